//! Scratch space: one file of rows, appended to, mapped to read, given back piece by piece as it is consumed. It has
//! no name, or one where a later build may go on with it. Its pages are the system's to drop: they are no anonymous
//! memory.

use crate::error::BuildError;
use memmap2::Mmap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// Bytes written to the file together.
const WRITE_BYTES: usize = 4 << 20;
/// How names of files of rows begin and end.
const NAME: [&str; 2] = [".esker-", ".rows"];

/// A run of bytes in the scratch file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Where it begins.
    pub offset: u64,
    /// How long it is.
    pub bytes: u64,
}

impl Extent {
    /// Its bytes in a mapping made since it was appended.
    pub fn of<'a>(&self, map: &'a Mmap) -> Option<&'a [u8]> {
        map.get(self.offset as usize..(self.offset + self.bytes) as usize)
    }
}

/// Whether a file has such a name as files of rows have.
pub fn is_ours(path: &Path) -> bool {
    let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    name.starts_with(NAME[0]) && name.ends_with(NAME[1])
}

/// A growing file, gone with the process where it has no name.
pub struct Scratch {
    file: BufWriter<File>,
    folder: PathBuf,
    /// Length of the file.
    file_bytes: u64,
    /// Bytes ever written.
    written_bytes: u64,
    /// Bytes not yet released.
    held_bytes: u64,
    held_bytes_peak: u64,
    /// Bytes that the file being built has.
    beside_bytes: u64,
    disk_bytes_peak: u64,
    path: Option<PathBuf>,
    is_kept: bool,
}

impl Scratch {
    /// A new scratch file in this folder.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn new(folder: &Path) -> Result<Self, BuildError> {
        let file = tempfile::tempfile_in(folder)
            .map_err(|e| BuildError::scratch(folder, "cannot make a scratch file", e))?;
        Ok(Self {
            file: BufWriter::with_capacity(WRITE_BYTES, file),
            folder: folder.to_owned(),
            file_bytes: 0,
            written_bytes: 0,
            held_bytes: 0,
            held_bytes_peak: 0,
            beside_bytes: 0,
            disk_bytes_peak: 0,
            path: None,
            is_kept: false,
        })
    }

    /// Gives the file, in which nothing is yet, a name that can be kept in a journal, if its folder's has letters.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn name(&mut self) -> Result<Option<&Path>, BuildError> {
        debug_assert_eq!(self.file_bytes, 0);
        if self.path.is_none() && self.folder.to_str().is_some() {
            let failed = |e| BuildError::scratch(&self.folder, "cannot make a scratch file", e);
            // A name from the root leads to it from wherever a later build begins.
            let folder = self.folder.canonicalize().map_err(failed)?;
            let mut named = tempfile::Builder::new();
            let named = named.prefix(NAME[0]).suffix(NAME[1]).tempfile_in(folder);
            let (file, path) =
                named.and_then(|n| n.keep().map_err(io::Error::from)).map_err(failed)?;
            self.file = BufWriter::with_capacity(WRITE_BYTES, file);
            self.path = Some(path);
        }
        Ok(self.path.as_deref())
    }

    /// Takes the file of an earlier build, which is to be told by [`Scratch::restore`] what is in it.
    ///
    /// # Errors
    /// Where it is not there.
    pub fn reopen(&mut self, path: &Path) -> io::Result<()> {
        if !is_ours(path) {
            return Err(io::Error::other("it has another name than scratch files have"));
        }
        let file = OpenOptions::new().read(true).write(true).open(path)?;
        self.file = BufWriter::with_capacity(WRITE_BYTES, file);
        self.path = Some(path.into());
        Ok(())
    }

    /// These extents are in the file that was reopened, and nothing behind them. Whether that can be.
    ///
    /// # Errors
    /// Where the disk fails.
    pub fn restore(&mut self, extents: &[Extent]) -> Result<bool, BuildError> {
        for extent in extents {
            let Some(end) = extent.offset.checked_add(extent.bytes) else { return Ok(false) };
            self.file_bytes = self.file_bytes.max(end);
            self.written_bytes += extent.bytes;
            self.held_bytes += extent.bytes;
        }
        self.note_peaks();
        let sought = self.file.seek(io::SeekFrom::Start(self.file_bytes));
        let length = sought.and_then(|_| self.file.get_ref().metadata());
        length
            .map(|m| m.len() >= self.file_bytes)
            .map_err(|e| BuildError::scratch(&self.folder, "cannot read scratch data", e))
    }

    /// Whether nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.file_bytes == 0
    }

    /// Whether it stays when it is dropped, where it has a name.
    pub fn keep(&mut self, is_kept: bool) {
        self.is_kept = is_kept;
    }

    /// Hands what is buffered to the system.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn flush(&mut self) -> Result<(), BuildError> {
        let flushed = self.file.flush();
        flushed.map_err(|e| BuildError::scratch(&self.folder, "cannot write scratch data", e))
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<Extent, BuildError> {
        self.file
            .write_all(bytes)
            .map_err(|e| BuildError::scratch(&self.folder, "cannot write scratch data", e))?;
        let extent = Extent { offset: self.file_bytes, bytes: bytes.len() as u64 };
        self.file_bytes += extent.bytes;
        self.written_bytes += extent.bytes;
        self.held_bytes += extent.bytes;
        self.note_peaks();
        Ok(extent)
    }

    /// Told that the file that is being built now has so many bytes.
    pub fn set_beside(&mut self, bytes: u64) {
        self.beside_bytes = bytes;
        self.note_peaks();
    }

    fn note_peaks(&mut self) {
        self.held_bytes_peak = self.held_bytes_peak.max(self.held_bytes);
        self.disk_bytes_peak = self.disk_bytes_peak.max(self.held_bytes + self.beside_bytes);
    }

    /// Bytes ever written.
    pub fn bytes(&self) -> u64 {
        self.written_bytes
    }

    /// The most bytes that were held at once.
    pub fn bytes_peak(&self) -> u64 {
        self.held_bytes_peak
    }

    /// The most bytes that scratch and the file being built had at once.
    pub fn disk_bytes_peak(&self) -> u64 {
        self.disk_bytes_peak
    }

    /// Begins anew; all extents are void.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn clear(&mut self) -> Result<(), BuildError> {
        (self.file_bytes, self.held_bytes) = (0, 0);
        self.file
            .flush()
            .and_then(|()| self.file.get_ref().set_len(0))
            .and_then(|()| self.file.rewind())
            .map_err(|e| BuildError::scratch(&self.folder, "cannot clear scratch data", e))
    }

    /// The file's content so far.
    ///
    /// # Errors
    /// Where the disk is full, or the system refuses the mapping.
    pub fn map(&mut self) -> Result<Mmap, BuildError> {
        self.flush()?;
        // SAFETY: this process alone holds the file: it has no name, or a random one of this user's, which the
        // journal of an output alone knows, and the output is locked; it is only appended to, cut only when
        // no extent is left (`clear` takes `&mut self` where no map lives), and holes
        // are punched only in extents that nobody reads any more, so the mapped bytes never change under
        // a reader and the mapping never reaches past the file's end.
        unsafe { Mmap::map(self.file.get_ref()) }
            .map_err(|e| BuildError::scratch(&self.folder, "cannot map scratch data", e))
    }

    /// Gives the space of extents back to the system, neighbours together. Best effort: what is not given
    /// back is freed at the end.
    pub fn release(&mut self, mut extents: Vec<Extent>) {
        extents.sort_unstable_by_key(|e| e.offset);
        for run in extents.chunk_by(|a, b| a.offset + a.bytes == b.offset) {
            let bytes = run.iter().map(|e| e.bytes).sum();
            self.held_bytes -= bytes;
            punch(self.file.get_ref(), Extent { offset: run[0].offset, bytes });
        }
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if let Some(path) = self.path.take().filter(|_| !self.is_kept) {
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(target_os = "linux")]
fn punch(file: &File, extent: Extent) {
    use rustix::fs::{FallocateFlags, fallocate};
    let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
    // Not every file system knows holes.
    let _ = fallocate(file, hole, extent.offset, extent.bytes);
}

#[cfg(not(target_os = "linux"))]
fn punch(_file: &File, _extent: Extent) {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extents_read_back_and_neighbours_survive_a_release() {
        let folder = tempfile::tempdir().unwrap();
        let mut scratch = Scratch::new(folder.path()).unwrap();
        let a = scratch.append(&[1; 10_000]).unwrap();
        let b = scratch.append(&[2; 10_000]).unwrap();
        scratch.set_beside(500);
        scratch.release(vec![a]);
        scratch.set_beside(7_000);
        let map = scratch.map().unwrap();
        assert_eq!(&map[b.offset as usize..][..b.bytes as usize], &[2; 10_000]);
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let c = scratch.append(&[3; 10]).unwrap();
        assert_eq!(scratch.map().unwrap()[c.offset as usize..], [3; 10]);
        assert_eq!((scratch.bytes(), scratch.bytes_peak()), (20_010, 20_000));
        assert_eq!(scratch.disk_bytes_peak(), 20_500);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Scratch::new(Path::new("/nowhere/at/all")).err().unwrap();
        assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    }
}
