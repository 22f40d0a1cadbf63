//! From scans to an .esker file under a memory bound: intake, partition, chunks bottom-up, levels
//! above, the file, and the proof that no point was lost; and from the file back to a scan. Meets
//! the runtime only in the file.

pub mod attributes;
pub mod budget;
pub mod calls;
pub(crate) mod error;
pub(crate) mod input;
pub(crate) mod page;
#[cfg(test)]
mod random;
pub(crate) mod rows;
pub(crate) mod sample;
pub(crate) mod tree;

pub use attributes::normals::NormalsMode;
pub use budget::shares::Shares;
pub use calls::append::{append, append_sources};
pub use calls::build::{Options, Report, build, build_shared, build_sources};
pub use calls::export::{Exported, export};
pub use calls::merge::merge;
pub use calls::onto::Onto;
pub use calls::verify::{Against, against, against_forest, against_sources};
pub use error::BuildError;
pub use rows::journal::Resume;
