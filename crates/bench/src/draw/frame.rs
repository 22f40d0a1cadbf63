//! What both backends draw, and what they return: a frame of single points without attributes, its
//! times and the pixels that it covered.

use esker_lod::View;
use esker_points::{Lattice, Node};
use esker_render::{ColourPlane, DrawNode, Frame, Method};

/// Number of pixels that a frame drew points to; `None` if it has no frame buffer.
pub(super) type Covered = Option<u64>;

/// Times of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Times {
    /// Time from its submission to its completion, milliseconds.
    pub wall_ms: f64,
    /// Time of its passes by the GPU's clock, if the GPU has one, milliseconds.
    pub gpu_ms: Option<f64>,
}

/// Draws all points of `node`, with no plane but their positions.
pub(super) fn draw_of<P>(node: &Node, position: P) -> DrawNode<'_, P> {
    DrawNode {
        node,
        entry: 0,
        prefix: node.points(),
        above: 0.0,
        position,
        residual: None,
        colour: ColourPlane::None,
        normal: None,
        clip: None,
        tangents: None,
    }
}

/// A frame of single points.
pub(super) fn frame_of<'a, P>(
    view: &'a View,
    lattice: &'a Lattice,
    draws: &'a [DrawNode<'a, P>],
) -> Frame<'a, P> {
    Frame { method: Method::Points, ..Frame::new(view, lattice, draws) }
}
