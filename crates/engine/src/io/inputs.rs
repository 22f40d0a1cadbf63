//! The inputs that were named: a folder stands for the scans in it, and what is named twice is
//! told.

use anyhow::Result;
use esker_points::Task;
use esker_scan::synthetic::is_spec;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The scans that are meant: in place of a folder those directly in it, by name.
///
/// # Errors
/// Where a folder cannot be read, or has no scan.
pub fn scans(named: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut scans = Vec::with_capacity(named.len());
    for path in named {
        if !is_spec(path) && path.is_dir() {
            scans.extend(esker_scan::scans_in(path)?);
        } else {
            scans.push(path.clone());
        }
    }
    Ok(scans)
}

/// Tells of scans that are named more than once. That may be meant: their points are taken as
/// often.
pub fn note_repeated(scans: &[PathBuf], task: &dyn Task) {
    let mut times = BTreeMap::new();
    for path in scans {
        // What is generated lies nowhere.
        let place = path.canonicalize().unwrap_or_else(|_| path.clone());
        times.entry(place).or_insert((path, 0u32)).1 += 1;
    }
    for (path, n) in times.into_values().filter(|(_, n)| *n > 1) {
        let path = path.display();
        task.note(&format!("{path}: is named {n} times, and its points are taken as often"));
    }
}
