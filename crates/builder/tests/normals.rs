//! Estimated normals through whole builds: right on walls and spheres, the same however memory cuts
//! a cloud into chunks, turned to the scanner if its position is known; and the effect of the modes
//! `keep` and `none` on the file, also with clip lines and tangents.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod given;

use cloud::{below, random};
use esker_builder::{
    NormalsMode, Options, Shares, append_sources, build_shared, build_sources, merge,
};
use esker_format::{EskerFile, Forest, Normals, PlaneKind};
use esker_points::quant::{oct_decode, oct_encode};
use esker_points::tangents::axis_of;
use esker_points::task::Silent;
use esker_points::{AttrType, Task, attribute::names};
use esker_scan::Source;
use given::{Given, boxed, given};
use std::collections::BTreeMap;
use std::path::Path;

const UNKNOWN: [i16; 2] = [i16::MIN; 2];

fn options(normals: NormalsMode) -> Options {
    Options { node_capacity: 1024, normals, ..Default::default() }
}

fn build_from(sources: Vec<Box<dyn Source>>, shares: Shares, normals: NormalsMode) -> EskerFile {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    build_shared(sources, &out, &options(normals), shares, &Silent).unwrap();
    EskerFile::open(&out).unwrap()
}

/// Ways in which normals are estimated.
const ESTIMATES: [NormalsMode; 2] = [NormalsMode::Estimate, NormalsMode::Fast];

/// World positions and normal codes of all points of a file.
fn normals(file: &EskerFile) -> Vec<([f64; 3], [i16; 2])> {
    let mut out = Vec::new();
    for i in 0..file.table().nodes.len() as u32 {
        let points = file.read_page(i).unwrap().points().unwrap();
        let world = points.positions.iter().map(|&p| file.metadata().lattice.world(p));
        out.extend(world.zip(points.normals.iter().copied()));
    }
    out
}

fn ample() -> Shares {
    Shares::of(1 << 30)
}

/// Angle between the lines of a code and a direction, degrees.
fn angle(code: [i16; 2], n: [f64; 3]) -> f64 {
    let ours = oct_decode(code).map(f64::from);
    let norm = n.iter().map(|c| c * c).sum::<f64>().sqrt();
    let cos = (0..3).map(|i| ours[i] * n[i]).sum::<f64>() / norm;
    cos.abs().min(1.0).acos().to_degrees()
}

/// A wall of 20 m and a sphere of 3 m behind it, in millimetres.
fn wall_and_sphere(count: u64) -> Given {
    let place = |i: u64| {
        let at = |k: u64, n: u32| below(4 * i + k, n);
        if i.is_multiple_of(2) {
            return [at(0, 20_000), 0, at(1, 20_000)];
        }
        let z = f64::from(at(0, 2_000_001)) / 1e6 - 1.0;
        let turn = f64::from(at(1, 1_000_000)) / 1e6 * std::f64::consts::TAU;
        let r = (1.0 - z * z).sqrt();
        [r * turn.cos(), r * turn.sin(), z].map(|c| (c * 3000.0) as i32 + 10_000)
    };
    given("a.las", [0.001; 3], (0..count).map(place).collect())
}

#[test]
fn a_wall_and_a_sphere_have_their_normals_in_every_node() {
    for mode in ESTIMATES {
        let shares = Shares { buffer_bytes_max: 0, chunk_bytes_max: 0 };
        let file = build_from(boxed(&[wall_and_sphere(60_000)]), shares, mode);
        assert_eq!(file.metadata().normals, Normals::Estimated);
        let (mut wall, mut sphere) = (Vec::new(), Vec::new());
        for (p, code) in normals(&file) {
            assert_ne!(code, UNKNOWN);
            if p[1].abs() < 1e-9 {
                wall.push(angle(code, [0.0, 1.0, 0.0]));
            } else {
                sphere.push(angle(code, p.map(|c| c - 10.0)));
            }
        }
        let worst = |angles: &[f64]| angles.iter().copied().fold(0.0, f64::max);
        assert!(worst(&wall) < 0.1, "{mode:?}: {}", worst(&wall));
        let mean = sphere.iter().sum::<f64>() / sphere.len() as f64;
        assert!(mean < 1.0 && worst(&sphere) < 10.0, "{mode:?}: {mean} {}", worst(&sphere));
    }
}

/// Hills, a stack that exceeds memory, a grid, distant strays.
fn mixed(count: u64) -> Given {
    let place = |i: u64| {
        let (x, y) = (below(3 * i, 200_000), below(3 * i + 1, 150_000));
        match random(i) % 8 {
            0 => [77_000, y, below(3 * i + 2, 40_000)],
            1 => [5000, 6000, 7000],
            2 => [x / 2000 * 2000, y / 2000 * 2000, 0],
            3 if i.is_multiple_of(64) => [x * 40, y * 40, 1_000_000],
            _ => [
                x,
                y,
                (2500.0 * ((f64::from(x) / 9e3).sin() + (f64::from(y) / 1.1e4).cos())) as i32,
            ],
        }
    };
    given("a.las", [0.001; 3], (0..count).map(place).collect())
}

#[test]
fn any_memory_bound_and_any_number_of_threads_give_the_same_normals() {
    let sources = [mixed(40_000)];
    let by_place = |file: &EskerFile| -> BTreeMap<[u64; 3], [i16; 2]> {
        normals(file).into_iter().map(|(p, code)| (p.map(f64::to_bits), code)).collect()
    };
    for mode in ESTIMATES {
        let estimated = |shares| build_from(boxed(&sources), shares, mode);
        let whole = by_place(&estimated(ample()));
        assert!(whole.values().filter(|&&c| c != UNKNOWN).count() > whole.len() * 9 / 10);
        for buffer_bytes_max in [0, 200_000, 1 << 30] {
            let shares = Shares { buffer_bytes_max, chunk_bytes_max: 0 };
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let cut = by_place(&pool.install(|| estimated(shares)));
                assert!(cut == whole, "{mode:?}: {threads} threads, {shares:?}: other normals");
            }
        }
    }
}

#[test]
fn normals_face_the_scanner_that_recorded_the_point() {
    let open = || {
        let path = Path::new("synthetic:office:60000:5");
        esker_scan::open(path, &Default::default(), &Silent as &dyn Task).unwrap()
    };
    let source = open();
    let scanner = source.info().scanner.clone().unwrap();
    let file = build_from(vec![open()], ample(), NormalsMode::Estimate);
    assert_eq!(file.metadata().normals, Normals::Oriented);
    let ids = file.metadata().schema.find(names::POINT_SOURCE_ID).unwrap();
    let (mut known, mut all) = (0, 0);
    for i in 0..file.table().nodes.len() as u32 {
        let points = file.read_page(i).unwrap().points().unwrap();
        for (k, &code) in points.normals.iter().enumerate() {
            let at = file.metadata().lattice.world(points.positions[k]);
            let id =
                u16::from_le_bytes([points.columns[ids][2 * k], points.columns[ids][2 * k + 1]]);
            let from = scanner.of(Some(id)).unwrap();
            let step = [0, 1, 2].map(|a| from[a] - at[a]);
            let n = oct_decode(code).map(f64::from);
            let norm = step.iter().map(|c| c * c).sum::<f64>().sqrt();
            let towards = (0..3).map(|a| n[a] * step[a]).sum::<f64>() / norm;
            assert!(towards > -1e-3, "{at:?} looks away from {from:?}: {n:?}");
            known += usize::from(code != UNKNOWN);
            all += 1;
        }
    }
    assert!(known > all * 9 / 10, "{known} of {all}");
}

/// A slope whose own normals, all equal, differ from those that its points would give.
fn with_normals() -> Given {
    let component = |value: f32| move |_| u64::from(value.to_bits());
    given(
        "a.ply",
        [0.001; 3],
        (0..5000).map(|i| [below(2 * i, 9000), below(2 * i + 1, 9000), 0]).collect(),
    )
    .with("nx", AttrType::F32, component(0.6))
    .with("ny", AttrType::F32, component(0.0))
    .with("nz", AttrType::F32, component(0.8))
}

#[test]
fn kept_estimated_and_no_normals_leave_attributes_exact() {
    let built = |mode| build_from(boxed(&[with_normals()]), ample(), mode);
    let [keep, estimate, none] =
        [NormalsMode::Keep, NormalsMode::Estimate, NormalsMode::None].map(built);
    assert_eq!(keep.footer().hash, estimate.footer().hash);
    assert_eq!(keep.footer().hash, none.footer().hash);
    let plane = |file: &EskerFile| file.read_page(0).unwrap().plane(PlaneKind::Normal).unwrap();
    let bytes = |code: [i16; 2]| code.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<u8>>();
    let own = bytes(oct_encode([0.6, 0.0, 0.8]));
    assert!(plane(&keep).unwrap().chunks(4).all(|c| c == own));
    let up = bytes(oct_encode([0.0, 0.0, 1.0]));
    assert!(plane(&estimate).unwrap().chunks(4).all(|c| c == up));
    assert_eq!((plane(&none), none.metadata().normals), (None, Normals::None));
    for file in [&estimate, &none] {
        assert_eq!(esker_format::verify(file, &Silent).unwrap().hash, keep.footer().hash);
    }
}

#[test]
fn scans_without_normals_have_those_of_cells_by_default() {
    let sources = [mixed(20_000)];
    let by_default =
        built(&sources, &Options { node_capacity: 1024, ..Options::default() }, ample());
    assert_eq!(by_default.metadata().normals, Normals::Estimated);
    let fast = built(&sources, &options(NormalsMode::Fast), ample());
    assert_eq!(drawn(&by_default), drawn(&fast));
    // Beside a scan with normals, the others have none.
    let both = [with_normals(), floor("b.las", 20_000)];
    let file = built(&both, &options(NormalsMode::Keep), ample());
    assert_eq!(file.metadata().normals, Normals::Source);
    let unknown = UNKNOWN.map(i16::to_le_bytes).concat();
    let drawn = drawn(&file);
    assert_eq!(drawn.values().filter(|(normal, ..)| *normal == unknown).count(), 20_000);
}

#[test]
fn appending_and_merging_estimate_normals_only_beside_estimated_ones() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(format!("{name}.esker"));
    let keep = options(NormalsMode::Keep);
    let build_as = |mode, scan: Given, name: &str| {
        build_sources(boxed(&[scan]), &at(name), &options(mode), &Silent).unwrap();
    };
    build_as(NormalsMode::None, floor("a.las", 0), "none");
    build_as(NormalsMode::Estimate, floor("a.las", 0), "estimated");
    build_as(NormalsMode::Keep, normalled(floor("a.ply", 0), |_| [0.6, 0.0, 0.8]), "given");
    let origin = |name: &str| EskerFile::open(&at(name)).unwrap().metadata().normals;
    for (old, appended, merged) in [
        ("none", Normals::None, Normals::None),
        ("estimated", Normals::Estimated, Normals::Estimated),
        ("given", Normals::None, Normals::Source),
    ] {
        let forest = Forest::open(&at(old)).unwrap();
        let new = boxed(&[floor("b.las", 5000)]);
        append_sources(&forest, new, &at("more"), &keep, &Silent).unwrap();
        assert_eq!(origin("more"), appended, "{old}");
        merge(&[at("more")], &at("all"), &keep, &Silent).unwrap();
        assert_eq!(origin("all"), merged, "{old}");
        let tangents = Options { tangents: true, ..keep.clone() };
        merge(&[at("more")], &at("all"), &tangents, &Silent).unwrap();
        assert_ne!(origin("all"), Normals::None, "{old}");
    }
}

/// Own normals of all points, by index.
fn normalled(given: Given, normal: impl Fn(u64) -> [f32; 3] + Copy) -> Given {
    let component = |axis: usize| move |i: u64| u64::from(normal(i)[axis].to_bits());
    given.with("nx", AttrType::F32, component(0)).with("ny", AttrType::F32, component(1)).with(
        "nz",
        AttrType::F32,
        component(2),
    )
}

fn built(sources: &[Given], options: &Options, shares: Shares) -> EskerFile {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    build_shared(boxed(sources), &out, options, shares, &Silent).unwrap();
    EskerFile::open(&out).unwrap()
}

/// Of each position: code of the normal that is drawn, clip lines, tangents.
type Drawn = BTreeMap<[u32; 3], (Vec<u8>, [u32; 4], [u8; 4])>;

fn drawn(file: &EskerFile) -> Drawn {
    let mut drawn = Drawn::new();
    for i in 0..file.table().nodes.len() as u32 {
        let page = file.read_page(i).unwrap();
        let normals = page.plane(PlaneKind::Normal).unwrap().unwrap();
        let points = page.points().unwrap();
        for (k, &p) in points.positions.iter().enumerate() {
            let lines = points.clip_lines.get(k).copied().unwrap_or_default();
            let tangents = points.tangents.get(k).copied().unwrap_or_default();
            drawn.insert(p, (normals[4 * k..4 * k + 4].to_vec(), lines, tangents));
        }
    }
    drawn
}

fn normals_of(drawn: &Drawn) -> Vec<&Vec<u8>> {
    drawn.values().map(|(normal, ..)| normal).collect()
}

/// A level floor of lines along y from `x` on, 40 mm apart, with points 10 mm apart.
fn floor(name: &str, x: i32) -> Given {
    let place = |i: i32| [x + i % 100 * 40, i / 100 * 10 + i % 100 * 7 % 10, 0];
    given(name, [0.001; 3], (0..20_000).map(place).collect())
}

/// Angles between the long axes of splats and a direction, ascending, degrees.
fn off_axis<'a>(
    points: impl Iterator<Item = &'a (Vec<u8>, [u32; 4], [u8; 4])>,
    direction: [f64; 3],
) -> Vec<f64> {
    let long = points.filter(|(.., tangents)| tangents[3] > 0);
    let mut off: Vec<f64> = long
        .map(|(.., tangents)| {
            let along = axis_of([tangents[0], tangents[1]].map(u8::cast_signed)).map(f64::from);
            let cosine = (0..3).map(|i| along[i] * direction[i]).sum::<f64>().abs();
            cosine.min(1.0).acos().to_degrees()
        })
        .collect();
    off.sort_by(f64::total_cmp);
    off
}

#[test]
fn tangents_lie_in_the_planes_of_the_scans_own_normals_which_stay_to_the_bit() {
    // The normals are turned by 37 degrees, so the long axes are too.
    let floor = normalled(floor("a.ply", 0), |_| [0.6, 0.0, 0.8]);
    let keep = options(NormalsMode::Keep);
    let with_tangents = Options { tangents: true, ..keep.clone() };
    let sources = [floor];
    let bare = drawn(&built(&sources, &keep, ample()));
    let file = built(&sources, &with_tangents, ample());
    assert_eq!(file.metadata().normals, Normals::Source);
    let whole = drawn(&file);
    assert_eq!(normals_of(&whole), normals_of(&bare));
    let off = off_axis(whole.values(), [0.8, 0.0, -0.6]);
    assert!(off.len() > 5000, "{}", off.len());
    assert!(off[off.len() * 9 / 10] < 12.0, "{}", off[off.len() * 9 / 10]);
}

#[test]
fn beside_points_with_normals_those_without_stay_so_and_get_tangents_of_their_neighbours() {
    let sources = [normalled(floor("a.ply", 0), |_| [0.6, 0.0, 0.8]), floor("b.las", 20_000)];
    let keep = options(NormalsMode::Keep);
    let bare = drawn(&built(&sources, &keep, ample()));
    let file = built(&sources, &Options { tangents: true, ..keep }, ample());
    assert_eq!(file.metadata().normals, Normals::Source);
    let whole = drawn(&file);
    assert_eq!(normals_of(&whole), normals_of(&bare));
    let unknown = UNKNOWN.map(i16::to_le_bytes).concat();
    let without = || whole.values().filter(|(normal, ..)| *normal == unknown);
    assert_eq!(without().count(), 20_000);
    let off = off_axis(without(), [1.0, 0.0, 0.0]);
    assert!(off.len() > 5000 && off[off.len() * 9 / 10] < 12.0, "{}", off.len());
}

#[test]
fn sharp_edges_are_where_the_scans_own_normals_turn_under_any_memory_bound() {
    // A level field whose own normals lean by 20 degrees to either side of its middle.
    let side = |i: u64| if i % 150 < 75 { -1.0 } else { 1.0 };
    let place = |i: u64| {
        [i as i32 % 150 * 20 + below(2 * i, 13), i as i32 / 150 * 20 + below(2 * i + 1, 13), 0]
    };
    let field = given("a.ply", [0.001; 3], (0..22_500).map(place).collect());
    let field = normalled(field, |i| [side(i) * 0.342, 0.0, 0.94]);
    let keep = options(NormalsMode::Keep);
    let sources = [field];
    let bare = drawn(&built(&sources, &keep, ample()));
    let sharp = Options { sharp_features: true, ..keep.clone() };
    let file = built(&sources, &sharp, ample());
    assert_eq!(file.metadata().normals, Normals::Source);
    let whole = drawn(&file);
    assert_eq!(normals_of(&whole), normals_of(&bare));
    let lattice = file.metadata().lattice;
    let (mut near, mut clipped, mut far) = (0, 0, 0);
    for (p, (_, lines, _)) in &whole {
        let away = (lattice.world(*p)[0] - 1.497).abs();
        near += usize::from(away < 0.015);
        clipped += usize::from(away < 0.015 && *lines != [0; 4]);
        far += usize::from(away > 0.06 && *lines != [0; 4]);
    }
    assert!(near > 100 && clipped * 10 > near * 9 && far == 0, "{near} {clipped} {far}");
    // The positions alone have no edge.
    let estimate = Options { normals: NormalsMode::Estimate, ..sharp.clone() };
    let flat = drawn(&built(&sources, &estimate, ample()));
    assert!(flat.values().all(|(_, lines, _)| *lines == [0; 4]));
    let both = Options { tangents: true, ..sharp };
    let whole = drawn(&built(&sources, &both, ample()));
    for buffer_bytes_max in [0, 1 << 30] {
        let shares = Shares { buffer_bytes_max, chunk_bytes_max: 0 };
        assert!(drawn(&built(&sources, &both, shares)) == whole, "{shares:?}");
    }
}

#[test]
fn what_needs_normals_is_refused_without_them() {
    let folder = tempfile::tempdir().unwrap();
    for (sharp_features, tangents, name) in
        [(true, false, "--sharp-features"), (false, true, "--tangents")]
    {
        let options = Options { sharp_features, tangents, ..options(NormalsMode::None) };
        let out = folder.path().join("out.esker");
        let refused =
            build_shared(boxed(&[with_normals()]), &out, &options, ample(), &Silent).unwrap_err();
        assert!(refused.to_string().contains(name), "{refused}");
    }
}
