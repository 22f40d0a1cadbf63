//! The splats of a run of points, and for each tile of the picture the list of those that touch it, sorted by counting.

use crate::ewa::clip::{Lines, WHOLE};
use crate::ewa::splat::{Box4, Dye, Splat};
use crate::ewa::sums::PAIR;
use crate::simd::values::EIGHT;

/// Pixels on a side of a tile: its sums stay in the nearest cache.
pub const TILE: usize = 32;
/// Pixels of a row that are worked on together.
pub const LANES: usize = crate::simd::lanes::LANES;

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

/// The part of a tile that a splat may touch.
#[derive(Clone, Copy, Debug, Default)]
pub struct Part {
    /// Whether the splat takes the short way: an ellipse without mending or lines, in the tile no wider than what is worked on
    /// together.
    pub is_small: bool,
    /// Its first column and row, and one past the last ones; from the tile's.
    pub left: u8,
    /// One past its last column.
    pub right: u8,
    /// Its first pair of rows.
    pub first_pair: u8,
    /// One past its last pair of rows.
    pub past_pair: u8,
}

impl Part {
    /// Of the first and last columns and rows, each last one being one past it.
    #[inline(always)]
    fn new(is_small: bool, [left, right, top, bottom]: [u8; 4]) -> Self {
        let pair = PAIR as u8;
        Self { is_small, left, right, first_pair: top / pair, past_pair: bottom.div_ceil(pair) }
    }
}

/// A splat in a tile.
#[derive(Clone, Copy, Debug, Default)]
pub struct Entry {
    /// Which splat of the run.
    splat: u16,
    /// What it may touch.
    pub part: Part,
}

/// Points that a run has at most: entries number its splats by 16 bits.
pub const RUN_POINTS: usize = 1 << 14;

/// Splats that there is room for at first.
const RUN_POINTS_LEAST: usize = 1 << 10;

/// The splats of a run of points, by tiles.
#[derive(Debug, Default)]
pub struct Run {
    /// The splats, in the order of their points, and room for more.
    splats: Vec<Splat>,
    /// How many there are.
    count: usize,
    /// Tiles in a row.
    columns: usize,
    /// The tiles that splats touch, in the order of the splats, with their entries.
    touched: Vec<(u32, Entry)>,
    /// For each tile its first entry, and one past the last of all.
    starts: Vec<u32>,
    /// Splats by tile.
    entries: Vec<Entry>,
    /// What of each splat is kept, up to the last one of which that is not all.
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

    /// How many splats there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Room for the next eight splats, for all but their dyes; [`Run::take`] takes the first one that it has not taken.
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

    /// Takes the next splat in the room, which touches one tile only and which no line cuts.
    #[inline(always)]
    pub fn take_single(&mut self, dye: Dye, tile: usize, part: Part) {
        let entry = Entry { splat: self.count as u16, part };
        self.splats[self.count].dye = dye;
        self.count += 1;
        self.starts[tile] += 1;
        self.touched.push((tile as u32, entry));
    }

    /// Takes the next splat in the room, with its box and what is kept of it.
    pub fn take(&mut self, dye: Dye, bounds: Box4, lines: Option<Lines>) {
        let first = self.count;
        self.splats[first].dye = dye;
        self.count += 1;
        let is_plain = self.splats[first].is_plain() && lines.is_none();
        let Self { touched, starts, columns, .. } = self;
        for_each_tile(bounds, *columns, |tile, part| {
            starts[tile] += 1;
            let is_small = is_plain && usize::from(part[1] - part[0]) <= LANES;
            let part = Part::new(is_small, part);
            touched.push((tile as u32, Entry { splat: first as u16, part }));
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

    /// Forgets all splats.
    pub fn clear(&mut self, tiles: Tiles) {
        self.count = 0;
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
    for y in first[1]..=last[1] {
        for x in first[0]..=last[0] {
            let within = |at: u32, first: u32| at.saturating_sub(first * SIDE).min(SIDE) as u8;
            let part = [within(left, x), within(right, x), within(top, y), within(bottom, y)];
            work(y as usize * columns + x as usize, part);
        }
    }
}
