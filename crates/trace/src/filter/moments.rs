//! Sums of products over columns of windows: of the guides, the picture, and pairs of them, for
//! four rows at once. The sums of a row follow from those of the row above by the rows that enter
//! and leave the window. They are kept in 64 bits: products of two 32-bit floats are then exact,
//! and a firefly leaves nothing behind when its row leaves.

use super::input::Input;
use fearless_simd::{Simd, SimdBase, f32x8, f64x4};

/// Pixels of a row that are summed together.
pub(crate) const EIGHT: usize = 8;
/// Rows that are summed together. They are the lanes of the sums along rows.
pub(crate) const ROWS: usize = 4;
/// Luminance of linear light (Rec. 709).
pub(crate) const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Number of moments for `k` guides and `n` signals: count, guides, signals, squared luminance,
/// pairs of guides, guides times signals.
pub(crate) const fn moment_count(k: usize, n: usize) -> usize {
    1 + k + n + 1 + k * (k + 1) / 2 + k * n
}

/// Index of the first guide.
pub(crate) const GUIDE: usize = 1;
/// Index of the first signal.
pub(crate) const fn signal(k: usize) -> usize {
    GUIDE + k
}
/// Index of the squared luminance.
pub(crate) const fn square(k: usize, n: usize) -> usize {
    signal(k) + n
}
/// Index of the first pair of guides. Pairs (i, j) with j at most i follow row by row.
pub(crate) const fn pair(k: usize, n: usize) -> usize {
    square(k, n) + 1
}
/// Index of the first guide times a signal. Guides of the first signal come first.
pub(crate) const fn cross(k: usize, n: usize) -> usize {
    pair(k, n) + k * (k + 1) / 2
}

/// Moments of four columns, or of four rows.
pub(crate) type Moments<S, const M: usize> = [f64x4<S>; M];

/// Sums over columns, eight columns a chunk.
pub(crate) struct Columns<'a, const K: usize, const N: usize, const M: usize> {
    input: &'a Input<'a>,
    radius: usize,
    sums: Vec<[[f64; EIGHT]; M]>,
}

impl<'a, const K: usize, const N: usize, const M: usize> Columns<'a, K, N, M> {
    const FITS: () = assert!(M == moment_count(K, N), "the number of moments follows from K and N");

    /// Sums of no row. `radius` is that of windows.
    pub fn new(input: &'a Input<'a>, radius: usize) -> Self {
        let () = Self::FITS;
        Self { input, radius, sums: vec![[[0.0; EIGHT]; M]; input.width.div_ceil(EIGHT)] }
    }

    /// Adds the rows of the window around row `y` but its last one, so that [`Self::rows`] can go
    /// on from `y`.
    #[inline(always)]
    pub fn start<S: Simd>(&mut self, simd: S, y: usize) {
        let rows = y.saturating_sub(self.radius)..(y + self.radius).min(self.input.height);
        for chunk in 0..self.sums.len() {
            for row in rows.clone() {
                for half in 0..2 {
                    let enter = self.products(simd, chunk, Some(row), half);
                    for (sum, enter) in self.sums[chunk].iter_mut().zip(enter) {
                        add(simd, half_of(sum, half), enter);
                    }
                }
            }
        }
    }

    /// Moves a chunk down over rows `y` to `y + 4`, and writes the sums of its columns with rows as
    /// lanes. Columns beyond the picture are zero.
    #[inline(always)]
    pub fn rows<S: Simd>(
        &mut self,
        simd: S,
        y: usize,
        chunk: usize,
        mut write: impl FnMut(usize, &Moments<S, M>),
    ) {
        for half in 0..2 {
            let zero = simd.splat_f64x4(0.0);
            let mut rows = [[zero; M]; ROWS];
            for (j, out) in rows.iter_mut().enumerate() {
                let row = y + j;
                let enters = Some(row + self.radius).filter(|&row| row < self.input.height);
                let enter = self.products(simd, chunk, enters, half);
                let leave = self.products(simd, chunk, row.checked_sub(self.radius + 1), half);
                for (m, sum) in self.sums[chunk].iter_mut().enumerate() {
                    out[m] = add(simd, half_of(sum, half), enter[m] - leave[m]);
                }
            }
            let mut columns = [[zero; M]; ROWS];
            for m in 0..M {
                let turned = transpose(rows.map(|row| row[m]));
                for (column, turned) in columns.iter_mut().zip(turned) {
                    column[m] = turned;
                }
            }
            for (i, column) in columns.iter().enumerate() {
                write(chunk * EIGHT + half * ROWS + i, column);
            }
        }
    }

    /// Products of half a chunk in a row; zeros for no row.
    #[inline(always)]
    fn products<S: Simd>(
        &self,
        simd: S,
        chunk: usize,
        row: Option<usize>,
        half: usize,
    ) -> Moments<S, M> {
        let zero = simd.splat_f64x4(0.0);
        let mut out = [zero; M];
        let Some(row) = row.filter(|&row| row < self.input.height) else { return out };
        let value = |plane: &[f32]| four(simd, plane, self.input.width, row, chunk, half);
        let mut guides = [zero; K];
        for (guide, plane) in guides.iter_mut().zip(&self.input.guides) {
            *guide = value(plane);
        }
        let mut signals = [zero; N];
        for (signal, plane) in signals.iter_mut().zip(&self.input.signals) {
            *signal = value(plane);
        }
        out[0] = value(&self.input.mask);
        let mut luminance = zero;
        for (signal, weight) in signals.iter().zip(LUMINANCE) {
            luminance = luminance + *signal * weight;
        }
        out[square(K, N)] = luminance * luminance;
        let mut pairs = pair(K, N);
        for i in 0..K {
            out[GUIDE + i] = guides[i];
            for j in 0..=i {
                out[pairs] = guides[i] * guides[j];
                pairs += 1;
            }
        }
        for n in 0..N {
            out[signal(K) + n] = signals[n];
            for k in 0..K {
                out[cross(K, N) + n * K + k] = guides[k] * signals[n];
            }
        }
        out
    }
}

/// Adds to a sum, and returns it.
#[inline(always)]
fn add<S: Simd>(simd: S, sum: &mut [f64; ROWS], value: f64x4<S>) -> f64x4<S> {
    let total = f64x4::load_array_ref(simd, sum) + value;
    *sum = *total;
    total
}

/// First or second half of a chunk.
#[inline(always)]
fn half_of(sum: &mut [f64; EIGHT], half: usize) -> &mut [f64; ROWS] {
    let (first, second) = sum.split_at_mut(ROWS);
    let half = if half == 0 { first } else { second };
    half.first_chunk_mut().expect("a chunk has two halves of four")
}

/// Half a chunk of a row of a plane; zeros beyond its end.
#[inline(always)]
fn four<S: Simd>(
    simd: S,
    plane: &[f32],
    width: usize,
    row: usize,
    chunk: usize,
    half: usize,
) -> f64x4<S> {
    let eight = eight(simd, &plane[row * width..(row + 1) * width], chunk * EIGHT);
    let (first, second) = simd.widen_f32x8(eight);
    if half == 0 { first } else { second }
}

/// Eight values of a row from `x` on; zeros beyond its end.
#[inline(always)]
pub(crate) fn eight<S: Simd>(simd: S, row: &[f32], x: usize) -> f32x8<S> {
    match row.get(x..).and_then(|rest| rest.first_chunk::<EIGHT>()) {
        Some(eight) => f32x8::load_array_ref(simd, eight),
        None => {
            let mut eight = [0.0; EIGHT];
            let rest = row.get(x..).unwrap_or(&[]);
            eight[..rest.len()].copy_from_slice(rest);
            f32x8::load_array_ref(simd, &eight)
        }
    }
}

/// Transposes four rows of four.
#[inline(always)]
pub(crate) fn transpose<S: Simd>([a, b, c, d]: [f64x4<S>; ROWS]) -> [f64x4<S>; ROWS] {
    let (ac_low, ac_high) = a.interleave(c);
    let (bd_low, bd_high) = b.interleave(d);
    let (first, second) = ac_low.interleave(bd_low);
    let (third, fourth) = ac_high.interleave(bd_high);
    [first, second, third, fourth]
}
