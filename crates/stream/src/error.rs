//! Why streaming cannot start. What goes wrong later is told by [`crate::Status::fault`], and the rest
//! goes on.

use std::path::PathBuf;

/// What is wrong with what a `Streamer` was asked to do.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The roots of all trees must always be resident.
    #[error(
        "{}: the planes of {} take {bytes} bytes, and drawing memory has {drawing_bytes} in pages of \
         {page_bytes}; raise the budget (--budget-gpu){}",
        path.display(),
        if *roots > 1 { format!("the roots of {roots} trees") } else { "the root".into() },
        if *roots > 1 { ", or make one tree of them (esker build --merge)" } else { "" }
    )]
    RootsTooLarge {
        /// The file.
        path: PathBuf,
        /// Trees that have one.
        roots: usize,
        /// What the roots take.
        bytes: u64,
        /// The budget.
        drawing_bytes: u64,
        /// What no slot straddles.
        page_bytes: u64,
    },
    /// Runs too short to be worth a read, or not aligned.
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
        /// Its name.
        name: String,
        /// What the system says.
        source: std::io::Error,
    },
}
