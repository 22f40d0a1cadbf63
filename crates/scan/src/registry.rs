//! Opens inputs: the table of formats that are read, in the order in which they are tried.

use crate::error::ScanError;
use crate::packed::head_of;
use crate::source::{Format, OpenOptions, Source};
use crate::synthetic;
use crate::system::located;
use esker_points::Task;
use esker_points::place::no_file_at;
use esker_points::read_at::is_remote;
use std::path::Path;

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
const NAMED: &[(&[u8], &str)] = &[
    (b"\x89ESKER", "is an .esker file already; give it to info, verify, render or build --merge"),
    (b"PK\x03\x04", "is a ZIP archive; unpack it first"),
    (b"7z\xBC\xAF\x27\x1C", "is a 7z archive; unpack it first"),
    (b"\xFD7zXZ\x00", "is compressed with xz; unpack it first"),
    (b"BZh", "is compressed with bzip2; unpack it first"),
];

/// The format of a file that begins with `head`, decompressed.
pub(crate) fn format_of(head: &[u8]) -> Option<&'static Format> {
    FORMATS.iter().find(|format| (format.recognises)(head))
}

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
        if options.one_in > 1 {
            return Err(ScanError::unsupported(path, "generated scans cannot be made in part"));
        }
        return synthetic::open(path, options);
    }
    let io = |source| ScanError::io(path, source);
    if !is_remote(path)
        && let Some(what) = no_file_at(path).map_err(io)?
    {
        return Err(ScanError::unsupported(path, what));
    }
    let (head, packing) = head_of(path)?;
    if head.is_empty() {
        return Err(ScanError::damaged(path, "the file is empty"));
    }
    if let Some((_, what)) = NAMED.iter().find(|(magic, _)| head.starts_with(magic)) {
        return Err(ScanError::unsupported(path, *what));
    }
    match (format_of(&head), packing) {
        (Some(format), _) if is_remote(path) && format.name != crate::las::FORMAT.name => {
            let what = format!(
                "is {}, and only LAS and LAZ are read at addresses: download it first",
                format.name
            );
            Err(ScanError::unsupported(path, what))
        }
        (Some(format), Some(packing)) if !format.is_streamed => {
            let what = format!(
                "is {} compressed with {}, which is not read; unpack it first",
                format.name,
                packing.name()
            );
            Err(ScanError::unsupported(path, what))
        }
        (Some(format), _) if options.one_in > 1 && !format.can_sample => {
            let what = format!("{} files cannot be read in part", format.name);
            Err(ScanError::unsupported(path, what))
        }
        (Some(_), Some(packing)) if options.one_in > 1 => {
            let what = format!("cannot be read in part: it is compressed with {}", packing.name());
            Err(ScanError::unsupported(path, what))
        }
        (Some(format), _) => Ok(located((format.open)(path, options, task)?, options)),
        // Who says how to read a text says that it is one.
        (None, _) if options.columns.is_some() || options.skip_lines > 0 => {
            Ok(located((crate::text::FORMAT.open)(path, options, task)?, options))
        }
        (None, packing) => {
            let mut known: Vec<_> = FORMATS.iter().map(|f| f.name).collect();
            if packing.is_some() {
                known = FORMATS.iter().filter(|f| f.is_streamed).map(|f| f.name).collect();
            }
            Err(ScanError::UnknownFormat { path: path.to_owned(), known: known.join(", ") })
        }
    }
}
