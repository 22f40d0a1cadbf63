//! Linear regression of the picture on the guides in a window (`bauszat2011`, equations 7 to 9;
//! `he2010`), for the windows of four rows at once: a ridge is added to the covariance of the
//! guides, which is factored as L D L^T.

use super::moments::{GUIDE, LUMINANCE, Moments, cross, pair, signal, square};
use fearless_simd::{Select, Simd, SimdBase, f64x4};

/// Least epsilon. The covariance of guides of the order of one is exact to some 1e-15 in 64 bits,
/// hence a window with constant guides still has a positive matrix.
const EPSILON_MIN: f64 = 1e-10;
/// Greatest share of noise in the mean of a window: the guides then count for nothing.
const NOISE_MAX: f64 = 1e6;

/// What is added to the variance of the guides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ridge<const K: usize> {
    /// Epsilon of each guide.
    pub epsilon: [f64; K],
    /// Epsilon of each guide for a window whose mean has a variance of its own square.
    pub noise: [f64; K],
}

/// Coefficients of the windows of four rows: of each signal, those of the guides, then the
/// constant. Windows without a pixel have zeros.
#[inline(always)]
pub(crate) fn solve<S: Simd, const K: usize, const N: usize, const M: usize, const C: usize>(
    simd: S,
    sums: &Moments<S, M>,
    ridge: &Ridge<K>,
) -> [f64x4<S>; C] {
    const { assert!(C == (K + 1) * N, "a coefficient for each guide, and a constant") };
    let zero = simd.splat_f64x4(0.0);
    let count = sums[0];
    // The count is a sum of ones, hence exact.
    let share = count.simd_gt(zero).select(zero + 1.0 / count, zero);
    let means: [f64x4<S>; M] = each(zero, |m| sums[m] * share);
    let epsilon = epsilons::<S, K, N, M>(simd, &means, share, ridge);
    let factors = factor::<S, K, N, M>(simd, &means, &epsilon);
    let mut out = [zero; C];
    for n in 0..N {
        let value = means[signal(K) + n];
        let cov: [f64x4<S>; K] =
            each(zero, |k| means[cross(K, N) + n * K + k] - means[GUIDE + k] * value);
        let slopes = factors.solve(zero, cov);
        let mut constant = value;
        for k in 0..K {
            constant = constant - slopes[k] * means[GUIDE + k];
            out[n * (K + 1) + k] = slopes[k];
        }
        out[n * (K + 1) + K] = constant;
    }
    out
}

/// Epsilon of each guide in these windows.
#[inline(always)]
fn epsilons<S: Simd, const K: usize, const N: usize, const M: usize>(
    simd: S,
    means: &[f64x4<S>; M],
    share: f64x4<S>,
    ridge: &Ridge<K>,
) -> [f64x4<S>; K] {
    let zero = simd.splat_f64x4(0.0);
    let mut luminance = zero;
    for (n, weight) in LUMINANCE.into_iter().enumerate() {
        luminance = luminance + means[signal(K) + n] * weight;
    }
    let square_of_mean = luminance * luminance;
    let variance = means[square(K, N)] - square_of_mean;
    // A black window has neither noise nor light.
    let bound = square_of_mean * NOISE_MAX;
    let noise = (variance * share).min(bound).max(zero) / square_of_mean.max(zero + f64::MIN_POSITIVE);
    each(zero, |k| noise * ridge.noise[k] + ridge.epsilon[k].max(EPSILON_MIN))
}

/// A covariance as L D L^T.
struct Factors<S: Simd, const K: usize> {
    /// L below its diagonal of ones.
    lower: [[f64x4<S>; K]; K],
    /// Reciprocals of D.
    inverse: [f64x4<S>; K],
}

/// Factors the covariance of the guides with epsilon on the diagonal.
#[inline(always)]
fn factor<S: Simd, const K: usize, const N: usize, const M: usize>(
    simd: S,
    means: &[f64x4<S>; M],
    epsilon: &[f64x4<S>; K],
) -> Factors<S, K> {
    let zero = simd.splat_f64x4(0.0);
    let (mut lower, mut inverse) = ([[zero; K]; K], [zero; K]);
    for i in 0..K {
        // Row i of L D, then of L.
        let mut scaled = [zero; K];
        for j in 0..=i {
            let both = means[pair(K, N) + i * (i + 1) / 2 + j];
            let mut value = both - means[GUIDE + i] * means[GUIDE + j];
            if i == j {
                value = value.max(zero) + epsilon[i];
            }
            for p in 0..j {
                value = value - scaled[p] * lower[j][p];
            }
            if j < i {
                scaled[j] = value;
                lower[i][j] = value * inverse[j];
            } else {
                // Rounding must not make a pivot less than its ridge.
                inverse[i] = 1.0 / value.max(epsilon[i]);
            }
        }
    }
    Factors { lower, inverse }
}

impl<S: Simd, const K: usize> Factors<S, K> {
    /// Solution for a right side.
    #[inline(always)]
    fn solve(&self, zero: f64x4<S>, right: [f64x4<S>; K]) -> [f64x4<S>; K] {
        let mut x = [zero; K];
        for i in 0..K {
            let mut value = right[i];
            for j in 0..i {
                value = value - self.lower[i][j] * x[j];
            }
            x[i] = value;
        }
        for i in (0..K).rev() {
            let mut value = x[i] * self.inverse[i];
            for j in i + 1..K {
                value = value - self.lower[j][i] * x[j];
            }
            x[i] = value;
        }
        x
    }
}

/// An array of registers. Not by `array::from_fn`, which is not always inlined.
#[inline(always)]
fn each<S: Simd, const L: usize>(
    zero: f64x4<S>,
    value: impl Fn(usize) -> f64x4<S>,
) -> [f64x4<S>; L] {
    let mut out = [zero; L];
    for (i, out) in out.iter_mut().enumerate() {
        *out = value(i);
    }
    out
}
