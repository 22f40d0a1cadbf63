//! Scan formats to columnar batches on the lattice. The only crate that knows LAS, LAZ, PLY and text.
//! The format is told by content, never by the name.

pub mod error;
pub mod registry;
pub mod source;

pub use error::ScanError;
pub use registry::open;
pub use source::{Crs, Format, OpenOptions, ReadReport, Source, SourceInfo};
