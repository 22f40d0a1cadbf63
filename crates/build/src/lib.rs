//! From scans to an .esker file under a memory bound: intake, partition, chunks bottom-up, levels above,
//! the file, and the proof that no point was lost; and from the file back to a scan. Meets the runtime only in the file.

pub mod against;
pub mod append;
mod borders;
pub mod build;
mod candidates;
mod chunk;
mod coincident;
mod contour;
pub mod crs;
pub mod density;
mod eigen;
pub mod error;
pub mod export;
mod gather;
mod intake;
mod levels;
pub mod memory;
pub mod merge;
mod nearest;
mod neighbours;
pub mod normals;
pub mod onto;
mod order;
mod partition;
mod rest;
mod row;
mod sample;
mod scratch;
mod shape;
mod sort;
mod space;
mod spacing;
mod stored;
mod thin;
mod tree;
mod turn;

pub use against::{Against, against, against_sources};
pub use append::{append, append_sources};
pub use build::{Options, Report, Shares, build, build_shared, build_sources};
pub use error::BuildError;
pub use export::{Exported, export};
pub use merge::merge;
pub use normals::NormalsMode;
pub use onto::Onto;
