//! Cells: cubes of the lattice, given by their corner and the log2 of their edge in steps. All
//! tests are integer arithmetic, so a point is never in two cells of one level. In a file, corners
//! are multiples of the edge; a tree that was moved by whole steps has moved cells, so tests count
//! from the corner. A moved cell may reach beyond the lattice, where it has no points: numbers of
//! steps then wrap around.

/// A cube of the octree. Its edge is `2^log2` steps; `log2` is 0 to 32. Its corner is a multiple of
/// the edge, unless its tree was moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Cell {
    /// Lowest lattice point in the cell.
    pub corner: [u32; 3],
    /// Log2 of the edge in steps; 32 is the whole lattice, 0 a single lattice point.
    pub log2: u8,
}

impl Cell {
    /// The cell of this size that holds `p`.
    #[inline]
    pub fn containing([x, y, z]: [u32; 3], log2: u8) -> Self {
        Self { corner: [truncate(x, log2), truncate(y, log2), truncate(z, log2)], log2 }
    }

    /// The smallest cell that holds both corners of a box (`min <= max` on each axis).
    pub fn enclosing(min: [u32; 3], max: [u32; 3]) -> Self {
        let differing = (min[0] ^ max[0]) | (min[1] ^ max[1]) | (min[2] ^ max[2]);
        Self::containing(min, (32 - differing.leading_zeros()) as u8)
    }

    /// Whether the lattice point is in the cell.
    #[inline]
    pub fn contains(&self, p: [u32; 3]) -> bool {
        let from = self.steps_within(p);
        u64::from(from[0] | from[1] | from[2]) >> self.log2 == 0
    }

    /// Whether `other` is in the cell (a cell is in itself).
    pub fn contains_cell(&self, other: &Self) -> bool {
        other.log2 <= self.log2 && self.contains(other.corner)
    }

    /// Index of the child octant that holds `p`: `x | y << 1 | z << 2`. The cell must be larger
    /// than a point.
    pub fn octant(&self, p: [u32; 3]) -> u8 {
        debug_assert!(self.log2 > 0 && self.contains(p));
        let (bit, [x, y, z]) = (self.log2 - 1, self.steps_within(p));
        ((x >> bit & 1) | (y >> bit & 1) << 1 | (z >> bit & 1) << 2) as u8
    }

    /// Steps from the corner; those of points outside wrap around and are too large.
    #[inline]
    fn steps_within(&self, p: [u32; 3]) -> [u32; 3] {
        [0, 1, 2].map(|axis| p[axis].wrapping_sub(self.corner[axis]))
    }

    /// Lowest lattice point in the cell: its corner, or the least of the lattice on axes on which
    /// it reaches beyond the lattice.
    pub fn first(&self) -> [u32; 3] {
        let is_within = |c: u32| u64::from(c) + self.edge() <= 1 << 32;
        self.corner.map(|c| if is_within(c) { c } else { 0 })
    }

    /// Highest lattice point in the cell, or the greatest of the lattice on axes on which it
    /// reaches beyond the lattice.
    pub fn last(&self) -> [u32; 3] {
        let span = ((1u64 << self.log2) - 1) as u32;
        self.corner.map(|c| c.saturating_add(span))
    }

    /// Edge in steps.
    pub fn edge(&self) -> u64 {
        1 << self.log2
    }

    /// Whether corner and size make a cell: the size at most 32, the corner aligned to it.
    pub fn is_valid(&self) -> bool {
        self.log2 <= 32 && self.corner.iter().all(|&c| truncate(c, self.log2) == c)
    }
}

#[inline]
fn truncate(c: u32, log2: u8) -> u32 {
    (u64::from(c) >> log2 << log2) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn moved_cells_hold_what_was_moved_with_them(
            p in [0u32..1 << 20, 0u32..1 << 20, 0u32..1 << 20],
            near in [0u32..1 << 20, 0u32..1 << 20, 0u32..1 << 20],
            steps in 0u32..1 << 30,
            log2 in 1u8..20,
        ) {
            let cell = Cell::containing(near, log2);
            let by = |c: [u32; 3]| c.map(|c| c + steps);
            let moved = Cell { corner: by(cell.corner), ..cell };
            prop_assert_eq!(cell.contains(p), Cell::containing(p, log2) == cell);
            prop_assert_eq!(moved.contains(by(p)), cell.contains(p));
            prop_assert_eq!(moved.octant(by(near)), cell.octant(near));
            prop_assert_eq!(moved.last(), by(cell.last()));
        }
    }

    #[test]
    fn the_whole_lattice_and_single_points_are_cells() {
        let whole = Cell::enclosing([0; 3], [u32::MAX; 3]);
        assert_eq!(whole, Cell { corner: [0; 3], log2: 32 });
        assert_eq!(whole.last(), [u32::MAX; 3]);
        assert_eq!(whole.octant([u32::MAX, 0, u32::MAX]), 5);
        let point = Cell::enclosing([7, 8, 9], [7, 8, 9]);
        assert_eq!(point, Cell { corner: [7, 8, 9], log2: 0 });
        assert_eq!(point.last(), [7, 8, 9]);
    }

    proptest! {
        #[test]
        fn the_enclosing_cell_is_the_smallest(a: [u32; 3], b: [u32; 3]) {
            let (mut min, mut max) = (a, b);
            for i in 0..3 { min[i] = a[i].min(b[i]); max[i] = a[i].max(b[i]); }
            let cell = Cell::enclosing(min, max);
            prop_assert!(cell.is_valid() && cell.contains(min) && cell.contains(max));
            if cell.log2 > 0 {
                prop_assert_ne!(cell.octant(min), cell.octant(max));
            }
        }

        #[test]
        fn every_point_is_in_exactly_one_child(p: [u32; 3], log2 in 1u8..=32) {
            let cell = Cell::containing(p, log2);
            let child = Cell::containing(p, log2 - 1);
            prop_assert!(cell.contains_cell(&child) && child.contains(p));
            let o = cell.octant(p);
            let half = (1u64 << (log2 - 1)) as u32;
            for axis in 0..3 {
                let upper = o >> axis & 1 == 1;
                prop_assert_eq!(child.corner[axis], cell.corner[axis] + if upper { half } else { 0 });
            }
        }
    }
}
