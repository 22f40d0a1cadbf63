//! No mutation of a file makes a reader panic, hang, or hold much more memory than the file has.
//! The cases are the same in each run; `cargo run --release --example fuzz` makes others.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod fuzz;

use fuzz::target::Reader;
use fuzz::{Cases, bytes_max, contents, run, seeds};
use std::sync::Mutex;

/// Cases of each reader.
const CASES: usize = 400;

/// The allocator counts the memory of all threads, so one test runs at a time.
static ALONE: Mutex<()> = Mutex::new(());

fn fuzz(reader: Reader) {
    let _alone = ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let mut sound = 0;
    for (path, bytes) in seeds(reader) {
        let ending = path.extension().unwrap().to_str().unwrap();
        let outcome = run(reader, &bytes, ending, folder.path());
        assert_eq!(outcome.panic, None, "{}", path.display());
        sound += usize::from(outcome.is_read);
    }
    assert!(sound > 0, "no seed of {} is sound", reader.name());
    let mut cases = Cases::new(reader, 1);
    let mut read = 0;
    for number in 0..CASES {
        let (bytes, ending) = cases.next_case();
        let outcome = run(reader, &bytes, &ending, folder.path());
        let fault = outcome.panic.or_else(|| {
            let is_more = outcome.peak_bytes > bytes_max(bytes.len());
            is_more.then(|| format!("{} MiB", outcome.peak_bytes >> 20))
        });
        if let Some(fault) = fault {
            let kept = folder.keep();
            panic!("case {number} of {}: {fault}; it is in {}", reader.name(), kept.display());
        }
        read += usize::from(outcome.is_read);
    }
    assert!(read < CASES, "no mutation of {} is refused", reader.name());
}

#[test]
fn las_mutations_are_survived() {
    fuzz(Reader::Las);
}

#[test]
fn laz_mutations_are_survived() {
    fuzz(Reader::Laz);
}

#[test]
fn ply_mutations_are_survived() {
    fuzz(Reader::Ply);
}

#[test]
fn pcd_mutations_are_survived() {
    fuzz(Reader::Pcd);
}

#[test]
fn e57_mutations_are_survived() {
    fuzz(Reader::E57);
}

#[test]
fn ptx_mutations_are_survived() {
    fuzz(Reader::Ptx);
}

#[test]
fn text_mutations_are_survived() {
    fuzz(Reader::Text);
}

#[test]
fn mesh_mutations_are_survived() {
    fuzz(Reader::Mesh);
}

#[test]
fn esker_mutations_are_survived() {
    fuzz(Reader::Esker);
}

#[test]
fn the_corpus_is_small() {
    let all = Reader::ALL.into_iter().flat_map(seeds);
    let bytes: usize = all.map(|(path, _)| contents(&path).len()).sum();
    assert!(bytes < 1 << 20, "{bytes}");
}
