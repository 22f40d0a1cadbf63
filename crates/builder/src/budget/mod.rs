//! What a build may use: memory, how it is shared out, and space on disks.

pub(crate) mod disk;
pub mod memory;
pub(crate) mod shares;
