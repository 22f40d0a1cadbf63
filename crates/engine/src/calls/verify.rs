//! Verifying as a call: a file and those that it names against themselves, and against the scans
//! they were built from; and the report as text.

use crate::io::inputs;
use crate::io::quantity::grouped;
use crate::machine::pool;
use anyhow::Result;
use esker_format::{EskerFile, Forest};
use esker_points::{MultisetHash, Task};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Checks every byte and every rule of a file and of all files that it names; with `against`, also
/// that the points of all trees, or of its own alone, are those of the scans.
///
/// # Errors
/// The first fault found.
pub fn verify(path: &Path, against: &[PathBuf], threads: usize, task: &dyn Task) -> Result<Value> {
    let start = Instant::now();
    let against = &inputs::scans(against)?[..];
    pool::run(threads, || {
        let forest = Forest::open(path)?;
        let mut hash = MultisetHash::default();
        for file in forest.files() {
            hash += esker_format::verify(file, task)?.hash;
        }
        let scans = match against {
            [] => None,
            inputs => Some(esker_builder::against_forest(&forest, inputs, task)?),
        };
        Ok(json!({
            "ok": true,
            "points": forest.points(),
            "nodes": forest.table().nodes.len(),
            "bytes": forest.file_bytes(),
            "trees": forest.files().len(),
            "multiset_hash": hash.to_string(),
            "against": against.iter().map(|p| p.display().to_string()).collect::<Vec<_>>(),
            "against_points": scans.map(|s| s.points),
            "against_refused": scans.map(|s| s.refused),
            "against_trees": scans.map(|s| s.trees),
            "seconds": start.elapsed().as_secs_f64(),
        }))
    })
}

/// The report for people.
pub fn text(path: &Path, report: &Value) -> String {
    let number = |name: &str| report[name].as_u64().unwrap_or(0);
    let trees = number("trees");
    let mut line = format!("{}: ok, {} points", path.display(), grouped(number("points")));
    if trees > 1 {
        line += &format!(" in {trees} trees");
    }
    if report["against_trees"].is_null() {
        return line;
    }
    line += if number("against_trees") < trees {
        ", those of the last tree the points of the scans"
    } else {
        ", the points of the scans"
    };
    match number("against_refused") {
        0 => {}
        refused => {
            line += &format!(
                "; {} points of the scans were refused when it was built, and are not in it",
                grouped(refused)
            );
        }
    }
    line
}

/// What machines are told of a file that did not hold: `ok` is false; its points, where it says
/// them.
pub fn refused(path: &Path, error: &anyhow::Error) -> Value {
    let points = EskerFile::open(path).ok().map(|file| file.footer().points);
    json!({ "ok": false, "points": points, "error": crate::one_line(error) })
}
