//! Tests whether a node's hot positions are exact enough for a view, or its residual plane is
//! needed. The points of inner nodes are drawn in close views as well.

use crate::oriented_box::OrientedBox;
use crate::view::View;
use esker_points::{Lattice, Node};
use glam::DVec3;

/// Greatest displacement in the picture that hot positions may cause, pixels: half a pixel, less
/// the error of `f32`.
const HOT_ERROR_PX_MAX: f64 = 0.48;

/// Whether a point of the node, drawn at the middle of its hot step, may be too far off in the
/// picture. The bound is half of a step's diagonal, at the contour's nearest place, stretched as in
/// a corner of the picture.
pub fn needs_residual(node: &Node, lattice: &Lattice, view: &View) -> bool {
    let half_steps = f64::from((1u32 << node.hot_shift) - 1) * 0.5;
    let off = DVec3::from_array(lattice.scale).length() * half_steps;
    let distance = OrientedBox::of_contour(node, lattice).distance(view.eye).max(view.near);
    let stretch = 1.0 + view.tan_half().length_squared();
    node.hot_shift > 0 && off * stretch * view.focal_px() / distance > HOT_ERROR_PX_MAX
}
