//! Opens the input of the window: an `.esker` file directly; scans are first built into one, which
//! is kept in the user's cache folder for the next time, or else in a temporary folder that is
//! removed with the window. A thread does this, reports progress and can be stopped.

use anyhow::{Context, Result};
use esker_engine::calls::build;
use esker_engine::draw::scene::open_together;
use esker_engine::io::kept::{Kept, Place};
use esker_engine::io::output;
use esker_engine::{BuildOptions, Forest, Task};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// Folders that are removed when the window ends, also by a signal.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Attempts to remove a folder to which a thread may still add files.
const REMOVE_ATTEMPTS: usize = 5;

/// Removes the folders of built files, when a signal ends the window.
pub fn remove_temporary_files() {
    for folder in known_folders().drain(..) {
        (0..REMOVE_ATTEMPTS).find(|_| {
            let removed = std::fs::remove_dir_all(&folder);
            removed.is_ok() || !folder.exists()
        });
    }
}

/// An opened input.
pub struct Opened {
    /// The `.esker` file.
    pub file: Arc<Forest>,
    /// Folder of a file that was built for this window alone; removed after the file is closed.
    folder: Option<OwnFolder>,
    /// Whether the file was built from scans, and is kept in the cache.
    is_kept: bool,
}

impl Opened {
    /// Whether the file was built from scans.
    pub fn is_built(&self) -> bool {
        self.folder.is_some() || self.is_kept
    }

    /// Where the file is, if it was built from scans, in words.
    pub fn built_in(&self) -> &'static str {
        match (&self.folder, self.is_kept) {
            (Some(_), _) => ", in a temporary file",
            (None, true) => ", kept for the next time",
            (None, false) => "",
        }
    }
}

/// A folder that is removed when the window no longer needs it, also by a signal.
struct OwnFolder {
    path: PathBuf,
    is_kept: bool,
}

impl OwnFolder {
    fn new(path: &Path) -> Self {
        known_folders().push(path.to_owned());
        Self { path: path.to_owned(), is_kept: false }
    }

    /// Leaves the folder as it is.
    fn keep(mut self) {
        self.is_kept = true;
    }
}

impl Drop for OwnFolder {
    fn drop(&mut self) {
        known_folders().retain(|path| *path != self.path);
        if !self.is_kept {
            let _ = std::fs::remove_dir_all(&self.path);
        }
    }
}

fn known_folders() -> MutexGuard<'static, Vec<PathBuf>> {
    FOLDERS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An input that is being opened or built. Dropping it stops the work and waits for its thread.
pub struct Opening {
    task: Arc<OpenTask>,
    opened: Receiver<Result<Opened>>,
    thread: Option<JoinHandle<()>>,
}

/// Progress of opening or building.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Name of the phase; empty while a file is opened.
    pub phase: String,
    /// Work that is done.
    pub done: u64,
    /// Work in total, if it is known.
    pub total: Option<u64>,
    /// Unit of the work.
    pub unit: &'static str,
    /// Seconds since the phase began.
    pub seconds: f64,
    /// Last note of the builder.
    pub note: Option<String>,
}

impl Progress {
    /// Work a second.
    pub fn rate(&self) -> f64 {
        if self.seconds > 0.0 { self.done as f64 / self.seconds } else { 0.0 }
    }

    /// Share of the work that is done, 0 to 1.
    pub fn share(&self) -> Option<f32> {
        let total = self.total.filter(|&t| t > 0)?;
        Some((self.done as f64 / total as f64).min(1.0) as f32)
    }

    /// Seconds until the phase ends, at the rate so far.
    pub fn left_s(&self) -> Option<f64> {
        let left = self.total?.saturating_sub(self.done) as f64;
        (self.done > 0 && self.seconds > 0.5).then(|| left / self.rate())
    }
}

/// State that the window and the thread that opens the input share.
struct OpenTask {
    stop: AtomicBool,
    done: AtomicU64,
    phase: Mutex<Phase>,
}

struct Phase {
    name: String,
    total: Option<u64>,
    unit: &'static str,
    start: Instant,
    note: Option<String>,
}

impl Opening {
    /// Starts the thread. Files that are built from scans are among the `kept` ones, if there are
    /// any.
    ///
    /// # Errors
    /// If the thread cannot be started.
    pub fn start(inputs: Vec<PathBuf>, options: BuildOptions, kept: Option<Kept>) -> Result<Self> {
        let phase =
            Phase { name: String::new(), total: None, unit: "", start: Instant::now(), note: None };
        let task = Arc::new(OpenTask {
            stop: AtomicBool::new(false),
            done: AtomicU64::new(0),
            phase: Mutex::new(phase),
        });
        let (sender, opened) = sync_channel(1);
        let shared = Arc::clone(&task);
        let work = move || {
            // The receiver is gone if the window has closed.
            let _ = sender.send(open(&inputs, &options, kept.as_ref(), &*shared));
        };
        let thread = std::thread::Builder::new()
            .name("esker-open".into())
            .spawn(work)
            .context("cannot start a thread to open the file")?;
        Ok(Self { task, opened, thread: Some(thread) })
    }

    /// Returns the result when there is one, once.
    pub fn poll(&mut self) -> Option<Result<Opened>> {
        match self.opened.try_recv() {
            Ok(opened) => Some(opened),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow::anyhow!("the thread that opens the file has ended unexpectedly")))
            }
        }
    }

    /// Present progress.
    pub fn progress(&self) -> Progress {
        let phase = self.task.phase();
        Progress {
            phase: phase.name.clone(),
            done: self.task.done.load(Relaxed),
            total: phase.total,
            unit: phase.unit,
            seconds: phase.start.elapsed().as_secs_f64(),
            note: phase.note.clone(),
        }
    }

    /// Requests the thread to stop; it ends with an error soon after.
    pub fn cancel(&self) {
        self.task.stop.store(true, Relaxed);
    }
}

impl Drop for Opening {
    fn drop(&mut self) {
        self.cancel();
        if let Some(thread) = self.thread.take() {
            // A panic was already reported by the thread.
            let _ = thread.join();
        }
    }
}

impl OpenTask {
    fn phase(&self) -> MutexGuard<'_, Phase> {
        self.phase.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Task for OpenTask {
    fn phase(&self, name: &str, total: Option<u64>, unit: &'static str) {
        self.done.store(0, Relaxed);
        let mut phase = OpenTask::phase(self);
        (phase.name, phase.total, phase.unit) = (name.to_owned(), total, unit);
        phase.start = Instant::now();
    }

    fn advance(&self, by: u64) {
        self.done.fetch_add(by, Relaxed);
    }

    fn note(&self, line: &str) {
        OpenTask::phase(self).note = Some(line.to_owned());
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Relaxed)
    }
}

fn open(
    inputs: &[PathBuf],
    options: &BuildOptions,
    kept: Option<&Kept>,
    task: &dyn Task,
) -> Result<Opened> {
    let whole = |path: &Path| -> Result<Arc<Forest>> { Ok(Arc::new(Forest::open(path)?)) };
    if let Some(forest) = open_together(inputs, &[])? {
        return Ok(Opened { file: Arc::new(forest), folder: None, is_kept: false });
    }
    // A user who names a folder wants the file there.
    let kept = kept.filter(|_| options.scratch.is_none());
    if let Some((kept, place)) = kept.and_then(|kept| Some((kept, kept.place(inputs, options)?))) {
        // A damaged file is built again.
        if let Some(file) = kept.find(&place).and_then(|path| whole(&path).ok()) {
            return Ok(Opened { file, folder: None, is_kept: true });
        }
        match kept.begin(&place) {
            Ok(built) => return build_kept(inputs, options, (kept, &place, &built), task),
            Err(fault) => task.note(&format!("{fault:#}")),
        }
    }
    let folder = output::temporary(options.scratch.as_deref())?;
    let folder = OwnFolder::new(&folder.keep());
    let built = folder.path.join("scan.esker");
    build::build(inputs, &built, options, 0, task)?;
    task.check()?;
    Ok(Opened { file: whole(&built)?, folder: Some(folder), is_kept: false })
}

/// Builds the file of a place, and keeps it if it is within the limit.
fn build_kept(
    inputs: &[PathBuf],
    options: &BuildOptions,
    (kept, place, built): (&Kept, &Place, &Path),
    task: &dyn Task,
) -> Result<Opened> {
    let folder = OwnFolder::new(place.building());
    build::build(inputs, built, options, 0, task)?;
    task.check()?;
    let path = kept.keep(place).unwrap_or_else(|fault| {
        task.note(&format!("{fault:#}"));
        None
    });
    let is_kept = path.is_some();
    let file = Arc::new(Forest::open(path.as_deref().unwrap_or(built))?);
    let folder = if is_kept {
        folder.keep();
        None
    } else {
        Some(folder)
    };
    Ok(Opened { file, folder, is_kept })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_has_a_rate_and_the_time_left() {
        let mut progress = Progress {
            phase: "sampling".into(),
            done: 25,
            total: Some(100),
            unit: "points",
            seconds: 5.0,
            note: None,
        };
        assert_eq!(progress.rate(), 5.0);
        assert_eq!(progress.share(), Some(0.25));
        assert_eq!(progress.left_s(), Some(15.0));
        progress.total = None;
        assert_eq!((progress.share(), progress.left_s()), (None, None));
    }
}
