//! Scans in a folder. In: the folder; out: the files directly in it that are scans, by the ends of
//! their names and, for text, by their content, and all others with the reason why they are left
//! out. Tables that lie beside scans (lists of files, trajectories) must never be mixed in.
//!
//! A file whose name says that it is a scan is one, damaged or not. Text is a scan if its first
//! lines are points like those of the rest of the folder ([`table`]).

mod rest;
mod table;

use crate::error::ScanError;
use crate::packed::{ENDINGS, head_of};
use crate::registry::{FORMATS, format_of};
use esker_points::place::no_file_at;
use rest::Rest;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use table::{LISTS_OF_FILES, Table};

/// Names of files in a note on those that are left out, for each reason.
const NAMES_MAX: usize = 3;

/// What a folder holds.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderScans {
    /// The scans, sorted by name.
    pub scans: Vec<PathBuf>,
    /// The names of all other files, by the reason why they are left out.
    pub left_out: BTreeMap<String, Vec<String>>,
}

impl FolderScans {
    fn leave_out(&mut self, path: &Path, why: impl Into<String>) {
        self.left_out.entry(why.into()).or_default().push(name_of(path));
    }

    /// What is left out, in one line: for each reason the number of files and some names. `None` if
    /// nothing is.
    pub fn left_out_text(&self) -> Option<String> {
        let reasons = self.left_out.iter().map(|(why, files)| {
            let shown: Vec<_> = files.iter().take(NAMES_MAX).map(String::as_str).collect();
            let more = match files.len() - shown.len() {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            format!("{why}: {}{more}", shown.join(", "))
        });
        let reasons: Vec<_> = reasons.collect();
        (!reasons.is_empty()).then(|| reasons.join("; "))
    }
}

/// Lists the scans directly in a folder, sorted by name, and what is left out. Hidden files and
/// `.prj` files are skipped.
///
/// # Errors
/// If the folder cannot be read or has no scan.
pub fn scans_in(folder: &Path) -> Result<FolderScans, ScanError> {
    let io = |source| ScanError::io(folder, source);
    let mut files = Vec::new();
    for entry in folder.read_dir().map_err(io)? {
        let path = entry.map_err(io)?.path();
        // Hidden files, and systems of the scans beside them.
        let name = name_of(&path);
        if !name.starts_with('.') && !name.to_ascii_lowercase().ends_with(".prj") {
            files.push(path);
        }
    }
    files.sort_by(|a, b| a.file_name().cmp(&b.file_name()));
    let mut found = FolderScans::default();
    let mut tables = Vec::new();
    for path in files {
        match kind_of(&path) {
            Kind::Scan => found.scans.push(path),
            Kind::Table(table) => tables.push((path, table)),
            Kind::Other(why) => found.leave_out(&path, why),
        }
    }
    let rest = Rest::new(&found.scans, &tables);
    for (path, table) in tables {
        match rest.why_not(&table) {
            None => found.scans.push(path),
            Some(why) => found.leave_out(&path, why),
        }
    }
    found.scans.sort_by(|a, b| a.file_name().cmp(&b.file_name()));
    found.left_out.values_mut().for_each(|names| names.sort());
    if found.scans.is_empty() {
        let endings: Vec<_> = endings().map(|e| format!(".{e}")).collect();
        let endings = endings.join(", ");
        let what = match found.left_out_text() {
            None => format!("is a folder without a file in it ({endings})"),
            Some(others) => format!("is a folder without a scan in it ({endings}): {others}"),
        };
        return Err(ScanError::unsupported(folder, what));
    }
    Ok(found)
}

/// What a file is, by its name and its first lines.
enum Kind {
    Scan,
    /// Text that may be points.
    Table(Table),
    /// No scan, and why.
    Other(String),
}

fn kind_of(path: &Path) -> Kind {
    if path.is_dir() {
        return Kind::Other("folders".into());
    }
    // Reading a pipe or a device might never end.
    if matches!(no_file_at(path), Ok(Some(_))) {
        return Kind::Other("no files".into());
    }
    let Some(ending) = ending_of(path) else {
        return Kind::Other("not named as scans".into());
    };
    if !crate::text::FORMAT.endings.contains(&ending) {
        return Kind::Scan;
    }
    // What cannot be read is a scan with an error.
    let Ok((head, _)) = head_of(path) else { return Kind::Scan };
    match format_of(&head) {
        _ if head.is_empty() => Kind::Other("empty text files".into()),
        None => match Table::of(&head, path) {
            Err(why @ LISTS_OF_FILES) => Kind::Other(why.into()),
            _ => Kind::Other("text without points".into()),
        },
        Some(format) if format.name != crate::text::FORMAT.name => Kind::Scan,
        Some(_) => match Table::of(&head, path) {
            Ok(table) => Kind::Table(table),
            Err(why) => Kind::Other(why.into()),
        },
    }
}

fn endings() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.endings).copied()
}

/// The extension of a scan in the name of a file, in any case and without that of a compression.
fn ending_of(path: &Path) -> Option<&'static str> {
    let name = name_of(path).to_ascii_lowercase();
    let packed = ENDINGS.iter().find_map(|e| name.strip_suffix(e)?.strip_suffix('.'));
    let (_, ending) = packed.unwrap_or(&name).rsplit_once('.')?;
    endings().find(|e| *e == ending)
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}
