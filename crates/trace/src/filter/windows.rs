//! Sums along rows: the moments of windows from those of columns, their regression, and the sums
//! of the coefficients of the windows that cover a pixel. Four rows go together as lanes, so that
//! a sum that moves by a pixel takes one addition and one subtraction for four rows.

#![allow(clippy::needless_range_loop, reason = "indices go over several arrays of constant length")]

use super::moments::{Columns, EIGHT, ROWS, Sums, transpose};
use super::solve::{Ridge, solve};
use fearless_simd::{Simd, SimdBase, f64x4};

/// The sums of coefficients of eight pixels of a row.
pub(crate) type Chunk<const C: usize> = [[f32; EIGHT]; C];

/// Sums over the last values of a row, kept in a ring.
struct Sliding<const L: usize> {
    ring: Vec<Sums<L>>,
    sums: Sums<L>,
}

impl<const L: usize> Sliding<L> {
    /// Room for `length` values.
    fn new(length: usize) -> Self {
        let zero = [[0.0; ROWS]; L];
        Self { ring: vec![zero; length.next_power_of_two()], sums: zero }
    }

    /// Place of the value of pixel `x`.
    #[inline(always)]
    fn place(&mut self, x: usize) -> &mut Sums<L> {
        let last = self.ring.len() - 1;
        &mut self.ring[x & last]
    }

    /// Places of four values from pixel `x` on, which is a multiple of four.
    #[inline(always)]
    fn places(&mut self, x: usize) -> Option<&mut [Sums<L>; ROWS]> {
        let last = self.ring.len() - 1;
        self.ring.get_mut(x & last..).and_then(|rest| rest.first_chunk_mut())
    }

    /// Adds the value of pixel `enter`.
    #[inline(always)]
    fn enter<S: Simd>(&mut self, simd: S, enter: usize) {
        let enter = &self.ring[enter & (self.ring.len() - 1)];
        for l in 0..L {
            let sum = f64x4::load_array_ref(simd, &self.sums[l]);
            self.sums[l] = *(sum + f64x4::load_array_ref(simd, &enter[l]));
        }
    }

    /// Subtracts the value of pixel `leave`.
    #[inline(always)]
    fn leave<S: Simd>(&mut self, simd: S, leave: usize) {
        let leave = &self.ring[leave & (self.ring.len() - 1)];
        for l in 0..L {
            let sum = f64x4::load_array_ref(simd, &self.sums[l]);
            self.sums[l] = *(sum - f64x4::load_array_ref(simd, &leave[l]));
        }
    }

    /// Adds the value of pixel `enter` and subtracts that of `leave`.
    #[inline(always)]
    fn slide<S: Simd>(&mut self, simd: S, enter: usize, leave: usize) {
        let last = self.ring.len() - 1;
        let (enter, leave) = (&self.ring[enter & last], &self.ring[leave & last]);
        for l in 0..L {
            let sum = f64x4::load_array_ref(simd, &self.sums[l]);
            let enter = f64x4::load_array_ref(simd, &enter[l]);
            self.sums[l] = *(sum + (enter - f64x4::load_array_ref(simd, &leave[l])));
        }
    }

    /// Moves the sums from the window before that of pixel `x` to that window, given how many
    /// values are summed. Returns how many are summed then.
    #[inline(always)]
    fn advance<S: Simd>(
        &mut self,
        simd: S,
        x: usize,
        radius: usize,
        width: usize,
        summed: usize,
    ) -> usize {
        let end = (x + radius + 1).min(width);
        if summed + 1 == end && x > radius {
            self.slide(simd, summed, x - radius - 1);
            return end;
        }
        for x in summed..end {
            self.enter(simd, x);
        }
        if x > radius {
            self.leave(simd, x - radius - 1);
        }
        end
    }
}

/// Regression in the windows of four rows.
pub(crate) struct Windows<const K: usize, const M: usize, const C: usize> {
    width: usize,
    radius: usize,
    ridge: Ridge<K>,
    moments: Sliding<M>,
    coefficients: Sliding<C>,
    /// The last pixels of [`EIGHT`].
    last: [Sums<C>; EIGHT],
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
            last: [[[0.0; ROWS]; C]; EIGHT],
        }
    }

    /// Sums the coefficients along four rows from `y` on, and writes them to `out`, the chunks of
    /// at most four rows.
    #[inline(always)]
    pub fn rows<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        y: usize,
        columns: &mut Columns<'_, K, N, M>,
        out: &mut [Chunk<C>],
    ) {
        self.moments.sums = [[0.0; ROWS]; M];
        self.coefficients.sums = [[0.0; ROWS]; C];
        let (width, radius) = (self.width, self.radius);
        let (mut moments, mut coefficients) = (0, 0);
        let (mut solved, mut written) = (0, 0);
        for half in 0..width.div_ceil(ROWS) {
            if let Some(places) = self.moments.places(half * ROWS) {
                columns.rows(simd, y, half, places);
            }
            let stored = width.min((half + 1) * ROWS);
            while solved < width && (solved + radius + 1).min(width) <= stored {
                moments = self.moments.advance(simd, solved, radius, width, moments);
                let place = self.coefficients.place(solved);
                solve::<S, K, N, M, C>(simd, &self.moments.sums, &self.ridge, place);
                solved += 1;
                while written < width && (written + radius + 1).min(width) <= solved {
                    coefficients =
                        self.coefficients.advance(simd, written, radius, width, coefficients);
                    self.last[written % EIGHT] = self.coefficients.sums;
                    written += 1;
                    if written % EIGHT == 0 || written == width {
                        self.write(simd, written.div_ceil(EIGHT) - 1, out);
                    }
                }
            }
        }
    }

    /// Writes the last eight pixels to a chunk of each row.
    #[inline(always)]
    fn write<S: Simd>(&self, simd: S, chunk: usize, out: &mut [Chunk<C>]) {
        let chunks = self.width.div_ceil(EIGHT);
        let [p0, p1, p2, p3, p4, p5, p6, p7] = &self.last;
        for c in 0..C {
            let first = transpose(simd, [&p0[c], &p1[c], &p2[c], &p3[c]]);
            let second = transpose(simd, [&p4[c], &p5[c], &p6[c], &p7[c]]);
            for row in 0..ROWS {
                if let Some(out) = out.get_mut(row * chunks + chunk) {
                    out[c] = *simd.narrow_f64x4(first[row], second[row]);
                }
            }
        }
    }
}
