//! Fuzzes a reader for some time: `fuzz READER [SECONDS] [SEED]`, with READER one of las, laz, ply,
//! pcd, e57, ptx, text, mesh, esker, or `all` for each in turn. Cases that fail are kept in
//! `target/fuzz`. `fuzz READER FILE` runs one file.
#![allow(clippy::unwrap_used, clippy::exit, reason = "a developer's tool")]

#[path = "../tests/fuzz/mod.rs"]
mod fuzz;

use fuzz::target::Reader;
use fuzz::{Cases, SECONDS_MAX, contents, run};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

/// The case that is running: when it began, and what is being read.
static RUNNING: Mutex<Option<(Instant, Vec<u8>, String)>> = Mutex::new(None);

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let word = |i: usize| words.get(i).map(String::as_str).unwrap_or_default();
    let readers: Vec<Reader> =
        Reader::ALL.into_iter().filter(|r| ["all", r.name()].contains(&word(0))).collect();
    assert!(!readers.is_empty(), "usage: fuzz READER [SECONDS | FILE] [SEED]");
    if Path::new(word(1)).is_file() {
        return run_file(readers[0], Path::new(word(1)));
    }
    thread::Builder::new().name("watch".into()).spawn(watch).unwrap();
    let seconds = word(1).parse().unwrap_or(60);
    let seed = word(2).parse().unwrap_or(2);
    let faults: usize = readers.iter().map(|&reader| fuzz_for(reader, seconds, seed)).sum();
    std::process::exit(i32::from(faults > 0));
}

fn run_file(reader: Reader, path: &Path) {
    let folder = tempfile::tempdir().unwrap();
    let bytes = contents(path);
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let outcome = run(reader, &bytes, ending, folder.path());
    let (seconds, peak) = (outcome.time.as_secs_f64(), outcome.peak_bytes >> 20);
    let fault = outcome.fault(bytes.len());
    println!("read: {}, {seconds:.2} s, {peak} MiB, fault: {fault:?}", outcome.is_read);
}

/// Runs mutations for some seconds; returns the number of faults.
fn fuzz_for(reader: Reader, seconds: u64, seed: u64) -> usize {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let mut cases = Cases::new(reader, seed);
    std::panic::set_hook(Box::new(|panic| {
        // Panics of cases are reported with the case.
        if RUNNING.try_lock().is_ok_and(|running| running.is_none()) {
            eprintln!("{panic}");
        }
    }));
    let (mut count, mut read, mut faults) = (0u64, 0u64, 0);
    let (mut slowest, mut most) = (Duration::ZERO, 0);
    while start.elapsed() < Duration::from_secs(seconds) && faults < 10 {
        let (bytes, ending) = cases.next_case();
        *RUNNING.lock().unwrap() = Some((Instant::now(), bytes.clone(), ending.clone()));
        let outcome = run(reader, &bytes, &ending, folder.path());
        *RUNNING.lock().unwrap() = None;
        count += 1;
        read += u64::from(outcome.is_read);
        (slowest, most) = (slowest.max(outcome.time), most.max(outcome.peak_bytes));
        if let Some(fault) = outcome.fault(bytes.len()) {
            faults += 1;
            let kept = keep(&bytes, &format!("{}-{count}.{ending}", reader.name()));
            println!("{}: case {count}: {fault}; kept as {}", reader.name(), kept.display());
        }
    }
    println!(
        "{}: {count} cases, {read} read, {faults} faults; slowest {:.2} s, most memory {} MiB",
        reader.name(),
        slowest.as_secs_f64(),
        most >> 20
    );
    faults
}

fn keep(bytes: &[u8], name: &str) -> PathBuf {
    let folder = Path::new("target/fuzz");
    std::fs::create_dir_all(folder).unwrap();
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// Ends the program if a case does not end.
fn watch() {
    loop {
        thread::sleep(Duration::from_secs(1));
        let running = RUNNING.lock().unwrap();
        if let Some((since, bytes, ending)) = &*running
            && since.elapsed() > Duration::from_secs(3 * SECONDS_MAX)
        {
            let kept = keep(bytes, &format!("hang.{ending}"));
            println!("a case does not end; kept as {}", kept.display());
            std::process::exit(1);
        }
    }
}
