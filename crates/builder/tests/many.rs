//! Very many inputs, and inputs with wrong bounds in their headers: every input is decoded a few
//! times at most, however many there are.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::{Options, against_sources, build, build_sources};
use esker_format::EskerFile;
use esker_points::lattice::Placement;
use esker_points::task::Silent;
use esker_points::{Spread, Task};
use esker_scan::source::Sink;
use esker_scan::{Crs, ReadReport, ScanError, Source, SourceInfo};
use given::{Given, given, hash_of, whole};
use std::fmt::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

#[test]
fn ten_thousand_small_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut inputs = Vec::new();
    for i in 0..10_000u64 {
        let mut text = String::new();
        for j in 0..3 {
            let [x, y] = [0, 1].map(|axis| below(6 * i + 2 * j + axis, 1_000_000));
            writeln!(text, "{}.{:03} {y} {}", x / 1000, x % 1000, j % 2).unwrap();
        }
        let path = folder.path().join(format!("{i}.xyz"));
        std::fs::write(&path, text).unwrap();
        inputs.push(path);
    }
    let out = folder.path().join("out.esker");
    let report = build(&inputs, &out, &options(), &Silent).unwrap();
    assert_eq!((report.points_in, report.points_out), (30_000, 30_000));
    assert_eq!(report.rounding_error_max, 0.0);
    let file = EskerFile::open(&out).unwrap();
    assert_eq!(file.metadata().sources.len(), 10_000);
    let against = esker_builder::against(&file, &inputs, &Silent).unwrap();
    assert_eq!((against.points, against.hash), (30_000, report.hash));
}

/// Counts how often its points are decoded.
struct Counted(Given, Arc<AtomicU64>);

impl Source for Counted {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        self.1.fetch_add(1, Relaxed);
        self.0.read(placement, task, sink)
    }

    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError> {
        self.1.fetch_add(1, Relaxed);
        self.0.survey(task)
    }
}

/// Adjacent tiles on grids of their own, each of which claims these bounds.
fn tiles(count: u64, claims: Option<[[f64; 3]; 2]>) -> Vec<Given> {
    let tile = |i: u64| {
        let point = |j: u64| [0, 1, 2].map(|axis| below(99 * i + 3 * j + axis, 9000));
        let tile = given(&format!("{i:03}"), [0.001; 3], (0..30).map(point).collect());
        tile.at([1000.0 * i as f64, 0.0, 0.0]).claiming(claims)
    };
    (0..count).map(tile).collect()
}

#[test]
fn hundreds_of_inputs_with_wrong_headers_are_measured_once() {
    for claims in [Some([[-9.0; 3], [-8.0; 3]]), Some([[f64::NAN; 3]; 2]), None] {
        let (sources, decoded) = (tiles(300, claims), Arc::new(AtomicU64::new(0)));
        let counted = |s: &Given| Box::new(Counted(s.clone(), decoded.clone())) as Box<dyn Source>;
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out.esker");
        let report =
            build_sources(sources.iter().map(counted).collect(), &out, &options(), &Silent);
        let report = report.unwrap();
        assert_eq!((report.points_out, report.rounding_error_max), (9000, 0.0));
        assert_eq!(report.hash, hash_of(&sources, &EskerFile::open(&out).unwrap()));
        assert!(decoded.load(Relaxed) <= 3 * 300, "{} times for 300 inputs", decoded.load(Relaxed));
    }
}

#[test]
fn claimed_bounds_that_are_too_large_do_not_coarsen_the_lattice() {
    let everything = Some([[-1e300; 3], [1e300; 3]]);
    let (report, file) = whole(&tiles(3, everything), &options());
    assert_eq!(file.metadata().lattice.scale, [0.001; 3]);
    assert_eq!(report.rounding_error_max, 0.0);
    // Points that are really that far apart do.
    let mut far = tiles(2, None);
    far[1] = far[1].clone().at([1e8, 0.0, 0.0]);
    let (_, file) = whole(&far, &options());
    assert_eq!(file.metadata().lattice.scale, [0.1, 0.001, 0.001]);
}

fn in_system(name: &str, text: Option<&str>) -> Given {
    let mut given = given(name, [0.001; 3], vec![[1, 2, 3], [4, 5, 6]]);
    given.info.crs = text.map(|t| Crs { text: t.to_owned(), unit: None });
    given
}

#[test]
fn inputs_of_different_reference_systems_are_refused_unless_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let mixed = [
        in_system("c.las", Some("PROJCS[\"Lambert\"]")),
        in_system("a.las", None),
        in_system("b.las", Some("PROJCS[\"Mercator\"]")),
    ];
    let error = build_sources(given::boxed(&mixed), &out, &options(), &Silent).unwrap_err();
    let error = error.to_string();
    assert!(error.starts_with("b.las and c.las are in different"), "{error}");
    assert!(error.contains("`Mercator` and `Lambert`"), "{error}");
    assert!(given::names_in(folder.path()).is_empty());
    let ignoring = Options { ignore_crs: true, ..options() };
    let report = build_sources(given::boxed(&mixed), &out, &ignoring, &Silent).unwrap();
    assert!(report.notes.iter().any(|n| n.contains("different coordinate")), "{:?}", report.notes);
    let file = EskerFile::open(&out).unwrap();
    assert_eq!(against_sources(&file, given::boxed(&mixed), &Silent).unwrap().points, 6);
    // An input without a reference system matches any.
    whole(&mixed[..2], &options());
}
