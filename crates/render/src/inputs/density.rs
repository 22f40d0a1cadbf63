//! Density of a view, from the nodes of its cut: dense if no pixel is without a point, which saves
//! pull and push; crowded if points share pixels, which are then averaged ([`esker_lod::crowding`]
//! says how crowded a view of a file is).
//! [`crate::FramePlan::new`] uses both.

use esker_lod::{CROWDED_PX, CompactOctree, View};
use esker_points::{Lattice, Node};
use glam::DVec3;

/// A view is dense if points are nowhere farther apart than this, pixels: then no pixel of the
/// front surface is without a point, and push has nothing to fill. Samples are even: their gaps are
/// at most 1.42 times as wide as those of a Poisson-disk sample, in which every circle of one
/// spacing holds a point.
pub const DENSE_PX: f64 = 0.4;

/// Distance of points from which planes that are fitted to a view without normals count wholly,
/// pixels. They fade towards dense views, which have none.
pub(crate) const FITTED_PX: f64 = 0.6;

/// Distance of the points of a view where they are farthest apart on the picture, pixels; infinite
/// where it is not known. `nodes` are the drawn nodes with their indices in `octree`. A node that
/// what is drawn below refines evenly counts with the spacing of that.
pub fn sparsest_px<'a>(
    view: &View,
    lattice: &Lattice,
    octree: &CompactOctree,
    nodes: impl IntoIterator<Item = (usize, &'a Node)>,
) -> f64 {
    let mut any = false;
    let spacings = nodes.into_iter().map(|(entry, node)| {
        any = true;
        if entry >= octree.len() {
            return f64::INFINITY;
        }
        let spacing = octree.open_spacing(entry);
        spacing.map_or(0.0, |s| nearest_spacing_px(view, lattice, node, f64::from(s)))
    });
    let sparsest = spacings.fold(0.0, f64::max);
    if any { sparsest } else { f64::INFINITY }
}

/// Whether drawn nodes are crowded: at least half of the points of the finest ones are closer
/// together than [`CROWDED_PX`] at the distance of the middle of their node. For frames that do not
/// say how crowded their view is ([`crate::Frame::crowding`]). `nodes` are the drawn nodes with
/// their indices in `octree` and their numbers of drawn points.
pub fn is_crowded<'a>(
    view: &View,
    lattice: &Lattice,
    octree: Option<&CompactOctree>,
    nodes: impl IntoIterator<Item = (usize, &'a Node, usize)>,
) -> bool {
    let (mut crowded, mut all) = (0, 0);
    for (entry, node, drawn) in nodes {
        let spacing = match octree.filter(|o| entry < o.len()) {
            Some(octree) => octree.open_spacing(entry),
            None => Some(node.spacing),
        };
        let Some(spacing) = spacing else { continue };
        let [low, high] = node.own_box().map(|corner| corner.map(f64::from));
        let middle = [0, 1, 2].map(|i| lattice.world_axis(i, 0.5 * (low[i] + high[i])));
        let distance = (DVec3::from_array(middle) - view.eye).length().max(view.near);
        let points = drawn.min(node.points()) as u64;
        all += points;
        if f64::from(spacing) * view.focal_px() <= CROWDED_PX * distance {
            crowded += points;
        }
    }
    crowded > 0 && crowded * 2 >= all
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
