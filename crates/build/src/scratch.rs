//! Scratch space: one nameless file of rows, appended to, mapped to read, given back piece by piece as it is
//! consumed. Its pages are the system's to drop: they are no anonymous memory.

use crate::error::BuildError;
use memmap2::Mmap;
use std::fs::File;
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

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
    file: File,
    folder: PathBuf,
    /// Length of the file.
    bytes: u64,
    /// Bytes of before it was cleared.
    cleared_bytes: u64,
}

impl Scratch {
    /// A new scratch file in this folder.
    ///
    /// # Errors
    /// Where the folder takes no file.
    pub fn new(folder: &Path) -> Result<Self, BuildError> {
        let file = tempfile::tempfile_in(folder)
            .map_err(|e| BuildError::scratch(folder, "cannot make a scratch file", e))?;
        Ok(Self { file, folder: folder.to_owned(), bytes: 0, cleared_bytes: 0 })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<Extent, BuildError> {
        self.file
            .write_all(bytes)
            .map_err(|e| BuildError::scratch(&self.folder, "cannot write scratch data", e))?;
        let extent = Extent { offset: self.bytes, bytes: bytes.len() as u64 };
        self.bytes += extent.bytes;
        Ok(extent)
    }

    /// Bytes ever written: the peak of scratch space is at most this.
    pub fn bytes(&self) -> u64 {
        self.cleared_bytes + self.bytes
    }

    /// Begins anew; all extents are void.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn clear(&mut self) -> Result<(), BuildError> {
        self.cleared_bytes += std::mem::take(&mut self.bytes);
        self.file
            .set_len(0)
            .and_then(|()| self.file.rewind())
            .map_err(|e| BuildError::scratch(&self.folder, "cannot clear scratch data", e))
    }

    /// The file's content so far.
    ///
    /// # Errors
    /// Where the system refuses the mapping.
    pub fn map(&self) -> Result<Mmap, BuildError> {
        // SAFETY: the file has no name and this process alone holds it; it is only appended to, cut only when
        // no extent is left (`clear` takes `&mut self` where no map lives), and holes
        // are punched only in extents that nobody reads any more, so the mapped bytes never change under
        // a reader and the mapping never reaches past the file's end.
        unsafe { Mmap::map(&self.file) }
            .map_err(|e| BuildError::scratch(&self.folder, "cannot map scratch data", e))
    }

    /// Gives an extent's space back to the system. Best effort: what is not given back is freed at the end.
    pub fn release(&self, extent: Extent) {
        punch(&self.file, extent);
    }
}

#[cfg(target_os = "linux")]
fn punch(file: &File, extent: Extent) {
    use std::os::fd::AsRawFd;
    let (Ok(offset), Ok(bytes)) = (i64::try_from(extent.offset), i64::try_from(extent.bytes))
    else {
        return;
    };
    // SAFETY: fallocate takes no pointers; the descriptor is open as long as `file` lives.
    unsafe {
        libc::fallocate(
            file.as_raw_fd(),
            libc::FALLOC_FL_PUNCH_HOLE | libc::FALLOC_FL_KEEP_SIZE,
            offset,
            bytes,
        );
    }
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
        scratch.release(a);
        let map = scratch.map().unwrap();
        assert_eq!(&map[b.offset as usize..][..b.bytes as usize], &[2; 10_000]);
        assert_eq!(scratch.bytes(), 20_000);
        drop(map);
        scratch.clear().unwrap();
        let c = scratch.append(&[3; 10]).unwrap();
        assert_eq!(scratch.map().unwrap()[c.offset as usize..], [3; 10]);
        assert_eq!(scratch.bytes(), 20_010);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Scratch::new(Path::new("/nowhere/at/all")).err().unwrap();
        assert!(error.to_string().starts_with("/nowhere/at/all: "), "{error}");
    }
}
