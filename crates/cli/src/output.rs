//! How every command tells what it does, and what came of it.

use anyhow::Result;
use clap::{Args as ClapArgs, ValueEnum};
use esker_engine::Value;
use esker_engine::io::progress::{Progress, Style};
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
    /// Does some work under a bar, which is gone before anything else is told; `stop` ends it.
    pub fn watch<R>(&self, stop: Arc<AtomicBool>, work: impl FnOnce(&Progress) -> R) -> R {
        work(&Progress::new(self.progress.into(), stop))
    }

    /// A report for machines or for people, to standard output.
    pub fn print(&self, report: &Value, text: impl FnOnce() -> String) -> Result<()> {
        print(self.json, report, text)
    }

    /// Measures, and prints the report.
    pub fn report(
        &self,
        stop: Arc<AtomicBool>,
        measure: impl FnOnce(&Progress) -> Result<Value>,
        text: impl FnOnce(&Value) -> String,
    ) -> Result<()> {
        let report = self.watch(stop, measure)?;
        self.print(&report, || text(&report))
    }
}

#[derive(Clone, Copy, Default, ValueEnum)]
pub enum ProgressArg {
    /// A bar, on a terminal.
    #[default]
    Bar,
    /// Lines of JSON.
    Json,
    /// Nothing but notes.
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

/// A report for machines or for people, to standard output.
pub fn print(as_json: bool, report: &Value, text: impl FnOnce() -> String) -> Result<()> {
    write(&if as_json { report.to_string() } else { visible(&text()) })
}

/// A text for a terminal: what files call their attributes, or are called, must not steer it.
pub fn visible(text: &str) -> String {
    let is_safe = |c: char| !c.is_control() || c == '\n' || c == '\t';
    let escape = |c: char| if is_safe(c) { c.to_string() } else { c.escape_default().to_string() };
    text.chars().map(escape).collect()
}

/// To standard output; a reader that went away is no reason to fail loudly.
pub fn write(text: &str) -> Result<()> {
    match writeln!(std::io::stdout().lock(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}
