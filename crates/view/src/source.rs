//! Opens the input of the window: an `.esker` file directly; scans are first built into one, which
//! is kept in the user's cache folder for the next time, or else in a temporary folder that is
//! removed with the window. A thread does this, reports progress and can be stopped. Large scans
//! are shown as a preview of a share of their points meanwhile.

use crate::document::SceneFile;
use anyhow::{Context, Result};
use esker_engine::calls::preview::{self, Sample};
use esker_engine::io::file::open_copc;
use esker_engine::io::kept::{Kept, Place};
use esker_engine::io::output;
use esker_engine::io::quantity::grouped;
use esker_engine::{BuildOptions, Forest, Task};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
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
    /// The scene document that names it.
    pub scene: SceneFile,
    /// Folder of a file that was built for this window alone; removed after the file is closed.
    folder: Option<OwnFolder>,
    /// Whether the file was built from scans, and is kept in the cache.
    is_kept: bool,
    /// Number of points of the scans, about, if the file is a preview of them.
    preview_of: Option<u64>,
}

impl Opened {
    /// A preview of about ten times its points, for tests.
    #[cfg(test)]
    pub fn preview(path: &Path) -> Result<Self> {
        let file = Arc::new(Forest::open(path)?);
        let (scene, preview_of) = (SceneFile::of(&[path.to_owned()])?, Some(10 * file.points()));
        Ok(Self { file, scene, folder: None, is_kept: false, preview_of })
    }

    /// A note if the file is a preview.
    pub fn preview_note(&self) -> Option<String> {
        let [shown, all] = [self.file.points(), self.preview_of?].map(grouped);
        Some(format!("preview: {shown} of about {all} points, while the rest is read"))
    }

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

/// What an input has become.
pub enum Event {
    /// A preview can be shown; the work goes on.
    Preview(Opened),
    /// The end of the work.
    End(Result<Opened>),
}

/// An input that is being opened or built. Dropping it stops the work and waits for its thread.
pub struct Opening {
    task: Arc<OpenTask>,
    events: Receiver<Event>,
    thread: Option<JoinHandle<()>>,
}

/// Share of the time of a build by the end of its first phase, in which scans are read: between
/// that of uncompressed LAS, a fifth, and that of LAZ and text, half.
const READING_SHARE: f64 = 0.35;
/// Name of the phase that follows it.
const BUILDING: &str = "building";

/// Progress of opening or building.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// Name of the phase; empty while a file is opened.
    pub phase: String,
    /// Work of the phase that is done.
    pub done: u64,
    /// Work of the phase in total, if it is known.
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

    /// Share of the work of the phase that is done, 0 to 1.
    fn phase_share(&self) -> Option<f64> {
        let total = self.total.filter(|&t| t > 0)?;
        Some((self.done as f64 / total as f64).min(1.0))
    }

    /// Share of all work that is done, 0 to 1.
    pub fn share(&self) -> Option<f32> {
        let share = self.phase_share()?;
        let [from, to] =
            if self.phase == BUILDING { [READING_SHARE, 1.0] } else { [0.0, READING_SHARE] };
        Some((from + share * (to - from)) as f32)
    }

    /// Seconds until all is done, at the rate of the phase so far.
    pub fn left_s(&self) -> Option<f64> {
        let share = self.phase_share().filter(|&share| share > 0.0 && self.seconds > 0.5)?;
        let phase_s = self.seconds / share;
        let after_s = if self.phase == BUILDING {
            0.0
        } else {
            phase_s * (1.0 - READING_SHARE) / READING_SHARE
        };
        Some(phase_s - self.seconds + after_s)
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
        let (sender, events) = sync_channel(3);
        let shared = Arc::clone(&task);
        let work = move || {
            let opened = open(&inputs, &options, kept.as_ref(), (&*shared, &sender));
            // The receiver is gone if the window has closed.
            let _ = sender.send(Event::End(opened));
        };
        let thread = std::thread::Builder::new()
            .name("esker-open".into())
            .spawn(work)
            .context("cannot start a thread to open the file")?;
        Ok(Self { task, events, thread: Some(thread) })
    }

    /// Returns what has happened since the last call. Nothing follows the end.
    pub fn poll(&mut self) -> Option<Event> {
        match self.events.try_recv() {
            Ok(event) => Some(event),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                let fault = "the thread that opens the file has ended unexpectedly";
                Some(Event::End(Err(anyhow::anyhow!(fault))))
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

/// What is built from scans: their document, the scans, and how.
struct Building {
    scene: SceneFile,
    scans: Vec<PathBuf>,
    options: BuildOptions,
}

fn open(
    inputs: &[PathBuf],
    options: &BuildOptions,
    kept: Option<&Kept>,
    (task, events): (&OpenTask, &SyncSender<Event>),
) -> Result<Opened> {
    let mut scene = SceneFile::of(inputs)?;
    if let Some(forest) = scene.open()? {
        let file = Arc::new(forest);
        return Ok(Opened { file, scene, folder: None, is_kept: false, preview_of: None });
    }
    let (scans, options) = (scene.scans()?, scene.build_options(options));
    if let [one] = &scans[..]
        && let Some(forest) = open_copc(one, &options)?
    {
        let file = Arc::new(forest);
        return Ok(Opened { file, scene, folder: None, is_kept: false, preview_of: None });
    }
    build_scans(Building { scene, scans, options }, kept, (task, events))
}

fn build_scans(
    of: Building,
    kept: Option<&Kept>,
    (task, events): (&OpenTask, &SyncSender<Event>),
) -> Result<Opened> {
    let whole = |path: &Path| -> Result<Arc<Forest>> { Ok(Arc::new(Forest::open(path)?)) };
    let Building { scans, options, .. } = &of;
    // A user who names a folder wants the file there.
    let kept = kept.filter(|_| options.scratch.is_none());
    if let Some((kept, place)) = kept.and_then(|kept| Some((kept, kept.place(scans, options)?))) {
        // A damaged file is built again.
        if let Some(file) = kept.find(&place).and_then(|path| whole(&path).ok()) {
            let scene = of.scene;
            return Ok(Opened { file, scene, folder: None, is_kept: true, preview_of: None });
        }
        show_preview(&of, task, events);
        match kept.begin(&place) {
            Ok(built) => return build_kept(of, (kept, &place, &built), (task, events)),
            Err(fault) => task.note(&format!("{fault:#}")),
        }
    }
    if kept.is_none() {
        show_preview(&of, task, events);
    }
    let folder = output::temporary(options.scratch.as_deref())?;
    let folder = OwnFolder::new(&folder.keep());
    let built = folder.path.join("scan.esker");
    build_whole(&of, &built, task, events)?;
    let (file, scene) = (whole(&built)?, of.scene);
    Ok(Opened { file, scene, folder: Some(folder), is_kept: false, preview_of: None })
}

/// Makes a preview and passes it on, if the scans are large. Whatever is wrong with them is
/// reported by the build of the whole file.
fn show_preview(of: &Building, task: &OpenTask, events: &SyncSender<Event>) {
    let Building { scene, scans, options } = of;
    let quiet = Quiet { task, is_over: &AtomicBool::new(false) };
    let make = || -> Result<Option<Opened>> {
        let folder = output::temporary(options.scratch.as_deref())?;
        let folder = OwnFolder::new(&folder.keep());
        let out = folder.path.join("preview.esker");
        let made = preview::preview(scans, &out, options, &quiet)?;
        let Some([_, all]) = made else { return Ok(None) };
        let (file, scene) = (Arc::new(Forest::open(&out)?), scene.clone());
        let folder = Some(folder);
        Ok(Some(Opened { file, scene, folder, is_kept: false, preview_of: Some(all) }))
    };
    if let Ok(Some(opened)) = make() {
        // The receiver is gone if the window has closed.
        let _ = events.send(Event::Preview(opened));
    }
}

/// Builds a file of all points. Once all are read, a finer preview of large scans is made and
/// passed on.
fn build_whole(
    of: &Building,
    out: &Path,
    task: &OpenTask,
    events: &SyncSender<Event>,
) -> Result<()> {
    let (sample, is_over) = (Sample::default(), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let finer = || {
            let sample = sample.clone();
            let quiet = Quiet { task, is_over: &is_over };
            // Without a thread the first preview stays.
            let _ = std::thread::Builder::new().name("esker-preview".into()).spawn_scoped(
                scope,
                move || {
                    if let Ok(Some(opened)) = finer_preview(&sample, of, &quiet) {
                        let _ = events.send(Event::Preview(opened));
                    }
                },
            );
        };
        let task = Watching { task, finer: &finer };
        let built = preview::build_watched(&of.scans, out, &of.options, &sample, &task);
        is_over.store(true, Relaxed);
        built
    })?;
    task.check()?;
    Ok(())
}

fn finer_preview(sample: &Sample, of: &Building, quiet: &Quiet<'_>) -> Result<Option<Opened>> {
    let folder = output::temporary(of.options.scratch.as_deref())?;
    let folder = OwnFolder::new(&folder.keep());
    let out = folder.path.join("preview.esker");
    let Some(_) = sample.build(&out, &of.options, quiet)? else { return Ok(None) };
    let (file, scene) = (Arc::new(Forest::open(&out)?), of.scene.clone());
    let all = quiet.task.phase().total;
    Ok(Some(Opened { file, scene, folder: Some(folder), is_kept: false, preview_of: all }))
}

/// The task of a build, which begins a finer preview once all points are read.
struct Watching<'a> {
    task: &'a OpenTask,
    finer: &'a (dyn Fn() + Sync),
}

impl Task for Watching<'_> {
    fn phase(&self, name: &str, total: Option<u64>, unit: &'static str) {
        Task::phase(self.task, name, total, unit);
        if name == BUILDING {
            (self.finer)();
        }
    }

    fn advance(&self, by: u64) {
        self.task.advance(by);
    }

    fn note(&self, line: &str) {
        self.task.note(line);
    }

    fn is_cancelled(&self) -> bool {
        self.task.is_cancelled()
    }
}

/// A part of a task that reports no progress, and is not wanted any more once the work `is_over`.
struct Quiet<'a> {
    task: &'a OpenTask,
    is_over: &'a AtomicBool,
}

impl Task for Quiet<'_> {
    fn is_cancelled(&self) -> bool {
        self.task.is_cancelled() || self.is_over.load(Relaxed)
    }
}

/// Builds the file of a place, and keeps it if it is within the limit.
fn build_kept(
    of: Building,
    (kept, place, built): (&Kept, &Place, &Path),
    (task, events): (&OpenTask, &SyncSender<Event>),
) -> Result<Opened> {
    let folder = OwnFolder::new(place.building());
    build_whole(&of, built, task, events)?;
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
    Ok(Opened { file, scene: of.scene, folder, is_kept, preview_of: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bar_and_one_time_cover_reading_and_building() {
        let mut progress = Progress {
            phase: "reading".into(),
            done: 25,
            total: Some(100),
            unit: "points",
            seconds: 5.0,
            note: None,
        };
        assert_eq!(progress.rate(), 5.0);
        let whole_s = 20.0 / READING_SHARE;
        assert!((progress.left_s().unwrap() - (whole_s - 5.0)).abs() < 1e-9);
        assert!((f64::from(progress.share().unwrap()) - 5.0 / whole_s).abs() < 1e-6);
        let before = progress.share();
        (progress.phase, progress.done) = (BUILDING.into(), 0);
        assert!(before < progress.share(), "the bar goes on where reading has ended");
        progress.done = 25;
        assert_eq!(progress.left_s(), Some(15.0));
        progress.done = 100;
        assert_eq!((progress.share(), progress.left_s()), (Some(1.0), Some(0.0)));
        progress.total = None;
        assert_eq!((progress.share(), progress.left_s()), (None, None));
    }
}
