//! The folder of real scans that `ESKER_DATA` names, and its `manifest.csv`: the points and bounds
//! of each file according to independent readers. Tests without the folder are skipped.

#![allow(dead_code, reason = "each test needs other parts")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::path::{Path, PathBuf};

/// A file of the manifest.
pub struct Entry {
    pub name: String,
    /// Number of points, if the file can be read.
    pub points: Option<u64>,
    /// Least and greatest coordinates, if the file has points.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// The folder; `None`, with a note, if it is not set.
pub fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("ESKER_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("skipped: ESKER_DATA is not set");
    }
    folder
}

/// The files of the manifest, in its order.
pub fn manifest(folder: &Path) -> Vec<Entry> {
    let manifest = std::fs::read_to_string(folder.join("manifest.csv")).unwrap();
    let entry = |line: &str| {
        let fields = fields(line);
        let bounds = position(&fields[4]).zip(position(&fields[5]));
        Entry {
            name: fields[0].clone(),
            points: fields[2].parse().ok(),
            bounds: bounds.map(|(low, high)| [low, high]),
        }
    };
    manifest.lines().skip(1).map(entry).collect()
}

/// The fields of a line, some of them in quotes.
fn fields(line: &str) -> Vec<String> {
    let (mut fields, mut is_quoted) = (vec![String::new()], false);
    for c in line.chars() {
        match c {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => fields.push(String::new()),
            c => fields.last_mut().unwrap().push(c),
        }
    }
    fields
}

fn position(field: &str) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = field.split(' ').filter_map(|word| word.parse().ok()).collect();
    numbers.try_into().ok()
}
