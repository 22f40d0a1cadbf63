//! Positioned reads: the only access to the bytes of a finished file. Ranges over HTTP or object
//! storage can implement the trait too. Nothing is ever mapped, so a file that is truncated while
//! it is read gives an error, not a signal.

use crate::system::read_exact_at;
use std::fs::File;
use std::io;

/// A source of bytes that is read by position, from any thread.
pub trait ReadAt: Send + Sync {
    /// Fills `buf` from `offset` on.
    ///
    /// # Errors
    /// If the source ends before `buf` is full, or cannot be read.
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()>;

    /// Length of the source, bytes.
    ///
    /// # Errors
    /// If the source has no known length.
    fn bytes(&self) -> io::Result<u64>;
}

/// An open file.
#[derive(Debug)]
pub struct FileSource(pub File);

impl ReadAt for FileSource {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        read_exact_at(&self.0, buf, offset)
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.0.metadata()?.len())
    }
}

/// A file in memory.
impl ReadAt for Vec<u8> {
    fn read_exact_at(&self, buf: &mut [u8], offset: u64) -> io::Result<()> {
        let start = usize::try_from(offset).unwrap_or(usize::MAX);
        let bytes = start.checked_add(buf.len()).and_then(|end| self.get(start..end));
        buf.copy_from_slice(bytes.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }

    fn bytes(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }
}
