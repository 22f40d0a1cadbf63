//! The points that thinning may still pick, along the Morton curve: how far each is from the picked ones, and
//! which of them are near a place. Points of an octree cell stand together, so a table from cells to runs finds
//! neighbours; distances are in space.

use wide::{f32x4, i32x4};

/// Points of a block.
const LANES: usize = 4;
/// The edge of the cells by which neighbours are found is at least so many radii, and less than twice as many.
const EDGE_RADII: f64 = 1.5;
/// Instead of a candidate, where a block has room left.
pub const NONE: u32 = u32::MAX;

/// Log2 of the edge of the cells, in steps, by which neighbours within a radius are found.
pub fn cell_log2(radius: f64) -> u32 {
    ((radius * EDGE_RADII).log2().ceil().max(0.0) as u32).min(31)
}

/// Points in blocks of four, each of one cell, over which the innermost loop of a build runs. A block's room that is
/// left is at distance 0, which is never picked.
#[derive(Default)]
pub struct Rest {
    /// Coordinates, axis by axis.
    q: Vec<[i32x4; 3]>,
    /// Square of the distance to the nearest picked point, where that is within the radius of the last telling;
    /// else any that is not.
    nearest2: Vec<f32x4>,
    /// Which candidate each is; [`NONE`] where there is none.
    candidate: Vec<u32>,
    /// The tile of each block.
    tile_of: Vec<u32>,
    cells: Cells,
    /// Log2 of the edge of the cells.
    log2: u32,
}

impl Rest {
    /// Takes other points: candidates in order, with the squares of their distances to the nearest picked one.
    pub fn refill(&mut self, q: &[[i32; 3]], points: impl Iterator<Item = (u32, f32)>, log2: u32) {
        self.log2 = log2;
        self.clear();
        let (mut last, mut tile, mut lane) = (None, 0, 0);
        for (candidate, nearest2) in points {
            let p = q[candidate as usize];
            let corner = p.map(|c| c >> log2);
            let is_new = last != Some(corner);
            if is_new {
                tile = self.cells.open(corner, self.q.len());
                last = Some(corner);
            }
            if is_new || lane == LANES {
                lane = 0;
                self.q.push([i32x4::default(); 3]);
                self.nearest2.push(f32x4::default());
                self.candidate.extend([NONE; LANES]);
                self.tile_of.push(tile);
            }
            let block = self.q.len() - 1;
            (0..3).for_each(|axis| self.q[block][axis].as_mut_array()[lane] = p[axis]);
            self.nearest2[block].as_mut_array()[lane] = nearest2;
            self.candidate[block * LANES + lane] = candidate;
            lane += 1;
        }
        self.cells.close(self.q.len());
    }

    fn clear(&mut self) {
        self.q.clear();
        self.nearest2.clear();
        self.candidate.clear();
        self.tile_of.clear();
        self.cells.clear();
    }

    /// Number of places: points, and room that is left.
    pub fn len(&self) -> usize {
        self.candidate.len()
    }

    /// The candidate at a place; [`NONE`] where there is none.
    pub fn candidate(&self, i: usize) -> u32 {
        self.candidate[i]
    }

    /// The points and the squares of their distances to the nearest picked one.
    pub fn points(&self) -> impl Iterator<Item = (u32, f32)> + '_ {
        let nearest2 = self.nearest2.iter().flat_map(|block| block.to_array());
        self.candidate.iter().copied().zip(nearest2).filter(|p| p.0 != NONE)
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
        let block = i / LANES;
        let p = self.q[block].each_ref().map(|axis| axis.as_array()[i % LANES]);
        self.tell_from(self.tile_of[block], p, reach);
    }

    /// The same for a position that has no place.
    pub fn tell(&mut self, p: [i32; 3], reach: i32) {
        self.tell_from(self.cells.find(p.map(|c| c >> self.log2 >> TILE_LOG2)), p, reach);
    }

    /// `own` is the tile of the position.
    #[inline]
    fn tell_from(&mut self, own: u32, p: [i32; 3], reach: i32) {
        let low = p.map(|c| c.saturating_sub(reach) >> self.log2);
        let high = p.map(|c| c.saturating_add(reach) >> self.log2);
        let home = p.map(|c| c >> self.log2 >> TILE_LOG2);
        let p = p.map(i32x4::from);
        let tiles = |axis: usize| low[axis] >> TILE_LOG2..=high[axis] >> TILE_LOG2;
        for z in tiles(2) {
            for y in tiles(1) {
                for x in tiles(0) {
                    let tile = [x, y, z];
                    let index = if tile == home { own } else { self.cells.find(tile) };
                    if index != NONE {
                        self.tell_tile(index, tile, [low, high], p);
                    }
                }
            }
        }
    }

    /// Tells the points in those of a tile's cells that lie between two.
    #[inline]
    fn tell_tile(&mut self, index: u32, tile: [i32; 3], [low, high]: [[i32; 3]; 2], p: [i32x4; 3]) {
        let Tile { occupied, first } = self.cells.tiles[index as usize];
        let cells = |axis: usize| {
            let start = tile[axis] << TILE_LOG2;
            low[axis].max(start)..=high[axis].min(start + TILE_EDGE - 1)
        };
        for z in cells(2) {
            for y in cells(1) {
                for x in cells(0) {
                    let bit = 1u64 << within([x, y, z]);
                    if occupied & bit != 0 {
                        self.tell_cell(first + (occupied & (bit - 1)).count_ones(), p);
                    }
                }
            }
        }
    }

    /// Differences are exact, and the rounding of their squares, the same everywhere, moves a radius by a ten
    /// millionth.
    #[inline]
    fn tell_cell(&mut self, cell: u32, p: [i32x4; 3]) {
        let run = self.cells.run(cell);
        for (q, nearest2) in self.q[run.clone()].iter().zip(&mut self.nearest2[run]) {
            let d = |axis: usize| (q[axis] - p[axis]).round_float();
            let (x, y, z) = (d(0), d(1), d(2));
            *nearest2 = nearest2.fast_min(x * x + y * y + z * z);
        }
    }
}

/// Cells along an edge of a tile, as log2: a tile has as many as a word has bits.
const TILE_LOG2: u32 = 2;
const TILE_EDGE: i32 = 1 << TILE_LOG2;

/// The place of a cell in its tile, along the Morton curve.
#[inline]
fn within(cell: [i32; 3]) -> usize {
    const SPREAD: [usize; TILE_EDGE as usize] = [0, 1, 8, 9];
    let [x, y, z] = cell.map(|c| SPREAD[(c & (TILE_EDGE - 1)) as usize]);
    x | y << 1 | z << 2
}

/// Cells that are neighbours.
#[derive(Clone, Copy)]
struct Tile {
    /// A bit for each cell that has points.
    occupied: u64,
    /// The first of these; the others follow.
    first: u32,
}

/// The cells that have points, along the curve, by tiles of them, which a table with open addressing finds.
#[derive(Default)]
struct Cells {
    /// The first block of each cell's points, and of the next cell's.
    first: Vec<u32>,
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

    /// The next cell along the curve, whose points begin at a block; the tile that it lies in.
    fn open(&mut self, cell: [i32; 3], block: usize) -> u32 {
        let corner = cell.map(|c| c >> TILE_LOG2);
        if self.corners.last() != Some(&corner) {
            self.corners.push(corner);
            self.tiles.push(Tile { occupied: 0, first: self.first.len() as u32 });
        }
        if let Some(tile) = self.tiles.last_mut() {
            tile.occupied |= 1 << within(cell);
        }
        self.first.push(block as u32);
        self.tiles.len() as u32 - 1
    }

    /// Makes the table; the last cell ends before a block.
    fn close(&mut self, block: usize) {
        self.first.push(block as u32);
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

    /// The blocks of a cell.
    #[inline]
    fn run(&self, cell: u32) -> std::ops::Range<usize> {
        self.first[cell as usize] as usize..self.first[cell as usize + 1] as usize
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
