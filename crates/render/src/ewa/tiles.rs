//! The splats of a run of points, and for each tile of the picture the list of those that touch it, sorted by counting.

use super::clip::{Lines, WHOLE};
use super::splat::{Box4, Splat};

/// Pixels on a side of a tile: its sums stay in the nearest cache.
pub const TILE: usize = 32;
/// Pixels of a row that are worked on together.
pub const LANES: usize = crate::lanes::LANES;

/// Tiles of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tiles {
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
}

impl Tiles {
    /// Of a picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { columns: width.div_ceil(TILE), rows: height.div_ceil(TILE) }
    }
}

/// A splat in a tile, and the part of the tile that it may touch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entry {
    /// Which splat of the run.
    splat: u16,
    /// Whether it takes the short way: an ellipse without mending or lines, in the tile no wider than what is worked on
    /// together.
    pub is_small: bool,
    /// Its first column and row, and one past the last ones; from the tile's.
    pub left: u8,
    /// One past its last column.
    pub right: u8,
    /// Its first row.
    pub top: u8,
    /// One past its last row.
    pub bottom: u8,
}

/// Points that a run has at most: entries number its splats by 16 bits.
pub const RUN_POINTS: usize = 1 << 14;

/// The splats of a run of points, by tiles.
#[derive(Debug, Default)]
pub struct Run {
    /// The splats, in the order of their points.
    pub splats: Vec<Splat>,
    /// Tiles in a row.
    columns: usize,
    /// The tiles that splats touch, in the order of the splats, with their entries.
    touched: Vec<(u32, Entry)>,
    /// For each tile its first entry, and one past the last of all.
    starts: Vec<u32>,
    /// Splats by tile.
    entries: Vec<Entry>,
    /// What of each splat is kept; empty where no splat of the run is clipped.
    lines: Vec<Lines>,
    /// Splats that could not be evaluated.
    pub dropped: u64,
}

impl Run {
    /// The splats that touch a tile, in their order.
    #[inline(always)]
    pub fn of_tile(&self, tile: usize) -> impl Iterator<Item = (&Splat, &Entry)> {
        let range = self.starts[tile] as usize..self.starts[tile + 1] as usize;
        self.entries[range].iter().map(|e| (&self.splats[usize::from(e.splat)], e))
    }

    /// The lines of an entry's splat, where it has some.
    #[inline]
    pub fn lines(&self, entry: &Entry) -> Option<&Lines> {
        self.lines.get(usize::from(entry.splat)).filter(|l| l.kept != WHOLE)
    }

    /// Adds a splat with its box and what is kept of it.
    #[inline(always)]
    pub fn push(&mut self, splat: Splat, bounds: Box4, lines: Option<Lines>) {
        let is_plain = splat.is_plain() && lines.is_none_or(|l| l.kept == WHOLE);
        let first = self.splats.len();
        self.splats.push(splat);
        let Self { touched, starts, columns, .. } = self;
        for_each_tile(bounds, *columns, |tile, [left, right, top, bottom]| {
            starts[tile] += 1;
            let is_small = is_plain && usize::from(right - left) <= LANES;
            let entry = Entry { splat: first as u16, is_small, left, right, top, bottom };
            touched.push((tile as u32, entry));
        });
        if lines.is_some() || !self.lines.is_empty() {
            self.lines.resize(first, Lines::default());
            self.lines.push(lines.unwrap_or_default());
        }
    }

    /// Forgets all splats.
    pub fn clear(&mut self, tiles: Tiles) {
        self.splats.clear();
        self.touched.clear();
        self.lines.clear();
        self.starts.clear();
        self.starts.resize(tiles.columns * tiles.rows + 1, 0);
        self.columns = tiles.columns;
        self.dropped = 0;
    }

    /// Sorts the splats into tiles, by counting.
    pub fn sort(&mut self) {
        // Ends of all tiles; filled from behind, they become their starts.
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.entries.resize(end as usize, Entry::default());
        for &(tile, entry) in self.touched.iter().rev() {
            let start = &mut self.starts[tile as usize];
            *start -= 1;
            self.entries[*start as usize] = entry;
        }
    }
}

/// Gives the tiles that a box touches, and the part of each.
#[inline(always)]
fn for_each_tile(b: Box4, columns: usize, mut work: impl FnMut(usize, [u8; 4])) {
    const SIDE: u32 = TILE as u32;
    let [left, right, top, bottom] = b;
    let (first, last) = ([left / SIDE, top / SIDE], [(right - 1) / SIDE, (bottom - 1) / SIDE]);
    if first == last {
        let [x, y] = first.map(|f| f * SIDE);
        let within = [left - x, right - x, top - y, bottom - y].map(|c| c as u8);
        return work(first[1] as usize * columns + first[0] as usize, within);
    }
    for y in first[1]..=last[1] {
        for x in first[0]..=last[0] {
            let within = |at: u32, first: u32| at.saturating_sub(first * SIDE).min(SIDE) as u8;
            let part = [within(left, x), within(right, x), within(top, y), within(bottom, y)];
            work(y as usize * columns + x as usize, part);
        }
    }
}
