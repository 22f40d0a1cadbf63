//! Errors that prevent streaming from starting. Later faults are reported by
//! [`crate::Status::fault`], and streaming goes on with what can be read.

use std::path::PathBuf;

/// Error of [`crate::Streamer::start`], or of a change of needs.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The roots of all trees must always be resident, and do not fit.
    #[error(
        "{}: the planes of {} take {bytes} bytes, and drawing memory has {drawing_bytes} in pages of \
         {page_bytes}; raise the budget (--budget-gpu){}",
        path.display(),
        if *roots > 1 { format!("the roots of {roots} trees") } else { "the root".into() },
        if *roots > 1 { ", or make one tree of them (esker build --merge)" } else { "" }
    )]
    RootsTooLarge {
        /// Path of the first file.
        path: PathBuf,
        /// Number of trees with a root.
        roots: usize,
        /// Bytes that the roots take.
        bytes: u64,
        /// Budget of drawing memory, bytes.
        drawing_bytes: u64,
        /// Page of drawing memory, bytes; a slot lies within one page.
        page_bytes: u64,
    },
    /// The landing's runs are too short to be worth a read, or not aligned.
    #[error(
        "a landing of runs of {0} bytes; they must be multiples of {align}, at least {least}",
        align = crate::Transfer::ALIGNMENT,
        least = crate::landing::RUN_BYTES_MIN
    )]
    Runs(usize),
    /// The system refused a thread.
    #[error(
        "cannot start the thread {name}: {source}; close other programs, or ask for fewer loaders"
    )]
    Thread {
        /// Name of the thread.
        name: String,
        /// Error of the system.
        source: std::io::Error,
    },
}
