//! Boxes and the regions of clips on a lattice. A region is the points of an upright box that are
//! behind all of its faces, which become planes with integer coefficients once. All tests of points
//! and of the boxes of nodes are exact on these, so that a node is judged as its points are, and a
//! region and its complement share no point and lose none.
//!
//! A face is `s . u <= e` for a lattice point `u`. The slopes `s` are the normal in steps, scaled
//! so that the greatest is 2^58, and `e` is rounded to 1/256 of a step along the axis of the
//! greatest slope, as the faces of upright boxes are. Sums of products of `s` and `u` are below
//! 2^92, and `e` is below 2^113, so `i128` holds all of them on any lattice.

use super::bounds::Bounds;
use super::clip::{Clip, ClipShape, around, axes};
use super::condition::{FilterError, PARTS, Side, in_parts};
use crate::lattice::Lattice;

/// Bits of the greatest slope of a face.
const SLOPE_BITS: u32 = 58;
/// Slopes below this share of the greatest one are 0: over the whole lattice they make 1/256 step.
const SLOPE_MIN: f64 = 1.0 / (1u64 << 40) as f64;
/// Upper bound of the sums of coordinates times slopes, of which the greatest is 1.
const SUM_MAX: f64 = (1u64 << 34) as f64;
/// Greatest error of the place of a face that crosses the lattice, in steps.
const ERROR_MAX: f64 = 0.5;
/// Error of the place of a face as a share of the numbers that it is computed from: that of three
/// products and sums of doubles, with a margin.
const ERROR: f64 = 8.0 * f64::EPSILON;

/// The lattice points between two corners, both included; none if the least is above the greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LatticeBox([[u32; 3]; 2]);

impl LatticeBox {
    /// The lattice points in a box in world units.
    pub(super) fn new(lattice: &Lattice, bounds: &Bounds) -> Self {
        let mut region = [[0; 3], [u32::MAX; 3]];
        for axis in 0..3 {
            let [low, high] = [bounds.min, bounds.max].map(|c| in_parts(lattice, axis, c[axis]));
            // The first step that is not below, the last that is not above.
            let least = low.div_euclid(PARTS) + i64::from(low.rem_euclid(PARTS) > 0);
            let greatest = high.div_euclid(PARTS);
            if greatest < 0 || least > i64::from(u32::MAX) || least > greatest {
                return Self([[1; 3], [0; 3]]);
            }
            region[0][axis] = least.max(0) as u32;
            region[1][axis] = greatest.min(i64::from(u32::MAX)) as u32;
        }
        Self(region)
    }

    /// All lattice points.
    const ALL: Self = Self([[0; 3], [u32::MAX; 3]]);

    pub(super) fn contains(&self, p: [u32; 3]) -> bool {
        let [low, high] = self.0;
        (0..3).all(|i| low[i] <= p[i] && p[i] <= high[i])
    }

    /// Side of the points of a box, both corners included.
    pub(super) fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let [low, high] = self.0;
        if (0..3).any(|i| max[i] < low[i] || min[i] > high[i] || low[i] > high[i]) {
            Side::Outside
        } else if (0..3).all(|i| low[i] <= min[i] && max[i] <= high[i]) {
            Side::Inside
        } else {
            Side::Across
        }
    }
}

/// The region of a clip on a lattice.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LatticeRegion {
    bounds: LatticeBox,
    faces: Vec<Face>,
    keeps_outside: bool,
}

/// The half space `slopes . u <= end` of lattice points `u`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    slopes: [i128; 3],
    end: i128,
}

/// Regions of the clips that are switched on.
pub(super) fn of_clips(
    clips: &[Clip],
    lattice: &Lattice,
) -> Result<Vec<LatticeRegion>, FilterError> {
    let on = clips.iter().filter(|clip| clip.is_on);
    on.map(|clip| LatticeRegion::new(clip, lattice)).collect()
}

impl LatticeRegion {
    fn new(clip: &Clip, lattice: &Lattice) -> Result<Self, FilterError> {
        clip.check()?;
        let far = || {
            FilterError(format!(
                "the clip `{clip}` is so far from the points that its faces have no exact place \
                 among them; is it in their coordinates?"
            ))
        };
        let face =
            |point, normal, distance| Face::new(lattice, point, normal, distance).ok_or_else(far);
        let (bounds, faces) = match clip.shape {
            ClipShape::Box(bounds) => (LatticeBox::new(lattice, &bounds), Vec::new()),
            ClipShape::Oriented { centre, size, rotation } => {
                let axes = axes(rotation);
                let sides = axes.iter().zip(size).flat_map(|(axis, length)| {
                    [1.0, -1.0].map(|sign| (axis.map(|c| c * sign), length / 2.0))
                });
                let faces = sides.map(|(normal, half)| face(centre, normal, half));
                let around = around(centre, size, &axes, lattice);
                (roomy(lattice, &around), faces.collect::<Result<_, _>>()?)
            }
            ClipShape::Plane { point, normal } => {
                (LatticeBox::ALL, vec![face(point, unit(normal), 0.0)?])
            }
        };
        Ok(Self { bounds, faces, keeps_outside: clip.keeps_outside })
    }

    /// Whether a lattice point is kept.
    pub(super) fn keeps(&self, p: [u32; 3]) -> bool {
        let is_inside = self.bounds.contains(p) && self.faces.iter().all(|face| face.contains(p));
        is_inside != self.keeps_outside
    }

    /// Side of the points of a box, both corners included.
    pub(super) fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let mut side = self.bounds.side_of_box(min, max);
        for face in &self.faces {
            if side == Side::Outside {
                break;
            }
            side = side.and(face.side_of_box(min, max));
        }
        match side {
            Side::Inside if self.keeps_outside => Side::Outside,
            Side::Outside if self.keeps_outside => Side::Inside,
            side => side,
        }
    }

    /// The region for points of a box, without the faces that all of them are behind; `None` if it
    /// keeps them all.
    pub(super) fn in_box(&self, min: [u32; 3], max: [u32; 3]) -> Option<Self> {
        if self.side_of_box(min, max) == Side::Inside {
            return None;
        }
        let cuts = |face: &&Face| face.side_of_box(min, max) != Side::Inside;
        Some(Self { faces: self.faces.iter().filter(cuts).copied().collect(), ..*self })
    }
}

impl Face {
    /// The half space whose points are at most `distance` from `point` along `normal`, which has
    /// length 1. Both are in metres if the coordinates are degrees. `None` if doubles do not place
    /// the plane among the lattice points to [`ERROR_MAX`].
    fn new(lattice: &Lattice, point: [f64; 3], normal: [f64; 3], distance: f64) -> Option<Self> {
        let across = lattice.measure(lattice.scale);
        let across = [0, 1, 2].map(|i| normal[i] * across[i]);
        let most = across.iter().fold(f64::MIN_POSITIVE, |most, s| most.max(s.abs()));
        let slopes = across.map(|s| s / most).map(|s| if s.abs() < SLOPE_MIN { 0.0 } else { s });
        // A slope of 0 has no part in the sum, not even at an infinite distance.
        let part = |i: usize| match slopes[i] {
            0.0 => 0.0,
            slope => slope * lattice.steps_axis(i, point[i]),
        };
        let parts = [part(0), part(1), part(2), (distance / most).min(f64::MAX / 8.0)];
        let end: f64 = parts.iter().sum();
        let error = parts.iter().map(|part| part.abs()).sum::<f64>() * ERROR;
        let is_beyond = end.abs() - error > SUM_MAX;
        if !end.is_finite() || !(is_beyond || error <= ERROR_MAX) {
            return None;
        }
        // Saturates, beyond all lattice points.
        let end = (end * PARTS as f64).round() as i64;
        let whole = f64::from(SLOPE_BITS).exp2();
        Some(Self {
            slopes: slopes.map(|s| (s * whole).round() as i128),
            end: i128::from(end) * ((1 << SLOPE_BITS) / i128::from(PARTS)),
        })
    }

    fn height(&self, p: [u32; 3]) -> i128 {
        (0..3).map(|axis| self.slopes[axis] * i128::from(p[axis])).sum()
    }

    fn contains(&self, p: [u32; 3]) -> bool {
        self.height(p) <= self.end
    }

    /// Side of a box: its farthest corners along the normal and against it decide.
    fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let corner = |is_far: bool| {
            [0, 1, 2].map(|i| if (self.slopes[i] > 0) == is_far { max[i] } else { min[i] })
        };
        if self.contains(corner(true)) {
            Side::Inside
        } else if self.contains(corner(false)) {
            Side::Across
        } else {
            Side::Outside
        }
    }
}

/// The lattice points in a box, with a margin for rounding: the faces alone decide near them.
fn roomy(lattice: &Lattice, Bounds { min, max }: &Bounds) -> LatticeBox {
    let margin =
        |i: usize| (min[i].abs().max(max[i].abs())) * (4.0 * ERROR) + 2.0 * lattice.scale[i];
    let bounds = Bounds {
        min: [0, 1, 2].map(|i| min[i] - margin(i)),
        max: [0, 1, 2].map(|i| max[i] + margin(i)),
    };
    LatticeBox::new(lattice, &bounds)
}

/// A direction of length 1, of a vector that is finite and not 0.
fn unit(v: [f64; 3]) -> [f64; 3] {
    let most = v.iter().fold(0.0f64, |most, c| most.max(c.abs()));
    let v = v.map(|c| c / most);
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / length)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may panic")]
mod tests;
