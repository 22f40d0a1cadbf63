//! Verifying as a call: a file and those that it names against themselves, and the file against the scans it
//! was built from.

use crate::pool;
use anyhow::Result;
use esker_format::{EskerFile, Forest};
use esker_points::{MultisetHash, Task};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Checks every byte and every rule of a file and of all files that it names; with `against`, also that the
/// points of its own tree are those of the scans.
///
/// # Errors
/// The first fault found.
pub fn verify(path: &Path, against: &[PathBuf], threads: usize, task: &dyn Task) -> Result<Value> {
    let start = Instant::now();
    pool::run(threads, || {
        let forest = Forest::open(path)?;
        let mut hash = MultisetHash::default();
        for file in forest.files() {
            hash += esker_format::verify(file, task)?.hash;
        }
        if let Some(own) = forest.files().next().filter(|_| !against.is_empty()) {
            esker_build::against(own, against, task)?;
        }
        Ok(json!({
            "ok": true,
            "points": forest.points(),
            "nodes": forest.table().nodes.len(),
            "bytes": forest.file_bytes(),
            "trees": forest.files().len(),
            "multiset_hash": hash.to_string(),
            "against": against.iter().map(|p| p.display().to_string()).collect::<Vec<_>>(),
            "seconds": start.elapsed().as_secs_f64(),
        }))
    })
}

/// What machines are told of a file that did not hold: `ok` is false; its points, where it says them.
pub fn refused(path: &Path, error: &anyhow::Error) -> Value {
    let points = EskerFile::open(path).ok().map(|file| file.footer().points);
    json!({ "ok": false, "points": points, "error": format!("{error:#}") })
}
