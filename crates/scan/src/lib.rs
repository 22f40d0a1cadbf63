//! Decodes scan formats to columnar batches on the lattice, encodes batches as scan formats
//! ([`mod@write`]), and reads triangle meshes ([`mesh`]). Only this crate knows LAS, LAZ, PLY, PCD,
//! E57, PTX, OBJ and text. Formats are recognised by content, never by file name; only generated
//! scans ([`synthetic`]) and meshes are named, and points of programs ([`given`]) have no file. All
//! but LAS, LAZ and E57 may be compressed as a whole, with zstd or gzip. The grids of the last
//! column are described in `docs/design/scans.md`.
//!
//! | format | what is read | grid of coordinates |
//! |---|---|---|
//! | LAS, LAZ | [`las`] | integers of the file |
//! | PLY | [`ply`]: all scalar properties of `vertex`, ASCII and binary | digits; floats |
//! | PCD | [`pcd`] | digits; floats |
//! | E57 | [`mod@e57`]: all scans, each in its pose | integers of the file; floats |
//! | PTX | [`ptx`]: all scans, each in its pose | digits; floats |
//! | text | [`text`]: XYZ, TXT, CSV, PTS, lines of 3 to 1,024 numbers | digits |

pub mod ahead;
pub mod caught;
mod e57;
mod error;
mod fields;
mod folder;
pub mod given;
pub mod las;
pub mod mesh;
mod packed;
mod pcd;
mod ply;
mod pose;
mod ptx;
mod registry;
mod runs;
pub mod source;
pub mod synthetic;
pub mod system;
mod text;
pub mod write;

pub use self::e57::turns::{Turn, turns};
pub use error::ScanError;
pub use folder::{FolderScans, scans_in};
pub use las::crs::{EpsgCodes, epsg_codes, vertical_name};
pub use las::geodetic::Geographic;
pub use registry::open;
pub use source::SourceInfo;
pub use source::{BESIDE_HELD_BYTES, Crs, Format, Guess, OpenOptions, ReadReport, Scanner, Source};
pub use text::{Column, Columns};
