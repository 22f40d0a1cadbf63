//! Trees over discs and triangles: eight children a node, eight primitives a leaf, tested at once.
//! `hilbert.rs` orders primitives, `tree.rs` builds the implicit tree over that order, `refine.rs`
//! builds a better one in more time, `walk.rs` follows a ray through either, and `discs.rs` has the
//! queries on scans. `disc.rs` and `triangle.rs` are the leaves.

pub(crate) mod bounds;
pub(crate) mod disc;
pub(crate) mod discs;
pub(crate) mod hilbert;
pub(crate) mod node;
pub(crate) mod refine;
pub(crate) mod tree;
pub(crate) mod triangle;
pub(crate) mod walk;

pub use bounds::Bounds;
pub use disc::{DiscLeaf, Tint};
pub use node::{EMPTY, LEAF, Node};
pub use tree::{Kind, Tree};
pub use triangle::TriangleLeaf;

/// Children of a node, and primitives of a leaf.
pub const WIDTH: usize = 8;
