//! What the window does with files beside drawing them: the scene document, what is being written,
//! the choice of a path, and the steps of undo and redo.

use crate::dialog::{Answer, Dialog};
use crate::document::{Saved, SceneFile};
use crate::history::History;
use crate::job::Job;
use crate::keep::Keeping;
use crate::prompt::{Prompt, Purpose};
use eframe::egui::Context;
use std::path::{Path, PathBuf};

/// The scene document of the window, and what is done with it.
pub struct Files {
    /// What is open.
    pub scene: Option<SceneFile>,
    /// A document that is being written.
    pub saving: Option<Job<Saved>>,
    /// The copy of the built file that is being made.
    pub keeping: Option<Keeping>,
    /// The field for a path.
    pub prompt: Option<Prompt>,
    /// The dialog of the system.
    pub dialog: Option<Dialog>,
    /// Whether dialogs of the system are used; a script has none.
    pub has_dialogs: bool,
    /// The steps of undo and redo.
    pub history: History,
}

impl Files {
    /// No files.
    pub fn new(has_dialogs: bool) -> Self {
        Self {
            scene: None,
            saving: None,
            keeping: None,
            prompt: None,
            dialog: None,
            has_dialogs,
            history: History::default(),
        }
    }

    /// Whether a file is being written.
    pub fn is_busy(&self) -> bool {
        self.saving.is_some() || self.keeping.is_some()
    }

    /// Asks for a path by a dialog of the system, or by a field.
    pub fn ask(&mut self, ctx: &Context, purpose: Purpose, start: &Path) {
        if self.dialog.is_some() {
            return;
        }
        self.dialog = match self.has_dialogs {
            true => Dialog::open(ctx, purpose, start).ok(),
            false => None,
        };
        if self.dialog.is_none() {
            self.prompt = Some(Prompt::new(purpose, start));
        }
    }

    /// Asks for an address by a field.
    pub fn ask_address(&mut self) {
        self.prompt = Some(Prompt::new(Purpose::Open, Path::new("https://")));
    }

    /// Files that were chosen in the dialog of the system.
    pub fn take_answer(&mut self) -> Option<(Purpose, Vec<PathBuf>)> {
        let dialog = self.dialog.as_ref()?;
        let answer = dialog.poll();
        if answer == Answer::Open {
            return None;
        }
        let Dialog { purpose, start, .. } = self.dialog.take()?;
        match answer {
            Answer::Chosen(paths) => Some((purpose, paths)),
            Answer::Absent => {
                self.has_dialogs = false;
                self.prompt = Some(Prompt::new(purpose, &start));
                None
            }
            Answer::Closed | Answer::Open => None,
        }
    }

    /// Closes the field for a path. Returns whether it was open.
    pub fn close_prompt(&mut self) -> bool {
        self.prompt.take().is_some()
    }
}
