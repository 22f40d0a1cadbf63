//! Weighted means over the neighbours of a pixel, with weights that fall with the difference of
//! their guides: what the cross-bilateral filter and a-trous wavelets share. Eight pixels of a row
//! go together. Depth is compared with the plane through the pixel, so that slanted surfaces are
//! smoothed like others.

#![allow(clippy::needless_range_loop, reason = "indices go over several arrays of constant length")]

use super::input::Input;
use fearless_simd::{Level, Simd, SimdBase, dispatch, f32x8};
use rayon::prelude::*;

const EIGHT: usize = 8;

/// A neighbour, and its weight before guides are compared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tap {
    pub x: isize,
    pub y: isize,
    pub weight: f32,
}

/// Planes with a margin on the left and right.
pub(crate) struct Padded {
    width: usize,
    stride: usize,
    margin: usize,
}

impl Padded {
    /// Layout for rows of `width` pixels with neighbours at most `margin` away.
    pub fn new(width: usize, margin: usize) -> Self {
        Self { width, margin, stride: width.next_multiple_of(EIGHT) + 2 * margin }
    }

    /// A plane times `scale`, with zeros in its margins.
    pub fn plane(&self, values: &[f32], scale: f32) -> Vec<f32> {
        let mut out = vec![0.0; values.len() / self.width * self.stride];
        let rows = out.par_chunks_mut(self.stride).zip(values.par_chunks(self.width));
        rows.for_each(|(out, row)| {
            let inner = &mut out[self.margin..self.margin + self.width];
            inner.iter_mut().zip(row).for_each(|(out, value)| *out = value * scale);
        });
        out
    }

    /// The plane without its margins.
    pub fn inner(&self, plane: &[f32]) -> Vec<f32> {
        let inner = |row: &[f32]| row[self.margin..self.margin + self.width].to_vec();
        plane.par_chunks(self.stride).flat_map_iter(inner).collect()
    }
}

/// Planes that neighbours are compared by, scaled so that a difference of one lowers the weight by
/// a factor e, and what is averaged. If `GAIN`, the last signal is the mask, and what comes out is
/// not its mean but the factor by which means lower the standard deviation of white noise.
pub(crate) struct Neighbours<'a, const N: usize, const GAIN: bool> {
    pub padded: &'a Padded,
    /// Guides; the last is depth if it has slopes.
    pub guides: Vec<&'a [f32]>,
    /// Change of depth by a pixel to the right and one down.
    pub slopes: Option<[&'a [f32]; 2]>,
    /// One where a pixel counts.
    pub mask: &'a [f32],
    /// Values, zero where a pixel does not count.
    pub signals: [&'a [f32]; N],
}

impl<const N: usize, const GAIN: bool> Neighbours<'_, N, GAIN> {
    /// Means over the taps, with margins. Pixels that do not count get zero.
    pub fn means(&self, taps: &[Tap]) -> [Vec<f32>; N] {
        let stride = self.padded.stride;
        let mut means = [(); N].map(|()| vec![0.0; self.mask.len()]);
        let mut planes = means.each_mut().map(|plane| plane.chunks_mut(stride));
        let rows = self.mask.len() / stride;
        let rows: Vec<[&mut [f32]; N]> = (0..rows)
            .map(|_| planes.each_mut().map(|rows| rows.next().unwrap_or_default()))
            .collect();
        rows.into_par_iter().enumerate().for_each(|(y, out)| {
            dispatch!(Level::new(), simd => match self.guides.len() {
                1 => self.row::<_, 1>(simd, y, taps, out),
                3 => self.row::<_, 3>(simd, y, taps, out),
                4 => self.row::<_, 4>(simd, y, taps, out),
                5 => self.row::<_, 5>(simd, y, taps, out),
                6 => self.row::<_, 6>(simd, y, taps, out),
                7 => self.row::<_, 7>(simd, y, taps, out),
                8 => self.row::<_, 8>(simd, y, taps, out),
                _ => self.row::<_, 0>(simd, y, taps, out),
            });
        });
        means
    }

    #[inline(always)]
    fn row<S: Simd, const K: usize>(
        &self,
        simd: S,
        y: usize,
        taps: &[Tap],
        mut out: [&mut [f32]; N],
    ) {
        let (stride, margin) = (self.padded.stride, self.padded.margin);
        let height = self.mask.len() / stride;
        for x in (margin..margin + self.padded.width).step_by(EIGHT) {
            let here = y * stride + x;
            let zero = simd.splat_f32x8(0.0);
            let mut centre = [zero; K];
            for k in 0..K {
                centre[k] = load(simd, self.guides[k], here);
            }
            let slopes = match self.slopes {
                Some([right, down]) => [load(simd, right, here), load(simd, down, here)],
                None => [zero; 2],
            };
            let (mut total, mut sums) = (zero, [zero; N]);
            for tap in taps {
                let Some(row) = y.checked_add_signed(tap.y).filter(|&row| row < height) else {
                    continue;
                };
                let there = (row * stride + x).wrapping_add_signed(tap.x);
                let mut distance = zero;
                for k in 0..K {
                    let mut change = load(simd, self.guides[k], there) - centre[k];
                    if k == K - 1 {
                        change -= slopes[0] * tap.x as f32 + slopes[1] * tap.y as f32;
                    }
                    distance = simd.mul_add_f32x8(change, change, distance);
                }
                let weight = falling(zero, distance) * tap.weight;
                total = simd.mul_add_f32x8(weight, load(simd, self.mask, there), total);
                for n in 0..N {
                    let mut value = load(simd, self.signals[n], there);
                    if GAIN && n == N - 1 {
                        value *= weight;
                    }
                    sums[n] = simd.mul_add_f32x8(weight, value, sums[n]);
                }
            }
            let share = load(simd, self.mask, here) / total.max(zero + f32::MIN_POSITIVE);
            if GAIN {
                sums[N - 1] = simd.sqrt_f32x8(sums[N - 1]);
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                if let Some(out) = out.get_mut(x..).and_then(|out| out.first_chunk_mut::<EIGHT>()) {
                    *out = *(sum * share);
                }
            }
        }
    }
}

/// About exp(-distance): a power of a line, which needs no exponential and ends at 16, where the
/// exponential is 1e-7.
#[inline(always)]
fn falling<S: Simd>(zero: f32x8<S>, distance: f32x8<S>) -> f32x8<S> {
    let line = (1.0 - distance * (1.0 / 16.0)).max(zero);
    let second = line * line;
    let fourth = second * second;
    let eighth = fourth * fourth;
    eighth * eighth
}

#[inline(always)]
fn load<S: Simd>(simd: S, plane: &[f32], from: usize) -> f32x8<S> {
    match plane.get(from..).and_then(|rest| rest.first_chunk::<EIGHT>()) {
        Some(eight) => f32x8::load_array_ref(simd, eight),
        None => simd.splat_f32x8(0.0),
    }
}

/// Change of a plane by a pixel to the right and by one down, of the two neighbours on an axis the
/// less: across an edge the other one counts.
pub(crate) fn slopes(input: &Input<'_>, plane: &[f32]) -> [Vec<f32>; 2] {
    let (width, height) = (input.width, input.height);
    let change = |i: usize, step: usize, first: bool, last: bool| {
        let between = |from: usize, to: usize| {
            (input.mask[from] * input.mask[to] != 0.0).then(|| plane[to] - plane[from])
        };
        let before = if first { None } else { between(i - step, i) };
        let after = if last { None } else { between(i, i + step) };
        match (before, after) {
            (Some(a), Some(b)) => {
                if a.abs() < b.abs() {
                    a
                } else {
                    b
                }
            }
            (a, b) => a.or(b).unwrap_or(0.0),
        }
    };
    let x = |i: usize| change(i, 1, i.is_multiple_of(width), i % width + 1 == width);
    let y = |i: usize| change(i, width, i < width, i / width + 1 == height);
    let len = plane.len();
    [(0..len).into_par_iter().map(x).collect(), (0..len).into_par_iter().map(y).collect()]
}
