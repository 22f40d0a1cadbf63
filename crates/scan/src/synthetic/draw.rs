//! Random numbers, angles and noise that are the same on every machine. Only integer arithmetic and
//! operations that IEEE 754 rounds exactly (`+ - * /`, `sqrt`, comparisons, conversions) may decide
//! the position of a point: the standard library's `sin`, `exp` and `powf` differ between
//! platforms, and `mul_add` is slow without a machine instruction.

use std::f64::consts::TAU;

/// Mixes all bits of a number: the finaliser of SplitMix64 (Steele, Lea and Flood 2014).
pub fn mix(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A stream of random numbers (SplitMix64).
#[derive(Clone, Debug)]
pub struct Draw(u64);

impl Draw {
    /// The stream of the `index`-th object of a kind.
    pub fn new(seed: u64, kind: u64, index: u64) -> Self {
        let kind = mix(seed ^ kind.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        Self(mix(kind ^ index.wrapping_mul(0xd1b5_4a32_d192_ed03)))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        unit(self.bits())
    }

    /// Uniform in [`low`, `high`).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Whether an event of this probability happens.
    pub fn happens(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// One of `n` choices.
    pub fn choice(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// Nearly normal, of mean 0 and standard deviation 1: the sum of four uniform numbers.
    pub fn bell(&mut self) -> f64 {
        let bits = self.bits();
        let sum: u64 = (0..4).map(|i| (bits >> (16 * i)) & 0xffff).sum();
        // The variance of four numbers of 0 to 65535 is (2^32 - 1) / 3.
        (sum as f64 - 131_070.0) * (1.0 / 37_837.227)
    }

    /// Three numbers of mean 0 and standard deviation 1 from one draw, each the sum of two uniform
    /// numbers.
    pub fn triple(&mut self) -> [f64; 3] {
        let bits = self.bits();
        let sum = |at: u32| ((bits >> at) & 0x3ff) + ((bits >> (at + 10)) & 0x3ff);
        // The variance of two numbers of 0 to 1023 is (2^20 - 1) / 6.
        [0, 20, 40].map(|at| (sum(at) as f64 - 1023.0) * (1.0 / 418.046_648))
    }
}

/// The upper 53 bits as a number in [0, 1).
pub fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// The greatest whole number that is not above `x`.
pub fn floor(x: f64) -> i64 {
    let whole = x as i64;
    if (whole as f64) > x { whole.saturating_sub(1) } else { whole }
}

/// `x` modulo `period`, not negative.
pub fn beyond(x: f64, period: f64) -> f64 {
    x - floor(x / period) as f64 * period
}

/// Cosine and sine of an angle in turns, to 2e-10: Taylor polynomials within an eighth of a turn.
pub fn cos_sin(turns: f64) -> [f64; 2] {
    let quarter = floor(turns * 4.0 + 0.5);
    let x = (turns - quarter as f64 * 0.25) * TAU;
    let q = x * x;
    let s = x
        * (1.0
            - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0)))));
    let c =
        1.0 - q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))));
    match quarter & 3 {
        0 => [c, s],
        1 => [-s, c],
        2 => [-c, -s],
        _ => [s, -c],
    }
}

/// A hash of a point of the integer plane.
pub fn at(seed: u64, x: i64, y: i64) -> u64 {
    let x = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let y = (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    mix(seed ^ x ^ y.rotate_left(32))
}

/// Smooth noise of -1 to 1 over the plane, of wavelength about 2: hashes at integer points,
/// blended.
pub fn noise(seed: u64, x: f64, y: f64) -> f64 {
    let (i, j) = (floor(x), floor(y));
    let (u, v) = (smooth(x - i as f64), smooth(y - j as f64));
    let corner = |di, dj| (at(seed, i + di, j + dj) >> 32) as f64;
    let low = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * u;
    let high = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * u;
    (low + (high - low) * v) * (2.0 / 4_294_967_295.0) - 1.0
}

/// Rises from 0 at 0 to 1 at 1, with slope 0 at both; constant outside.
pub fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_follow_the_circle() {
        for i in -1000..1000 {
            let turns = f64::from(i) / 333.0;
            let [c, s] = cos_sin(turns);
            assert!((c - (turns * TAU).cos()).abs() < 2e-10, "{turns}");
            assert!((s - (turns * TAU).sin()).abs() < 2e-10, "{turns}");
        }
    }

    #[test]
    fn draws_have_the_spread_that_they_claim() {
        let mut draw = Draw::new(1, 2, 3);
        let n = 100_000;
        let (mut mean, mut square, mut half) = (0.0, 0.0, 0.0);
        let mut triples = [0.0; 3];
        for _ in 0..n {
            let b = draw.bell();
            (mean, square, half) = (mean + b, square + b * b, half + draw.unit());
            let triple = draw.triple();
            triples = [0, 1, 2].map(|i| triples[i] + triple[i] * triple[i]);
        }
        let n = f64::from(n);
        assert!((mean / n).abs() < 0.02, "{mean}");
        assert!((square / n - 1.0).abs() < 0.02, "{square}");
        assert!(triples.iter().all(|t| (t / n - 1.0).abs() < 0.02), "{triples:?}");
        assert!((half / n - 0.5).abs() < 0.01, "{half}");
    }

    #[test]
    fn noise_is_bounded_and_has_no_steps() {
        for i in -500..500 {
            let x = f64::from(i) * 0.01;
            let here = noise(7, x, 3.3);
            assert!((-1.0..=1.0).contains(&here));
            assert!((noise(7, x + 1e-6, 3.3) - here).abs() < 1e-5);
        }
    }
}
