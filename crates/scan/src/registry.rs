//! Opens inputs: the table of formats that are read, in the order in which they are tried.

use crate::error::ScanError;
use crate::source::{Format, HEAD_BYTES, OpenOptions, Source};
use crate::synthetic;
use esker_points::Task;
use esker_points::place::no_file_at;
use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// All formats. Text is last, because nearly any file could be text.
pub static FORMATS: &[Format] = &[
    crate::las::FORMAT,
    crate::ply::FORMAT,
    crate::pcd::FORMAT,
    crate::e57::FORMAT,
    crate::ptx::FORMAT,
    crate::text::FORMAT,
];

/// First bytes of files that are known but not read, with what to do.
const NAMED: &[(&[u8], &str)] = &[(
    b"\x89ESKER",
    "is an .esker file already; give it to info, verify, render or build --merge",
)];

/// Opens a scan, whose format is recognised by its content, or a generated scan, by its name.
///
/// # Errors
/// If the file cannot be read, is of no known format or is damaged, or if no generated scan has
/// this name.
pub fn open(
    path: &Path,
    options: &OpenOptions,
    task: &dyn Task,
) -> Result<Box<dyn Source>, ScanError> {
    if synthetic::is_spec(path) {
        return synthetic::open(path, options);
    }
    let io = |source| ScanError::io(path, source);
    if let Some(what) = no_file_at(path).map_err(io)? {
        return Err(ScanError::unsupported(path, what));
    }
    let file = File::open(path).map_err(io)?;
    let mut head = Vec::new();
    file.take(HEAD_BYTES).read_to_end(&mut head).map_err(io)?;
    if head.is_empty() {
        return Err(ScanError::damaged(path, "the file is empty"));
    }
    if let Some((_, what)) = NAMED.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Err(ScanError::unsupported(path, *what));
    }
    match FORMATS.iter().find(|f| (f.recognises)(&head)) {
        Some(format) => (format.open)(path, options, task),
        // Who says how to read a text says that it is one.
        None if options.columns.is_some() || options.skip_lines > 0 => {
            (crate::text::FORMAT.open)(path, options, task)
        }
        None => {
            let known: Vec<_> = FORMATS.iter().map(|f| f.name).collect();
            Err(ScanError::UnknownFormat { path: path.to_owned(), known: known.join(", ") })
        }
    }
}

/// Lists the scans directly in a folder, by their file name extensions and sorted by name. Hidden
/// files are skipped.
///
/// # Errors
/// If the folder cannot be read or has no scan.
pub fn scans_in(folder: &Path) -> Result<Vec<PathBuf>, ScanError> {
    let io = |source| ScanError::io(folder, source);
    let mut scans = Vec::new();
    for entry in folder.read_dir().map_err(io)? {
        let path = entry.map_err(io)?.path();
        if has_name_of_scan(&path) && !path.is_dir() {
            scans.push(path);
        }
    }
    scans.sort_by(|a, b| a.file_name().cmp(&b.file_name()));
    if scans.is_empty() {
        let endings: Vec<_> = endings().map(|e| format!(".{e}")).collect();
        let what = format!("is a folder without a scan in it ({})", endings.join(", "));
        return Err(ScanError::unsupported(folder, what));
    }
    Ok(scans)
}

fn endings() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.endings).copied()
}

fn has_name_of_scan(path: &Path) -> bool {
    let text = |part: Option<&OsStr>| part.and_then(OsStr::to_str).unwrap_or_default().to_owned();
    let ending = text(path.extension()).to_ascii_lowercase();
    endings().any(|e| e == ending) && !text(path.file_name()).starts_with('.')
}
