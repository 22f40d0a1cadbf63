//! The state of the window, and what a pass of egui does: input moves the camera, the session draws
//! the scene, the picture is shown with the panel beside it. Depends on egui, but not on what
//! paints the window.

use crate::args::Args;
use crate::commands::{self, Command};
use crate::counters::Counters;
use crate::device::WindowPainter;
use crate::document::SceneFile;
use crate::files::Files;
use crate::input_events::WindowState;
use crate::keys::Keys;
use crate::overlay::Overlay;
use crate::panel::data::PanelData;
use crate::panel::{self, PanelState};
use crate::pilot::Order;
use crate::progress::Next;
use crate::script::Script;
use crate::scripted_run::ScriptedRun;
use crate::settings::{self, Settings};
use crate::shots::Shots;
use crate::source::Opening;
use crate::times::{FrameTime, Times};
use crate::viewer::{Viewer, pixels};
use crate::{document, fault, fit, fonts, progress, theme, widgets};
use anyhow::Result;
use eframe::egui::text_selection::LabelSelectionState;
use eframe::egui::{
    CentralPanel, Context, Event, Frame, Margin, Panel, RawInput, Rect, Sense, Ui, ViewportCommand,
};
use esker_engine::draw::scene::PictureRequest;
use esker_engine::io::kept::Kept;
use esker_engine::light::IS_BUILT;
use esker_engine::{BuildOptions, Filter, Method, memory};
use serde_json::json;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::{Duration, Instant};

mod files;

/// Seconds that the plot of frame times covers.
const PLOT_S: f64 = 5.0;
/// Time between two polls of the thread that opens the file.
const POLL_INTERVAL: Duration = Duration::from_millis(10);
/// Time between two readings of the process's memory, seconds.
const MEMORY_INTERVAL_S: f64 = 0.5;
/// Width of the panel, points.
const PANEL_WIDTH: f32 = 256.0;
const PANEL_WIDTHS: RangeInclusive<f32> = 220.0..=520.0;
/// Scans that were opened before, on the start page.
const RECENT: usize = 8;
/// Width of windows that have the panel from the start, points.
const WIDTH_WITH_PANEL: f32 = 900.0;

/// The application that runs in the window.
pub struct App {
    args: Args,
    /// How scans are built, and where the files are kept.
    build: BuildOptions,
    kept: Option<Kept>,
    start: Instant,
    stage: Stage,
    /// The build of the whole file, while a preview is shown.
    building: Option<Opening>,
    wanted: Settings,
    /// Whether the user wants the panel; without a choice, windows that are wide enough have it.
    has_panel: Option<bool>,
    is_panel_shown: bool,
    panel: PanelState,
    /// Whether the monitor is known.
    is_fitted: bool,
    keys: Keys,
    overlay: Overlay,
    window_painter: WindowPainter,
    times: Times,
    counters: Counters,
    shots: Shots,
    /// Time of the last reading of the process's memory, seconds, and the anonymous bytes that it
    /// found.
    anon_bytes: (f64, u64),
    /// Time of the last frame, seconds, if another one follows it without a pause.
    last_s: Option<f64>,
    /// When the picture became final, seconds.
    rest_s: Option<f64>,
    milestones: Milestones,
    /// Whether in this pass the pointer has moved and nothing else, and no picture was drawn.
    has_only_pointed: bool,
    /// The run that a script controls, if there is one.
    run: Option<ScriptedRun>,
    files: Files,
}

/// What the window shows.
enum Stage {
    /// Nothing is open; what was opened before.
    Start(Vec<Vec<PathBuf>>),
    Opening(Opening),
    Viewing(Box<Viewer>),
    Failed(String),
}

impl Stage {
    /// The words for an error.
    fn failed(error: &anyhow::Error) -> Self {
        Self::Failed(fault::in_words(&format!("{error:#}")))
    }

    /// Opens the inputs; without any, lists what was opened before.
    fn of(args: &Args, build: &BuildOptions, kept: Option<Kept>) -> Result<Self> {
        if args.inputs.is_empty() {
            return Ok(Self::Start(kept.map_or_else(Vec::new, |kept| kept.recent(RECENT))));
        }
        Ok(Self::Opening(Opening::start(args.inputs.clone(), build.clone(), kept)?))
    }
}

/// Times of the first events, milliseconds since the program started.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Milestones {
    /// First pass of the window.
    window_ms: Option<f64>,
    /// First picture with points, as it is handed to egui.
    picture_ms: Option<f64>,
    /// The pass that follows it: the picture is then on the screen.
    first_frame_ms: Option<f64>,
}

impl App {
    /// Makes the application and starts the thread that opens the file, so that it is opened while
    /// the window appears.
    ///
    /// # Errors
    /// If the script cannot be read, or the thread cannot be started.
    pub fn new(args: Args, start: Instant) -> Result<Self> {
        args.camera.with_up(args.up)?;
        let budgets = Settings {
            budget_gpu_bytes: args.budget_gpu,
            budget_ram_bytes: args.budget_ram,
            occlusion: !args.no_occlusion,
            ..Settings::default()
        };
        let wanted = document::settings(&args, &PictureRequest::of_options(), &budgets);
        let build = BuildOptions::default();
        let build = BuildOptions {
            memory_bytes: args.memory.unwrap_or(build.memory_bytes),
            scratch: args.scratch.clone(),
            ..build
        };
        let script = args.script.as_deref().map(Script::read).transpose()?;
        anyhow::ensure!(
            script.is_none() || !args.inputs.is_empty(),
            "a script needs a file to open: give one before --script"
        );
        let (kept, is_scripted) = (Kept::of_user(args.cache), script.is_some());
        let stage = Stage::of(&args, &build, kept.clone())?;
        Ok(Self {
            build,
            kept,
            has_panel: args.no_panel.then_some(false),
            is_panel_shown: !args.no_panel,
            panel: PanelState::default(),
            is_fitted: false,
            keys: Keys::default(),
            overlay: Overlay::default(),
            args,
            start,
            stage,
            building: None,
            wanted,
            window_painter: WindowPainter::default(),
            times: Times::new(PLOT_S),
            counters: Counters::default(),
            shots: Shots::default(),
            anon_bytes: (f64::NEG_INFINITY, 0),
            last_s: None,
            rest_s: None,
            milestones: Milestones::default(),
            has_only_pointed: false,
            run: script.map(ScriptedRun::new),
            files: Files::new(!is_scripted),
        })
    }

    /// Sets what paints the window; called once, when the window is open.
    pub fn set_window_painter(&mut self, ctx: &Context, window_painter: WindowPainter) {
        theme::apply(ctx);
        fonts::apply(ctx);
        if self.run.as_ref().is_some_and(ScriptedRun::clicks_widgets) {
            widgets::collect(ctx);
        }
        self.window_painter = window_painter;
    }

    /// Changes the input of the next pass: a script replaces it, and each key goes to the window or
    /// to the focused widget.
    pub fn input(&mut self, ctx: &Context, raw: &mut RawInput) {
        self.fly(ctx, raw);
        self.keys.take(ctx, raw);
    }

    fn fly(&mut self, ctx: &Context, raw: &mut RawInput) {
        let now_s = self.now_s();
        // A script flies through the whole file, unless it asks for the preview.
        let is_whole = self.building.is_none();
        let run = self.run.as_mut().filter(|run| is_whole || run.begins_with_preview());
        let Some(run) = run else { return };
        let viewer = match &mut self.stage {
            Stage::Viewing(viewer) if viewer.fault().is_none() => viewer,
            Stage::Opening(_) if !run.closes_at_once() => return,
            // There is no scene to fly through.
            _ => return ctx.send_viewport_cmd(ViewportCommand::Close),
        };
        let Some(picture_rect) = viewer.picture_rect() else { return };
        if let Err(error) = run.prepare(viewer.file(), pixels(picture_rect, 1.0, 1.0)) {
            self.stage = Stage::failed(&error);
            return;
        }
        let widgets = widgets::of(ctx);
        let window = WindowState {
            widgets: &widgets,
            now_s,
            picture_rect,
            camera: viewer.camera(),
            settled: self.counters.settled
                && !viewer.needs_redraw(now_s)
                && viewer.has(&self.wanted),
            is_busy: self.shots.is_busy() || self.files.is_busy(),
            read_bytes: self.counters.status.read_bytes,
        };
        let orders = run.fly(raw, &window);
        let mut given = Vec::new();
        for order in orders {
            match order {
                Order::Command(command) => given.push(command),
                Order::Picture(path) => self.shots.request(Some(&path), ""),
                Order::Window(path) => self.shots.request_window(ctx, path),
                Order::SetPose(pose) => viewer.set_pose(pose),
                Order::Fault(fault) => run.record.fault(&fault),
                Order::Close => ctx.send_viewport_cmd(ViewportCommand::Close),
                Order::Begin | Order::End => {}
            }
        }
        self.perform(ctx, given);
    }

    /// Runs one pass of egui: handles input, draws the scene, shows it with the panel.
    pub fn pass(&mut self, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let now_s = self.now_s();
        self.fit_monitor(&ctx);
        self.record_milestones(now_s);
        self.poll(&ctx);
        let dropped = ctx.input(|i| i.raw.dropped_files.clone());
        let dropped: Vec<PathBuf> =
            dropped.into_iter().map(|file| file.path().to_owned()).collect();
        if !dropped.is_empty() && self.run.is_none() {
            self.open_files(dropped);
        }
        let mut given = self.shortcuts(&ctx);
        let is_wide = ctx.content_rect().width() >= WIDTH_WITH_PANEL;
        self.is_panel_shown = self.has_panel.unwrap_or(is_wide);
        if self.is_panel_shown && matches!(self.stage, Stage::Viewing(_)) {
            let frame =
                Frame::NONE.fill(theme::inks(ui).panel).inner_margin(Margin::symmetric(12, 10));
            let side = Panel::right("panel").frame(frame).default_size(PANEL_WIDTH);
            side.size_range(PANEL_WIDTHS).show(ui, |ui| self.panel(ui, &mut given));
        }
        CentralPanel::no_frame().show(ui, |ui| self.centre(ui, now_s, &mut given));
        given.extend(self.overlay.show(&ctx));
        self.show_files(&ctx);
        self.perform(&ctx, given);
        self.watch_changes(&ctx, now_s);
        if self.run.is_some() {
            ctx.request_repaint();
        }
    }

    /// Draws everything smaller if the monitor is small, once it is known.
    fn fit_monitor(&mut self, ctx: &Context) {
        if !self.is_fitted
            && let Some(monitor) = ctx.input(|i| i.viewport().monitor_size)
        {
            self.is_fitted = true;
            ctx.set_zoom_factor(fit::zoom(monitor));
        }
    }

    /// Waits for pictures that are being written, and writes the report of a script.
    ///
    /// # Errors
    /// If a picture or the report cannot be written, or if the scene could not be shown.
    pub fn end(&mut self) -> Result<()> {
        let failed = self.shots.finish();
        self.panel.close_file();
        let (reopened, stalls) = match &self.stage {
            Stage::Viewing(viewer) => viewer.reopened_and_stalls(),
            _ => (0, 0),
        };
        let drawn_by = match &self.stage {
            Stage::Viewing(viewer) => viewer.drawn_by(&self.window_painter),
            _ => String::new(),
        };
        let measured = match &self.stage {
            Stage::Viewing(viewer) => viewer.measured(),
            _ => Vec::new(),
        };
        let (was_failed, fault) =
            match std::mem::replace(&mut self.stage, Stage::Failed(String::new())) {
                Stage::Failed(fault) => (Some(fault.clone()), Some(fault)),
                Stage::Viewing(viewer) => (None, viewer.fault().map(str::to_owned)),
                Stage::Opening(_) | Stage::Start(_) => (None, None),
            };
        let Some(run) = &mut self.run else {
            return was_failed.map_or(Ok(()), |fault| Err(anyhow::anyhow!(fault)));
        };
        fault.iter().for_each(|fault| run.record.fault(fault));
        self.shots.failures().iter().for_each(|fault| run.record.fault(fault));
        run.record.stalls = stalls;
        let extra = json!({
            "file": self.args.inputs.first().map(|p| p.display().to_string()),
            "drawn_by": drawn_by,
            "window_ms": self.milestones.window_ms,
            "first_frame_ms": self.milestones.first_frame_ms,
            "budget_gpu_bytes": self.wanted.budget_gpu_bytes,
            "budget_ram_bytes": self.wanted.budget_ram_bytes,
            "reopened": reopened,
            "measured": measured,
            "pictures_failed": failed,
        });
        run.report(extra)?;
        anyhow::ensure!(
            failed == 0,
            "{}",
            self.shots.failures().first().map_or("a picture was not written", String::as_str)
        );
        fault.map_or(Ok(()), |fault| Err(anyhow::anyhow!(fault)))
    }

    /// Records that a pass took `cpu_ms` of CPU time and painted so many pixels of the window.
    pub fn painted(&mut self, cpu_ms: f64, pixels: usize) {
        if let Some(run) = &mut self.run
            && std::mem::take(&mut self.has_only_pointed)
        {
            run.record.pointed.push([cpu_ms, pixels as f64]);
        }
    }

    fn now_s(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn record_milestones(&mut self, now_s: f64) {
        let now_ms = now_s * 1e3;
        self.milestones.window_ms.get_or_insert(now_ms);
        if self.milestones.picture_ms.is_some() {
            self.milestones.first_frame_ms.get_or_insert(now_ms);
        }
        if now_s - self.anon_bytes.0 > MEMORY_INTERVAL_S {
            self.anon_bytes = (now_s, memory::usage().anon_bytes);
        }
        self.shots.poll();
        if let Some(run) = &mut self.run {
            let record = &mut run.record;
            record.anon_bytes_peak = record.anon_bytes_peak.max(self.anon_bytes.1);
            let status = &self.counters.status;
            record.drawing_bytes_peak = record.drawing_bytes_peak.max(status.drawing_bytes_peak);
            record.gpu_bytes_peak = self.counters.gpu_bytes.map(|gpu| gpu.peak_bytes);
            status.fault.iter().for_each(|fault| record.fault(fault));
        }
    }

    fn poll(&mut self, ctx: &Context) {
        let opening = match (&mut self.stage, &mut self.building) {
            (Stage::Opening(opening), _) | (_, Some(opening)) => opening,
            _ => return,
        };
        match opening.poll() {
            None => ctx.request_repaint_after(POLL_INTERVAL),
            Some(event) => self.take(ctx, event),
        }
    }

    /// Commands whose keys were pressed; none while text is edited.
    fn shortcuts(&mut self, ctx: &Context) -> Vec<Command> {
        if ctx.text_edit_focused() {
            return Vec::new();
        }
        let has_focus = ctx.memory(|memory| memory.focused().is_some());
        let mut given = ctx.input_mut(|input| commands::pressed(input, has_focus));
        // Without a picture there is nothing else to command.
        let is_viewing = matches!(self.stage, Stage::Viewing(_));
        given.retain(|command| is_viewing || *command == Command::Open);
        given
    }

    fn panel(&mut self, ui: &mut Ui, given: &mut Vec<Command>) {
        let Stage::Viewing(viewer) = &mut self.stage else { return };
        // A fault of the picture is painted over it.
        let picking = viewer.pick_fault().map(String::from);
        let faults = self.counters.status.fault.clone().into_iter().chain(picking);
        let faults: Vec<String> = faults.map(|text| fault::in_words(&text)).collect();
        let mut is_coarser = viewer.is_coarser_moving();
        let legend = viewer.legend();
        let together = self.files.scene.as_ref().map_or_else(Vec::new, SceneFile::names);
        let data = PanelData {
            file: viewer.file(),
            name: viewer.name(),
            about: viewer.about(),
            clouds: &viewer.clouds().scans,
            is_built: viewer.built_file().is_some(),
            together: &together,
            extent: viewer.clouds().extent,
            crs: viewer.clouds().crs.as_deref(),
            has_degrees: viewer.clouds().has_degrees,
            notes: viewer.notes(),
            unit: viewer.unit(),
            is_failed: viewer.fault().is_some(),
            times: &self.times,
            counters: &self.counters,
            anon_bytes: self.anon_bytes.1,
            backend: &viewer.drawn_by(&self.window_painter),
            sources: viewer.sources(),
            has_fronts: viewer.has_fronts(),
            has_flags: viewer.clouds().has_flags,
            classes: viewer.classes(),
            legend: legend.as_ref(),
            measured: &viewer.measured(),
            picked: &viewer.about_picked(),
            picture: viewer.picture_size(),
            speed: viewer.camera().pace(),
            tool: viewer.tool(),
            has_fixed_speed: viewer.camera().has_fixed_pace(),
            is_parallel: viewer.camera().is_parallel(),
            up_note: viewer.up_note(),
            is_frozen: viewer.is_frozen(),
            faults: &faults,
            message: self.shots.message(),
        };
        let clicked = panel::show(ui, &data, &mut self.panel, &mut self.wanted, &mut is_coarser);
        viewer.set_coarser_moving(is_coarser);
        given.extend(clicked);
    }

    fn centre(&mut self, ui: &mut Ui, now_s: f64, given: &mut Vec<Command>) {
        let rect = ui.available_rect_before_wrap();
        ui.painter().rect_filled(rect, 0.0, theme::inks(ui).ground);
        match &mut self.stage {
            Stage::Start(recent) => match progress::start(ui, recent) {
                Some(Next::Files(chosen)) => self.open_files(chosen),
                Some(Next::Other) => given.push(Command::Open),
                Some(Next::Address) => self.files.ask_address(),
                None => {}
            },
            Stage::Opening(opening) => progress::show(ui, opening, &self.args.inputs),
            Stage::Failed(fault) => match progress::failed(ui, fault, &self.args.inputs) {
                Some(Next::Files(again)) => self.open_files(again),
                Some(Next::Other) => given.push(Command::Open),
                Some(Next::Address) => self.files.ask_address(),
                None => {}
            },
            Stage::Viewing(_) => {
                self.show_scene(ui, rect, now_s);
                self.show_keeping(ui, rect);
                if !self.is_panel_shown {
                    panel::tab(ui, rect, given);
                }
            }
        }
    }

    fn show_scene(&mut self, ui: &mut Ui, rect: Rect, now_s: f64) {
        let Stage::Viewing(viewer) = &mut self.stage else { return };
        let response = ui.allocate_rect(rect, Sense::click_and_drag());
        viewer.handle_input(ui, &response, now_s);
        #[cfg(feature = "light")]
        if let Some(moved) = viewer.take_sun_drag() {
            panel::light::drag_sun(&mut self.wanted, moved);
        }
        // The panel was laid out with these.
        let shown_rates = self.counters.rates();
        viewer.update_session(ui.ctx(), &self.wanted, self.shots.is_requested(), now_s);
        let work = viewer.draw(ui, now_s, &mut self.counters, &mut self.shots);
        self.has_only_pointed = work.is_none()
            && viewer.is_at_rest()
            && ui.input(|i| matches!(i.events[..], [Event::PointerMoved(_)]));
        viewer.paint(ui);
        if let Some(building) = &self.building {
            progress::over(ui, rect, building);
        }
        let is_filtered = !self.wanted.filter.is_all();
        if is_filtered && self.counters.settled && self.counters.points == 0 {
            let all = progress::nothing_left(ui, rect);
            if all {
                self.wanted.filter = Filter::default();
            }
        }
        if self.counters.points > 0 {
            self.milestones.picture_ms.get_or_insert(now_s * 1e3);
        }
        // A pause between two pictures is not the time of a frame.
        if let (Some(work_ms), Some(last_s)) = (work, self.last_s) {
            let frame = FrameTime { at_s: now_s, interval_ms: (now_s - last_s) * 1e3, work_ms };
            self.times.push(frame);
            if let Some(run) = &mut self.run {
                run.frame(frame, self.counters.points);
            }
        }
        let needs_redraw = viewer.needs_redraw(now_s) || self.shots.is_requested();
        self.last_s = needs_redraw.then_some(now_s);
        // The panel was laid out before this picture was drawn, so it needs another pass.
        if needs_redraw || work.is_some() {
            self.rest_s = None;
            ui.ctx().request_repaint();
        } else if self.shots.is_busy() {
            ui.ctx().request_repaint_after(POLL_INTERVAL);
        } else {
            self.come_to_rest(ui.ctx(), now_s, shown_rates);
        }
    }

    /// Repaints at rest until the panel shows that nothing is read any more, the memory that is
    /// taken now, and no message that has had its time.
    fn come_to_rest(&mut self, ctx: &Context, now_s: f64, shown_rates: [f64; 2]) {
        let rest_s = *self.rest_s.get_or_insert(now_s);
        let rates = self.counters.rates();
        if rates != shown_rates {
            ctx.request_repaint();
        } else if rates != [0.0; 2] || self.anon_bytes.0 <= rest_s {
            ctx.request_repaint_after(Duration::from_secs_f64(MEMORY_INTERVAL_S * 1.2));
        }
        self.shots.message_left().iter().for_each(|&left| ctx.request_repaint_after(left));
    }

    fn perform(&mut self, ctx: &Context, given: Vec<Command>) {
        for command in given {
            self.perform_one(ctx, command);
            ctx.request_repaint();
        }
    }

    fn perform_one(&mut self, ctx: &Context, command: Command) {
        if command == Command::Open {
            return self.ask_for_files(ctx);
        }
        let Stage::Viewing(viewer) = &mut self.stage else { return };
        match command {
            Command::Fit => viewer.go_home(),
            Command::Look(side) => viewer.look_from(side),
            Command::Tool(name) => viewer.set_tool(name),
            Command::Parallel => viewer.toggle_parallel(),
            Command::Hud => viewer.toggle_hud(),
            Command::Picture => self.shots.request(None, viewer.name()),
            Command::Open => self.ask_for_files(ctx),
            Command::Keep => self.ask_where_to_keep(ctx),
            Command::Undo => self.step(true),
            Command::Redo => self.step(false),
            Command::SaveScene => self.save_scene(),
            Command::SaveSceneAs => self.save_scene_as(ctx),
            Command::NextMethod => {
                self.wanted.method = match self.wanted.method {
                    Method::Points => Method::Auto,
                    Method::Auto => Method::PullPush,
                    Method::PullPush => Method::Ewa,
                    Method::Ewa if IS_BUILT => Method::Lit,
                    Method::Ewa | Method::Lit => Method::Points,
                };
            }
            Command::NextColours => settings::next_colour(&mut self.wanted, viewer.sources()),
            Command::Hidden => self.wanted.occlusion = !self.wanted.occlusion,
            Command::ClearMeasurements => {
                if !self.overlay.close() && !self.files.close_prompt() {
                    viewer.clear_measurements();
                }
            }
            Command::Copy => {
                let lines = viewer.measured();
                if !lines.is_empty() && !has_selected_text(ctx) {
                    ctx.copy_text(lines.join("\n"));
                }
            }
            Command::FixSpeed => viewer.toggle_fixed_pace(),
            Command::Freeze => viewer.toggle_frozen(),
            Command::Panel => self.has_panel = Some(!self.is_panel_shown),
            Command::Keys => self.overlay.toggle_keys(),
            Command::List => self.overlay.toggle_list(),
        }
    }
}

/// Whether text of the window is selected, which the keys for copying copy.
fn has_selected_text(ctx: &Context) -> bool {
    ctx.plugin::<LabelSelectionState>().lock().has_selection()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests;
