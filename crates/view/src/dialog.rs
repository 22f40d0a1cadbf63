//! Dialogs of the system for files. A dialog runs on a thread of its own, and the window goes on.
//! Where the system has none (no portal of the desktop), it closes at once without a choice, which
//! no person does: the window then shows its own field for a path.

use crate::prompt::Purpose;
use anyhow::{Context as _, Result};
use eframe::egui::Context;
use esker_engine::io::output::folder_of;
use rfd::{AsyncFileDialog, FileHandle};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::time::{Duration, Instant};

/// A dialog that closes without a choice before this time was never shown.
const SHOWN: Duration = Duration::from_millis(700);
/// What the window opens, by the ends of names.
const SCANS: [&str; 16] = [
    "esker", "las", "laz", "e57", "ptx", "pts", "ply", "pcd", "xyz", "txt", "csv", "asc", "obj",
    "json", "gz", "zst",
];

/// An open dialog.
pub struct Dialog {
    /// What the path is for.
    pub purpose: Purpose,
    /// The path that it began with.
    pub start: PathBuf,
    answer: Receiver<(Vec<PathBuf>, Duration)>,
}

/// What has become of a dialog.
#[derive(Debug, PartialEq, Eq)]
pub enum Answer {
    /// It is open.
    Open,
    /// The user has chosen these files.
    Chosen(Vec<PathBuf>),
    /// The user has closed it.
    Closed,
    /// The system has no such dialog.
    Absent,
}

impl Dialog {
    /// Opens a dialog that begins with a path; repaints the window when it is closed. Its thread is
    /// not joined: a program cannot close a dialog of the system.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn open(ctx: &Context, purpose: Purpose, start: &Path) -> Result<Self> {
        let (sender, answer) = sync_channel(1);
        let (ctx, path) = (ctx.clone(), start.to_owned());
        let work = move || {
            let since = Instant::now();
            let chosen = pollster::block_on(choose(purpose, &path));
            // The receiver is gone if the window has closed.
            let _ = sender.send((chosen, since.elapsed()));
            ctx.request_repaint();
        };
        std::thread::Builder::new()
            .name("esker-dialog".into())
            .spawn(work)
            .context("cannot start a thread for a dialog")?;
        Ok(Self { purpose, start: start.to_owned(), answer })
    }

    /// What has become of it.
    pub fn poll(&self) -> Answer {
        match self.answer.try_recv() {
            Ok((chosen, after)) => answer(chosen, after),
            Err(TryRecvError::Empty) => Answer::Open,
            Err(TryRecvError::Disconnected) => Answer::Absent,
        }
    }
}

fn answer(chosen: Vec<PathBuf>, after: Duration) -> Answer {
    match chosen.is_empty() {
        false => Answer::Chosen(chosen),
        true if after < SHOWN => Answer::Absent,
        true => Answer::Closed,
    }
}

/// Shows the dialog. Returns what was chosen; nothing if it was closed, or there is none.
async fn choose(purpose: Purpose, start: &Path) -> Vec<PathBuf> {
    let dialog = AsyncFileDialog::new().set_title(purpose.title());
    let folder = std::path::absolute(folder_of(start));
    let dialog = match folder {
        Ok(folder) if folder.is_dir() => dialog.set_directory(folder),
        _ => dialog,
    };
    let name = start.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let paths = |chosen: Vec<FileHandle>| chosen.iter().map(|file| file.path().into()).collect();
    match purpose {
        Purpose::Open => {
            let dialog = dialog.add_filter("Scans and scenes", &SCANS).add_filter("All", &["*"]);
            dialog.pick_files().await.map_or_else(Vec::new, paths)
        }
        Purpose::SaveScene => {
            let dialog = dialog.set_file_name(name).add_filter("Scene documents", &["json"]);
            dialog.save_file().await.map_or_else(Vec::new, |file| paths(vec![file]))
        }
        Purpose::Keep => {
            let dialog = dialog.set_file_name(name).add_filter("Esker files", &["esker"]);
            dialog.save_file().await.map_or_else(Vec::new, |file| paths(vec![file]))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dialog_that_closes_at_once_without_a_choice_is_absent() {
        let at_once = Duration::from_millis(20);
        assert_eq!(answer(Vec::new(), at_once), Answer::Absent);
        assert_eq!(answer(Vec::new(), Duration::from_secs(2)), Answer::Closed);
        let chosen = vec![PathBuf::from("a.las")];
        assert_eq!(answer(chosen.clone(), at_once), Answer::Chosen(chosen));
    }
}
