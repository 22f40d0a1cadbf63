//! The points of a file are exported whole, or as a filter selects; an export that ends early
//! leaves no file behind.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{BuildError, Options, build_sources, export};
use esker_format::{Footer, Forest, ForestFilter, PlaneKind};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES};
use esker_points::task::Silent;
use esker_points::{AttrType, Filter, Task};
use given::{Given, boxed, given, names_in};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points of a hill in two sources: one with classes and times, the other with intensities only.
fn sources() -> Vec<Given> {
    let hill = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
    let classed = given("a.las", [0.001; 3], (0..20_000).map(hill).collect())
        .with("classification", AttrType::U8, |i| i % 5)
        .with("gps_time", AttrType::F64, |i| (i as f64).to_bits());
    let bare = given("b.las", [0.001; 3], (20_000..32_000).map(hill).collect());
    vec![classed, bare.with("intensity", AttrType::U16, |i| i + 1)]
}

fn built(folder: &Path) -> Forest {
    let out = folder.join("in.esker");
    let options = Options { node_capacity: 256, ..Default::default() };
    build_sources(boxed(&sources()), &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

/// Footer of the only file.
fn footer(file: &Forest) -> &Footer {
    file.files().next().unwrap().footer()
}

fn filter(change: impl FnOnce(&mut Filter)) -> Filter {
    let mut filter = Filter::default();
    change(&mut filter);
    filter
}

/// Sorted lines of the export as text.
fn lines(file: &Forest, folder: &Path, filter: &Filter) -> Vec<String> {
    let out = folder.join("out.csv");
    let report = export(file, &out, filter, &Silent).unwrap();
    let text = std::fs::read_to_string(&out).unwrap();
    let mut lines: Vec<_> = text.lines().skip(1).map(str::to_owned).collect();
    assert_eq!(report.points_out, lines.len() as u64);
    lines.sort();
    lines
}

#[test]
fn different_sources_are_exported_together_with_zeros_for_missing_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let report =
        export(&file, &folder.path().join("out.las"), &Filter::default(), &Silent).unwrap();
    assert_eq!((report.points_out, report.hash), (32_000, footer(&file).hash));
    assert_eq!(report.nodes_read, footer(&file).nodes);
    assert_eq!(report.format, "LAS 1.4, point format 6");
    assert_eq!(
        report.notes,
        [
            "32000 points without a return number are written as return 1",
            "zero where a point's source had none: classification, gps_time, intensity"
        ]
    );
    let all = lines(&file, folder.path(), &Filter::default());
    // x, y, z, classification, gps_time, intensity.
    assert_eq!(all.iter().filter(|l| l.ends_with(",0,0") || l.ends_with(",0")).count(), 20_000);
}

#[test]
fn class_filters_match_only_points_that_have_a_class() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    // Points of the second source are exported with zeros there, but have no class: not even a
    // filter for all classes matches them.
    for (classes, points) in [("0", 4_000), ("0-4", 20_000), ("0-255", 20_000)] {
        let wanted = filter(|f| f.classes = Some(classes.parse().unwrap()));
        assert_eq!(lines(&file, folder.path(), &wanted).len(), points, "{classes}");
        assert_eq!(drawn(&file, &wanted), points, "{classes}");
    }
}

/// Number of points that are drawn with a filter.
fn drawn(file: &Forest, filter: &Filter) -> usize {
    let shown =
        ForestFilter::of(file, Some(filter.on(file.lattice(), file.schema()).unwrap()), None)
            .unwrap();
    let nodes = 0..file.table().nodes.len() as u32;
    let drawn = nodes.map(|node| {
        let planes = shown.read(file, node, &[PlaneKind::Position]).unwrap();
        let positions = planes.get(PlaneKind::Position).unwrap_or_default();
        let positions = positions.as_chunks::<HOT_POSITION_BYTES>().0.iter();
        positions.take(shown.points_max(node)).filter(|p| p[HIDDEN_AT] == 0).count()
    });
    drawn.sum()
}

#[test]
fn flags_choose_points_in_exports_and_pictures_alike() {
    let folder = tempfile::tempdir().unwrap();
    let hill = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
    let (flags, class) = (|i: u64| i % 16, |i: u64| [2, 8, 12][i as usize % 3]);
    let flagged = given("a.las", [0.001; 3], (0..9_600).map(hill).collect())
        .with("flags", AttrType::U8, flags)
        .with("classification", AttrType::U8, class);
    let bare = given("b.las", [0.001; 3], (9_600..10_000).map(hill).collect());
    let out = folder.path().join("in.esker");
    let options = Options { node_capacity: 256, ..Default::default() };
    build_sources(boxed(&[flagged, bare]), &out, &options, &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    let count = |keeps: &dyn Fn(u64, u64) -> bool| {
        (0..9_600).filter(|&i| keeps(flags(i), class(i))).count()
    };
    let wanted = |word: &str| filter(|f| f.flags = word.parse().unwrap());
    let without = |word: &str| filter(|f| f.without_flags = word.parse().unwrap());
    let classes = |word: &str| filter(|f| f.classes = Some(word.parse().unwrap()));
    for (filter, points) in [
        (wanted("withheld"), count(&|f, _| f & 4 != 0)),
        (wanted("synthetic,key-point"), count(&|f, c| f & 3 != 0 || c == 8)),
        (without("withheld"), 400 + count(&|f, _| f & 4 == 0)),
        (without("overlap,synthetic"), 400 + count(&|f, c| f & 9 == 0 && c != 12)),
        (classes("overlap"), count(&|f, c| f & 8 != 0 || c == 12)),
        (classes("12"), count(&|_, c| c == 12)),
        (Filter { without_flags: "withheld".parse().unwrap(), ..classes("ground") }, {
            count(&|f, c| f & 4 == 0 && c == 2)
        }),
    ] {
        assert_eq!(lines(&file, folder.path(), &filter).len(), points, "{filter:?}");
        assert_eq!(drawn(&file, &filter), points, "{filter:?}");
    }
}

#[test]
fn values_choose_points_in_exports_and_pictures_alike() {
    let folder = tempfile::tempdir().unwrap();
    let hill = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), below(i, 300)];
    let odd = (1u64 << 53) + 1;
    let red = |i: u64| i * 7 % 65_536;
    let blue = |i: u64| i % 250;
    let time = |i: u64| if i.is_multiple_of(3) { f64::NAN } else { i as f64 * 0.25 };
    let amplitude = |i: u64| (i as f32 * 0.1).to_bits().into();
    let a = given("a.las", [0.001; 3], (0..6_000).map(hill).collect())
        .with("id", AttrType::U64, move |i| odd + i)
        .with("signed", AttrType::I64, |i| (i as i64 - 3_000) as u64)
        .with("place", AttrType::U32, |i| below(2 * i, 50_000) as u64)
        .with("red", AttrType::U16, red)
        .with("green", AttrType::U16, |_| 256)
        .with("blue", AttrType::U16, blue)
        .with("intensity", AttrType::U16, |i| i)
        .with("returns", AttrType::U8, |i| (i % 3 + 1) | 0x30)
        .with("gps_time", AttrType::F64, move |i| time(i).to_bits());
    // Colours and an intensity of other types, and no times.
    let b = given("b.las", [0.001; 3], (6_000..8_000).map(hill).collect())
        .with("red", AttrType::U8, |i| i % 256)
        .with("green", AttrType::U8, |_| 1)
        .with("blue", AttrType::U8, |_| 1)
        .with("amplitude", AttrType::F32, amplitude)
        .with("intensity", AttrType::F32, |i| (i as f32).to_bits().into());
    let out = folder.path().join("in.esker");
    let options = Options { node_capacity: 256, ..Default::default() };
    build_sources(boxed(&[a, b]), &out, &options, &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    let first = |keeps: &dyn Fn(u64) -> bool| (0..6_000).filter(|&i| keeps(i)).count();
    let second = |keeps: &dyn Fn(u64) -> bool| (0..2_000).filter(|&i| keeps(i)).count();
    let exact = format!("id:{}..{}", odd + 1, odd + 2);
    for (ranges, points) in [
        (&[exact.as_str()][..], 2),
        (&["signed:-10..-1"], 10),
        (&["red:1000..40000"], first(&|i| (1000..=40_000).contains(&red(i)))),
        (&["red:..100"], first(&|i| red(i) <= 100) + second(&|i| i % 256 <= 100)),
        (&["blue:200.."], first(&|i| blue(i) >= 200)),
        (&["intensity:1500..1509"], 20),
        (&["return:2..2", "number_of_returns:3..3"], 2_000),
        (&["time:100..200.1"], first(&|i| (100.0..=200.1).contains(&time(i)))),
        (&["gps_time:.."], 4_000),
        (&["amplitude:..0.1"], 2),
        (&["intensity:100..", "TIME:..50"], first(&|i| i >= 100 && time(i) <= 50.0)),
    ] {
        let wanted = filter(|f| f.values = ranges.iter().map(|r| r.parse().unwrap()).collect());
        assert_eq!(lines(&file, folder.path(), &wanted).len(), points, "{ranges:?}");
        assert_eq!(drawn(&file, &wanted), points, "{ranges:?}");
    }
    // Nodes whose values are all outside are not read.
    let place = filter(|f| f.values = vec!["place:..4000".parse().unwrap()]);
    let report = export(&file, &folder.path().join("place.csv"), &place, &Silent).unwrap();
    let within = first(&|i| below(2 * i, 50_000) <= 4_000);
    assert_eq!((report.points_out as usize, drawn(&file, &place)), (within, within));
    assert!(report.nodes_read * 2 < report.nodes, "{report:?}");
    let unknown = filter(|f| f.values = vec!["height:1..".parse().unwrap()]);
    let error = export(&file, &folder.path().join("no.csv"), &unknown, &Silent).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("in.esker: there is no attribute `height`"), "{error}");
    assert!(
        error.contains("amplitude, blue, gps_time, green, id, intensity, place, red"),
        "{error}"
    );
}

#[test]
fn attributes_converted_from_others_are_not_reported_as_zero() {
    let folder = tempfile::tempdir().unwrap();
    let place = |i: u64| [below(2 * i, 50_000), below(2 * i + 1, 50_000), 0];
    let scan = |name| given(name, [0.001; 3], (0..500).map(place).collect());
    let fine = scan("a.las").with("scan_angle", AttrType::I16, |i| i);
    let coarse = scan("b.las").with("scan_angle_rank", AttrType::I8, |i| i % 90);
    let bare = scan("c.las");
    let notes = |sources: &[Given], ending: &str| {
        let file = folder.path().join("angles.esker");
        build_sources(boxed(sources), &file, &Options::default(), &Silent).unwrap();
        let (file, out) =
            (Forest::open(&file).unwrap(), folder.path().join(format!("out.{ending}")));
        export(&file, &out, &Filter::default(), &Silent).unwrap().notes
    };
    // A LAS record has one field for both.
    let two = [fine.clone(), coarse.clone()];
    let returns =
        |points| format!("{points} points without a return number are written as return 1");
    let steps = "whole degrees of scan angles are written in steps of 0.006, off by at most 0.003";
    assert_eq!(notes(&two, "las"), [steps.to_owned(), returns(1000)]);
    let zeros = "zero where a point's source had none: scan_angle, scan_angle_rank".to_owned();
    assert_eq!(notes(&two, "ply"), std::slice::from_ref(&zeros));
    assert_eq!(notes(&[fine, coarse, bare], "las"), [steps.to_owned(), returns(1500), zeros]);
}

#[test]
fn an_absent_value_is_the_offset_of_its_attribute() {
    let folder = tempfile::tempdir().unwrap();
    let place = |i: i32| [i, 2 * i, 0];
    let scan = |name| given(name, [0.001; 3], (0..50).map(place).collect());
    let mut own = scan("a.las").with("amp", AttrType::U16, |i| i);
    let attribute = &mut std::sync::Arc::make_mut(&mut own.info.schema).attributes[0];
    (attribute.scale, attribute.offset) = (0.01, 10.0);
    let file = folder.path().join("in.esker");
    build_sources(boxed(&[own, scan("b.las")]), &file, &Options::default(), &Silent).unwrap();
    let out = folder.path().join("out.csv");
    let forest = Forest::open(&file).unwrap();
    let notes = export(&forest, &out, &Filter::default(), &Silent).unwrap().notes.join("\n");
    let want = "their offset, which is a stored zero, where a point's source had none: amp (10)";
    assert!(notes.contains(want) && !notes.contains("zero where"), "{notes}");
    let text = std::fs::read_to_string(&out).unwrap();
    assert_eq!(text.lines().filter(|line| line.ends_with(",10.00")).count(), 51, "{text}");
}

#[test]
fn nodes_that_a_filter_excludes_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let out = folder.path().join("out.ply");
    let corner = filter(|f| f.bounds = Some("0,0,5,5".parse().unwrap()));
    let report = export(&file, &out, &corner, &Silent).unwrap();
    // A hundredth of the area: its own nodes and those above them.
    assert!(report.nodes_read * 5 < report.nodes, "{report:?}");
    assert!(report.points_out > 200 && report.points_out < 500, "{report:?}");
    let total: u64 = file.table().nodes.iter().map(|n| u64::from(n.page_bytes)).sum();
    assert!(report.bytes_read * 4 < total, "{report:?}");
    let none = filter(|f| f.classes = Some("99".parse().unwrap()));
    let error = export(&file, &out, &none, &Silent).unwrap_err().to_string();
    assert!(error.contains("none of its 32000 points is wanted"), "{error}");
}

#[test]
fn a_spacing_gives_an_even_sample_that_grows_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let out = folder.path().join("out.ply");
    let at = |spacing: f64| {
        let wanted = filter(|f| f.max_spacing = Some(spacing));
        export(&file, &out, &wanted, &Silent).unwrap().points_out
    };
    // 50 by 50 units: half the spacing gives four times the points.
    let points = [4.0, 2.0, 1.0].map(at);
    for pair in points.windows(2) {
        let ratio = pair[1] as f64 / pair[0] as f64;
        assert!((2.5..6.0).contains(&ratio), "{points:?}");
    }
    assert!((300..2_000).contains(&points[1]), "{points:?}");
    assert_eq!(at(1e-6), 32_000);
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
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    for ending in ["las", "laz", "ply", "xyz"] {
        let out = folder.path().join(format!("out.{ending}"));
        let run = |after| {
            let task = Stops { checks: AtomicU64::new(0), after };
            let result = export(&file, &out, &Filter::default(), &task);
            (result, task.checks.into_inner())
        };
        let (result, checks) = run(u64::MAX);
        result.unwrap();
        std::fs::remove_file(&out).unwrap();
        assert!(checks > 100, "{checks}");
        for after in (0..6).map(|i| i * (checks - 1) / 5) {
            let (result, _) = run(after);
            assert!(matches!(result, Err(BuildError::Cancelled(_))), "{after}: {result:?}");
            assert_eq!(names_in(folder.path()), ["in.esker"]);
        }
    }
}

#[test]
fn damage_is_reported_and_an_earlier_file_survives() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path());
    let out = folder.path().join("out.las");
    std::fs::write(&out, "mine").unwrap();
    let node = file.table().nodes[file.table().nodes.len() / 2];
    let mut bytes = std::fs::read(file.path()).unwrap();
    bytes[node.page_offset as usize + node.page_bytes as usize / 2] ^= 1;
    std::fs::write(file.path(), bytes).unwrap();
    let error = export(&file, &out, &Filter::default(), &Silent).unwrap_err().to_string();
    assert!(error.contains("in.esker") && error.contains("damaged"), "{error}");
    assert_eq!(std::fs::read(&out).unwrap(), b"mine");
    let nowhere = folder.path().join("nowhere/out.las");
    let error = export(&file, &nowhere, &Filter::default(), &Silent).unwrap_err().to_string();
    assert!(error.contains("cannot write"), "{error}");
    let mut names = names_in(folder.path());
    names.sort();
    assert_eq!(names, ["in.esker", "out.las"]);
}
