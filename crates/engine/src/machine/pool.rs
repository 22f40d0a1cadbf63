//! The rayon pool that all parallel work runs in.

use anyhow::{Context, Result, ensure};
use std::sync::Mutex;
use std::thread;

/// Threads at most: more than any machine has cores for, fewer than would bring one down.
const THREADS_MAX: usize = 1024;

/// Runs `work` in a pool of so many threads, which have ended when this returns; 0 is one a core.
///
/// # Errors
/// Where the threads cannot be started, and those of `work`.
pub fn run<T: Send>(threads: usize, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    ensure!(threads <= THREADS_MAX, "{threads} threads are too many: {THREADS_MAX} at most");
    let handles = Mutex::new(Vec::new());
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("esker-{i}"))
        .spawn_handler(|worker| {
            let builder = thread::Builder::new().name(worker.name().unwrap_or_default().into());
            let handle = builder.spawn(|| worker.run())?;
            handles.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(handle);
            Ok(())
        })
        .build()
        .context("cannot start the worker threads")?;
    let result = pool.install(work);
    drop(pool);
    // A pool does not wait for its threads. A program that ends meanwhile unloads libraries,
    // graphics drivers among them, under threads that still clear away what these have left with
    // them: one in a hundred crashed.
    for handle in handles.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        // What panics in a pool's thread is told where its work is waited for.
        let _ = handle.join();
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    static CLEARED: AtomicUsize = AtomicUsize::new(0);

    /// What a library leaves with a thread.
    struct Left;

    impl Drop for Left {
        fn drop(&mut self) {
            thread::sleep(Duration::from_millis(50));
            CLEARED.fetch_add(1, Ordering::Relaxed);
        }
    }

    thread_local!(static LEFT: Left = const { Left });

    #[test]
    fn threads_have_ended_when_their_work_is_given_back() {
        let work = || {
            rayon::broadcast(|_| LEFT.with(|_| ()));
            Ok(rayon::current_num_threads())
        };
        assert_eq!(run(3, work).unwrap(), 3);
        assert_eq!(CLEARED.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn what_fails_is_told_and_what_is_too_much_refused() {
        assert!(run::<()>(1, || anyhow::bail!("no")).is_err());
        assert!(run(THREADS_MAX + 1, || Ok(())).is_err());
    }
}
