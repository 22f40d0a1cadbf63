//! The report of the benchmark of rendering, and its table for people.

use crate::pass_times;
use esker_engine::io::quantity::grouped;
use esker_render::PassTimes;
use serde::Serialize;

/// Rows of all models, sizes, methods, radii and backends.
#[derive(Clone, Debug, Serialize)]
pub struct RenderBenchReport {
    /// Name of the GPU.
    pub(super) adapter: Option<String>,
    /// Whether the GPU is a software driver.
    pub(super) is_software: Option<bool>,
    /// Why the CPU alone is measured.
    pub(super) note: Option<String>,
    /// Threads of the CPU renderer.
    pub(super) threads: usize,
    /// A row for each model, size, method, radius and backend.
    pub(super) rows: Vec<RenderRow>,
}

/// One model in pictures of one size, by one method, radius and backend. Times are medians.
#[derive(Clone, Debug, Serialize)]
pub(super) struct RenderRow {
    pub model: String,
    pub points: u64,
    pub width: u32,
    pub height: u32,
    /// `cpu` or `gpu`.
    pub backend: &'static str,
    pub method: &'static str,
    /// Passes from points to level 0 of the pyramid, or to placed splats.
    pub project_ms: f64,
    /// Passes that close the surface.
    pub pull_push_ms: f64,
    /// Passes that light the surface.
    pub shade_ms: f64,
    pub total_ms: f64,
    /// Pixels that show a surface.
    pub pixels_covered: u64,
    /// Time in which the bytes of points and pixels are copied once.
    pub copy_floor_ms: f64,
    /// Dispatches of a frame on the GPU.
    pub dispatches: Option<u64>,
    /// Least time of a frame on the GPU, by its memory and its dispatches.
    pub gpu_floor_ms: Option<f64>,
    /// `total_ms` over `gpu_floor_ms`.
    pub over_floor: Option<f64>,
    pub mpoints_per_s: f64,
    /// Frames that were timed.
    pub frames: usize,
    /// Times of the fastest frame, whose passes add up.
    #[serde(serialize_with = "pass_times::with_total")]
    pub least_ms: PassTimes,
    /// Time in the paper.
    pub paper_total_ms: Option<f64>,
    /// Factor of the radii.
    pub radius_factor: f32,
    /// Time of a frame in which every pixel is covered.
    pub full_screen_ms: Option<f64>,
}

/// Writes the report for people: a line for each row, then the times beside a full screen.
pub fn text(report: &RenderBenchReport) -> String {
    let rows = &report.rows;
    let mut lines = vec![format!(
        "{:<18} {:>11} {:>10} {:<14} {:<7} {:>9} {:>9} {:>8} {:>9} {:>9} {:>14} {:>10} {:>9}",
        "model",
        "points",
        "size",
        "method",
        "backend",
        "project",
        "pull-push",
        "shade",
        "total ms",
        "copy",
        "GPU floor",
        "Mpoints/s",
        "paper ms"
    )];
    lines.extend(rows.iter().map(line));
    lines.extend(rows.iter().filter_map(beside_full_screen));
    lines.extend(report.adapter.iter().map(|name| format!("gpu: {name}")));
    lines.extend(report.note.iter().map(|note| format!("the CPU alone is measured: {note}")));
    lines.join("\n")
}

fn line(row: &RenderRow) -> String {
    format!(
        "{:<18} {:>11} {:>10} {:<14} {:<7} {:>9.2} {:>9.2} {:>8.2} {:>9.2} {:>9.2} {:>14} {:>10.1} {:>9}",
        row.model,
        grouped(row.points),
        format!("{}x{}", row.width, row.height),
        method(row),
        row.backend,
        row.project_ms,
        row.pull_push_ms,
        row.shade_ms,
        row.total_ms,
        row.copy_floor_ms,
        floor(row),
        row.mpoints_per_s,
        row.paper_total_ms.map_or("-".into(), |ms| ms.to_string()),
    )
}

/// The floor of a GPU, and the factor by which the frame takes longer.
fn floor(row: &RenderRow) -> String {
    match (row.gpu_floor_ms, row.over_floor) {
        (Some(floor), Some(over)) => format!("{floor:.2} (x{over:.1})"),
        _ => "-".into(),
    }
}

/// A line for each row with a factor of radii: the share of the picture that they cover, and the
/// time beside that of a full screen.
fn beside_full_screen(row: &RenderRow) -> Option<String> {
    let full = row.full_screen_ms?;
    let pixels = f64::from(row.width) * f64::from(row.height);
    Some(format!(
        "{} {}x{} {} {}: radii x{} cover {:.1} % of the pixels in {:.2} ms, {:.2} of a full screen's {full:.2}",
        row.model,
        row.width,
        row.height,
        row.method,
        row.backend,
        row.radius_factor,
        row.pixels_covered as f64 / pixels.max(1.0) * 100.0,
        row.total_ms,
        row.total_ms / full.max(1e-9),
    ))
}

/// The method, and the factor of the radii unless it is 1.
fn method(row: &RenderRow) -> String {
    match row.radius_factor {
        1.0 => row.method.into(),
        factor => format!("{} x{factor}", row.method),
    }
}
