//! The report of error against run time: a row for each setting, which of them are on the Pareto
//! front, advice for given frame times, and a table for people.

use crate::error_time::budgets::Budget;
use crate::error_time::columns::{COLUMNS, in_columns, padded};
use crate::error_time::lit::{self, LitRow};
use crate::error_time::row::Row;
use crate::error_time::streaming::Load;
use esker_engine::calls::conditions::ConditionsReport;
use esker_engine::io::quantity::grouped;
use serde::Serialize;

/// Times of frames for which there is advice, milliseconds: 60, 30 and 15 frames a second.
pub(super) const BUDGETS_MS: [f64; 3] = [16.0, 33.0, 66.0];

/// Time that threads wait for a core, over CPU time, from which on the report has a note.
const BUSY: f64 = 0.1;

/// Rows of all scans, and what they are compared with.
#[derive(Clone, Debug, Serialize)]
pub struct ErrorTimeReport {
    /// Name of the GPU.
    pub(super) adapter: Option<String>,
    /// Why the CPU alone is measured.
    pub(super) note: Option<String>,
    /// Threads of the CPU renderer.
    pub(super) threads: usize,
    /// Time that threads waited for a core over the CPU time of the run: what other programs took.
    pub(super) waited: Option<f64>,
    /// Width and height of the shown picture, pixels.
    pub(super) size: [u32; 2],
    /// A scan each.
    pub(super) scans: Vec<Scan>,
    /// A row for each scan and setting.
    pub(super) rows: Vec<Row>,
    /// A row for each scan and setting of traced light, against a reference of its own.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) lit: Vec<LitRow>,
    /// A row for each scan, method and budget of time.
    pub(super) budgets: Vec<Budget>,
    /// A row for each scan, view and order of loading.
    pub(super) streaming: Vec<Load>,
}

/// A scan and its reference.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Scan {
    /// Name of the file.
    #[serde(skip)]
    pub name: String,
    /// The same with a number, if another scan has it.
    pub file: String,
    pub points: u64,
    /// Width and height of the shown picture, pixels.
    pub size: [u32; 2],
    /// Points of the common reference, by EWA splatting at twice the resolution.
    /// None where pictures are compared with exact surfaces.
    pub reference_points: Option<u64>,
    /// Error of the reference against itself, a step of the lattice aside: FLIP, and the share of
    /// the pixels that are off by more than 8 of 255. Smaller errors mean nothing.
    pub floor_flip: f64,
    pub floor_off_share: f64,
    /// The best setting for each of the [`BUDGETS_MS`].
    pub advice: Vec<Advice>,
    /// How difficult its points are, beside what pictures are rated to.
    pub conditions: ConditionsReport,
}

/// The setting of least error that keeps a time, of those that users have; none if no setting does.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Advice {
    /// The time, milliseconds a frame.
    pub budget_ms: f64,
    /// Options on the command line.
    pub options: Option<String>,
    pub ms: Option<f64>,
    pub cpu_ms: Option<f64>,
    pub flip: Option<f64>,
    pub off_share: Option<f64>,
}

impl Scan {
    /// What pictures are compared with.
    pub fn reference(&self) -> String {
        match self.reference_points {
            Some(points) => {
                format!("EWA splatting of {} points at twice the resolution", grouped(points))
            }
            None => "the exact surfaces".into(),
        }
    }
}

/// Marks the rows on the Pareto front of time and FLIP.
pub(super) fn mark_front(rows: &mut [Row]) {
    let figures: Vec<[f64; 2]> = rows.iter().map(|row| [row.ms, row.flip]).collect();
    for (row, own) in rows.iter_mut().zip(&figures) {
        let beats = |other: &[f64; 2]| {
            other[0] <= own[0] && other[1] <= own[1] && (other[0] < own[0] || other[1] < own[1])
        };
        row.on_front = !figures.iter().any(beats);
    }
}

/// The best setting for each of the [`BUDGETS_MS`].
pub(super) fn advice(rows: &[Row]) -> Vec<Advice> {
    let best = |budget_ms: f64| {
        let fast = rows.iter().filter(|row| row.ms <= budget_ms && row.options.is_some());
        let row = fast.min_by(|a, b| a.flip.total_cmp(&b.flip));
        Advice {
            budget_ms,
            options: row.and_then(|row| row.options.clone()),
            ms: row.map(|row| row.ms),
            cpu_ms: row.and_then(|row| row.cpu_ms),
            flip: row.map(|row| row.flip),
            off_share: row.map(|row| row.off_share),
        }
    };
    BUDGETS_MS.map(best).to_vec()
}

impl Scan {
    /// A sentence for each advice: what to draw with, and what to expect.
    pub fn sentences(&self) -> Vec<String> {
        self.advice.iter().map(|advice| self.sentence(advice)).collect()
    }

    fn sentence(&self, advice: &Advice) -> String {
        let budget_ms = advice.budget_ms;
        let (Some(options), Some(ms), Some(flip), Some(off_share)) =
            (&advice.options, advice.ms, advice.flip, advice.off_share)
        else {
            return format!("On this machine no setting takes less than {budget_ms:.0} ms.");
        };
        format!(
            "On this machine at {budget_ms:.0} ms: {options} takes {ms:.1} ms; FLIP {flip:.3}, \
             {:.1} % of the pixels off (floor {:.3}, {:.1} %).",
            off_share * 100.0,
            self.floor_flip,
            self.floor_off_share * 100.0,
        )
    }
}

/// Writes the report for people: the rows of each scan, fastest first, and the advice.
pub fn text(report: &ErrorTimeReport) -> String {
    let mut lines = Vec::new();
    for scan in &report.scans {
        let mut rows: Vec<Row> =
            report.rows.iter().filter(|row| row.file == scan.file).cloned().collect();
        rows.sort_by(|a, b| a.ms.total_cmp(&b.ms));
        lines.push(format!(
            "{}: {} points, {}x{} pixels; reference: {}",
            scan.file,
            grouped(scan.points),
            scan.size[0],
            scan.size[1],
            scan.reference()
        ));
        lines.push(COLUMNS.iter().map(|(title, width)| padded(title, *width)).collect());
        lines.extend(rows.iter().map(line));
        let lit: Vec<&LitRow> = report.lit.iter().filter(|row| row.file == scan.file).collect();
        lines.extend(lit::heading(&lit));
        lines.extend(lit.iter().map(|row| in_columns(&row.cells()).trim_end().to_owned()));
        lines.extend(scan.sentences());
        lines.extend(report.budgets.iter().filter(|b| b.file == scan.file).map(Budget::line));
        lines.extend(streaming_lines(report.streaming.iter().filter(|l| l.file == scan.file)));
    }
    let waited = report.waited.filter(|waited| *waited > BUSY);
    lines.extend(waited.map(|waited| {
        format!("other programs kept this machine busy: threads waited for {waited:.2} of their CPU time, so times of frames are too long")
    }));
    lines.extend(report.adapter.iter().map(|name| format!("gpu: {name}")));
    lines.extend(report.note.iter().map(|note| format!("the CPU alone is measured: {note}")));
    lines.join("\n")
}

/// A line for each view and order of loading.
pub(super) fn streaming_lines<'a>(loads: impl Iterator<Item = &'a Load>) -> Vec<String> {
    let line = |load: &Load| {
        let [low, high] = load.area_quartiles_ms;
        format!(
            "streaming {} by {}: complete after {:.0} ms, {} KB read, area under the error {:.2} ms ({low:.2} to {high:.2})",
            load.view,
            load.priority,
            load.complete_ms,
            grouped(load.read_bytes / 1000),
            load.area_ms
        )
    };
    loads.map(line).collect()
}

fn line(row: &Row) -> String {
    in_columns(&row.cells()) + if row.on_front { " *" } else { "" }
}
