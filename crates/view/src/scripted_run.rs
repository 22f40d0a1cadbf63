//! A scripted run: the script, the pilot that plays it, and the record of its frames. The report is
//! written when the window closes.

use crate::input_events::WindowState;
use crate::pilot::{Order, Pilot};
use crate::report::{Flight, Record};
use crate::script::{Script, Step};
use crate::times::FrameTime;
use anyhow::{Context, Result};
use eframe::egui::RawInput;
use esker_engine::Forest;
use esker_engine::cameras::path::Path;
use esker_engine::machine::system;
use serde_json::Value;
use std::io::Write;

/// A window that a script controls.
pub struct ScriptedRun {
    script: Script,
    pilot: Option<Pilot>,
    /// Measurements of the run.
    pub record: Record,
    is_over: bool,
}

impl ScriptedRun {
    /// Makes a run of `script`.
    pub fn new(script: Script) -> Self {
        Self { script, pilot: None, record: Record::default(), is_over: false }
    }

    /// Whether pictures may be coarser while the camera moves.
    pub fn is_coarser_moving(&self) -> bool {
        self.script.coarser_moving
    }

    /// Whether the steps begin with the preview of a scan.
    pub fn begins_with_preview(&self) -> bool {
        self.script.preview
    }

    /// Whether the script clicks widgets by their names.
    pub fn clicks_widgets(&self) -> bool {
        let script = &self.script;
        let mut steps = script.before.iter().chain(&script.flight).chain(&script.after);
        steps.any(|step| matches!(step, Step::Widget { .. }))
    }

    /// Whether the script begins with closing the window.
    pub fn closes_at_once(&self) -> bool {
        let script = &self.script;
        let mut steps = script.before.iter().chain(&script.flight).chain(&script.after);
        steps.next() == Some(&Step::Close)
    }

    /// Prepares the flight through a file, once: reads the camera paths of the script for pictures
    /// of `size` pixels, and for a cold run removes the file from the system's cache.
    ///
    /// # Errors
    /// If a camera path cannot be read, or the file cannot be removed from the cache.
    pub fn prepare(&mut self, file: &Forest, size: [u32; 2]) -> Result<()> {
        if self.pilot.is_some() {
            return Ok(());
        }
        if self.script.cold {
            let path = file.path();
            let opened = std::fs::File::open(path);
            opened.and_then(|f| system::forget(&f)).with_context(|| {
                format!("{}: cannot be removed from the system's cache", path.display())
            })?;
        }
        let mut paths = Vec::new();
        let script = &self.script;
        for step in script.before.iter().chain(&script.flight).chain(&script.after) {
            if let Step::Path { file: name, .. } = step {
                let path = match name {
                    Some(name) => Path::read(name, file, size)?,
                    None => Path::of(file, size),
                };
                paths.push((name.clone(), path));
            }
        }
        self.pilot = Some(Pilot::new(self.script.clone(), paths));
        Ok(())
    }

    /// Replaces the input of the next frame. Returns what else is to be done.
    pub fn fly(&mut self, raw: &mut RawInput, window: &WindowState<'_>) -> Vec<Order> {
        let Some(pilot) = &mut self.pilot else { return Vec::new() };
        let orders = pilot.fly(raw, window);
        for order in &orders {
            let (now, read) = (window.now_s, window.read_bytes);
            match order {
                Order::Begin => {
                    let flight =
                        Flight { span_s: [now; 2], read_bytes: [read; 2], ..Flight::default() };
                    self.record.flights.push(flight);
                    self.record.is_flying = true;
                }
                Order::End => {
                    if let Some(flight) = self.record.flight() {
                        (flight.span_s[1], flight.read_bytes[1]) = (now, read);
                    }
                    self.record.is_flying = false;
                }
                _ => {}
            }
        }
        orders
    }

    /// Records a frame in which `points` were drawn.
    pub fn frame(&mut self, frame: FrameTime, points: u64) {
        if let Some(flight) = self.record.flight() {
            flight.frames.push(frame);
            flight.points += points;
            flight.empty += u64::from(points == 0);
        }
    }

    /// Writes the report, extended by the entries of `extra`; does nothing when called again.
    ///
    /// # Errors
    /// If the report cannot be written.
    pub fn report(&mut self, extra: Value) -> Result<()> {
        if std::mem::replace(&mut self.is_over, true) {
            return Ok(());
        }
        let mut report = self.record.json();
        if let (Some(report), Value::Object(extra)) = (report.as_object_mut(), extra) {
            report.extend(extra);
        }
        match &self.script.report {
            Some(path) => std::fs::write(path, format!("{report}\n"))
                .with_context(|| format!("{}: cannot write the report", path.display())),
            None => writeln!(std::io::stdout().lock(), "{report}")
                .context("cannot write the report to standard output"),
        }
    }
}
