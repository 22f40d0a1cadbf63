//! Which parts of a node are closed surface. An occupancy bit says only that one point lies in its part
//! of the contour's plane; so a node hides something only where it is flat, where its points are enough
//! to fill all parts that have any, and, of those parts, only those whose neighbours have some too.

use crate::select::Drawn;
use esker_points::Node;

/// Least share of the occupied parts' area that the points cover, at one squared spacing each, of a node
/// that hides anything.
const FILL_LEAST: f64 = 0.6;

/// Columns of the mask.
const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;

/// The closed parts of what is drawn of a node, as a mask like [`Node::occupancy`]; none where it is no
/// surface.
pub fn closed_parts(node: &Node, drawn: &Drawn) -> u64 {
    if node.dimension() != 2 || node.occupancy == 0 {
        return 0;
    }
    let [x, y, _] = node.contour_half.map(f64::from);
    let occupied = 4.0 * x * y * f64::from(node.occupancy.count_ones()) / 64.0;
    let spacing = f64::from(drawn.effective_spacing);
    let filled = drawn.prefix as f64 * spacing * spacing;
    if filled >= FILL_LEAST * occupied { eroded(node.occupancy) } else { 0 }
}

/// The parts whose eight neighbours are occupied too. What is outside of the mask counts as occupied: the
/// contour is tight, so that a surface goes on there or ends with the box.
fn eroded(mask: u64) -> u64 {
    let right = mask >> 1 | FIRST_COLUMN << 7;
    let left = mask << 1 | FIRST_COLUMN;
    let rows = mask & right & left;
    rows & (rows >> 8 | 0xff << 56) & (rows << 8 | 0xff)
}
