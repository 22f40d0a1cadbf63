//! Building, appending and merging as calls, and their report as JSON and as text.

use crate::io::inputs;
use crate::io::output;
use crate::io::quantity::{grouped, readable_bytes};
use crate::machine::pool;
use crate::machine::system;
use anyhow::Result;
use esker_builder::{Options, Report};
use esker_format::{EskerFile, Normals};
use esker_points::Task;
use esker_points::palette::Misfit;
use esker_points::{quant, tangents};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Builds `out` from scans, or from those in folders, on so many threads (0: one a core); the
/// report and the seconds it took.
///
/// # Errors
/// Where an input is damaged, space runs out, or on request; nothing is left under the final name.
pub fn build(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<(Report, f64)> {
    let start = Instant::now();
    let inputs = &inputs::scans(inputs)?;
    output::may_build(out, inputs)?;
    inputs::note_repeated(inputs, task);
    let report = within_memory(threads, || Ok(esker_builder::build(inputs, out, options, task)?))?;
    Ok((report, start.elapsed().as_secs_f64()))
}

/// Runs what is to keep to `--memory` on so many threads: what is freed must not stay with the
/// process.
fn within_memory<R: Send>(threads: usize, work: impl FnOnce() -> Result<R> + Send) -> Result<R> {
    system::give_back_freed_memory();
    pool::run(threads, work)
}

/// Points that a node of a built file holds.
///
/// # Errors
/// Where the file does not open.
pub fn node_capacity(file: &Path) -> Result<u32> {
    Ok(EskerFile::open(file)?.metadata().node_capacity)
}

/// Builds `out` from scans onto the lattice of `old`, which it names; nothing of that is written
/// again.
///
/// # Errors
/// As [`build`]; where `old` does not open, or is in another coordinate reference system.
pub fn append(
    old: &Path,
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<(Report, f64)> {
    let start = Instant::now();
    let inputs = &inputs::scans(inputs)?;
    output::may_build(out, inputs)?;
    inputs::note_repeated(inputs, task);
    let report =
        within_memory(threads, || Ok(esker_builder::append(old, inputs, out, options, task)?))?;
    Ok((report, start.elapsed().as_secs_f64()))
}

/// Builds `out`, one tree, from all points of `.esker` files and of those that they name.
///
/// # Errors
/// As [`build`]; where the files do not open, or do not lie on one lattice.
pub fn merge(
    files: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<(Report, f64)> {
    let start = Instant::now();
    output::may_build(out, files)?;
    let report = within_memory(threads, || Ok(esker_builder::merge(files, out, options, task)?))?;
    Ok((report, start.elapsed().as_secs_f64()))
}

/// The report for machines.
pub fn json(report: &Report, seconds: f64) -> Value {
    json!({
        "points_in": report.points_in,
        "points_out": report.points_out,
        "points_refused": report.points_refused.values().sum::<u64>(),
        "refused_reasons": report.points_refused,
        "multiset_hash": report.hash.to_string(),
        "seconds": seconds,
        "points_per_second": report.points_in as f64 / seconds.max(1e-9),
        "peak_anon_bytes": report.peak_anon_bytes,
        "peak_rss_bytes": report.peak_rss_bytes,
        "scratch_bytes_estimated": report.scratch_bytes_estimated,
        "scratch_bytes": report.scratch_bytes,
        "scratch_bytes_peak": report.scratch_bytes_peak,
        "disk_bytes_peak": report.disk_bytes_peak,
        "bytes_out": report.bytes_out,
        "nodes": report.nodes,
        "depth": report.depth,
        "rounding_error_max": report.rounding_error_max,
        "palette_misfit": report.palette_misfit.map(|m| {
            json!({ "mean": m.mean, "most": m.most, "worst": m.worst })
        }),
        "code_error_bounds": {
            "radius": quant::RADIUS_ERROR,
            "normal_degrees": (report.normals != Normals::None).then_some(quant::NORMAL_ERROR_DEGREES),
            "shape": report.has_tangents.then(|| {
                json!({
                    "axis_degrees": tangents::AXIS_ERROR_DEGREES,
                    "apart": tangents::APART_ERROR,
                    "aspect": tangents::ASPECT_ERROR,
                })
            }),
        },
        "notes": report.notes,
    })
}

/// The report for people.
pub fn text(report: &Report, seconds: f64, out: &Path) -> String {
    let mut lines = vec![format!(
        "{}: {} points in {} nodes, {} levels deep, {} ({:.1} bytes a point), in {seconds:.1} s",
        out.display(),
        grouped(report.points_out),
        grouped(report.nodes),
        report.depth + u32::from(report.nodes > 0),
        readable_bytes(report.bytes_out),
        report.bytes_out as f64 / report.points_out.max(1) as f64,
    )];
    lines.push(format!(
        "proof: {} points in, {} out, multiset hash {}",
        grouped(report.points_in),
        grouped(report.points_out),
        report.hash
    ));
    for (reason, n) in &report.points_refused {
        lines.push(format!("refused: {} points: {reason}", grouped(*n)));
    }
    lines.push(match report.rounding_error_max {
        0.0 => "coordinates: exact".into(),
        error => format!("coordinates: rounded by at most {error:.3e}"),
    });
    if let Some(Misfit { mean, most, worst }) = report.palette_misfit {
        lines.push(format!(
            "compact: colours of a palette, off by {mean:.1} of 255 in the mean, {most:.1} at most for 99 % of the points, {worst:.1} for any; \
             the exact ones are kept beside it"
        ));
    }
    lines.push(codes(report));
    lines.push(format!(
        "memory: {} at most, {} resident; disk: {} through scratch{}, {} at most with the file",
        readable_bytes(report.peak_anon_bytes),
        readable_bytes(report.peak_rss_bytes),
        readable_bytes(report.scratch_bytes),
        scratch_at_once(report),
        readable_bytes(report.disk_bytes_peak)
    ));
    lines.extend(report.notes.iter().map(|n| format!("note: {n}")));
    lines.join("\n")
}

/// What scratch held at once, beside what was estimated.
fn scratch_at_once(report: &Report) -> String {
    if report.scratch_bytes == 0 {
        return String::new();
    }
    let estimated = report.scratch_bytes_estimated.map(readable_bytes);
    let estimated = estimated.map_or_else(String::new, |bytes| format!(", {bytes} estimated"));
    format!(" ({} at once{estimated})", readable_bytes(report.scratch_bytes_peak))
}

/// What codes that pictures are drawn from can be off by: this follows from their form, not from
/// the points.
fn codes(report: &Report) -> String {
    let per_cent = |share: f64| format!("{:.1} %", share * 100.0);
    let mut line = "codes: their form lets ".to_owned();
    line += &format!("radii be too wide by {} at most", per_cent(quant::RADIUS_ERROR));
    if report.normals != Normals::None {
        line += &format!(", normals turned by {} degrees", quant::NORMAL_ERROR_DEGREES);
    }
    if report.has_tangents {
        line += &format!(
            "; shapes: axes turned by {} degrees, distances off by {}, aspects by {}",
            tangents::AXIS_ERROR_DEGREES,
            per_cent(tangents::APART_ERROR),
            per_cent(tangents::ASPECT_ERROR)
        );
    }
    line
}
