//! Every good scan of the data folder is built, verified against itself and exported again. The
//! number of points is that of an independent reader (`manifest.csv`).

use crate::folder::Folder;
use crate::program::{build, esker, verify};
use crate::{export, missing, trial};
use libtest_mimic::Trial;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Folders whose files are read, apart from [`REFUSED`].
const READ: [&str; 10] = ["las", "laz", "copc", "ply", "models", "xyz", "pts", "ptx", "pcd", "e57"];
/// Files of those folders that cannot be read whole: two whose compression drops fields of their
/// point format, and one that holds waveforms, no points.
const REFUSED: [&str; 3] =
    ["las/pdrf/10pts-pdrf9.laz", "las/pdrf/10pts-pdrf10.laz", "laz/fullwaveform.wdz"];
/// The largest scan, which is built within a limit of memory.
const BIG: &str = "big/craft-creek-ky-27m.laz";

/// The folder of real scans.
pub fn root() -> Option<PathBuf> {
    std::env::var_os("ESKER_DATA").map(PathBuf::from).filter(|d| d.join("manifest.csv").is_file())
}

/// Files of the manifest and their points.
fn manifest(root: &Path) -> Vec<(String, Option<u64>)> {
    let text = std::fs::read_to_string(root.join("manifest.csv")).unwrap();
    let rows = text.lines().skip(1).map(|line| {
        // The first columns are file, format and points; only the format may be quoted, with
        // commas.
        let (file, rest) = line.split_once(',').unwrap();
        let rest = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once("\",").unwrap().1,
            None => rest.split_once(',').unwrap().1,
        };
        (file.to_owned(), rest.split(',').next().unwrap().parse().ok())
    });
    rows.collect()
}

pub fn trials(trials: &mut Vec<Trial>) {
    let Some(root) = root() else {
        trials.push(missing("data: the big scan within its memory"));
        trials.push(missing("data: good scans"));
        trials.push(missing("data: files that lack fields are refused"));
        trials.push(missing("data: adjoining tiles become one file"));
        trials.push(missing("data: LAS and LAZ of the same points have the same hash"));
        return;
    };
    let within =
        |file: &str, folders: &[&str]| folders.iter().any(|f| Path::new(file).starts_with(f));
    let manifest = manifest(&root);
    assert!(manifest.len() > 100, "the manifest lists {} files", manifest.len());
    for (file, points) in manifest {
        let path = root.join(&file);
        let name = format!("data: {file}");
        if file == BIG {
            let points = points.unwrap();
            trials.insert(0, trial(&name, move || within_memory(&path, points)));
        } else if REFUSED.contains(&file.as_str()) {
            trials.push(trial(&format!("{name} is refused"), move || is_refused(&path)));
        } else if within(&file, &READ) {
            trials.push(trial(&name, move || comes_through(&path, points.unwrap())));
        }
    }
    let tiles = root.join("laz/ign-tiles");
    trials.push(trial("data: adjoining tiles become one file", move || become_one_file(&tiles)));
    let pairs = root.join("laz/pairs");
    let name = "data: LAS and LAZ of the same points have the same hash";
    trials.push(trial(name, move || have_the_same_hash(&pairs)));
}

/// Each input point is in the output or is refused with a reason.
fn adds_up(report: &Value) {
    let n = |name: &str| report[name].as_u64().unwrap();
    assert_eq!(n("points_out") + n("points_refused"), n("points_in"), "{report}");
    let reasons = report["refused_reasons"].as_object().unwrap().values();
    assert_eq!(reasons.map(|r| r.as_u64().unwrap()).sum::<u64>(), n("points_refused"), "{report}");
}

fn comes_through(scan: &Path, points: u64) {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let report = build(&[scan], &out, &[]);
    assert_eq!(report["points_in"], points, "{report}");
    adds_up(&report);
    let verified = verify(&out, &[scan]).json();
    assert_eq!(verified["ok"], true);
    assert_eq!(verified["points"], report["points_out"]);
    assert_eq!(verified["multiset_hash"], report["multiset_hash"]);
    if scan.extension().is_some_and(|e| e == "las" || e == "laz") {
        assert_eq!(report["rounding_error_max"], 0.0, "{report}");
        assert_eq!(report["points_refused"], 0, "{report}");
    }
    assert_eq!(folder.names(), ["out.esker"], "nothing else is left");
    export::gives_back(scan, &out, report["points_refused"].as_u64().unwrap());
    if scan.extension().is_some_and(|e| e == "las" || e == "laz") {
        export::copc_comes_back(scan, &out);
    }
}

fn is_refused(path: &Path) {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let outcome = esker(["build".as_ref(), path.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    let error = outcome.error();
    assert!(error.contains(&path.display().to_string()), "{error}");
    assert_eq!(folder.names(), [""; 0], "nothing is left");
}

fn become_one_file(folder: &Path) {
    let mut tiles: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    tiles.sort();
    assert_eq!(tiles.len(), 6);
    let own = Folder::new();
    let out = own.file("out.esker");
    let report = build(&tiles, &out, &[]);
    assert_eq!((&report["points_in"], &report["points_out"]), (&405_937.into(), &405_937.into()));
    assert_eq!(report["rounding_error_max"], 0.0);
    assert_eq!(verify(&out, &tiles).json()["points"], 405_937);
    // An export of the file is one scan of all points.
    let merged = own.file("merged.laz");
    export::export(&out, &merged, &[]).json();
    let again = build(&[&merged], &own.file("again.esker"), &[]);
    assert_eq!(again["multiset_hash"], report["multiset_hash"]);
    // Inputs may be in any order, but none missing and none twice.
    tiles.rotate_left(2);
    verify(&out, &tiles).json();
    verify(&out, &tiles[1..]).error();
    tiles[0] = tiles[1].clone();
    verify(&out, &tiles).error();
}

fn have_the_same_hash(folder: &Path) {
    let own = Folder::new();
    for pair in ["point10", "point-time", "extra-bytes", "pointwise-v1"] {
        let [las, laz] = ["las", "laz"].map(|kind| {
            let scan = folder.join(format!("{pair}.{kind}"));
            let out = own.file(&format!("{kind}.esker"));
            let report = build(&[&scan], &out, &[]);
            (scan, out, report)
        });
        assert_eq!(las.2["multiset_hash"], laz.2["multiset_hash"], "{pair}");
        verify(&las.1, &[&laz.0]).json();
        // Both inputs together hold every point twice.
        let both = own.file("both.esker");
        let report = build(&[&las.0, &laz.0], &both, &[]);
        assert_eq!(report["points_out"].as_u64(), las.2["points_out"].as_u64().map(|n| 2 * n));
        verify(&both, &[&las.0, &laz.0]).json();
        verify(&both, &[&las.0]).error();
    }
}

/// The bound is 1.05 times `--memory` plus the memory of the empty program, which is measured as
/// the least limit under which a tiny scan is built.
#[cfg(unix)]
fn within_memory(scan: &Path, points: u64) {
    use crate::program::{empty_kib, esker_within};
    const MEMORY_KIB: u64 = 1 << 20;
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let arguments = |scan: &Path| {
        let words = ["--memory", "1GiB", "--json", "--progress", "none"].map(Into::into);
        let files = ["build".into(), scan.to_owned(), "-o".into(), out.clone()];
        files.into_iter().chain(words).collect::<Vec<PathBuf>>()
    };
    let limit_kib = empty_kib() + MEMORY_KIB + MEMORY_KIB / 20;
    let report = esker_within(limit_kib, 600, arguments(scan)).json();
    assert_eq!((&report["points_in"], &report["points_out"]), (&points.into(), &points.into()));
    assert_eq!(report["rounding_error_max"], 0.0);
    let peak = report["peak_anon_bytes"].as_u64().unwrap();
    assert!(peak <= (MEMORY_KIB + MEMORY_KIB / 20) << 10, "{peak} bytes at the peak");
    assert_eq!(verify(&out, &[scan]).json()["points"], points);
}

#[cfg(not(unix))]
fn within_memory(scan: &Path, points: u64) {
    comes_through(scan, points);
}
