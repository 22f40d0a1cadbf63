//! Grids of inputs: of integers as their headers give them, of floats and of decimal text as their
//! points need them.

use crate::spread::{Corners, Spread};
use serde::{Deserialize, Serialize};

/// Doubles of an extent of 2^24 steps keep enough digits for any scanner.
const STEPS_OF_EXTENT: f64 = (1u64 << 24) as f64;
/// Step numbers up to this leave bits of a double to round with; beyond it a grid of floats gets an
/// offset near the points.
const STEPS_FROM_ZERO_MAX: f64 = (1u64 << 50) as f64;
/// Rounds in which the bounds of floats and their step are chosen; each can only widen the bounds.
const ROUNDS: usize = 8;

/// Half the lattice: coordinate of raw 0 of a LAS file.
pub const ORIGIN: i64 = 1 << 31;

/// Reason why no lattice could be chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LatticeError {
    /// A scale that is not a positive number, or an offset or bound that is not a number.
    #[error(
        "{name}: {what} of axis {axis} is {value}, which is no usable number; the header is damaged"
    )]
    Unusable {
        /// Name of the input.
        name: String,
        /// Name of the value.
        what: &'static str,
        /// Axis: x, y or z.
        axis: char,
        /// The value.
        value: f64,
    },
}

/// An integer grid: `world = raw * scale + offset` on each axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Length of a step in the file's unit.
    pub scale: [f64; 3],
    /// World coordinate of raw 0.
    pub offset: [f64; 3],
}

impl Grid {
    /// World coordinates of a raw point.
    pub fn world(&self, raw: [i32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(raw[i]) * self.scale[i] + self.offset[i])
    }
}

/// Kind of an input's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GridKind {
    /// Integers on the input's own grid (LAS, LAZ).
    Integer,
    /// Floating point; the grid comes from [`float_grid`].
    Float,
    /// Decimal text; the grid comes from [`decimal_grid`].
    Decimal,
}

/// Coordinates of an input, as known before its points are decoded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputGrid {
    /// Path as given; decides which input's offset is used.
    pub name: String,
    /// Kind of numbers.
    pub kind: GridKind,
    /// Grid of the coordinates.
    pub grid: Grid,
    /// World minimum and maximum: a hint (headers of LAS can be wrong), exact for floats and text.
    pub bounds: Option<[[f64; 3]; 2]>,
}

/// Grid for floating-point coordinates, and the bounds of all but stray points. The step is one
/// power of ten for all axes: the largest not above the spacing of singles at the largest
/// coordinate, or, unless `is_single`, not above 2^-24 of the longest extent. Points outside of the
/// 2^32 steps around nearly all others are strays.
pub fn float_grid(spread: &Spread, is_single: bool) -> (Grid, Option<Corners>) {
    let Some(mut bounds) = spread.core() else {
        return (float_grid_within([[0.0; 3]; 2], is_single), None);
    };
    for _ in 0..ROUNDS {
        let step = float_step(bounds, is_single);
        let half = step * (ORIGIN - 2) as f64;
        let middle = [0, 1, 2].map(|i| bounds[0][i] / 2.0 + bounds[1][i] / 2.0);
        let window = [middle.map(|m| m - half), middle.map(|m| m + half)];
        let wider = spread.bounds_within(window).unwrap_or(bounds);
        if wider == bounds {
            break;
        }
        bounds = wider;
    }
    (float_grid_within(bounds, is_single), Some(bounds))
}

/// Grid for floating-point coordinates within `bounds`.
pub fn float_grid_within(bounds: Corners, is_single: bool) -> Grid {
    let step = float_step(bounds, is_single);
    let offset = [0, 1, 2].map(|i| {
        let (low, high) = (bounds[0][i], bounds[1][i]);
        if low.abs().max(high.abs()) / step <= STEPS_FROM_ZERO_MAX {
            return 0.0;
        }
        let middle = low / 2.0 + high / 2.0;
        let nearest = [middle.round(), format!("{middle:.12e}").parse().unwrap_or(middle)];
        // The shorter number, if it is near.
        let near = |o: &f64| (o - middle).abs() / step <= STEPS_FROM_ZERO_MAX;
        nearest.into_iter().find(near).unwrap_or(middle)
    });
    Grid { scale: [step; 3], offset }
}

/// The step of a grid for floats within `bounds`.
fn float_step(bounds: Corners, is_single: bool) -> f64 {
    let extent = (0..3).map(|i| bounds[1][i] - bounds[0][i]).fold(0.0, f64::max);
    let largest = bounds.iter().flatten().fold(0.0f64, |m, c| m.max(c.abs()));
    let spacing = if is_single {
        2f64.powi(largest.max(f64::from(f32::MIN_POSITIVE)).log2().floor() as i32 - 23)
    } else {
        let of = if extent > 0.0 { extent } else { largest };
        (of / STEPS_OF_EXTENT).max(largest * (f64::EPSILON / 2.0))
    };
    power_of_ten(if spacing > 0.0 { spacing } else { 1e-9 })
}

/// The largest power of ten not above `v`, as the nearest double.
pub(super) fn power_of_ten(v: f64) -> f64 {
    // Parsed rather than computed: `powi` of a negative exponent is not the nearest double.
    let of = |exponent: i32| format!("1e{exponent}").parse().unwrap_or(1.0);
    let exponent = (v.log10().floor() as i32).clamp(-300, 300) + 1;
    (0..3).map(|less| of(exponent - less)).find(|power| *power <= v).unwrap_or(1e-300)
}

/// Ten times `scale`; of a power of ten the nearest double.
pub(super) fn tenfold(scale: f64) -> f64 {
    let exact = power_of_ten(scale * 10.5);
    let is_power = (exact / (scale * 10.0) - 1.0).abs() < 4.0 * f64::EPSILON;
    if is_power { exact } else { scale * 10.0 }
}

/// Grid for decimal text with this number of digits after the point on each axis (at most 15 are
/// kept).
pub fn decimal_grid(decimals: [u32; 3]) -> Grid {
    // Parsed rather than computed: `powi` of a negative exponent is not the nearest double.
    let scale = decimals.map(|d| format!("1e-{}", d.min(15)).parse().unwrap_or(1.0));
    Grid { scale, offset: [0.0; 3] }
}

impl InputGrid {
    pub(super) fn check(&self) -> Result<(), LatticeError> {
        let fail = |what, axis, value| Err(self.unusable(what, axis, value));
        for axis in 0..3 {
            let scale = self.grid.scale[axis];
            if !scale.is_normal() || scale < 0.0 {
                return fail("the scale", axis, scale);
            }
            if !self.grid.offset[axis].is_finite() {
                return fail("the offset", axis, self.grid.offset[axis]);
            }
        }
        Ok(())
    }

    pub(super) fn unusable(&self, what: &'static str, axis: usize, value: f64) -> LatticeError {
        let axis = ['x', 'y', 'z'][axis];
        LatticeError::Unusable { name: self.name.clone(), what, axis, value }
    }

    /// Bounds of one axis if they are numbers, for integers clamped to the range of `i32`.
    pub(super) fn axis_bounds(&self, axis: usize) -> Option<(f64, f64)> {
        let [lo, hi] = self.bounds?.map(|b| b[axis]);
        if !(lo.is_finite() && hi.is_finite() && lo <= hi) {
            return None;
        }
        if self.kind != GridKind::Integer {
            return Some((lo, hi));
        }
        let at = |raw: i32| f64::from(raw) * self.grid.scale[axis] + self.grid.offset[axis];
        Some((lo.clamp(at(i32::MIN), at(i32::MAX)), hi.clamp(at(i32::MIN), at(i32::MAX))))
    }
}
