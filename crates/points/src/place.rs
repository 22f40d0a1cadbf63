//! Tests what a path names before it is opened: a pipe without a writer blocks whoever opens it,
//! and a device may never end. Also the lock that gives a file that is being written to one writer.

use std::fs::{File, FileType, OpenOptions, TryLockError};
use std::io;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// Message about anything but a file at `path`, with what to do; `None` if it is a file.
///
/// # Errors
/// If there is nothing at `path`, or the system refuses.
pub fn no_file_at(path: &Path) -> io::Result<Option<&'static str>> {
    let kind = path.metadata()?.file_type();
    Ok(match kind {
        _ if kind.is_file() => None,
        _ if kind.is_dir() => Some("is a folder; name the files in it"),
        _ => Some(special(kind)),
    })
}

#[cfg(unix)]
fn special(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    match () {
        () if kind.is_fifo() => {
            "is a pipe, not a file: save what comes out of it to a file first, and name that"
        }
        () if kind.is_socket() => "is a socket, not a file",
        () => "is a device, not a file: save what it holds to a file first, and name that",
    }
}

#[cfg(not(unix))]
fn special(_kind: FileType) -> &'static str {
    "is no file: save what it holds to a file first, and name that"
}

/// Longest wait for another writer: one that was just killed takes a moment to release the lock.
const PATIENCE: Duration = Duration::from_secs(1);

/// Opens a file for one writer, with the contents that an earlier writer left. `work` names the
/// writer's task in the error of a second one (`build`).
///
/// # Errors
/// If another writer has the file, or it cannot be created.
pub fn open_alone(path: &Path, work: &str) -> io::Result<File> {
    let start = Instant::now();
    loop {
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) if start.elapsed() < PATIENCE => {
                thread::sleep(PATIENCE / 100);
                continue;
            }
            Err(TryLockError::WouldBlock) => {
                return Err(io::Error::other(format!(
                    "another {work} is writing it; wait for its end, or choose another output"
                )));
            }
            // Not every file system supports locks.
            Err(TryLockError::Error(e)) if e.kind() != io::ErrorKind::Unsupported => return Err(e),
            _ => {}
        }
        if is_still_at(&file, path) {
            return Ok(file);
        }
    }
}

/// Whether an open file still has this name: otherwise another writer has finished or removed it.
#[cfg(unix)]
fn is_still_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |m: std::fs::Metadata| (m.dev(), m.ino());
    match (file.metadata(), path.metadata()) {
        (Ok(a), Ok(b)) => identity(a) == identity(b),
        _ => false,
    }
}

#[cfg(not(unix))]
fn is_still_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn anything_but_a_file_is_refused_by_its_kind() {
        let folder = std::env::temp_dir();
        assert!(no_file_at(&folder).unwrap().unwrap().contains("folder"));
        let program = std::env::current_exe().unwrap();
        assert_eq!(no_file_at(&program).unwrap(), None);
        no_file_at(&program.join("nowhere")).unwrap_err();
        #[cfg(unix)]
        assert!(no_file_at(Path::new("/dev/null")).unwrap().unwrap().contains("device"));
    }
}
