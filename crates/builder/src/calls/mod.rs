//! What the crate does, as calls: build, append, merge, export, verify.

pub(crate) mod append;
pub(crate) mod build;
pub(crate) mod export;
mod export_colours;
pub(crate) mod merge;
mod metadata;
pub(crate) mod verify;
