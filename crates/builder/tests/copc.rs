//! Exports to COPC have all points with all attributes, each in the voxel of its chunk, whatever
//! the shape of the cloud and the number of trees.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;
mod octree;

use cloud::below;
use esker_builder::{
    BuildError, ExportOptions, Options, against_sources, append_sources, build_sources, export,
    export_with, verify_export,
};
use esker_format::{EskerFile, Forest};
use esker_points::task::Silent;
use esker_points::{AttrType, Filter, Task};
use esker_scan::source::{Crs, OpenOptions};
use given::{Given, boxed, given, names_in};
use octree::Octree;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

const WKT: &str = r#"LOCAL_CS["site",UNIT["metre",1]]"#;

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

fn scan(count: u64, place: impl Fn(u64) -> [i32; 3]) -> Given {
    given("a.las", [0.001; 3], (0..count).map(place).collect())
        .with("intensity", AttrType::U16, |i| i)
        .with("gps_time", AttrType::F64, |i| (i as f64 - 100.0).to_bits())
}

/// Folder, built forest and the name of its export.
struct Built {
    folder: tempfile::TempDir,
    forest: Forest,
    out: PathBuf,
}

impl Built {
    fn of(sources: &[Given]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("in.esker");
        build_sources(boxed(sources), &file, &options(), &Silent).unwrap();
        let out = folder.path().join("out.copc.laz");
        Self { forest: Forest::open(&file).unwrap(), out, folder }
    }

    fn export(&self, filter: &Filter) -> Octree {
        let report = export(&self.forest, &self.out, filter, &Silent).unwrap();
        let octree = Octree::read(&self.out);
        assert_eq!(octree.count() as u64, report.points_out);
        octree
    }

    /// Exports all points, which must come back.
    fn whole(&self) -> Octree {
        let octree = self.export(&Filter::default());
        let verified = verify_export(&self.out, &self.forest, &Silent).unwrap();
        assert_eq!(verified.points, self.forest.points());
        octree
    }
}

fn sorted(scans: &[Given]) -> Vec<[i32; 3]> {
    let mut all: Vec<_> = scans.iter().flat_map(|scan| scan.positions.iter().copied()).collect();
    all.sort_unstable();
    all
}

/// Clouds whose trees differ: by name, with the number of levels that their octrees need at least.
fn clouds() -> Vec<(&'static str, Given, i32)> {
    let near = |i: u64, size: u32| [0, 1, 2].map(|axis| below(3 * i + axis, size));
    let middle = move |i: u64| near(i, 3_000).map(|c| c - 1_500);
    vec![
        ("a volume", scan(6_000, move |i| near(i, 9_000)), 2),
        ("a plane", scan(6_000, |i| [below(2 * i, 50_000), below(2 * i + 1, 50_000), 7]), 2),
        ("a tower", scan(6_000, |i| [below(2 * i, 3), below(2 * i + 1, 3), below(i, 900_000)]), 3),
        ("a line", scan(6_000, |i| [i as i32, 0, 0]), 3),
        // Every axis crosses the middle of the lattice, so the cell of the root is all of it.
        ("around the origin", scan(6_000, middle), 2),
        ("across one face", scan(6_000, move |i| [middle(i)[0], 10 + middle(i)[1].abs(), 40]), 2),
        // Small clusters far apart: levels of the tree skip.
        (
            "clusters",
            scan(8_000, move |i| {
                let corner = [[0, 0, 0], [9_000_000, 0, 0], [0, 8_000_000, 70], [5_000_000; 3]];
                let (at, p) = (corner[i as usize % 4], near(i, 200));
                [0, 1, 2].map(|axis| at[axis] + p[axis])
            }),
            10,
        ),
        // More points at one place than a node holds: continuations.
        ("piles", scan(5_000, move |i| [near(i % 3, 9_000)[0], 5, 5]), 1),
        ("one place", scan(2_000, |_| [5, 6, 7]), 0),
        ("one point", scan(1, |_| [-5, 6, 7]), 0),
        ("both ends", scan(2, |i| [[i32::MIN; 3], [i32::MAX; 3]][i as usize]), 0),
    ]
}

#[test]
fn every_cloud_comes_back_with_each_point_in_the_voxel_of_its_chunk() {
    for (name, scan, levels) in clouds() {
        let built = Built::of(std::slice::from_ref(&scan));
        let octree = built.whole();
        assert_eq!(octree.sorted(), sorted(&[scan]), "{name}");
        assert_eq!(octree.empty(), 0, "{name}");
        assert!(octree.depth() >= levels, "{name}: {}", octree.depth());
        assert_eq!(names_in(built.folder.path()).len(), 2, "{name}");
    }
}

#[test]
fn continuations_share_the_chunk_of_their_node() {
    let built = Built::of(&[scan(2_000, |_| [5, 6, 7])]);
    let nodes = &built.forest.table().nodes;
    assert!(nodes.len() > 5 && nodes[1..].iter().all(|node| node.is_continuation()));
    assert_eq!(built.whole().points[&[0; 4]].len(), 2_000);
}

#[test]
fn the_cube_is_about_as_large_as_the_cloud_wherever_it_lies() {
    for place in [0, -700, 123_456_789] {
        let built = Built::of(&[scan(3_000, move |i| {
            [0, 1, 2].map(|axis| place + below(3 * i + axis, 1_500))
        })]);
        let octree = built.whole();
        assert!(octree.halfsize < 4.0 * 0.001 * 1_500.0, "{place}: {}", octree.halfsize);
    }
}

#[test]
fn points_grow_denser_level_by_level() {
    let built = Built::of(&[scan(20_000, |i| [below(2 * i, 50_000), below(2 * i + 1, 50_000), 0])]);
    let octree = built.whole();
    let upto = |level: i32| -> usize {
        octree.points.iter().filter(|(key, _)| key[0] <= level).map(|(_, p)| p.len()).sum()
    };
    // Half the spacing gives four times the points.
    for level in 0..2 {
        let ratio = upto(level + 1) as f64 / upto(level) as f64;
        assert!((1.5..8.0).contains(&ratio), "{level}: {ratio}");
    }
}

#[test]
fn all_fields_of_the_point_format_and_extra_bytes_come_back() {
    let full = scan(3_000, |i| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000)))
        .with("returns", AttrType::U8, |i| (i % 3 + 1) | 0x30)
        .with("flags", AttrType::U8, |i| i % 16)
        .with("classification", AttrType::U8, |i| i % 40)
        .with("user_data", AttrType::U8, |i| i % 251)
        .with("scan_angle", AttrType::I16, |i| i)
        .with("point_source_id", AttrType::U16, |i| i / 7)
        .with("red", AttrType::U16, |i| 9 * i)
        .with("green", AttrType::U16, |i| 7 * i)
        .with("blue", AttrType::U16, |i| 5 * i);
    let with_nir = full.clone().with("nir", AttrType::U16, |i| 3 * i);
    let extra = full
        .clone()
        .with("range", AttrType::F32, |i| (i as f32 * 0.1).to_bits().into())
        .with("beam", AttrType::U8, |i| i % 64);
    for (scan, format) in [(full, 7), (with_nir, 8), (extra, 7)] {
        let built = Built::of(std::slice::from_ref(&scan));
        assert_eq!(built.whole().point_format, format);
        let source = esker_scan::open(&built.out, &OpenOptions::default(), &Silent).unwrap();
        let file = EskerFile::open(&built.folder.path().join("in.esker")).unwrap();
        // Of the format's own fields, no attribute is added.
        let same = against_sources(&file, vec![source], &Silent).unwrap();
        assert_eq!(same.points, 3_000);
    }
}

#[test]
fn filters_keep_their_points_and_every_voxel_in_reach() {
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000));
    let scan = scan(9_000, place).with("classification", AttrType::U8, |i| i % 50);
    let built = Built::of(std::slice::from_ref(&scan));
    let kept = |keeps: &dyn Fn(u64, [i32; 3]) -> bool| {
        let mut all: Vec<_> = (0..9_000).filter(|&i| keeps(i, place(i))).map(place).collect();
        all.sort_unstable();
        all
    };
    let boxed = Filter { bounds: Some("2,2,2,3.5,4,9".parse().unwrap()), ..Filter::default() };
    let within = kept(&|_, p| {
        (2_000..=3_500).contains(&p[0]) && (2_000..=4_000).contains(&p[1]) && p[2] >= 2_000
    });
    assert_eq!(built.export(&boxed).sorted(), within);
    let rare = Filter { classes: Some("7".parse().unwrap()), ..Filter::default() };
    let octree = built.export(&rare);
    assert_eq!(octree.sorted(), kept(&|i, _| i % 50 == 7));
    let few = Filter { values: vec!["gps_time:-40..-30".parse().unwrap()], ..Filter::default() };
    let octree = built.export(&few);
    assert_eq!(octree.sorted(), kept(&|i, _| (60..=70).contains(&i)));
    assert!(octree.empty() > 0, "ancestors without points have entries");
    let coarse = Filter { max_spacing: Some(0.9), ..Filter::default() };
    let sample = built.export(&coarse).count();
    assert!((100..6_000).contains(&sample), "{sample}");
    let none = Filter { classes: Some("99".parse().unwrap()), ..Filter::default() };
    let error = export(&built.forest, &built.out, &none, &Silent).unwrap_err().to_string();
    assert!(error.contains("none of its 9000 points is wanted"), "{error}");
}

#[test]
fn the_trees_of_a_forest_share_one_octree() {
    let at = |name: &str, corner: [i32; 3], count: u64| {
        let place = |i: u64| [0, 1, 2].map(|axis| corner[axis] + below(3 * i + axis as u64, 4_000));
        let mut scan = scan(count, place);
        (scan.info.path, scan.info.grid.name) = (name.into(), name.into());
        scan
    };
    let scans = [
        at("a.las", [0; 3], 3_000),
        at("b.las", [-2_000, 500, 0], 2_000),
        at("c.las", [900_000, 0, 77], 1_000),
        at("d.las", [20_000, -30_000, 0], 1),
    ];
    let built = Built::of(&scans[..1]);
    let mut forest = Forest::open(&built.folder.path().join("in.esker")).unwrap();
    for scan in &scans[1..] {
        let next = built.folder.path().join(format!("{}.esker", scan.info.path.display()));
        append_sources(&forest, boxed(std::slice::from_ref(scan)), &next, &options(), &Silent)
            .unwrap();
        forest = Forest::open(&next).unwrap();
    }
    let built = Built { forest, ..built };
    let octree = built.whole();
    assert_eq!(octree.sorted(), sorted(&scans));
    // The root has a share of each tree, not all of the small ones.
    let root = octree.points[&[0; 4]].len();
    assert!(root < 1_000, "{root}");
}

#[test]
fn a_file_without_points_gives_an_octree_without_points() {
    let built = Built::of(&[scan(0, |_| [0; 3])]);
    let octree = built.whole();
    assert_eq!((octree.count(), octree.entries.len(), octree.empty()), (0, 1, 1));
}

#[test]
fn steps_of_different_lengths_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000));
    let degrees = given("a.las", [1e-7, 1e-7, 0.001], (0..500).map(place).collect());
    let file = folder.path().join("in.esker");
    build_sources(boxed(&[degrees]), &file, &options(), &Silent).unwrap();
    let forest = Forest::open(&file).unwrap();
    let out = folder.path().join("out.copc.laz");
    let error = export(&forest, &out, &Filter::default(), &Silent).unwrap_err().to_string();
    assert!(error.contains("voxels of COPC are cubes"), "{error}");
    assert!(error.contains("one step on all axes") && error.contains(".laz"), "{error}");
    assert_eq!(names_in(folder.path()), ["in.esker"]);
}

#[test]
fn the_coordinate_system_is_wkt_of_the_scan_or_given() {
    let with = |text: Option<&str>| {
        let mut scan = scan(500, |i| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000)));
        scan.info.crs = text.map(|text| Crs { text: text.into(), unit: None });
        Built::of(&[scan])
    };
    let crs_of = |built: &Built, crs: Option<&str>| {
        let options = ExportOptions { crs: crs.map(str::to_owned), ..Default::default() };
        let exported =
            export_with(&built.forest, &built.out, &Filter::default(), options, &Silent)?;
        let source = esker_scan::open(&built.out, &OpenOptions::default(), &Silent).unwrap();
        let bytes = std::fs::read(&built.out).unwrap();
        assert_eq!(bytes[6] & 16, 16, "the bit of WKT");
        Ok::<_, BuildError>((source.info().crs.as_ref().map(|c| c.text.clone()), exported.notes))
    };
    assert_eq!(crs_of(&with(Some(WKT)), None).unwrap().0.as_deref(), Some(WKT));
    let (crs, notes) = crs_of(&with(None), None).unwrap();
    assert!(crs.is_none() && notes.iter().any(|n| n.starts_with("no coordinate")), "{notes:?}");
    let keys = with(Some("GeoTIFF: ProjectedCSType=2154"));
    let error = crs_of(&keys, None).unwrap_err().to_string();
    assert!(error.contains("give it by --crs"), "{error}");
    let error = crs_of(&keys, Some("GeoTIFF: ProjectedCSType=2154")).unwrap_err().to_string();
    assert!(error.contains("as WKT or a file of it"), "{error}");
    assert_eq!(crs_of(&keys, Some(WKT)).unwrap().0.as_deref(), Some(WKT));
    let options = ExportOptions { crs: Some(WKT.into()), ..Default::default() };
    let las = keys.folder.path().join("out.las");
    let error = export_with(&keys.forest, &las, &Filter::default(), options, &Silent).unwrap_err();
    assert!(error.to_string().contains("--crs gives the coordinate reference system of COPC"));
}

#[test]
fn an_export_that_is_not_of_the_file_is_told_apart() {
    let place = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 9_000));
    let built = Built::of(&[scan(3_000, place)]);
    built.whole();
    let differs = |other: Given| {
        let other = Built::of(&[other]);
        let error = verify_export(&built.out, &other.forest, &Silent).unwrap_err();
        assert!(matches!(error, BuildError::Differs(_)), "{error}");
        error.to_string()
    };
    assert!(differs(scan(2_999, place)).contains("holds 3000 points"));
    let moved = |i: u64| if i == 77 { [1, 2, 3] } else { place(i) };
    assert!(differs(scan(3_000, moved)).contains("its points are not those of"));
    let brighter = scan(3_000, place);
    let brighter = Given { columns: brighter.columns.clone(), ..brighter };
    let mut brighter = brighter;
    brighter.columns[1][0] ^= 1;
    assert!(differs(brighter).contains("its points are not those of"));
    assert!(differs(scan(3_000, place).with("beam", AttrType::U8, |_| 0)).contains("its records"));
    // As ordinary LAS and LAZ, too.
    for name in ["out.las", "out.laz"] {
        let out = built.folder.path().join(name);
        export(&built.forest, &out, &Filter::default(), &Silent).unwrap();
        assert_eq!(verify_export(&out, &built.forest, &Silent).unwrap().points, 3_000);
    }
    let text = built.folder.path().join("out.csv");
    export(&built.forest, &text, &Filter::default(), &Silent).unwrap();
    let error = verify_export(&text, &built.forest, &Silent).unwrap_err().to_string();
    assert!(error.contains("only LAS, LAZ and COPC"), "{error}");
}

/// Cancels the task after `after` checks.
struct Stops {
    checks: AtomicU64,
    after: u64,
}

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.checks.fetch_add(1, Ordering::Relaxed) >= self.after
    }
}

#[test]
fn an_export_can_be_cancelled_anywhere() {
    let built = Built::of(&[scan(9_000, |i| [0, 1, 2].map(|a| below(3 * i + a, 9_000)))]);
    let run = |after| {
        let task = Stops { checks: AtomicU64::new(0), after };
        let result = export(&built.forest, &built.out, &Filter::default(), &task);
        (result, task.checks.into_inner())
    };
    let (result, checks) = run(u64::MAX);
    result.unwrap();
    let names = |folder: &Path| {
        let mut names = names_in(folder);
        names.sort();
        names
    };
    let before = std::fs::read(&built.out).unwrap();
    assert!(checks > 20, "{checks}");
    for after in (0..6).map(|i| i * (checks - 1) / 5) {
        let (result, _) = run(after);
        assert!(matches!(result, Err(BuildError::Cancelled(_))), "{after}: {result:?}");
        assert_eq!(names(built.folder.path()), ["in.esker", "out.copc.laz"]);
        assert_eq!(std::fs::read(&built.out).unwrap(), before, "the earlier file survives");
    }
}
