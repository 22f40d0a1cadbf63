//! Palettes of at most 255 colours, and the entry nearest to any colour. Compact planes store its
//! index beside each point's position (`data-format/SPEC.md`, section 11). [`train`] makes
//! palettes.

pub mod train;

pub use train::{Histogram, Misfit};

use std::sync::{Arc, OnceLock};

/// Greatest number of colours in a palette: one index is left.
pub const COLOURS_MAX: usize = 255;
/// Index for a point without colour.
pub const NO_COLOUR: u8 = 255;

/// Bits of a channel in the grid of colours that lists the entries which may be nearest.
const CELL_BITS: u32 = 5;
/// Edge of a cell of that grid, in steps of a channel.
const CELL_EDGE: i32 = 1 << (8 - CELL_BITS);

/// From 1 to [`COLOURS_MAX`] colours.
#[derive(Clone, Debug)]
pub struct Palette {
    colours: Vec<[u8; 3]>,
    near: Arc<OnceLock<Near>>,
}

/// For each cell of the grid of colours, the entries that may be nearest to any of its colours, in
/// order.
#[derive(Debug)]
struct Near {
    starts: Vec<u32>,
    entries: Vec<(u8, [i32; 3])>,
}

impl PartialEq for Palette {
    fn eq(&self, other: &Self) -> bool {
        self.colours == other.colours
    }
}

impl Palette {
    /// A palette of these colours; `None` if there are none, or too many.
    pub fn new(colours: Vec<[u8; 3]>) -> Option<Self> {
        let fits = (1..=COLOURS_MAX).contains(&colours.len());
        fits.then(|| Self { colours, near: Arc::default() })
    }

    /// Colours in the order of their indices.
    pub fn colours(&self) -> &[[u8; 3]] {
        &self.colours
    }

    /// Colour of every index; black for indices without one, such as that of points without colour.
    pub fn table(&self) -> [[u8; 3]; 256] {
        std::array::from_fn(|i| self.colours.get(i).copied().unwrap_or_default())
    }

    /// Entry nearest to a colour: least sum of squared differences of the channels, the first of
    /// several.
    #[inline]
    pub fn nearest(&self, rgb: [u8; 3]) -> u8 {
        let near = self.near.get_or_init(|| Near::of(&self.colours));
        let cell = cell_of(rgb);
        let entries = &near.entries[near.starts[cell] as usize..near.starts[cell + 1] as usize];
        let rgb = rgb.map(i32::from);
        let (mut best, mut least) = (0, i32::MAX);
        for &(entry, colour) in entries {
            let away = apart(rgb, colour);
            if away < least {
                (best, least) = (entry, away);
            }
        }
        best
    }
}

/// Squared distance of two colours.
#[inline]
fn apart(a: [i32; 3], b: [i32; 3]) -> i32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

#[inline]
fn cell_of(rgb: [u8; 3]) -> usize {
    rgb.iter().fold(0, |cell, &c| cell << CELL_BITS | usize::from(c >> (8 - CELL_BITS)))
}

impl Near {
    /// Lists the entries of each cell: an entry whose distance from the cell exceeds the distance
    /// of another entry from all of the cell is nearest to none of its colours.
    fn of(colours: &[[u8; 3]]) -> Self {
        // Squared distances of each entry from the nearest and the farthest step of each part of a
        // channel.
        let parts: Vec<[Vec<[i32; 2]>; 3]> = (0..1 << CELL_BITS)
            .map(|part: i32| {
                let (low, high) = (part * CELL_EDGE, part * CELL_EDGE + CELL_EDGE - 1);
                let of = |c: u8| {
                    let c = i32::from(c);
                    let nearest = (low - c).max(c - high).max(0);
                    let farthest = (c - low).max(high - c);
                    [nearest * nearest, farthest * farthest]
                };
                [0, 1, 2].map(|axis| colours.iter().map(|colour| of(colour[axis])).collect())
            })
            .collect();
        let mut near = Self { starts: vec![0], entries: Vec::new() };
        let cells = (0..1usize << (3 * CELL_BITS))
            .map(|cell| [2, 1, 0].map(|axis| cell >> (axis * CELL_BITS) & ((1 << CELL_BITS) - 1)));
        for cell in cells {
            let away = |which: usize| {
                let [r, g, b] = [0, 1, 2].map(|axis| &parts[cell[axis]][axis]);
                (0..colours.len()).map(move |i| r[i][which] + g[i][which] + b[i][which])
            };
            let reach = away(1).min().unwrap_or(0);
            let within = away(0).enumerate().filter(|&(_, away)| away <= reach);
            near.entries.extend(within.map(|(i, _)| (i as u8, colours[i].map(i32::from))));
            near.starts.push(near.entries.len() as u32);
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn palettes_have_a_colour_and_leave_a_number() {
        assert_eq!(Palette::new(vec![]), None);
        assert_eq!(Palette::new(vec![[1; 3]; 256]), None);
        let one = Palette::new(vec![[9, 8, 7]]).unwrap();
        assert_eq!(
            (one.nearest([255; 3]), one.table()[0], one.table()[255]),
            (0, [9, 8, 7], [0; 3])
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn every_colour_gets_the_first_of_its_nearest_entries(
            colours in prop::collection::vec(any::<[u8; 3]>(), 1..=COLOURS_MAX), spread in 0u8..8,
            some in prop::collection::vec(any::<[u8; 3]>(), 200),
        ) {
            // Also crowded ones, and alike.
            let colours: Vec<_> = colours.into_iter().map(|c| c.map(|c| c >> spread)).collect();
            let palette = Palette::new(colours.clone()).unwrap();
            let away = |rgb: [u8; 3], of: [u8; 3]| apart(rgb.map(i32::from), of.map(i32::from));
            for rgb in some.iter().flat_map(|&c| [c, c.map(|c| c >> spread)]) {
                let first = (0..colours.len()).min_by_key(|&i| away(rgb, colours[i])).unwrap();
                prop_assert_eq!(usize::from(palette.nearest(rgb)), first);
            }
        }
    }
}
