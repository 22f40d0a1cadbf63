//! The files of the window: opening others, and saving what is shown as a scene document.

use super::{App, Stage};
use crate::counters::Counters;
use crate::document::{Saved, SceneFile};
use crate::job::Job;
use crate::prompt::{Chosen, Prompt, Purpose};
use crate::scripted_run::ScriptedRun;
use crate::source::Opened;
use crate::theme::TITLE;
use crate::viewer::Viewer;
use crate::{fault, source};
use eframe::egui::{Context, ViewportCommand};
use std::path::{Path, PathBuf};

/// The scene document of the window, and what is done with it.
#[derive(Default)]
pub struct Files {
    /// What is open.
    pub scene: Option<SceneFile>,
    /// A document that is being written.
    saving: Option<Job<Saved>>,
    /// The field for a path.
    prompt: Option<Prompt>,
}

impl Files {
    /// Whether a file is being written.
    pub fn is_busy(&self) -> bool {
        self.saving.is_some()
    }

    /// Closes the field for a path. Returns whether it was open.
    pub fn close_prompt(&mut self) -> bool {
        self.prompt.take().is_some()
    }
}

impl App {
    /// Opens other files in place of those that are open. Options of pictures on the command line
    /// belong to the first ones.
    pub(super) fn open_files(&mut self, inputs: Vec<PathBuf>) {
        if inputs != self.args.inputs {
            self.panel.clear_filter(&mut self.wanted);
            self.wanted.colour_by = None;
            self.wanted.hidden_clouds.clear();
            self.args = self.args.for_inputs(inputs);
        }
        self.panel.close_file();
        // What is open ends before another session takes its memory.
        (self.stage, self.building) = (Stage::Failed(String::new()), None);
        (self.files.scene, self.files.prompt) = (None, None);
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
                let before = std::mem::replace(&mut self.stage, Stage::Failed(String::new()));
                if let Stage::Opening(opening) = before {
                    self.building = Some(opening);
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
    pub(super) fn save_scene_as(&mut self) {
        if let Some(scene) = &self.files.scene {
            self.files.prompt = Some(Prompt::new(Purpose::SaveScene, &scene.place()));
        }
    }

    fn save_to(&mut self, path: &Path, may_replace: bool) {
        let (Stage::Viewing(viewer), Some(scene)) = (&self.stage, &self.files.scene) else {
            return;
        };
        if self.files.is_busy() {
            return;
        }
        let (scene, path, settings) = (scene.clone(), path.to_owned(), self.wanted.clone());
        let (camera, size) = (viewer.camera_request(), viewer.full_size());
        let save = move || scene.save(&path, may_replace, (&settings, camera, size));
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
            if let Some(Chosen { purpose, path, may_replace }) = chosen {
                match purpose {
                    Purpose::SaveScene => self.save_to(&path, may_replace),
                }
            }
        }
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
