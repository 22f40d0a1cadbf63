//! The report of the drawing rate, and its table for people.

use esker_engine::io::quantity::{grouped, readable_bytes};
use serde::Serialize;

/// Rows of all clouds, sizes and paths.
#[derive(Clone, Debug, Serialize)]
pub struct DrawReport {
    /// The `.esker` file, if its points were drawn.
    pub(super) file: Option<String>,
    /// Name of the GPU.
    pub(super) adapter: Option<String>,
    /// Whether the GPU is a software driver.
    pub(super) is_software: Option<bool>,
    /// Threads of the CPU renderer.
    pub(super) threads: usize,
    /// Bytes that are read of each point.
    pub(super) bytes_a_point: usize,
    /// What was left out, and why.
    pub(super) notes: Vec<String>,
    /// A row for each cloud, size and path.
    pub(super) rows: Vec<DrawRow>,
}

/// One path over one cloud at one size of the picture.
#[derive(Clone, Debug, Serialize)]
pub(super) struct DrawRow {
    /// Name of the path: `cpu`, or a pass of the GPU.
    pub path: &'static str,
    /// Order of the points.
    pub order: &'static str,
    pub points: u64,
    pub nodes: usize,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Median time of a frame by `clock`, and its 10 % and 90 % quantiles.
    pub ms: f64,
    pub ms_p10: f64,
    pub ms_p90: f64,
    /// `timestamps` of the GPU, or `wall`.
    pub clock: &'static str,
    /// Median time by the wall clock.
    pub wall_ms: f64,
    /// Median time by the GPU's clock, if all frames have one.
    pub gpu_ms: Option<f64>,
    pub frames: usize,
    pub mpoints_per_s: f64,
    pub bytes_per_s: f64,
    /// Rate of copies of the same memory, bytes read and written.
    pub copy_bytes_per_s: f64,
    /// `bytes_per_s` over `copy_bytes_per_s`.
    pub share_of_bandwidth: f64,
    /// Rate over that of the pass without pixels, for the path `atomics`.
    pub rate_to_no_pixels: Option<f64>,
    /// Pixels with points.
    pub pixels_covered: Option<u64>,
    /// Name of the GPU, or of the CPU with its threads.
    pub device: String,
    /// Whether the device is a software driver of a GPU.
    pub is_software: bool,
}

/// Writes the report for people: a line for each row, then the devices and the notes.
pub fn text(report: &DrawReport) -> String {
    let mut lines = vec![format!(
        "{:>13} {:<7} {:>10} {:<18} {:>10} {:>9} {:>9} {:>9} {:>9} {:>10} {:>7} {:>9}",
        "points",
        "order",
        "size",
        "path",
        "ms",
        "p10",
        "p90",
        "wall ms",
        "Mpoints/s",
        "bytes/s",
        "share",
        "covered"
    )];
    lines.extend(report.rows.iter().map(line));
    let mut rows: Vec<_> = report.rows.iter().collect();
    // One line a device: the rate of its copies is measured anew for each cloud.
    rows.sort_by_key(|row| &row.device);
    for same_device in rows.chunk_by(|a, b| a.device == b.device) {
        let rates = || same_device.iter().map(|row| row.copy_bytes_per_s);
        let [low, high] = [rates().fold(f64::MAX, f64::min), rates().fold(0.0, f64::max)];
        lines.push(format!(
            "{}: a copy reads and writes {} to {} a second",
            same_device[0].device,
            readable_bytes(low as u64),
            readable_bytes(high as u64),
        ));
    }
    lines.extend(report.notes.iter().cloned());
    lines.join("\n")
}

fn line(row: &DrawRow) -> String {
    let beside = match row.rate_to_no_pixels {
        Some(share) => format!("  {:.0} % of its rate without pixels", share * 100.0),
        None => String::new(),
    };
    format!(
        "{:>13} {:<7} {:>10} {:<18} {:>10.3} {:>9.3} {:>9.3} {:>9.3} {:>9.1} {:>10} {:>5.1} % {:>9}{beside}",
        grouped(row.points),
        row.order,
        format!("{}x{}", row.size[0], row.size[1]),
        row.path,
        row.ms,
        row.ms_p10,
        row.ms_p90,
        row.wall_ms,
        row.mpoints_per_s,
        readable_bytes(row.bytes_per_s as u64),
        row.share_of_bandwidth * 100.0,
        row.pixels_covered.map_or("-".into(), |n| n.to_string()),
    )
}
