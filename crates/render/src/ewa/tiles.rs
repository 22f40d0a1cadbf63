//! The splats of a run of points, and for each tile of the picture the list of splats that touch
//! it, by counting sort. [`crate::ewa::place`] fills runs, [`crate::ewa::blend`] draws them tile by
//! tile.

use crate::ewa::clip::{Lines, WHOLE};
use crate::ewa::splat::{Box4, Splat, SplatAttributes};
use crate::simd::values::EIGHT;

/// Pixels on a side of a tile, so that its sums fit the first-level cache.
pub const TILE: usize = 32;
/// Columns that are worked on together.
pub const LANES: usize = crate::simd::lanes::LANES;
/// Rows that lie together.
pub const PAIR: usize = 2;
/// Columns of a row in the buffers of a tile: the last ones that are worked on together may end
/// beyond the tile.
pub const STRIDE: usize = TILE + LANES;

/// The grid of tiles of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tiles {
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
}

impl Tiles {
    /// Tiles that cover a picture of `width` x `height` pixels.
    pub fn new(width: usize, height: usize) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }
}

/// The rectangle of a tile that a splat may touch, relative to the tile.
#[derive(Clone, Copy, Debug, Default)]
pub struct TileRect {
    /// Whether the fast path draws the splat: a plain ellipse ([`Splat::is_plain`]) without clip
    /// lines, at most [`LANES`] columns wide.
    pub is_small: bool,
    /// First column.
    pub left: u8,
    /// One past the last column.
    pub right: u8,
    /// First pair of rows.
    pub first_pair: u8,
    /// One past the last pair of rows.
    pub past_pair: u8,
}

impl TileRect {
    /// The rectangle of the first column, one past the last one, the first row and one past the
    /// last one.
    #[inline(always)]
    fn new(is_small: bool, [left, right, top, bottom]: [u8; 4]) -> Self {
        let pair = PAIR as u8;
        Self { is_small, left, right, first_pair: top / pair, past_pair: bottom.div_ceil(pair) }
    }
}

/// A splat in the list of a tile.
#[derive(Clone, Copy, Debug, Default)]
pub struct TileEntry {
    /// Index of the splat in the run.
    splat: u16,
    /// The pixels that it may touch.
    pub rect: TileRect,
}

/// Most points of a run: entries have indices of 16 bits.
pub const RUN_POINTS: usize = 1 << 14;

/// Splats that a new run has room for.
const RUN_POINTS_LEAST: usize = 1 << 10;

/// The splats of a run of points, with a list for each tile.
#[derive(Debug, Default)]
pub struct SplatRun {
    /// The splats in the order of their points, and room for more.
    splats: Vec<Splat>,
    /// Number of splats.
    count: usize,
    /// Tiles in a row.
    columns: usize,
    /// Tiles with their entries, in the order of the splats.
    touched: Vec<(u32, TileEntry)>,
    /// For each tile the index of its first entry; then the number of all entries.
    starts: Vec<u32>,
    /// Entries sorted by tile.
    entries: Vec<TileEntry>,
    /// Clip lines of splats, up to the last splat that has some.
    lines: Vec<Lines>,
    /// Splats that could not be evaluated.
    pub dropped: u64,
}

impl SplatRun {
    /// Iterates over the splats that touch a tile, in their order.
    #[inline(always)]
    pub fn of_tile(&self, tile: usize) -> impl Iterator<Item = (&Splat, &TileEntry)> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map(|e| (&self.splats[usize::from(e.splat)], e))
    }

    /// Clip lines of the splat of an entry, if it has some.
    #[inline]
    pub fn lines(&self, entry: &TileEntry) -> Option<&Lines> {
        self.lines.get(usize::from(entry.splat)).filter(|l| l.kept != WHOLE)
    }

    /// Number of splats.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Room to write the next eight splats to, without their attributes. Each call of
    /// [`SplatRun::push`] or [`SplatRun::push_single`] then appends the next of them.
    #[inline(always)]
    pub fn room(&mut self) -> &mut [Splat; EIGHT] {
        if self.splats.len() < self.count + EIGHT {
            self.grow();
        }
        let room = self.splats[self.count..].first_chunk_mut();
        room.unwrap_or_else(|| unreachable!("it was grown"))
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        self.splats.resize(2 * self.count + (RUN_POINTS_LEAST + EIGHT), Splat::default());
    }

    /// Appends the next splat of [`SplatRun::room`], which touches one tile only and has no lines.
    #[inline(always)]
    pub fn push_single(&mut self, attributes: SplatAttributes, tile: usize, rect: TileRect) {
        let entry = TileEntry { splat: self.count as u16, rect };
        self.splats[self.count].attributes = attributes;
        self.count += 1;
        self.starts[tile] += 1;
        self.touched.push((tile as u32, entry));
    }

    /// Appends the next splat of [`SplatRun::room`], with its bounds and clip lines.
    pub fn push(&mut self, attributes: SplatAttributes, bounds: Box4, lines: Option<Lines>) {
        let first = self.count;
        self.splats[first].attributes = attributes;
        self.count += 1;
        let is_plain = self.splats[first].is_plain() && lines.is_none();
        let Self { touched, starts, columns, .. } = self;
        for_each_tile(bounds, *columns, |tile, sides| {
            starts[tile] += 1;
            let is_small = is_plain && usize::from(sides[1] - sides[0]) <= LANES;
            let rect = TileRect::new(is_small, sides);
            touched.push((tile as u32, TileEntry { splat: first as u16, rect }));
        });
        if let Some(lines) = lines {
            self.lines.resize(first, Lines::default());
            self.lines.push(lines);
        }
    }

    /// Tiles in a row of the picture.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Removes all splats.
    pub fn clear(&mut self, tiles: Tiles) {
        self.count = 0;
        self.touched.clear();
        self.lines.clear();
        self.starts.clear();
        self.starts.resize(tiles.columns * tiles.rows + 1, 0);
        self.columns = tiles.columns;
        self.dropped = 0;
    }

    /// Sorts the entries by tile, by counting.
    pub fn sort(&mut self) {
        // Turns counts into ends; filling from behind turns ends into starts.
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.entries.resize(end as usize, TileEntry::default());
        for &(tile, entry) in self.touched.iter().rev() {
            let start = &mut self.starts[tile as usize];
            *start -= 1;
            self.entries[*start as usize] = entry;
        }
    }
}

/// Calls `work` with the number of each tile that a box touches, and the sides of the box in it.
#[inline(always)]
fn for_each_tile(b: Box4, columns: usize, mut work: impl FnMut(usize, [u8; 4])) {
    const SIDE: u32 = TILE as u32;
    let [left, right, top, bottom] = b;
    let (first, last) = ([left / SIDE, top / SIDE], [(right - 1) / SIDE, (bottom - 1) / SIDE]);
    for y in first[1]..=last[1] {
        for x in first[0]..=last[0] {
            let within = |at: u32, first: u32| at.saturating_sub(first * SIDE).min(SIDE) as u8;
            let sides = [within(left, x), within(right, x), within(top, y), within(bottom, y)];
            work(y as usize * columns + x as usize, sides);
        }
    }
}
