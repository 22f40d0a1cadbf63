//! What a reader of a scan format gives: what it knows before decoding, and its points as batches
//! on the lattice, in the file's order. A new format is one file with one [`Format`] and one line
//! in [`crate::registry`].

use crate::error::ScanError;
use esker_points::lattice::Placement;
use esker_points::{Batch, ColourDepth, InputGrid, Schema, Task};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes at the beginning of a file from which its format is detected: text may begin with many
/// comments, or with one long line of names.
pub(crate) const HEAD_BYTES: u64 = 64 << 10;

/// Points in a batch at most: small enough for a cache, large enough that calls cost nothing.
pub const BATCH_POINTS: usize = 1 << 16;

/// A scan format, as the registry knows it.
pub struct Format {
    /// Its name in messages: `LAS`, `PLY` ...
    pub name: &'static str,
    /// What names of such files end in, lower-case. Only in a folder are scans told by their names.
    pub endings: &'static [&'static str],
    /// Whether a file that begins with these bytes (up to 64 KiB) is of this format.
    pub recognises: fn(head: &[u8]) -> bool,
    /// Opens a file of this format.
    pub open: Open,
}

/// Opens a file; may decode some of it to learn what [`SourceInfo`] tells.
pub type Open =
    fn(path: &Path, options: &OpenOptions, task: &dyn Task) -> Result<Box<dyn Source>, ScanError>;

/// What the user may say about an input.
#[derive(Clone, Debug, Default)]
pub struct OpenOptions {
    /// Overrides what was detected of 16-bit colour fields.
    pub colour_depth: Option<ColourDepth>,
    /// Memory that all together may take while inputs are read, in bytes; a few dozen MiB and what
    /// a format needs where not said.
    pub memory_bytes: Option<u64>,
}

/// What all but [`Source::held_bytes`] takes while inputs are read: batches, and the least of what
/// is made of them.
pub const BESIDE_HELD_BYTES: u64 = 128 << 20;

/// What is known of an input before its points are decoded.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// As given by the user.
    pub path: PathBuf,
    /// Format, version and variant: `LAZ 1.4, point format 6`.
    pub format: String,
    /// Kind, grid and bounds of its coordinates.
    pub grid: InputGrid,
    /// Attributes in canonical order.
    pub schema: Arc<Schema>,
    /// Number of points that the header claims; a hint only.
    pub points_hint: u64,
    /// Bytes of the input.
    pub bytes: u64,
    /// What its 16-bit colour fields hold, where it has such: detected from its first points or
    /// overridden. [`ReadReport::colour_max`] tells afterwards whether that was right.
    pub colour_depth: Option<ColourDepth>,
    /// The coordinate reference system, where the input tells it.
    pub crs: Option<Crs>,
    /// Where its points were scanned from, where that is known.
    pub scanner: Option<Scanner>,
    /// Blocks of the source kept verbatim: header, VLRs, EVLRs (name and bytes).
    pub verbatim: Vec<(String, Vec<u8>)>,
    /// What is left out and why, one line each (faces ignored, waveform packets not kept ...).
    pub notes: Vec<String>,
}

/// A coordinate reference system as the source writes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crs {
    /// OGC WKT, or the GeoTIFF keys in readable form (`GeoTIFF: ProjectedCSType=2154 ...`).
    pub text: String,
    /// Unit of length where the CRS tells it: `metre`, `US survey foot`, `foot`, `degree`.
    pub unit: Option<String>,
}

/// Where points were scanned from, in the file's coordinates.
#[derive(Clone, Debug, PartialEq)]
pub enum Scanner {
    /// All from one place.
    At([f64; 3]),
    /// By the point's `point_source_id`.
    BySource(BTreeMap<u16, [f64; 3]>),
}

impl Scanner {
    /// The place that points of this `point_source_id` were scanned from.
    pub fn of(&self, point_source_id: Option<u16>) -> Option<[f64; 3]> {
        match self {
            Self::At(place) => Some(*place),
            Self::BySource(places) => places.get(&point_source_id?).copied(),
        }
    }
}

/// What became of the points of an input.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadReport {
    /// Points handed over.
    pub points: u64,
    /// Points refused, by reason (`coordinate is not a number` ...).
    pub refused: BTreeMap<String, u64>,
    /// Greatest distance by which a coordinate was rounded, along one axis, in the file's unit.
    pub rounding_error_max: f64,
    /// Greatest value in 16-bit colour fields; 0 where there are none.
    pub colour_max: u16,
    /// What was noticed while decoding (the true count where the header is wrong ...), a line each.
    pub notes: Vec<String>,
}

impl ReadReport {
    /// Counts what was read of a part of an input, and hands its points over: how many others were
    /// refused for which reason, and the greatest rounding and 16-bit colour among them.
    pub(crate) fn take(
        &mut self,
        batch: Batch,
        refused: &[(&str, u64)],
        rounding_error_max: f64,
        colour_max: u16,
        sink: &mut Sink<'_>,
    ) -> Result<(), ScanError> {
        for &(reason, points) in refused.iter().filter(|(_, points)| *points > 0) {
            *self.refused.entry(reason.to_owned()).or_default() += points;
        }
        self.points += batch.len() as u64;
        self.rounding_error_max = self.rounding_error_max.max(rounding_error_max);
        self.colour_max = self.colour_max.max(colour_max);
        if batch.is_empty() { Ok(()) } else { sink(batch) }
    }
}

/// Takes batches in the file's order. An error ends the reading and is returned by it.
pub type Sink<'a> = dyn FnMut(Batch) -> Result<(), ScanError> + 'a;

/// An opened input.
pub trait Source: Send + Sync {
    /// What is known of it.
    fn info(&self) -> &SourceInfo;

    /// Decodes all points once, in order, on the lattice of `placement`, into batches of at most
    /// [`BATCH_POINTS`] points that have all attributes of the schema. Uses the cores of the
    /// current rayon pool where the format allows; calls `sink` from this thread only. Memory stays
    /// bounded by a few dozen MiB beside [`Source::held_bytes`] whatever the file claims.
    ///
    /// # Errors
    /// [`ScanError::OffLattice`] where a point does not fit the lattice (its header's bounds lied);
    /// [`ScanError::Cancelled`]; otherwise what is wrong with the file. Points handed over before
    /// an error are void.
    fn read(
        &self,
        placement: &Placement,
        task: &dyn Task,
        sink: &mut Sink<'_>,
    ) -> Result<ReadReport, ScanError>;

    /// The true bounds of all points, by decoding the file (called only after
    /// [`ScanError::OffLattice`]); `None` where there is no point.
    ///
    /// # Errors
    /// As [`Source::read`].
    fn survey(&self, task: &dyn Task) -> Result<Option<[[f64; 3]; 2]>, ScanError>;

    /// Bytes of memory that it holds at once at most while it is read: a large compressed chunk
    /// whose decoder needs all of it.
    fn held_bytes(&self) -> u64 {
        0
    }
}
