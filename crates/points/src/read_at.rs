//! Positioned reads: the only access to the bytes of an input that is finished. Files on this
//! machine are read by calls of the system, addresses such as `https://host/town.esker` by what
//! [`set_remote`] was given (`esker_remote`). Nothing is ever mapped, so a file that is truncated
//! while it is read gives an error, not a signal.

use crate::address::whole;
pub use crate::address::{beside, is_remote};
use crate::place::no_file_at;
use crate::positioned::read_exact_at;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, OnceLock};

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

    /// Says what is read next, so that a source with long round trips fetches it at once. Files on
    /// this machine need no such word.
    fn will_read(&self, _ranges: &[Range<u64>]) {}

    /// Makes reads that are waiting now fail, because those who need them end.
    fn interrupt(&self) {}

    /// Requests that were made until now, and bytes that came; `None` for files on this machine.
    fn traffic(&self) -> Option<[u64; 2]> {
        None
    }

    /// Number of threads that should read at the same time; `None` if the caller knows best.
    fn readers(&self) -> Option<usize> {
        None
    }
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

/// Opens an address.
pub type Opener = Box<dyn Fn(&str) -> io::Result<Arc<dyn ReadAt>> + Send + Sync>;

static REMOTE: OnceLock<Opener> = OnceLock::new();

/// Sets what opens addresses, for the whole process. The first one stays.
pub fn set_remote(opener: Opener) {
    let _ = REMOTE.set(opener);
}

/// Opens what a path names: an address, or a file on this machine.
///
/// # Errors
/// If there is nothing, or no file; if it cannot be opened; for an address, if nothing in this
/// program opens addresses.
pub fn open(path: &Path) -> io::Result<Arc<dyn ReadAt>> {
    if is_remote(path) {
        let path = whole(path);
        let address = path.to_str().unwrap_or_default();
        let none = || {
            io::Error::other(
                "this program cannot read addresses: build it with `--features remote`, or \
                 download the file and name that",
            )
        };
        return REMOTE.get().ok_or_else(none)?(address);
    }
    if let Some(what) = no_file_at(path)? {
        return Err(io::Error::other(what));
    }
    Ok(Arc::new(FileSource(File::open(path)?)))
}

/// Reads from front to back, and seeks, in a source of positioned reads.
#[derive(Clone)]
pub struct Input {
    source: Arc<dyn ReadAt>,
    at: u64,
    end: u64,
}

impl Input {
    /// Opens what a path names, as [`open`] does, and begins at the front.
    ///
    /// # Errors
    /// As for [`open`].
    pub fn open(path: &Path) -> io::Result<Self> {
        Self::new(open(path)?)
    }

    /// Number of bytes of the source.
    pub fn end(&self) -> u64 {
        self.end
    }

    /// Begins at the front.
    ///
    /// # Errors
    /// If the source has no known length.
    pub fn new(source: Arc<dyn ReadAt>) -> io::Result<Self> {
        let end = source.bytes()?;
        Ok(Self { source, at: 0, end })
    }
}

impl Read for Input {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.end.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let read = buf.len().min(left);
        if read == 0 {
            return Ok(0);
        }
        self.source.read_exact_at(&mut buf[..read], self.at)?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests {
    use super::*;

    #[test]
    fn a_cursor_reads_what_the_source_has() {
        let bytes: Vec<u8> = (0..=255).collect();
        let mut cursor = Input::new(Arc::new(bytes.clone())).unwrap();
        let mut all = Vec::new();
        cursor.read_to_end(&mut all).unwrap();
        assert_eq!(all, bytes);
        cursor.seek(SeekFrom::End(-2)).unwrap();
        let mut two = [0; 2];
        cursor.read_exact(&mut two).unwrap();
        assert_eq!(two, [254, 255]);
        assert!(cursor.read_exact(&mut two).is_err());
        cursor.seek(SeekFrom::Start(1 << 40)).unwrap();
        assert_eq!(cursor.read(&mut two).unwrap(), 0);
        assert!(cursor.seek(SeekFrom::Current(i64::MIN)).is_err());
    }
}
