//! A folder of a trial's own, gone when the trial ends, and what lies in it.

use std::path::PathBuf;

/// The folder.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// A new one, empty.
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A file's path in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A file of this text in it.
    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        let path = self.file(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    /// The names of all files in it, hidden ones too.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> =
            entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}
