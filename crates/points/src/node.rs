//! The node table: one record of fixed size a node, with everything that selection, culling and
//! reading need, and nothing else. 144 bytes a node (kanzok2015 has up to 184).

use crate::cell::Cell;
use bytemuck::{Pod, Zeroable};

/// Greatest number of levels of a node; deeper levels of its n-tree join the last.
pub const LEVELS_MAX: usize = 16;
/// Index for "no node": the parent of a root.
pub const NONE: u32 = u32::MAX;

/// Record of a node. Little-endian on disk, in this order, without padding.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Node {
    /// Corner of its cell.
    pub corner: [u32; 3],
    /// Log2 of the cell's edge in steps.
    pub cell_log2: u8,
    /// Bits 0-1: dimension of its n-tree (n = 2^dimension; 0 is a single point, 1 a line, 2 a
    /// plane, 3 a volume). Bit 2: the contour is oriented (otherwise axis-parallel). Bit 3: the
    /// node continues its parent (same cell, the next of its points, as an even sample of more).
    pub shape: u8,
    /// Number of children, which are contiguous in the table, in Morton order.
    pub child_count: u8,
    /// Number of levels.
    pub level_count: u8,
    /// Index of its parent, [`NONE`] for a root.
    pub parent: u32,
    /// Index of the first child; 0 without children.
    pub first_child: u32,
    /// Points of each level, three bytes each, little-endian.
    pub level_counts: [[u8; 3]; LEVELS_MAX],
    /// Centre of its contour, from the cell's corner, in the file's unit.
    pub contour_centre: [f32; 3],
    /// Half the contour's edges along its own axes, in the file's unit; the third is the shortest.
    pub contour_half: [f32; 3],
    /// Rotation from the contour's axes to the world's: a unit quaternion x, y, z, w, times 32767.
    pub contour_rotation: [i16; 4],
    /// Parts of the contour's plane (first and second axis) that hold points, 8 x 8: bit
    /// `v * 8 + u`.
    pub occupancy: u64,
    /// Typical distance of points when all points of this node and its ancestors are drawn, the
    /// file's unit.
    pub spacing: f32,
    /// Lowest corner of the integer box of its own points: the base of hot positions.
    pub box_min: [u32; 3],
    /// Bits that a hot position drops.
    pub hot_shift: u8,
    /// Zero.
    pub reserved: [u8; 3],
    /// Bytes of its page.
    pub page_bytes: u32,
    /// Offset of its page in the file, bytes.
    pub page_offset: u64,
}

const _: () = assert!(size_of::<Node>() == 144 && size_of::<Node>() + size_of::<Sides>() <= 184);

/// Bit of [`Node::shape`] for an oriented contour.
pub const SHAPE_ORIENTED: u8 = 4;
/// Bit of [`Node::shape`] for a continuation.
pub const SHAPE_CONTINUATION: u8 = 8;

impl Node {
    /// Its cell.
    pub fn cell(&self) -> Cell {
        Cell { corner: self.corner, log2: self.cell_log2 }
    }

    /// Dimension of its n-tree: 0 to 3.
    pub fn dimension(&self) -> u32 {
        u32::from(self.shape & 3)
    }

    /// Whether it continues its parent.
    pub fn is_continuation(&self) -> bool {
        self.shape & SHAPE_CONTINUATION != 0
    }

    /// Points of each of its levels.
    pub fn levels(&self) -> impl Iterator<Item = usize> + '_ {
        self.level_counts[..usize::from(self.level_count).min(LEVELS_MAX)]
            .iter()
            .map(|c| c[0] as usize | (c[1] as usize) << 8 | (c[2] as usize) << 16)
    }

    /// Sets the points of each level.
    ///
    /// # Panics
    /// If there are more than [`LEVELS_MAX`] levels, or one of 2^24 points or more.
    pub fn set_levels(&mut self, counts: &[usize]) {
        assert!(counts.len() <= LEVELS_MAX);
        self.level_counts = [[0; 3]; LEVELS_MAX];
        self.level_count = counts.len() as u8;
        for (slot, &n) in self.level_counts.iter_mut().zip(counts) {
            assert!(n < 1 << 24);
            *slot = [n as u8, (n >> 8) as u8, (n >> 16) as u8];
        }
    }

    /// Number of its own points.
    pub fn points(&self) -> usize {
        self.levels().sum()
    }

    /// A lattice box that holds its own points, both corners included. Any bits of the record give
    /// a box.
    pub fn own_box(&self) -> [[u32; 3]; 2] {
        let span = ((1u64 << (16 + u32::from(self.hot_shift.min(16)))) - 1) as u32;
        let cell = self.cell();
        let last = Cell { log2: cell.log2.min(32), ..cell }.last();
        [self.box_min, [0, 1, 2].map(|i| self.box_min[i].saturating_add(span).min(last[i]))]
    }

    /// Moves the node by whole steps; `None` if its points would leave the lattice. Its cell may,
    /// where it is empty: its corner then wraps around ([`Cell::first`]).
    pub fn moved(&self, steps: [i64; 3]) -> Option<Self> {
        let mut node = *self;
        let is_empty = self.points() == 0;
        for (axis, steps) in steps.into_iter().enumerate() {
            let place = |c: u32| i64::from(c).checked_add(steps);
            node.corner[axis] = place(self.corner[axis])? as u32;
            let least = place(self.box_min[axis])?;
            node.box_min[axis] = if is_empty { least as u32 } else { u32::try_from(least).ok()? };
        }
        Some(node)
    }

    /// Indices of its children; none if they are not known ([`Node::lacks_children`]).
    pub fn children(&self) -> std::ops::Range<u32> {
        self.first_child..self.first_child.saturating_add(u32::from(self.child_count))
    }

    /// Whether it has children that are not in the table, of which only a part was read: its first
    /// child is [`NONE`].
    pub fn lacks_children(&self) -> bool {
        self.child_count > 0 && self.first_child == NONE
    }

    /// The contour as numbers.
    pub fn contour(&self) -> Contour {
        let q = self.contour_rotation.map(|c| f64::from(c) / 32767.0);
        Contour {
            centre: self.contour_centre.map(f64::from),
            half: self.contour_half.map(f64::from),
            axes: axes_of(q),
        }
    }
}

/// A box around all of a node's own points; the third axis is the shortest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contour {
    /// Centre relative to the cell's corner, the file's unit.
    pub centre: [f64; 3],
    /// Half its edges.
    pub half: [f64; 3],
    /// Its axes in world coordinates, unit vectors.
    pub axes: [[f64; 3]; 3],
}

/// Axes (columns of the rotation matrix) of a quaternion x, y, z, w, which is normalised first.
fn axes_of(q: [f64; 4]) -> [[f64; 3]; 3] {
    let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
    let [x, y, z, w] = if norm > 1e-6 { q.map(|c| c / norm) } else { [0.0, 0.0, 0.0, 1.0] };
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Packs a right-handed orthonormal frame, given by its axes, into the stored quaternion. Also
/// returns the axes of the rounded quaternion: bounds must be computed in these.
pub fn pack_rotation(axes: [[f64; 3]; 3]) -> ([i16; 4], [[f64; 3]; 3]) {
    let [a, b, c] = axes;
    let trace = a[0] + b[1] + c[2];
    // The largest of the four components is computed first, so that no divisor is small.
    let q = if trace > 0.0 {
        let s = 2.0 * (trace + 1.0).sqrt();
        [(b[2] - c[1]) / s, (c[0] - a[2]) / s, (a[1] - b[0]) / s, s / 4.0]
    } else if a[0] >= b[1] && a[0] >= c[2] {
        let s = 2.0 * (1.0 + a[0] - b[1] - c[2]).sqrt();
        [s / 4.0, (b[0] + a[1]) / s, (c[0] + a[2]) / s, (b[2] - c[1]) / s]
    } else if b[1] >= c[2] {
        let s = 2.0 * (1.0 + b[1] - a[0] - c[2]).sqrt();
        [(b[0] + a[1]) / s, s / 4.0, (c[1] + b[2]) / s, (c[0] - a[2]) / s]
    } else {
        let s = 2.0 * (1.0 + c[2] - a[0] - b[1]).sqrt();
        [(c[0] + a[2]) / s, (c[1] + b[2]) / s, s / 4.0, (a[1] - b[0]) / s]
    };
    let packed = q.map(|c| (c * 32767.0).round().clamp(-32767.0, 32767.0) as i16);
    (packed, axes_of(packed.map(|c| f64::from(c) / 32767.0)))
}

/// Identity of a node in a forest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeName {
    /// Tree: 0 is that of the file itself, the others follow in the order in which it names them.
    pub tree: u16,
    /// Index in that tree's own table.
    pub index: u32,
}

/// All nodes of a tree: the root is first, parents come before their children. Or those of several
/// trees over one lattice, one tree after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeTable {
    /// Records.
    pub nodes: Vec<Node>,
    /// Indices of the roots of all trees but the first, ascending.
    pub later_roots: Vec<u32>,
    /// [`Sides`] of the nodes: of the first nodes or of all.
    pub sides: Vec<Sides>,
    /// Indices of the nodes in the table of their file, of which only a part was read; empty for
    /// whole tables.
    pub in_file: Vec<u32>,
}

/// Parts of a contour's sides that hold points, as [`Node::occupancy`] has for its plane: of 8 x 8
/// parts along the first and third axis (bit `u * 8 + w`), and along the second and third (bit
/// `v * 8 + w`).
pub type Sides = [u64; 2];

/// Sides of a node whose sides are unknown.
pub const ALL_SIDES: Sides = [u64::MAX; 2];

impl NodeTable {
    /// The table of one tree.
    pub fn of_tree(nodes: Vec<Node>) -> Self {
        Self { nodes, ..Self::default() }
    }

    /// Bytes of a node in memory.
    pub fn bytes_a_node(&self) -> usize {
        let sides = if self.sides.is_empty() { 0 } else { size_of::<Sides>() };
        let in_file = if self.in_file.is_empty() { 0 } else { size_of::<u32>() };
        size_of::<Node>() + sides + in_file
    }

    /// Bytes of all nodes in memory.
    pub fn bytes(&self) -> usize {
        self.nodes.len() * self.bytes_a_node()
    }

    /// Sides of a node; all parts if the file does not have them.
    pub fn sides_of(&self, node: u32) -> Sides {
        self.sides.get(node as usize).copied().unwrap_or(ALL_SIDES)
    }

    /// Index of a node in the whole table: it does not depend on what else was read before it.
    pub fn index_in_file(&self, node: u32) -> u32 {
        self.in_file.get(node as usize).copied().unwrap_or(node)
    }

    /// Root of the first tree, if there is any node.
    pub fn root(&self) -> Option<&Node> {
        self.nodes.first()
    }

    /// Roots of all trees that have nodes, ascending.
    pub fn roots(&self) -> impl Iterator<Item = u32> + Clone + '_ {
        let first = (!self.nodes.is_empty()).then_some(0);
        first.into_iter().chain(self.later_roots.iter().copied())
    }

    /// Appends the nodes of another tree, with its pages moved by `pages_moved` bytes.
    ///
    /// # Panics
    /// If there are 2^32 nodes in all, or pages beyond byte 2^64: the caller checks that first.
    pub fn join(&mut self, tree: &Self, pages_moved: u64) {
        let base =
            u32::try_from(self.nodes.len()).expect("nodes are counted before trees are joined");
        if base > 0 {
            self.later_roots.extend(tree.roots().map(|root| root + base));
        } else {
            self.later_roots.clone_from(&tree.later_roots);
        }
        if !tree.sides.is_empty() {
            self.sides.resize(self.nodes.len(), ALL_SIDES);
            self.sides.extend_from_slice(&tree.sides);
        }
        self.nodes.extend(tree.nodes.iter().map(|node| {
            let mut node = *node;
            node.parent = if node.parent == NONE { NONE } else { node.parent + base };
            node.first_child = if node.child_count == 0 { 0 } else { node.first_child + base };
            node.page_offset += pages_moved;
            node
        }));
    }

    /// Depth of each node: 0 for the roots.
    pub fn depths(&self) -> Vec<u32> {
        let mut depths = vec![0u32; self.nodes.len()];
        for (i, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.parent != NONE) {
            let above = depths.get(node.parent as usize).copied().unwrap_or(0);
            depths[i] = above + 1;
        }
        depths
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn joined_trees_keep_their_links_and_their_roots() {
        let node = |parent, first_child, child_count, page_offset| Node {
            parent,
            first_child,
            child_count,
            page_offset,
            ..Node::zeroed()
        };
        let mut tree =
            NodeTable::of_tree(vec![node(NONE, 1, 2, 64), node(0, 0, 0, 128), node(0, 0, 0, 192)]);
        let mut forest = NodeTable::default();
        assert_eq!(forest.roots().count(), 0);
        [0, 1000].into_iter().for_each(|moved| forest.join(&tree, moved));
        forest.join(&NodeTable::default(), 2000);
        tree.sides = vec![[1, 2], [3, 4], [5, 6]];
        forest.join(&tree, 3000);
        assert_eq!([5, 6, 8].map(|node| forest.sides_of(node)), [ALL_SIDES, [1, 2], [5, 6]]);
        assert_eq!(forest.roots().collect::<Vec<_>>(), [0, 3, 6]);
        assert_eq!(forest.depths(), [0, 1, 1, 0, 1, 1, 0, 1, 1]);
        for (first, moved) in [(0, 0), (3, 1000), (6, 3000)] {
            assert_eq!(forest.nodes[first].children(), first as u32 + 1..first as u32 + 3);
            assert_eq!(forest.nodes[first + 2].parent, first as u32);
            assert_eq!(forest.nodes[first + 2].page_offset, 192 + moved);
            assert!(forest.nodes[first + 1].children().is_empty());
        }
    }

    #[test]
    fn level_counts_survive() {
        let mut node = Node::zeroed();
        node.set_levels(&[33, 0, 70_000, 1]);
        assert_eq!(node.levels().collect::<Vec<_>>(), [33, 0, 70_000, 1]);
        assert_eq!(node.points(), 70_034);
    }

    #[test]
    fn moved_nodes_stay_on_the_lattice() {
        let mut node = Node { corner: [64; 3], cell_log2: 6, box_min: [70; 3], ..Node::zeroed() };
        node.set_levels(&[1]);
        let moved = node.moved([-64, 0, 7]).unwrap();
        assert_eq!((moved.corner, moved.box_min), ([0, 64, 71], [6, 70, 77]));
        assert_eq!(moved.own_box()[1], [63, 127, 134], "up to the last step of the cell");
        // The cell reaches beyond the lattice, the points do not.
        let beyond = node.moved([-70, 0, (1 << 32) - 71]).unwrap();
        assert_eq!(
            (beyond.corner, beyond.box_min),
            ([u32::MAX - 5, 64, u32::MAX - 6], [0, 70, u32::MAX])
        );
        assert_eq!(
            (beyond.cell().first(), beyond.cell().last()),
            ([0, 64, 0], [u32::MAX, 127, u32::MAX])
        );
        assert!(beyond.cell().contains([57, 64, 0]) && !beyond.cell().contains([58, 64, 0]));
        assert_eq!(node.moved([-71, 0, 0]), None);
        assert_eq!(node.moved([0, 0, (1 << 32) - 70]), None);
        assert_eq!(node.moved([i64::MAX, 0, 0]), None);
    }

    proptest! {
        #[test]
        fn packed_rotations_turn_axes_by_less_than_a_ten_thousandth(q in [-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0]) {
            prop_assume!(q.iter().map(|c| c * c).sum::<f64>() > 1e-3);
            let axes = axes_of(q);
            let (_, again) = pack_rotation(axes);
            for (a, b) in axes.iter().flatten().zip(again.iter().flatten()) {
                prop_assert!((a - b).abs() < 1e-4, "{axes:?} {again:?}");
            }
        }
    }
}
