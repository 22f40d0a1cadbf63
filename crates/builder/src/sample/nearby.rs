//! A grid of the points of a cell, to look up those near a point across borders of octree cells.
//! Coincident points are one *place*. A search visits few places, however many share a cell of the
//! grid (`sample/boxes.rs`).

use crate::sample::boxes::{Boxes, Run, Unopened, length2};
use crate::sample::tiles::{Cells, CellsBuilder, NONE, TILE_LOG2, between};
use std::ops::Range;

/// Places by cells whose edge is at least the distance that is searched.
pub struct NeighbourGrid {
    /// Distinct positions in steps, along the curve.
    places: Vec<[i32; 3]>,
    /// First point of each place, and the end of the last one.
    first: Vec<u32>,
    /// Log2 of the edge of cells, in steps.
    log2: u32,
    cells: Cells,
    boxes: Boxes,
}

impl NeighbourGrid {
    /// Builds the grid of points along the curve; `far` is the distance to be searched, in steps.
    pub fn new(q: &[[i32; 3]], far: f64) -> Self {
        let log2 = far.log2().ceil().clamp(0.0, 30.0) as u32;
        let mut places: Vec<[i32; 3]> = Vec::with_capacity(q.len());
        let mut first = Vec::with_capacity(q.len() + 1);
        let mut cells = Cells::default();
        let mut builder = CellsBuilder::new(&mut cells, log2);
        for (point, &p) in (0..).zip(q) {
            if places.last() != Some(&p) {
                builder.tile(p, places.len());
                places.push(p);
                first.push(point);
            }
        }
        first.push(q.len() as u32);
        cells.close(places.len());
        let crowd = cells.first.windows(2).map(|ends| ends[1] - ends[0]).max().unwrap_or(0);
        let boxes = Boxes::of(&places, crowd as usize);
        Self { places, first, log2, cells, boxes }
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// The points of consecutive places.
    pub fn points(&self, places: &Range<usize>) -> Range<usize> {
        self.first[places.start] as usize..self.first[places.end] as usize
    }

    /// The points of a place.
    pub fn points_at(&self, place: usize) -> Range<usize> {
        self.points(&(place..place + 1))
    }

    /// Edge of a cell, in steps.
    pub fn edge(&self) -> f64 {
        f64::from(1u32 << self.log2)
    }

    /// Lists, in `runs`, the occupied cells among that of a place and the 26 around it.
    pub fn around(&self, place: usize, runs: &mut Vec<Run>) {
        runs.clear();
        let p = self.places[place];
        let cell = p.map(|c| c >> self.log2);
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
                    let places = self.cells.first[at] as usize..self.cells.first[at + 1] as usize;
                    let away2 = self.away2(p, self.places[places.start]);
                    runs.push(Run { places, away2 });
                    wanted &= wanted - 1;
                }
            }
        }
    }

    /// Square of the distance from `p` to the cell that holds `other`.
    fn away2(&self, p: [i32; 3], other: [i32; 3]) -> f64 {
        let along = |axis: usize| {
            let low = f64::from(other[axis] >> self.log2 << self.log2);
            let (high, p) = (low + self.edge() - 1.0, f64::from(p[axis]));
            (low - p).max(p - high).max(0.0)
        };
        length2(&[0, 1, 2].map(along))
    }

    /// Calls `add` with the places of `runs` that are nearest to `place`, and perhaps others. It
    /// gets the index of the run, the place and its squared distance, and returns the squared
    /// distance beyond which places do not matter from then on.
    pub fn nearest(
        &self,
        place: usize,
        runs: &[Run],
        unopened: &mut Unopened,
        add: impl FnMut(usize, usize, f64) -> f64,
    ) {
        let p = self.places[place];
        let from = (p, length2, f64::INFINITY);
        self.boxes.nearest((&self.places, runs), from, unopened, add);
    }

    /// Calls `visit` with the places of a run within `reach` of `place`, along the curve, and the
    /// vectors to them, until it returns false; returns whether it never did.
    pub fn within(
        &self,
        place: usize,
        run: &Run,
        reach: f64,
        mut visit: impl FnMut(usize, [f64; 3]) -> bool,
    ) -> bool {
        let (p, reach2) = (self.places[place], reach * reach);
        self.boxes.within(&self.places, run.places.clone(), p, reach2, &mut visit)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::sample::boxes::offset;
    use crate::sample::candidates::tests::candidates_of;
    use proptest::prelude::*;

    /// Points in the 27 cells around point `i`, by the definition of a grid: tile by tile, along z,
    /// y and x, and along the curve in a tile, as the points are.
    pub fn plain_around(q: &[[i32; 3]], i: usize, far: f64) -> Vec<usize> {
        let log2 = far.log2().ceil().clamp(0.0, 30.0) as u32;
        let cell = |j: usize| q[j].map(|c| c >> log2);
        let is_near = |&j: &usize| (0..3).all(|axis| cell(i)[axis].abs_diff(cell(j)[axis]) < 2);
        let mut near: Vec<usize> = (0..q.len()).filter(is_near).collect();
        let tile = |j: &usize| cell(*j).map(|c| c >> TILE_LOG2);
        near.sort_by_key(|j| (tile(j)[2], tile(j)[1], tile(j)[0]));
        near
    }

    proptest! {
        #[test]
        fn runs_are_the_points_of_27_cells(points in prop::collection::vec([0u32..900, 0u32..900, 0u32..40], 1..300), far in 1.0..200.0) {
            let candidates = candidates_of(&points, [0.01; 3]);
            let near = NeighbourGrid::new(&candidates.q, far);
            prop_assert!(near.edge() >= far);
            let cell = |i: usize| candidates.q[i].map(|c| c >> near.log2);
            let mut runs = Vec::new();
            for place in 0..near.len() {
                let i = near.points_at(place).start;
                near.around(place, &mut runs);
                let mut found = Vec::new();
                for run in &runs {
                    let points = near.points(&run.places);
                    prop_assert!(points.clone().all(|j| cell(j) == cell(points.start)));
                    let nearest = points.clone().map(|j| length2(&offset(candidates.q[i], candidates.q[j])));
                    prop_assert!(run.away2 <= nearest.fold(f64::INFINITY, f64::min));
                    found.extend(points);
                }
                prop_assert_eq!(found, plain_around(&candidates.q, i, far));
            }
        }
    }

    #[test]
    fn cells_at_the_ends_of_the_lattice_are_searched() {
        let end = i32::MAX;
        let q = [[0; 3], [1; 3], [end - 1, end, end], [end; 3]];
        for far in [0.5, 1.0, 3.0, 1e9] {
            let near = NeighbourGrid::new(&q, far);
            let (mut found, mut runs) = (0, Vec::new());
            for place in 0..near.len() {
                near.around(place, &mut runs);
                found += runs.iter().map(|run| run.places.len()).sum::<usize>();
            }
            assert!(found >= q.len(), "{found}");
        }
    }
}
