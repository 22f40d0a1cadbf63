//! The points that thinning may still pick, along the Morton curve, with their distances to the
//! nearest picked point. A table of cells to ranges of points finds neighbours, since the points of
//! an octree cell are contiguous; distances are computed in space, eight at a time.

use crate::sample::boxes::{Boxes, Run, Unopened};
use crate::sample::tiles::{Cells, CellsBuilder, NONE, TILE_LOG2, Tile, between};
use esker_points::fetch::fetch;
use fearless_simd::{Simd, SimdBase, SimdCvtFloat, f32x8, i32x8};
use std::ops::Range;

/// Points of a block: a loop over them compiles to vector registers.
const LANES: usize = 8;
/// Cells that find neighbours have an edge of at least this many radii, and less than twice as
/// many.
const EDGE_RADII: f64 = 1.5;
/// A tile with no more points is updated as a whole.
const FEW: u32 = 12;
/// Blocks before and after that of a picked point that are updated with it.
const BESIDE_BLOCKS: usize = 2;
/// Blocks between one that is examined and the one that is prefetched.
const AHEAD: usize = 12;
/// Log2 of the edge, in steps, of the cells that find neighbours within `radius`.
pub fn octave(radius: f64) -> u32 {
    ((radius * EDGE_RADII).log2().ceil().max(0.0) as u32).min(31)
}

/// Coordinates of a block's points, axis by axis.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct BlockPoints([[i32; LANES]; 3]);

/// A number for each point of a block.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct BlockValues([f32; LANES]);

/// Points in blocks, over which the innermost loop of a build runs. Free places of the last block
/// have distance 0, which is never picked. Hot functions are inlined, and so compiled for the
/// vector instructions that are detected at run time.
#[derive(Default)]
pub struct Unpicked {
    q: Vec<BlockPoints>,
    /// Square of the distance to the nearest picked point, if that is within the radius of the last
    /// update; else any greater value.
    nearest2: Vec<BlockValues>,
    /// Turn from which on each point is picked at a smaller distance; empty if there is none.
    due: Vec<BlockValues>,
    /// Candidate at each place; [`NONE`] at free places.
    candidate: Vec<u32>,
    /// Tile of each point.
    tile_of: Vec<u32>,
    cells: Cells,
    /// Log2 of the edge of the cells.
    log2: u32,
    /// Number of points when it was last filled or shrunk.
    points: usize,
}

impl Unpicked {
    /// Replaces the points by `candidates`, in order, all of them far from picked points.
    pub fn refill(&mut self, q: &[[i32; 3]], candidates: &[u32], log2: u32) {
        let blocks = candidates.len().div_ceil(LANES);
        self.q.clear();
        self.q.reserve(blocks);
        self.nearest2.clear();
        self.nearest2.resize(blocks, BlockValues([f32::INFINITY; LANES]));
        self.candidate.clear();
        self.candidate.reserve(blocks * LANES);
        self.candidate.extend_from_slice(candidates);
        self.candidate.resize(blocks * LANES, NONE);
        self.tile_of.clear();
        self.tile_of.reserve(blocks * LANES);
        let mut builder = CellsBuilder::new(&mut self.cells, log2);
        for block in candidates.chunks(LANES) {
            let (mut places, mut tiles) = (BlockPoints::default(), [NONE; LANES]);
            for (lane, &candidate) in block.iter().enumerate() {
                let p = q[candidate as usize];
                places.set(lane, p);
                tiles[lane] = builder.tile(p, self.tile_of.len() + lane);
            }
            self.q.push(places);
            self.tile_of.extend_from_slice(&tiles);
        }
        self.cells.close(candidates.len());
        self.finish(candidates.len(), log2);
    }

    /// Removes points that are picked or coincide with picked ones, and finds neighbours by cells
    /// of another size from then on.
    pub fn rebuild(&mut self, log2: u32) {
        let n = self.remove_picked();
        let mut builder = CellsBuilder::new(&mut self.cells, log2);
        for (i, tile) in self.tile_of[..n].iter_mut().enumerate() {
            *tile = builder.tile(self.q[i / LANES].get(i % LANES), i);
        }
        self.cells.close(n);
        self.finish(n, log2);
    }

    /// Removes points that are picked or coincide with picked ones. Only
    /// [`Unpicked::update_beside`] may follow.
    pub fn shrink(&mut self) {
        let n = self.remove_picked();
        self.finish(n, self.log2);
    }

    /// Moves the points that remain to the front; returns their number.
    fn remove_picked(&mut self) -> usize {
        let mut n = 0;
        for block in 0..self.q.len() {
            let (places, BlockValues(nearest2)) = (self.q[block], self.nearest2[block]);
            for (lane, &nearest2) in nearest2.iter().enumerate() {
                // Written in any case and overwritten if the point is removed: without a branch
                // nothing is mispredicted.
                self.q[n / LANES].set(n % LANES, places.get(lane));
                self.nearest2[n / LANES].0[n % LANES] = nearest2;
                self.candidate[n] = self.candidate[block * LANES + lane];
                n += usize::from(nearest2 > 0.0);
            }
        }
        n
    }

    /// Cuts all columns to `n` points.
    fn finish(&mut self, n: usize, log2: u32) {
        self.log2 = log2;
        self.points = n;
        let blocks = n.div_ceil(LANES);
        self.q.truncate(blocks);
        self.nearest2.truncate(blocks);
        self.candidate.truncate(blocks * LANES);
        self.tile_of.truncate(blocks * LANES);
        for i in n..self.candidate.len() {
            self.nearest2[i / LANES].0[i % LANES] = 0.0;
            self.candidate[i] = NONE;
        }
    }

    /// Log2 of the edge of the cells by which neighbours are found.
    pub fn log2(&self) -> u32 {
        self.log2
    }

    /// Number of points when it was last filled or shrunk.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Number of places, including free ones.
    pub fn len(&self) -> usize {
        self.candidate.len()
    }

    /// Candidate at a place; [`NONE`] if it is free.
    pub fn candidate(&self, i: usize) -> u32 {
        self.candidate[i]
    }

    /// Sets the turn from which on each point is due, by candidate.
    pub fn set_due(&mut self, turns: &[u16]) {
        let turn = |candidate: u32| turns.get(candidate as usize).copied().unwrap_or(u16::MAX);
        let blocks = self.candidate.as_chunks().0.iter();
        self.due.clear();
        self.due.extend(blocks.map(|block| BlockValues(block.map(|c| turn(c).into()))));
    }

    /// Square of the greatest distance to a picked point.
    pub fn farthest2(&self) -> f32 {
        let each = self.nearest2.iter().map(|n| wide::f32x8::from(n.0));
        let farthest = each.fold(wide::f32x8::ZERO, wide::f32x8::fast_max);
        farthest.to_array().into_iter().fold(0.0, f32::max)
    }

    /// Square of the distance to the nearest picked point; see the field.
    #[inline(always)]
    pub fn nearest2(&self, i: usize) -> f32 {
        self.nearest2[i / LANES].0[i % LANES]
    }

    /// First place from `i` on whose squared distance is at least `least2`, which is positive.
    #[inline(always)]
    pub fn next_from(&self, i: usize, least2: f32) -> Option<usize> {
        let least2 = wide::f32x8::from(least2);
        let nearest2 = self.nearest2[i / LANES..].iter();
        self.next(i, nearest2.map(|n| wide::f32x8::from(n.0).simd_ge(least2)))
    }

    /// Variant of [`Unpicked::next_from`] among the points due by `turn`, after
    /// [`Unpicked::set_due`].
    #[inline(always)]
    pub fn next_due_from(&self, i: usize, turn: u16, least2: f32) -> Option<usize> {
        let (turn, least2) = (wide::f32x8::from(f32::from(turn)), wide::f32x8::from(least2));
        let blocks = self.due[i / LANES..].iter().zip(&self.nearest2[i / LANES..]);
        let is_far = |n: &BlockValues| wide::f32x8::from(n.0).simd_ge(least2);
        self.next(i, blocks.map(|(d, n)| wide::f32x8::from(d.0).simd_le(turn) & is_far(n)))
    }

    /// First place from `i` on that is wanted; `blocks` begins with the block of `i`. (Skipping in
    /// an iterator that computes would walk there, unless the compiler sees that it need not.)
    #[inline(always)]
    fn next(&self, i: usize, blocks: impl Iterator<Item = wide::f32x8>) -> Option<usize> {
        let mut wanted = !0 << (i % LANES);
        for (block, is_wanted) in (i / LANES..).zip(blocks) {
            self.fetch(block + AHEAD);
            wanted &= is_wanted.to_bitmask();
            if wanted != 0 {
                return Some(block * LANES + wanted.trailing_zeros() as usize);
            }
            wanted = !0;
        }
        None
    }

    /// Prefetches what is read of a block in which a point is picked.
    #[inline(always)]
    fn fetch(&self, block: usize) {
        if let Some(BlockPoints([x, _, z])) = self.q.get(block) {
            fetch(x, 0);
            fetch(z, LANES - 1);
            fetch(&self.candidate, block * LANES);
            fetch(&self.tile_of, block * LANES);
        }
    }

    /// Updates the distances of all points within a radius of the picked point at place `i`, itself
    /// included.
    #[inline(always)]
    pub fn update_around<S: Simd>(&mut self, simd: S, i: usize, reach: i32) {
        // Not inlined, since it is large. The position is read inside: passed by value it would be
        // stored number by number and loaded in pairs, which stalls store forwarding.
        simd.vectorize(
            #[inline(always)]
            move || {
                let p = self.q[i / LANES].get(i % LANES);
                self.update_tiles(simd, self.tile_of[i], p, reach);
            },
        );
    }

    /// Updates the points beside a place along the curve, most of those near it.
    #[inline(always)]
    pub fn update_beside<S: Simd>(&mut self, simd: S, i: usize) {
        let p = self.q[i / LANES].get(i % LANES).map(|c| i32x8::splat(simd, c));
        let first = (i / LANES).saturating_sub(BESIDE_BLOCKS);
        let end = (i / LANES + BESIDE_BLOCKS + 1).min(self.q.len());
        self.update_blocks(simd, first..end, p);
    }

    /// Updates all points within a radius of a position that has no place.
    #[inline(always)]
    pub fn update_near<S: Simd>(&mut self, simd: S, p: &[i32; 3], reach: i32) {
        simd.vectorize(
            #[inline(always)]
            move || self.update_tiles(simd, NONE, *p, reach),
        );
    }

    /// Variant of [`Unpicked::update_near`] for many `picked` positions along the curve, with the
    /// same distances: searches the nearest of them for each point.
    pub fn find_nearest(&mut self, picked: &[[i32; 3]], reach: i32) {
        // Rounds as the updates do.
        let metric = |offset: &[f64; 3]| {
            let [x, y, z] = offset.map(|along| along as f32);
            f64::from(x * x + y * y + z * z)
        };
        let boxes = Boxes::of(picked, picked.len());
        let runs = [Run { places: 0..picked.len(), away2: 0.0 }];
        let mut unopened = Unopened::default();
        let limit2 = metric(&[f64::from(reach), 0.0, 0.0]);
        for i in 0..self.points {
            let p = self.q[i / LANES].get(i % LANES);
            let from = (p, metric, limit2);
            let nearest2 = &mut self.nearest2[i / LANES].0[i % LANES];
            boxes.nearest((picked, &runs), from, &mut unopened, |_, _, away2| {
                *nearest2 = away2 as f32;
                away2
            });
        }
    }

    /// Updates the cells around `p` tile by tile; `own` is the tile of `p`, or [`NONE`].
    #[inline(always)]
    fn update_tiles<S: Simd>(&mut self, simd: S, own: u32, p: [i32; 3], reach: i32) {
        // Neither coordinates nor the reach are negative.
        let low = p.map(|c| c.wrapping_sub(reach) >> self.log2);
        let high = p.map(|c| c.saturating_add(reach) >> self.log2);
        let (first, last) = (low.map(|c| c >> TILE_LOG2), high.map(|c| c >> TILE_LOG2));
        let p = p.map(|c| i32x8::splat(simd, c));
        if own != NONE && first == last {
            return self.update_tile(simd, own, between([low, high]), p);
        }
        let [mut x, mut y, mut z] = first;
        loop {
            let tile = self.cells.find([x, y, z]);
            if tile != NONE {
                // All cells of tiles between the outer ones.
                let corner = [x, y, z];
                let from = [0, 1, 2].map(|i| if corner[i] == first[i] { low[i] } else { 0 });
                let to = [0, 1, 2].map(|i| if corner[i] == last[i] { high[i] } else { !0 });
                self.update_tile(simd, tile, between([from, to]), p);
            }
            // Additions wrap; no tile lies at the largest number.
            if x < last[0] {
                x = x.wrapping_add(1);
            } else if y < last[1] {
                (x, y) = (first[0], y.wrapping_add(1));
            } else if z < last[2] {
                (x, y, z) = (first[0], first[1], z.wrapping_add(1));
            } else {
                return;
            }
        }
    }

    /// Updates the points in `cells` of a tile, and some beside them: cells that are consecutive
    /// along the curve are updated as one range, a tile with few points as a whole.
    #[inline(always)]
    fn update_tile<S: Simd>(&mut self, simd: S, tile: u32, cells: u64, p: [i32x8<S>; 3]) {
        let Tile { occupied, first, start } = self.cells.tiles[tile as usize];
        let end = self.cells.tiles[tile as usize + 1].start;
        if end.wrapping_sub(start) <= FEW {
            return self.update_run(simd, start, end, p);
        }
        let mut wanted = occupied & cells;
        let others = occupied & !cells;
        // First point of an occupied cell.
        let point = |unpicked: &Self, cell: u32| {
            let before = (occupied & !(!0 << cell)).count_ones();
            unpicked.cells.first[first.wrapping_add(before) as usize]
        };
        while wanted != 0 {
            // From the next wanted cell to the first one behind it that is not.
            let from = wanted.trailing_zeros();
            let behind = others & (!0 << from);
            let to = if behind == 0 { end } else { point(self, behind.trailing_zeros()) };
            self.update_run(simd, point(self, from), to, p);
            // Drops the cells before that one; all if there is none.
            wanted &= !(behind & behind.wrapping_neg()).wrapping_sub(1);
        }
    }

    /// Updates the blocks that contain the points `start..end`. Differences are exact; the squares
    /// round the same on every machine, by a ten-millionth of a radius. Other points of the same
    /// blocks are updated too, which does no harm.
    #[inline(always)]
    fn update_run<S: Simd>(&mut self, simd: S, start: u32, end: u32, p: [i32x8<S>; 3]) {
        self.update_blocks(simd, start as usize / LANES..(end as usize).div_ceil(LANES), p);
    }

    #[inline(always)]
    fn update_blocks<S: Simd>(&mut self, simd: S, run: Range<usize>, p: [i32x8<S>; 3]) {
        #[cfg(test)]
        crate::sample::effort::add(run.len());
        for (BlockPoints(q), BlockValues(nearest2)) in
            self.q[run.clone()].iter().zip(&mut self.nearest2[run])
        {
            let d =
                |axis: usize| f32x8::float_from(i32x8::load_array_ref(simd, &q[axis]) - p[axis]);
            let (x, y, z) = (d(0), d(1), d(2));
            let nearer2 = f32x8::load_array_ref(simd, nearest2).min(x * x + y * y + z * z);
            nearer2.store_array(nearest2);
        }
    }
}

impl BlockPoints {
    /// Coordinates of a point of the block.
    #[inline(always)]
    fn get(&self, lane: usize) -> [i32; 3] {
        [self.0[0][lane], self.0[1][lane], self.0[2][lane]]
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, p: [i32; 3]) {
        (0..3).for_each(|axis| self.0[axis][lane] = p[axis]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use fearless_simd::{Level, dispatch};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn distances_are_the_same_point_by_point_and_pick_by_pick(points in prop::collection::vec([0u32..3000, 0u32..3000, 0u32..99], 2..200), dense in prop::collection::vec([700u32..720, 700u32..720, 0u32..9], 0..200), shift in 0u32..19, reach in 1i32..3000, every in 2usize..9) {
            let points: Vec<_> = points.iter().chain(&dense).map(|p| p.map(|c| c << shift)).collect();
            let q = candidates_of(&points, [1.0; 3]).q;
            let reach = reach << shift;
            let (picked, others): (Vec<u32>, Vec<u32>) = (0..q.len() as u32).partition(|i| *i as usize % every == 1);
            let places: Vec<[i32; 3]> = picked.iter().map(|&i| q[i as usize]).collect();
            let mut both = [Unpicked::default(), Unpicked::default()];
            both.iter_mut().for_each(|of| of.refill(&q, &others, octave(reach.into())));
            both[0].find_nearest(&places, reach);
            dispatch!(Level::new(), simd => places.iter().for_each(|p| both[1].update_near(simd, p, reach)));
            let limit2 = reach as f32 * reach as f32;
            for i in 0..others.len() {
                let [found, updated] = [0, 1].map(|k| both[k].nearest2(i));
                prop_assert!(found == updated || found.min(updated) > limit2, "{found} {updated}");
            }
        }
    }
}
