//! Places the nodes of the trees of a forest in one octree whose every level halves the edge of the
//! voxels, as COPC has it. Levels of Esker's trees skip: a cell may be many times smaller than an
//! octant of the cell above.
//!
//! - The cube of the octree is the least one that holds all points and whose octants are cells of
//!   the lattice, so that voxels below it are cells too. The cell of a root may be far larger,
//!   where points lie on both sides of a face of large cells.
//! - A node comes one level below its parent, to the voxel that holds its cell, however small that
//!   is, so that no empty voxel lies between them. Where no voxel of that level holds it, each
//!   point comes to the one that it lies in. Continuations come to the voxels of their node.
//! - A node with several children must end in the voxel that is its cell, since only there they
//!   come to different octants; the root of one of several trees, where voxels have the size of its
//!   own points. Its points are spread over the levels down to there: each has the share that
//!   halving the spacing leaves to it, at least one point. Any prefix of a node is an even sample,
//!   so every level shows the node.

use esker_points::{Cell, Lattice, Node, NodeTable};
use esker_scan::write::las::copc::{Octree, VoxelKey};
use std::ops::Range;

/// Lattice box, both corners included.
type Bounds = [[u32; 3]; 2];

/// Points of a node that come to a voxel.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// The voxel.
    pub key: VoxelKey,
    /// The range of its points of which some come to the voxel.
    pub range: Range<usize>,
    /// The cell of the voxel, if only those in it do.
    pub within: Option<Cell>,
}

/// First and last level that the points of a node come to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels {
    first: u8,
    last: u8,
}

/// The octree of trees, and where their nodes are in it.
pub struct Placement {
    /// The octree.
    pub octree: Octree,
    bounds: Bounds,
    /// For each tree, the levels of its nodes.
    levels: Vec<Vec<Levels>>,
}

impl Placement {
    /// Places the nodes of `trees`, whose points lie in `bounds`, on `lattice`.
    pub fn new(trees: &[&NodeTable], bounds: Option<Bounds>, lattice: &Lattice) -> Self {
        let bounds = bounds.unwrap_or([[0; 3]; 2]);
        let root = cube(bounds);
        let levels: Vec<_> =
            trees.iter().map(|table| levels(table, root.log2, trees.len() > 1)).collect();
        // The spacing that the roots' own gives to the cube.
        let of_cube = |(table, levels): (&&NodeTable, &Vec<Levels>)| {
            let spacing = f64::from(table.root()?.spacing) / lattice.factor[0];
            Some(spacing * 2f64.powi(levels.first()?.last.into()))
        };
        let is_usable = |spacing: &f64| spacing.is_finite() && *spacing > 0.0;
        let spacing = trees.iter().zip(&levels).filter_map(of_cube).filter(is_usable);
        let edge = root.edge() as f64 * lattice.scale[0];
        let spacing = spacing.reduce(f64::min).unwrap_or(edge);
        Self { octree: Octree { root, spacing }, bounds, levels }
    }

    /// The voxels that the points of a node of a tree come to.
    pub fn shares(&self, tree: usize, index: usize, node: &Node) -> impl Iterator<Item = Share> {
        let (levels, points) = (self.levels[tree][index], node.points());
        // Points on a line, a plane and in a volume are 2, 4 and 8 times as many at half the
        // distance.
        let ratio = 2f64.powi(node.dimension().max(1) as i32);
        let behind = move |level: u8| {
            let share = points as f64 / ratio.powi(i32::from(levels.last - level));
            (share.ceil() as usize).max(usize::from(level - levels.first) + 1).min(points)
        };
        (levels.first..=levels.last).flat_map(move |level| {
            let start = if level == levels.first { 0 } else { behind(level - 1) };
            self.voxels(node, level.into(), start..behind(level))
        })
    }

    /// The voxels of a level that hold points of a node.
    fn voxels(&self, node: &Node, level: u32, range: Range<usize>) -> Vec<Share> {
        let root = self.octree.root;
        let log2 = u32::from(root.log2) - level;
        let place = |p: [u32; 3]| {
            [0, 1, 2].map(|i| (u64::from(p[i].wrapping_sub(root.corner[i])) >> log2) as u32)
        };
        let of_cell = VoxelKey { level, place: place(node.corner) };
        if u32::from(node.cell_log2) <= log2
            && self.octree.cell(of_cell).contains_cell(&node.cell())
        {
            return vec![Share { key: of_cell, range, within: None }];
        }
        let [low, high] = node.own_box();
        let low = place([0, 1, 2].map(|i| low[i].clamp(self.bounds[0][i], self.bounds[1][i])));
        let high = place([0, 1, 2].map(|i| high[i].clamp(self.bounds[0][i], self.bounds[1][i])));
        let mut shares = Vec::new();
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let key = VoxelKey { level, place: [x, y, z] };
                    let within = Some(self.octree.cell(key));
                    shares.push(Share { key, range: range.clone(), within });
                }
            }
        }
        shares
    }
}

/// The least cube that holds a box and whose octants are cells. Where that is a cell, it is one.
fn cube([low, high]: Bounds) -> Cell {
    let cell = Cell::enclosing(low, high);
    let is_split = |log2: u8| (0..3).all(|i| (high[i] >> log2) - (low[i] >> log2) <= 1);
    // At half the lattice there are only two cells on an axis.
    let octant = (0..32).find(|&log2| is_split(log2)).unwrap_or(31);
    if cell.log2 <= octant + 1 {
        return cell;
    }
    Cell { corner: low.map(|c| c >> octant << octant), log2: octant + 1 }
}

/// The levels of the nodes of a tree in a cube of `2^cube_log2` steps.
fn levels(table: &NodeTable, cube_log2: u8, are_several: bool) -> Vec<Levels> {
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
    // Voxels of a step are the smallest, and have keys of 31 bits.
    let deepest = cube_log2.min(VoxelKey::LEVEL_MAX as u8);
    let mut levels: Vec<Levels> = Vec::with_capacity(nodes.len());
    for (node, branches) in nodes.iter().zip(branches) {
        // Parents come first.
        let above = levels.get(node.parent as usize).copied();
        let first = match above {
            None => 0,
            Some(above) if node.is_continuation() => above.last,
            Some(above) => (above.last + 1).min(deepest),
        };
        let end = match above {
            None if are_several => Some(log2_of_box(node).min(node.cell_log2)),
            _ if branches => Some(node.cell_log2),
            _ => None,
        };
        let last = end.map_or(first, |log2| cube_log2.saturating_sub(log2).clamp(first, deepest));
        levels.push(Levels { first, last });
    }
    levels
}

/// Log2 of the edge of the least cube, wherever it lies, that holds a node's own points.
fn log2_of_box(node: &Node) -> u8 {
    let [low, high] = node.own_box();
    let extent = (0..3).fold(0, |all, i| all | high[i].saturating_sub(low[i]));
    (32 - extent.leading_zeros()) as u8
}
