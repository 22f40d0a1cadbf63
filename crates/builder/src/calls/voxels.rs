//! Places the nodes of the trees of a forest in one octree whose every level halves the edge of the
//! voxels, as COPC has it. Levels of Esker's trees skip: a cell may be many times smaller than an
//! octant of the cell above.
//!
//! - The cube is the least cell that holds the roots of all trees; nodes of several trees that come
//!   to the same voxel share it.
//! - A node comes to the voxel one level below its parent's that holds its cell, however small that
//!   is, so that no empty voxel lies between them. Continuations come to the voxel of their node.
//! - A node with several children must end in the voxel that is its cell, since only there they
//!   come to different octants. Its points are spread over the voxels down to it: each has the
//!   share that halving the spacing leaves to its level, at least one point. Any prefix of a node
//!   is an even sample, so every voxel shows the node.

use esker_points::{Cell, Lattice, Node, NodeTable};
use esker_scan::write::las::copc::{Octree, VoxelKey};
use std::ops::Range;

/// First and last level that the points of a node come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    first: u8,
    last: u8,
}

/// The octree of `trees`, whose lattice is `lattice`; a voxel of a step without nodes.
pub fn octree<'a>(trees: impl Iterator<Item = &'a NodeTable> + Clone, lattice: &Lattice) -> Octree {
    let roots = trees.filter_map(NodeTable::root);
    let cells = roots.clone().map(Node::cell);
    let root = cells.reduce(enclosing).unwrap_or(Cell { corner: [0; 3], log2: 0 });
    // The spacing that the roots' own gives to the cube.
    let of_cube = |node: &Node| {
        let depth = i32::from(root.log2) - i32::from(node.cell_log2);
        f64::from(node.spacing) / lattice.factor[0] * 2f64.powi(depth)
    };
    let is_usable = |spacing: &f64| spacing.is_finite() && *spacing > 0.0;
    let spacing = roots.map(of_cube).filter(is_usable).reduce(f64::min);
    let edge = root.edge() as f64 * lattice.scale[0];
    Octree { root, spacing: spacing.unwrap_or(edge) }
}

/// The least cell that holds two.
fn enclosing(a: Cell, b: Cell) -> Cell {
    let least = |a: [u32; 3], b: [u32; 3]| [0, 1, 2].map(|i| a[i].min(b[i]));
    let greatest = |a: [u32; 3], b: [u32; 3]| [0, 1, 2].map(|i| a[i].max(b[i]));
    Cell::enclosing(least(a.corner, b.corner), greatest(a.last(), b.last()))
}

/// The levels of the nodes of a tree in `octree`.
pub fn levels(table: &NodeTable, octree: &Octree) -> Vec<Levels> {
    let nodes = &table.nodes;
    // Whether the children of a node, or those of its last continuation, are several.
    let mut branches = vec![false; nodes.len()];
    for (i, node) in nodes.iter().enumerate().rev() {
        let child = nodes.get(node.first_child as usize).filter(|_| node.child_count == 1);
        branches[i] = match child {
            Some(child) if child.is_continuation() => branches[node.first_child as usize],
            _ => node.child_count > 1,
        };
    }
    let mut levels: Vec<Levels> = Vec::with_capacity(nodes.len());
    for (node, branches) in nodes.iter().zip(branches) {
        // Parents come first.
        let above = levels.get(node.parent as usize).copied();
        let first = match above {
            None => 0,
            Some(above) if node.is_continuation() => above.last,
            Some(above) => (above.last + 1).min(VoxelKey::LEVEL_MAX as u8),
        };
        let own = octree.root.log2.saturating_sub(node.cell_log2);
        let last = if branches { own.clamp(first, VoxelKey::LEVEL_MAX as u8) } else { first };
        levels.push(Levels { first, last });
    }
    levels
}

/// The voxels of a node, each with the range of its points that comes to it.
pub fn voxels(
    node: &Node,
    levels: Levels,
    octree: &Octree,
) -> impl Iterator<Item = (VoxelKey, Range<usize>)> {
    let points = node.points();
    // Points on a line, a plane and in a volume are 2, 4 and 8 times as many at half the distance.
    let ratio = 2f64.powi(node.dimension().max(1) as i32);
    let behind = move |level: u8| {
        let share = points as f64 / ratio.powi(i32::from(levels.last - level));
        (share.ceil() as usize).max(usize::from(level - levels.first) + 1).min(points)
    };
    let [cell, root] = [node.cell(), octree.root];
    (levels.first..=levels.last).map(move |level| {
        let start = if level == levels.first { 0 } else { behind(level - 1) };
        (key(cell, u32::from(level), root), start..behind(level))
    })
}

/// The voxel of a level that holds a cell.
fn key(cell: Cell, level: u32, root: Cell) -> VoxelKey {
    let log2 = u32::from(root.log2).saturating_sub(level);
    let steps = |axis: usize| u64::from(cell.corner[axis].wrapping_sub(root.corner[axis]));
    VoxelKey { level, place: [0, 1, 2].map(|axis| (steps(axis) >> log2) as u32) }
}
