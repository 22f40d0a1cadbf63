//! From planes to the renderer's frame: the one place where nodes of a cut, wherever their planes lie,
//! become what is drawn. Shared by pictures read whole and by sessions that stream.

use crate::colour::Colouring;
use esker_format::{Forest, PlaneKind};
use esker_lod::{CompactOctree, View};
use esker_points::Node;
use esker_render::{Background, ColourPlane, DrawNode, Frame, Method};

/// A node of the cut, whose `entry` is its place in it, with the planes that `plane` gives.
pub fn draw_node<'a, P: Default>(
    node: &'a Node,
    entry: usize,
    prefix: usize,
    colouring: &Colouring,
    plane: impl Fn(PlaneKind) -> Option<P>,
) -> DrawNode<'a, P> {
    let colour = match colouring.plane.and_then(|(kind, ty)| Some((plane(kind)?, ty))) {
        Some((bytes, None)) => ColourPlane::Rgba(bytes),
        Some((bytes, Some(ty))) => ColourPlane::Scalar { bytes, ty },
        None => ColourPlane::None,
    };
    DrawNode {
        node,
        entry,
        prefix,
        position: plane(PlaneKind::Position).unwrap_or_default(),
        residual: plane(PlaneKind::Residual),
        colour,
        normal: plane(PlaneKind::Normal),
    }
}

/// The frame of these nodes, with the habits of all of Esker's pictures: points that look away are
/// dropped from surfaces of clouds whose normals tell front from back.
pub fn frame<'a, P>(
    file: &'a Forest,
    view: &'a View,
    draws: &'a [DrawNode<'a, P>],
    octree: &'a CompactOctree,
    colouring: &Colouring,
    method: Method,
) -> Frame<'a, P> {
    Frame {
        view,
        lattice: file.lattice(),
        draws,
        octree: Some(octree),
        method,
        colour: colouring.by,
        cull_back_faces: file.has_oriented_normals() && method == Method::PullPush,
        background: Background::default(),
    }
}
