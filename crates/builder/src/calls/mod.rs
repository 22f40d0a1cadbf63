//! What the crate does, as calls: build, append, merge, export, verify; and reading points: one, or
//! those that pass a filter.

pub(crate) mod append;
pub(crate) mod build;
pub(crate) mod closing;
pub(crate) mod export;
mod export_aside;
mod export_colours;
mod export_copc;
mod export_notes;
mod export_tree;
pub(crate) mod merge;
pub(crate) mod metadata;
pub(crate) mod point;
pub(crate) mod query;
mod rounding;
pub(crate) mod selection;
pub(crate) mod verify;
pub(crate) mod verify_export;
mod voxels;
