//! Scratch space: one nameless file of rows, appended to, mapped to read, given back piece by piece as it is
//! consumed. Its pages are the system's to drop: they are no anonymous memory.

use crate::error::BuildError;
use memmap2::Mmap;
use std::fs::File;
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// Bytes written to the file together.
const WRITE_BYTES: usize = 4 << 20;

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

/// A growing file without a name, gone with the process.
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
        })
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
        self.held_bytes_peak = self.held_bytes_peak.max(self.held_bytes);
        Ok(extent)
    }

    /// Bytes ever written.
    pub fn bytes(&self) -> u64 {
        self.written_bytes
    }

    /// The most bytes that were held at once.
    pub fn bytes_peak(&self) -> u64 {
        self.held_bytes_peak
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
        self.file
            .flush()
            .map_err(|e| BuildError::scratch(&self.folder, "cannot write scratch data", e))?;
        // SAFETY: the file has no name and this process alone holds it; it is only appended to, cut only when
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
        scratch.release(vec![a]);
        let map = scratch.map().unwrap();
        assert_eq!(&map[b.offset as usize..][..b.bytes as usize], &[2; 10_000]);
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let c = scratch.append(&[3; 10]).unwrap();
        assert_eq!(scratch.map().unwrap()[c.offset as usize..], [3; 10]);
        assert_eq!((scratch.bytes(), scratch.bytes_peak()), (20_010, 20_000));
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Scratch::new(Path::new("/nowhere/at/all")).err().unwrap();
        assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    }
}
