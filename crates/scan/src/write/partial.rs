//! A file with a temporary name beside its final one, which it gets when all of it is on the disk.
//! If it is dropped before that, it is removed; the next program overwrites what a killed one has
//! left. It is locked until it has its final name, so no two programs write it.

use crate::error::ScanError;
use esker_points::place::open_alone;
use esker_points::unfinished::Unfinished;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Size of the write buffer, in bytes.
const BUFFER_BYTES: usize = 1 << 20;

/// A file with a temporary name.
#[derive(Debug)]
pub struct Partial {
    path: PathBuf,
    partial: PathBuf,
    /// `None` once the file has its final name.
    out: Option<BufWriter<File>>,
    _unfinished: Unfinished,
}

impl Partial {
    /// Begins the file that will be at `path`.
    ///
    /// # Errors
    /// If it cannot be created, or if `path` exists and is not a file.
    pub fn create(path: &Path) -> Result<Self, ScanError> {
        let refused = |what: &str| ScanError::write(path, io::Error::other(what));
        let name = path.file_name().ok_or_else(|| refused("the path names no file"))?;
        // The rename at the end would replace a device by a file, or fail on a folder.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(refused("something other than a file has this name"));
        }
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(".partial");
        let partial = path.with_file_name(hidden);
        let file = open_alone(&partial, "export").map_err(|e| ScanError::write(path, e))?;
        file.set_len(0).map_err(|e| ScanError::write(path, e))?;
        let out = Some(BufWriter::with_capacity(BUFFER_BYTES, file));
        let _unfinished = Unfinished::new(&partial);
        Ok(Self { path: path.to_owned(), partial, out, _unfinished })
    }

    /// Makes the error of a failed write.
    pub fn error(&self, source: io::Error) -> ScanError {
        ScanError::write(&self.path, source)
    }

    /// Overwrites its beginning with `head` and renames it to its final name; returns its size in
    /// bytes.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(mut self, head: &[u8]) -> Result<u64, ScanError> {
        let path = self.path.clone();
        self.commit(head).map_err(|e| ScanError::write(&path, e))
    }

    fn commit(&mut self, head: &[u8]) -> io::Result<u64> {
        self.seek(SeekFrom::Start(0))?;
        self.write_all(head)?;
        let Some(out) = &mut self.out else { return Err(closed()) };
        out.flush()?;
        let file = out.get_ref();
        file.sync_all()?;
        let bytes = file.metadata()?.len();
        // Renamed while it is locked, so that no other program has begun to overwrite it.
        fs::rename(&self.partial, &self.path)?;
        self.out = None;
        Ok(bytes)
    }
}

fn closed() -> io::Error {
    io::Error::other("the file is closed already")
}

impl Write for Partial {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.as_mut().ok_or_else(closed)?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.as_mut().ok_or_else(closed)?.flush()
    }
}

impl Seek for Partial {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.out.as_mut().ok_or_else(closed)?.seek(to)
    }
}

impl Drop for Partial {
    fn drop(&mut self) {
        if let Some(out) = self.out.take() {
            // The buffer is not flushed, as it is of no use. The name is removed while the file is
            // locked; an error of that is ignored, because a file that stays is overwritten by the
            // next program.
            let (file, _) = out.into_parts();
            let _ = fs::remove_file(&self.partial);
            drop(file);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<OsString> {
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name()).collect()
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.ply");
        fs::write(&path, "mine").unwrap();
        let mut partial = Partial::create(&path).unwrap();
        partial.write_all(b"....body").unwrap();
        drop(partial);
        assert_eq!(names(folder.path()), ["out.ply"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
        let mut partial = Partial::create(&path).unwrap();
        partial.write_all(b"....body").unwrap();
        assert_eq!(partial.finish(b"head").unwrap(), 8);
        assert_eq!(names(folder.path()), ["out.ply"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "headbody");
        // The file of a killed program is overwritten; the file of a running one is not.
        fs::write(folder.path().join(".out.ply.partial"), "left by a killed program").unwrap();
        let mut partial = Partial::create(&path).unwrap();
        let error = Partial::create(&path).unwrap_err().to_string();
        assert!(error.contains("another export is writing it"), "{error}");
        partial.write_all(b"....tail").unwrap();
        assert_eq!(partial.finish(b"head").unwrap(), 8);
        assert_eq!(names(folder.path()), ["out.ply"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "headtail");
        let error = Partial::create(folder.path()).unwrap_err().to_string();
        assert!(error.contains("other than a file has this name"), "{error}");
    }
}
