//! Eigenvalues and eigenvectors of a symmetric 3 x 3 matrix in closed form (`eberly2014`, section
//! 3): the eigenvalue farthest from the others first, its vector from the longest cross product,
//! the others in the plane across it. It uses only sums, products, quotients and square roots, so
//! its bits are the same on every machine; the root of the cubic is found without trigonometry.

/// A vector.
pub type Vec3 = [f64; 3];

/// Eigenvalues and eigenvectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, largest first.
    pub values: Vec3,
    /// Unit eigenvectors, right-handed.
    pub axes: [Vec3; 3],
}

impl Eigen {
    /// Eigensystem of the zero matrix.
    const NONE: Self =
        Self { values: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    /// Computes the eigensystem of the matrix with entries xx, yy, zz, xy, xz, yz. A matrix that is
    /// not finite counts as zero.
    pub fn of(m: [f64; 6]) -> Self {
        let largest = m.iter().fold(0.0f64, |a, b| a.max(b.abs()));
        if !m.iter().all(|c| c.is_finite()) || largest == 0.0 {
            return Self::NONE;
        }
        // Divided, not multiplied by an inverse: the inverse of a denormal number is infinite.
        let m = m.map(|c| c / largest);
        let mean = (m[0] + m[1] + m[2]) / 3.0;
        let [xx, yy, zz] = [m[0] - mean, m[1] - mean, m[2] - mean];
        let [xy, xz, yz] = [m[3], m[4], m[5]];
        let square = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz);
        let size = (square / 6.0).sqrt();
        if size == 0.0 {
            return Self { values: [mean * largest; 3], ..Self::NONE };
        }
        // Of the matrix less its mean, over its size, the eigenvalues are 2 cos t, where cos 3t is
        // half the determinant.
        let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].map(|row| row.map(|c| c / size));
        let half_det = dot(rows[0], cross(rows[1], rows[2])) / 2.0;
        let lone = (2.0 * third_of_angle(half_det.abs().min(1.0))).copysign(half_det);
        let axis = null_of(&rows, lone);
        let (u, v) = across(axis);
        let (values, [first, second]) = in_plane(&rows, u, v);
        let lone = dot(axis, times(&rows, axis));
        let value = |c: f64| (c * size + mean) * largest;
        let (mut values, mut axes) = if half_det >= 0.0 {
            ([lone, values[0], values[1]], [axis, first, second])
        } else {
            ([values[0], values[1], lone], [first, second, axis])
        };
        // Rounding may swap nearly equal eigenvalues.
        for (a, b) in [(0, 1), (1, 2), (0, 1)] {
            if values[a] < values[b] {
                values.swap(a, b);
                axes.swap(a, b);
            }
        }
        Self { values: values.map(value), axes: [axes[0], axes[1], cross(axes[0], axes[1])] }
    }
}

/// `cos(acos(h) / 3)` for 0 <= h <= 1: the root of 4 c^3 - 3 c = h between cos(pi / 6) and 1. The
/// slope there is 6 to 9, so three Newton steps from a chord that is off by at most 0.005 reach the
/// last bits.
fn third_of_angle(h: f64) -> f64 {
    let mut c = 0.868_5 + 0.134_0 * h;
    for _ in 0..3 {
        c -= ((4.0 * c * c - 3.0) * c - h) / (12.0 * c * c - 3.0);
    }
    c
}

/// Returns the unit vector that the matrix less `value` maps to zero. The rows are perpendicular to
/// it, and the longest of their cross products is the most accurate. It is never short, since
/// `value` is apart from the other two eigenvalues.
fn null_of(rows: &[Vec3; 3], value: f64) -> Vec3 {
    let mut rows = *rows;
    for (i, row) in rows.iter_mut().enumerate() {
        row[i] -= value;
    }
    let mut longest = (0.0, [1.0, 0.0, 0.0]);
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let c = cross(rows[i], rows[j]);
        let square = dot(c, c);
        if square > longest.0 {
            longest = (square, c);
        }
    }
    let norm = longest.0.sqrt();
    if norm > 0.0 { longest.1.map(|c| c / norm) } else { longest.1 }
}

/// Returns two unit vectors that form a right-handed system with `axis`.
fn across(axis: Vec3) -> (Vec3, Vec3) {
    let [x, y, z] = axis;
    let u = if x.abs() > y.abs() {
        let norm = (x * x + z * z).sqrt();
        [-z / norm, 0.0, x / norm]
    } else {
        let norm = (y * y + z * z).sqrt();
        [0.0, z / norm, -y / norm]
    };
    (u, cross(axis, u))
}

/// Eigenvalues, largest first, and eigenvectors in the plane of `u` and `v`, by one Jacobi
/// rotation.
fn in_plane(rows: &[Vec3; 3], u: Vec3, v: Vec3) -> ([f64; 2], [Vec3; 2]) {
    let (mu, mv) = (times(rows, u), times(rows, v));
    let (uu, uv, vv) = (dot(u, mu), dot(u, mv), dot(v, mv));
    if uv == 0.0 {
        return if uu >= vv { ([uu, vv], [u, v]) } else { ([vv, uu], [v, u]) };
    }
    let theta = (vv - uu) / (2.0 * uv);
    let tan = 1.0f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
    let cos = 1.0 / (tan * tan + 1.0).sqrt();
    let sin = tan * cos;
    let mix = |a: f64, b: f64| [0, 1, 2].map(|i| a * u[i] + b * v[i]);
    let (low, high) = (mix(cos, -sin), mix(sin, cos));
    let (a, b) = (uu - tan * uv, vv + tan * uv);
    if a >= b { ([a, b], [low, high]) } else { ([b, a], [high, low]) }
}

fn times(rows: &[Vec3; 3], v: Vec3) -> Vec3 {
    [dot(rows[0], v), dot(rows[1], v), dot(rows[2], v)]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use nalgebra::{Matrix3, SymmetricEigen};

    /// Matrices of eight kinds, seven of them degenerate.
    fn matrix(kind: u64, random: &mut Random) -> [f64; 6] {
        const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        let outer = |m: &mut [f64; 6], v: Vec3, share: f64| {
            PAIRS.iter().zip(m).for_each(|(&(i, j), m)| *m += share * v[i] * v[j]);
        };
        let mut m = [0.0; 6];
        match kind {
            // Any entries, of any sign and size.
            0 => {
                let size = 10f64.powi((random.next() % 200) as i32 - 100);
                m = m.map(|_| random.signed() * size);
            }
            // One direction; two directions, one of them nearly or entirely absent.
            1 => outer(&mut m, random.vector(), 1.0),
            2 => {
                outer(&mut m, random.vector(), 1.0);
                let share = 10f64.powi(-((random.next() % 20) as i32));
                outer(&mut m, random.vector(), share);
            }
            // Nearly or exactly a multiple of the identity.
            3 => {
                let share = 10f64.powi(-((random.next() % 20) as i32));
                m = m.map(|_| random.signed() * share);
                (0..3).for_each(|i| m[i] += 1.0);
            }
            // Diagonal, with equal entries.
            4 => (0..3).for_each(|i| m[i] = (random.next() % 3) as f64),
            // Covariance of a plane in any direction: two equal eigenvalues, the third small.
            5 => {
                let n = random.vector();
                let square = dot(n, n).max(1e-9);
                (0..3).for_each(|i| m[i] = square);
                outer(&mut m, n, -1.0);
                let share = 10f64.powi(-((random.next() % 20) as i32));
                outer(&mut m, n, share);
            }
            // Few points on a lattice: whole numbers, often singular.
            6 => {
                for _ in 0..1 + random.next() % 4 {
                    let v = [0; 3].map(|_| (random.next() % 5) as f64 - 2.0);
                    outer(&mut m, v, 1.0);
                }
            }
            // Entries of very different sizes.
            _ => m = m.map(|_| random.signed() * 10f64.powi(-((random.next() % 30) as i32))),
        }
        m
    }

    /// Greatest errors against a library: of eigenvalues, of `A v - l v`, of the products of axes.
    fn worst_errors(count: u64) -> [[f64; 3]; 8] {
        let (mut random, mut worst) = (Random(7), [[0.0f64; 3]; 8]);
        for i in 0..count {
            let kind = i % 8;
            let m = matrix(kind, &mut random);
            let [xx, yy, zz, xy, xz, yz] = m;
            let size = m.iter().fold(f64::MIN_POSITIVE, |a, b| a.max(b.abs()));
            let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].map(|r| r.map(|c| c / size));
            let matrix = Matrix3::from_fn(|i, j| rows[i][j]);
            let mut theirs: Vec<f64> =
                SymmetricEigen::new(matrix).eigenvalues.iter().copied().collect();
            theirs.sort_by(|a, b| b.total_cmp(a));
            let ours = Eigen::of(m);
            let worst = &mut worst[kind as usize];
            for (k, axis) in ours.axes.into_iter().enumerate() {
                let value = ours.values[k] / size;
                worst[0] = worst[0].max((value - theirs[k]).abs());
                let image = times(&rows, axis);
                for c in 0..3 {
                    worst[1] = worst[1].max((image[c] - value * axis[c]).abs());
                }
                for (j, other) in ours.axes.into_iter().enumerate() {
                    let one = f64::from(u8::from(j == k));
                    worst[2] = worst[2].max((dot(axis, other) - one).abs());
                }
            }
            assert!(ours.values[0] >= ours.values[1] && ours.values[1] >= ours.values[2]);
            assert!(dot(ours.axes[0], cross(ours.axes[1], ours.axes[2])) > 0.0);
        }
        worst
    }

    #[test]
    fn a_million_random_and_degenerate_matrices_agree_with_a_library() {
        for (kind, worst) in worst_errors(1_000_000).into_iter().enumerate() {
            assert!(worst.iter().all(|&e| e < 1e-14), "kind {kind}: {worst:?}");
        }
    }

    #[test]
    fn zero_and_non_finite_matrices_have_no_direction() {
        for m in [[0.0; 6], [f64::NAN; 6], [f64::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0]] {
            assert_eq!(Eigen::of(m), Eigen::NONE);
        }
        // The smallest and the largest numbers.
        for size in [5e-324, f64::MAX] {
            let e = Eigen::of([size, 0.0, 0.0, 0.0, 0.0, 0.0]);
            assert_eq!((e.values, e.axes[0]), ([size, 0.0, 0.0], [1.0, 0.0, 0.0]));
        }
    }

    #[test]
    fn a_third_of_an_angle_is_exact_to_the_last_bits() {
        for i in 0..=100_000 {
            let h = f64::from(i) / 100_000.0;
            assert!((third_of_angle(h) - (h.acos() / 3.0).cos()).abs() < 4e-16, "{h}");
        }
    }
}
