//! A grid of the points of a cell, to look up those near a point across borders of octree cells.

use crate::sample::tiles::{Cells, CellsBuilder, NONE, TILE_LOG2, between};
use std::ops::Range;

/// Points by cells whose edge is at least the distance that is searched.
pub struct NeighbourGrid<'a> {
    /// Positions in steps, along the curve.
    q: &'a [[i32; 3]],
    /// Log2 of the edge of cells, in steps.
    log2: u32,
    cells: Cells,
}

impl<'a> NeighbourGrid<'a> {
    /// Builds the grid; `far` is the distance to be searched, in steps.
    pub fn new(q: &'a [[i32; 3]], far: f64) -> Self {
        let log2 = far.log2().ceil().clamp(0.0, 30.0) as u32;
        let mut cells = Cells::default();
        let mut builder = CellsBuilder::new(&mut cells, log2);
        for (i, &p) in q.iter().enumerate() {
            builder.tile(p, i);
        }
        cells.close(q.len());
        Self { q, log2, cells }
    }

    /// Edge of a cell, in steps.
    pub fn edge(&self) -> f64 {
        f64::from(1u32 << self.log2)
    }

    /// Calls `f` with the indices of the points of each occupied cell among that of point `i` and
    /// the 26 around it.
    pub fn each_run(&self, i: usize, mut f: impl FnMut(Range<usize>)) {
        let cell = self.q[i].map(|c| c >> self.log2);
        let (low, high) = (cell.map(|c| c - 1), cell.map(|c| c.saturating_add(1)));
        let tiles = |axis: usize| low[axis] >> TILE_LOG2..=high[axis] >> TILE_LOG2;
        for z in tiles(2) {
            for (x, y) in tiles(1).flat_map(|y| tiles(0).map(move |x| (x, y))) {
                let tile = self.cells.find([x, y, z]);
                if tile == NONE {
                    continue;
                }
                let tile = self.cells.tiles[tile as usize];
                // Clamped to the tile: of a tile between others, all cells.
                let corner = [x, y, z].map(|c| c << TILE_LOG2);
                let from = [0, 1, 2].map(|axis| low[axis].max(corner[axis]));
                let to = [0, 1, 2].map(|axis| high[axis].min(corner[axis] | 3));
                let mut wanted = tile.occupied & between([from, to]);
                while wanted != 0 {
                    let before = tile.occupied & ((1 << wanted.trailing_zeros()) - 1);
                    let at = (tile.first + before.count_ones()) as usize;
                    f(self.cells.first[at] as usize..self.cells.first[at + 1] as usize);
                    wanted &= wanted - 1;
                }
            }
        }
    }

    /// Square of the distance of two points, in steps.
    pub fn distance2(&self, i: usize, j: usize) -> f64 {
        self.offset(i, j).iter().map(|along| along * along).sum()
    }

    /// Vector from point `i` to point `j`, in steps.
    pub fn offset(&self, i: usize, j: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(self.q[j][axis]) - f64::from(self.q[i][axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_are_the_points_of_27_cells(points in prop::collection::vec([0u32..900, 0u32..900, 0u32..40], 1..300), far in 1.0..200.0) {
            let candidates = candidates_of(&points, [0.01; 3]);
            let near = NeighbourGrid::new(&candidates.q, far);
            prop_assert!(near.edge() >= far);
            let cell = |i: usize| candidates.q[i].map(|c| c >> near.log2);
            for i in 0..candidates.len() {
                let mut found = Vec::new();
                near.each_run(i, |run| {
                    assert!(run.clone().all(|j| cell(j) == cell(run.start)));
                    found.extend(run);
                });
                found.sort_unstable();
                let is_near = |&j: &usize| (0..3).all(|axis| cell(i)[axis].abs_diff(cell(j)[axis]) < 2);
                prop_assert_eq!(found, (0..candidates.len()).filter(is_near).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn cells_at_the_ends_of_the_lattice_are_searched() {
        let end = i32::MAX;
        let q = [[0; 3], [1; 3], [end - 1, end, end], [end; 3]];
        for far in [0.5, 1.0, 3.0, 1e9] {
            let near = NeighbourGrid::new(&q, far);
            let mut found = 0;
            (0..q.len()).for_each(|i| near.each_run(i, |run| found += run.len()));
            assert!(found >= q.len(), "{found}");
        }
    }
}
