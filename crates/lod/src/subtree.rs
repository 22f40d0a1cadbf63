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

/// Lower bound of the distance of the eye to the points of a node and of all nodes below it.
pub(crate) fn distance(table: &NodeTable, lattice: &Lattice, node: u32, eye: DVec3) -> f64 {
    let mut left = NODES_MAX;
    bound(table, lattice, node, eye, &mut left)
}

fn bound(table: &NodeTable, lattice: &Lattice, index: u32, eye: DVec3, left: &mut usize) -> f64 {
    let node = &table.nodes[index as usize];
    let cell = OrientedBox::of_cell(&node.cell(), lattice).distance(eye);
    let own = OrientedBox::of_contour(node, lattice).distance(eye);
    if cell >= CLOSE * own || *left < node.child_count as usize {
        return cell;
    }
    *left -= node.child_count as usize;
    let below = children_below(table, index);
    let nearest = below.fold(own, |least, child| {
        if least <= cell { least } else { least.min(bound(table, lattice, child, eye, left)) }
    });
    nearest.max(cell)
}
