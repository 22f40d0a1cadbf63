//! Sums of products over columns of windows: of the guides, the picture, and pairs of them, for
//! four rows at once. The sums of a row follow from those of the row above by the rows that enter
//! and leave the window. They are kept in 64 bits: products of two 32-bit floats are then exact,
//! and a firefly leaves nothing behind when its row leaves.

#![allow(clippy::needless_range_loop, reason = "indices go over several arrays of constant length")]

use super::input::Input;
use fearless_simd::{Simd, SimdBase, f32x4, f32x8, f64x4};

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

/// Sums of the moments of four columns or four rows, in memory: too many for registers.
pub(crate) type Sums<const M: usize> = [[f64; ROWS]; M];

/// Sums over columns, half a chunk (four columns) at a time.
pub(crate) struct Columns<'a, const K: usize, const N: usize, const M: usize> {
    input: &'a Input<'a>,
    radius: usize,
    sums: Vec<Sums<M>>,
    /// Sums of half a chunk, row by row.
    rows: [Sums<M>; ROWS],
}

/// Half a chunk of the guides and the picture in a row.
#[derive(Clone, Copy)]
struct Pixels<S: Simd, const K: usize, const N: usize> {
    mask: f64x4<S>,
    guides: [f64x4<S>; K],
    signals: [f64x4<S>; N],
}

impl<'a, const K: usize, const N: usize, const M: usize> Columns<'a, K, N, M> {
    const FITS: () = assert!(M == moment_count(K, N), "the number of moments follows from K and N");

    /// Sums of no row. `radius` is that of windows.
    pub fn new(input: &'a Input<'a>, radius: usize) -> Self {
        let () = Self::FITS;
        let none = [[0.0; ROWS]; M];
        let sums = vec![none; input.width.div_ceil(ROWS)];
        Self { input, radius, sums, rows: [none; ROWS] }
    }

    /// Adds the rows of the window around the row above `y`, so that [`Self::rows`] can go on from
    /// `y`.
    #[inline(always)]
    pub fn start<S: Simd>(&mut self, simd: S, y: usize) {
        let none = Pixels::<S, K, N>::none(simd);
        for half in 0..self.sums.len() {
            for row in y.saturating_sub(self.radius + 1)..(y + self.radius).min(self.input.height) {
                let enter = Pixels::new(simd, self.input, row, half);
                advance(simd, &mut self.sums[half], &mut self.rows[0], &enter, &none);
            }
        }
    }

    /// Moves four columns from `half * 4` on down over rows `y` to `y + 4`, and writes their sums
    /// to `columns` with rows as lanes. Columns beyond the picture are zero.
    #[inline(always)]
    pub fn rows<S: Simd>(&mut self, simd: S, y: usize, half: usize, columns: &mut [Sums<M>; ROWS]) {
        let none = Pixels::<S, K, N>::none(simd);
        for row in 0..ROWS {
            let (mut enter, mut leave) = (none, none);
            if y + row + self.radius < self.input.height {
                enter = Pixels::new(simd, self.input, y + row + self.radius, half);
            }
            if y + row > self.radius && y + row - self.radius <= self.input.height {
                leave = Pixels::new(simd, self.input, y + row - self.radius - 1, half);
            }
            advance(simd, &mut self.sums[half], &mut self.rows[row], &enter, &leave);
        }
        for m in 0..M {
            let [a, b, c, d] = &self.rows;
            let [a, b, c, d] = transpose(simd, [&a[m], &b[m], &c[m], &d[m]]);
            columns[0][m] = *a;
            columns[1][m] = *b;
            columns[2][m] = *c;
            columns[3][m] = *d;
        }
    }
}

impl<S: Simd, const K: usize, const N: usize> Pixels<S, K, N> {
    /// No pixel.
    #[inline(always)]
    fn none(simd: S) -> Self {
        let zero = simd.splat_f64x4(0.0);
        Self { mask: zero, guides: [zero; K], signals: [zero; N] }
    }

    /// Half a chunk of a row.
    #[inline(always)]
    fn new(simd: S, input: &Input<'_>, row: usize, half: usize) -> Self {
        let mut out = Self::none(simd);
        let row = row * input.width..(row + 1) * input.width;
        out.mask = four(simd, &input.mask[row.clone()], half);
        for k in 0..K {
            out.guides[k] = four(simd, &input.guides[k][row.clone()], half);
        }
        for n in 0..N {
            out.signals[n] = four(simd, &input.signals[n][row.clone()], half);
        }
        out
    }

    /// Luminance of linear light.
    #[inline(always)]
    fn luminance(&self) -> f64x4<S> {
        self.signals[0] * LUMINANCE[0]
            + self.signals[1] * LUMINANCE[1]
            + self.signals[2] * LUMINANCE[2]
    }
}

/// Adds the moments of the pixels that enter to sums, subtracts those of the pixels that leave, and
/// copies the sums to `copy`.
#[inline(always)]
fn advance<S: Simd, const K: usize, const N: usize, const M: usize>(
    simd: S,
    sums: &mut Sums<M>,
    copy: &mut Sums<M>,
    enter: &Pixels<S, K, N>,
    leave: &Pixels<S, K, N>,
) {
    add(simd, sums, copy, 0, enter.mask - leave.mask);
    let (entering, leaving) = (enter.luminance(), leave.luminance());
    add(simd, sums, copy, square(K, N), entering * entering - leaving * leaving);
    let mut pairs = pair(K, N);
    for i in 0..K {
        add(simd, sums, copy, GUIDE + i, enter.guides[i] - leave.guides[i]);
        for j in 0..=i {
            let entering = enter.guides[i] * enter.guides[j];
            add(simd, sums, copy, pairs, entering - leave.guides[i] * leave.guides[j]);
            pairs += 1;
        }
    }
    for n in 0..N {
        add(simd, sums, copy, signal(K) + n, enter.signals[n] - leave.signals[n]);
        for k in 0..K {
            let entering = enter.guides[k] * enter.signals[n];
            let change = entering - leave.guides[k] * leave.signals[n];
            add(simd, sums, copy, cross(K, N) + n * K + k, change);
        }
    }
}

/// Adds to moment `m`, and copies it.
#[inline(always)]
fn add<S: Simd, const M: usize>(
    simd: S,
    sums: &mut Sums<M>,
    copy: &mut Sums<M>,
    m: usize,
    change: f64x4<S>,
) {
    let sum = f64x4::load_array_ref(simd, &sums[m]) + change;
    sums[m] = *sum;
    copy[m] = *sum;
}

/// Four values of a row from `half * 4` on; zeros beyond its end.
#[inline(always)]
fn four<S: Simd>(simd: S, row: &[f32], half: usize) -> f64x4<S> {
    let four = match row.get(half * ROWS..).and_then(|rest| rest.first_chunk::<ROWS>()) {
        Some(four) => *four,
        None => {
            let rest = row.get(half * ROWS..).unwrap_or(&[]);
            let at = |i: usize| rest.get(i).copied().unwrap_or(0.0);
            [at(0), at(1), at(2), at(3)]
        }
    };
    let (low, high) = simd.widen_f32x4(f32x4::load_array(simd, four));
    simd.combine_f64x2(low, high)
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
pub(crate) fn transpose<S: Simd>(simd: S, rows: [&[f64; ROWS]; ROWS]) -> [f64x4<S>; ROWS] {
    let [a, b, c, d] = rows;
    let (a, b) = (f64x4::load_array_ref(simd, a), f64x4::load_array_ref(simd, b));
    let (c, d) = (f64x4::load_array_ref(simd, c), f64x4::load_array_ref(simd, d));
    let (ac_low, ac_high) = simd.interleave_f64x4(a, c);
    let (bd_low, bd_high) = simd.interleave_f64x4(b, d);
    let (first, second) = simd.interleave_f64x4(ac_low, bd_low);
    let (third, fourth) = simd.interleave_f64x4(ac_high, bd_high);
    [first, second, third, fourth]
}
