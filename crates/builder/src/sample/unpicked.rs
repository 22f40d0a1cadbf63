//! The points that thinning may still pick, along the Morton curve: how far each is from the picked ones, and
//! which of them are near a place. Points of an octree cell stand together, so a table from cells to runs finds
//! neighbours; distances are in space.

use crate::sample::tiles::{Cells, CellsBuilder, NONE, TILE_LOG2, Tile, between};
use esker_points::fetch::fetch;
use fearless_simd::{Simd, SimdBase, SimdCvtFloat, f32x8, i32x8};
use std::ops::Range;

/// Points of a block: loops over them are registers where they are compiled for such.
const LANES: usize = 8;
/// The edge of the cells by which few neighbours are found is at least so many radii, and less than twice as many.
const EDGE_RADII: f64 = 1.5;
/// A tile of no more points is told as a whole.
const FEW: u32 = 12;
/// Blocks before and behind that of a place whose points stand beside it.
const BESIDE_BLOCKS: usize = 2;
/// So many blocks before it is looked at, a block is asked for.
const AHEAD: usize = 12;
/// Log2 of the edge of the cells, in steps, by which few neighbours within a radius are found.
pub fn octave(radius: f64) -> u32 {
    ((radius * EDGE_RADII).log2().ceil().max(0.0) as u32).min(31)
}

/// Coordinates of a block's points, axis by axis.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct BlockPoints([[i32; LANES]; 3]);

/// A number for each of a block's points.
#[derive(Clone, Copy, Default)]
#[repr(align(32))]
struct BlockValues([f32; LANES]);

/// Points in blocks, over which the innermost loop of a build runs. The last block's room that is left is at distance 0,
/// which is never picked. What runs often is inlined, and so compiled for the processor that thinning finds.
#[derive(Default)]
pub struct Unpicked {
    q: Vec<BlockPoints>,
    /// Square of the distance to the nearest picked point, where that is within the radius of the last telling;
    /// else any that is not.
    nearest2: Vec<BlockValues>,
    /// The turn from which on each is picked sooner than others; empty where none is.
    due: Vec<BlockValues>,
    /// Which candidate each is; [`NONE`] where there is none.
    candidate: Vec<u32>,
    /// The tile of each.
    tile_of: Vec<u32>,
    cells: Cells,
    /// Log2 of the edge of the cells.
    log2: u32,
    /// Points there were when it was filled.
    points: usize,
}

impl Unpicked {
    /// Takes other points: candidates in order, all of them far from picked ones.
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

    /// Leaves out what is picked or coincides with it, and finds neighbours by other cells.
    pub fn rebuild(&mut self, log2: u32) {
        let n = self.remove_picked();
        let mut builder = CellsBuilder::new(&mut self.cells, log2);
        for (i, tile) in self.tile_of[..n].iter_mut().enumerate() {
            *tile = builder.tile(self.q[i / LANES].get(i % LANES), i);
        }
        self.cells.close(n);
        self.finish(n, log2);
    }

    /// The same where no neighbours are found any more but those beside a place.
    pub fn shrink(&mut self) {
        let n = self.remove_picked();
        self.finish(n, self.log2);
    }

    /// Moves what is neither picked nor coincides with what is to the front. How many that are.
    fn remove_picked(&mut self) -> usize {
        let mut n = 0;
        for block in 0..self.q.len() {
            let (places, BlockValues(nearest2)) = (self.q[block], self.nearest2[block]);
            for (lane, &nearest2) in nearest2.iter().enumerate() {
                // Written in any case, to be written over: no guess what is left out goes wrong.
                self.q[n / LANES].set(n % LANES, places.get(lane));
                self.nearest2[n / LANES].0[n % LANES] = nearest2;
                self.candidate[n] = self.candidate[block * LANES + lane];
                n += usize::from(nearest2 > 0.0);
            }
        }
        n
    }

    /// There are so many points.
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

    /// How many points there were when they were last taken or left out.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Number of places: points, and room that is left.
    pub fn len(&self) -> usize {
        self.candidate.len()
    }

    /// The candidate at a place; [`NONE`] where there is none.
    pub fn candidate(&self, i: usize) -> u32 {
        self.candidate[i]
    }

    /// Tells from which turn on each is due, by candidate.
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

    /// See [`Unpicked::nearest2`].
    #[inline(always)]
    pub fn nearest2(&self, i: usize) -> f32 {
        self.nearest2[i / LANES].0[i % LANES]
    }

    /// The first place from `i` on which is so far, more than not at all, from picked points.
    #[inline(always)]
    pub fn next_from(&self, i: usize, least2: f32) -> Option<usize> {
        let least2 = wide::f32x8::from(least2);
        let nearest2 = self.nearest2[i / LANES..].iter();
        self.next(i, nearest2.map(|n| wide::f32x8::from(n.0).simd_ge(least2)))
    }

    /// The same among those due by a turn, where that was told.
    #[inline(always)]
    pub fn next_due_from(&self, i: usize, turn: u16, least2: f32) -> Option<usize> {
        let (turn, least2) = (wide::f32x8::from(f32::from(turn)), wide::f32x8::from(least2));
        let blocks = self.due[i / LANES..].iter().zip(&self.nearest2[i / LANES..]);
        let is_far = |n: &BlockValues| wide::f32x8::from(n.0).simd_ge(least2);
        self.next(i, blocks.map(|(d, n)| wide::f32x8::from(d.0).simd_le(turn) & is_far(n)))
    }

    /// The first place from `i` on which is wanted, of the blocks from its own on. (Skipping to it in an iterator that computes
    /// walks there, unless a compiler sees that it need not.)
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

    /// Asks for what is read of a block in which something is picked.
    #[inline(always)]
    fn fetch(&self, block: usize) {
        if let Some(BlockPoints([x, _, z])) = self.q.get(block) {
            fetch(x, 0);
            fetch(z, LANES - 1);
            fetch(&self.candidate, block * LANES);
            fetch(&self.tile_of, block * LANES);
        }
    }

    /// Tells all points within a radius of a place, itself among them, that it is picked.
    #[inline(always)]
    pub fn update_around<S: Simd>(&mut self, simd: S, i: usize, reach: i32) {
        // Not inlined: it is large. The position is read there: handed over, its numbers would be stored one
        // by one and loaded by twos, which waits for the stores.
        simd.vectorize(
            #[inline(always)]
            move || {
                let p = self.q[i / LANES].get(i % LANES);
                self.update_tiles(simd, self.tile_of[i], p, reach);
            },
        );
    }

    /// Tells the points that stand beside a place along the curve, most of those near it.
    #[inline(always)]
    pub fn update_beside<S: Simd>(&mut self, simd: S, i: usize) {
        let p = self.q[i / LANES].get(i % LANES).map(|c| i32x8::splat(simd, c));
        let first = (i / LANES).saturating_sub(BESIDE_BLOCKS);
        let end = (i / LANES + BESIDE_BLOCKS + 1).min(self.q.len());
        self.update_blocks(simd, first..end, p);
    }

    /// Tells all points within a radius of a position that has no place.
    #[inline(always)]
    pub fn update_near<S: Simd>(&mut self, simd: S, p: &[i32; 3], reach: i32) {
        simd.vectorize(
            #[inline(always)]
            move || self.update_tiles(simd, NONE, *p, reach),
        );
    }

    /// `own` is the tile of the position, if that is known.
    #[inline(always)]
    fn update_tiles<S: Simd>(&mut self, simd: S, own: u32, p: [i32; 3], reach: i32) {
        // No coordinate is negative, nor a reach.
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
                // Of tiles between the outer ones, all cells.
                let corner = [x, y, z];
                let from = [0, 1, 2].map(|i| if corner[i] == first[i] { low[i] } else { 0 });
                let to = [0, 1, 2].map(|i| if corner[i] == last[i] { high[i] } else { !0 });
                self.update_tile(simd, tile, between([from, to]), p);
            }
            // Wrapping: no tile lies at the end of all numbers.
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

    /// Tells the points in these cells of a tile, and some beside them: where cells follow each other along the
    /// curve they are told at once, and a tile of few points as a whole.
    #[inline(always)]
    fn update_tile<S: Simd>(&mut self, simd: S, tile: u32, cells: u64, p: [i32x8<S>; 3]) {
        let Tile { occupied, first, start } = self.cells.tiles[tile as usize];
        let end = self.cells.tiles[tile as usize + 1].start;
        if end.wrapping_sub(start) <= FEW {
            return self.update_run(simd, start, end, p);
        }
        let mut wanted = occupied & cells;
        let others = occupied & !cells;
        // The first point of an occupied cell.
        let point = |unpicked: &Self, cell: u32| {
            let before = (occupied & !(!0 << cell)).count_ones();
            unpicked.cells.first[first.wrapping_add(before) as usize]
        };
        while wanted != 0 {
            // From the next cell on, up to the first one behind it that is left out.
            let from = wanted.trailing_zeros();
            let behind = others & (!0 << from);
            let to = if behind == 0 { end } else { point(self, behind.trailing_zeros()) };
            self.update_run(simd, point(self, from), to, p);
            // Those before the cell that is left out; all, where none is.
            wanted &= !(behind & behind.wrapping_neg()).wrapping_sub(1);
        }
    }

    /// Differences are exact, and the rounding of their squares, the same everywhere, moves a radius by a ten
    /// millionth. Points that share a block with others are told too, which does no harm.
    #[inline(always)]
    fn update_run<S: Simd>(&mut self, simd: S, start: u32, end: u32, p: [i32x8<S>; 3]) {
        self.update_blocks(simd, start as usize / LANES..(end as usize).div_ceil(LANES), p);
    }

    #[inline(always)]
    fn update_blocks<S: Simd>(&mut self, simd: S, run: Range<usize>, p: [i32x8<S>; 3]) {
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
    /// The coordinates of a point of the block.
    #[inline(always)]
    fn get(&self, lane: usize) -> [i32; 3] {
        [self.0[0][lane], self.0[1][lane], self.0[2][lane]]
    }

    #[inline(always)]
    fn set(&mut self, lane: usize, p: [i32; 3]) {
        (0..3).for_each(|axis| self.0[axis][lane] = p[axis]);
    }
}
