//! Scan formats to columnar batches on the lattice, and back ([`mod@write`]). The only crate that knows LAS, LAZ, PLY and text.
//! The format is told by content, never by the name; only generated scans ([`synthetic`]) are named.
//!
//! | format | what is read | coordinates |
//! |---|---|---|
//! | LAS, LAZ | see [`las`] | the file's integers |
//! | PLY | ASCII, binary of both byte orders, also compressed with zstd: all scalar properties of `vertex` | binary: the grid for floats; ASCII: the digits of the text, where they fit |
//! | text | XYZ, TXT, CSV: lines of 3 to 1,024 numbers, with or without a line of names | the digits of the text |
//!
//! PCD, PTS and PTX are known by their content and refused by name.

pub mod ahead;
pub mod caught;
pub mod error;
pub mod las;
pub mod ply;
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
