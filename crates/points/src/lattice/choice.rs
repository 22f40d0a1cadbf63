//! The lattice and its choice from the grids of the inputs (see [`super`]).

use super::grids::{GridKind, InputGrid, LatticeError, ORIGIN, tenfold};
use crate::spread::{Spread, join};
use serde::{Deserialize, Serialize};

/// Least length of a step that is shortened, in spacings of doubles at the farthest coordinate:
/// their noise is then no rounding ([`super::placement`]).
const TOLD_APART: f64 = 400.0;
/// Free steps on each side of the points, as a multiple of their extent: appended scans lie beside
/// the first.
const ROOM: f64 = 6.0;
/// Greatest step number while choosing: `f64` has no whole steps beyond it.
pub(super) const STEPS_MAX: f64 = 9.0e15;

/// The integer grid of all coordinates of a file: `world = (u - 2^31 + shift) * scale + offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Length of a step on each axis, the file's unit.
    pub scale: [f64; 3],
    /// World coordinate of step 0.
    pub offset: [f64; 3],
    /// Whole steps by which the lattice is moved along the inputs' grid.
    pub shift: [i64; 3],
    /// Units of length per unit of the coordinates, on each axis: metres per degree where the
    /// coordinates are geographic, else 1 ([`Lattice::metric`]).
    pub factor: [f64; 3],
}

impl Default for Lattice {
    fn default() -> Self {
        Self { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3], factor: [1.0; 3] }
    }
}

impl Lattice {
    /// Chooses the lattice for these inputs (see the head of [`super`]).
    ///
    /// # Errors
    /// If an input's scale, offset or bounds are not usable numbers.
    pub fn choose(inputs: &[InputGrid]) -> Result<Self, LatticeError> {
        for input in inputs {
            input.check()?;
        }
        let Some(first) = inputs.iter().min_by(|a, b| a.name.as_bytes().cmp(b.name.as_bytes()))
        else {
            return Ok(Self::default());
        };
        let alike = |i: &InputGrid| {
            i.kind == GridKind::Integer
                && i.grid.scale.map(f64::to_bits) == first.grid.scale.map(f64::to_bits)
                && i.grid.offset.map(f64::to_bits) == first.grid.offset.map(f64::to_bits)
        };
        let mut lattice =
            Self { scale: first.grid.scale, offset: first.grid.offset, ..Self::default() };
        if inputs.iter().all(alike) {
            return Ok(lattice);
        }
        for axis in 0..3 {
            lattice.choose_axis(inputs, axis)?;
        }
        // The integers of LAS keep their step.
        if inputs.iter().all(|input| input.kind != GridKind::Integer) {
            lattice.even_out(inputs);
        }
        Ok(lattice)
    }

    /// Shortens steps by powers of ten, which text and floats have, where they are over ten times
    /// as long as those of another axis, as far as the lattice still has room on all sides and
    /// doubles tell the steps apart.
    fn even_out(&mut self, inputs: &[InputGrid]) {
        let finest = self.scale.into_iter().fold(f64::INFINITY, f64::min);
        for axis in 0..3 {
            let Some((lo, hi)) = extent(inputs, axis) else { continue };
            let mut scale = tenfold(finest);
            let least = lo.abs().max(hi.abs()) * f64::EPSILON * TOLD_APART;
            while scale < least || (hi - lo) / scale * (2.0 * ROOM + 1.0) > 2.0 * ORIGIN as f64 {
                scale = tenfold(scale);
            }
            if scale < self.scale[axis] {
                self.place(axis, scale, (lo, hi));
            }
        }
    }

    /// Narrows the bounds of `inputs`, whose points are distributed as `spreads`, so that strays do
    /// not make the lattice coarser than the inputs. Where the bounds need a coarser step than the
    /// finest of the inputs, the window of the finest step that holds nearly all points of each
    /// input replaces them.
    ///
    /// # Errors
    /// As for [`Lattice::choose`].
    pub fn narrow(inputs: &mut [InputGrid], spreads: &[Spread]) -> Result<(), LatticeError> {
        let chosen = Self::choose(inputs)?;
        let mut window = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        let core = spreads.iter().filter_map(Spread::core).reduce(join);
        let Some([low, high]) = core else { return Ok(()) };
        for axis in 0..3 {
            let finest = inputs.iter().map(|i| i.grid.scale[axis]).fold(f64::INFINITY, f64::min);
            let mut scale = finest;
            while scale < chosen.scale[axis] {
                let steps = [low, high].map(|c| (c[axis] - chosen.offset[axis]) / scale);
                if fits(steps[0].floor(), steps[1].ceil()) {
                    let middle = low[axis] / 2.0 + high[axis] / 2.0;
                    let half = scale * (ORIGIN - 2) as f64;
                    (window[0][axis], window[1][axis]) = (middle - half, middle + half);
                    break;
                }
                scale = tenfold(scale);
            }
        }
        for (input, spread) in inputs.iter_mut().zip(spreads) {
            input.bounds = spread.bounds_within(window).or(input.bounds);
        }
        Ok(())
    }

    fn choose_axis(&mut self, inputs: &[InputGrid], axis: usize) -> Result<(), LatticeError> {
        // A bound so far from the offset that the difference overflows: no scale makes steps of
        // that.
        let offset = self.offset[axis];
        for input in inputs {
            let bounds = input.axis_bounds(axis).map(|(lo, hi)| [lo, hi]);
            let far = bounds.into_iter().flatten().find(|bound| !(bound - offset).is_finite());
            if let Some(value) = far {
                return Err(input.unusable("a bound", axis, value));
            }
        }
        let scale = inputs.iter().map(|i| i.grid.scale[axis]).fold(f64::INFINITY, f64::min);
        self.scale[axis] = scale;
        if let Some(extent) = extent(inputs, axis) {
            self.place(axis, scale, extent);
        }
        Ok(())
    }

    /// Sets the step of an axis to `scale`, or to so many tens of it that the lattice holds the
    /// extent of the points, and moves the lattice to them if they would lie at its end.
    fn place(&mut self, axis: usize, mut scale: f64, (low, high): (f64, f64)) {
        let offset = self.offset[axis];
        let steps = |scale: f64| ((low - offset) / scale).floor()..((high - offset) / scale).ceil();
        let mut range = steps(scale);
        while !fits(range.start, range.end) {
            scale = tenfold(scale);
            range = steps(scale);
        }
        self.scale[axis] = scale;
        let room = (range.end - range.start) * ROOM;
        if range.start - room < -(ORIGIN as f64) || range.end + room >= ORIGIN as f64 {
            self.shift[axis] = ((range.start + range.end) / 2.0).floor() as i64;
        }
    }

    /// Whether lengths are measured in another unit than the coordinates.
    pub fn is_scaled(&self) -> bool {
        self.factor != [1.0; 3]
    }

    /// The lattice on which lengths are measured: its world coordinates are those of this lattice
    /// times `factor`. Equal to this lattice, bit by bit, where the factors are 1.
    #[must_use]
    pub fn metric(&self) -> Self {
        let (scale, offset) = (self.measure(self.scale), self.measure(self.offset));
        Self { scale, offset, shift: self.shift, factor: [1.0; 3] }
    }

    /// Place or vector in world coordinates, in those of the metric lattice.
    pub fn measure(&self, world: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| world[i] * self.factor[i])
    }

    /// Inverse of [`Lattice::measure`].
    pub fn unmeasure(&self, metric: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| metric[i] / self.factor[i])
    }

    /// World coordinates of a lattice point.
    pub fn world(&self, p: [u32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|i| {
            (i64::from(p[i]) - ORIGIN + self.shift[i]) as f64 * self.scale[i] + self.offset[i]
        })
    }

    /// World coordinate of a real position along one axis of the lattice (0 to 2^32).
    pub fn world_axis(&self, axis: usize, u: f64) -> f64 {
        (u - ORIGIN as f64 + self.shift[axis] as f64) * self.scale[axis] + self.offset[axis]
    }

    /// Position of a world coordinate along one axis of the lattice, in steps; neither rounded nor
    /// bounded.
    pub fn steps_axis(&self, axis: usize, world: f64) -> f64 {
        (world - self.offset[axis]) / self.scale[axis] - self.shift[axis] as f64 + ORIGIN as f64
    }
}

/// The least and the greatest coordinate of the inputs on an axis, if any is known.
fn extent(inputs: &[InputGrid], axis: usize) -> Option<(f64, f64)> {
    let bounds = inputs.iter().filter_map(|input| input.axis_bounds(axis));
    bounds.reduce(|(low, high), (a, b)| (low.min(a), high.max(b)))
}

/// Whether a lattice holds the steps from `lo` to `hi`.
fn fits(lo: f64, hi: f64) -> bool {
    hi - lo <= u32::MAX as f64 - 2.0 && lo.abs().max(hi.abs()) < STEPS_MAX
}
