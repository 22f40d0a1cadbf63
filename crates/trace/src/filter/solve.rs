//! Linear regression of the picture on the guides in a window (`bauszat2011`, equations 7 to 9;
//! `he2010`), for the windows of four rows at once: a ridge is added to the covariance of the
//! guides, which is factored as L D L^T.

#![allow(clippy::needless_range_loop, reason = "indices go over several arrays of constant length")]

use super::moments::{GUIDE, LUMINANCE, Sums, cross, pair, signal, square};
use fearless_simd::{Select, Simd, SimdBase, f64x4};

/// Least epsilon. The covariance of guides of the order of one is exact to some 1e-15 in 64 bits,
/// hence a window with constant guides still has a positive matrix.
const EPSILON_MIN: f64 = 1e-10;
/// Greatest share of noise in the mean of a window: the guides then count for nothing.
const NOISE_MAX: f64 = 1e6;

/// Guides are counted from here: in the middle of their range, the fits of a pixel cancel least
/// when they are summed in 32 bits.
pub(crate) const CENTRE: f64 = 0.5;

/// What is added to the variance of the guides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ridge<const K: usize> {
    /// Epsilon of each guide.
    pub epsilon: [f64; K],
    /// Epsilon of each guide for a window whose mean has a variance of its own square.
    pub noise: [f64; K],
}

/// Writes the coefficients of the windows of four rows: of each signal, those of the guides, then
/// the constant. Windows without a pixel have zeros.
#[inline(always)]
pub(crate) fn solve<S: Simd, const K: usize, const N: usize, const M: usize, const C: usize>(
    simd: S,
    sums: &Sums<M>,
    ridge: &Ridge<K>,
    out: &mut Sums<C>,
) {
    const { assert!(C == (K + 1) * N, "a coefficient for each guide, and a constant") };
    let zero = simd.splat_f64x4(0.0);
    let sum = |m: usize| f64x4::load_array_ref(simd, &sums[m]);
    let count = sum(0);
    // The count is a sum of ones, hence exact.
    let share = count.simd_gt(zero).select(1.0 / count, zero);
    let (mut guides, mut values) = ([zero; K], [zero; N]);
    for k in 0..K {
        guides[k] = sum(GUIDE + k) * share;
    }
    for n in 0..N {
        values[n] = sum(signal(K) + n) * share;
    }
    let luminance = values[0] * LUMINANCE[0] + values[1] * LUMINANCE[1] + values[2] * LUMINANCE[2];
    let noise = noise(zero, luminance, sum(square(K, N)) * share, share);
    let mut epsilon = [zero; K];
    for k in 0..K {
        epsilon[k] = noise * ridge.noise[k] + ridge.epsilon[k].max(EPSILON_MIN);
    }
    let mut covariance = [[zero; K]; K];
    for i in 0..K {
        for j in 0..=i {
            let both = sum(pair(K, N) + i * (i + 1) / 2 + j) * share;
            covariance[i][j] = both - guides[i] * guides[j];
        }
    }
    let factors = Factors::new(zero, &covariance, &epsilon);
    for n in 0..N {
        let mut slopes = [zero; K];
        for k in 0..K {
            slopes[k] = sum(cross(K, N) + n * K + k) * share - guides[k] * values[n];
        }
        factors.solve(&mut slopes);
        let mut constant = values[n];
        for k in 0..K {
            constant -= slopes[k] * (guides[k] - CENTRE);
            out[n * (K + 1) + k] = *slopes[k];
        }
        out[n * (K + 1) + K] = *constant;
    }
}

/// Variance of the mean luminance over its square. `share` is one over the number of pixels.
#[inline(always)]
fn noise<S: Simd>(
    zero: f64x4<S>,
    luminance: f64x4<S>,
    squares: f64x4<S>,
    share: f64x4<S>,
) -> f64x4<S> {
    let square_of_mean = luminance * luminance;
    let variance = (squares - square_of_mean) * share;
    // A black window has neither noise nor light.
    let variance = variance.min(square_of_mean * NOISE_MAX).max(zero);
    variance / square_of_mean.max(zero + f64::MIN_POSITIVE)
}

/// A covariance as L D L^T.
struct Factors<S: Simd, const K: usize> {
    /// L below its diagonal of ones.
    lower: [[f64x4<S>; K]; K],
    /// Reciprocals of D.
    inverse: [f64x4<S>; K],
}

impl<S: Simd, const K: usize> Factors<S, K> {
    /// Factors a covariance, of which the lower triangle is read, with epsilon on the diagonal.
    #[inline(always)]
    fn new(zero: f64x4<S>, covariance: &[[f64x4<S>; K]; K], epsilon: &[f64x4<S>; K]) -> Self {
        let (mut lower, mut inverse) = ([[zero; K]; K], [zero; K]);
        for i in 0..K {
            // Row i of L D.
            let mut scaled = [zero; K];
            for j in 0..i {
                let mut value = covariance[i][j];
                for p in 0..j {
                    value -= scaled[p] * lower[j][p];
                }
                scaled[j] = value;
                lower[i][j] = value * inverse[j];
            }
            let mut pivot = covariance[i][i].max(zero) + epsilon[i];
            for p in 0..i {
                pivot -= scaled[p] * lower[i][p];
            }
            // Rounding must not make a pivot less than its ridge.
            inverse[i] = 1.0 / pivot.max(epsilon[i]);
        }
        Self { lower, inverse }
    }

    /// Replaces a right side by the solution.
    #[inline(always)]
    fn solve(&self, x: &mut [f64x4<S>; K]) {
        for i in 0..K {
            for j in 0..i {
                x[i] -= self.lower[i][j] * x[j];
            }
        }
        for i in 0..K {
            // From the last one up; `rev` is not always unrolled.
            let i = K - 1 - i;
            x[i] *= self.inverse[i];
            for j in i + 1..K {
                x[i] -= self.lower[j][i] * x[j];
            }
        }
    }
}
