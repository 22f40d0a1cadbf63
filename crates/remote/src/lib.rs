//! Positioned reads at addresses: `http://`, `https://`, `s3://`, `gs://` and `az://`. A file is read
//! in blocks, of which neighbours are fetched in one request and many requests run at a time; what
//! was fetched stays in memory and in a bounded folder of the user's cache. A file that changes while
//! it is read, a server that ignores ranges, and short answers are errors. Credentials come from the
//! standard variables of the environment alone.

mod address;
mod blocks;
mod disk;
mod fetch;
mod source;

pub use disk::Disk;
pub use source::{Limits, Remote};

use std::io;
use std::sync::{Arc, OnceLock};

/// Lets this process open addresses wherever it opens files ([`esker_points::read_at::open`]).
/// `disk` keeps what was fetched; `None` keeps it in memory alone.
pub fn install(disk: Option<Disk>) {
    let disk = disk.map(Arc::new);
    esker_points::read_at::set_remote(Box::new(move |address| {
        let remote = Remote::open(address, disk.clone(), Limits::default())?;
        Ok(Arc::new(remote))
    }));
}

/// Chooses what encrypts connections, for the whole process.
fn choose_tls() {
    // One that was chosen before is as good.
    let _ = rustls::crypto::ring::default_provider().install_default();
}

/// The threads that fetch, for the whole process.
fn runtime() -> io::Result<&'static tokio::runtime::Runtime> {
    static RUNTIME: OnceLock<Option<tokio::runtime::Runtime>> = OnceLock::new();
    let start = || {
        let mut runtime = tokio::runtime::Builder::new_multi_thread();
        runtime.worker_threads(2).thread_name("esker-fetch").enable_all().build().ok()
    };
    let failed = || io::Error::other("no threads can be started to fetch with");
    RUNTIME.get_or_init(start).as_ref().ok_or_else(failed)
}
