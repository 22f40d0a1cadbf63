//! The files of the window: opening others, saving what is shown as a scene document, keeping what
//! was built; and the steps of undo and redo.

use super::{App, Stage};
use crate::counters::Counters;
use crate::document::{Present, Saved, SceneFile};
use crate::files::Files;
use crate::history::{History, Made};
use crate::job::Job;
use crate::keep::Keeping;
use crate::prompt::{Chosen, Prompt, Purpose};
use crate::scripted_run::ScriptedRun;
use crate::source::Opened;
use crate::theme::TITLE;
use crate::viewer::Viewer;
use crate::{fault, progress, source};
use eframe::egui::{Context, Rect, Ui, ViewportCommand};
use esker_engine::Filter;
use std::path::{Path, PathBuf};

impl App {
    /// Opens other files in place of those that are open. Options of pictures on the command line
    /// belong to the first ones.
    pub(super) fn open_files(&mut self, inputs: Vec<PathBuf>) {
        if inputs != self.args.inputs {
            self.wanted.filter = Filter::default();
            self.wanted.colour_by = None;
            self.wanted.hidden_clouds.clear();
            self.args = self.args.for_inputs(inputs);
        }
        self.panel.close_file();
        // What is open ends before another session takes its memory.
        (self.stage, self.building) = (Stage::Failed(String::new()), None);
        // A copy of what was built ends with it.
        self.files = Files::new(self.files.has_dialogs);
        self.counters = Counters::default();
        self.last_s = None;
        self.stage = match Stage::of(&self.args, &self.build, self.kept.clone()) {
            Ok(stage) => stage,
            Err(error) => Stage::failed(&error),
        };
    }

    /// Shows what has become of an input that is being opened.
    pub(super) fn take(&mut self, ctx: &Context, event: source::Event) {
        match event {
            source::Event::Preview(opened) => {
                match std::mem::replace(&mut self.stage, Stage::Failed(String::new())) {
                    Stage::Opening(opening) => self.building = Some(opening),
                    // A preview of more points replaces the first one.
                    before => self.stage = before,
                }
                self.view(ctx, opened);
            }
            source::Event::End(ended) => {
                self.building = None;
                match (ended, &mut self.stage) {
                    (Ok(opened), _) => self.view(ctx, opened),
                    // The preview stays.
                    (Err(error), Stage::Viewing(viewer)) => {
                        viewer.stay_preview(&fault::in_words(&format!("{error:#}")));
                    }
                    (Err(error), stage) => *stage = Stage::failed(&error),
                }
            }
        }
    }

    /// Shows a file: the first one, or the whole of what a preview shows.
    fn view(&mut self, ctx: &Context, opened: Opened) {
        let is_coarser = self.run.as_ref().is_none_or(ScriptedRun::is_coarser_moving);
        let before = std::mem::replace(&mut self.stage, Stage::Failed(String::new()));
        let scene = opened.scene.clone();
        let mut args = self.args.clone();
        (args.camera, args.up) = (scene.camera(&self.args), None);
        let mut viewer = Viewer::new(opened, &args, &self.window_painter, is_coarser);
        match before {
            Stage::Viewing(preview) => viewer.replace(*preview),
            _ => {
                let title = format!("{} - {TITLE}", viewer.name());
                ctx.send_viewport_cmd(ViewportCommand::Title(title));
                self.wanted = scene.settings(&self.args, &self.wanted);
                self.panel.close_file();
                self.files.scene = Some(scene);
                self.files.history = History::default();
            }
        }
        self.wanted.vertical = viewer.vertical();
        self.stage = Stage::Viewing(Box::new(viewer));
        ctx.request_repaint();
    }

    /// Saves the scene where its document is, or beside the scan.
    pub(super) fn save_scene(&mut self) {
        if let Some(scene) = &self.files.scene {
            let place = scene.place();
            self.save_to(&place, false);
        }
    }

    /// Asks where to save the scene.
    pub(super) fn save_scene_as(&mut self, ctx: &Context) {
        if let Some(place) = self.files.scene.as_ref().map(SceneFile::place) {
            self.files.ask(ctx, Purpose::SaveScene, &place);
        }
    }

    /// Asks for other files to open.
    pub(super) fn ask_for_files(&mut self, ctx: &Context) {
        let first = self.args.inputs.first().cloned().unwrap_or_default();
        self.files.ask(ctx, Purpose::Open, &first);
    }

    /// Asks where to keep the file that was built from scans.
    pub(super) fn ask_where_to_keep(&mut self, ctx: &Context) {
        let Stage::Viewing(viewer) = &self.stage else { return };
        let Some(scene) = self.files.scene.as_ref().filter(|_| viewer.built_file().is_some())
        else {
            let why = "nothing to keep: only files that the window has built from scans, once they \
                       are complete, are copied";
            return self.shots.say(Err(why.into()));
        };
        let place = scene.place().with_extension("").with_extension("esker");
        self.files.ask(ctx, Purpose::Keep, &place);
    }

    fn keep_as(&mut self, path: PathBuf) {
        let Stage::Viewing(viewer) = &self.stage else { return };
        if let Some(built) = viewer.built_file().filter(|_| self.files.keeping.is_none()) {
            match Keeping::start(built, path) {
                Ok(keeping) => self.files.keeping = Some(keeping),
                Err(error) => self.shots.add_failure(format!("{error:#}")),
            }
        }
    }

    /// Writes the file that a path was chosen for.
    fn take_path(&mut self, purpose: Purpose, path: PathBuf, may_replace: bool) {
        match purpose {
            Purpose::SaveScene => self.save_to(&path, may_replace),
            Purpose::Keep => self.keep_as(path),
            Purpose::Open => {}
        }
    }

    /// Takes the copy of the built file, once it is made.
    fn take_kept(&mut self, ctx: &Context) {
        let Some(kept) = self.files.keeping.as_mut().and_then(Keeping::poll) else { return };
        self.files.keeping = None;
        ctx.request_repaint();
        match kept {
            Ok(path) => self.shots.say(Ok(format!("kept as {}", path.display()))),
            Err(error) => self.shots.add_failure(fault::in_words(&format!("{error:#}"))),
        }
    }

    /// Shows over the picture how much of the built file is copied.
    pub(super) fn show_keeping(&self, ui: &Ui, rect: Rect) {
        if let Some(keeping) = &self.files.keeping
            && progress::keeping(ui, rect, keeping.share())
        {
            keeping.cancel();
        }
    }

    /// What is undone and redone.
    fn made(&self) -> Option<Made> {
        let Stage::Viewing(viewer) = &self.stage else { return None };
        Some(Made { settings: self.wanted.clone(), measure: viewer.measure().clone() })
    }

    /// Takes note of what the user has changed; a drag is one change.
    pub(super) fn watch_changes(&mut self, ctx: &Context, now_s: f64) {
        if ctx.egui_is_using_pointer() {
            return;
        }
        if let Some(made) = self.made()
            && let Some(left) = self.files.history.watch(now_s, &made)
        {
            ctx.request_repaint_after(left);
        }
    }

    /// Takes back the last change, or makes it again.
    pub(super) fn step(&mut self, is_back: bool) {
        let Some(present) = self.made() else { return };
        let history = &mut self.files.history;
        let made = if is_back { history.undo(&present) } else { history.redo(&present) };
        let (Some(Made { settings, measure }), Stage::Viewing(viewer)) = (made, &mut self.stage)
        else {
            return;
        };
        self.wanted = settings;
        viewer.set_measure(measure);
    }

    fn save_to(&mut self, path: &Path, may_replace: bool) {
        let (Stage::Viewing(viewer), Some(scene)) = (&self.stage, &self.files.scene) else {
            return;
        };
        if self.files.is_busy() {
            return;
        }
        let (scene, path) = (scene.clone(), path.to_owned());
        let present = Present {
            settings: self.wanted.clone(),
            camera: viewer.camera_request(),
            size: viewer.full_size(),
            measurements: viewer.measure().measurements(),
        };
        let save = move || scene.save(&path, may_replace, &present);
        match Job::start("esker-save", save) {
            Ok(job) => self.files.saving = Some(job),
            Err(error) => self.shots.add_failure(format!("{error:#}")),
        }
    }

    /// Shows the field for a path, and takes what was written.
    pub(super) fn show_files(&mut self, ctx: &Context) {
        if let Some(prompt) = &mut self.files.prompt {
            let (stays, chosen) = prompt.show(ctx);
            if !stays {
                self.files.prompt = None;
                ctx.request_repaint();
            }
            match chosen {
                Some(Chosen { purpose: Purpose::Open, path, .. }) => self.open_files(vec![path]),
                Some(Chosen { purpose, path, may_replace }) => {
                    self.take_path(purpose, path, may_replace);
                }
                None => {}
            }
        }
        // Dialogs of the system ask themselves before a file is replaced.
        match self.files.take_answer() {
            Some((Purpose::Open, paths)) => self.open_files(paths),
            Some((purpose, paths)) => {
                paths.into_iter().take(1).for_each(|path| self.take_path(purpose, path, true));
            }
            None => {}
        }
        self.take_kept(ctx);
        let Some(saved) = self.files.saving.as_mut().and_then(Job::poll) else {
            if self.files.is_busy() {
                ctx.request_repaint_after(super::POLL_INTERVAL);
            }
            return;
        };
        self.files.saving = None;
        ctx.request_repaint();
        match saved {
            Ok(Saved::Written(scene)) => {
                let path = scene.path().unwrap_or(Path::new("")).display().to_string();
                self.shots.say(Ok(format!("scene: {path}")));
                self.files.scene = Some(*scene);
            }
            Ok(Saved::Exists(path)) => {
                self.files.prompt = Some(Prompt::exists(Purpose::SaveScene, path));
            }
            Err(error) => self.shots.add_failure(fault::in_words(&format!("{error:#}"))),
        }
    }
}
