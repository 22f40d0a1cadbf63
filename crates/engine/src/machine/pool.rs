//! The rayon pool of all parallel work.

use anyhow::{Context, Result, ensure};
use std::sync::Mutex;
use std::thread;

/// Most threads: more than any machine has cores, fewer than would exhaust one.
const THREADS_MAX: usize = 1024;

/// Runs `work` in a pool of `threads` threads (0: one a core), which have ended when this returns.
///
/// # Errors
/// If the threads cannot be started, or `work` fails.
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
    // A pool does not wait for its threads. If the program ends meanwhile, libraries such as
    // graphics drivers are unloaded while the threads still run their thread-local destructors, and
    // the program can crash.
    for handle in handles.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        // A panic in a thread of the pool was reported where its work was waited for.
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

    /// A thread-local value of a library with a slow destructor.
    struct SlowToDrop;

    impl Drop for SlowToDrop {
        fn drop(&mut self) {
            thread::sleep(Duration::from_millis(50));
            CLEARED.fetch_add(1, Ordering::Relaxed);
        }
    }

    thread_local!(static SLOW: SlowToDrop = const { SlowToDrop });

    #[test]
    fn threads_have_ended_when_a_pool_returns() {
        let work = || {
            rayon::broadcast(|_| SLOW.with(|_| ()));
            Ok(rayon::current_num_threads())
        };
        assert_eq!(run(3, work).unwrap(), 3);
        assert_eq!(CLEARED.load(Ordering::Relaxed), 3);
    }

    #[test]
    fn errors_are_returned_and_too_many_threads_refused() {
        assert!(run::<()>(1, || anyhow::bail!("no")).is_err());
        assert!(run(THREADS_MAX + 1, || Ok(())).is_err());
    }
}
