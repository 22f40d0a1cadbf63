//! What is to be written is looked at before the work, not after it: a missing folder, a folder in place of a
//! file, an input that would be replaced.

use anyhow::{Result, ensure};
use std::path::{Path, PathBuf};

/// Refuses an output that would replace what it is made from, or that has no place.
///
/// # Errors
/// As said.
pub fn may_write(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    let shown = path.display();
    if let Ok(place) = path.canonicalize() {
        ensure!(!place.is_dir(), "{shown}: is a folder; name a file in it");
        let same = inputs.iter().any(|i| i.canonicalize().is_ok_and(|i| i == place));
        ensure!(!same, "{shown}: is input and output at once; choose another output");
    }
    let folder = folder_of(path);
    ensure!(
        folder.is_dir(),
        "{shown}: cannot write it: there is no folder {}; make it first",
        folder.display()
    );
    Ok(())
}

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
