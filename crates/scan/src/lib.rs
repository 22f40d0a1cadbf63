//! Scan formats to columnar batches on the lattice, and back ([`mod@write`]). The only crate that
//! knows LAS, LAZ, PLY, PCD, E57, PTX and text. The format is told by content, never by the name;
//! only generated scans ([`synthetic`]) are named.
//!
//! | format | what is read | coordinates |
//! |---|---|---|
//! | LAS, LAZ | see [`las`] | the file's integers |
//! | PLY | ASCII, binary of both byte orders, also compressed with zstd: all scalar properties of `vertex` | binary: the grid for floats; ASCII: the digits of the text, where they fit |
//! | PCD | see [`pcd`] | as of PLY |
//! | E57 | see [`mod@e57`]: all scans, each in its pose | the file's integers where all scans share a grid and none is turned, else the grid for floats |
//! | PTX | see [`ptx`]: all scans, each in its pose | the digits of the text where none is turned, else the grid for floats |
//! | text | XYZ, TXT, CSV, PTS: lines of 3 to 1,024 numbers, with or without a line of names, or after their count | the digits of the text |

pub mod ahead;
mod bounds;
pub mod caught;
pub mod e57;
pub mod error;
pub mod las;
pub mod pcd;
pub mod ply;
pub mod ptx;
pub mod registry;
pub mod source;
pub mod synthetic;
pub mod text;
pub mod write;

pub use error::ScanError;
pub use las::crs::{Codes, codes};
pub use registry::{open, scans_in};
pub use source::SourceInfo;
pub use source::{BESIDE_HELD_BYTES, Crs, Format, OpenOptions, ReadReport, Scanner, Source};
