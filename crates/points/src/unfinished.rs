//! Hidden files of outputs that are not finished. They are removed when their writer is dropped;
//! where a program has to end without that, because memory has run out or on a second Ctrl-C, it
//! removes all that are listed here.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

static FILES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
static ARE_KEPT: AtomicBool = AtomicBool::new(false);

/// An unfinished file, listed until this is dropped.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Lists a file.
    pub fn new(path: &Path) -> Self {
        FILES.lock().unwrap_or_else(PoisonError::into_inner).push(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut files = FILES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = files.iter().position(|path| *path == self.0) {
            files.swap_remove(at);
        }
    }
}

/// Sets that [`remove_all`] leaves everything, because a later run can go on with it.
pub fn keep_all() {
    ARE_KEPT.store(true, Relaxed);
}

/// Removes the listed files, just before the program ends. Neither allocates nor waits.
pub fn remove_all() {
    if ARE_KEPT.load(Relaxed) {
        return;
    }
    if let Ok(files) = FILES.try_lock() {
        files.iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_removed_while_they_are_listed() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        [&a, &b].into_iter().for_each(|path| std::fs::write(path, "half").unwrap());
        let (listed, finished) = (Unfinished::new(&a), Unfinished::new(&b));
        drop(finished);
        remove_all();
        assert!(!a.exists() && b.exists());
        drop(listed);
    }
}
