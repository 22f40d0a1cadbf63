//! Interface of the writers of all formats: outline and sources of an export, the traits of an
//! encoder and of an output, and the encoded points that pass between them.

use crate::error::ScanError;
use crate::source::{Crs, SourceInfo};
use esker_points::lattice::GridKind;
use esker_points::{Batch, Column, Lattice, Schema};
use std::sync::Arc;

/// What an export restores of a source of its points.
#[derive(Clone, Debug)]
pub struct Origin {
    /// Kind of grid of its coordinates.
    pub kind: GridKind,
    /// Its coordinate reference system.
    pub crs: Option<Crs>,
    /// Its blocks kept verbatim, as in [`SourceInfo::verbatim`].
    pub verbatim: Vec<(String, Vec<u8>)>,
}

impl From<&SourceInfo> for Origin {
    fn from(info: &SourceInfo) -> Self {
        Self { kind: info.grid.kind, crs: info.crs.clone(), verbatim: info.verbatim.clone() }
    }
}

impl Origin {
    pub(crate) fn block(&self, name: &str) -> Option<&[u8]> {
        self.verbatim.iter().find(|(n, _)| n == name).map(|(_, bytes)| bytes.as_slice())
    }
}

/// What is known of an export before its first point.
#[derive(Clone, Debug)]
pub struct Outline {
    /// The lattice of all coordinates.
    pub lattice: Lattice,
    /// The attributes of all batches; values are zero where a point lacks an attribute.
    pub schema: Arc<Schema>,
    /// Greatest number of points.
    pub points_max: u64,
    /// Least and greatest value of each attribute; empty or `None` where they are not known.
    pub ranges: Vec<Option<(f64, f64)>>,
    /// For each class of points, the attributes that its points have; empty where that is not
    /// known, and points may have all.
    pub classes: Vec<Vec<usize>>,
}

impl Outline {
    /// Whether some points have both of these attributes.
    pub(crate) fn has_both(&self, a: usize, b: usize) -> bool {
        let both = |class: &Vec<usize>| class.contains(&a) && class.contains(&b);
        self.classes.is_empty() || self.classes.iter().any(both)
    }

    /// Whether all values of an attribute are known to lie within this range.
    pub(crate) fn is_within(&self, attribute: usize, low: f64, high: f64) -> bool {
        let range = self.ranges.get(attribute).copied().flatten();
        range.is_some_and(|(least, greatest)| low <= least && greatest <= high)
    }
}

/// Sources one after the other: their blocks may be large, so only one is held at a time.
pub type Origins<'a> = dyn Iterator<Item = Result<Origin, ScanError>> + 'a;

/// The points of a batch as bytes of the file.
#[derive(Clone, Debug, Default)]
pub struct Encoded {
    /// Number of points.
    pub points: u64,
    /// Their bytes.
    pub bytes: Vec<u8>,
    /// Least and greatest lattice coordinates, if the header of the format has them.
    pub(crate) bounds: Option<[[u32; 3]; 2]>,
    /// Number of points by return number, from 1, if the header of the format has them.
    pub(crate) by_return: [u64; 15],
}

/// Encodes batches; called on any thread.
pub trait Encode: Send + Sync {
    /// Encodes a batch that has the outline's attributes.
    fn encode(&self, batch: &Batch) -> Encoded;

    /// Encodes points at `places` in world coordinates, which no lattice holds, with `columns` as
    /// those of a batch; `None` if the format does not hold them exactly.
    fn encode_outside(&self, _places: &[[f64; 3]], _columns: &[Column]) -> Option<Encoded> {
        None
    }
}

/// Writes encoded points in order. If it is dropped before [`Output::finish`], no file is left.
pub trait Output: Send {
    /// Appends points; compresses on the current rayon pool if the format does.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn put(&mut self, points: Encoded) -> Result<(), ScanError>;

    /// What was changed in the points written so far, a line each.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Writes the remaining bytes, flushes them to the disk and renames the file to its final name;
    /// returns its size in bytes.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn finish(self: Box<Self>) -> Result<u64, ScanError>;
}

/// A file that is being written.
pub struct Export {
    /// Encodes its batches.
    pub encode: Arc<dyn Encode>,
    /// Writes the encoded points.
    pub output: Box<dyn Output>,
    /// The format, version and variant: `LAS 1.4, point format 7`.
    pub format: String,
    /// For each attribute, the index of its field. If one attribute is converted to the field of
    /// another, both have the same index.
    pub fields: Vec<usize>,
    /// Differences from the sources, a line each.
    pub notes: Vec<String>,
}
