//! Building, appending and merging as calls: from scans, or `.esker` files, to an `.esker` file.
//! Inputs and output are checked before any work. Returns a [`BuildReport`], which is printed as
//! JSON or as text.

use crate::io::inputs;
use crate::io::output;
use crate::io::quantity::{grouped, readable_bytes};
use crate::machine::pool;
use crate::machine::system;
use anyhow::Result;
use esker_builder::{Options, Report, Wrap};
use esker_format::{EskerFile, Normals};
use esker_points::Task;
use esker_points::palette::Misfit;
use esker_points::{quant, tangents};
use esker_scan::given::{Given, GivenInfo, Points};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What a build did.
#[derive(Clone, Debug, Serialize)]
pub struct BuildReport {
    /// Points decoded, including those refused or set aside.
    pub points_in: u64,
    /// Points in the file.
    pub points_out: u64,
    /// Points that were refused.
    pub points_refused: u64,
    /// Points that were refused, by reason.
    pub refused_reasons: BTreeMap<String, u64>,
    /// Points far from nearly all others, which the file keeps beside the tree.
    pub points_set_aside: u64,
    /// Multiset hash of the points in the file, hexadecimal.
    pub multiset_hash: String,
    /// Duration of the build, seconds.
    pub seconds: f64,
    /// Points decoded a second.
    pub points_per_second: f64,
    /// Greatest anonymous memory above that at the start, bytes.
    pub peak_anon_bytes: u64,
    /// Greatest resident set, bytes.
    pub peak_rss_bytes: u64,
    /// Estimate of the most bytes that scratch holds at once; none if a build was resumed.
    pub scratch_bytes_estimated: Option<u64>,
    /// Bytes written to scratch.
    pub scratch_bytes: u64,
    /// The most bytes that scratch held at once.
    pub scratch_bytes_peak: u64,
    /// The most bytes that scratch and the file held at once.
    pub disk_bytes_peak: u64,
    /// Bytes of the file.
    pub bytes_out: u64,
    /// Nodes of the file.
    pub nodes: u64,
    /// Greatest depth of a node; 0 for the root.
    pub depth: u32,
    /// Greatest distance by which a coordinate was rounded, in the file's unit.
    pub rounding_error_max: f64,
    /// Origin of the normals that are drawn, as in the metadata: none, source, estimated, oriented.
    pub normals: &'static str,
    /// Errors of the palette's colours; none without a compact plane.
    pub palette_misfit: Option<MisfitReport>,
    /// Greatest errors of the codes that pictures are drawn from.
    pub code_error_bounds: CodeErrorBounds,
    /// What the user should know, a line each.
    pub notes: Vec<String>,
}

/// Errors of the palette's colours, of 255.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MisfitReport {
    /// Mean over all points.
    pub mean: f64,
    /// Greatest error of 99 % of the points.
    pub most: f64,
    /// Greatest error of all points.
    pub worst: f64,
}

/// Greatest errors of the codes that pictures are drawn from; they follow from the encoding, not
/// from the points.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CodeErrorBounds {
    /// Share by which radii are too wide.
    pub radius: f64,
    /// Angle of normals, degrees; none in a file without normals.
    pub normal_degrees: Option<f64>,
    /// Shapes of splats; none in a file without them.
    pub shape: Option<ShapeErrorBounds>,
}

/// Greatest errors of the codes of splats' shapes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ShapeErrorBounds {
    /// Angle of the axes, degrees.
    pub axis_degrees: f64,
    /// Share of the distance between points.
    pub apart: f64,
    /// Share of the aspect.
    pub aspect: f64,
}

/// Builds `out` from scans, and from the scans in folders, on `threads` threads (0: one a core).
///
/// # Errors
/// If an input is damaged, space runs out, or `task` is cancelled; no file has the final name then.
pub fn build(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<BuildReport> {
    build_from(inputs, out, options, threads, &|sources| sources, task)
}

/// Builds like [`build`], from what `wrap` makes of the sources.
pub(crate) fn build_from(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    wrap: &Wrap<'_>,
    task: &dyn Task,
) -> Result<BuildReport> {
    let start = Instant::now();
    let inputs = &inputs::scans(inputs, task)?;
    output::may_build(out, inputs)?;
    inputs::note_repeated(inputs, task);
    within_memory(threads, start, || {
        Ok(esker_builder::build_wrapped(inputs, out, options, wrap, task)?)
    })
}

/// Builds `out` from points that the program has in memory, otherwise like [`build`].
///
/// # Errors
/// As for [`build`]; also if a coordinate is not finite.
pub fn build_given(
    given: GivenInfo,
    points: Box<dyn Points>,
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<BuildReport> {
    let start = Instant::now();
    output::may_build(out, &[])?;
    within_memory(threads, start, || {
        let given = Given::open(given, points, &options.open_options(), task)?;
        Ok(esker_builder::build_sources(vec![Box::new(given)], out, options, task)?)
    })
}

/// Runs a build, which keeps to `--memory`, on `threads` threads: freed memory must not stay with
/// the process.
pub(crate) fn within_memory(
    threads: usize,
    start: Instant,
    work: impl FnOnce() -> Result<Report> + Send,
) -> Result<BuildReport> {
    system::give_back_freed_memory();
    let report = pool::run(threads, work)?;
    Ok(BuildReport::new(report, start.elapsed().as_secs_f64()))
}

/// Most points of a node of a built file.
///
/// # Errors
/// If the file cannot be opened.
pub fn node_capacity(file: &Path) -> Result<u32> {
    Ok(EskerFile::open(file)?.metadata().node_capacity)
}

/// Builds `out` from scans onto the lattice of `old`. The new file names `old`, whose points are
/// not written again.
///
/// # Errors
/// As for [`build`]; also if `old` cannot be opened, or has another coordinate reference system.
pub fn append(
    old: &Path,
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<BuildReport> {
    let start = Instant::now();
    let inputs = &inputs::scans(inputs, task)?;
    output::may_build(out, inputs)?;
    inputs::note_repeated(inputs, task);
    within_memory(threads, start, || Ok(esker_builder::append(old, inputs, out, options, task)?))
}

/// Builds `out`, a single tree, from all points of `.esker` files and of the files that they name.
///
/// # Errors
/// As for [`build`]; also if the files cannot be opened, or have different lattices.
pub fn merge(
    files: &[PathBuf],
    out: &Path,
    options: &Options,
    threads: usize,
    task: &dyn Task,
) -> Result<BuildReport> {
    let start = Instant::now();
    output::may_build(out, files)?;
    within_memory(threads, start, || Ok(esker_builder::merge(files, out, options, task)?))
}

impl BuildReport {
    fn new(report: Report, seconds: f64) -> Self {
        let has_normals = report.normals != Normals::None;
        Self {
            points_in: report.points_in,
            points_out: report.points_out,
            points_refused: report.points_refused.values().sum(),
            refused_reasons: report.points_refused,
            points_set_aside: report.points_set_aside,
            multiset_hash: report.hash.to_string(),
            seconds,
            points_per_second: report.points_in as f64 / seconds.max(1e-9),
            peak_anon_bytes: report.peak_anon_bytes,
            peak_rss_bytes: report.peak_rss_bytes,
            scratch_bytes_estimated: report.scratch_bytes_estimated,
            scratch_bytes: report.scratch_bytes,
            scratch_bytes_peak: report.scratch_bytes_peak,
            disk_bytes_peak: report.disk_bytes_peak,
            bytes_out: report.bytes_out,
            nodes: report.nodes,
            depth: report.depth,
            rounding_error_max: report.rounding_error_max,
            normals: report.normals.name(),
            palette_misfit: report.palette_misfit.map(MisfitReport::from),
            code_error_bounds: CodeErrorBounds::of(has_normals, report.has_tangents),
            notes: report.notes,
        }
    }
}

impl From<Misfit> for MisfitReport {
    fn from(misfit: Misfit) -> Self {
        let Misfit { mean, most, worst } = misfit;
        Self { mean, most, worst }
    }
}

impl CodeErrorBounds {
    fn of(has_normals: bool, has_tangents: bool) -> Self {
        let shape = ShapeErrorBounds {
            axis_degrees: tangents::AXIS_ERROR_DEGREES,
            apart: tangents::APART_ERROR,
            aspect: tangents::ASPECT_ERROR,
        };
        Self {
            radius: quant::RADIUS_ERROR,
            normal_degrees: has_normals.then_some(quant::NORMAL_ERROR_DEGREES),
            shape: has_tangents.then_some(shape),
        }
    }
}

/// Text of a report on the build of `out`.
pub fn text(report: &BuildReport, out: &Path) -> String {
    let mut lines = vec![format!(
        "{}: {} points in {} nodes, {} levels deep, {} ({:.1} bytes a point), in {:.1} s",
        out.display(),
        grouped(report.points_out),
        grouped(report.nodes),
        report.depth + u32::from(report.nodes > 0),
        readable_bytes(report.bytes_out),
        report.bytes_out as f64 / report.points_out.max(1) as f64,
        report.seconds,
    )];
    lines.push(format!(
        "proof: {} points in, {} out, multiset hash {}",
        grouped(report.points_in),
        grouped(report.points_out),
        report.multiset_hash
    ));
    if report.points_set_aside > 0 {
        lines.push(format!("set aside: {} points", grouped(report.points_set_aside)));
    }
    for (reason, n) in &report.refused_reasons {
        lines.push(format!("refused: {} points: {reason}", grouped(*n)));
    }
    lines.push(match report.rounding_error_max {
        0.0 => "coordinates: exact".into(),
        error => format!("coordinates: rounded by at most {error:.3e}"),
    });
    if let Some(line) = normals_text(report.normals) {
        lines.push(line);
    }
    if let Some(MisfitReport { mean, most, worst }) = report.palette_misfit {
        lines.push(format!(
            "compact: colours of a palette, off by {mean:.1} of 255 in the mean, {most:.1} at most for 99 % of the points, {worst:.1} for any; \
             the exact ones are kept beside it"
        ));
    }
    lines.push(report.code_error_bounds.text());
    lines.push(format!(
        "memory: {} at most, {} resident; disk: {} through scratch{}, {} at most with the file",
        readable_bytes(report.peak_anon_bytes),
        readable_bytes(report.peak_rss_bytes),
        readable_bytes(report.scratch_bytes),
        scratch_peak(report),
        readable_bytes(report.disk_bytes_peak)
    ));
    lines.extend(report.notes.iter().map(|n| format!("note: {n}")));
    lines.join("\n")
}

/// Line on normals that were estimated.
fn normals_text(normals: &str) -> Option<String> {
    let origin = Normals::from_name(normals).filter(|origin| origin.is_estimated())?;
    let turned = if origin.is_oriented() { ", turned to the scanners" } else { "" };
    Some(format!("normals: estimated from the points{turned} (--normals none leaves them out)"))
}

/// The most bytes that scratch held at once, and their estimate; empty if scratch was not used.
fn scratch_peak(report: &BuildReport) -> String {
    if report.scratch_bytes == 0 {
        return String::new();
    }
    let estimated = report.scratch_bytes_estimated.map(readable_bytes);
    let estimated = estimated.map_or_else(String::new, |bytes| format!(", {bytes} estimated"));
    format!(" ({} at once{estimated})", readable_bytes(report.scratch_bytes_peak))
}

impl CodeErrorBounds {
    /// The bounds as a line.
    fn text(&self) -> String {
        let per_cent = |share: f64| format!("{:.1} %", share * 100.0);
        let mut line = "codes: their form lets ".to_owned();
        line += &format!("radii be too wide by {} at most", per_cent(self.radius));
        if let Some(degrees) = self.normal_degrees {
            line += &format!(", normals turned by {degrees} degrees");
        }
        if let Some(shape) = self.shape {
            line += &format!(
                "; shapes: axes turned by {} degrees, distances off by {}, aspects by {}",
                shape.axis_degrees,
                per_cent(shape.apart),
                per_cent(shape.aspect)
            );
        }
        line
    }
}
