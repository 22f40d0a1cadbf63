//! Batches on the lattice to scan formats, the way back of the readers. A format is two parts: [`Encode`] makes
//! bytes of a batch, on any thread; [`Output`] takes them in order, and writes what stands before and behind
//! them. Nothing is kept of the points, so a file of any size takes the memory of a few batches.
//!
//! | format | coordinates | attributes |
//! |---|---|---|
//! | LAS, LAZ | the lattice's integers; scale and offset are the lattice's | the record's fields, others as extra bytes; see [`las`] |
//! | PLY, binary little-endian | `float` where all sources were, else `double` | properties of their name and type; with a scale or an offset `double`, as they are shown |
//! | text (XYZ, TXT, CSV) | the lattice's decimals, all digits | columns of their name, in the fewest digits that keep the value, with a scale or an offset as they are shown |

mod coordinates;
pub mod las;
mod numbers;
mod partial;
mod ply;
mod shown;
mod text;
mod unique;

use crate::error::ScanError;
use crate::source::{Crs, SourceInfo};
use esker_points::lattice::GridKind;
use esker_points::{Batch, Lattice, Schema};
use std::path::Path;
use std::sync::Arc;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// LAS, the version and point format of the sources where they are LAS.
    Las,
    /// The same, compressed.
    Laz,
    /// PLY.
    Ply,
    /// Columns between blanks.
    Text,
    /// Columns between commas.
    Csv,
}

impl Target {
    /// The format that a file's ending names.
    ///
    /// # Errors
    /// Where it names none that is written.
    pub fn of(path: &Path) -> Result<Self, ScanError> {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        match ending.to_ascii_lowercase().as_str() {
            "las" => Ok(Self::Las),
            "laz" => Ok(Self::Laz),
            "ply" => Ok(Self::Ply),
            "xyz" | "txt" => Ok(Self::Text),
            "csv" => Ok(Self::Csv),
            _ => Err(ScanError::unsupported(
                path,
                "its ending names no format that is written: name it .las, .laz, .ply, .xyz, .txt or .csv",
            )),
        }
    }
}

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
    fn block(&self, name: &str) -> Option<&[u8]> {
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
    bounds: Option<[[u32; 3]; 2]>,
    /// Points by number of return, from the first on, where the format tells them.
    by_return: [u64; 15],
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
    /// For each attribute, the field that it goes to; where one is converted to another, they have the same.
    pub fields: Vec<usize>,
    /// What is not as in the sources, a line each.
    pub notes: Vec<String>,
}

/// Begins a file that will stand at `path`.
///
/// # Errors
/// Where the file cannot be written, or the format cannot hold the attributes.
pub fn create(
    path: &Path,
    target: Target,
    outline: &Outline,
    origins: &mut Origins<'_>,
) -> Result<Export, ScanError> {
    match target {
        Target::Las => las::create(path, outline, origins, false),
        Target::Laz => las::create(path, outline, origins, true),
        Target::Ply => ply::create(path, outline, origins),
        Target::Text => text::create(path, outline, origins, false),
        Target::Csv => text::create(path, outline, origins, true),
    }
}
