//! Decoding alone: reads scans and discards their points, the least time that building can take.

use anyhow::Result;
use esker_engine::io::quantity::grouped;
use esker_engine::machine::pool;
use esker_points::Task;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Report of decoding.
#[derive(Clone, Debug, Serialize)]
pub struct DecodeReport {
    /// Points of all inputs, according to their headers.
    pub points: u64,
    /// Time of all inputs.
    pub seconds: f64,
    /// Points over seconds.
    pub points_per_second: f64,
}

/// Decodes scans and discards their points; only positions are looked at.
///
/// # Errors
/// If an input is damaged, or `task` is cancelled.
pub fn decode(inputs: &[PathBuf], threads: usize, task: &dyn Task) -> Result<DecodeReport> {
    let start = Instant::now();
    let points = pool::run(threads, || {
        let mut points = 0;
        for input in inputs {
            let source = esker_scan::open(input, &Default::default(), task)?;
            source.survey(task)?;
            points += source.info().points_hint;
        }
        Ok(points)
    })?;
    let seconds = start.elapsed().as_secs_f64();
    Ok(DecodeReport { points, seconds, points_per_second: points as f64 / seconds.max(1e-9) })
}

/// Writes the report for people.
pub fn decode_text(report: &DecodeReport) -> String {
    format!(
        "{} points decoded in {:.2} s, {:.2} million a second",
        grouped(report.points),
        report.seconds,
        report.points_per_second / 1e6
    )
}
