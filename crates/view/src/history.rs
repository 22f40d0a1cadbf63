//! Undo and redo of what a user makes: settings and measured points. The camera is not undone. A
//! change that goes on, such as that of a slider, is one step.

use crate::settings::Settings;
use crate::tools::measure::Measure;
use eframe::egui::util::undoer::{self, Undoer};
use std::time::Duration;

/// How long the state must rest for a step.
const REST_S: f32 = 0.4;
/// Most steps.
const STEPS: usize = 100;

/// What is undone and redone.
#[derive(Clone, Debug, PartialEq)]
pub struct Made {
    /// Method, colours, filter, light, up axis, visible clouds, budgets.
    pub settings: Settings,
    /// Measured points.
    pub measure: Measure,
}

/// The steps.
pub struct History {
    undoer: Undoer<Made>,
}

impl Default for History {
    fn default() -> Self {
        let settings = undoer::Settings {
            max_undos: STEPS,
            stable_time: REST_S,
            ..undoer::Settings::default()
        };
        Self { undoer: Undoer::with_settings(settings) }
    }
}

impl History {
    /// Takes note of the present state at a time, seconds. Returns after which time it needs
    /// another look, if the state has just changed.
    pub fn watch(&mut self, now_s: f64, made: &Made) -> Option<Duration> {
        self.undoer.feed_state(now_s, made);
        self.undoer.is_in_flux().then_some(Duration::from_secs_f32(REST_S))
    }

    /// The state before the last step; `None` if there is none.
    pub fn undo(&mut self, present: &Made) -> Option<Made> {
        self.undoer.undo(present).cloned()
    }

    /// The state after the step that was undone last; `None` if there is none.
    pub fn redo(&mut self, present: &Made) -> Option<Made> {
        self.undoer.redo(present).cloned()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    fn made(points_budget: u64) -> Made {
        let settings = Settings { points_budget, ..Settings::default() };
        Made { settings, measure: Measure::default() }
    }

    #[test]
    fn changes_that_go_on_are_one_step_and_a_new_one_ends_redoing() {
        let mut history = History::default();
        history.watch(0.0, &made(1));
        assert!(history.undo(&made(1)).is_none());
        // A slider moves for a second, then rests.
        for i in 0..60 {
            let left = history.watch(1.0 + f64::from(i) / 60.0, &made(2 + i as u64));
            assert!(left.is_some());
        }
        assert!(history.watch(3.0, &made(61)).is_none());
        history.watch(4.0, &made(70));
        assert!(history.watch(5.0, &made(70)).is_none());
        assert_eq!(history.undo(&made(70)), Some(made(61)));
        assert_eq!(history.undo(&made(61)), Some(made(1)));
        assert_eq!(history.undo(&made(1)), None);
        assert_eq!(history.redo(&made(1)), Some(made(61)));
        history.watch(6.0, &made(5));
        history.watch(7.0, &made(5));
        assert_eq!(history.redo(&made(5)), None);
        // A change that has not rested yet is undone too.
        history.watch(8.0, &made(6));
        assert_eq!(history.undo(&made(6)), Some(made(5)));
    }
}
