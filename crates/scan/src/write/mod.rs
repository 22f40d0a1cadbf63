//! Writes batches on the lattice as scan formats, the inverse of the readers. A format has two
//! parts: [`Encode`] encodes a batch, on any thread; [`Output`] writes the encoded batches in
//! order, and what precedes and follows them. No points are kept, so a file of any size takes the
//! memory of a few batches. LAS and LAZ are described in [`las`], COPC, which is written voxel by
//! voxel, in [`las::copc`].
//!
//! | format | coordinates | attributes |
//! |---|---|---|
//! | LAS, LAZ | integers, scale and offset of the lattice | fields of the record, extra bytes |
//! | PLY, binary | `float` if all sources had it, else `double` | properties; `double` if scaled |
//! | text (XYZ, TXT, CSV) | all decimals of the lattice | columns, in the fewest exact digits |

mod coordinates;
mod encode;
pub mod las;
mod numbers;
pub(crate) mod partial;
mod ply;
mod scaling;
mod stated;
mod text;
mod unique;

use crate::error::ScanError;
use std::path::Path;

pub use encode::{Encode, Encoded, Export, Origin, Origins, Outline, Output};
pub use text::PointText;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// LAS; keeps version and point format of the sources if they are LAS.
    Las,
    /// LAS, compressed.
    Laz,
    /// PLY.
    Ply,
    /// Columns separated by blanks.
    Text,
    /// Columns separated by commas.
    Csv,
}

impl Target {
    /// Whether it is LAS, compressed or not.
    pub fn is_las(self) -> bool {
        matches!(self, Self::Las | Self::Laz)
    }

    /// The format of a file name's extension.
    ///
    /// # Errors
    /// If the extension is not that of a format that is written.
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
                "its ending names no format that is written: name it .las, .laz, .copc.laz, .ply, .xyz, .txt or .csv",
            )),
        }
    }
}

/// Begins the file that will be at `path`.
///
/// # Errors
/// If the file cannot be written or the format cannot hold the attributes.
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
