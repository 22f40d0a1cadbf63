//! How difficult a scan is, as a call (`esker info --conditions`): its own value of each condition
//! that its points have, beside the value up to which pictures are rated. A sample of cells, evenly
//! spread over the points, is read; conditions of views are listed in `docs/limits.md`.

mod measure;
pub mod rated;
mod sample;

use crate::io::file::is_esker;
use crate::io::quantity::grouped;
use crate::machine::pool;
use anyhow::{Result, ensure};
use esker_format::Forest;
use esker_points::Task;
use measure::{CellConditions, quantile};
use rated::Condition;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;

/// Ratio of densities that random points of one density have by chance.
const RANDOM_DENSITIES: f64 = 2.5;
/// Ratio of rows and columns that random points have by chance.
const RANDOM_ROWS: f64 = 2.0;

/// Conditions of a file.
#[derive(Clone, Debug, Serialize)]
pub struct ConditionsReport {
    /// Points of the file.
    pub points: u64,
    /// Cells of at most as many points as a node may have.
    pub cells: usize,
    /// Cells that were measured, and the points in them.
    pub cells_read: usize,
    /// Points that were read.
    pub points_read: u64,
    /// A row for each condition.
    pub conditions: Vec<ConditionRow>,
}

/// A condition of a file.
#[derive(Clone, Debug, Serialize)]
pub struct ConditionRow {
    /// Name of the condition.
    pub condition: &'static str,
    /// Meaning of its values.
    pub value_is: &'static str,
    /// Median of the cells; none where no cell has enough points.
    pub typical: Option<f64>,
    /// Value of the most difficult cell.
    pub hardest: Option<f64>,
    /// Whether a smaller value is more difficult.
    pub smaller_is_harder: bool,
    /// Most difficult value that evenly random points have; easier ones say nothing of a scan.
    pub by_chance: f64,
    /// Rated values.
    pub rated: Vec<RatedRow>,
}

/// A rated value, and whether a file keeps it.
#[derive(Clone, Debug, Serialize)]
pub struct RatedRow {
    /// Method, as on the command line.
    pub method: &'static str,
    /// Error that is bounded.
    pub measure: &'static str,
    /// Maximum permissible error.
    pub bound: f64,
    /// Value up to which it holds.
    pub rated_to: f64,
    /// Whether the most difficult cell is no more difficult than the rated value, or than random
    /// points.
    pub is_within: bool,
}

/// How a condition is read from cells.
struct Reading {
    condition: &'static Condition,
    of: fn(&CellConditions) -> Option<f64>,
    smaller_is_harder: bool,
    by_chance: f64,
}

/// Conditions that points have.
static READINGS: [Reading; 6] = [
    Reading {
        condition: &rated::DENSITY_JUMP,
        of: |cell| cell.density_jump,
        smaller_is_harder: false,
        by_chance: RANDOM_DENSITIES,
    },
    Reading {
        condition: &rated::STEP,
        of: |cell| cell.step,
        smaller_is_harder: false,
        by_chance: 0.0,
    },
    Reading {
        condition: &rated::NOISE,
        of: |cell| cell.noise,
        smaller_is_harder: false,
        by_chance: 0.0,
    },
    Reading {
        condition: &rated::SCAN_LINES,
        of: |cell| cell.scan_lines,
        smaller_is_harder: false,
        by_chance: RANDOM_ROWS,
    },
    Reading {
        condition: &rated::SAME_PLACE,
        of: |cell| cell.same_place,
        smaller_is_harder: false,
        by_chance: 0.0,
    },
    Reading {
        condition: &rated::THICKNESS,
        of: |cell| cell.thickness,
        smaller_is_harder: true,
        by_chance: f64::INFINITY,
    },
];

/// Measures the conditions of an `.esker` file.
///
/// # Errors
/// If the file is no `.esker` file or cannot be read, or `task` is cancelled.
pub fn conditions(path: &Path, task: &dyn Task) -> Result<ConditionsReport> {
    ensure!(
        is_esker(path)?,
        "{}: conditions are those of an .esker file; build one with `esker build`",
        path.display()
    );
    let forest = Forest::open(path)?;
    pool::run(0, || of_forest(&forest, task))
}

/// Measures the conditions of an open file.
///
/// # Errors
/// If the file cannot be read, or `task` is cancelled.
pub fn of_forest(forest: &Forest, task: &dyn Task) -> Result<ConditionsReport> {
    let (chosen, cells) = sample::choose(forest);
    let measured = chosen.par_iter().map(|top| {
        task.check()?;
        let (points, count) = sample::read(forest, *top)?;
        Ok((points.conditions(), count as u64))
    });
    let measured: Vec<(CellConditions, u64)> = measured.collect::<Result<_>>()?;
    Ok(ConditionsReport {
        points: forest.points(),
        cells,
        cells_read: measured.len(),
        points_read: measured.iter().map(|(_, points)| points).sum(),
        conditions: READINGS.iter().map(|reading| reading.row(&measured)).collect(),
    })
}

impl Reading {
    fn row(&self, measured: &[(CellConditions, u64)]) -> ConditionRow {
        let values: Vec<f64> = measured.iter().filter_map(|(cell, _)| (self.of)(cell)).collect();
        let has_any = !values.is_empty();
        let end = if self.smaller_is_harder { 0.0 } else { 1.0 };
        let hardest = has_any.then(|| quantile(values.clone(), end));
        let is_within = |rated_to: f64| match (hardest, self.smaller_is_harder) {
            (None, _) => true,
            (Some(value), true) => value >= rated_to,
            (Some(value), false) => value <= rated_to.max(self.by_chance),
        };
        let rated = self.condition.gauges.iter().map(|gauge| RatedRow {
            method: gauge.method,
            measure: gauge.measure.name(),
            bound: gauge.bound,
            rated_to: gauge.rated_to,
            is_within: is_within(gauge.rated_to),
        });
        ConditionRow {
            condition: self.condition.name,
            value_is: self.condition.value_is,
            typical: has_any.then(|| quantile(values, 0.5)),
            hardest,
            smaller_is_harder: self.smaller_is_harder,
            by_chance: if self.by_chance.is_finite() { self.by_chance } else { 0.0 },
            rated: rated.collect(),
        }
    }
}

/// Cells of a table for people: condition, meaning, typical and hardest value, and for each method
/// and error the rated value, with what is beyond it marked.
pub fn cells(row: &ConditionRow) -> [String; 5] {
    let value = |value: Option<f64>| value.map_or("-".into(), short);
    let rated = row.rated.iter().map(|rated| {
        let measure = rated.measure.split(',').next().unwrap_or_default();
        let beyond = if rated.is_within { "" } else { " BEYOND" };
        format!("{} {measure} {}{beyond}", rated.method, short(rated.rated_to))
    });
    [
        row.condition.into(),
        row.value_is.into(),
        value(row.typical),
        value(row.hardest),
        rated.collect::<Vec<_>>().join("; "),
    ]
}

/// Writes the report for people.
pub fn text(report: &ConditionsReport) -> String {
    let mut lines = vec![
        format!(
            "conditions of {} of {} cells, evenly spread: {} of {} points are read",
            grouped(report.cells_read as u64),
            grouped(report.cells as u64),
            grouped(report.points_read),
            grouped(report.points)
        ),
        format!("{:<13} {:>9} {:>9}  rated to", "condition", "typical", "hardest"),
    ];
    for row in &report.conditions {
        let [name, value_is, typical, hardest, rated] = cells(row);
        lines.push(format!("{name:<13} {typical:>9} {hardest:>9}  {rated}"));
        lines.push(format!("  {value_is}"));
    }
    lines.push("values beyond: docs/limits.md says what a picture then looks like".into());
    lines.join("\n")
}

/// A number with three digits.
fn short(value: f64) -> String {
    if value == 0.0 || !(1e-3..1e5).contains(&value.abs()) {
        return if value == 0.0 { "0".into() } else { format!("{value:.0e}") };
    }
    let digits = (2 - value.abs().log10().floor() as i32).max(0) as usize;
    let text = format!("{value:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').into(),
        false => text,
    }
}
