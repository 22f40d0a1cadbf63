//! The rayon pool that all parallel work runs in.

use anyhow::{Context, Result, ensure};

/// Threads at most: more than any machine has cores for, fewer than would bring one down.
const THREADS_MAX: usize = 1024;

/// Runs `work` in a pool of so many threads; 0 is one a core.
///
/// # Errors
/// Where the threads cannot be started, and those of `work`.
pub fn run<T: Send>(threads: usize, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    ensure!(threads <= THREADS_MAX, "{threads} threads are too many: {THREADS_MAX} at most");
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("esker-{i}"))
        .build()
        .context("cannot start the worker threads")?
        .install(work)
}
