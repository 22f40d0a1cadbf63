//! A few points far from all others cost the others nothing: they are set aside, exactly, and
//! exported again; coordinates that stand for no value are refused; there is room to append.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod given;

use esker_builder::{
    BuildError, NO_VALUE, Options, Report, Resume, Shares, append, build, build_shared, export,
    merge,
};
use esker_format::{EskerFile, Forest};
use esker_points::task::Silent;
use esker_points::{AttrType, Filter, Task};
use given::{Given, boxed, given};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

/// A position on two walls and the floor of a room of 8 x 6 x 3 m, with four decimals.
fn room(i: u64) -> [f64; 3] {
    let part = |salt: u64, of: f64| {
        let mixed = (i * 3 + salt).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        (mixed as f64 / f64::from(1 << 24) * of * 1e4).round() / 1e4
    };
    let (x, y, z) = (part(0, 8.0), part(1, 6.0), part(2, 3.0));
    [[x, y, 0.0], [x, 0.0, z], [0.0, y, z]][(i % 3) as usize]
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes text with an intensity, the number of the point.
    fn text(&self, name: &str, points: &[[f64; 3]]) -> PathBuf {
        let line = |(i, [x, y, z]): (usize, &[f64; 3])| format!("{x} {y} {z} {}\n", i % 60_000);
        let lines: String = points.iter().enumerate().map(line).collect();
        self.write(name, format!("x y z intensity\n{lines}").as_bytes())
    }

    /// Writes binary PLY of singles or doubles.
    fn ply(&self, name: &str, points: &[[f64; 3]], is_single: bool) -> PathBuf {
        let ty = if is_single { "float" } else { "double" };
        let n = points.len();
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {n}\nproperty {ty} x\nproperty {ty} y\nproperty {ty} z\nend_header\n"
        )
        .into_bytes();
        for c in points.iter().flatten() {
            match is_single {
                true => bytes.extend((*c as f32).to_le_bytes()),
                false => bytes.extend(c.to_le_bytes()),
            }
        }
        self.write(name, &bytes)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.at(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn build(&self, inputs: &[PathBuf], out: &str) -> (Report, EskerFile) {
        let out = self.at(out);
        let report = build(inputs, &out, &options(), &Silent).unwrap();
        let file = EskerFile::open(&out).unwrap();
        esker_format::verify(&file, &Silent).unwrap();
        (report, file)
    }

    /// The coordinates that an export as text has, sorted.
    fn exported(&self, file: &Path) -> Vec<[f64; 3]> {
        let out = self.at("exported.xyz");
        export(&Forest::open(file).unwrap(), &out, &Filter::default(), &Silent).unwrap();
        let text = std::fs::read_to_string(&out).unwrap();
        let place = |line: &str| {
            let mut words = line.split_whitespace().map(|word| word.parse().unwrap());
            [(); 3].map(|()| words.next().unwrap())
        };
        let mut all: Vec<[f64; 3]> = text.lines().skip(1).map(place).collect();
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        all
    }
}

fn with_stray(count: u64, stray: [f64; 3]) -> Vec<[f64; 3]> {
    let mut points: Vec<_> = (0..count).map(room).collect();
    points.insert(points.len() / 3, stray);
    points
}

#[test]
fn a_stray_costs_the_others_no_digit_and_is_kept_exactly() {
    let folder = Folder::new();
    for stray in [[1e9; 3], [-1e10, 1.0, 2.0], [1e15, -7.25, 1e9]] {
        let points = with_stray(1000, stray);
        let text = folder.text("room.xyz", &points);
        let (report, file) = folder.build(std::slice::from_ref(&text), "t.esker");
        assert_eq!((report.points_in, report.points_out, report.points_set_aside), (1001, 1000, 1));
        assert_eq!((report.rounding_error_max, file.metadata().lattice.scale), (0.0, [1e-4; 3]));
        let aside = &file.metadata().set_aside;
        assert_eq!((aside.len(), aside[0].place), (1, stray));
        assert_eq!(aside[0].values, 333u16.to_le_bytes());
        let mut all = points.clone();
        all.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(folder.exported(file.path()), all);
        let inputs = std::slice::from_ref(&text);
        let same = esker_builder::against(&file, inputs, &Silent).unwrap();
        assert_eq!((same.points, same.set_aside, same.rounding_error_max), (1000, 1, 0.0));
        // Another stray is another scan.
        let other = folder.text("other.xyz", &with_stray(1000, [stray[0], stray[1], 5e8]));
        let error = esker_builder::against(&file, &[other], &Silent).unwrap_err();
        assert!(matches!(error, BuildError::Differs(_)), "{error}");
    }
}

#[test]
fn floats_keep_their_precision_beside_a_stray() {
    let folder = Folder::new();
    for is_single in [true, false] {
        let alone = folder.ply("a.ply", &(0..1000).map(room).collect::<Vec<_>>(), is_single);
        let with = folder.ply("b.ply", &with_stray(1000, [f64::from(1e9f32); 3]), is_single);
        let (alone, alone_file) = folder.build(&[alone], "a.esker");
        let (with, with_file) = folder.build(&[with], "b.esker");
        assert_eq!(alone_file.metadata().lattice, with_file.metadata().lattice);
        assert_eq!((alone.hash, alone.points_out), (with.hash, with.points_out));
        assert_eq!((with.points_set_aside, with.rounding_error_max), (1, alone.rounding_error_max));
        assert!(with.rounding_error_max <= 0.5e-7, "{}", with.rounding_error_max);
    }
}

#[test]
fn coordinates_that_stand_for_no_value_are_refused_and_counted() {
    let folder = Folder::new();
    for none in [f64::from(f32::MAX), 1e30, -1e20] {
        let mut points: Vec<_> = (0..1000).map(room).collect();
        points.extend((0..300).map(|i| [none, room(i)[1], 1.0]));
        let ply = folder.ply("a.ply", &points, true);
        let (report, file) = folder.build(std::slice::from_ref(&ply), "a.esker");
        assert_eq!((report.points_in, report.points_out), (1300, 1000));
        assert_eq!(report.points_refused, [(NO_VALUE.to_owned(), 300)].into());
        let same = esker_builder::against(&file, &[ply], &Silent).unwrap();
        assert_eq!((same.points, same.refused), (1000, 300));
    }
}

#[test]
fn two_bad_records_do_not_coarsen_inputs_of_different_scales() {
    let folder = Folder::new();
    let raw = |i: u64, scale: f64| room(i).map(|c| (c / scale).round() as i32);
    let mut coarse: Vec<_> = (0..5000).map(|i| raw(i, 0.01)).collect();
    coarse[7] = [i32::MAX; 3];
    coarse[8] = [i32::MIN, 5, 5];
    let fine = given("fine", [0.0001; 3], (0..5000).map(|i| raw(i + 5000, 0.0001)).collect());
    let coarse = given("coarse", [0.01; 3], coarse).with("intensity", AttrType::U16, |i| i);
    let sources = [fine, coarse];
    let out = folder.at("t.esker");
    let options = options();
    let report = esker_builder::build_sources(boxed(&sources), &out, &options, &Silent).unwrap();
    assert_eq!((report.points_out, report.points_set_aside), (9998, 2));
    assert_eq!(report.rounding_error_max, 0.0);
    let file = EskerFile::open(&out).unwrap();
    assert_eq!(file.metadata().lattice.scale, [0.0001; 3]);
    let places: Vec<_> = file.metadata().set_aside.iter().map(|p| p.place[0]).collect();
    assert_eq!(places, [i32::MAX, i32::MIN].map(|raw| f64::from(raw) * 0.01));
}

#[test]
fn stations_beside_the_first_always_fit() {
    let folder = Folder::new();
    let moved = |by: f64| (0..900).map(|i| room(i).map(|c| c + by)).collect::<Vec<_>>();
    for is_single in [true, false] {
        let first = folder.ply("a.ply", &moved(0.0), is_single);
        let (_, file) = folder.build(&[first], "a.esker");
        for by in [8.0, -40.0, 100.0] {
            let next = folder.ply("b.ply", &moved(by), is_single);
            let out = folder.at("b.esker");
            let report = append(file.path(), &[next], &out, &options(), &Silent).unwrap();
            assert_eq!((report.points_out, report.points_set_aside), (900, 0));
            std::fs::remove_file(&out).unwrap();
        }
        // Beyond that nothing is written, unless the points are to be left out.
        let far = folder.ply("c.ply", &[moved(0.0), moved(1e6)].concat(), is_single);
        let out = folder.at("c.esker");
        let inputs = std::slice::from_ref(&far);
        let error = append(file.path(), inputs, &out, &options(), &Silent).unwrap_err().to_string();
        assert!(error.contains("c.ply") && error.contains("--drop-outside"), "{error}");
        assert!(!out.exists());
        let drops = Options { drop_outside: true, ..options() };
        let report = append(file.path(), inputs, &out, &drops, &Silent).unwrap();
        assert_eq!((report.points_in, report.points_out), (1800, 900));
        std::fs::remove_file(&out).unwrap();
    }
}

#[test]
fn strays_survive_appending_and_merging() {
    let folder = Folder::new();
    let first = folder.text("a.xyz", &with_stray(900, [1e9, 2.0, 3.0]));
    let second = folder.text("b.xyz", &with_stray(900, [4.0, 1e10, 5.0]));
    let (_, file) = folder.build(&[first], "a.esker");
    let both = folder.at("b.esker");
    append(file.path(), &[second], &both, &options(), &Silent).unwrap();
    let exported = folder.exported(&both);
    assert_eq!(exported.len(), 1802);
    let one = folder.at("c.esker");
    let report = merge(std::slice::from_ref(&both), &one, &options(), &Silent).unwrap();
    assert_eq!((report.points_in, report.points_set_aside), (1802, 2));
    assert_eq!(folder.exported(&one), exported);
}

#[test]
fn rounding_above_the_distance_of_points_is_an_error_unless_it_is_allowed() {
    let folder = Folder::new();
    let near =
        folder.text("a.xyz", &(0..900).map(|i| room(i).map(|c| c * 1e-3)).collect::<Vec<_>>());
    let far = folder.text("b.xyz", &(0..900).map(|i| room(i).map(|c| c + 9e9)).collect::<Vec<_>>());
    let (out, inputs) = (folder.at("t.esker"), [near, far]);
    let error = build(&inputs, &out, &options(), &Silent).unwrap_err().to_string();
    assert!(error.contains("a.xyz") && error.contains("--allow-rounding"), "{error}");
    assert!(!out.exists());
    let allowed = Options { allow_rounding: true, ..options() };
    let report = build(&inputs, &out, &allowed, &Silent).unwrap();
    assert!(
        report.notes.iter().any(|note| note.contains("rounded by up to")),
        "{:?}",
        report.notes
    );
}

/// Cancels the task after a number of checks.
struct Stops(AtomicU64, u64);

impl Task for Stops {
    fn is_cancelled(&self) -> bool {
        self.0.fetch_add(1, Ordering::Relaxed) >= self.1
    }
}

#[test]
fn a_resumed_build_has_the_same_strays() {
    let folder = Folder::new();
    let raw = |i: u64| room(i).map(|c| (c * 1e4) as i32);
    let mut coarse = given("b", [0.01; 3], (0..40_000).map(|i| raw(i).map(|c| c / 100)).collect());
    for i in 0..30 {
        coarse.positions[i * 1300 + 11] = [i32::MAX - i as i32; 3];
    }
    let fine = given("a", [0.0001; 3], (0..40_000).map(raw).collect());
    let coarse: Given = coarse.with("intensity", AttrType::U16, |i| i);
    let sources = [fine, coarse.claiming(Some([[0.0; 3], [8.0, 6.0, 3.0]]))];
    let shares = Shares { buffer_bytes_max: 150_000, chunk_bytes_max: 300_000 };
    let whole = folder.at("whole.esker");
    let run = |out: &Path, resume: Resume, task: &dyn Task| {
        let options = Options { resume, ..options() };
        build_shared(boxed(&sources), out, &options, shares, task)
    };
    let report = run(&whole, Resume::Never, &Silent).unwrap();
    assert_eq!((report.points_in, report.points_set_aside), (80_000, 30));
    for checks in [20, 60, 110, 180, 260, 400] {
        let out = folder.at(&format!("cut-{checks}.esker"));
        if run(&out, Resume::Later, &Stops(AtomicU64::new(0), checks)).is_err() {
            run(&out, Resume::Now, &Silent).unwrap();
        }
        assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&whole).unwrap(), "{checks}");
    }
}
