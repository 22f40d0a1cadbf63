//! The octree, built bottom-up: chunks, the cells above them, finished nodes, and the proof.

pub(crate) mod chunk;
pub(crate) mod finishing;
pub(crate) mod levels;
pub(crate) mod pages;
pub(crate) mod parting;
pub(crate) mod pipeline;
pub(crate) mod proof;
pub(crate) mod subtree;
pub(crate) mod waiting;
