//! Previews of a large scan: a share of its points, from all of it, in little time; and building
//! the whole file beside a preview gives the same file.
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::calls::preview::{Sample, build_watched, preview};
use esker_engine::calls::{build, export, info};
use esker_engine::{BuildOptions, ExportOptions, Filter, Forest};
use esker_points::task::Silent;
use std::path::PathBuf;
use tempfile::TempDir;

/// Points of the scan.
const POINTS: u64 = 6_000_000;

/// A LAZ file of a generated terrain, and the file that was built of it.
fn scan(folder: &TempDir) -> [PathBuf; 2] {
    let [terrain, laz, whole] =
        ["terrain.esker", "terrain.laz", "whole.esker"].map(|name| folder.path().join(name));
    let options = BuildOptions::default();
    let spec = [PathBuf::from("synthetic:terrain:6M:1")];
    build::build(&spec, &terrain, &options, 0, &Silent).unwrap();
    let (filter, how) = (Filter::default(), ExportOptions::default());
    export::export(&terrain, &laz, &filter, how, 0, &Silent).unwrap();
    std::fs::remove_file(&terrain).unwrap();
    build::build(std::slice::from_ref(&laz), &whole, &options, 0, &Silent).unwrap();
    [laz, whole]
}

/// Whether a preview covers the box of the whole file, in which nearly all points are, but for a
/// share `off` of its extents.
fn covers(preview: &Forest, whole: &Forest, off: f64) -> bool {
    let [[low, high], [whole_low, whole_high]] = [preview, whole].map(info::fitted_bounds);
    (0..3).all(|axis| {
        let extent = whole_high[axis] - whole_low[axis];
        (low[axis] - whole_low[axis]).abs() < off * extent
            && (high[axis] - whole_high[axis]).abs() < off * extent
    })
}

#[test]
fn previews_have_points_from_all_of_the_scan_and_leave_the_built_file_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let [laz, whole] = scan(&folder);
    let [first, watched, second] =
        ["first.esker", "watched.esker", "second.esker"].map(|name| folder.path().join(name));
    let (inputs, options) = (std::slice::from_ref(&laz), BuildOptions::default());
    let forest = Forest::open(&whole).unwrap();

    let [points, all] = preview(inputs, &first, &options, &Silent).unwrap().unwrap();
    assert!((POINTS * 99 / 100..POINTS * 101 / 100).contains(&all), "{all}");
    let file = Forest::open(&first).unwrap();
    assert_eq!(file.points(), points);
    assert!((POINTS / 12..POINTS / 7).contains(&points), "{points}");
    // The chunks are an eleventh of the terrain wide, and half of each is read.
    assert!(covers(&file, &forest, 0.1));

    // Records of a PLY file are read in short runs.
    let (ply, of_ply) = (folder.path().join("terrain.ply"), folder.path().join("ply.esker"));
    let (filter, how) = (Filter::default(), ExportOptions::default());
    export::export(&whole, &ply, &filter, how, 0, &Silent).unwrap();
    let made = preview(std::slice::from_ref(&ply), &of_ply, &options, &Silent);
    let [points, all] = made.unwrap().unwrap();
    assert!((POINTS * 99 / 100..POINTS * 101 / 100).contains(&all), "{all}");
    let file = Forest::open(&of_ply).unwrap();
    assert_eq!(file.points(), points);
    assert!((POINTS / 12..POINTS / 7).contains(&points), "{points}");
    assert!(covers(&file, &forest, 0.02));

    let sample = Sample::default();
    build_watched(inputs, &watched, &options, &sample, &Silent).unwrap();
    assert!(std::fs::read(&watched).unwrap() == std::fs::read(&whole).unwrap(), "other bytes");
    let points = sample.build(&second, &options, &Silent).unwrap().unwrap();
    let file = Forest::open(&second).unwrap();
    assert_eq!(file.points(), points);
    assert!((POINTS / 12..POINTS / 7).contains(&points), "{points}");
    assert!(covers(&file, &forest, 0.02));
    assert_eq!(sample.build(&second, &options, &Silent).unwrap(), None, "they are used once");
}

#[test]
fn builds_with_little_memory_keep_no_points_and_small_scans_have_no_preview() {
    let folder = tempfile::tempdir().unwrap();
    let [out, second] = ["out.esker", "second.esker"].map(|name| folder.path().join(name));
    let options = BuildOptions::default();
    let little = BuildOptions { memory_bytes: 1 << 30, ..options.clone() };
    for (scan, options) in
        [("synthetic:terrain:6M:1", &little), ("synthetic:office:10k:1", &options)]
    {
        let sample = Sample::default();
        build_watched(&[scan.into()], &out, options, &sample, &Silent).unwrap();
        assert_eq!(sample.build(&second, options, &Silent).unwrap(), None, "{scan}");
        std::fs::remove_file(&out).unwrap();
    }
}

#[test]
fn small_scans_and_those_read_from_front_to_back_have_no_preview() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("none.esker");
    for scan in ["synthetic:office:10k:1", "synthetic:terrain:6M:1"] {
        let made = preview(&[scan.into()], &out, &BuildOptions::default(), &Silent);
        assert_eq!(made.unwrap(), None, "{scan}");
        assert!(!out.exists());
    }
}
