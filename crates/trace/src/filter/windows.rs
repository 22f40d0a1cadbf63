//! Sums along rows: the moments of windows from those of columns, their regression, and the sums
//! of the coefficients of the windows that cover a pixel. Four rows go together as lanes, so that
//! a sum that moves by a pixel takes one addition and one subtraction for four rows.

use super::moments::{Columns, EIGHT, Moments, ROWS, transpose};
use super::solve::{Ridge, solve};
use fearless_simd::{Simd, SimdBase, f64x4};

/// Sums over the last values of a row, kept in a ring.
struct Sliding<const L: usize> {
    ring: Vec<[[f64; ROWS]; L]>,
    sums: [[f64; ROWS]; L],
}

impl<const L: usize> Sliding<L> {
    /// Room for `length` values.
    fn new(length: usize) -> Self {
        let zero = [[0.0; ROWS]; L];
        Self { ring: vec![zero; length.next_power_of_two()], sums: zero }
    }

    /// Value of pixel `x`, which must be one of the last.
    #[inline(always)]
    fn value(&self, x: usize) -> &[[f64; ROWS]; L] {
        &self.ring[x & (self.ring.len() - 1)]
    }

    /// Stores a value. It is not summed yet.
    #[inline(always)]
    fn store<S: Simd>(&mut self, x: usize, value: &[f64x4<S>; L]) {
        let last = self.ring.len() - 1;
        for (to, from) in self.ring[x & last].iter_mut().zip(value) {
            *to = **from;
        }
    }

    /// Adds the value of pixel `enter` and subtracts that of `leave`; returns the sums.
    #[inline(always)]
    fn slide<S: Simd>(
        &mut self,
        simd: S,
        enter: Option<usize>,
        leave: Option<usize>,
    ) -> [f64x4<S>; L] {
        let last = self.ring.len() - 1;
        let mut out = [simd.splat_f64x4(0.0); L];
        for (sum, out) in self.sums.iter().zip(&mut out) {
            *out = f64x4::load_array_ref(simd, sum);
        }
        if let Some(x) = enter {
            for (out, value) in out.iter_mut().zip(&self.ring[x & last]) {
                *out = *out + f64x4::load_array_ref(simd, value);
            }
        }
        if let Some(x) = leave {
            for (out, value) in out.iter_mut().zip(&self.ring[x & last]) {
                *out = *out - f64x4::load_array_ref(simd, value);
            }
        }
        for (sum, out) in self.sums.iter_mut().zip(&out) {
            *sum = **out;
        }
        out
    }
}

/// Regression in the windows of four rows.
pub(crate) struct Windows<const K: usize, const M: usize, const C: usize> {
    width: usize,
    radius: usize,
    ridge: Ridge<K>,
    moments: Sliding<M>,
    coefficients: Sliding<C>,
    /// Columns that are stored, columns that are summed, windows that are solved, pixels written.
    stored: usize,
    summed: usize,
    solved: usize,
    written: usize,
    /// The last pixels of [`EIGHT`].
    last: [[[f64; ROWS]; C]; EIGHT],
}

impl<const K: usize, const M: usize, const C: usize> Windows<K, M, C> {
    /// For rows of `width` pixels.
    pub fn new(width: usize, radius: usize, ridge: Ridge<K>) -> Self {
        let reach = 2 * radius + 2 * EIGHT;
        Self {
            width,
            radius,
            ridge,
            moments: Sliding::new(reach),
            coefficients: Sliding::new(reach),
            stored: 0,
            summed: 0,
            solved: 0,
            written: 0,
            last: [[[0.0; ROWS]; C]; EIGHT],
        }
    }

    /// Sums the coefficients along four rows from `y` on. `write` takes the number of the chunk, and
    /// the sums of eight pixels for each row.
    #[inline(always)]
    pub fn rows<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        y: usize,
        columns: &mut Columns<'_, K, N, M>,
        mut write: impl FnMut(usize, &[[[f32; EIGHT]; C]; ROWS]),
    ) {
        self.moments.sums = [[0.0; ROWS]; M];
        self.coefficients.sums = [[0.0; ROWS]; C];
        (self.stored, self.summed, self.solved, self.written) = (0, 0, 0, 0);
        for chunk in 0..self.width.div_ceil(EIGHT) {
            columns.rows(simd, y, chunk, |x, column| self.moments.store(x, column));
            self.stored = self.width.min((chunk + 1) * EIGHT);
            while self.solved < self.width && self.end(self.solved) <= self.stored {
                let sums = self.next_window(simd);
                self.solve_next::<S, N>(simd, &sums);
                while self.written < self.width && self.end(self.written) <= self.solved {
                    self.write_next(simd, &mut write);
                }
            }
        }
    }

    /// End of the window around pixel `x`.
    #[inline(always)]
    fn end(&self, x: usize) -> usize {
        (x + self.radius + 1).min(self.width)
    }

    /// Moments of the next window.
    #[inline(always)]
    fn next_window<S: Simd>(&mut self, simd: S) -> Moments<S, M> {
        let end = self.end(self.solved);
        while self.summed + 1 < end {
            self.moments.slide(simd, Some(self.summed), None);
            self.summed += 1;
        }
        let enter = (self.summed < end).then_some(self.summed);
        self.summed = end;
        self.moments.slide(simd, enter, self.solved.checked_sub(self.radius + 1))
    }

    /// Solves the next window.
    #[inline(always)]
    fn solve_next<S: Simd, const N: usize>(&mut self, simd: S, sums: &Moments<S, M>) {
        let coefficients = solve::<S, K, N, M, C>(simd, sums, &self.ridge);
        self.coefficients.store(self.solved, &coefficients);
        self.solved += 1;
        // The sums of a pixel need all windows up to its end.
        if self.solved < self.end(self.written) {
            self.coefficients.slide(simd, Some(self.solved - 1), None);
        }
    }

    /// Sums the coefficients of the windows that cover the next pixel.
    #[inline(always)]
    fn write_next<S: Simd>(
        &mut self,
        simd: S,
        write: &mut impl FnMut(usize, &[[[f32; EIGHT]; C]; ROWS]),
    ) {
        let x = self.written;
        // At the end of the row windows only leave.
        let is_new = x == 0 || self.end(x) > self.end(x - 1);
        let enter = is_new.then(|| self.end(x) - 1);
        let sums = self.coefficients.slide(simd, enter, x.checked_sub(self.radius + 1));
        for (to, from) in self.last[x % EIGHT].iter_mut().zip(&sums) {
            *to = **from;
        }
        self.written += 1;
        if self.written % EIGHT == 0 || self.written == self.width {
            write(x / EIGHT, &self.turned(simd));
        }
    }

    /// The last eight pixels, row by row.
    #[inline(always)]
    fn turned<S: Simd>(&self, simd: S) -> [[[f32; EIGHT]; C]; ROWS] {
        let mut out = [[[0.0; EIGHT]; C]; ROWS];
        for c in 0..C {
            let four = |from: usize| {
                let at = |i: usize| f64x4::load_array_ref(simd, &self.last[from + i][c]);
                transpose([at(0), at(1), at(2), at(3)])
            };
            let (first, second) = (four(0), four(ROWS));
            for ((row, first), second) in out.iter_mut().zip(first).zip(second) {
                row[c] = *simd.narrow_f64x4(first, second);
            }
        }
        out
    }
}
