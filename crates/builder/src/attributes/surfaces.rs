//! Generated surfaces: points with true normals, for the tests of both estimates.

use crate::random::Random;

/// Points with true normals.
pub(crate) type Truth = Vec<([f64; 3], [f64; 3])>;

const NORMAL: [f64; 3] = [0.48, 0.6, 0.64];

/// A point of a tilted plane, `off` it.
pub(crate) fn tilted(a: f64, b: f64, off: f64) -> ([f64; 3], [f64; 3]) {
    let (u, v) = ([0.8, 0.0, -0.6], [-0.36, 0.8, -0.48]);
    ([0, 1, 2].map(|i| a * u[i] + b * v[i] + off * NORMAL[i]), NORMAL)
}

/// 20,000 points of a tilted square of 10 m, 7 cm apart, off it by `noise_m`.
pub(crate) fn plane(noise_m: f64) -> Truth {
    let mut r = Random(1);
    let mut point = || tilted(r.unit() * 10.0, r.unit() * 10.0, r.bell() * noise_m);
    (0..20_000).map(|_| point()).collect()
}

/// 20,000 points of a sphere.
pub(crate) fn sphere(radius_m: f64) -> Truth {
    let mut r = Random(2);
    let mut point = || loop {
        let v = [0; 3].map(|_| r.unit() * 2.0 - 1.0);
        let norm = v.iter().map(|c| c * c).sum::<f64>().sqrt();
        if norm > 0.1 && norm < 1.0 {
            return (v.map(|c| c / norm * radius_m), v.map(|c| c / norm));
        }
    };
    (0..20_000).map(|_| point()).collect()
}

/// 20,000 points of two walls of 5 m that meet at a right angle.
pub(crate) fn two_walls() -> Truth {
    let mut r = Random(3);
    let mut point = |i: u32| {
        let (a, b) = (r.unit() * 5.0, r.unit() * 5.0);
        if i.is_multiple_of(2) {
            ([a, b, 0.0], [0.0, 0.0, 1.0])
        } else {
            ([0.0, b, a], [1.0, 0.0, 0.0])
        }
    };
    (0..20_000).map(&mut point).collect()
}
