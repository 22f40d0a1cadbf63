//! A row of the report: a scan drawn with one setting.

use crate::error_time::columns::{COLUMNS, or_dash};
use crate::error_time::settings::Setting;
use crate::pass_times;
use esker_engine::io::quantity::grouped;
use esker_render::PassTimes;
use serde::Serialize;

/// A scan drawn with one setting. Errors are means of the alignments, against the common reference
/// where nothing else is said.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Row {
    pub file: String,
    pub method: &'static str,
    /// `cpu` or `gpu`.
    pub backend: &'static str,
    pub settings: Setting,
    /// What differs from the method's defaults.
    pub what: String,
    /// Options on the command line; none if only the benchmark can draw so.
    pub options: Option<String>,
    /// Points that are drawn.
    pub points: u64,
    /// Median and quartiles of the time of a frame.
    pub ms: f64,
    pub ms_quartiles: [f64; 2],
    /// Median and quartiles of the CPU time of a frame, over all threads.
    pub cpu_ms: Option<f64>,
    pub cpu_ms_quartiles: Option<[f64; 2]>,
    /// Medians of the passes.
    #[serde(serialize_with = "pass_times::with_total")]
    pub stages_ms: PassTimes,
    /// Mean of FLIP, 0 to 1, and the least and greatest of the alignments.
    pub flip: f64,
    pub flip_range: [f64; 2],
    /// FLIP against the reference by the same method.
    pub flip_own: f64,
    /// Share of the pixels of which a channel is off by more than 8 of 255.
    pub off_share: f64,
    /// Shares of the interior of surfaces: empty, and showing what lies behind.
    pub hole_share: f64,
    pub bleeding_share: f64,
    /// Mean error of depths inside surfaces, in widths of a pixel.
    pub depth_px: f64,
    /// Mean error of the points' normals, degrees, where the surfaces are known.
    pub normal_deg: Option<f64>,
    /// Mean difference between the changes from frame to frame of picture and reference along a
    /// path of 30 frames, root of the mean square, 0 to 255.
    pub flicker: Option<f64>,
    /// How the file was built.
    pub build: Option<Build>,
    /// Whether no other setting of the scan is both faster and closer to the reference.
    pub on_front: bool,
}

/// How a file was built.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Build {
    /// Options, as on the command line, or `default`.
    pub options: &'static str,
    pub seconds: f64,
    pub bytes: u64,
}

impl Row {
    /// Its cells in the [`COLUMNS`].
    pub fn cells(&self) -> [String; COLUMNS.len()] {
        let percent = |share: f64, digits: usize| format!("{:.digits$}", share * 100.0);
        [
            self.method.into(),
            self.what.clone(),
            self.backend.into(),
            grouped(self.points),
            format!("{:.1}", self.ms),
            or_dash(self.cpu_ms),
            format!("{:.4}", self.flip),
            format!("{:.4}", self.flip_own),
            percent(self.off_share, 2),
            percent(self.hole_share, 3),
            percent(self.bleeding_share, 3),
            format!("{:.2}", self.depth_px),
            or_dash(self.normal_deg),
            or_dash(self.flicker),
        ]
    }
}
