//! Cells: size-aligned cubes of the absolute lattice, given by their corner and the log2 of their
//! edge in steps. All tests are integer arithmetic, so a point is never in two cells of one level.

/// A cube of the octree. Its edge is `2^log2` steps, its corner a multiple of that; `log2` is 0 to
/// 32.
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
        Self::containing(p, self.log2).corner == self.corner
    }

    /// Whether `other` is in the cell (a cell is in itself).
    pub fn contains_cell(&self, other: &Self) -> bool {
        other.log2 <= self.log2 && self.contains(other.corner)
    }

    /// Index of the child octant that holds `p`: `x | y << 1 | z << 2`. The cell must be larger
    /// than a point.
    pub fn octant(&self, p: [u32; 3]) -> u8 {
        debug_assert!(self.log2 > 0 && self.contains(p));
        let bit = self.log2 - 1;
        ((p[0] >> bit & 1) | (p[1] >> bit & 1) << 1 | (p[2] >> bit & 1) << 2) as u8
    }

    /// Highest lattice point in the cell.
    pub fn last(&self) -> [u32; 3] {
        let span = ((1u64 << self.log2) - 1) as u32;
        self.corner.map(|c| c | span)
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
