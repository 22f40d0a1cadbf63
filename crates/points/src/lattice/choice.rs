//! The lattice and its choice from the grids of the inputs (see [`super`]).

use super::grids::{GridKind, InputGrid, LatticeError, ORIGIN, tenfold};
use crate::spread::{Spread, join};

/// Free steps on each side of the points, as a multiple of their extent: appended scans lie beside
/// the first.
const ROOM: f64 = 6.0;
/// Greatest step number while choosing: `f64` has no whole steps beyond it.
pub(super) const STEPS_MAX: f64 = 9.0e15;

/// The integer grid of all coordinates of a file: `world = (u - 2^31 + shift) * scale + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
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
        Ok(lattice)
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
        let mut scale = inputs.iter().map(|i| i.grid.scale[axis]).fold(f64::INFINITY, f64::min);
        let bounds = inputs.iter().filter_map(|i| i.axis_bounds(axis));
        let (lo, hi) = bounds
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), (a, b)| (lo.min(a), hi.max(b)));
        self.scale[axis] = scale;
        if lo > hi {
            return Ok(());
        }
        let steps = |scale: f64| (((lo - offset) / scale).floor(), ((hi - offset) / scale).ceil());
        let (mut lo, mut hi) = steps(scale);
        while !fits(lo, hi) {
            scale = tenfold(scale);
            (lo, hi) = steps(scale);
        }
        self.scale[axis] = scale;
        let room = (hi - lo) * ROOM;
        if lo - room < -(ORIGIN as f64) || hi + room >= ORIGIN as f64 {
            self.shift[axis] = ((lo + hi) / 2.0).floor() as i64;
        }
        Ok(())
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

/// Whether a lattice holds the steps from `lo` to `hi`.
fn fits(lo: f64, hi: f64) -> bool {
    hi - lo <= u32::MAX as f64 - 2.0 && lo.abs().max(hi.abs()) < STEPS_MAX
}
