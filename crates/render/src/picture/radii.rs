//! Mean radii of the discs around each place of a picture, for passes that work as wide as discs
//! are. Means of samples in tiles make means at the corners of tiles, between which the radius of a
//! pixel is interpolated. Tiles count from the first pixel of the picture, as windows do, so a
//! window has the radii of the whole.

use crate::picture::surface::Surface;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a tile, pixels: several times as wide as discs that matter, so that no disc decides
/// alone.
pub(crate) const TILE: usize = 64;
/// Distance of samples along both axes, pixels. Smaller discs need no wide passes.
pub(crate) const EVERY: usize = 8;
/// Greatest radius of a sample, pixels, so that one disc that fills the picture does not decide
/// alone.
pub(crate) const RADIUS_MAX_PX: f32 = 256.0;

/// Centres of the pixels of a tile.
const PLACES: [f32; TILE] = {
    let mut places = [0.0; TILE];
    let mut at = 0;
    while at < TILE {
        places[at] = at as f32 + 0.5;
        at += 1;
    }
    places
};

/// Mean radii of discs around each place of a picture, pixels.
#[derive(Clone, Debug, Default)]
pub struct Radii {
    /// Tiles in a row.
    columns: usize,
    /// Sum and number of the samples of each tile.
    tiles: Vec<[f32; 2]>,
    /// Mean radius at each corner of a tile, row by row; 0 where nothing is drawn around it.
    corners: Vec<f32>,
    /// Greatest radius in each tile, row by row.
    most: Vec<f32>,
}

impl Radii {
    /// The same radius everywhere in a picture of `size` pixels.
    pub fn even(size: [usize; 2], radius_px: f32) -> Self {
        let [columns, rows] = size.map(|side| side.div_ceil(TILE));
        let corners = vec![radius_px; (columns + 1) * (rows + 1)];
        Self { columns, tiles: Vec::new(), corners, most: vec![radius_px; columns * rows] }
    }

    /// Measures the radii of the pixels of `surface` that `depth` does not leave empty.
    pub fn measure(&mut self, surface: &impl Surface, depth: &[f32]) {
        let size = surface.size();
        let [columns, rows] = size.map(|side| side.div_ceil(TILE));
        self.columns = columns;
        self.tiles.resize(columns * rows, [0.0; 2]);
        let tiles = self.tiles.par_chunks_mut(columns.max(1)).enumerate();
        tiles.for_each(|(row, tiles)| {
            for (column, tile) in tiles.iter_mut().enumerate() {
                *tile = samples(surface, depth, size, [column * TILE, row * TILE]);
            }
        });
        let tile = |x: usize, y: usize| {
            let is_there = (1..=columns).contains(&x) && (1..=rows).contains(&y);
            if is_there { self.tiles[(y - 1) * columns + x - 1] } else { [0.0; 2] }
        };
        self.corners.clear();
        self.corners.extend((0..=rows).flat_map(|y| (0..=columns).map(move |x| [x, y])).map(
            |[x, y]| {
                let [a, b, c, d] = [tile(x, y), tile(x + 1, y), tile(x, y + 1), tile(x + 1, y + 1)];
                let [sum, count] = [0, 1].map(|k| (a[k] + b[k]) + (c[k] + d[k]));
                if count > 0.0 { sum / count } else { 0.0 }
            },
        ));
        let corner = |x: usize, y: usize| self.corners[y * (columns + 1) + x];
        let most = |x: usize, y: usize| {
            let [above, below] = [y, y + 1].map(|y| corner(x, y).max(corner(x + 1, y)));
            above.max(below)
        };
        self.most.clear();
        self.most.extend(
            (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])).map(|[x, y]| most(x, y)),
        );
    }

    /// Greatest radius.
    pub fn most(&self) -> f32 {
        self.most.iter().copied().fold(0.0, f32::max)
    }

    /// Runs of pixels of row `y` in which radii are above `limit`, or nowhere, from left to right.
    pub fn runs(&self, y: usize, limit: f32) -> impl Iterator<Item = (Range<usize>, bool)> {
        let first = y / TILE * self.columns;
        let tiles = self.most.get(first..first + self.columns).unwrap_or(&[]);
        let runs = tiles.chunk_by(move |a, b| (*a > limit) == (*b > limit));
        let mut from = 0;
        runs.map(move |run| {
            let start = from;
            from += run.len() * TILE;
            (start..from, run[0] > limit)
        })
    }

    /// Writes the radii of row `y` to `row`: those of the tiles of the columns in `part`.
    #[inline(always)]
    pub fn write(&self, y: usize, part: &Range<usize>, row: &mut Vec<f32>) {
        row.resize(self.columns * TILE, 0.0);
        let (first, past) = (part.start / TILE, part.end.div_ceil(TILE).min(self.columns));
        let count = self.columns + 1;
        let corners = |row: usize| self.corners.get(row * count + first..row * count + past + 1);
        let (Some(above), Some(below)) = (corners(y / TILE), corners(y / TILE + 1)) else { return };
        let down = PLACES[y % TILE] / TILE as f32;
        let mut left = 0.0;
        let tiles = &mut row.as_chunks_mut::<TILE>().0[first..];
        for (column, (&above, &below)) in above.iter().zip(below).enumerate() {
            let right = above + (below - above) * down;
            let growth = (right - left) / TILE as f32;
            if let Some(tile) = column.checked_sub(1).and_then(|before| tiles.get_mut(before)) {
                for (radius, place) in tile.iter_mut().zip(PLACES) {
                    *radius = left + growth * place;
                }
            }
            left = right;
        }
    }
}

/// Sum and number of the radii of a tile's samples.
fn samples(
    surface: &impl Surface,
    depth: &[f32],
    [width, height]: [usize; 2],
    [left, top]: [usize; 2],
) -> [f32; 2] {
    let mut found = [0.0; 2];
    for y in (top..height.min(top + TILE)).step_by(EVERY) {
        for x in (left..width.min(left + TILE)).step_by(EVERY) {
            if depth[y * width + x] < f32::INFINITY {
                found[0] += surface.radius_px(x, y).min(RADIUS_MAX_PX);
                found[1] += 1.0;
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::pyramid::{Planes, Pyramid};
    use glam::Vec4;

    /// Radii measured on the columns from `from` on of a picture of two kinds of discs, the wide
    /// ones to the right.
    fn measured(from: usize) -> Radii {
        let size = [10 * TILE - from, 2 * TILE + 5];
        let mut surface = Pyramid::default();
        surface.fit(size[0], size[1], Planes::None);
        let mut depth = vec![1.0; size[0] * size[1]];
        for (i, depth) in depth.iter_mut().enumerate() {
            let x = from + i % size[0];
            let radius_px = if x < 5 * TILE { 2.0 } else { 20.0 };
            surface.levels[0].tint[i] = Vec4::new(0.0, 0.0, 0.0, radius_px);
            if x >= 9 * TILE {
                *depth = f32::INFINITY;
            }
        }
        let mut radii = Radii::default();
        radii.measure(&surface, &depth);
        radii
    }

    fn row(radii: &Radii, y: usize) -> Vec<f32> {
        let mut row = Vec::new();
        radii.write(y, &(0..radii.columns * TILE), &mut row);
        row
    }

    #[test]
    fn radii_are_those_around_and_change_gradually() {
        let row = row(&measured(0), 20);
        assert!(row[..4 * TILE].iter().all(|&radius| radius == 2.0), "{row:?}");
        assert!(row[6 * TILE..9 * TILE].iter().all(|&radius| radius == 20.0), "{row:?}");
        let mut steps = row[..9 * TILE].windows(2).map(|pair| pair[1] - pair[0]);
        let most = 18.0 / TILE as f32;
        assert!(steps.all(|step| (0.0..=most).contains(&step)), "{row:?}");
    }

    #[test]
    fn a_window_has_the_radii_of_the_whole() {
        let from = 3 * TILE;
        let (whole, window) = (measured(0), measured(from));
        for y in [0, TILE + 1, 2 * TILE + 4] {
            let (whole, window) = (row(&whole, y), row(&window, y));
            assert_eq!(whole[from + TILE..], window[TILE..]);
        }
    }

    #[test]
    fn runs_part_a_row_by_radius() {
        let runs: Vec<_> = measured(0).runs(20, 2.0).collect();
        assert_eq!(runs, [(0..4 * TILE, false), (4 * TILE..10 * TILE, true)]);
    }
}
