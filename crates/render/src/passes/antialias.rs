//! Antialias: smooths outlines, where a surface ends in front of another or of the background, and
//! creases; all other pixels stay. The surroundings of such a pixel are split at the step of depth
//! into those in front and those behind. A weighted count of the pixels in front is its coverage,
//! by which the mean colours of both are mixed, in linear light and weighted by alpha.
//!
//! A pixel shows a surface wherever a point or an ellipse touches it, so outlines lie about half a
//! pixel too far out. They are taken back by the slope of the coverage, which is its change per
//! pixel. Lines two pixels wide or less are not, since too little of them would be left.

use crate::inputs::colour::{linear, words};
use crate::picture::marks::{Marks, bits};
use crate::picture::windows::{eight, rows_around, windows};
use crate::simd::values::{EIGHT, Values, bits as bits_of, dot, load, only};
use fearless_simd::{ExtractToken, Level, Select, Simd, dispatch, f32x8, mask32x8, u32x8};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Weights of coverage along an axis (binomial).
pub(crate) const COVERAGE: [f32; 5] = [1.0, 4.0, 6.0, 4.0, 1.0];
pub(crate) const COVERAGE_SUM: f32 = 256.0;
/// Positions of the weights, pixels from the middle.
const PLACES: [f32; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
/// Weights of colours along an axis.
pub(crate) const COLOUR: [f32; 3] = [1.0, 2.0, 1.0];
pub(crate) const COLOUR_SUM: f32 = 16.0;
/// Steepness of the outline over that of the weighted count. Steeper outlines show steps again.
pub(crate) const STEEP: f32 = 1.5;
/// Distance by which outlines are taken back, pixels. More dents outlines of sparse samples.
pub(crate) const INSET_PX: f32 = 0.4;
/// Depth over width beyond which neighbouring pixels show two surfaces.
pub(crate) const STEP_PX: f32 = 6.0;
/// Square of the cosine (30 degrees) below which neighbouring normals make a crease.
pub(crate) const CREASE: f32 = 0.75;

/// Whether two normals of any length make a crease.
#[inline]
pub fn is_crease(a: Vec3, b: Vec3) -> bool {
    let dot = a.dot(b);
    dot * dot.max(0.0) < CREASE * a.length_squared() * b.length_squared()
}

/// [`is_crease`] for registers of normals.
#[inline(always)]
pub fn are_creases<V: Values>(a: [V; 3], b: [V; 3]) -> V::Mask {
    let along = dot(a, b);
    (along * along.max(along.like(0.0))).cmplt(dot(a, a) * CREASE * dot(b, b))
}

/// Antialiases a picture of `width` pixels per row (sRGB, straight alpha): those pixels of `edges`
/// that lie at a step of `depth` (infinite where the picture is empty), and those of `creases`.
pub fn antialias(
    depth: &[f32],
    width: usize,
    focal_px: f32,
    edges: &Marks,
    creases: &Marks,
    rgba: &mut [u8],
) {
    let outlines = Outlines { depth, width, near: STEP_PX / focal_px, edges, creases };
    let shown = rgba.as_chunks().0;
    let bands = edges.bands().map(|pixels| outlines.antialiased(shown, pixels));
    let antialiased: Vec<Vec<_>> = bands.collect();
    let pixels = rgba.as_chunks_mut::<4>().0;
    for (pixel, colour) in antialiased.into_iter().flatten() {
        pixels[pixel as usize] = colour;
    }
}

/// Pixels of a picture to be antialiased.
struct Outlines<'a> {
    depth: &'a [f32],
    width: usize,
    /// Difference of neighbouring depths, over the depth, beyond which there is a step.
    near: f32,
    edges: &'a Marks,
    creases: &'a Marks,
}

impl Outlines<'_> {
    /// Changed pixels in a run of whole rows, with their new colours.
    fn antialiased(&self, shown: &[[u8; 4]], pixels: Range<usize>) -> Vec<(u32, [u8; 4])> {
        let mut antialiased = Vec::new();
        for y in pixels.start / self.width..pixels.end / self.width {
            dispatch!(Level::new(), simd => self.antialias_row(simd, shown, y, &mut antialiased));
        }
        antialiased
    }

    /// Appends the changed pixels of row `y`.
    #[inline(always)]
    fn antialias_row<S: Simd>(
        &self,
        simd: S,
        shown: &[[u8; 4]],
        y: usize,
        antialiased: &mut Vec<(u32, [u8; 4])>,
    ) {
        let (depths, shown) =
            (rows_around(self.depth, self.width, y), rows_around(shown, self.width, y));
        for x in (0..self.width).step_by(EIGHT) {
            let (pixel, count) = (y * self.width + x, EIGHT.min(self.width - x));
            let [edges, creases] = [self.edges, self.creases].map(|m| m.run(pixel, count));
            if edges | creases == 0 {
                continue;
            }
            let (mut space, mut none) = ([[0.0; _]; 5], [[[0; 4]; _]; 3]);
            let depths = windows(depths, x, &mut space);
            let split = split(simd, depths, self.near);
            let at_steps = bits_of(split.cmplt(split.like(f32::INFINITY)));
            let changing = creases | edges & u64::from(at_steps);
            if changing != 0 {
                let colours = mixed(simd, depths, split, windows(shown, x, &mut none));
                antialiased.extend(bits(changing).map(|k| ((pixel + k) as u32, colours[k])));
            }
        }
    }
}

/// Five rows of depths around eight pixels, with two pixels on either side.
type Depths<'a> = [&'a [f32; EIGHT + 4]; 5];

/// Depth halfway across the greatest step from each of eight pixels to a neighbour, if that is more
/// than the share `near` of the depth; else infinity.
#[inline(always)]
fn split<S: Simd>(simd: S, depths: Depths<'_>, near: f32) -> f32x8<S> {
    let here = eight(simd, depths[2], 2);
    let (mut most, mut split) = (here.like(0.0), here.like(f32::INFINITY));
    for (row, from) in [(2, 1), (2, 3), (1, 2), (3, 2)] {
        let beside = eight(simd, depths[row], from);
        // Infinity minus infinity is NaN, which is no step, as there is none to a pixel outside the
        // picture.
        let (step, nearer) = ((beside - here).abs(), beside.min(here));
        let is_most = (nearer * near).cmplt(step) & most.cmplt(step);
        let between = (nearer + step * 0.5).min(step.like(f32::MAX));
        (most, split) =
            (Values::select(is_most, step, most), Values::select(is_most, between, split));
    }
    split
}

/// Mixes the surroundings of eight pixels in front of `split` and behind it.
#[inline(always)]
fn mixed<S: Simd>(
    simd: S,
    depths: Depths<'_>,
    split: f32x8<S>,
    shown: [&[[u8; 4]; EIGHT + 2]; 3],
) -> [[u8; 4]; EIGHT] {
    let (zero, one) = (split.like(0.0), split.like(1.0));
    let is_before = |row: usize, from: usize| eight(simd, depths[row], from).cmple(split);
    // The slope of the coverage, towards the front, is the weighted sum of positions.
    let (mut coverage, mut slope) = (zero, [zero; 2]);
    // Surroundings that are in front, a bit each.
    let mut places = simd.splat_u32x8(0);
    for (row, (down, y)) in COVERAGE.into_iter().zip(PLACES).enumerate() {
        let (mut count, mut across) = (zero, zero);
        for (from, (weight, x)) in COVERAGE.into_iter().zip(PLACES).enumerate() {
            let is_before = is_before(row, from);
            count += only(is_before, one.like(weight));
            across += only(is_before, one.like(weight * x));
            let place = simd.splat_u32x8(1 << (5 * row + from));
            places |= is_before.select(place, simd.splat_u32x8(0));
        }
        coverage = count.mul_add(one.like(down), coverage);
        slope[0] = across.mul_add(one.like(down), slope[0]);
        slope[1] = count.mul_add(one.like(down * y), slope[1]);
    }
    let is_inside = is_inside(slope, places);
    let length = (slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
    coverage -= only(is_inside, length * INSET_PX);
    // Colours times alpha, alpha, and the sum of weights.
    let (mut before, mut all, mut weight) = ([zero; 4], [zero; 4], zero);
    for (row, down) in COLOUR.into_iter().enumerate() {
        let light = lit(shown[row]);
        for (from, across) in COLOUR.into_iter().enumerate() {
            let is_before = is_before(row + 1, from + 1);
            let share = one.like(down * across);
            weight += only(is_before, share);
            for k in 0..4 {
                let light = eight(simd, &light[k], from) * share;
                all[k] += light;
                before[k] += only(is_before, light);
            }
        }
    }
    let share = ((coverage * (1.0 / COVERAGE_SUM) - 0.5) * STEEP + 0.5).max(zero).min(one);
    let is_whole = weight.cmpeq(zero) | weight.cmpeq(weight.like(COLOUR_SUM));
    let parts = [share / weight, (one - share) / (weight.like(COLOUR_SUM) - weight)];
    let mixed: [_; 4] = std::array::from_fn(|k| {
        let parted = before[k] * parts[0] + (all[k] - before[k]) * parts[1];
        Values::select(is_whole, all[k] * (1.0 / COLOUR_SUM), parted)
    });
    let is_seen = zero.cmplt(mixed[3]);
    let colour = words([0, 1, 2].map(|k| only(is_seen, mixed[k] / mixed[3])));
    let alpha = mixed[3] + 0.5;
    let (colour, alpha) = (<[u32; EIGHT]>::from(colour), *alpha);
    std::array::from_fn(|k| {
        let [r, g, b, _] = colour[k].to_le_bytes();
        [r, g, b, alpha[k] as u8]
    })
}

/// Colours of a row in linear light times alpha, and alpha, component by component.
#[inline(always)]
fn lit<const N: usize>(shown: &[[u8; 4]; N]) -> [[f32; N]; 4] {
    let mut planes = [[0.0; N]; 4];
    for (k, &[r, g, b, a]) in shown.iter().enumerate() {
        let light = linear([r, g, b]).extend(1.0) * f32::from(a);
        (0..4).for_each(|i| planes[i][k] = light[i]);
    }
    planes
}

/// Whether the pixel two pixels from the middle, in a direction towards the front, is in front too,
/// for eight pixels. Whole numbers and no root, so that processors and GPUs decide alike.
#[inline(always)]
fn is_inside<S: Simd>([x, y]: [f32x8<S>; 2], places: u32x8<S>) -> mask32x8<S> {
    let square = x * x + y * y;
    // Rounded: two pixels beyond three quarters of the way, one beyond a quarter.
    let steps = |along: f32x8<S>| {
        let part = along * along * 16.0;
        let one = along.like(1.0);
        let steps = only(square.cmplt(part), one) + only((square * 9.0).cmplt(part), one);
        Values::select(along.cmplt(along.like(0.0)), -steps, steps)
    };
    let place = *((steps(y) + 2.0) * 5.0 + (steps(x) + 2.0));
    let places = <[u32; EIGHT]>::from(places);
    let inside: [f32; EIGHT] = std::array::from_fn(|k| (places[k] >> place[k] as u32 & 1) as f32);
    let inside = load(x.token(), &inside);
    inside.like(0.0).cmplt(inside)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 12;

    fn antialiased(depth: impl Fn(usize) -> f32, rgba: &mut [u8]) {
        let depth: Vec<f32> = (0..SIDE * SIDE).map(depth).collect();
        let mut all = Marks::new(SIDE, SIDE);
        (0..SIDE * SIDE).for_each(|pixel| all.set(pixel));
        antialias(&depth, SIDE, 100.0, &all, &Marks::new(SIDE, SIDE), rgba);
    }

    #[test]
    fn within_a_surface_nothing_changes_also_on_a_slope() {
        let texture: Vec<u8> = (0..SIDE * SIDE * 4).map(|i| (i * 37 % 251) as u8).collect();
        let mut rgba = texture.clone();
        antialiased(|i| 2.0 + 0.1 * (i % SIDE) as f32, &mut rgba);
        assert_eq!(rgba, texture);
    }

    #[test]
    fn an_outline_is_taken_back_by_less_than_half_a_pixel_and_colours_do_not_darken() {
        // Red from column 6 on, empty to the left.
        let pixel = |i: usize| if i % SIDE < 6 { [0; 4] } else { [200, 0, 0, 255] };
        let mut rgba: Vec<u8> = (0..SIDE * SIDE).flat_map(pixel).collect();
        antialiased(|i| if i % SIDE < 6 { f32::INFINITY } else { 1.0 }, &mut rgba);
        let row = &rgba.as_chunks::<4>().0[5 * SIDE..6 * SIDE];
        assert_eq!([row[4], row[7]], [[0; 4], [200, 0, 0, 255]]);
        // Coverage 0.56 is left of the pixel at the outline, and nothing of the pixel beyond.
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
            antialiased(|i| if is_line(i) { 1.0 } else { f32::INFINITY }, &mut rgba);
            let row = &rgba.as_chunks::<4>().0[5 * SIDE..6 * SIDE];
            let alphas = row.iter().map(|p| f32::from(p[3]) / 255.0).sum::<f32>();
            // Coverage of an outline that is not taken back; of two pixels, the part beyond them
            // goes.
            let expected = [0.5625, 1.375, 2.1125][width - 1];
            assert!((alphas - expected).abs() < 0.02, "{alphas} of {width}");
        }
    }
}
