//! Occupied octree cells of one size, found by position. Cells are bits of tiles of 4 x 4 x 4;
//! tiles are in a hash table with open addressing. Points are along the Morton curve, so the points
//! of a cell are contiguous, and so are the cells of a tile.

/// Index that stands for no tile or no candidate.
pub const NONE: u32 = u32::MAX;

/// Log2 of the cells along an edge of a tile: a tile has as many cells as a word has bits.
pub const TILE_LOG2: u32 = 2;
const TILE_EDGE: i32 = 1 << TILE_LOG2;

/// Bits of a coordinate within a tile, spread to their places in the Morton index of a cell.
const SPREAD: [u32; TILE_EDGE as usize] = [0, 1, 8, 9];

/// Masks of the cells of a tile that lie, along an axis, between two coordinates: the index has the
/// first coordinate in its upper bits, the last in its lower bits.
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

/// Mask of the cells of a tile in the box between two cells.
#[inline(always)]
pub fn between([low, high]: [[i32; 3]; 2]) -> u64 {
    let along =
        |axis: usize| BETWEEN[axis][((low[axis] & 3) << TILE_LOG2 | high[axis] & 3) as usize];
    along(0) & along(1) & along(2)
}

/// Index of a cell in its tile, along the Morton curve.
#[inline]
fn cell_index(cell: [i32; 3]) -> u32 {
    let [x, y, z] = cell.map(|c| SPREAD[(c & (TILE_EDGE - 1)) as usize]);
    x | y << 1 | z << 2
}

/// Builds [`Cells`] from points along the curve.
pub struct CellsBuilder<'a> {
    cells: &'a mut Cells,
    log2: u32,
    /// The last point; initially negative, as no point is.
    last: [i32; 3],
    tile: u32,
}

impl<'a> CellsBuilder<'a> {
    /// Clears `cells` and begins with cells of edge 2^`log2`.
    pub fn new(cells: &'a mut Cells, log2: u32) -> Self {
        cells.clear();
        Self { cells, log2, last: [-1; 3], tile: NONE }
    }

    /// Adds the next point, with the index `place`; returns its tile.
    #[inline(always)]
    pub fn tile(&mut self, p: [i32; 3], place: usize) -> u32 {
        let differing = (p[0] ^ self.last[0]) | (p[1] ^ self.last[1]) | (p[2] ^ self.last[2]);
        self.last = p;
        if differing >> self.log2 != 0 {
            self.tile = self.cells.open(p.map(|c| c >> self.log2), place);
        }
        self.tile
    }
}

/// A tile of 4 x 4 x 4 cells.
#[derive(Clone, Copy)]
pub struct Tile {
    /// A bit for each occupied cell.
    pub occupied: u64,
    /// Index of the first of these in [`Cells::first`]; the others follow.
    pub first: u32,
    /// Index of its first point.
    pub start: u32,
}

/// Occupied cells along the curve, and the hash table of their tiles.
#[derive(Default)]
pub struct Cells {
    /// First point of each cell, and the end of the last one.
    pub first: Vec<u32>,
    /// Tiles, and one more that marks the end of the last.
    pub tiles: Vec<Tile>,
    corners: Vec<[i32; 3]>,
    /// Hash table of tiles by their corners; [`NONE`] marks a free slot.
    slots: Vec<u32>,
    shift: u32,
}

impl Cells {
    fn clear(&mut self) {
        self.first.clear();
        self.tiles.clear();
        self.corners.clear();
    }

    /// Begins the next cell along the curve at `point`; returns its tile.
    fn open(&mut self, cell: [i32; 3], point: usize) -> u32 {
        let corner = cell.map(|c| c >> TILE_LOG2);
        if self.corners.last() != Some(&corner) {
            self.corners.push(corner);
            let (first, start) = (self.first.len() as u32, point as u32);
            self.tiles.push(Tile { occupied: 0, first, start });
        }
        if let Some(tile) = self.tiles.last_mut() {
            tile.occupied |= 1 << cell_index(cell);
        }
        self.first.push(point as u32);
        self.tiles.len() as u32 - 1
    }

    /// Builds the hash table; `point` is the end of the last cell.
    pub fn close(&mut self, point: usize) {
        let (first, start) = (self.first.len() as u32, point as u32);
        self.first.push(start);
        self.tiles.push(Tile { occupied: 0, first, start });
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

    /// Returns the tile at a corner, or [`NONE`].
    #[inline(always)]
    pub fn find(&self, corner: [i32; 3]) -> u32 {
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

#[inline(always)]
fn hash(corner: [i32; 3]) -> u64 {
    const ODD: [u64; 3] = [0x9e37_79b9_7f4a_7c15, 0xd1b5_4a32_d192_ed03, 0x8cb9_2ba7_2f3d_8dd7];
    let part = |axis: usize| (corner[axis] as u64).wrapping_mul(ODD[axis]);
    part(0).wrapping_add(part(1)).wrapping_add(part(2))
}
