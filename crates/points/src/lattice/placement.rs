//! Places the coordinates of an input on the lattice.

use super::choice::{Lattice, STEPS_MAX};
use super::grids::{Grid, InputGrid, ORIGIN};
use crate::batch::Rounding;

/// Deviations from a whole step below this are noise of `f64`, not rounding.
const NOISE_STEPS: f64 = 1e-6;
/// Deviations from a coordinate below this, in units in the last place of the coordinate and of the
/// lattice's offset, are noise too ...
const NOISE_ULPS: f64 = 4.0;
/// ... unless they are a larger part of a step than this: then steps are so short that doubles do
/// not tell them apart.
const NOISE_STEPS_MAX: f64 = 0.01;

/// Map of one axis of an input to lattice coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
enum AxisMap {
    Whole { factor: i64, delta: i64 },
    Real { ratio: f64, delta: f64 },
}

/// Places the coordinates of one input on the lattice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    lattice: Lattice,
    axes: [AxisMap; 3],
}

impl AxisMap {
    fn new(lattice: &Lattice, grid: &Grid, axis: usize) -> Self {
        let ratio = grid.scale[axis] / lattice.scale[axis];
        let delta = (grid.offset[axis] - lattice.offset[axis]) / lattice.scale[axis]
            - lattice.shift[axis] as f64
            + ORIGIN as f64;
        let whole = |v: f64| (v - v.round()).abs() < NOISE_STEPS && v.abs() < STEPS_MAX;
        // The product with a raw coordinate of up to 2^31 must stay whole as well.
        let ratio_whole = (ratio - ratio.round()).abs() * ORIGIN as f64 <= NOISE_STEPS * 1e3;
        if ratio_whole && ratio.round() >= 1.0 && ratio < 2f64.powi(31) && whole(delta) {
            Self::Whole { factor: ratio.round() as i64, delta: delta.round() as i64 }
        } else {
            Self::Real { ratio, delta }
        }
    }
}

impl Lattice {
    /// Placement of the coordinates of an input on the lattice.
    pub fn placement(&self, input: &InputGrid) -> Placement {
        let axes = [0, 1, 2].map(|axis| AxisMap::new(self, &input.grid, axis));
        Placement { lattice: *self, axes }
    }
}

impl Placement {
    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Whether no integer coordinate of the input is rounded.
    pub fn is_exact(&self) -> bool {
        self.axes.iter().all(|a| matches!(a, AxisMap::Whole { .. }))
    }

    /// Places raw integer coordinates. `rounding` collects the greatest rounding error, and the
    /// points that do not fit, whose result means nothing.
    pub fn integer(&self, raw: [i32; 3], grid: &Grid, rounding: &mut Rounding) -> [u32; 3] {
        rounding.placed += 1;
        let (mut out, mut off) = ([0; 3], rounding.error_max);
        for axis in 0..3 {
            let placed = match self.axes[axis] {
                AxisMap::Whole { factor, delta } => {
                    u32::try_from(i64::from(raw[axis]) * factor + delta).ok()
                }
                AxisMap::Real { ratio, delta } => {
                    self.round(axis, f64::from(raw[axis]) * ratio + delta, &mut off)
                }
            };
            let Some(placed) = placed else {
                return outside(grid.world(raw), rounding);
            };
            out[axis] = placed;
        }
        rounding.error_max = off;
        out
    }

    /// Places world coordinates (finite); otherwise like [`Placement::integer`].
    pub fn real(&self, world: [f64; 3], rounding: &mut Rounding) -> [u32; 3] {
        rounding.placed += 1;
        let mut out = [0; 3];
        for axis in 0..3 {
            let rounded = self.lattice.steps_axis(axis, world[axis]).round_ties_even();
            if !(0.0..=f64::from(u32::MAX)).contains(&rounded) {
                return outside(world, rounding);
            }
            out[axis] = rounded as u32;
        }
        // Compared in world units: of large step numbers even a millionth exceeds small
        // coordinates.
        let there = self.lattice.world(out);
        for axis in 0..3 {
            let off = (there[axis] - world[axis]).abs();
            let size = world[axis].abs() + self.lattice.offset[axis].abs();
            let noise = size * (NOISE_ULPS * f64::EPSILON);
            if off > noise.min(self.lattice.scale[axis] * NOISE_STEPS_MAX) {
                rounding.error_max = rounding.error_max.max(off);
            }
        }
        out
    }

    fn round(&self, axis: usize, steps: f64, error: &mut f64) -> Option<u32> {
        let rounded = steps.round_ties_even();
        let off = (steps - rounded).abs();
        if off > NOISE_STEPS {
            *error = error.max(off * self.lattice.scale[axis]);
        }
        (0.0..=u32::MAX as f64).contains(&rounded).then_some(rounded as u32)
    }
}

fn outside(world: [f64; 3], rounding: &mut Rounding) -> [u32; 3] {
    rounding.outside.push((rounding.placed - 1, world));
    [0; 3]
}
