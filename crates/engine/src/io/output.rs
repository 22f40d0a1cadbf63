//! Checks of outputs before any work: a missing folder, a folder in place of a file, an input or a
//! file of another kind that would be replaced.

use crate::io::file::is_esker;
use anyhow::{Context, Result, ensure};
use esker_points::read_at::{self, is_remote};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Refuses an output that would replace one of `inputs`, or cannot be written.
///
/// # Errors
/// If `path` is `-`, a folder, not a regular file, one of `inputs`, or in a folder that does not
/// exist.
pub fn may_write(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    let shown = path.display();
    ensure!(
        path != Path::new("-"),
        "-: standard output cannot be written to; name a file (./- for one of that name)"
    );
    if let Ok(place) = path.canonicalize() {
        ensure!(!place.is_dir(), "{shown}: is a folder; name a file in it");
        ensure!(
            place.is_file(),
            "{shown}: something other than a file has this name; choose another"
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

/// Refuses an output as [`may_write`] does, and a file that is neither empty nor an `.esker` file:
/// a mistyped name, or one that a shell has completed, must not cost a scan.
///
/// # Errors
/// If `path` is such an output.
pub fn may_build(path: &Path, inputs: &[PathBuf]) -> Result<()> {
    may_write(path, inputs)?;
    let holds_something = path.metadata().is_ok_and(|m| m.is_file() && m.len() > 0);
    refuse_others(!holds_something || is_esker(path)?, path)
}

/// Refuses an output of a divided build as [`may_build`] does, also one at an address.
///
/// # Errors
/// If `path` is such an output; for an address, if it cannot be looked whether a file is there.
pub fn may_join(path: &Path) -> Result<()> {
    if !is_remote(path) {
        return may_build(path, &[]);
    }
    match read_at::open(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(()),
        _ => refuse_others(is_esker(path)?, path),
    }
}

fn refuse_others(is_esker: bool, path: &Path) -> Result<()> {
    ensure!(
        is_esker,
        "{}: is there already, and is no .esker file: choose another output, or remove it first",
        path.display()
    );
    Ok(())
}

/// Refuses an output of an export that is there already: it may be a scan, of which there is no
/// other copy.
///
/// # Errors
/// If `path` is a file that is not empty.
pub fn may_create(path: &Path) -> Result<()> {
    let holds_something = path.metadata().is_ok_and(|m| m.is_file() && m.len() > 0);
    ensure!(
        !holds_something,
        "{}: is there already: choose another output, or replace it with --overwrite",
        path.display()
    );
    Ok(())
}

/// Refuses an output that would replace a scan which an `.esker` file in `folder` was built from;
/// `scans` are the paths as they were given to the build.
///
/// # Errors
/// If `path` is one of `scans`.
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

/// A temporary folder for files that are built to be drawn or measured once: in `scratch`, or in
/// the folder of the system. Dropping it removes it.
///
/// # Errors
/// If the folder cannot be made.
pub fn temporary(scratch: Option<&Path>) -> Result<tempfile::TempDir> {
    let folder = scratch.map_or_else(std::env::temp_dir, Path::to_owned);
    tempfile::tempdir_in(&folder).with_context(|| {
        let folder = folder.display();
        format!("{folder}: cannot make a temporary folder in it to build the scan in; name another by --scratch")
    })
}

/// Folder of a file.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}
