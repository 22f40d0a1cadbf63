//! Guided image filter (`bauszat2011` 3.3; `he2010`): in each window the picture is fitted to the
//! guides by linear regression, and a pixel takes the mean of the fits of all windows that cover
//! it. The cost does not depend on the radius. The first pass sums along rows and solves the
//! windows; the second pass sums their coefficients along columns. Bands of rows run in parallel;
//! where they begin depends on the picture and the radius alone, hence the result does not depend
//! on the number of threads.

#![allow(clippy::needless_range_loop, reason = "indices go over several arrays of constant length")]

use super::input::Input;
use super::moments::{Columns, EIGHT, ROWS, eight, moment_count};
use super::solve::{CENTRE, Ridge};
use super::windows::{Chunk, Windows};
use fearless_simd::{Level, Simd, SimdBase, dispatch, f32x8, f64x8};
use rayon::prelude::*;

/// Ridge of each guide, of any number.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Ridges {
    /// Epsilon of each guide.
    pub epsilon: Vec<f64>,
    /// Epsilon of each guide for a window whose mean has a variance of its own square.
    pub noise: Vec<f64>,
}

/// Memory of the filters that is kept from picture to picture: 48 to 76 MB at 1024 x 768. Fetching
/// it anew from the system takes a third of the time of the filter.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    sums: Vec<[f32; EIGHT]>,
}

impl Workspace {
    /// Chunks of `C` sums, of any value.
    fn chunks<const C: usize>(&mut self, count: usize) -> &mut [Chunk<C>] {
        if self.sums.len() < count * C {
            self.sums = vec![[0.0; EIGHT]; count * C];
        }
        self.sums[..count * C].as_chunks_mut().0
    }

    /// Bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.sums)
    }
}

/// Filters the signals of the input, the first three of which are colour. Pixels that are left out
/// get any value.
pub(crate) fn regress(
    input: &Input<'_>,
    radius: usize,
    ridges: &Ridges,
    workspace: &mut Workspace,
) -> Vec<Vec<f32>> {
    match (input.guides.len(), input.signals.len()) {
        (1, 3) => run::<1, 3, { moment_count(1, 3) }, 6>(input, radius, ridges, workspace),
        (3, 3) => run::<3, 3, { moment_count(3, 3) }, 12>(input, radius, ridges, workspace),
        (4, 3) => run::<4, 3, { moment_count(4, 3) }, 15>(input, radius, ridges, workspace),
        (5, 3) => run::<5, 3, { moment_count(5, 3) }, 18>(input, radius, ridges, workspace),
        (1, 4) => run::<1, 4, { moment_count(1, 4) }, 8>(input, radius, ridges, workspace),
        (3, 4) => run::<3, 4, { moment_count(3, 4) }, 16>(input, radius, ridges, workspace),
        (4, 4) => run::<4, 4, { moment_count(4, 4) }, 20>(input, radius, ridges, workspace),
        (5, 4) => run::<5, 4, { moment_count(5, 4) }, 24>(input, radius, ridges, workspace),
        (guides, signals) => panic!("{guides} guides and {signals} signals have no filter"),
    }
}

/// Rows of a band. A band begins with sums over a window, which must be cheap beside its own rows.
fn band_rows(radius: usize) -> usize {
    (6 * radius).clamp(64, 1024).next_multiple_of(ROWS)
}

fn run<const K: usize, const N: usize, const M: usize, const C: usize>(
    input: &Input<'_>,
    radius: usize,
    ridges: &Ridges,
    workspace: &mut Workspace,
) -> Vec<Vec<f32>> {
    // A radius beyond the picture is as good as one of its size.
    let radius = radius.min(input.width.max(input.height));
    let mut out: Vec<Vec<f32>> = (0..N).map(|_| vec![0.0; input.len()]).collect();
    if input.len() == 0 {
        return out;
    }
    let value = |values: &[f64], k: usize| values.get(k).copied().unwrap_or(0.0);
    let ridge = Ridge {
        epsilon: std::array::from_fn(|k| value(&ridges.epsilon, k)),
        noise: std::array::from_fn(|k| value(&ridges.noise, k)),
    };
    let (chunks, band) = (input.width.div_ceil(EIGHT), band_rows(radius));
    let sums = workspace.chunks::<C>(chunks * input.height);
    sums.par_chunks_mut(chunks * band).enumerate().for_each(|(b, sums)| {
        dispatch!(Level::new(), simd => {
            solve_band::<_, K, N, M, C>(simd, input, radius, ridge, b * band, sums);
        });
    });
    let sums = &*sums;
    let mut rows: Vec<_> = out.iter_mut().map(|out| out.chunks_mut(input.width * band)).collect();
    let bands: Vec<Vec<&mut [f32]>> = (0..input.height.div_ceil(band))
        .map(|_| rows.iter_mut().filter_map(Iterator::next).collect())
        .collect();
    bands.into_par_iter().enumerate().for_each(|(b, mut out)| {
        dispatch!(Level::new(), simd => {
            mean_band::<_, K, N, C>(simd, input, radius, sums, b * band, &mut out);
        });
    });
    out
}

/// Solves the windows of a band of rows from `top` on, and sums their coefficients along rows.
#[inline(always)]
fn solve_band<S: Simd, const K: usize, const N: usize, const M: usize, const C: usize>(
    simd: S,
    input: &Input<'_>,
    radius: usize,
    ridge: Ridge<K>,
    top: usize,
    sums: &mut [Chunk<C>],
) {
    let mut columns = Columns::<K, N, M>::new(input, radius);
    columns.start(simd, top);
    let mut windows = Windows::<K, M, C>::new(input.width, radius, ridge);
    let chunks = input.width.div_ceil(EIGHT);
    for (i, sums) in sums.chunks_mut(chunks * ROWS).enumerate() {
        windows.rows::<S, N>(simd, top + i * ROWS, &mut columns, sums);
    }
}

/// Sums coefficients along columns for a band of rows from `top` on, and applies them.
#[inline(always)]
fn mean_band<S: Simd, const K: usize, const N: usize, const C: usize>(
    simd: S,
    input: &Input<'_>,
    radius: usize,
    sums: &[Chunk<C>],
    top: usize,
    out: &mut [&mut [f32]],
) {
    let (width, height) = (input.width, input.height);
    let chunks = width.div_ceil(EIGHT);
    let row = |y: usize| &sums[y * chunks..(y + 1) * chunks];
    let shares: Vec<[f32; EIGHT]> = (0..chunks)
        .map(|chunk| {
            std::array::from_fn(|i| 1.0 / covering(chunk * EIGHT + i, radius, width) as f32)
        })
        .collect();
    let mut columns = vec![[[0.0; EIGHT]; C]; chunks];
    let none = [[0.0; EIGHT]; C];
    for y in top.saturating_sub(radius + 1)..(top + radius).min(height) {
        for (column, enter) in columns.iter_mut().zip(row(y)) {
            move_down(simd, column, enter, &none);
        }
    }
    let rows = out.first().map_or(0, |plane| plane.len() / width);
    for y in top..top + rows {
        let enters = Some(y + radius).filter(|&y| y < height).map(row);
        let leaves = y.checked_sub(radius + 1).map(row);
        let share = 1.0 / covering(y, radius, height) as f32;
        for chunk in 0..chunks {
            let (mut enter, mut leave) = (&none, &none);
            if let Some(row) = enters {
                enter = &row[chunk];
            }
            if let Some(row) = leaves {
                leave = &row[chunk];
            }
            move_down(simd, &mut columns[chunk], enter, leave);
            let share = f32x8::load_array_ref(simd, &shares[chunk]) * share;
            let fits = fits::<S, K, N, C>(simd, input, y, chunk, &columns[chunk]);
            let from = (y - top) * width + chunk * EIGHT;
            let length = EIGHT.min(width - chunk * EIGHT);
            for n in 0..N {
                let fit: [f32; EIGHT] = *(fits[n] * share);
                let to = &mut out[n][from..from + length];
                match to.first_chunk_mut::<EIGHT>() {
                    Some(to) => *to = fit,
                    None => to.copy_from_slice(&fit[..length]),
                }
            }
        }
    }
}

/// Number of windows of a row of `length` pixels that cover pixel `x`.
fn covering(x: usize, radius: usize, length: usize) -> usize {
    (x + radius + 1).min(length).saturating_sub(x.saturating_sub(radius)).max(1)
}

/// Adds the row that enters to sums over columns, and subtracts the one that leaves.
#[inline(always)]
fn move_down<S: Simd, const C: usize>(
    simd: S,
    sums: &mut [[f64; EIGHT]; C],
    enter: &Chunk<C>,
    leave: &Chunk<C>,
) {
    for c in 0..C {
        let enter = simd.widen_f32x8(f32x8::load_array_ref(simd, &enter[c]));
        let leave = simd.widen_f32x8(f32x8::load_array_ref(simd, &leave[c]));
        let sum = f64x8::load_array_ref(simd, &sums[c]);
        let change = simd.combine_f64x4(enter.0 - leave.0, enter.1 - leave.1);
        sums[c] = *(sum + change);
    }
}

/// Sums of the fits of all windows that cover eight pixels of row `y`.
#[inline(always)]
fn fits<S: Simd, const K: usize, const N: usize, const C: usize>(
    simd: S,
    input: &Input<'_>,
    y: usize,
    chunk: usize,
    sums: &[[f64; EIGHT]; C],
) -> [f32x8<S>; N] {
    let mut guides = [simd.splat_f64x8(0.0); K];
    for k in 0..K {
        let row = &input.guides[k][y * input.width..(y + 1) * input.width];
        let (first, second) = simd.widen_f32x8(eight(simd, row, chunk * EIGHT));
        guides[k] = simd.combine_f64x4(first, second) - CENTRE;
    }
    let mut out = [simd.splat_f32x8(0.0); N];
    for n in 0..N {
        let own = n * (K + 1);
        let mut fit = f64x8::load_array_ref(simd, &sums[own + K]);
        for k in 0..K {
            fit += f64x8::load_array_ref(simd, &sums[own + k]) * guides[k];
        }
        let (first, second) = simd.split_f64x8(fit);
        out[n] = simd.narrow_f64x4(first, second);
    }
    out
}
