//! Fuzzing of every reader: valid seeds are mutated, read to the end, and watched. A case fails if
//! it panics, takes more than [`SECONDS_MAX`], or holds more memory than [`bytes_max`]. The test
//! `fuzzing` runs a few cases that are the same each time; the example `fuzz` runs for a
//! given time.

#![allow(dead_code, reason = "test and example use other parts")]
#![allow(clippy::unwrap_used, reason = "what the harness cannot do without ends it")]

pub mod allocator;
pub mod checksums;
pub mod mutate;
pub mod target;

use mutate::Random;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use target::Reader;

/// Longest time of a case.
pub const SECONDS_MAX: u64 = 10;

/// Memory that may be held while a file of this size is read, in bytes.
pub fn bytes_max(file_bytes: usize) -> usize {
    (256 << 20) + 10 * file_bytes
}

/// Result of one case.
pub struct Outcome {
    pub time: Duration,
    /// Most memory that was held, in bytes.
    pub peak_bytes: usize,
    /// Message of a panic.
    pub panic: Option<String>,
    /// Whether the file was read to its end.
    pub is_read: bool,
}

impl Outcome {
    /// What is wrong with this case of a file of `file_bytes`.
    pub fn fault(&self, file_bytes: usize) -> Option<String> {
        if let Some(panic) = &self.panic {
            return Some(format!("panic: {panic}"));
        }
        if self.peak_bytes > bytes_max(file_bytes) {
            return Some(format!("{} MiB of memory", self.peak_bytes >> 20));
        }
        let seconds = self.time.as_secs_f64();
        (seconds > SECONDS_MAX as f64).then(|| format!("{seconds:.1} seconds"))
    }
}

/// Seeds of a reader: all files of the corpus for it.
pub fn seeds(reader: Reader) -> Vec<(PathBuf, Vec<u8>)> {
    let folders = reader
        .corpus()
        .into_iter()
        .map(|folder| Path::new(env!("CARGO_MANIFEST_DIR")).join(folder));
    let mut paths: Vec<PathBuf> = folders
        .flat_map(|folder| folder.read_dir().unwrap().map(|entry| entry.unwrap().path()))
        .filter(|path| reader.takes(path))
        .collect();
    paths.sort();
    paths.into_iter().map(|path| (path.clone(), contents(&path))).collect()
}

pub fn contents(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    File::open(path).unwrap().take(64 << 20).read_to_end(&mut bytes).unwrap();
    bytes
}

/// Makes cases of one reader.
pub struct Cases {
    reader: Reader,
    seeds: Vec<(PathBuf, Vec<u8>)>,
    random: Random,
}

impl Cases {
    pub fn new(reader: Reader, seed: u64) -> Self {
        let seeds = seeds(reader);
        assert!(!seeds.is_empty(), "no seed of {}", reader.name());
        Self { reader, seeds, random: Random::new(seed) }
    }

    /// The next mutated file, and the ending of its name.
    pub fn next_case(&mut self) -> (Vec<u8>, String) {
        let random = &mut self.random;
        let (path, seed) = &self.seeds[random.below(self.seeds.len())];
        let (_, other) = &self.seeds[random.below(self.seeds.len())];
        let mut bytes = seed.clone();
        for _ in 0..=random.below(4) {
            mutate::mutate(&mut bytes, other, random);
        }
        // Half of the cases get past the checksums.
        if random.below(2) == 0 {
            checksums::seal(self.reader, &mut bytes);
        }
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        (bytes, ending.to_owned())
    }
}

/// Reads bytes as a file in `folder`, and measures it.
pub fn run(reader: Reader, bytes: &[u8], ending: &str, folder: &Path) -> Outcome {
    let path = folder.join(format!("case.{ending}"));
    fs::write(&path, bytes).unwrap();
    allocator::reset_peak();
    let before = allocator::live_bytes();
    let start = Instant::now();
    let result = std::panic::catch_unwind(|| reader.read(&path));
    let time = start.elapsed();
    let peak_bytes = allocator::peak_bytes().saturating_sub(before);
    let (panic, is_read) = match result {
        Ok(is_read) => (None, is_read),
        Err(panic) => (Some(message(&*panic)), false),
    };
    Outcome { time, peak_bytes, panic, is_read }
}

fn message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|s| (*s).into())).unwrap_or_default()
}
