//! What stands at a path where a file is asked for. Whoever opens one that was named asks first: a pipe that nobody
//! writes to lets whoever opens it wait for ever, a device may never end. And the lock by which a file that is being
//! written is one writer's.

use std::fs::{File, FileType, OpenOptions, TryLockError};
use std::io;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

/// What stands at `path` in place of a file, and what to do; `None` where it is a file.
///
/// # Errors
/// Where nothing stands there, or the system does not say.
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

/// How long another writer is waited for: one that was just killed takes a moment to be gone.
const PATIENCE: Duration = Duration::from_secs(1);

/// Opens a file for this writer alone, with what an earlier one left in it; another that has it is told by an error, by
/// what it does (`build`).
///
/// # Errors
/// As said; where the file cannot be made.
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
            // Not every file system knows locks.
            Err(TryLockError::Error(e)) if e.kind() != io::ErrorKind::Unsupported => return Err(e),
            _ => {}
        }
        if stands_at(&file, path) {
            return Ok(file);
        }
    }
}

/// Whether an open file still has this name: else another writer has finished or dropped it meanwhile.
#[cfg(unix)]
fn stands_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |m: std::fs::Metadata| (m.dev(), m.ino());
    match (file.metadata(), path.metadata()) {
        (Ok(a), Ok(b)) => identity(a) == identity(b),
        _ => false,
    }
}

#[cfg(not(unix))]
fn stands_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_files_and_what_else_there_is_is_named() {
        let folder = std::env::temp_dir();
        assert!(no_file_at(&folder).unwrap().unwrap().contains("folder"));
        let program = std::env::current_exe().unwrap();
        assert_eq!(no_file_at(&program).unwrap(), None);
        no_file_at(&program.join("nowhere")).unwrap_err();
        #[cfg(unix)]
        assert!(no_file_at(Path::new("/dev/null")).unwrap().unwrap().contains("device"));
    }
}
