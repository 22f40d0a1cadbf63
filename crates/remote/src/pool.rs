//! What the files of a process share, so that many files take no more than one: requests that run
//! at the same time, bytes in memory, and the flag that ends waiting.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;
use tokio::sync::Semaphore;

/// Bytes of memory of a file, however many are open.
const SHARE_MIN: u64 = 1 << 20;

/// How much is done at a time.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Requests that run at the same time.
    pub requests: usize,
    /// Most blocks of one request, of 16 KiB each.
    pub blocks: u64,
    /// Bytes of blocks in memory. Each of many open files may have a megabyte in any case.
    pub memory_bytes: u64,
    /// Longest wait for an answer, and for its next bytes.
    pub answer: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self { requests: 16, blocks: 128, memory_bytes: 64 << 20, answer: Duration::from_secs(30) }
    }
}

/// What files share.
#[derive(Debug)]
pub struct Pool {
    pub(crate) limits: Limits,
    pub(crate) permits: Semaphore,
    /// Ends all waiting when it is set.
    stop: Arc<AtomicBool>,
    /// Number of open files.
    open: AtomicU64,
    /// Blocks in memory.
    pub(crate) blocks: AtomicU64,
}

impl Pool {
    /// A pool for any number of files. Readers give up with an error once `stop` is set.
    pub fn new(limits: Limits, stop: Arc<AtomicBool>) -> Self {
        Self {
            limits,
            permits: Semaphore::new(limits.requests.max(1)),
            stop,
            open: AtomicU64::new(0),
            blocks: AtomicU64::new(0),
        }
    }

    /// Bytes of blocks in memory, of all files.
    pub fn memory_bytes(&self) -> u64 {
        self.blocks.load(Relaxed) * crate::blocks::BLOCK
    }

    /// Bytes of memory that a file may have.
    pub(crate) fn share(&self) -> u64 {
        let all = self.limits.memory_bytes;
        (all / self.open.load(Relaxed).max(1)).max(SHARE_MIN.min(all))
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }

    pub(crate) fn opened(&self) {
        self.open.fetch_add(1, Relaxed);
    }

    pub(crate) fn closed(&self) {
        self.open.fetch_sub(1, Relaxed);
    }
}
