//! What `--budget-ms` is worth: the settings that it chose beside the best fixed ones. All are rows
//! of the same rounds, drawn in turn.

use crate::error_time::row::Row;
use serde::Serialize;

/// Time of a fixed setting over that of one that a budget chose, at most, to be called as fast.
const AS_FAST: f64 = 1.1;

/// A budget of time: what it chose, and the fixed setting of the same method of least error that is
/// as fast.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Budget {
    pub file: String,
    /// The budget, and the method that was asked for.
    pub budget_ms: f64,
    pub wanted_method: &'static str,
    /// What was chosen.
    pub what: String,
    /// Median time of a frame, also over the budget.
    pub ms: f64,
    pub ms_over_budget: f64,
    /// CPU time of a frame, and the predicted over the measured one.
    pub cpu_ms: f64,
    pub predicted_over_measured: f64,
    pub flip: f64,
    /// None if no fixed setting is as fast.
    pub best_fixed: Option<BestFixed>,
}

/// A fixed setting beside a budget.
#[derive(Clone, Debug, Serialize)]
pub(super) struct BestFixed {
    pub what: String,
    pub ms: f64,
    pub flip: f64,
    /// Time of the budget's frame over that of this one.
    pub ms_ratio: f64,
    /// FLIP of the budget's frame over that of this one.
    pub flip_ratio: f64,
}

/// The budgets among the rows of a scan.
pub(super) fn budgets(rows: &[Row]) -> Vec<Budget> {
    rows.iter().filter_map(|row| budget(row, rows)).collect()
}

fn budget(row: &Row, rows: &[Row]) -> Option<Budget> {
    let (budget_ms, wanted_method) = row.settings.budget_ms.zip(row.settings.wanted_method)?;
    let (predicted_ms, cpu_ms) = row.settings.predicted_cpu_ms.zip(row.cpu_ms)?;
    let is_rival = |other: &&Row| {
        let is_fixed = other.settings.budget_ms.is_none() && other.settings.build.is_empty();
        let is_fast = other.cpu_ms.is_some_and(|other_ms| other_ms <= cpu_ms * AS_FAST);
        is_fixed && is_fast && other.method == wanted_method && other.backend == row.backend
    };
    let least = rows.iter().filter(is_rival).min_by(|a, b| a.flip.total_cmp(&b.flip));
    Some(Budget {
        file: row.file.clone(),
        budget_ms,
        wanted_method,
        what: row.what.clone(),
        ms: row.ms,
        ms_over_budget: row.ms / budget_ms,
        cpu_ms,
        predicted_over_measured: predicted_ms / cpu_ms.max(1e-6),
        flip: row.flip,
        best_fixed: least.map(|best| BestFixed {
            what: best.what.clone(),
            ms: best.ms,
            flip: best.flip,
            ms_ratio: row.ms / best.ms.max(1e-6),
            flip_ratio: row.flip / best.flip.max(1e-6),
        }),
    })
}

impl Budget {
    /// The same for people.
    pub fn line(&self) -> String {
        let rival = self.best_fixed.as_ref().map_or(String::new(), |best| {
            format!(
                "; best fixed setting that is as fast: FLIP {:.4}, {:.1} ms, {}",
                best.flip, best.ms, best.what
            )
        });
        format!(
            "--budget-ms {} by {}: {:.1} ms, {:.1} CPU ms, {:.2} of them predicted; FLIP {:.4}{rival}",
            self.budget_ms,
            self.wanted_method,
            self.ms,
            self.cpu_ms,
            self.predicted_over_measured,
            self.flip,
        )
    }
}
