//! What the writers of all formats share: the outline and the sources of an export, the traits of
//! an encoder and of an output, and the encoded points between them.

use crate::error::ScanError;
use crate::source::{Crs, SourceInfo};
use esker_points::lattice::GridKind;
use esker_points::{Batch, Lattice, Schema};
use std::sync::Arc;

/// What is known of a source that points come from: what of it can be restored.
#[derive(Clone, Debug)]
pub struct Origin {
    /// Kind of numbers of its coordinates.
    pub kind: GridKind,
    /// Its coordinate reference system.
    pub crs: Option<Crs>,
    /// Its blocks kept verbatim, as [`SourceInfo::verbatim`] has them.
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

/// What is to be written, known before the first point.
#[derive(Clone, Debug)]
pub struct Outline {
    /// The lattice of all coordinates.
    pub lattice: Lattice,
    /// The attributes of all batches; a batch has zeros where a point lacks one.
    pub schema: Arc<Schema>,
    /// Points at most.
    pub points_max: u64,
}

/// Sources one after the other: their blocks may be large, so that only one is held at a time.
pub type Origins<'a> = dyn Iterator<Item = Result<Origin, ScanError>> + 'a;

/// The points of a batch in a file's form.
#[derive(Clone, Debug, Default)]
pub struct Encoded {
    /// Number of points.
    pub points: u64,
    /// Their bytes.
    pub bytes: Vec<u8>,
    /// Least and greatest lattice coordinates, where the format tells them.
    pub(crate) bounds: Option<[[u32; 3]; 2]>,
    /// Points by number of return, from the first on, where the format tells them.
    pub(crate) by_return: [u64; 15],
}

/// Makes bytes of batches; called on any thread.
pub trait Encode: Send + Sync {
    /// The points of a batch that has the outline's attributes.
    fn encode(&self, batch: &Batch) -> Encoded;
}

/// Takes points in order. What is dropped before [`Output::finish`] leaves nothing behind.
pub trait Output: Send {
    /// Appends points; compresses on the current rayon pool where the format does.
    ///
    /// # Errors
    /// Where the disk is full.
    fn put(&mut self, points: Encoded) -> Result<(), ScanError>;

    /// Writes what is left, puts it on the disk and gives the file its name; its bytes.
    ///
    /// # Errors
    /// Where the disk is full.
    fn finish(self: Box<Self>) -> Result<u64, ScanError>;
}

/// A file that is being written.
pub struct Export {
    /// Makes bytes of batches.
    pub encode: Arc<dyn Encode>,
    /// Takes them.
    pub output: Box<dyn Output>,
    /// The format, version and variant: `LAS 1.4, point format 7`.
    pub format: String,
    /// For each attribute, the field that it goes to; where one is converted to another, they have
    /// the same.
    pub fields: Vec<usize>,
    /// What is not as in the sources, a line each.
    pub notes: Vec<String>,
}
