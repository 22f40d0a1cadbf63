//! The points that thinning may still pick, along the Morton curve: how far each is from the picked ones, and
//! which of them are near a place. Points of an octree cell stand together, so a table from cells to runs finds
//! neighbours; distances are in space.

use wide::{f32x4, i32x4};

/// Points of a block.
const LANES: usize = 4;
/// The edge of the cells by which few neighbours are found is at least so many radii, and less than twice as many.
const EDGE_RADII: f64 = 1.5;
/// Instead of a candidate, where a block has room left.
pub const NONE: u32 = u32::MAX;

/// Log2 of the edge of the cells, in steps, by which few neighbours within a radius are found.
pub fn octave(radius: f64) -> u32 {
    ((radius * EDGE_RADII).log2().ceil().max(0.0) as u32).min(31)
}

/// Points in blocks of four, over which the innermost loop of a build runs. The last block's room that is left is at
/// distance 0, which is never picked.
#[derive(Default)]
pub struct Rest {
    /// Coordinates, axis by axis.
    q: Vec<[i32x4; 3]>,
    /// Square of the distance to the nearest picked point, where that is within the radius of the last telling;
    /// else any that is not.
    nearest2: Vec<f32x4>,
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

impl Rest {
    /// Takes other points: candidates in order, all of them far from picked ones.
    pub fn refill(&mut self, q: &[[i32; 3]], candidates: &[u32], log2: u32) {
        let blocks = candidates.len().div_ceil(LANES);
        self.q.resize(blocks, [i32x4::default(); 3]);
        self.nearest2.resize(blocks, f32x4::default());
        self.candidate.resize(blocks * LANES, NONE);
        self.tile_of.resize(blocks * LANES, NONE);
        let mut filling = Filling::new(&mut self.cells, log2);
        for (n, &candidate) in candidates.iter().enumerate() {
            let p = q[candidate as usize];
            let block = &mut self.q[n / LANES];
            (0..3).for_each(|axis| block[axis].as_mut_array()[n % LANES] = p[axis]);
            self.candidate[n] = candidate;
            self.tile_of[n] = filling.tile(p, n);
            self.nearest2[n / LANES].as_mut_array()[n % LANES] = f32::INFINITY;
        }
        self.finish(candidates.len(), log2);
    }

    /// Leaves out what is picked or coincides with it, and finds neighbours by other cells.
    pub fn narrow(&mut self, log2: u32) {
        let mut filling = Filling::new(&mut self.cells, log2);
        let mut n = 0;
        for i in 0..self.candidate.len() {
            let nearest2 = self.nearest2[i / LANES].as_array()[i % LANES];
            if nearest2 > 0.0 {
                let p = lane(&self.q[i / LANES], i % LANES);
                let block = &mut self.q[n / LANES];
                (0..3).for_each(|axis| block[axis].as_mut_array()[n % LANES] = p[axis]);
                self.nearest2[n / LANES].as_mut_array()[n % LANES] = nearest2;
                self.candidate[n] = self.candidate[i];
                self.tile_of[n] = filling.tile(p, n);
                n += 1;
            }
        }
        self.finish(n, log2);
    }

    /// There are so many points.
    fn finish(&mut self, n: usize, log2: u32) {
        self.log2 = log2;
        self.points = n;
        self.cells.close(n);
        let blocks = n.div_ceil(LANES);
        self.q.truncate(blocks);
        self.nearest2.truncate(blocks);
        self.candidate.truncate(blocks * LANES);
        self.tile_of.truncate(blocks * LANES);
        for i in n..self.candidate.len() {
            self.nearest2[i / LANES].as_mut_array()[i % LANES] = 0.0;
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

    /// Square of the greatest distance to a picked point.
    pub fn farthest2(&self) -> f32 {
        let farthest = self.nearest2.iter().fold(f32x4::default(), |a, &b| a.fast_max(b));
        farthest.to_array().into_iter().fold(0.0, f32::max)
    }

    /// See [`Rest::nearest2`].
    #[inline]
    pub fn nearest2(&self, i: usize) -> f32 {
        self.nearest2[i / LANES].as_array()[i % LANES]
    }

    /// The first place from `i` on which is so far, more than not at all, from picked points.
    #[inline]
    pub fn next_from(&self, i: usize, least2: f32) -> Option<usize> {
        let least2 = f32x4::from(least2);
        let mut far = !0 << (i % LANES);
        for (block, nearest2) in self.nearest2.iter().enumerate().skip(i / LANES) {
            far &= nearest2.simd_ge(least2).to_bitmask();
            if far != 0 {
                return Some(block * LANES + far.trailing_zeros() as usize);
            }
            far = !0;
        }
        None
    }

    /// Tells all points within a radius of a place, itself among them, that it is picked.
    #[inline]
    pub fn tell_around(&mut self, i: usize, reach: i32) {
        let p = lane(&self.q[i / LANES], i % LANES);
        self.tell_from(self.tile_of[i], p, reach);
    }

    /// The same for a position that has no place.
    pub fn tell(&mut self, p: [i32; 3], reach: i32) {
        self.tell_from(NONE, p, reach);
    }

    /// `own` is the tile of the position, if that is known.
    #[inline]
    fn tell_from(&mut self, own: u32, p: [i32; 3], reach: i32) {
        // No coordinate is negative, nor a reach.
        let low = p.map(|c| c.wrapping_sub(reach) >> self.log2);
        let high = p.map(|c| c.saturating_add(reach) >> self.log2);
        let (first, last) = (low.map(|c| c >> TILE_LOG2), high.map(|c| c >> TILE_LOG2));
        let p = p.map(i32x4::from);
        if own != NONE && first == last {
            return self.tell_tile(own, between([low, high]), p);
        }
        let [mut x, mut y, mut z] = first;
        loop {
            let tile = self.cells.find([x, y, z]);
            if tile != NONE {
                // Of tiles between the outer ones, all cells.
                let corner = [x, y, z];
                let from = [0, 1, 2].map(|i| if corner[i] == first[i] { low[i] } else { 0 });
                let to = [0, 1, 2].map(|i| if corner[i] == last[i] { high[i] } else { !0 });
                self.tell_tile(tile, between([from, to]), p);
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
    #[inline]
    fn tell_tile(&mut self, tile: u32, cells: u64, p: [i32x4; 3]) {
        let Tile { occupied, before, first, start } = self.cells.tiles[tile as usize];
        let end = self.cells.tiles[tile as usize + 1].start;
        if end.wrapping_sub(start) <= FEW {
            return self.tell_run(start, end, p);
        }
        let mut wanted = occupied & cells;
        let others = occupied & !cells;
        // The first point of an occupied cell.
        let point = |rest: &Self, cell: u32| {
            let byte = cell & 56;
            let cells = (occupied >> byte) as usize & ((1 << (cell & 7)) - 1);
            let before = (before >> byte) as u8 + ONES[cells];
            rest.cells.first[first.wrapping_add(u32::from(before)) as usize]
        };
        while wanted != 0 {
            // From the next cell on, up to the first one behind it that is left out.
            let from = wanted.trailing_zeros();
            let behind = others & (!0 << from);
            if behind == 0 {
                return self.tell_run(point(self, from), end, p);
            }
            let to = behind.trailing_zeros();
            wanted &= !0 << to;
            self.tell_run(point(self, from), point(self, to), p);
        }
    }

    /// Differences are exact, and the rounding of their squares, the same everywhere, moves a radius by a ten
    /// millionth. Points that share a block with others are told too, which does no harm.
    #[inline]
    fn tell_run(&mut self, start: u32, end: u32, p: [i32x4; 3]) {
        let run = start as usize / LANES..(end as usize).div_ceil(LANES);
        for (q, nearest2) in self.q[run.clone()].iter().zip(&mut self.nearest2[run]) {
            let d = |axis: usize| (q[axis] - p[axis]).round_float();
            let (x, y, z) = (d(0), d(1), d(2));
            *nearest2 = nearest2.fast_min(x * x + y * y + z * z);
        }
    }
}

/// The coordinates in a lane of a block.
#[inline]
fn lane([x, y, z]: &[i32x4; 3], lane: usize) -> [i32; 3] {
    [x.as_array()[lane], y.as_array()[lane], z.as_array()[lane]]
}

/// Cells along an edge of a tile, as log2: a tile has as many as a word has bits.
const TILE_LOG2: u32 = 2;
const TILE_EDGE: i32 = 1 << TILE_LOG2;
/// A tile of no more points is told as a whole.
const FEW: u32 = 12;

/// Bits of a coordinate within a tile, where they stand in the place of a cell.
const SPREAD: [u32; TILE_EDGE as usize] = [0, 1, 8, 9];

/// The cells of a tile that lie, along an axis, between two: by the first, and in the lower bits the last.
const BETWEEN: [[u64; 1 << (2 * TILE_LOG2)]; 3] = {
    let mut out = [[0; 1 << (2 * TILE_LOG2)]; 3];
    let mut i = 0;
    while i < 3 << (2 * TILE_LOG2 + 6) {
        let (axis, range, cell) = (i >> 10, i >> 6 & 15, i & 63);
        let at = (cell >> axis & 1) | (cell >> axis >> 3 & 1) << 1;
        if at >= range >> TILE_LOG2 && at <= range & 3 {
            out[axis][range] |= 1 << cell;
        }
        i += 1;
    }
    out
};

/// The cells of a tile between two of them.
#[inline]
fn between([low, high]: [[i32; 3]; 2]) -> u64 {
    let along =
        |axis: usize| BETWEEN[axis][((low[axis] & 3) << TILE_LOG2 | high[axis] & 3) as usize];
    along(0) & along(1) & along(2)
}

/// How many bits of a byte are set.
const ONES: [u8; 256] = {
    let mut ones = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        ones[byte] = byte.count_ones() as u8;
        byte += 1;
    }
    ones
};

/// The place of a cell in its tile, along the Morton curve.
#[inline]
fn within(cell: [i32; 3]) -> u32 {
    let [x, y, z] = cell.map(|c| SPREAD[(c & (TILE_EDGE - 1)) as usize]);
    x | y << 1 | z << 2
}

/// Cells being found along the curve.
struct Filling<'a> {
    cells: &'a mut Cells,
    log2: u32,
    cell: [i32; 3],
    tile: u32,
}

impl<'a> Filling<'a> {
    fn new(cells: &'a mut Cells, log2: u32) -> Self {
        cells.clear();
        Self { cells, log2, cell: [-1; 3], tile: NONE }
    }

    /// The tile of the next point, whose place this is.
    #[inline]
    fn tile(&mut self, p: [i32; 3], place: usize) -> u32 {
        let cell = p.map(|c| c >> self.log2);
        if cell != self.cell {
            self.cell = cell;
            self.tile = self.cells.open(cell, place);
        }
        self.tile
    }
}

/// Cells that are neighbours.
#[derive(Clone, Copy)]
struct Tile {
    /// A bit for each cell that has points.
    occupied: u64,
    /// For each byte of these, how many there are in the bytes before.
    before: u64,
    /// The first of these; the others follow.
    first: u32,
    /// Its first point.
    start: u32,
}

/// The cells that have points, along the curve, by tiles of them, which a table with open addressing finds.
#[derive(Default)]
struct Cells {
    /// The first point of each cell, and of what follows.
    first: Vec<u32>,
    /// One more than there are: where the last one ends.
    tiles: Vec<Tile>,
    corners: Vec<[i32; 3]>,
    /// Tiles by their corners; [`NONE`] where there is none.
    slots: Vec<u32>,
    shift: u32,
}

impl Cells {
    fn clear(&mut self) {
        self.first.clear();
        self.tiles.clear();
        self.corners.clear();
    }

    /// The next cell along the curve, which begins at a point; the tile that it lies in.
    fn open(&mut self, cell: [i32; 3], point: usize) -> u32 {
        let corner = cell.map(|c| c >> TILE_LOG2);
        if self.corners.last() != Some(&corner) {
            self.corners.push(corner);
            let (first, start) = (self.first.len() as u32, point as u32);
            self.tiles.push(Tile { occupied: 0, before: 0, first, start });
        }
        if let Some(tile) = self.tiles.last_mut() {
            tile.occupied |= 1 << within(cell);
        }
        self.first.push(point as u32);
        self.tiles.len() as u32 - 1
    }

    /// Makes the table; the last cell ends before a point.
    fn close(&mut self, point: usize) {
        let (first, start) = (self.first.len() as u32, point as u32);
        self.first.push(start);
        self.tiles.push(Tile { occupied: 0, before: 0, first, start });
        for tile in &mut self.tiles {
            let ones = tile.occupied.to_le_bytes().map(|byte| ONES[usize::from(byte)]);
            // Eight sums at once; none is over 64.
            let ones = u64::from_le_bytes(ones);
            tile.before = ones.wrapping_mul(0x0101_0101_0101_0101).wrapping_sub(ones);
        }
        let size = (self.corners.len() * 2).next_power_of_two().max(2);
        self.shift = 64 - size.ilog2();
        self.slots.clear();
        self.slots.resize(size, NONE);
        for (tile, &corner) in (0..).zip(&self.corners) {
            let mut at = (hash(corner) >> self.shift) as usize;
            while self.slots[at] != NONE {
                at = (at + 1) & (size - 1);
            }
            self.slots[at] = tile;
        }
    }

    /// The tile at a place; [`NONE`] where there is none.
    #[inline]
    fn find(&self, corner: [i32; 3]) -> u32 {
        let mut at = (hash(corner) >> self.shift) as usize;
        loop {
            let tile = self.slots[at];
            if tile == NONE || self.corners[tile as usize] == corner {
                return tile;
            }
            at = (at + 1) & (self.slots.len() - 1);
        }
    }
}

fn hash(corner: [i32; 3]) -> u64 {
    const ODD: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xd1b5_4a32_d192_ed03, 0x8cb9_2ba7_2f3d_8dd7];
    let part = |axis: usize| (corner[axis] as u64).wrapping_mul(ODD[axis]);
    part(0).wrapping_add(part(1)).wrapping_add(part(2))
}
