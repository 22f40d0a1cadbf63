//! Progress on standard error: a bar with rate and remaining time, lines of JSON, or nothing; and
//! the flag that Ctrl-C sets.

use crate::io::visible::{visible, visible_json};
use esker_points::Task;
use indicatif::{HumanCount, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::fmt::Write;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How progress is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// A bar, if standard error is a terminal.
    #[default]
    Bar,
    /// A line of JSON twice a second.
    Json,
    /// Only notes.
    None,
    /// Nothing.
    Silent,
}

/// Interval of lines of JSON.
const LINE_EVERY: Duration = Duration::from_millis(500);

/// Shows progress; knows whether the user has cancelled the work.
pub struct Progress {
    style: Style,
    stop: Arc<AtomicBool>,
    done: AtomicU64,
    phase: Mutex<Phase>,
}

struct Phase {
    name: String,
    total: Option<u64>,
    unit: &'static str,
    start: Instant,
    line: Instant,
    bar: ProgressBar,
}

impl Progress {
    /// Shows progress in `style`; cancelled when `stop` is set.
    pub fn new(style: Style, stop: Arc<AtomicBool>) -> Self {
        let now = Instant::now();
        let phase = Phase {
            name: String::new(),
            total: None,
            unit: "",
            start: now,
            line: now,
            bar: ProgressBar::hidden(),
        };
        Self { style, stop, done: AtomicU64::new(0), phase: Mutex::new(phase) }
    }

    fn with<T>(&self, f: impl FnOnce(&mut Phase) -> T) -> T {
        f(&mut self.phase.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    /// Shows the end of a phase.
    fn end(&self, phase: &mut Phase) {
        phase.bar.finish_and_clear();
        if self.style == Style::Json && !phase.name.is_empty() {
            self.line(phase);
        }
    }

    fn line(&self, phase: &mut Phase) {
        phase.line = Instant::now();
        let done = self.done.load(Ordering::Relaxed);
        let seconds = phase.start.elapsed().as_secs_f64();
        let line = serde_json::json!({
            "phase": phase.name, "done": done, "total": phase.total, "unit": phase.unit,
            "seconds": seconds, "rate": if seconds > 0.0 { done as f64 / seconds } else { 0.0 },
        });
        eprintln!("{line}");
    }
}

impl Task for Progress {
    fn phase(&self, name: &str, total: Option<u64>, unit: &'static str) {
        self.with(|phase| {
            self.end(phase);
            self.done.store(0, Ordering::Relaxed);
            let now = Instant::now();
            (phase.name, phase.total, phase.unit, phase.start) = (name.to_owned(), total, unit, now);
            if self.style == Style::Bar {
                let target = ProgressDrawTarget::stderr_with_hz(5);
                let bar = ProgressBar::with_draw_target(total, target).with_message(name.to_owned());
                let template = format!("{{msg:16}} {{wide_bar}} {{percent:>3}} %  {{human_pos}} {unit}, {{rate}}, {{eta}} left");
                if let Ok(style) = ProgressStyle::with_template(&template) {
                    bar.set_style(style.with_key("rate", rate));
                }
                phase.bar = bar;
            }
        });
    }

    fn advance(&self, by: u64) {
        self.done.fetch_add(by, Ordering::Relaxed);
        match self.style {
            Style::Bar => self.with(|phase| phase.bar.inc(by)),
            Style::Json => self.with(|phase| {
                if phase.line.elapsed() >= LINE_EVERY {
                    self.line(phase)
                }
            }),
            Style::None | Style::Silent => {}
        }
    }

    fn note(&self, line: &str) {
        match self.style {
            Style::Silent => {}
            Style::Json => {
                eprintln!("{}", visible_json(&serde_json::json!({ "note": line }).to_string()));
            }
            _ => {
                let line = visible(line);
                self.with(|phase| phase.bar.suspend(|| eprintln!("note: {line}")));
            }
        }
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.with(|phase| self.end(phase));
    }
}

/// Units a second, without decimals.
fn rate(state: &ProgressState, out: &mut dyn Write) {
    // A bar that cannot be written cannot report it either.
    let _ = write!(out, "{}/s", HumanCount(state.per_sec() as u64));
}
