//! How far points crowd: whether several share a pixel, and are averaged
//! ([`crate::passes::average`]). Judged point by point, from the distance of points on the picture
//! and the foreshortening of their node; a pixel carries it in the last bits of its radius.
//! [`crate::FramePlan::new`] uses the sum over a view.

use crate::frame::{DrawNode, Frame, Method};
use esker_lod::{CompactOctree, OrientedBox, View};
use esker_points::{Lattice, Node};

/// Points crowd where they are closer together than about 0.85 pixels, with foreshortening: one to
/// two points share a pixel then. They begin to count at the first of these distances and count
/// fully from the second on, so that a picture does not change at once when the view moves.
pub const CROWDED_PX: [f32; 2] = [1.0, 0.7];

/// Least share of a node's face that is taken to be seen: contours may be flatter than their
/// points.
const FACING_MIN: f64 = 0.04;

/// How far a view is crowded: 0 (no point is) to 255 (all are). `nodes` are the drawn nodes with
/// their indices in `octree` and their numbers of drawn points; each counts by its points, and by
/// how far they crowd at the centre of its contour, which does not depend on the lattice's steps.
pub fn crowding<'a>(
    view: &View,
    lattice: &Lattice,
    octree: Option<&CompactOctree>,
    nodes: impl IntoIterator<Item = (usize, &'a Node, usize)>,
) -> u8 {
    let (mut crowded, mut all, mut any) = (0.0, 0.0, false);
    for (entry, node, drawn) in nodes {
        any |= may_crowd(view, lattice, octree, (entry, node));
        let Some(spacing) = leaf_spacing(octree, entry, node) else { continue };
        let centre = OrientedBox::of_contour(node, lattice).centre;
        let distance = (centre - view.eye).length().max(view.near);
        let points = drawn.min(node.points()) as f64;
        all += points;
        let seen = f64::from(flatness(view, lattice, node) * spacing) * view.focal_px() / distance;
        crowded += points * f64::from(crowding_at(seen as f32));
    }
    let share = if all > 0.0 { crowded / all } else { 0.0 };
    ((share * 255.0).round() as u8).max(u8::from(any))
}

/// Whether points of a node may crowd: those at the far end of its contour do. A node above drawn
/// ones has points of their spacing.
pub(crate) fn may_crowd(
    view: &View,
    lattice: &Lattice,
    octree: Option<&CompactOctree>,
    (entry, node): (usize, &Node),
) -> bool {
    let Some(spacing) = leaf_spacing(octree, entry, node) else { return false };
    let contour = OrientedBox::of_contour(node, lattice);
    let farthest = (contour.centre - view.eye).length() + contour.radius();
    let seen = f64::from(flatness(view, lattice, node) * spacing) * view.focal_px();
    seen < f64::from(CROWDED_PX[0]) * farthest
}

/// Spacing of a node's points; `None` above drawn nodes.
fn leaf_spacing(octree: Option<&CompactOctree>, entry: usize, node: &Node) -> Option<f32> {
    match octree.filter(|o| entry < o.len()) {
        Some(octree) => octree.leaf_spacing(entry),
        None => Some(node.spacing),
    }
}

/// Factor on the distance of a node's points for their foreshortening, 0.2 to 1.
pub(crate) fn flatness(view: &View, lattice: &Lattice, node: &Node) -> f32 {
    let facing = OrientedBox::of_contour(node, lattice).facing(view.eye);
    facing.clamp(FACING_MIN, 1.0).sqrt() as f32
}

/// Whether points of a draw may crowd, and the factor on their distances for foreshortening; if
/// points are not averaged, a distance at which none crowds.
pub(crate) fn crowding_of_draw<P>(frame: &Frame<'_, P>, draw: &DrawNode<'_, P>) -> (bool, f32) {
    const APART: f32 = 1e30;
    if !frame.averages || frame.method != Method::PullPush {
        return (false, APART);
    }
    let Frame { view, lattice, octree, .. } = *frame;
    let is_leaf = leaf_spacing(octree, draw.entry, draw.node).is_some();
    let crowds = !is_leaf || may_crowd(view, lattice, octree, (draw.entry, draw.node));
    (crowds, flatness(view, lattice, draw.node))
}

/// How far points at this distance on the picture crowd, 0 to 1.
#[inline(always)]
pub(crate) fn crowding_at(spacing_px: f32) -> f32 {
    let [from, to] = CROWDED_PX;
    ((spacing_px - from) / (to - from)).clamp(0.0, 1.0)
}

/// Last bits of the radius of a pixel's disc, which say how far points crowd there.
const CROWDING_BITS: u32 = 6;
pub(crate) const CROWDING_MAX: u32 = (1 << CROWDING_BITS) - 1;

/// A radius whose last bits say how far points crowd, 0 to 1: the share of the mean of a pixel's
/// points, where push smooths by the other share. The radius changes by 2^-17 of itself.
#[inline(always)]
pub(crate) fn radius_with_crowding(radius_px: f32, crowding: f32) -> f32 {
    let code = (crowding.clamp(0.0, 1.0) * CROWDING_MAX as f32 + 0.5) as u32;
    f32::from_bits(radius_px.to_bits() & !CROWDING_MAX | code)
}

/// How far points crowd in a pixel, from the radius of its disc.
#[inline(always)]
pub(crate) fn crowding_of(radius_px: f32) -> f32 {
    (radius_px.to_bits() & CROWDING_MAX) as f32 * (1.0 / CROWDING_MAX as f32)
}
