//! What the whole process fetches with: threads, and what encrypts connections.

use std::io;
use std::sync::OnceLock;

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
