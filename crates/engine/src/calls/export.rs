//! Exporting as a call: an `.esker` file with all files that it names, or the points of it that a
//! filter accepts, as a scan. Returns an [`ExportReport`].

use crate::draw::empty_picture;
use crate::io::file::open_tree;
use crate::io::output;
use crate::io::quantity::{grouped, readable_bytes};
use crate::machine::pool;
use anyhow::Result;
use esker_builder::{ExportOptions, Exported};
use esker_points::{Filter, Task};
use serde::Serialize;
use std::path::Path;
use std::time::Instant;

/// What an export did.
#[derive(Clone, Debug, Serialize)]
pub struct ExportReport {
    /// Points of the file.
    pub points_in: u64,
    /// Points of the scan.
    pub points_out: u64,
    /// Points far from nearly all others that were written too.
    pub set_aside_out: u64,
    /// Multiset hash of the other points that were written, hexadecimal.
    pub multiset_hash: String,
    /// Whether points were left out.
    pub filtered: bool,
    /// True if all points were written and their hash is that of the file; none if points were
    /// left out.
    pub hash_equal: Option<bool>,
    /// Trees of the file.
    pub trees: u64,
    /// Nodes of the file.
    pub nodes: u64,
    /// Nodes that were read.
    pub nodes_read: u64,
    /// Bytes that were read.
    pub bytes_read: u64,
    /// Bytes of the scan.
    pub bytes_out: u64,
    /// Format of the scan.
    pub format: String,
    /// Duration, seconds.
    pub seconds: f64,
    /// Points written a second.
    pub points_per_second: f64,
    /// What the user should know, a line each.
    pub notes: Vec<String>,
}

/// Writes the points of `file`, and of the files that it names, that `filter` accepts to `out`,
/// with `options`, on `threads` threads (0: one a core).
///
/// # Errors
/// If the file is damaged, no point is accepted, the disk is full, or `task` is cancelled; no file
/// has the final name then.
pub fn export(
    file: &Path,
    out: &Path,
    filter: &Filter,
    options: ExportOptions,
    threads: usize,
    task: &dyn Task,
) -> Result<ExportReport> {
    let start = Instant::now();
    output::may_write(out, &[file.to_owned()])?;
    let exported = pool::run(threads, || {
        // The spacings of nodes that were not read yet are estimates.
        let forest = open_tree(file)?.grown(filter.max_spacing.is_some())?;
        let trees: Vec<_> = forest.files().map(|tree| tree.path().to_owned()).collect();
        output::may_write(out, &trees)?;
        let scans = forest.files().flat_map(|tree| &tree.metadata().sources);
        output::may_replace(out, output::folder_of(file), scans.map(|scan| scan.path.as_str()))?;
        empty_picture::check_classes(&forest, filter)?;
        Ok(esker_builder::export_with(&forest, out, filter, options, task)?)
    })?;
    Ok(ExportReport::new(exported, start.elapsed().as_secs_f64()))
}

impl ExportReport {
    fn new(exported: Exported, seconds: f64) -> Self {
        Self {
            points_in: exported.points_in,
            points_out: exported.points_out,
            set_aside_out: exported.set_aside_out,
            multiset_hash: exported.hash.to_string(),
            filtered: !exported.is_whole,
            hash_equal: (exported.is_whole && exported.has_hashes).then_some(true),
            trees: exported.trees,
            nodes: exported.nodes,
            nodes_read: exported.nodes_read,
            bytes_read: exported.bytes_read,
            bytes_out: exported.bytes_out,
            format: exported.format,
            seconds,
            points_per_second: exported.points_out as f64 / seconds.max(1e-9),
            notes: exported.notes,
        }
    }
}

/// Text of a report on the export to `out`.
pub fn text(report: &ExportReport, out: &Path) -> String {
    let mut lines = vec![format!(
        "{}: {}, {} points, {} ({:.1} bytes a point), in {:.1} s",
        out.display(),
        report.format,
        grouped(report.points_out),
        readable_bytes(report.bytes_out),
        report.bytes_out as f64 / report.points_out.max(1) as f64,
        report.seconds,
    )];
    lines.push(if report.filtered {
        format!(
            "filtered: {} of {} points, from {} of {} nodes, multiset hash {}",
            grouped(report.points_out),
            grouped(report.points_in),
            grouped(report.nodes_read),
            grouped(report.nodes),
            report.multiset_hash
        )
    } else {
        let of = if report.trees > 1 { "of all trees" } else { "of the file" };
        format!("proof: all points {of}, multiset hash {}", report.multiset_hash)
    });
    if report.set_aside_out > 0 {
        let points = grouped(report.set_aside_out);
        lines.push(format!("set aside: {points} points far from nearly all others, written too"));
    }
    lines.extend(report.notes.iter().map(|n| format!("note: {n}")));
    lines.join("\n")
}
