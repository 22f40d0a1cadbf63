//! Weights of the Gaussian inside its cutoff (`zwicker2004`, section 4.4), by a polynomial.

use crate::simd::values::Values;

/// Least and greatest cutoff, standard deviations from the centre of a kernel to its end
/// (`zwicker2004`, section 4.4 and figure 5).
pub const CUTOFF: std::ops::RangeInclusive<f32> = 0.5..=2.0;

/// Coefficients of `exp(-t / 2)` for t from 0 to 2 in powers of t / 2, lowest first; relative error
/// 2.5e-5.
const POWERS: [f32; 5] = [0.999_989_16, -0.999_456_3, 0.495_569_67, -0.153_750_47, 0.025_536_54];

/// Weights from the centre of a kernel to its end: `exp(-c t)` for t from 0 to 1, with a relative
/// error of 5e-5, where `c` is half the square of the cutoff and at most 2. Computed as the square
/// of a polynomial, without branches or tables, for several pixels at once.
#[derive(Clone, Copy, Debug)]
pub struct Falloff([f32; 5]);

impl Falloff {
    /// Weights for a cutoff, in standard deviations.
    pub fn new(cutoff: f32) -> Self {
        let half = 0.25 * cutoff * cutoff;
        let mut scale = 1.0;
        Self(POWERS.map(|power| {
            let scaled = power * scale;
            scale *= half;
            scaled
        }))
    }

    /// Weights at squared distances from the centre, 1 at the cutoff.
    #[inline(always)]
    pub fn of<V: Values>(&self, squared: V) -> V {
        let [a, b, c, d, e] = self.0.map(
            #[inline(always)]
            |power| squared.like(power),
        );
        let root = squared.mul_add(e, d);
        let root = squared.mul_add(root, c);
        let root = squared.mul_add(root, b);
        let root = squared.mul_add(root, a);
        root * root
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec4;

    #[test]
    fn weights_are_the_exponential_within_the_greatest_cutoff() {
        for cutoff in [*CUTOFF.start(), 1.5, *CUTOFF.end()] {
            let falloff = Falloff::new(cutoff);
            for i in 0..=2000 {
                let t = f64::from(i) * 5e-4;
                let weight = f64::from(falloff.of(Vec4::splat(t as f32)).x);
                let share = weight * (0.5 * f64::from(cutoff * cutoff) * t).exp();
                assert!((share - 1.0).abs() < 5.1e-5, "{cutoff} {t}: {share}");
            }
        }
    }
}
