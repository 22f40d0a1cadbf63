//! Trees over discs and triangles, and their traversal.

pub mod bounds;
pub(crate) mod disc;
pub(crate) mod simple;
pub(crate) mod triangle;

pub use bounds::Bounds;
