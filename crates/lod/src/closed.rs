//! Which parts of a node are closed surface. An occupancy bit says only that one point lies in its part
//! of the contour's plane; so a node hides something only where it is flat, where its points are enough
//! to fill all parts that have any, and, of those parts, only those whose neighbours have some too.

use crate::selection::Drawn;
use esker_points::Node;

/// Least share of the occupied parts' area that the points cover, at one squared spacing each, of a node
/// that hides anything. A grille half open covers half; even samples of closed walls about all.
const FILL_LEAST: f64 = 0.75;
/// Least share of the points in a node's place that are its own, for its own to tell of them all.
const OWN_LEAST: f64 = 0.2;

/// Columns of the mask.
const FIRST_COLUMN: u64 = 0x0101_0101_0101_0101;

/// The closed parts of what is drawn of a node, as a mask like [`Node::occupancy`]; none where it is no
/// surface. `above` is the spacing of its parent's sample, infinite for the root.
pub fn closed_parts(node: &Node, drawn: &Drawn, above: f64) -> u64 {
    if node.dimension() != 2 || node.occupancy == 0 {
        return 0;
    }
    let [x, y, _] = node.contour_half.map(f64::from);
    let occupied = 4.0 * x * y * f64::from(node.occupancy.count_ones()) / 64.0;
    let spacing = f64::from(drawn.effective_spacing);
    // The density that the ancestors' points have there already.
    let own = 1.0 - (spacing / above).powi(2);
    let filled = drawn.prefix as f64 * spacing * spacing / own;
    let is_closed = own >= OWN_LEAST && filled >= FILL_LEAST * occupied;
    if is_closed { eroded(node.occupancy) } else { 0 }
}

/// The parts whose eight neighbours are occupied too. What is outside of the mask counts as occupied: the
/// contour is tight, so that a surface goes on there or ends with the box.
fn eroded(mask: u64) -> u64 {
    let right = mask >> 1 | FIRST_COLUMN << 7;
    let left = mask << 1 | FIRST_COLUMN;
    let rows = mask & right & left;
    rows & (rows >> 8 | 0xff << 56) & (rows << 8 | 0xff)
}
