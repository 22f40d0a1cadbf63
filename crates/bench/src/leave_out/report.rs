//! The report of the benchmark of leaving out, and its table for people.

use esker_engine::io::quantity::readable_bytes;
use serde::Serialize;

/// Rows of all files and omissions.
#[derive(Clone, Debug, Serialize)]
pub struct LeaveOutReport {
    /// Name of the GPU.
    pub(super) adapter: Option<String>,
    /// Why the CPU alone is measured.
    pub(super) note: Option<String>,
    /// Threads of the CPU renderer.
    pub(super) threads: usize,
    /// Width of the requested picture, pixels.
    pub(super) width: u32,
    /// Height of the requested picture, pixels.
    pub(super) height: u32,
    /// A row for each file and omission.
    pub(super) rows: Vec<LeaveOutRow>,
}

/// A thing that is left out of pictures of a file.
#[derive(Clone, Debug, Serialize)]
pub(super) struct LeaveOutRow {
    pub file: String,
    pub left_out: &'static str,
    /// Whether the frames differ.
    pub applies: bool,
    /// Width of the picture, which may be smaller than the requested one, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Cost of a frame with it.
    pub with: FrameCost,
    /// Cost of a frame without it.
    pub without: FrameCost,
}

/// Cost of a frame.
#[derive(Clone, Debug, Serialize)]
pub(super) struct FrameCost {
    /// Bytes read from the file.
    pub bytes_read: u64,
    /// Bytes of planes in memory.
    pub bytes_resident: u64,
    pub points: u64,
    /// Median time on the CPU.
    pub cpu_ms: Option<f64>,
    /// Median time on the GPU.
    pub gpu_ms: Option<f64>,
}

/// Writes the report for people.
pub fn text(report: &LeaveOutReport) -> String {
    let mut lines = Vec::new();
    let mut file = "";
    for row in &report.rows {
        if row.file != file {
            file = &row.file;
            lines.push(format!("{file}: with it and without"));
        }
        lines.push(line(row, report));
    }
    lines.extend(report.adapter.iter().map(|name| format!("gpu: {name}")));
    lines.join("\n")
}

fn line(row: &LeaveOutRow, report: &LeaveOutReport) -> String {
    let name = name_of(row, report);
    if !row.applies {
        return format!("  {name:<50} not in this view: nothing is left out");
    }
    let LeaveOutRow { with, without, .. } = row;
    let bytes = |with: u64, without: u64| {
        format!("{:>10} {:>10}", readable_bytes(with), readable_bytes(without))
    };
    let ms = |with: Option<f64>, without: Option<f64>| match (with, without) {
        (Some(with), Some(without)) => format!("{with:>8.2} {without:>8.2} ms"),
        _ => String::new(),
    };
    format!(
        "  {name:<50} read {}  resident {}  cpu {}{}{}",
        bytes(with.bytes_read, without.bytes_read),
        bytes(with.bytes_resident, without.bytes_resident),
        ms(with.cpu_ms, without.cpu_ms),
        if with.gpu_ms.is_none() { "" } else { "  gpu " },
        ms(with.gpu_ms, without.gpu_ms),
    )
}

/// Name of the omission, and the size of the picture if it is not the requested one.
fn name_of(row: &LeaveOutRow, report: &LeaveOutReport) -> String {
    let LeaveOutRow { left_out, width, height, .. } = *row;
    if (width, height) == (report.width, report.height) {
        left_out.into()
    } else {
        format!("{left_out} ({width}x{height})")
    }
}
