//! Inputs that can be read in ranges give the same points as when they are read whole, wherever the
//! ranges are cut; others say that they cannot.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

#[allow(dead_code, reason = "other tests need other parts")]
mod las_writer;

use esker_points::Batch;
use esker_points::lattice::Lattice;
use esker_points::task::Silent;
use esker_scan::{OpenOptions, ReadReport, ScanError, Source};
use las_writer::{File, Point, Variant};
use std::ops::Range;
use std::path::Path;

fn open(path: &Path) -> Box<dyn Source> {
    esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap()
}

/// Records of a range of the points, or of all, and the report on them.
fn read(
    source: &dyn Source,
    points: Option<Range<u64>>,
) -> Result<(Vec<u8>, ReadReport), ScanError> {
    let grid = &source.info().grid;
    let placement = Lattice::choose(std::slice::from_ref(grid)).unwrap().placement(grid);
    let mut records = Vec::new();
    let mut sink = |batch: Batch| {
        (0..batch.len()).for_each(|i| batch.record_into(i, &mut records));
        Ok(())
    };
    let report = match points {
        None => source.read(&placement, &Silent, &mut sink),
        Some(points) => source.read_range(points, &placement, &Silent, &mut sink),
    }?;
    Ok((records, report))
}

/// Checks ranges of a source that can begin at `least` points or more.
fn check_ranges(source: &dyn Source, least: usize) {
    let count = source.info().points_hint;
    let (whole, report) = read(source, None).unwrap();
    let mut starts: Vec<u64> = (0..=97).map(|i| source.begin_near(count * i / 97)).collect();
    assert_eq!(starts[0], 0);
    assert!(starts.is_sorted() && starts.iter().all(|&start| start <= count));
    starts.dedup();
    assert!(starts.len() >= least, "{starts:?}");
    if starts.last() != Some(&count) {
        starts.push(count);
    }
    let (mut joined, mut points) = (Vec::new(), 0);
    for pair in starts.windows(2) {
        let (records, of_range) = read(source, Some(pair[0]..pair[1])).unwrap();
        assert_eq!(of_range.points, pair[1] - pair[0]);
        assert!(of_range.colour_max <= report.colour_max);
        joined.extend(records);
        points += of_range.points;
    }
    assert!(joined == whole && points == report.points);
}

#[test]
fn las_is_read_from_any_point_and_laz_from_any_chunk() {
    let point = |i: u32| Point {
        position: [i as i32, -(i as i32), 7],
        fields: [(i % 251) as u8; 60],
        extra: vec![(i % 7) as u8; 3],
    };
    for (format, minor) in [(3, 2), (7, 4)] {
        let variant = Variant { format, minor, extra: 3 };
        let file = File { variant, points: (0..3000).map(point).collect(), vlrs: Vec::new() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        for (bytes, least) in [
            (file.las(), 97),
            (file.laz(100), 30),
            (file.laz(5000), 1),
            (file.laz_of_varying_chunks(&[400, 1, 99, 2500]), 4),
        ] {
            std::fs::write(&path, bytes).unwrap();
            check_ranges(open(&path).as_ref(), least);
        }
    }
}

#[test]
fn generated_scans_are_read_from_any_block() {
    for scene in ["bridge", "office", "terrain"] {
        let source = open(Path::new(&format!("synthetic:{scene}:200001:7")));
        check_ranges(source.as_ref(), 12);
    }
}

#[test]
fn other_scans_are_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    std::fs::write(&path, "1 2 3\n4 5 6\n").unwrap();
    let source = open(&path);
    assert_eq!(source.begin_near(2), 0);
    let error = read(source.as_ref(), Some(0..2)).unwrap_err().to_string();
    assert!(error.contains("a.xyz: its points cannot be read in ranges"), "{error}");
}
