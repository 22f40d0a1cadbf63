//! Resources of a build: memory, its shares, and disk space.

pub(crate) mod disk;
pub mod memory;
pub(crate) mod shares;
