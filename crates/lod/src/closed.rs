//! Finds the closed parts of a node's surface. An occupancy bit says only that one point lies in
//! its part of the contour's plane. So a node occludes only if it is flat and its points suffice to
//! fill all occupied parts, and then only by the parts whose neighbours are occupied too.

use crate::selection::Drawn;
use esker_points::Node;

/// Least share of the occupied area that the points of an occluder cover, at one squared spacing
/// each. A grille that is half open covers half; even samples of closed walls cover about all.
const FILL_LEAST: f64 = 0.75;
/// Least share of the points in a node's cell that are its own, so that they represent all of them.
const OWN_LEAST: f64 = 0.2;

/// First column of the mask.
const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;

/// Closed parts of the drawn points of a node, as a mask like [`Node::occupancy`]; 0 if the node is
/// not a surface. `above` is the spacing of its parent's sample, infinite for the root.
pub(crate) fn closed_parts(node: &Node, drawn: &Drawn, above: f64) -> u64 {
    if node.dimension() != 2 || node.occupancy == 0 {
        return 0;
    }
    let [x, y, _] = node.contour_half.map(f64::from);
    let occupied = 4.0 * x * y * f64::from(node.occupancy.count_ones()) / 64.0;
    let spacing = f64::from(drawn.effective_spacing);
    // Without the density that the ancestors' points already have there.
    let own = 1.0 - (spacing / above).powi(2);
    let filled = drawn.prefix as f64 * spacing * spacing / own;
    let is_closed = own >= OWN_LEAST && filled >= FILL_LEAST * occupied;
    if is_closed { eroded(node.occupancy) } else { 0 }
}

/// Parts whose eight neighbours are occupied too. Parts outside of the mask count as occupied: the
/// contour is tight, so a surface goes on there or ends with the box.
fn eroded(mask: u64) -> u64 {
    let right = mask >> 1 | FIRST_COLUMN << 7;
    let left = mask << 1 | FIRST_COLUMN;
    let rows = mask & right & left;
    rows & (rows >> 8 | 0xff << 56) & (rows << 8 | 0xff)
}
