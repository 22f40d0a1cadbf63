//! Inputs of a build: replaces folders by the scans in them, notes what is left out of folders, and
//! inputs that are named twice.

use anyhow::Result;
use esker_points::Task;
use esker_scan::synthetic::is_spec;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Scans that `named` stands for: those directly in a folder, by name, in place of the folder.
/// Notes the other files of folders.
///
/// # Errors
/// If a folder cannot be read, or has no scan.
pub fn scans(named: &[PathBuf], task: &dyn Task) -> Result<Vec<PathBuf>> {
    let mut scans = Vec::with_capacity(named.len());
    for path in named {
        if !is_spec(path) && path.is_dir() {
            let found = esker_scan::scans_in(path)?;
            if let Some(others) = found.left_out_text() {
                let path = path.display();
                task.note(&format!("{path}: left out unless named; {others}"));
            }
            scans.extend(found.scans);
        } else {
            scans.push(path.clone());
        }
    }
    Ok(scans)
}

/// Notes scans that are named more than once. This is allowed: their points are read as often.
pub fn note_repeated(scans: &[PathBuf], task: &dyn Task) {
    let mut times = BTreeMap::new();
    for path in scans {
        // A generated scan has no path.
        let place = path.canonicalize().unwrap_or_else(|_| path.clone());
        times.entry(place).or_insert((path, 0u32)).1 += 1;
    }
    for (path, n) in times.into_values().filter(|(_, n)| *n > 1) {
        let path = path.display();
        task.note(&format!("{path}: is named {n} times, and its points are taken as often"));
    }
}
