//! Directions about a normal: cosine-weighted ones and their frame. In: pairs in [0, 1). Out: unit
//! vectors.

use glam::Vec3;
use std::f32::consts::{FRAC_PI_4, PI};

/// Two unit vectors that form a right-handed orthonormal frame with a unit normal.
/// Without a branch on the direction (`duff2017`).
pub(crate) fn frame(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// Point of the unit disc by the concentric map, which keeps the strata of the square together
/// (Shirley and Chiu 1997).
pub(crate) fn disc(u: [f32; 2]) -> [f32; 2] {
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    if a.abs() > b.abs() {
        let (sin, cos) = sin_cos(FRAC_PI_4 * (b / a));
        [a * cos, a * sin]
    } else {
        let (sin, cos) = sin_cos(FRAC_PI_4 * (a / b));
        [b * sin, b * cos]
    }
}

/// Direction about a unit normal with the density cosine over pi.
pub(crate) fn cosine(normal: Vec3, u: [f32; 2]) -> Vec3 {
    let [x, y] = disc(u);
    let (t, b) = frame(normal);
    let z = (1.0 - x * x - y * y).max(0.0).sqrt();
    (t * x + b * y + normal * z).normalize_or(normal)
}

/// Sine and cosine for angles within a quarter of pi, by Taylor polynomials: their error is below
/// that of `f32`, and they are far faster than the library's.
fn sin_cos(x: f32) -> (f32, f32) {
    debug_assert!(x.abs() <= PI * 0.2501);
    let s = x * x;
    let sin =
        x * (1.0 + s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s / 362_880.0))));
    let cos = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s / 40_320.0)));
    (sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosine_directions_have_the_moments_of_their_density() {
        let normal = Vec3::new(-0.3, 0.5, -0.81).normalize_or_zero();
        let (mut mean, mut square) = (Vec3::ZERO, 0.0);
        let side = 64;
        for i in 0..side * side {
            let u = [(i % side) as f32 + 0.5, (i / side) as f32 + 0.5].map(|v| v / side as f32);
            let direction = cosine(normal, u);
            assert!((direction.length() - 1.0).abs() < 1e-5 && direction.dot(normal) >= 0.0);
            mean += direction / (side * side) as f32;
            square += direction.dot(normal).powi(2) / (side * side) as f32;
        }
        // The mean of the cosine is 2/3, of its square 1/2.
        assert!((mean - normal * (2.0 / 3.0)).length() < 3e-3, "{mean}");
        assert!((square - 0.5).abs() < 1e-3, "{square}");
    }

    #[test]
    fn frames_are_orthonormal_at_the_poles_too() {
        for n in [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::new(0.6, -0.0, -0.8)] {
            let (t, b) = frame(n);
            for (a, b, want) in [(t, t, 1.0), (b, b, 1.0), (t, b, 0.0), (t, n, 0.0), (b, n, 0.0)] {
                assert!((a.dot(b) - want).abs() < 1e-6, "{n}");
            }
            assert!((t.cross(b) - n).length() < 1e-6);
        }
    }
}
