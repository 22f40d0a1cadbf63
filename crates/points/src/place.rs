//! Tests what a path names before it is opened: a pipe without a writer blocks whoever opens it,
//! and a device may never end. Also opens the files that a writer owns under a name that others can
//! guess, without following links that they planted there; the lock gives each file one writer.

use std::fs::{File, FileType, Metadata, OpenOptions, TryLockError};
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

/// Opens a file to read and write it, and never what a link of that name leads to.
///
/// # Errors
/// [`io::ErrorKind::NotFound`] if there is no such file; if it is a link or no regular file.
pub fn open_own(path: &Path) -> io::Result<File> {
    check_own(&path.symlink_metadata()?)?;
    let file = OpenOptions::new().read(true).write(true).open(path)?;
    // The name may have become a link since it was examined; nothing was changed yet.
    if is_still_at(&file, path) { Ok(file) } else { Err(not_own()) }
}

/// Creates a file, in place of one or a link of that name; never writes to an existing file.
///
/// # Errors
/// If it cannot be created.
pub fn create_own(path: &Path) -> io::Result<File> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    OpenOptions::new().read(true).write(true).create_new(true).open(path)
}

/// Whether an open file is the one with this name, and not one that a link leads to. Always true on
/// systems that do not say.
pub fn is_own(file: &File, path: &Path) -> bool {
    is_still_at(file, path)
}

/// Refuses links, other kinds of files, and files that have a second name.
fn check_own(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_file() && names(metadata) == 1 { Ok(()) } else { Err(not_own()) }
}

fn not_own() -> io::Error {
    io::Error::other(
        "the hidden file that is written first is a link, or no file of Esker: remove it (ls -a shows it), or choose another output",
    )
}

/// Opens a file for one writer, with the contents that an earlier writer left, or creates it; never
/// opens what a link of that name leads to. `work` names the writer's task in the error of a second
/// one (`build`).
///
/// # Errors
/// If another writer has the file, it cannot be created, or it is a link.
pub fn open_alone(path: &Path, work: &str) -> io::Result<File> {
    let start = Instant::now();
    loop {
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let file = match path.symlink_metadata() {
            Ok(metadata) => {
                check_own(&metadata)?;
                options.open(path)
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => options.create_new(true).open(path),
            Err(e) => return Err(e),
        };
        let file = match file {
            // Another writer has created or removed it since.
            Err(e)
                if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::AlreadyExists)
                    && start.elapsed() < PATIENCE =>
            {
                continue;
            }
            file => file?,
        };
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
    let identity = |m: Metadata| (m.dev(), m.ino());
    match (file.metadata(), path.symlink_metadata()) {
        (Ok(a), Ok(b)) => identity(a) == identity(b),
        _ => false,
    }
}

/// Number of names of a file.
#[cfg(unix)]
fn names(metadata: &Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(metadata)
}

#[cfg(not(unix))]
fn names(_metadata: &Metadata) -> u64 {
    1
}

#[cfg(not(unix))]
fn is_still_at(_file: &File, _path: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn planted_links_are_neither_followed_nor_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let [victim, planted] = ["victim", "planted"].map(|name| folder.path().join(name));
        std::fs::write(&victim, "precious").unwrap();
        let is_kept = || std::fs::read_to_string(&victim).unwrap() == "precious";
        std::os::unix::fs::symlink(&victim, &planted).unwrap();
        open_own(&planted).unwrap_err();
        let error = open_alone(&planted, "build").unwrap_err().to_string();
        assert!(error.contains("is a link") && is_kept(), "{error}");
        create_own(&planted).unwrap().set_len(3).unwrap();
        assert!(is_kept());
        assert_eq!(open_own(&planted).unwrap().metadata().unwrap().len(), 3);
        // A second name of the victim is as bad as a link.
        std::fs::remove_file(&planted).unwrap();
        std::fs::hard_link(&victim, &planted).unwrap();
        open_alone(&planted, "build").unwrap_err();
        open_own(&planted).unwrap_err();
        // Links to nothing, which creating a file would follow.
        std::fs::remove_file(&planted).unwrap();
        std::os::unix::fs::symlink(folder.path().join("nothing"), &planted).unwrap();
        open_alone(&planted, "build").unwrap_err();
        create_own(&planted).unwrap();
        assert!(!folder.path().join("nothing").exists() && is_kept());
        drop(open_alone(&folder.path().join("new"), "build").unwrap());
    }

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
