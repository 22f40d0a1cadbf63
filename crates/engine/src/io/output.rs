//! What is to be written is looked at before the work, not after it: a missing folder, a folder in
//! place of a file, an input that would be replaced, a file of another kind that would be.

use crate::io::file::is_esker;
use anyhow::{Context, Result, ensure};
use std::path::{Path, PathBuf};

/// Checks that an output can be written.
///
/// # Errors
/// If `path` is a folder, is one of `inputs`, or is in no folder.
pub fn may_write(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    let shown = path.display();
    if let Ok(place) = path.canonicalize() {
        ensure!(!place.is_dir(), "{shown}: is a folder; name a file in it");
        ensure!(
            place.is_file(),
            "{shown}: something that is no file has this name; choose another"
        );
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

/// Checks that an `.esker` file can be written to `path`: it may replace another one, or an empty
/// file, so that a mistyped name does not cost a scan.
///
/// # Errors
/// If [`may_write`] fails, or `path` is a file of another kind.
pub fn may_build(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    may_write(path, inputs)?;
    let holds_something = path.metadata().is_ok_and(|m| m.is_file() && m.len() > 0);
    ensure!(
        !holds_something || is_esker(path)?,
        "{}: is there already, and is no .esker file: choose another output, or remove it first",
        path.display()
    );
    Ok(())
}

/// Checks that an output is none of the scans that an `.esker` file in a folder was built from, by
/// the paths that were given then.
///
/// # Errors
/// If the output is one of these scans.
pub fn may_replace<'a>(
    path: &Path,
    folder: &Path,
    mut scans: impl Iterator<Item = &'a str>,
) -> Result<()> {
    let Ok(place) = path.canonicalize() else { return Ok(()) };
    let is_it = |scan: &Path| scan.canonicalize().is_ok_and(|scan| scan == place);
    let scan = scans.find(|scan| is_it(Path::new(scan)) || is_it(&folder.join(scan)));
    ensure!(
        scan.is_none(),
        "{}: has the name of one of the scans that the file was built from; choose another output, or remove it first",
        path.display()
    );
    Ok(())
}

/// A folder for what is built to be drawn or measured alone, which goes with it: in the one that
/// the user has named for such, else in the system's.
///
/// # Errors
/// Where none can be made.
pub fn temporary(scratch: Option<&Path>) -> Result<tempfile::TempDir> {
    let folder = scratch.map_or_else(std::env::temp_dir, Path::to_owned);
    tempfile::tempdir_in(&folder).with_context(|| {
        let folder = folder.display();
        format!("{folder}: cannot make a temporary folder in it to build the scan in; name another by --scratch")
    })
}

/// The folder that a file lies in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
