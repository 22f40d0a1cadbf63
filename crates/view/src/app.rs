//! The window's state and what happens in a pass of it: input moves the camera, the scene is drawn
//! for it, the picture is shown, the panel beside it. Knows egui, but not who shows the window.

use crate::args::Args;
use crate::counters::Counters;
use crate::device::ShownBy;
use crate::input_events::Sight;
use crate::looking::{Looking, pixels};
use crate::panel::{self, Asked, Facts};
use crate::pilot::Order;
use crate::rig::Rig;
use crate::script::Script;
use crate::settings::{self, Settings};
use crate::shots::Shots;
use crate::source::Opening;
use crate::times::{FrameTime, Times};
use crate::{keys, progress, theme};
use anyhow::Result;
use eframe::egui::{
    CentralPanel, Context, CursorIcon, Frame, Key, Margin, Panel, RawInput, Rect, Sense, Ui,
    ViewportCommand,
};
use esker_engine::{BuildOptions, Method, memory};
use serde_json::json;
use std::time::{Duration, Instant};

/// Seconds of the plot.
const PLOT_S: f64 = 5.0;
/// Between two looks at what is opened.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Between two looks at the process's memory, seconds.
const MEMORY_EVERY_S: f64 = 0.5;
/// Width of the panel, points.
const PANEL_WIDTH: f32 = 280.0;

/// The window.
pub struct App {
    args: Args,
    start: Instant,
    stage: Stage,
    wanted: Settings,
    has_panel: bool,
    shown_by: ShownBy,
    times: Times,
    counters: Counters,
    shots: Shots,
    /// When the process's memory was looked at, and how much of it is its own.
    anon_bytes: (f64, u64),
    /// When the last frame was shown, if another one was to follow at once.
    last_s: Option<f64>,
    marks: Marks,
    /// What is done in place of a hand.
    rig: Option<Rig>,
}

/// What the window is at.
enum Stage {
    Opening(Opening),
    Looking(Box<Looking>),
    Failed(String),
}

/// When things happened first, milliseconds since the program started.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Marks {
    /// The first pass of the window.
    window_ms: Option<f64>,
    /// The first picture with points was handed over.
    picture_ms: Option<f64>,
    /// The pass after that: the picture is on the screen.
    first_frame_ms: Option<f64>,
}

impl App {
    /// A window for these arguments; the file is opened while the window comes up.
    ///
    /// # Errors
    /// Where the script cannot be read.
    pub fn new(args: Args, start: Instant) -> Result<Self> {
        let wanted = Settings {
            method: args.method,
            colour_by: args.colour.clone(),
            filter: args.filter(),
            shines: !args.no_highlights,
            evens_exposure: args.even_exposure,
            full: args.full,
            points_budget: args.budget_points.unwrap_or(Settings::default().points_budget),
            target_spacing_px: args.target_spacing,
            budget_gpu_bytes: args.budget_gpu,
            budget_ram_bytes: args.budget_ram,
            occlusion: !args.no_occlusion,
        };
        let build = BuildOptions::default();
        let build = BuildOptions {
            memory_bytes: args.memory.unwrap_or(build.memory_bytes),
            scratch: args.scratch.clone(),
            ..build
        };
        let script = args.script.as_deref().map(Script::read).transpose()?;
        let stage = Stage::Opening(Opening::start(args.inputs.clone(), build)?);
        Ok(Self {
            has_panel: !args.no_panel,
            args,
            start,
            stage,
            wanted,
            shown_by: ShownBy::default(),
            times: Times::new(PLOT_S),
            counters: Counters::default(),
            shots: Shots::default(),
            anon_bytes: (f64::NEG_INFINITY, 0),
            last_s: None,
            marks: Marks::default(),
            rig: script.map(Rig::new),
        })
    }

    /// Told who shows the window.
    pub fn show_by(&mut self, ctx: &Context, shown_by: ShownBy) {
        theme::apply(ctx);
        self.shown_by = shown_by;
    }

    /// Changes the input of the next pass: a script flies, and the panel's key is no other's.
    pub fn input(&mut self, ctx: &Context, raw: &mut RawInput) {
        self.fly(ctx, raw);
        self.has_panel ^= keys::take(ctx, raw);
    }

    fn fly(&mut self, ctx: &Context, raw: &mut RawInput) {
        let now_s = self.now_s();
        let Some(rig) = &mut self.rig else { return };
        let looking = match &mut self.stage {
            Stage::Looking(looking) if looking.fault().is_none() => looking,
            Stage::Opening(_) if !rig.closes_at_once() => return,
            // There is nothing to fly through.
            _ => return ctx.send_viewport_cmd(ViewportCommand::Close),
        };
        let Some(place) = looking.place() else { return };
        if let Err(error) = rig.board(looking.file(), pixels(place, 1.0, 1.0)) {
            self.stage = Stage::Failed(format!("{error:#}"));
            return;
        }
        let sight = Sight {
            now_s,
            place,
            camera: looking.camera(),
            settled: self.counters.settled && !looking.goes_on(now_s),
            is_busy: self.shots.is_busy(),
            read_bytes: self.counters.status.read_bytes,
        };
        let orders = rig.fly(raw, &sight);
        for order in orders {
            match order {
                Order::Picture(path) => self.shots.ask(Some(&path), ""),
                Order::Window(path) => self.shots.ask_window(ctx, path),
                Order::Stand(pose) => looking.stand(pose),
                Order::Close => ctx.send_viewport_cmd(ViewportCommand::Close),
                Order::Begin | Order::End => {}
            }
        }
    }

    /// One pass.
    pub fn pass(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let now_s = self.now_s();
        self.mark(now_s);
        self.poll(&ctx);
        let mut asked = self.shortcuts(&ctx);
        if self.has_panel && matches!(self.stage, Stage::Looking(_)) {
            let frame = Frame::NONE.fill(theme::PANEL).inner_margin(Margin::symmetric(12, 10));
            let side = Panel::right("panel").frame(frame).resizable(false).exact_size(PANEL_WIDTH);
            side.show(ui, |ui| self.panel(ui, &mut asked));
        }
        CentralPanel::no_frame().show(ui, |ui| self.centre(ui, now_s));
        self.act(&ctx, asked);
        if self.rig.is_some() {
            ctx.request_repaint();
        }
    }

    /// Ends what is still done, and writes the report of a script.
    ///
    /// # Errors
    /// Where a picture or the report cannot be written, or there was nothing to see.
    pub fn end(&mut self) -> Result<()> {
        let failed = self.shots.finish();
        let (reopened, stalls) = match &self.stage {
            Stage::Looking(looking) => looking.reopened_and_stalls(),
            _ => (0, 0),
        };
        let drawn_by = match &self.stage {
            Stage::Looking(looking) => looking.drawn_by(&self.shown_by),
            _ => String::new(),
        };
        let measured = match &self.stage {
            Stage::Looking(looking) => looking.measured(),
            _ => Vec::new(),
        };
        let (was_failed, fault) =
            match std::mem::replace(&mut self.stage, Stage::Failed(String::new())) {
                Stage::Failed(fault) => (Some(fault.clone()), Some(fault)),
                Stage::Looking(looking) => (None, looking.fault().map(str::to_owned)),
                Stage::Opening(_) => (None, None),
            };
        let Some(rig) = &mut self.rig else {
            return was_failed.map_or(Ok(()), |fault| Err(anyhow::anyhow!(fault)));
        };
        fault.iter().for_each(|fault| rig.record.fault(fault));
        self.shots.failures().iter().for_each(|fault| rig.record.fault(fault));
        rig.record.stalls = stalls;
        let with = json!({
            "file": self.args.inputs.first().map(|p| p.display().to_string()),
            "drawn_by": drawn_by,
            "window_ms": self.marks.window_ms,
            "first_frame_ms": self.marks.first_frame_ms,
            "budget_gpu_bytes": self.wanted.budget_gpu_bytes,
            "budget_ram_bytes": self.wanted.budget_ram_bytes,
            "reopened": reopened,
            "measured": measured,
            "pictures_failed": failed,
        });
        rig.report(with)?;
        anyhow::ensure!(
            failed == 0,
            "{}",
            self.shots.failures().first().map_or("a picture was not written", String::as_str)
        );
        fault.map_or(Ok(()), |fault| Err(anyhow::anyhow!(fault)))
    }

    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn mark(&mut self, now_s: f64) {
        let now_ms = now_s * 1e3;
        self.marks.window_ms.get_or_insert(now_ms);
        if self.marks.picture_ms.is_some() {
            self.marks.first_frame_ms.get_or_insert(now_ms);
        }
        if now_s - self.anon_bytes.0 > MEMORY_EVERY_S {
            self.anon_bytes = (now_s, memory::usage().anon_bytes);
        }
        self.shots.poll();
        if let Some(rig) = &mut self.rig {
            let record = &mut rig.record;
            record.anon_bytes_peak = record.anon_bytes_peak.max(self.anon_bytes.1);
            let status = &self.counters.status;
            record.drawing_bytes_peak = record.drawing_bytes_peak.max(status.drawing_bytes_peak);
            record.gpu_bytes_peak = self.counters.gpu_bytes.map(|gpu| gpu.peak_bytes);
            status.fault.iter().for_each(|fault| record.fault(fault));
        }
    }

    fn poll(&mut self, ctx: &Context) {
        let Stage::Opening(opening) = &mut self.stage else { return };
        match opening.poll() {
            None => ctx.request_repaint_after(LOOK_EVERY),
            Some(Err(error)) => self.stage = Stage::Failed(format!("{error:#}")),
            Some(Ok(opened)) => {
                let is_coarser = self.rig.as_ref().is_none_or(Rig::is_coarser_moving);
                let looking = Looking::new(opened, &self.args, &self.shown_by, is_coarser);
                self.stage = Stage::Looking(Box::new(looking));
            }
        }
    }

    fn shortcuts(&mut self, ctx: &Context) -> Asked {
        let mut asked = Asked::default();
        if ctx.text_edit_focused() {
            return asked;
        }
        let Stage::Looking(looking) = &self.stage else { return asked };
        ctx.input_mut(|i| {
            asked.freeze = i.key_pressed(Key::Space);
            asked.forget = i.key_pressed(Key::Escape);
            asked.screenshot = i.key_pressed(Key::P);
            if i.key_pressed(Key::M) {
                self.wanted.method = match self.wanted.method {
                    Method::Points => Method::PullPush,
                    Method::PullPush => Method::Ewa,
                    Method::Ewa => Method::Points,
                };
            }
            if i.key_pressed(Key::C) {
                settings::next_colour(&mut self.wanted, looking.sources());
            }
            self.wanted.occlusion ^= i.key_pressed(Key::O);
        });
        asked
    }

    fn panel(&mut self, ui: &mut Ui, asked: &mut Asked) {
        let Stage::Looking(looking) = &mut self.stage else { return };
        // What is wrong with the picture stands over it.
        let faults: Vec<String> = self.counters.status.fault.clone().into_iter().collect();
        let mut is_coarser = looking.is_coarser_moving();
        let legend = looking.legend();
        let facts = Facts {
            name: looking.name(),
            about: looking.about(),
            notes: looking.notes(),
            unit: looking.unit(),
            is_failed: looking.fault().is_some(),
            times: &self.times,
            counters: &self.counters,
            anon_bytes: self.anon_bytes.1,
            backend: &looking.drawn_by(&self.shown_by),
            sources: looking.sources(),
            legend: legend.as_ref(),
            measured: &looking.measured(),
            picture: looking.picture_size(),
            speed: looking.camera().speed() * looking.camera().distance(),
            is_frozen: looking.is_frozen(),
            faults: &faults,
            said: self.shots.said(),
        };
        let clicked = panel::show(ui, &facts, &mut self.wanted, &mut is_coarser);
        looking.set_coarser_moving(is_coarser);
        asked.add(clicked);
    }

    fn centre(&mut self, ui: &mut Ui, now_s: f64) {
        let place = ui.available_rect_before_wrap();
        ui.painter().rect_filled(place, 0.0, theme::GROUND);
        match &mut self.stage {
            Stage::Opening(opening) => progress::show(ui, opening, &self.args.inputs),
            Stage::Failed(fault) => progress::failed(ui, fault),
            Stage::Looking(_) => self.look(ui, place, now_s),
        }
    }

    fn look(&mut self, ui: &mut Ui, place: Rect, now_s: f64) {
        let Stage::Looking(looking) = &mut self.stage else { return };
        let response = ui.allocate_rect(place, Sense::click_and_drag());
        if looking.follow(ui, &response, now_s) {
            ui.ctx().set_cursor_icon(CursorIcon::Grabbing);
        }
        looking.fit(ui.ctx(), &self.wanted, now_s);
        let work = looking.draw(ui, now_s, &mut self.counters, &mut self.shots);
        looking.paint(ui);
        if self.counters.points > 0 {
            self.marks.picture_ms.get_or_insert(now_s * 1e3);
        }
        // What stood still in between was no frame.
        if let (Some(work_ms), Some(last_s)) = (work, self.last_s) {
            let frame = FrameTime { at_s: now_s, interval_ms: (now_s - last_s) * 1e3, work_ms };
            self.times.push(frame);
            if let Some(rig) = &mut self.rig {
                rig.frame(frame, self.counters.points);
            }
        }
        let goes_on = looking.goes_on(now_s) || self.shots.wants();
        self.last_s = goes_on.then_some(now_s);
        // The panel is a pass behind the picture.
        if goes_on || work.is_some() {
            ui.ctx().request_repaint();
        } else if self.shots.is_busy() {
            ui.ctx().request_repaint_after(LOOK_EVERY);
        }
    }

    fn act(&mut self, ctx: &Context, asked: Asked) {
        self.has_panel &= !asked.hide;
        let Stage::Looking(looking) = &mut self.stage else { return };
        if asked.home {
            looking.go_home();
        }
        if asked.freeze {
            looking.toggle_frozen();
        }
        if asked.forget {
            looking.forget();
        }
        if asked.screenshot {
            self.shots.ask(None, looking.name());
        }
        if asked != Asked::default() {
            ctx.request_repaint();
        }
    }
}
