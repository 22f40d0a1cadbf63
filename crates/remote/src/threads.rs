//! What the whole process fetches with: threads, and what encrypts connections.

use crate::pool::Pool;
use std::io;
use std::sync::OnceLock;
use std::time::Duration;
use tokio::task::JoinHandle;

/// Time between two looks whether waiting is to end.
pub const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Message for requests that ended without a result.
pub const GIVEN_UP: &str = "the request was given up";

/// The error of waiting that was ended.
pub fn stopped() -> io::Error {
    io::Error::other("it was stopped while a server was waited for")
}

/// Chooses what encrypts connections, for the whole process.
pub fn choose_tls() {
    // One that was chosen before is as good.
    let _ = rustls::crypto::ring::default_provider().install_default();
}

/// The threads that fetch, for the whole process.
pub fn runtime() -> io::Result<&'static tokio::runtime::Runtime> {
    static RUNTIME: OnceLock<Option<tokio::runtime::Runtime>> = OnceLock::new();
    let start = || {
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        runtime.worker_threads(2).thread_name("esker-fetch").enable_all().build().ok()
    };
    let failed = || io::Error::other("no threads can be started to fetch with");
    RUNTIME.get_or_init(start).as_ref().ok_or_else(failed)
}

/// Waits for requests, unless the pool is stopped.
///
/// # Errors
/// If it is stopped, or there are no threads.
pub fn finish<T: Send + 'static>(
    pool: &Pool,
    requests: impl Future<Output = T> + Send + 'static,
) -> io::Result<T> {
    wait(pool, runtime()?.spawn(requests))
}

/// Waits for requests that run, unless the pool is stopped: then they are given up.
///
/// # Errors
/// As for [`finish`].
pub fn wait<T>(pool: &Pool, mut running: JoinHandle<T>) -> io::Result<T> {
    runtime()?.block_on(async {
        loop {
            match tokio::time::timeout(LOOK_EVERY, &mut running).await {
                Ok(done) => return done.map_err(|_| io::Error::other(GIVEN_UP)),
                Err(_) if pool.is_stopped() => {
                    running.abort();
                    return Err(stopped());
                }
                Err(_) => {}
            }
        }
    })
}
