//! A file under a temporary name beside its final one, which it gets when all of it is on the disk.
//! Dropped before that, it leaves nothing behind; what a killed program left is the next one's to
//! write over. It is locked until it has its name, so that no two write it.

use crate::error::ScanError;
use esker_points::place::open_alone;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes gathered before the file is written to.
const BUFFER_BYTES: usize = 1 << 20;

/// The file.
#[derive(Debug)]
pub struct Partial {
    path: PathBuf,
    partial: PathBuf,
    /// `None` once it has its name.
    out: Option<BufWriter<File>>,
}

impl Partial {
    /// Begins a file that will stand at `path`.
    ///
    /// # Errors
    /// Where it cannot be made, or something that is no file has the name.
    pub fn create(path: &Path) -> Result<Self, ScanError> {
        let refused = |what: &str| ScanError::write(path, io::Error::other(what));
        let name = path.file_name().ok_or_else(|| refused("the path names no file"))?;
        // The rename at the end would put a file in the place of a device or fail on a folder.
        if path.metadata().is_ok_and(|m| !m.is_file()) {
            return Err(refused("something that is no file has this name"));
        }
        let mut hidden = OsString::from(".");
        hidden.push(name);
        hidden.push(".partial");
        let partial = path.with_file_name(hidden);
        let file = open_alone(&partial, "export").map_err(|e| ScanError::write(path, e))?;
        file.set_len(0).map_err(|e| ScanError::write(path, e))?;
        let out = Some(BufWriter::with_capacity(BUFFER_BYTES, file));
        Ok(Self { path: path.to_owned(), partial, out })
    }

    /// An error of writing it.
    pub fn error(&self, source: io::Error) -> ScanError {
        ScanError::write(&self.path, source)
    }

    /// Writes `head` over its beginning, gives it its name; its bytes.
    ///
    /// # Errors
    /// Where the disk is full.
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
        // While it is locked, so that nobody else has begun to write over it.
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
            // Without flushing: what is buffered is of no use. The name goes while the file is
            // locked; whether it does changes nothing.
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
        // What a killed program left is written over; what another one writes is not.
        fs::write(folder.path().join(".out.ply.partial"), "left by a killed program").unwrap();
        let mut partial = Partial::create(&path).unwrap();
        let error = Partial::create(&path).unwrap_err().to_string();
        assert!(error.contains("another export is writing it"), "{error}");
        partial.write_all(b"....tail").unwrap();
        assert_eq!(partial.finish(b"head").unwrap(), 8);
        assert_eq!(names(folder.path()), ["out.ply"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "headtail");
        let error = Partial::create(folder.path()).unwrap_err().to_string();
        assert!(error.contains("no file has this name"), "{error}");
    }
}
