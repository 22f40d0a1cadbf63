//! The tables of what is drawn, as the shaders read them (`shaders/common/draws.wgsl`): nodes, and equal
//! chunks of their points. One dispatch goes over all chunks, never one over a node.

use crate::same_layout;
use bytemuck::{Pod, Zeroable};

/// Points of a chunk.
pub const CHUNK_POINTS: u32 = 4096;
/// The page of a plane that is not there.
pub const NO_PAGE: u32 = u32::MAX;

/// A place in drawing memory: one range of addresses from 0, cut into pages that no plane straddles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneAt {
    /// Its first byte, a multiple of 4.
    pub offset: u64,
    /// Bytes.
    pub bytes: u64,
}

/// A drawn node.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Draw {
    /// As in [`crate::camera::NodePlace`].
    pub base_high: [i32; 3],
    /// Bits that hot positions drop.
    pub shift: u32,
    /// As in [`crate::camera::NodePlace`].
    pub base_low: [i32; 3],
    /// Points drawn.
    pub points: u32,
    /// As in [`crate::camera::NodePlace`].
    pub bias_steps: [f32; 3],
    /// Typical distance of the node's points, the file's unit.
    pub spacing: f32,
    /// Least lattice coordinates.
    pub box_min: [u32; 3],
    /// Its place in the compact octree.
    pub entry: u32,
    /// Page of the positions.
    pub position_page: u32,
    /// Their first word in it.
    pub position_word: u32,
    /// Page of the dropped bits, or [`NO_PAGE`].
    pub residual_page: u32,
    /// Their first word in it.
    pub residual_word: u32,
    /// Page of the colours or values, or [`NO_PAGE`].
    pub colour_page: u32,
    /// Their first word in it.
    pub colour_word: u32,
    /// Page of the normals, or [`NO_PAGE`].
    pub normal_page: u32,
    /// Their first word in it.
    pub normal_word: u32,
    /// Log2 of its cell's edge.
    pub cell_log2: u32,
    /// Its first chunk.
    pub chunk: u32,
    /// To a whole multiple of 16 bytes.
    pub unused_a: u32,
    /// To a whole multiple of 16 bytes.
    pub unused_b: u32,
}

/// A run of a node's points.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Chunk {
    /// The node, in the table of draws.
    pub draw: u32,
    /// First point, in the node.
    pub first: u32,
    /// Points, at most [`CHUNK_POINTS`].
    pub points: u32,
    /// To a whole multiple of 16 bytes.
    pub unused: u32,
}

same_layout!(Draw {
    base_high,
    shift,
    base_low,
    points,
    bias_steps,
    spacing,
    box_min,
    entry,
    position_page,
    position_word,
    residual_page,
    residual_word,
    colour_page,
    colour_word,
    normal_page,
    normal_word,
    cell_log2,
    chunk
});
same_layout!(Chunk { draw, first, points });
