//! How densely a view is drawn, by the nodes of its cut: so that no pixel is without a point, which
//! saves pull and push; or so that points share pixels, which are then averaged. The plan of a
//! frame asks ([`crate::plan`]).

use esker_lod::{CompactOctree, View};
use esker_points::{Lattice, Node};
use glam::DVec3;

/// A view is dense where points are drawn at most this far apart everywhere, pixels: then no pixel
/// of the front surface is without a point of its own, and nothing is left to be pushed. Samples
/// are even: their gaps are at most 1.42 times as wide as those of a Poisson-disk sample, whose
/// circles of one spacing hold a point each.
pub const DENSE_PX: f64 = 0.5;

/// Points crowd where most of them are drawn closer than this, pixels: about two share a pixel.
pub const CROWDED_PX: f64 = 0.75;

/// Whether these nodes, given with their entries in the octree of the cut, are drawn so densely
/// that no pixel of their surfaces is without a point. Where something is drawn below a node, its
/// points are among those.
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

/// Whether points crowd: half of those of the finest nodes (given with their entries in the octree
/// of the cut, and the number drawn) are closer together on the picture than [`CROWDED_PX`], by the
/// middle of their node.
pub fn is_crowded<'a>(
    view: &View,
    lattice: &Lattice,
    octree: Option<&CompactOctree>,
    nodes: impl IntoIterator<Item = (usize, &'a Node, usize)>,
) -> bool {
    let (mut crowded, mut all) = (0, 0);
    for (entry, node, drawn) in nodes {
        let spacing = match octree.filter(|o| entry < o.len()) {
            Some(octree) => octree.leaf_spacing(entry),
            None => Some(node.spacing),
        };
        let Some(spacing) = spacing else { continue };
        // Its box is more than half of what hot positions reach, and all of it at most.
        let half = 0.375 * 2f64.powi(16 + i32::from(node.hot_shift.min(16)));
        let middle =
            [0, 1, 2].map(|axis| lattice.world_axis(axis, f64::from(node.box_min[axis]) + half));
        let distance = (DVec3::from_array(middle) - view.eye).length().max(view.near);
        let points = drawn.min(node.points()) as u64;
        all += points;
        if f64::from(spacing) * view.focal_px() <= CROWDED_PX * distance {
            crowded += points;
        }
    }
    crowded > 0 && crowded * 2 >= all
}

/// How far points of this spacing are apart on the picture where a node comes nearest, pixels.
fn nearest_spacing_px(view: &View, lattice: &Lattice, node: &Node, spacing: f64) -> f64 {
    let [low, high] = node
        .own_box()
        .map(|corner| [0, 1, 2].map(|axis| lattice.world_axis(axis, f64::from(corner[axis]))));
    let eye = view.eye.to_array();
    let nearest = (0..3).map(|axis| (low[axis] - eye[axis]).max(eye[axis] - high[axis]).max(0.0));
    let distance = nearest.map(|d| d * d).sum::<f64>().sqrt().max(view.near);
    spacing * view.focal_px() / distance
}
