//! The Gaussian's weights inside its cutoff.

use glam::Vec4;

/// Least and greatest cutoff, standard deviations from the middle to where kernels end (zwicker2004, section
/// 4.4 and figure 5).
pub const CUTOFF: std::ops::RangeInclusive<f32> = 0.5..=2.0;

/// `exp(-t / 2)` for t from 0 to 2, by powers of t / 2, lowest first; relative error 2.5e-5.
const POWERS: [f32; 5] = [0.999_989_16, -0.999_456_3, 0.495_569_67, -0.153_750_47, 0.025_536_54];

/// `exp(-t)` for t from 0 to 2 (the half square of the greatest cutoff) to 5e-5 of itself: the square of a
/// polynomial. Without branches or tables, so that several pixels are done at once.
#[inline(always)]
pub fn falloff(t: Vec4) -> Vec4 {
    let [a, b, c, d, e] = POWERS;
    let s = t * 0.5;
    let root = s * (s * (s * (s * e + d) + c) + b) + a;
    root * root
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_the_exponential_within_the_greatest_cutoff() {
        for i in 0..=2000 {
            let t = f64::from(i) * 1e-3;
            let share = f64::from(falloff(Vec4::splat(t as f32)).x) * t.exp();
            assert!((share - 1.0).abs() < 5.1e-5, "{t}: {share}");
        }
    }
}
