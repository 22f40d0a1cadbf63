//! Least-squares planes of points that are given by their sums (`hoppe1992`, section 3.2), and what
//! the points are instead if they are no surface (`westin1997`). Without square roots and
//! trigonometry, so the bits are the same on every machine.

use crate::attributes::normals::LINE;

/// Number of points, sums of x, y, z, and of xx, yy, zz, xy, xz, yz.
pub type Moments = [f64; 10];

/// Least eigenvalue over the second above which points are a volume, such as the crown of a tree.
/// Noise of a quarter of the distance of points stays below it.
pub(super) const VOLUME: f64 = 0.35;
/// Newton's steps to the least eigenvalue.
const STEPS: usize = 6;

/// Whether points in steps of these lengths lie along a line; costs less than their plane.
pub fn is_line(sums: &Moments, scale: [f64; 3]) -> bool {
    // The second coefficient of the characteristic polynomial of a line is nearly the sum of the
    // two least eigenvalues, as the greatest is nearly one.
    let covariance = Covariance::of(sums, scale);
    covariance.is_some_and(|c| c.minors <= 2.0 * LINE)
}

/// Moments of one point.
pub fn moments([x, y, z]: [f64; 3]) -> Moments {
    [1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]
}

/// Adds moments.
pub fn add(sums: &mut Moments, terms: &Moments) {
    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
}

/// What points spread along.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Spread {
    Line,
    #[default]
    Plane,
    Volume,
}

/// Plane through the mean of points, across the direction in which they spread least.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plane {
    /// Normal of any length, in metres.
    pub normal: [f64; 3],
    pub spread: Spread,
    /// Least variance, as a share of the sum of all three.
    pub share: f64,
    /// Variance of the distances from the plane of all points that these are a sample of; not
    /// finite if three points or fewer determine the plane.
    pub variance: f64,
    /// Distance from the plane, along its normal: of the origin, and for each step of an axis.
    along: [f64; 4],
    /// Square of the length of the normal, and its inverse.
    square: f64,
    over_square: f64,
}

impl Plane {
    /// Fits a plane to points in steps of these lengths; `None` if all of them coincide.
    pub fn of(sums: &Moments, scale: [f64; 3]) -> Option<Self> {
        let covariance = Covariance::of(sums, scale)?;
        Some(Self::across(&covariance, sums, scale))
    }

    /// Fits a plane to points that spread along a plane, whose share and variance are at most
    /// these; `None` for others, most of which cost little.
    pub fn flat(sums: &Moments, scale: [f64; 3], (share, variance): (f64, f64)) -> Option<Self> {
        let covariance = Covariance::of(sums, scale)?;
        let is_flat = |least: f64| {
            least <= share && least * covariance.trace <= variance * variance_weight(sums[0])
        };
        if !is_flat(covariance.least_bound()) {
            return None;
        }
        let plane = Self::across(&covariance, sums, scale);
        (plane.spread == Spread::Plane && is_flat(plane.share)).then_some(plane)
    }

    /// The plane of points with this covariance.
    fn across(covariance: &Covariance, sums: &Moments, scale: [f64; 3]) -> Self {
        let [n, x, y, z, ..] = *sums;
        let (normal, spread, share) = covariance.least();
        let steps = [0, 1, 2].map(|i| normal[i] * scale[i]);
        let at = (steps[0] * x + steps[1] * y + steps[2] * z) / n;
        let square = square(normal);
        Self {
            normal,
            spread,
            share,
            variance: share * covariance.trace / variance_weight(n),
            along: [-at, steps[0], steps[1], steps[2]],
            square,
            over_square: 1.0 / square,
        }
    }

    /// Square of the distance of a point, which is given in steps.
    pub fn square_distance(&self, p: [f64; 3]) -> f64 {
        let [at, x, y, z] = self.along;
        let along = at + x * p[0] + y * p[1] + z * p[2];
        along * along * self.over_square
    }

    /// Sum of the squares of the distances of points.
    pub fn square_distances(&self, sums: &Moments) -> f64 {
        let [n, x, y, z, xx, yy, zz, xy, xz, yz] = *sums;
        let [at, a, b, c] = self.along;
        let squares = a * a * xx + b * b * yy + c * c * zz;
        let products = a * b * xy + a * c * xz + b * c * yz;
        let linear = at * (a * x + b * y + c * z);
        (n * at * at + squares + 2.0 * (products + linear)) * self.over_square
    }

    /// Square of the cosine of the angle to another plane.
    pub fn square_cosine(&self, other: &Self) -> f64 {
        let [a, b] = [self.normal, other.normal];
        let dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        dot * dot / (self.square * other.square)
    }
}

fn square(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// Least eigenvalue of the covariance of `n` points, over the variance of the distances from their
/// plane: three points lie on any plane.
fn variance_weight(n: f64) -> f64 {
    n * (n - 3.0)
}

/// Covariance of points: xx, yy, zz, xy, xz, yz as shares of the trace.
pub(super) struct Covariance {
    shares: [f64; 6],
    /// Sum of the variances, larger by the square of the number of points.
    trace: f64,
    /// Coefficients of the characteristic polynomial.
    minors: f64,
    det: f64,
}

impl Covariance {
    /// Covariance of points in steps of these lengths; `None` if all of them coincide.
    fn of(sums: &Moments, scale: [f64; 3]) -> Option<Self> {
        let [n, x, y, z, xx, yy, zz, xy, xz, yz] = *sums;
        let [a, b, c] = scale;
        Self::new([
            (n * xx - x * x) * (a * a),
            (n * yy - y * y) * (b * b),
            (n * zz - z * z) * (c * c),
            (n * xy - x * y) * (a * b),
            (n * xz - x * z) * (a * c),
            (n * yz - y * z) * (b * c),
        ])
    }

    /// `None` if there is no variance.
    pub(super) fn new(covariance: [f64; 6]) -> Option<Self> {
        let trace = covariance[0] + covariance[1] + covariance[2];
        if !(trace > 0.0 && trace.is_finite()) {
            return None;
        }
        let over = 1.0 / trace;
        let [xx, yy, zz, xy, xz, yz] = covariance.map(|c| c * over);
        let minors = (xx * yy - xy * xy) + (xx * zz - xz * xz) + (yy * zz - yz * yz);
        let det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
        Some(Self { shares: [xx, yy, zz, xy, xz, yz], trace, minors, det })
    }

    /// Lower bound of the least eigenvalue: the first of Newton's steps.
    fn least_bound(&self) -> f64 {
        if self.det > 0.0 && self.minors > 0.0 { self.det / self.minors } else { 0.0 }
    }

    /// Direction, of any length, in which the points spread least, what they spread along, and the
    /// least eigenvalue.
    pub(super) fn least(&self) -> ([f64; 3], Spread, f64) {
        let Self { shares: [xx, yy, zz, xy, xz, yz], minors, det, .. } = *self;
        // Newton's steps from below approach the least root of the characteristic polynomial and do
        // not pass it.
        let mut least = 0.0;
        for _ in 0..STEPS {
            let value = ((least - 1.0) * least + minors) * least - det;
            let slope = (3.0 * least - 2.0) * least + minors;
            if value >= 0.0 || slope <= 0.0 {
                break;
            }
            least -= value / slope;
        }
        // Sum and product of the other two, whose polynomial is negative between them.
        let (sum, product) = (1.0 - least, minors - least * (1.0 - least));
        let bound = least / VOLUME;
        let spread = if product * (1.0 + LINE) * (1.0 + LINE) <= LINE * sum * sum {
            Spread::Line
        } else if bound * (bound - sum) + product < 0.0 || 2.0 * bound > sum {
            Spread::Volume
        } else {
            Spread::Plane
        };
        let rows = [[xx - least, xy, xz], [xy, yy - least, yz], [xz, yz, zz - least]];
        let cross = |[i, j]: [usize; 2]| {
            let (a, b) = (rows[i], rows[j]);
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let [first, second, third] = [[0, 1], [0, 2], [1, 2]].map(cross);
        let longer = |a, b| if square(b) >= square(a) { b } else { a };
        (longer(longer(first, second), third), spread, least)
    }
}
