//! The report of the benchmark of size, and its table for people.

use serde::Serialize;

/// Rows of all files, views and packings.
#[derive(Clone, Debug, Serialize)]
pub struct SizeReport {
    /// Width and height of the pictures, pixels.
    pub(super) size: [u32; 2],
    /// A row for each file, view and packing.
    pub(super) rows: Vec<SizeRow>,
}

/// One packing in one view of a file.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SizeRow {
    pub file: String,
    pub view: String,
    pub packing: &'static str,
    pub points: u64,
    pub bytes: u64,
    pub bytes_a_point: f64,
    /// Root mean square error of the points on the picture, pixels.
    pub place_px_rms: f64,
    /// Greatest error of a point on the picture, pixels.
    pub place_px_most: f64,
    /// Root mean square error of a colour channel, of 255.
    pub colour_rms: f64,
    /// Root mean square error of normals.
    pub normal_degrees_rms: f64,
    /// Mean difference of a channel of the picture, of 255.
    pub picture_difference: f64,
    /// Share of pixels that differ visibly.
    pub pixels_changed: f64,
}

/// Writes the report for people: a table a view.
pub fn text(report: &SizeReport) -> String {
    let mut lines = Vec::new();
    for same_view in report.rows.chunk_by(|a, b| (&a.file, &a.view) == (&b.file, &b.view)) {
        let SizeRow { file, view, points, .. } = &same_view[0];
        lines.push(format!("{file}, {view}: {points} points"));
        lines.push(format!(
            "  {:<48} {:>8} {:>14} {:>8} {:>8} {:>9} {:>9}",
            "", "bytes", "place px (most)", "colour", "normal", "picture", "changed"
        ));
        lines.extend(same_view.iter().map(line));
    }
    lines.join("\n")
}

fn line(row: &SizeRow) -> String {
    format!(
        "  {:<48} {:>8.2} {:>7.3} ({:.2}) {:>8.2} {:>7.2}° {:>9.3} {:>8.2} %",
        row.packing,
        row.bytes_a_point,
        row.place_px_rms,
        row.place_px_most,
        row.colour_rms,
        row.normal_degrees_rms,
        row.picture_difference,
        100.0 * row.pixels_changed,
    )
}
