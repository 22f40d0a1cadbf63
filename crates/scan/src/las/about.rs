//! What is known of a LAS file from its header and records, however its points are read.

use super::header::{Header, format_bytes};
use super::points::Layout;
use super::vlr::Records;
use super::{crs, extra_bytes};
use crate::error::ScanError;
use crate::source::SourceInfo;
use esker_points::lattice::GridKind;
use esker_points::{Attribute, InputGrid};
use std::path::Path;
use std::sync::Arc;

/// Name of files whose points are compressed.
pub const FORMAT_NAME: &str = "LAZ";
/// Bytes read as the header; that of 1.5 has 393.
pub const HEAD_BYTES: u64 = 512;
/// Greatest number of extra bytes of a record: each may become an attribute of its own, and
/// LASzip's models for each take up to 12 KiB a thread. Real files have a few dozen.
pub const EXTRA_BYTES_MAX: usize = 1024;

/// Attributes of the extra bytes of a record.
///
/// # Errors
/// If there are too many of them.
pub fn extra_attributes(
    header: &Header,
    records: &Records,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<Attribute>, ScanError> {
    let extra = header.record_bytes - format_bytes(header.point_format).unwrap_or(0);
    if extra > EXTRA_BYTES_MAX {
        let what = format!("{extra} extra bytes a point; {EXTRA_BYTES_MAX} are read at most");
        return Err(ScanError::unsupported(path, what));
    }
    Ok(extra_bytes::attributes(records, extra, notes))
}

/// What is known of a file but for the depth of its colours.
pub fn source_info(
    path: &Path,
    format: String,
    header: &Header,
    layout: &Layout,
    bytes: u64,
    (records, mut notes): (Records, Vec<String>),
) -> SourceInfo {
    if matches!(header.point_format, 4 | 5 | 9 | 10) {
        notes.push("waveform packets are not kept (the fields that point to them are)".into());
    }
    SourceInfo {
        path: path.to_owned(),
        format,
        grid: InputGrid {
            name: path.display().to_string(),
            kind: GridKind::Integer,
            grid: header.grid,
            bounds: (header.points > 0).then_some(header.bounds),
        },
        schema: Arc::clone(&layout.schema),
        points_hint: header.points,
        bytes,
        colour_depth: None,
        crs: crs::of(&records, &mut notes),
        scanner: None,
        verbatim: records.verbatim,
        notes,
    }
}
