//! Interface of all readers: what is known of an input before its points are decoded, and its
//! points as batches on the lattice, in the file's order. A new format is a module with one
//! [`Format`] and a line in [`crate::registry`].

use crate::error::ScanError;
use crate::text::Columns;
use esker_points::lattice::Placement;
use esker_points::{AttrType, Batch, ColourDepth, InputGrid, Rounding, Schema, Spread, Task};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes at the beginning of a file from which its format is recognised. Text may begin with many
/// comments or with one long line of names.
pub(crate) const HEAD_BYTES: u64 = 64 << 10;

/// Greatest number of points in a batch: small enough for a cache, large enough that the overhead
/// of a batch does not matter.
pub const BATCH_POINTS: usize = 1 << 16;

/// Note on scans that the reader numbers: readers do not know of each other.
pub(crate) const SCAN_NUMBERS: &str = "point_source_id is the number of the scan within this file, \
    from 1: scans of other files may have the same numbers";

/// Note on an input of which one in `one_in` points is read.
pub(crate) fn share_note(one_in: u32) -> String {
    format!("one in {one_in} of its points is read, for a preview")
}

/// A scan format, an entry of the registry.
pub struct Format {
    /// Name in messages: `LAS`, `PLY` ...
    pub name: &'static str,
    /// File name extensions, lower-case, by which scans are found in a folder.
    pub endings: &'static [&'static str],
    /// Whether it is read from front to back, so that compressed files can be read, too.
    pub is_streamed: bool,
    /// Whether a share of the points may be read without the others ([`OpenOptions::one_in`]),
    /// unless a file is compressed as a whole.
    pub can_sample: bool,
    /// Whether a file that begins with these bytes (up to 64 KiB) is of this format.
    pub recognises: fn(head: &[u8]) -> bool,
    /// Opens a file of this format.
    pub open: Open,
}

/// Opens a file; may decode a part of it to fill in [`SourceInfo`].
pub type Open =
    fn(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError>;

/// Options of the user for an input.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// Bit depth of 16-bit colour fields; overrides the detected one.
    pub colour_depth: Option<ColourDepth>,
    /// Memory for everything while inputs are read, in bytes. If absent, a few dozen MiB and what
    /// the format needs.
    pub memory_bytes: Option<u64>,
    /// Whether the points and normals of a PCD file are transformed by the pose in its header.
    pub apply_viewpoint: bool,
    /// Coordinate reference system of inputs that state none.
    pub crs: Option<Crs>,
    /// Name of the unit of length of inputs that state none, as in [`Crs::unit`].
    pub unit: Option<String>,
    /// Which column of text files is which; overrides what the files tell.
    pub columns: Option<Columns>,
    /// Lines at the beginning of text files that are passed over.
    pub skip_lines: u64,
    /// Of how many points about one is read, spread over the whole input, for a preview; 0 and 1
    /// for all. Inputs that cannot be read in part are refused.
    pub one_in: u32,
}

/// Memory that everything except [`Source::held_bytes`] takes while inputs are read, in bytes:
/// batches and the least amount of rows.
pub const BESIDE_HELD_BYTES: u64 = 128 << 20;

/// What is known of an input before its points are decoded.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// Path as given by the user.
    pub path: PathBuf,
    /// Format, version and variant: `LAZ 1.4, point format 6`.
    pub format: String,
    /// Kind, grid and bounds of the coordinates.
    pub grid: InputGrid,
    /// Attributes in canonical order.
    pub schema: Arc<Schema>,
    /// Number of points that the header claims; only a hint.
    pub points_hint: u64,
    /// Size of the input, in bytes.
    pub bytes: u64,
    /// Bit depth of the values in 16-bit colour fields, detected from the first points or
    /// overridden; `None` without such fields. After reading, [`ReadReport::colour_max`] shows
    /// whether it was right.
    pub colour_depth: Option<ColourDepth>,
    /// The coordinate reference system, if the input has one.
    pub crs: Option<Crs>,
    /// Position of the scanner, if it is known.
    pub scanner: Option<Scanner>,
    /// Blocks of the source kept verbatim: name and bytes of header, VLRs and EVLRs.
    pub verbatim: Vec<(String, Vec<u8>)>,
    /// What is left out and why, a line each: faces, waveform packets ...
    pub notes: Vec<String>,
}

/// A guess at what an input means, which the user should see before the points are used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Guess {
    /// What is missing in the input, and what is assumed.
    pub what: String,
    /// The first points as they stand in the input.
    pub rows: Vec<String>,
    /// How the user states what is right.
    pub remedy: String,
}

/// A coordinate reference system as the source writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crs {
    /// OGC WKT, or the GeoTIFF keys in readable form (`GeoTIFF: ProjectedCSType=2154 ...`); empty
    /// if only the unit is known.
    pub text: String,
    /// Unit of length, if the CRS names it: `metre`, `US survey foot`, `foot`, `degree`.
    pub unit: Option<String>,
}

/// Positions of the scanner, in the file's coordinates.
#[derive(Clone, Debug, PartialEq)]
pub enum Scanner {
    /// All points were scanned from one position.
    At([f64; 3]),
    /// Positions by the `point_source_id` of the points.
    BySource(BTreeMap<u16, [f64; 3]>),
}

impl Scanner {
    /// Position from which points of this `point_source_id` were scanned.
    pub fn of(&self, point_source_id: Option<u16>) -> Option<[f64; 3]> {
        match self {
            Self::At(place) => Some(*place),
            Self::BySource(places) => places.get(&point_source_id?).copied(),
        }
    }
}

/// Outcome of reading an input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadReport {
    /// Points passed to the sink, including those outside of the lattice.
    pub points: u64,
    /// Refused points, by reason (`coordinate is not a number` ...).
    pub refused: BTreeMap<String, u64>,
    /// Greatest rounding of a coordinate along one axis, in the file's unit.
    pub rounding_error_max: f64,
    /// Greatest value in 16-bit colour fields; 0 without such fields.
    pub colour_max: u16,
    /// Findings while decoding, a line each: the true count if the header is wrong ...
    pub notes: Vec<String>,
}

impl ReadReport {
    /// Passes `batch` to `sink` and adds it to the report, with the number of points that were
    /// `refused` for each reason, what placing it changed, and the greatest 16-bit colour.
    pub(crate) fn take(
        &mut self,
        mut batch: Batch,
        refused: &[(&str, u64)],
        rounding: Rounding,
        colour_max: u16,
        sink: &mut Sink<'_>,
    ) -> Result<(), ScanError> {
        for &(reason, points) in refused.iter().filter(|(_, points)| *points > 0) {
            *self.refused.entry(reason.to_owned()).or_default() += points;
        }
        self.points += batch.len() as u64;
        self.rounding_error_max = self.rounding_error_max.max(rounding.error_max);
        batch.outside = rounding.outside;
        self.colour_max = self.colour_max.max(colour_max);
        if batch.is_empty() { Ok(()) } else { sink(batch) }
    }
}

/// Consumer of batches in the file's order. An error ends the reading, which returns it.
pub type Sink<'a> = dyn FnMut(Batch) -> Result<(), ScanError> + 'a;

/// An opened input.
pub trait Source: Send + Sync {
    /// What is known of the input.
    fn info(&self) -> &SourceInfo;

    /// Decodes all points once, in order, on the lattice of `placement`, into batches of at most
    /// [`BATCH_POINTS`] points that have all attributes of the schema. Points outside of the
    /// lattice are among them: see [`Batch::outside`]. Uses the threads of the current rayon pool
    /// if the format allows; calls `sink` only on the calling thread. Whatever the file claims,
    /// memory stays bounded by a few dozen MiB plus [`Source::held_bytes`].
    ///
    /// # Errors
    /// [`ScanError::Cancelled`]; otherwise what is wrong with the file. After an error, points that
    /// were passed to `sink` before are void.
    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError>;

    /// Number of the last point, at most `point`, at which [`Source::read_range`] can begin: 0 if
    /// the input can only be read whole. The number of points is then [`SourceInfo::points_hint`].
    fn begin_near(&self, _point: u64) -> u64 {
        0
    }

    /// Decodes a range of the points as [`Source::read`] decodes all. It begins where
    /// [`Source::begin_near`] says, and ends where another can begin, or with the last point.
    ///
    /// # Errors
    /// As for [`Source::read`]; if the input can only be read whole.
    fn read_range(
        &self,
        _points: Range<u64>,
        _placement: &Placement,
        _task: &dyn Task,
        _sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError> {
        let what = "its points cannot be read in ranges";
        Err(ScanError::unsupported(&self.info().path, what))
    }

    /// Computes the true distribution of all points by decoding the file; called if the lattice
    /// that its bounds need does not hold its points, or is coarser than its coordinates.
    ///
    /// # Errors
    /// [`ScanError::Cancelled`], or what is wrong with the file.
    fn survey(&self, task: &dyn Task) -> Result<Spread, ScanError>;

    /// Most memory that is held at once while the source is read, in bytes: a large compressed
    /// chunk whose decoder needs all of it.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// Whether points are lines of text, which take several times as long to decode as others.
    fn is_text(&self) -> bool {
        false
    }

    /// Attributes, as indices in the schema, whose types were chosen by the values of this input
    /// alone: another input may have values under the same name that need a wider type.
    fn typed_by_values(&self) -> Vec<usize> {
        Vec::new()
    }

    /// Changes the type of an attribute of [`Source::typed_by_values`] to a wider one
    /// ([`AttrType::wider`]).
    fn widen(&mut self, _attribute: usize, _ty: AttrType) {}

    /// The guess at the meaning of the input, if it does not tell.
    fn guess(&self) -> Option<&Guess> {
        None
    }
}
