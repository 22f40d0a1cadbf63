//! Every damaged or hostile file of the data folder gives a one-line error that names the file, or
//! a success that verifies; never a panic, a hang, an allocation of a size that a header claims, or
//! a file left behind.

use crate::data::root;
use crate::folder::Folder;
use crate::program::verify;
use crate::{missing, trial};
use libtest_mimic::Trial;
use std::path::Path;

/// Files whose intact part is read.
const SOUND_ENOUGH: [&str; 8] = [
    "bad-geotiff-keys.las",
    "bad_vlr_count.las",
    "e57-invalid-cv-header.e57",
    "e57-no-ext-namespace.e57",
    "gps-time-nan.las",
    "huge-count.las",
    "laz-pdal-fail.laz",
    "malformed-extra-bytes.las",
];

pub fn trials(trials: &mut Vec<Trial>) {
    let Some(root) = root() else {
        trials.push(missing("bad: damaged scans"));
        return;
    };
    let entries = std::fs::read_dir(root.join("bad")).unwrap();
    let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
    files.sort();
    assert!(files.len() > 20, "there are {} bad files", files.len());
    for file in files {
        let name = format!("bad: {}", file.file_name().unwrap().display());
        trials.push(trial(&name, move || is_harmless(&file)));
    }
    trials
        .push(trial("bad: a panic inside a decoder is an error", move || is_damaged_within(&root)));
}

/// A LAZ file on whose bytes the decoder panics gives an error without a backtrace.
fn is_damaged_within(root: &Path) {
    let folder = Folder::new();
    let (scan, out) = (folder.file("damaged.laz"), folder.file("out.esker"));
    let mut bytes = std::fs::read(root.join("las/pdrf/10pts-pdrf8.laz")).unwrap();
    bytes[799..807].fill(u8::MAX);
    std::fs::write(&scan, bytes).unwrap();
    let outcome = run(&scan, &out);
    assert!(outcome.error().contains("compressed points are damaged at or after point"));
    assert_eq!(folder.names(), ["damaged.laz"]);
}

#[cfg(unix)]
fn run(scan: &Path, out: &Path) -> crate::program::Outcome {
    /// Limit of memory, KiB; far above the need of these small files.
    const DATA_KIB: u64 = 512 << 10;
    let words = ["build".into(), scan.to_owned(), "-o".into(), out.to_owned(), "--json".into()];
    crate::program::esker_within(DATA_KIB, 20, words)
}

#[cfg(not(unix))]
fn run(scan: &Path, out: &Path) -> crate::program::Outcome {
    crate::program::esker(["build".as_ref(), scan, "-o".as_ref(), out, "--json".as_ref()])
}

fn is_harmless(scan: &Path) {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let outcome = run(scan, &out);
    let name = scan.file_name().unwrap().to_str().unwrap();
    if SOUND_ENOUGH.contains(&name) {
        let report = outcome.json();
        assert_eq!(verify(&out, &[scan]).json()["points"], report["points_out"]);
        assert_eq!(folder.names(), ["out.esker"]);
    } else {
        let error = outcome.error();
        assert!(error.contains(name), "{error}");
        assert_eq!(folder.names(), [""; 0], "nothing is left");
    }
}
