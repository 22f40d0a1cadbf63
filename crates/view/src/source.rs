//! Where the scene comes from: an `.esker` file is opened, scans are first built into one, in a
//! temporary folder that goes with it. Done by a thread of its own, which tells how far it is and
//! can be stopped.

use anyhow::{Context, Result, bail};
use esker_engine::calls::build;
use esker_engine::io::output;
use esker_engine::{BuildOptions, Forest, Task};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

/// Folders that are to go with the window, however it ends.
static FOLDERS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// How often a folder is removed in which something still grows.
const SWEEPS: usize = 5;

/// Removes what was built for the window, where it ends by a signal.
pub fn sweep() {
    let mut folders = FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    for folder in folders.drain(..) {
        (0..SWEEPS).find(|_| {
            let removed = std::fs::remove_dir_all(&folder);
            removed.is_ok() || !folder.exists()
        });
    }
}

/// What is looked at.
pub struct Opened {
    /// The file.
    pub file: Arc<Forest>,
    /// Where it lies, if it was built for this window alone; removed after the file is closed.
    folder: Option<tempfile::TempDir>,
}

impl Opened {
    /// Whether it goes when the window closes.
    pub fn is_temporary(&self) -> bool {
        self.folder.is_some()
    }
}

/// A file or scans on their way. Dropping it stops the work and waits for its thread.
pub struct Opening {
    told: Arc<Told>,
    opened: Receiver<Result<Opened>>,
    thread: Option<JoinHandle<()>>,
}

/// How far it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Progress {
    /// What is being done; empty where only a file is opened.
    pub phase: String,
    /// How much of it is done.
    pub done: u64,
    /// How much there is to do, where known.
    pub total: Option<u64>,
    /// What is counted.
    pub unit: &'static str,
    /// Seconds since the phase began.
    pub seconds: f64,
    /// What the builder found worth saying last.
    pub note: Option<String>,
}

impl Progress {
    /// Done a second.
    pub fn rate(&self) -> f64 {
        if self.seconds > 0.0 { self.done as f64 / self.seconds } else { 0.0 }
    }

    /// Share that is done, 0 to 1.
    pub fn share(&self) -> Option<f32> {
        let total = self.total.filter(|&t| t > 0)?;
        Some((self.done as f64 / total as f64).min(1.0) as f32)
    }

    /// Seconds left of this phase, at the rate so far.
    pub fn left_s(&self) -> Option<f64> {
        let left = self.total?.saturating_sub(self.done) as f64;
        (self.done > 0 && self.seconds > 0.5).then(|| left / self.rate())
    }
}

/// What the working thread tells, and is told.
struct Told {
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
    /// Begins.
    ///
    /// # Errors
    /// Where the thread cannot be started.
    pub fn start(inputs: Vec<PathBuf>, options: BuildOptions) -> Result<Self> {
        let phase =
            Phase { name: String::new(), total: None, unit: "", start: Instant::now(), note: None };
        let told = Arc::new(Told {
            stop: AtomicBool::new(false),
            done: AtomicU64::new(0),
            phase: Mutex::new(phase),
        });
        let (sender, opened) = sync_channel(1);
        let task = Arc::clone(&told);
        let work = move || {
            // Nobody listens once the window has closed.
            let _ = sender.send(open(&inputs, &options, &*task));
        };
        let thread = std::thread::Builder::new()
            .name("esker-open".into())
            .spawn(work)
            .context("cannot start a thread to open the file")?;
        Ok(Self { told, opened, thread: Some(thread) })
    }

    /// What came of it, once.
    pub fn poll(&mut self) -> Option<Result<Opened>> {
        match self.opened.try_recv() {
            Ok(opened) => Some(opened),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err(anyhow::anyhow!("the thread that opens the file has ended early")))
            }
        }
    }

    /// How far it is.
    pub fn progress(&self) -> Progress {
        let phase = self.told.phase();
        Progress {
            phase: phase.name.clone(),
            done: self.told.done.load(Relaxed),
            total: phase.total,
            unit: phase.unit,
            seconds: phase.start.elapsed().as_secs_f64(),
            note: phase.note.clone(),
        }
    }

    /// Asks it to stop; it ends with an error soon after.
    pub fn cancel(&self) {
        self.told.stop.store(true, Relaxed);
    }
}

impl Drop for Opening {
    fn drop(&mut self) {
        self.cancel();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has said so itself.
            let _ = thread.join();
        }
    }
}

impl Told {
    fn phase(&self) -> std::sync::MutexGuard<'_, Phase> {
        self.phase.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Task for Told {
    fn phase(&self, name: &str, total: Option<u64>, unit: &'static str) {
        self.done.store(0, Relaxed);
        let mut phase = Told::phase(self);
        (phase.name, phase.total, phase.unit) = (name.to_owned(), total, unit);
        phase.start = Instant::now();
    }

    fn advance(&self, by: u64) {
        self.done.fetch_add(by, Relaxed);
    }

    fn note(&self, line: &str) {
        Told::phase(self).note = Some(line.to_owned());
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Relaxed)
    }
}

fn open(inputs: &[PathBuf], options: &BuildOptions, task: &dyn Task) -> Result<Opened> {
    if let [one] = inputs
        && esker_engine::io::file::is_esker(one)?
    {
        return Ok(Opened { file: Arc::new(Forest::open(one)?), folder: None });
    }
    for input in inputs {
        if esker_engine::io::file::is_esker(input)? {
            bail!(
                "{}: several inputs are shown together only where all are scans",
                input.display()
            );
        }
    }
    let folder = output::temporary(options.scratch.as_deref())?;
    let known = || FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    known().push(folder.path().to_owned());
    let built = folder.path().join("scan.esker");
    build::build(inputs, &built, options, 0, task)?;
    task.check()?;
    Ok(Opened { file: Arc::new(Forest::open(&built)?), folder: Some(folder) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_tells_rate_and_time_left() {
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
