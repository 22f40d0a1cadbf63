//! Soften: antialiasing where a surface ends before another or before the background, and at creases;
//! elsewhere nothing changes. What is seen around such a pixel falls into two, before and behind the step.
//! A weighted count of both is the pixel's coverage, which smooths the outline and gives it its share of a
//! pixel; the two are mixed by it. In linear light, colours weighted by their alpha.
//!
//! A pixel shows a surface wherever a point or an ellipse touches it, so that outlines lie about half a pixel too far out. They are
//! taken back by the slope of the count, which is how much of it a pixel's step makes; but not those of lines two pixels
//! wide or less, of which too little would be left.

use crate::colour::{Encoder, linear};
use crate::values::{Values, dot};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// Weights of coverage an axis (binomial).
const COVERAGE: [f32; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];
const COVERAGE_SUM: f32 = 256.0;
/// Places of the weights, pixels from the middle.
const PLACES: [f32; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// Weights of colours an axis.
const COLOUR: [f32; 5] = [0.0, 1.0, 2.0, 1.0, 0.0];
const COLOUR_SUM: f32 = 16.0;
/// How much steeper the outline is than its weighted count. Steeper ones show steps again.
const STEEP: f32 = 1.5;
/// How far outlines are taken back, pixels: of a sphere and a cube with normals, samples a pixel apart, alpha is off by 0.21
/// (root of the mean square where the true outline crosses a pixel), without by 0.35. More dents outlines of sparse samples.
const INSET_PX: f32 = 0.4;
/// Depth over width beyond which neighbouring pixels show two surfaces.
const STEP_PX: f32 = 6.0;
/// Square of the cosine below which neighbouring normals make a crease (30 degrees).
const CREASE: f32 = 0.75;

/// Whether two normals make a crease. Their lengths do not matter.
#[inline]
pub fn is_crease(a: Vec3, b: Vec3) -> bool {
    let dot = a.dot(b);
    dot * dot.max(0.0) < CREASE * a.length_squared() * b.length_squared()
}

/// The same of several.
#[inline(always)]
pub fn are_creases<V: Values>(a: [V; 3], b: [V; 3]) -> V::Mask {
    let along = dot(a, b);
    (along * along.max(along.like(0.0))).cmplt(dot(a, a) * CREASE * dot(b, b))
}

/// Softens a picture of `width` pixels a row (sRGB, straight alpha): the pixels of `edges` that lie at a step of
/// `depth` (infinite where there is nothing), and those of `creases`.
pub fn soften(
    depth: &[f32],
    width: usize,
    focal_px: f32,
    edges: &[usize],
    creases: &[usize],
    rgba: &mut [u8],
) {
    let near = STEP_PX / focal_px;
    let image = Image { depth, pixels: rgba.as_chunks().0, width };
    let at_edges = edges.par_iter().with_min_len(1024).filter_map(|&p| {
        let split = image.split(p, near);
        (split < f32::INFINITY).then(|| (p, image.softened(p, split)))
    });
    let at_creases = creases.par_iter().with_min_len(1024);
    let at_creases = at_creases.map(|&p| (p, image.softened(p, image.split(p, near))));
    let softened: Vec<_> = at_edges.chain(at_creases).collect();
    let pixels = rgba.as_chunks_mut::<4>().0;
    for (pixel, colour) in softened {
        pixels[pixel] = colour;
    }
}

/// Column and row of the surroundings, two pixels from the middle in this direction: whole numbers and no root, so that
/// processors and GPUs choose the same.
fn inwards([x, y]: [f32; 2]) -> [usize; 2] {
    let square = x * x + y * y;
    // Rounded: beyond three quarters of the way two, beyond a quarter one.
    [x, y].map(|along| {
        let part = 16.0 * along * along;
        let steps = usize::from(part > square) + usize::from(part > 9.0 * square);
        if along < 0.0 { 2 - steps } else { 2 + steps }
    })
}

struct Image<'a> {
    depth: &'a [f32],
    pixels: &'a [[u8; 4]],
    width: usize,
}

impl Image<'_> {
    /// Its surroundings before `split` and behind it, mixed. Beyond the picture they go on as at its border.
    fn softened(&self, pixel: usize, split: f32) -> [u8; 4] {
        let [width, height] = [self.width, self.depth.len() / self.width];
        let around = |at: usize, len: usize| {
            [0, 1, 2, 3, 4].map(|k| (at + k).saturating_sub(2).min(len - 1))
        };
        let columns = around(pixel % width, width);
        let rows = around(pixel / width, height).map(|y| y * width);
        // Colours times alpha, alpha, and their weights.
        let (mut coverage, mut before, mut all) = (0.0, Vec4::ZERO, Vec4::ZERO);
        // What the count changes by, towards what is before: its sum of places.
        let (mut weight, mut slope) = (0.0, [0.0; 2]);
        for ((row, down), y) in rows.into_iter().zip(COVERAGE).zip(PLACES) {
            for ((column, across), x) in columns.into_iter().zip(COVERAGE).zip(PLACES) {
                let is_before = self.depth[row + column] <= split;
                let count = if is_before { across * down } else { 0.0 };
                coverage += count;
                slope[0] += count * x;
                slope[1] += count * y;
            }
        }
        let [x, y] = inwards(slope);
        if self.depth[rows[y] + columns[x]] <= split {
            coverage -= INSET_PX * (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
        }
        for (row, down) in rows.into_iter().zip(COLOUR).skip(1).take(3) {
            for (column, across) in columns.into_iter().zip(COLOUR).skip(1).take(3) {
                let [r, g, b, a] = self.pixels[row + column];
                let share = down * across;
                let colour = linear([r, g, b]).extend(1.0) * (f32::from(a) * share);
                all += colour;
                if self.depth[row + column] <= split {
                    before += colour;
                    weight += share;
                }
            }
        }
        let share = ((coverage / COVERAGE_SUM - 0.5) * STEEP + 0.5).clamp(0.0, 1.0);
        let mixed = if weight == 0.0 || weight == COLOUR_SUM {
            all / COLOUR_SUM
        } else {
            before * (share / weight) + (all - before) * ((1.0 - share) / (COLOUR_SUM - weight))
        };
        let colour = if mixed.w > 0.0 { mixed.truncate() / mixed.w } else { Vec3::ZERO };
        let [r, g, b] = Encoder::get().bytes(colour);
        [r, g, b, (mixed.w + 0.5) as u8]
    }

    /// The depth between the two sides of the greatest step to a neighbour, where it is more than the share
    /// `near` of the depth; else infinity.
    fn split(&self, pixel: usize, near: f32) -> f32 {
        let (width, here) = (self.width, self.depth[pixel]);
        let x = pixel % width;
        let beside = [
            (x > 0).then(|| pixel - 1),
            (x + 1 < width).then_some(pixel + 1),
            pixel.checked_sub(width),
            Some(pixel + width).filter(|&p| p < self.depth.len()),
        ];
        let (mut most, mut split) = (0.0, f32::INFINITY);
        for depth in beside.into_iter().flatten().map(|p| self.depth[p]) {
            // Infinity less infinity is no number, which is no step.
            let (step, nearer) = ((depth - here).abs(), depth.min(here));
            if step > near * nearer && step > most {
                (most, split) =
                    (step, if step < f32::INFINITY { nearer + step * 0.5 } else { f32::MAX });
            }
        }
        split
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 12;

    fn softened(depth: impl Fn(usize) -> f32, rgba: &mut [u8]) {
        let depth: Vec<f32> = (0..SIDE * SIDE).map(depth).collect();
        let all: Vec<usize> = (0..SIDE * SIDE).collect();
        soften(&depth, SIDE, 100.0, &all, &[], rgba);
    }

    #[test]
    fn within_a_surface_nothing_changes_also_on_a_slope() {
        let texture: Vec<u8> = (0..SIDE * SIDE * 4).map(|i| (i * 37 % 251) as u8).collect();
        let mut rgba = texture.clone();
        softened(|i| 2.0 + 0.1 * (i % SIDE) as f32, &mut rgba);
        assert_eq!(rgba, texture);
    }

    #[test]
    fn an_outline_is_taken_back_by_less_than_half_a_pixel_and_colours_do_not_darken() {
        // Red from column 6 on, nothing to the left.
        let pixel = |i: usize| if i % SIDE < 6 { [0; 4] } else { [200, 0, 0, 255] };
        let mut rgba: Vec<u8> = (0..SIDE * SIDE).flat_map(pixel).collect();
        softened(|i| if i % SIDE < 6 { f32::INFINITY } else { 1.0 }, &mut rgba);
        let row = &rgba.as_chunks::<4>().0[5 * SIDE..6 * SIDE];
        assert_eq!([row[4], row[7]], [[0; 4], [200, 0, 0, 255]]);
        // Of the pixel that the outline was beside, 0.44 are taken, and nothing is left of the one beyond.
        assert!(row[5][3] <= 2 && (140..=144).contains(&row[6][3]), "{row:?}");
        assert!(row[6][0].abs_diff(200) <= 1);
    }

    #[test]
    fn lines_are_not_taken_back() {
        for width in [1, 2, 3] {
            let line = 5..5 + width;
            let is_line = |i: usize| line.contains(&(i % SIDE));
            let pixel = |i: usize| if is_line(i) { [200, 0, 0, 255] } else { [0; 4] };
            let mut rgba: Vec<u8> = (0..SIDE * SIDE).flat_map(pixel).collect();
            softened(|i| if is_line(i) { 1.0 } else { f32::INFINITY }, &mut rgba);
            let row = &rgba.as_chunks::<4>().0[5 * SIDE..6 * SIDE];
            let alphas = row.iter().map(|p| f32::from(p[3]) / 255.0).sum::<f32>();
            // As much as there was without taking anything back: 0.56 and 1.81; of two pixels, what lies beyond them goes.
            let expected = [0.5625, 1.375, 2.1125][width - 1];
            assert!((alphas - expected).abs() < 0.02, "{alphas} of {width}");
        }
    }
}
