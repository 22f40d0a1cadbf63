//! The local shape of a node: exact integer moments that merge without rounding, the covariance in
//! the file's unit, its eigensystem, and the dimension of the n-tree (`kanzok2015`, section 3.1,
//! equation 1, after `westin1997`).

use esker_points::Cell;

/// Linearity, planarity or sphericity below this counts as zero (`kanzok2015`, section 3.1).
const THRESHOLD: f64 = 0.03;
/// Largest width of a line, in distances of points along it; with three rows of points or more it
/// is a strip.
const LINE_WIDTH: f64 = 8.0;

/// Exact sums over lattice positions. Merging is addition, in any order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moments {
    /// Number of points, below 2^40.
    pub count: u64,
    /// Sums of x, y, z.
    sum: [i128; 3],
    /// Sums of xx, yy, zz, xy, xz, yz.
    square: [i128; 6],
}

/// Pairs of axes of the entries of `Moments::square`.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl Moments {
    /// Adds a point.
    pub fn add(&mut self, p: [u32; 3]) {
        self.count += 1;
        for (sum, c) in self.sum.iter_mut().zip(p) {
            *sum += i128::from(c);
        }
        for (square, (i, j)) in self.square.iter_mut().zip(PAIRS) {
            *square += i128::from(u64::from(p[i]) * u64::from(p[j]));
        }
    }

    /// Sums points that are less than 2^22 steps above `corner` on each axis, in local 64-bit
    /// coordinates, which is fast.
    fn of_near(points: impl Iterator<Item = [u32; 3]>, corner: [u32; 3]) -> Self {
        let (mut count, mut sum, mut square) = (0u64, [0u64; 3], [0u64; 6]);
        for p in points {
            let local = |axis: usize| u64::from(p[axis].wrapping_sub(corner[axis]));
            let local = [local(0), local(1), local(2)];
            count += 1;
            (0..3).for_each(|i| sum[i] = sum[i].wrapping_add(local[i]));
            for (square, (i, j)) in square.iter_mut().zip(PAIRS) {
                *square = square.wrapping_add(local[i] * local[j]);
            }
        }
        let (n, c) = (i128::from(count), corner.map(i128::from));
        let local = sum.map(i128::from);
        let mut moments =
            Self { count, sum: [0, 1, 2].map(|i| local[i] + n * c[i]), square: [0; 6] };
        for ((out, square), (i, j)) in moments.square.iter_mut().zip(square).zip(PAIRS) {
            *out = i128::from(square) + c[i] * local[j] + c[j] * local[i] + n * c[i] * c[j];
        }
        moments
    }

    /// Sums points in a cell, fewer than 2^20.
    pub fn of(points: impl Iterator<Item = [u32; 3]>, cell: &Cell) -> Self {
        if cell.log2 <= 22 {
            return Self::of_near(points, cell.corner);
        }
        let mut moments = Self::default();
        points.for_each(|p| moments.add(p));
        moments
    }

    /// Returns the sums as numbers, to be stored.
    pub fn to_numbers(self) -> [i128; 10] {
        let mut numbers = [i128::from(self.count); 10];
        numbers[1..4].copy_from_slice(&self.sum);
        numbers[4..].copy_from_slice(&self.square);
        numbers
    }

    /// Restores sums from [`Moments::to_numbers`].
    pub fn from_numbers([count, x, y, z, square @ ..]: [i128; 10]) -> Self {
        Self { count: count as u64, sum: [x, y, z], square }
    }

    /// Adds all points of `other`.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum.iter_mut().zip(other.sum).for_each(|(a, b)| *a += b);
        self.square.iter_mut().zip(other.square).for_each(|(a, b)| *a += b);
    }

    /// Covariance matrix in the file's unit, entries as in [`PAIRS`]; zero for no point. Sums are
    /// moved to the lattice point at the mean while they are still integers, so nothing cancels.
    pub fn covariance(&self, scale: [f64; 3]) -> [f64; 6] {
        let n = i128::from(self.count);
        if n == 0 {
            return [0.0; 6];
        }
        let about = self.sum.map(|s| s / n);
        let rest = [0, 1, 2].map(|i| (self.sum[i] - n * about[i]) as f64 / n as f64);
        let mut out = [0.0; 6];
        for (k, (i, j)) in PAIRS.into_iter().enumerate() {
            let centred = self.square[k] - about[i] * self.sum[j] - about[j] * self.sum[i]
                + n * about[i] * about[j];
            out[k] = (centred as f64 / n as f64 - rest[i] * rest[j]) * scale[i] * scale[j];
        }
        out
    }
}

/// Eigenvalues, largest first, and eigenvectors of a covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// l1 >= l2 >= l3 >= 0.
    pub values: [f64; 3],
    /// Unit eigenvectors, right-handed.
    pub axes: [[f64; 3]; 3],
    /// Dimension of the n-tree, n = 2^dimension: 0 a point, 1 a line, 2 a plane, 3 a volume.
    pub dimension: u32,
}

impl Shape {
    /// Computes the shape of a covariance (entries xx, yy, zz, xy, xz, yz).
    pub fn of(covariance: [f64; 6]) -> Self {
        let (values, axes) = eigen(covariance);
        let sum: f64 = values.iter().sum();
        let dimension = if sum <= 0.0 {
            0
        } else if 3.0 * values[2] / sum > THRESHOLD {
            3
        } else if 2.0 * (values[1] - values[2]) / sum > THRESHOLD {
            2
        } else {
            1
        };
        Self { values, axes, dimension }
    }

    /// Dimension in which `points` points fill the shape evenly. A long shape is a line if it has
    /// few points; with many it is a surface (a road, a wall, a flight strip), or a volume if it is
    /// as thick as wide.
    pub fn dimension_of(&self, points: usize) -> u32 {
        let [along, across, thick] = self.values;
        let is_line = across.sqrt() * points as f64 <= LINE_WIDTH * along.sqrt();
        match self.dimension {
            1 if is_line => 1,
            // Sphericity of a piece that is as long as wide.
            1 if 3.0 * thick / (2.0 * across + thick) > THRESHOLD => 3,
            1 => 2,
            dimension => dimension,
        }
    }
}

/// Eigensystem of a symmetric 3 x 3 matrix by cyclic Jacobi rotations (`golub2013`, section 8.5).
/// It uses only sums, products, quotients and square roots, so its bits are the same on every
/// machine.
fn eigen(m: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let largest = m.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    if !(largest > 0.0 && largest.is_finite()) {
        return ([0.0; 3], IDENTITY);
    }
    let [xx, yy, zz, xy, xz, yz] = m.map(|c| c / largest);
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut v = IDENTITY;
    for _sweep in 0..12 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]).then(i.cmp(&j)));
    let column = |k: usize| [v[0][k], v[1][k], v[2][k]];
    let (first, second) = (column(order[0]), column(order[1]));
    let third = [
        first[1] * second[2] - first[2] * second[1],
        first[2] * second[0] - first[0] * second[2],
        first[0] * second[1] - first[1] * second[0],
    ];
    (order.map(|k| (a[k][k] * largest).max(0.0)), [first, second, third])
}

fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = 1.0f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    let (row_p, row_q) = (a[p], a[q]);
    for (k, (x, y)) in row_p.into_iter().zip(row_q).enumerate() {
        (a[p][k], a[q][k]) = (c * x - s * y, s * x + c * y);
    }
    for row in v.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn moments_of_local_coordinates_are_those_of_absolute_ones(points in prop::collection::vec([0u32..1 << 22, 0u32..1 << 22, 0u32..1 << 22], 1..100), corner in [0u32..1 << 10, 0u32..1 << 10, 0u32..1 << 10]) {
            let cell = Cell { corner: corner.map(|c| c << 22), log2: 22 };
            let points: Vec<_> = points.iter().map(|p| [0, 1, 2].map(|i| p[i] + cell.corner[i])).collect();
            prop_assert_eq!(Moments::of(points.iter().copied(), &cell), moments(&points));
        }
    }

    fn moments(points: &[[u32; 3]]) -> Moments {
        let mut m = Moments::default();
        points.iter().for_each(|&p| m.add(p));
        m
    }

    #[test]
    fn coincident_points_have_dimension_zero_anywhere() {
        for p in [[0; 3], [u32::MAX; 3], [u32::MAX, 0, 1 << 31]] {
            let shape = Shape::of(moments(&[p; 1000]).covariance([0.001; 3]));
            assert_eq!((shape.dimension, shape.values), (0, [0.0; 3]));
        }
    }

    #[test]
    fn a_long_shape_is_a_line_of_few_points_and_a_surface_or_a_volume_of_many() {
        let dimension = |along: u32, across: u32, thick: u32| {
            let place = |i: u32| [i / across / thick, i / thick % across, i % thick];
            let points: Vec<_> =
                (0..along * across * thick).map(|i| place(i).map(|c| c * 50)).collect();
            let shape = Shape::of(moments(&points).covariance([0.001; 3]));
            (shape.dimension, shape.dimension_of(points.len()))
        };
        assert_eq!(dimension(1000, 1, 1), (1, 1));
        assert_eq!(dimension(1000, 2, 1), (1, 1));
        assert_eq!(dimension(1000, 3, 1), (1, 2));
        assert_eq!(dimension(1000, 40, 1), (1, 2));
        assert_eq!(dimension(200, 9, 9), (1, 3));
        assert_eq!(dimension(100, 60, 1), (2, 2));
        // A wire that sways by as much as its points are apart.
        let wire: Vec<_> = (0..1000u32).map(|i| [i * 50, i % 3 * 25 + 7, i * 7 % 5 * 12]).collect();
        let wire = Shape::of(moments(&wire).covariance([0.001; 3]));
        assert_eq!(wire.dimension_of(1000), 1);
    }

    #[test]
    fn a_far_corner_does_not_cancel() {
        // 2^32 steps from the origin, one step apart: the variance is 1/4 of a squared step.
        let m = moments(&[[u32::MAX; 3], [u32::MAX - 1, u32::MAX, u32::MAX]]);
        assert_eq!(m.covariance([1.0; 3]), [0.25, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    proptest! {
        #[test]
        fn covariance_equals_that_computed_in_f64(points in prop::collection::vec([0u32..1000, 0u32..1000, 0u32..1000], 1..100)) {
            let n = points.len() as f64;
            let mean = [0, 1, 2].map(|i| points.iter().map(|p| f64::from(p[i])).sum::<f64>() / n);
            let ours = moments(&points).covariance([0.5, 1.0, 2.0]);
            let scale = [0.5, 1.0, 2.0];
            for (k, (i, j)) in PAIRS.into_iter().enumerate() {
                let plain = points.iter().map(|p| (f64::from(p[i]) - mean[i]) * (f64::from(p[j]) - mean[j])).sum::<f64>() / n * scale[i] * scale[j];
                prop_assert!((ours[k] - plain).abs() <= 1e-9 * (1.0 + plain.abs()) * 1e3, "{} {}", ours[k], plain);
            }
        }

        #[test]
        fn eigenvectors_reproduce_the_matrix(m in [-1e3f64..1e3, -1e3f64..1e3, -1e3f64..1e3, -1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0]) {
            // Any symmetric positive semi-definite matrix: the product of a matrix with its
            // transpose.
            let b = [[m[0], m[3], m[4]], [m[3], m[1], m[5]], [m[4] * 7.0, m[5], m[2]]];
            let g = |i: usize, j: usize| (0..3).map(|k| b[i][k] * b[j][k]).sum::<f64>();
            let spd = [g(0, 0), g(1, 1), g(2, 2), g(0, 1), g(0, 2), g(1, 2)];
            let shape = Shape::of(spd);
            let size = spd.iter().fold(0.0f64, |a, b| a.max(b.abs()));
            prop_assert!(shape.values[0] >= shape.values[1] && shape.values[1] >= shape.values[2]);
            for (k, (i, j)) in PAIRS.into_iter().enumerate() {
                let back: f64 = (0..3).map(|e| shape.values[e] * shape.axes[e][i] * shape.axes[e][j]).sum();
                prop_assert!((back - spd[k]).abs() <= 1e-12 * size, "{back} {}", spd[k]);
            }
        }

        #[test]
        fn merging_is_adding(a in prop::collection::vec(any::<[u32; 3]>(), 0..50), b in prop::collection::vec(any::<[u32; 3]>(), 0..50)) {
            let mut merged = moments(&a);
            merged.merge(&moments(&b));
            let all: Vec<_> = b.iter().chain(&a).copied().collect();
            prop_assert_eq!(merged, moments(&all));
        }
    }
}
