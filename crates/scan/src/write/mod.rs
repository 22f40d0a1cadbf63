//! Batches on the lattice to scan formats, the way back of the readers. A format is two parts:
//! [`Encode`] makes bytes of a batch, on any thread; [`Output`] takes them in order, and writes
//! what stands before and behind them. Nothing is kept of the points, so a file of any size takes
//! the memory of a few batches.
//!
//! | format | coordinates | attributes |
//! |---|---|---|
//! | LAS, LAZ | the lattice's integers; scale and offset are the lattice's | the record's fields, others as extra bytes; see [`las`] |
//! | PLY, binary little-endian | `float` where all sources were, else `double` | properties of their name and type; with a scale or an offset `double`, as they are shown |
//! | text (XYZ, TXT, CSV) | the lattice's decimals, all digits | columns of their name, in the fewest digits that keep the value, with a scale or an offset as they are shown |

mod coordinates;
mod encode;
pub mod las;
mod numbers;
mod partial;
mod ply;
mod shown;
mod text;
mod unique;

use crate::error::ScanError;
use std::path::Path;

pub use encode::{Encode, Encoded, Export, Origin, Origins, Outline, Output};

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
