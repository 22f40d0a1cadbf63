//! Long calls: the engine works on a thread of its own, and the thread that called from Python
//! waits for it without the interpreter lock. Every few dozen milliseconds it takes the lock to see
//! whether the user has pressed Ctrl-C, and to call back with the progress; an exception in either
//! cancels the work and is raised.

use crate::errors::{EskerError, exception};
use anyhow::Result;
use esker_engine::Task;
use esker_engine::io::address::{is_remote, shown};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, Once, PoisonError};
use std::time::Duration;

/// Time between two looks at signals and progress.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Ends reads at addresses that wait for a server, of all calls, while one that was cancelled ends.
static STOPS_READING: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);
/// Most notes that are kept.
const NOTES_MAX: usize = 1000;

/// What a call has done so far.
#[derive(Default)]
pub struct Progress {
    is_cancelled: AtomicBool,
    done: AtomicU64,
    phase: Mutex<Phase>,
    notes: Mutex<Vec<String>>,
}

#[derive(Clone, Default, PartialEq)]
struct Phase {
    name: String,
    total: Option<u64>,
    unit: &'static str,
}

impl Progress {
    /// Notes for the user, in their order.
    fn into_notes(self) -> Vec<String> {
        self.notes.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Task for Progress {
    fn phase(&self, name: &str, total: Option<u64>, unit: &'static str) {
        let mut phase = lock(&self.phase);
        self.done.store(0, Ordering::Relaxed);
        *phase = Phase { name: name.to_owned(), total, unit };
    }

    fn advance(&self, by: u64) {
        self.done.fetch_add(by, Ordering::Relaxed);
    }

    fn note(&self, line: &str) {
        let mut notes = lock(&self.notes);
        if notes.len() < NOTES_MAX {
            notes.push(line.to_owned());
        }
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// Calls `progress` with phase, work done, all of it if that is known, and unit.
struct Reporter {
    progress: Option<Py<PyAny>>,
    shown: (Phase, u64),
}

impl Reporter {
    fn look(&mut self, py: Python<'_>, work: &Progress) -> PyResult<()> {
        py.check_signals()?;
        let Some(progress) = &self.progress else { return Ok(()) };
        let phase = lock(&work.phase).clone();
        let now = (phase, work.done.load(Ordering::Relaxed));
        if now.0.name.is_empty() || now == self.shown {
            return Ok(());
        }
        let (phase, done) = &now;
        progress.call1(py, (&phase.name, *done, phase.total, phase.unit))?;
        self.shown = now;
        Ok(())
    }
}

/// Runs `work` without the interpreter lock; returns its result and its notes.
///
/// # Errors
/// The exception of `work`; `KeyboardInterrupt`; what `progress` raises.
pub fn run<T: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&dyn Task) -> Result<T> + Send,
) -> PyResult<(T, Vec<String>)> {
    let reporter = Reporter { progress, shown: (Phase::default(), 0) };
    py.detach(|| beside(reporter, work))
}

fn beside<T: Send>(
    mut reporter: Reporter,
    work: impl FnOnce(&dyn Task) -> Result<T> + Send,
) -> PyResult<(T, Vec<String>)> {
    let state = Progress::default();
    let mut raised = None;
    let done = std::thread::scope(|scope| {
        let (finish, finished) = sync_channel::<()>(1);
        let worker = std::thread::Builder::new().name("esker-python".into());
        let worker = worker.spawn_scoped(scope, || {
            // Dropping it wakes the thread that waits, after a panic too.
            let _finish = finish;
            work(&state)
        });
        let worker = worker.map_err(|error| exception(&error.into()))?;
        while finished.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
            if raised.is_some() {
                continue;
            }
            // The interpreter may be ending, in which case nobody waits for the result.
            let looked = Python::try_attach(|py| reporter.look(py, &state)).unwrap_or(Ok(()));
            if let Err(error) = looked {
                state.is_cancelled.store(true, Ordering::Relaxed);
                STOPS_READING.store(true, Ordering::Relaxed);
                raised = Some(error);
            }
        }
        worker.join().map_err(|_| {
            EskerError::new_err("a defect of Esker stopped the work; please report it")
        })
    });
    if let Some(raised) = raised {
        STOPS_READING.store(false, Ordering::Relaxed);
        return Err(raised);
    }
    let done = done?.map_err(|error| exception(&error))?;
    // The end of the work is reported, however short it was.
    Python::try_attach(|py| reporter.look(py, &state)).unwrap_or(Ok(()))?;
    Ok((done, state.into_notes()))
}

/// The path of a file as it is used and shown: addresses without their secrets, which are kept for
/// requests. Lets this process open addresses, from the first one that is named on.
pub fn place(path: &Path) -> PathBuf {
    static ONCE: Once = Once::new();
    if is_remote(path) {
        let pool =
            || esker_remote::Pool::new(esker_remote::Limits::default(), STOPS_READING.clone());
        ONCE.call_once(|| drop(esker_remote::install(esker_remote::Disk::of_user(), pool())));
    }
    shown(path)
}

/// [`place`] of several files.
pub fn places(paths: &[PathBuf]) -> Vec<PathBuf> {
    paths.iter().map(|path| place(path)).collect()
}
