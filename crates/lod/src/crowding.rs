//! Crowding of a view: how large a part of the points that it draws share pixels, so that their
//! colours are averaged ([`crowding`]). It follows from the file, the view and the target spacing
//! alone, and not from what is resident: a picture does not change its passes while nodes arrive.

use crate::frustum::Frustum;
use crate::oriented_box::OrientedBox;
use crate::prefix::spacing;
use crate::subtree::{self, children_below};
use crate::view::View;
use esker_points::{Lattice, NodeTable};

/// Points that are drawn at most this far apart crowd, pixels: about two share a pixel.
pub const CROWDED_PX: f64 = 0.75;
/// Points that are drawn at least this far apart do not crowd at all, pixels. It is the usual
/// target spacing: views that draw a point a pixel are not averaged.
const APART_PX: f64 = 1.0;
/// Shares of crowded points up to which a view is not crowded, and from which it is wholly.
const SHARES: [f64; 2] = [0.25, 0.75];

/// Crowding of a view of the trees of `roots` in which points are drawn at most `target_spacing_px`
/// apart where the file has that many: 0 if the points of its finest nodes are apart, 1 if they
/// crowd. In between it is continuous. Adds nodes to `lacking` whose children are not in the table
/// and would change it.
pub fn crowding(
    table: &NodeTable,
    roots: impl Iterator<Item = u32>,
    lattice: &Lattice,
    view: &View,
    target_spacing_px: f64,
    lacking: &mut Vec<u32>,
) -> f32 {
    if target_spacing_px >= APART_PX {
        return 0.0;
    }
    let frustum = Frustum::of(view);
    let spacing_px = |spacing: f64, distance: f64| {
        spacing * view.focal_px() / view.parallel_at.unwrap_or(distance.max(view.near))
    };
    let (mut crowded, mut all) = (0.0, 0.0);
    let mut open: Vec<_> = roots.map(|root| (root, f64::INFINITY)).collect();
    while let Some((index, above)) = open.pop() {
        let node = &table.nodes[index as usize];
        let cell = OrientedBox::of_cell(&node.cell(), lattice);
        let repeats = node.is_continuation() && node.cell_log2 == 0;
        if !frustum.touches(&cell) || repeats && target_spacing_px > 0.0 {
            continue;
        }
        let spacing = spacing(node).min(above);
        let distance = subtree::distance(table, lattice, index, view.eye, lacking);
        let is_coarse = spacing_px(spacing, distance) > target_spacing_px;
        if node.lacks_children() && is_coarse {
            lacking.push(index);
        } else if node.child_count > 0 && is_coarse {
            open.extend(children_below(table, index).map(|child| (child, spacing)));
            continue;
        }
        let contour = OrientedBox::of_contour(node, lattice);
        if !frustum.touches(&contour) {
            continue;
        }
        let own_px = spacing_px(spacing, (contour.centre - view.eye).length());
        // Of points that are closer together than the target, so many are drawn.
        let share =
            if target_spacing_px > 0.0 { (own_px / target_spacing_px).min(1.0) } else { 1.0 };
        let points = (node.points() as f64 * share * share).max(1.0);
        let apart = own_px.max(target_spacing_px);
        all += points;
        crowded += points * ((APART_PX - apart) / (APART_PX - CROWDED_PX)).clamp(0.0, 1.0);
    }
    let [none, wholly] = SHARES;
    if all > 0.0 { ((crowded / all - none) / (wholly - none)).clamp(0.0, 1.0) as f32 } else { 0.0 }
}
