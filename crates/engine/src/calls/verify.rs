//! Verifying as a call: checks a file, and the files that it names, against their own rules, and
//! against the scans that they were built from. Returns a [`VerifyReport`], or the first fault.

use crate::io::file::is_esker;
use crate::io::inputs;
use crate::io::quantity::grouped;
use crate::machine::pool;
use anyhow::Result;
use esker_format::{EskerFile, Forest};
use esker_points::{MultisetHash, Task};
use esker_scan::OpenOptions;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What was verified.
#[derive(Clone, Debug, Serialize)]
pub struct VerifyReport {
    /// Always true: a fault is an error.
    pub ok: bool,
    /// Points of all trees.
    pub points: u64,
    /// Nodes of all trees; 0 if the file is a scan, as for its trees.
    pub nodes: usize,
    /// Bytes of all files.
    pub bytes: u64,
    /// Trees, one a file.
    pub trees: usize,
    /// Multiset hash of all points, hexadecimal; of a scan that of its records.
    pub multiset_hash: String,
    /// Scans that the points were compared with, or the `.esker` file that a scan was.
    pub against: Vec<String>,
    /// Points of the scans; none if there are no scans, as for the fields below.
    pub against_points: Option<u64>,
    /// Points of the scans that the file keeps beside the tree.
    pub against_set_aside: Option<u64>,
    /// Greatest distance by which coordinates of the scans were rounded, in the file's unit.
    pub against_rounding_error_max: Option<f64>,
    /// Points of the scans that were refused.
    pub against_refused: Option<u64>,
    /// Trees, the last ones of the forest, that have the points of the scans.
    pub against_trees: Option<usize>,
    /// Duration, seconds.
    pub seconds: f64,
}

/// Report on a file with a fault.
#[derive(Clone, Debug, Serialize)]
pub struct FaultReport {
    /// Always false.
    pub ok: bool,
    /// Points of the file, if its footer can be read.
    pub points: Option<u64>,
    /// The fault.
    pub error: String,
}

/// Checks every byte and every rule of the file at `path` and of all files that it names. With
/// `against`, also checks that the points of all trees, or of the last one alone, are those of the
/// scans, which are opened with `reading` as they were for the build. The other way round, checks
/// that a scan has the points of the `.esker` file that it was exported from.
///
/// # Errors
/// If there is a fault: the first one.
pub fn verify(
    path: &Path,
    against: &[PathBuf],
    reading: &OpenOptions,
    threads: usize,
    task: &dyn Task,
) -> Result<VerifyReport> {
    let start = Instant::now();
    if let [file] = against
        && is_esker(file).unwrap_or(false)
        && !is_esker(path).unwrap_or(true)
    {
        return pool::run(threads, || verify_scan(path, file, start, task));
    }
    let against = &inputs::scans(against, task)?[..];
    pool::run(threads, || {
        let forest = Forest::open(path)?;
        let mut hash = MultisetHash::default();
        for file in forest.files() {
            hash += esker_format::verify(file, task)?.hash;
        }
        let scans = match against {
            [] => None,
            inputs => Some(esker_builder::against_forest(&forest, inputs, reading, task)?),
        };
        Ok(VerifyReport {
            ok: true,
            points: forest.points(),
            nodes: forest.table().nodes.len(),
            bytes: forest.file_bytes(),
            trees: forest.files().len(),
            multiset_hash: hash.to_string(),
            against: against.iter().map(|p| p.display().to_string()).collect(),
            against_points: scans.map(|s| s.points),
            against_set_aside: scans.map(|s| s.set_aside),
            against_rounding_error_max: scans.map(|s| s.rounding_error_max),
            against_refused: scans.map(|s| s.refused),
            against_trees: scans.map(|s| s.trees),
            seconds: start.elapsed().as_secs_f64(),
        })
    })
}

/// Checks that the points of the scan at `path` are those of `file`, which it was exported from,
/// and every byte of that file.
fn verify_scan(path: &Path, file: &Path, start: Instant, task: &dyn Task) -> Result<VerifyReport> {
    let forest = Forest::open(file)?;
    for tree in forest.files() {
        esker_format::verify(tree, task)?;
    }
    let verified = esker_builder::verify_export(path, &forest, task)?;
    Ok(VerifyReport {
        ok: true,
        points: verified.points,
        nodes: 0,
        bytes: esker_points::read_at::open(path)?.bytes()?,
        trees: 0,
        multiset_hash: verified.hash.to_string(),
        against: vec![file.display().to_string()],
        against_points: Some(forest.points()),
        against_set_aside: Some(verified.set_aside),
        against_rounding_error_max: None,
        against_refused: None,
        against_trees: Some(forest.files().len()),
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Text of a report on the file at `path`.
pub fn text(path: &Path, report: &VerifyReport) -> String {
    let mut line = format!("{}: ok, {} points", path.display(), grouped(report.points));
    if report.trees > 1 {
        line += &format!(" in {} trees", report.trees);
    }
    let Some(trees) = report.against_trees else { return line };
    if report.trees == 0 {
        line += &format!(", all points of {} with all attributes", report.against.join(" "));
        let aside = report.against_set_aside.unwrap_or(0);
        if aside > 0 {
            line += &format!(
                "; {} points that it keeps beside its tree are not in the scan",
                grouped(aside)
            );
        }
        return line;
    }
    line += if trees < report.trees {
        ", those of the last tree the points of the scans"
    } else {
        ", the points of the scans"
    };
    line += &match report.against_rounding_error_max {
        None | Some(0.0) => ", coordinates exact".to_owned(),
        Some(error) => format!(", coordinates rounded by at most {error:.3e}"),
    };
    if let Some(aside) = report.against_set_aside.filter(|&aside| aside > 0) {
        line += &format!("; {} points far from the others are beside the tree", grouped(aside));
    }
    if let Some(refused) = report.against_refused.filter(|&refused| refused > 0) {
        line += &format!(
            "; {} points of the scans were refused when it was built, and are not in it",
            grouped(refused)
        );
    }
    line
}

/// Report on the fault `error` of the file at `path`.
pub fn fault(path: &Path, error: &anyhow::Error) -> FaultReport {
    let points = EskerFile::open(path).ok().map(|file| file.footer().points);
    FaultReport { ok: false, points, error: crate::one_line(error) }
}
