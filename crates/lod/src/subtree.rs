//! Where the points of a node and of the nodes below it are: the cell holds them all, but may be
//! far larger than the scan, since cells begin at multiples of their size.

use crate::oriented_box::OrientedBox;
use esker_points::{Lattice, NodeTable};
use glam::DVec3;

/// Distance of a cell over that of the contour in it from which the cell tells enough.
const CLOSE: f64 = 0.7;
/// Nodes below that are examined, at most; few are where cells are as small as what they hold.
const NODES_MAX: usize = 64;

/// Children of a node, without links that do not go down the tree.
pub(crate) fn children_below(table: &NodeTable, node: u32) -> impl Iterator<Item = u32> + '_ {
    let below = move |&child: &u32| {
        child > node && table.nodes.get(child as usize).is_some_and(|c| c.parent == node)
    };
    table.nodes[node as usize].children().filter(below)
}

/// Lower bound of the distance of the eye to the points of a node and of all nodes below it. Adds
/// nodes to `lacking` whose children are not in the table and would be examined.
pub(crate) fn distance(
    table: &NodeTable,
    lattice: &Lattice,
    node: u32,
    eye: DVec3,
    lacking: &mut Vec<u32>,
) -> f64 {
    Bound { table, lattice, eye, left: NODES_MAX, lacking }.of(node)
}

/// The search for a bound.
struct Bound<'a> {
    table: &'a NodeTable,
    lattice: &'a Lattice,
    eye: DVec3,
    /// Nodes that may still be examined.
    left: usize,
    lacking: &'a mut Vec<u32>,
}

impl Bound<'_> {
    fn of(&mut self, index: u32) -> f64 {
        let (table, lattice, eye) = (self.table, self.lattice, self.eye);
        let node = &table.nodes[index as usize];
        let cell = OrientedBox::of_cell(&node.cell(), lattice).distance(eye);
        let own = OrientedBox::of_contour(node, lattice).distance(eye);
        if cell >= CLOSE * own || self.left < node.child_count as usize {
            return cell;
        }
        if node.lacks_children() {
            self.lacking.push(index);
            return cell;
        }
        self.left -= node.child_count as usize;
        let below = children_below(table, index);
        let nearest =
            below.fold(
                own,
                |least, child| if least <= cell { least } else { least.min(self.of(child)) },
            );
        nearest.max(cell)
    }
}
