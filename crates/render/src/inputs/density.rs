//! Density of a view, from the nodes of its cut: dense if no pixel is without a point, which saves
//! pull and push; crowded if points share pixels, which are then averaged. A view that is crowded in
//! part is a mixture of both pictures.
//! [`crate::FramePlan::new`] uses both.

use crate::frame::{DrawNode, Frame, Method};
use esker_lod::{CompactOctree, OrientedBox, View};
use esker_points::{Lattice, Node};

/// A view is dense if points are nowhere farther apart than this, pixels: then no pixel of the
/// front surface is without a point, and push has nothing to fill. Samples are even: their gaps are
/// at most 1.42 times as wide as those of a Poisson-disk sample, in which every circle of one
/// spacing holds a point.
pub const DENSE_PX: f64 = 0.5;

/// Points crowd where they are closer together than about 0.85 pixels, with foreshortening: one to
/// two points share a pixel then. They begin to count at the first of these distances and count
/// fully from the second on, so that a picture does not change at once when the view moves.
pub const CROWDED_PX: [f64; 2] = [1.0, 0.7];

/// Least share of a node's face that is taken to be seen: contours may be flatter than their points.
const FACING_MIN: f64 = 0.04;

/// Whether a view is dense. `nodes` are the drawn nodes with their indices in `octree`. A node
/// below which something is drawn counts with the spacing of what is drawn there.
pub fn is_dense<'a>(
    view: &View,
    lattice: &Lattice,
    octree: &CompactOctree,
    nodes: impl IntoIterator<Item = (usize, &'a Node)>,
) -> bool {
    let mut any = false;
    let is_dense = nodes.into_iter().all(|(entry, node)| {
        any = true;
        entry < octree.len()
            && octree.leaf_spacing(entry).is_none_or(|spacing| {
                nearest_spacing_px(view, lattice, node, f64::from(spacing)) <= DENSE_PX
            })
    });
    any && is_dense
}

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
        crowded += points * ramp(seen);
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
    seen < CROWDED_PX[0] * farthest
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

/// How far points at this distance on the picture crowd, 0 to 1.
pub(crate) fn ramp(spacing_px: f64) -> f64 {
    let [from, to] = CROWDED_PX;
    ((spacing_px - from) / (to - from)).clamp(0.0, 1.0)
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

/// Distance of points of this spacing on the picture where a node comes nearest, pixels.
fn nearest_spacing_px(view: &View, lattice: &Lattice, node: &Node, spacing: f64) -> f64 {
    let [low, high] = node
        .own_box()
        .map(|corner| [0, 1, 2].map(|axis| lattice.world_axis(axis, f64::from(corner[axis]))));
    let eye = view.eye.to_array();
    let nearest = (0..3).map(|axis| (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0));
    let distance = nearest.map(|d| d * d).sum::<f64>().sqrt().max(view.near);
    spacing * view.focal_px() / distance
}
