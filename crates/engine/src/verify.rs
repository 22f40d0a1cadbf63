//! Verifying as a call: the file against itself, and against the scans it was built from.

use crate::pool;
use anyhow::Result;
use esker_format::EskerFile;
use esker_points::Task;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Checks every byte and every rule of a file; with `against`, also that its points are those of the scans.
///
/// # Errors
/// The first fault found.
pub fn verify(path: &Path, against: &[PathBuf], threads: usize, task: &dyn Task) -> Result<Value> {
    let start = Instant::now();
    pool::run(threads, || {
        let file = EskerFile::open(path)?;
        let report = esker_format::verify(&file, task)?;
        if !against.is_empty() {
            esker_build::against(&file, against, task)?;
        }
        Ok(json!({
            "ok": true,
            "points": report.points,
            "nodes": report.nodes,
            "bytes": report.bytes,
            "multiset_hash": report.hash.to_string(),
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
