//! Builds an `.esker` file from scans within a memory bound: decodes, partitions, builds chunks and
//! the cells above them bottom-up, writes the file and proves that no point was lost. Also appends,
//! merges, exports and verifies. Meets the crates that draw only in the file. The phases are
//! described in `docs/design/building.md`.

pub mod attributes;
pub mod budget;
pub(crate) mod calls;
pub mod copc;
pub(crate) mod error;
pub(crate) mod input;
pub mod jobs;
pub(crate) mod options;
pub(crate) mod page;
#[cfg(test)]
mod random;
pub(crate) mod rows;
pub(crate) mod sample;
pub(crate) mod tree;

pub use attributes::normals::NormalsMode;
pub use budget::shares::Shares;
pub use calls::append::{append, append_sources};
pub use calls::build::{Wrap, build, build_shared, build_sources, build_wrapped};
pub use calls::export::{ExportOptions, export, export_with};
pub use calls::merge::merge;
pub use calls::point::{ExactPoint, ExactValue, exact_point};
pub use calls::query::{Query, QueryPoints, points_at};
pub use calls::selection::Exported;
pub use calls::verify::{Against, against, against_forest, against_sources};
pub use calls::verify_export::{ExportVerified, verify_export};
pub use error::BuildError;
pub use input::outside::{NO_VALUE, OFF_LATTICE};
pub use options::{Inherited, Merged, Options, Report, Resume};
