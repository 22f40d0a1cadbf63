//! What the crate does, as calls: build, append, merge, export, verify; and one exact
//! point.

pub(crate) mod append;
pub(crate) mod build;
pub(crate) mod export;
mod export_aside;
mod export_colours;
mod export_notes;
pub(crate) mod merge;
mod metadata;
pub(crate) mod point;
mod rounding;
pub(crate) mod verify;
