//! A file in memory as a disk that can be slow, fail, and lose its end.

use esker_format::ReadAt;
use std::io::{Error, ErrorKind, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::time::Duration;

/// Faults of the disk; they take effect when set.
#[derive(Debug)]
pub struct Faults {
    /// Time of a read, microseconds.
    pub delay_us: AtomicU64,
    /// One of this many reads fails; 0 for none.
    pub fails_one_of: AtomicU64,
    /// Reads so far.
    pub reads: AtomicU64,
    /// Bytes left of the file.
    pub left: AtomicU64,
    /// Whether every read returns other bytes.
    pub replaced: AtomicBool,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            delay_us: AtomicU64::new(0),
            fails_one_of: AtomicU64::new(0),
            reads: AtomicU64::new(0),
            left: AtomicU64::new(u64::MAX),
            replaced: AtomicBool::new(false),
        }
    }
}

/// The disk.
pub struct Disk {
    pub bytes: Arc<Vec<u8>>,
    pub faults: Arc<Faults>,
}

impl ReadAt for Disk {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> Result<()> {
        let reads = self.faults.reads.fetch_add(1, SeqCst);
        let delay_us = self.faults.delay_us.load(SeqCst);
        if delay_us > 0 {
            std::thread::sleep(Duration::from_micros(delay_us));
        }
        let one_of = self.faults.fails_one_of.load(SeqCst);
        if one_of > 0 && reads.is_multiple_of(one_of) {
            return Err(Error::other("the disk is tired"));
        }
        if offset + buf.len() as u64 > self.faults.left.load(SeqCst) {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        self.bytes.read_exact_at(buf, offset)?;
        if self.faults.replaced.load(SeqCst) {
            buf.iter_mut().for_each(|b| *b = !*b);
        }
        Ok(())
    }

    fn bytes(&self) -> Result<u64> {
        Ok((self.bytes.len() as u64).min(self.faults.left.load(SeqCst)))
    }
}
