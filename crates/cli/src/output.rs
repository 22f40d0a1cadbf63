//! Output of all commands: progress while they work, and a report as JSON or as text at their end.

use anyhow::Result;
use clap::{Args as ClapArgs, ValueEnum};
use esker_engine::io::progress::{Progress, Style};
use esker_engine::io::visible::{visible, visible_json};
use serde::Serialize;
use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

#[derive(ClapArgs)]
pub struct Output {
    /// Print one JSON object, as the last line of standard output.
    #[arg(long)]
    pub json: bool,
    /// How progress is shown on standard error.
    #[arg(long, value_enum, default_value_t)]
    pub progress: ProgressArg,
}

impl Output {
    /// Does some work while progress is shown, which is cleared at its end; `stop` cancels it.
    pub fn watch<R>(&self, stop: Arc<AtomicBool>, work: impl FnOnce(&Progress) -> R) -> R {
        work(&Progress::new(self.progress.into(), stop))
    }

    /// Prints a report to standard output, as JSON or as text.
    pub fn print<R: Serialize>(&self, report: &R, text: impl FnOnce() -> String) -> Result<()> {
        print(self.json, report, text)
    }

    /// Does some work while progress is shown, and prints its report.
    pub fn report<R: Serialize>(
        &self,
        stop: Arc<AtomicBool>,
        work: impl FnOnce(&Progress) -> Result<R>,
        text: impl FnOnce(&R) -> String,
    ) -> Result<()> {
        let report = self.watch(stop, work)?;
        self.print(&report, || text(&report))
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum ProgressArg {
    /// A bar, if standard error is a terminal.
    #[default]
    Bar,
    /// Lines of JSON.
    Json,
    /// Only notes.
    None,
}

impl From<ProgressArg> for Style {
    fn from(arg: ProgressArg) -> Self {
        match arg {
            ProgressArg::Bar => Self::Bar,
            ProgressArg::Json => Self::Json,
            ProgressArg::None => Self::None,
        }
    }
}

/// Prints a report to standard output, as JSON with sorted keys or as text.
pub fn print<R: Serialize>(as_json: bool, report: &R, text: impl FnOnce() -> String) -> Result<()> {
    let json = |report| Ok::<_, anyhow::Error>(serde_json::to_value(report)?.to_string());
    write(&if as_json { visible_json(&json(report)?) } else { visible(&text()) })
}

/// Writes a line to standard output. A closed pipe is no error: the reader has seen enough.
pub fn write(text: &str) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}
