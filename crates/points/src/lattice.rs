//! The lattice: the integer grid of all points of a file, its choice from the grids of the inputs,
//! and the placement of an input's coordinates on it.
//!
//! If all inputs are integers of bit-equal scale and offset, a lattice coordinate is the raw `i32`
//! plus 2^31. Otherwise the lattice has the finest scale of each axis and the offset of the first
//! input in byte order of names, moved by whole steps to where all inputs fit; whole ratios and
//! differences stay exact, other values are rounded half to even. If the extent exceeds 2^32 steps,
//! the scale grows by tens.

use serde::{Deserialize, Serialize};

/// Half the lattice: coordinate of raw 0 of a LAS file.
pub const ORIGIN: i64 = 1 << 31;
/// Deviations from a whole step below this are noise of `f64`, not rounding.
const NOISE_STEPS: f64 = 1e-6;
/// Deviations from a coordinate below this are noise too: in units in the last place of the
/// coordinate and of the lattice's offset.
const NOISE_ULPS: f64 = 4.0;
/// Greatest step number while choosing: `f64` has no whole steps beyond it.
const STEPS_MAX: f64 = 9.0e15;

/// An integer grid: `world = raw * scale + offset` on each axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Length of a step in the file's unit.
    pub scale: [f64; 3],
    /// World coordinate of raw 0.
    pub offset: [f64; 3],
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

/// Grid for floating-point coordinates within these bounds: one power of two for all axes, the
/// finest at which the longest extent stays within 2^31 steps and every coordinate within 2^52.
/// Values on coarser binary grids, such as all `f32` of similar size, stay exact.
pub fn float_grid(bounds: [[f64; 3]; 2]) -> Grid {
    let extent = (0..3).map(|i| bounds[1][i] - bounds[0][i]).fold(0.0, f64::max);
    let largest = bounds.iter().flatten().fold(0.0f64, |m, c| m.max(c.abs()));
    let by_extent = if extent > 0.0 { ceil_log2(extent) - 31 } else { ceil_log2(largest) - 30 };
    let exponent = by_extent.max(ceil_log2(largest) - 52).clamp(-1000, 1000);
    Grid { scale: [2f64.powi(exponent); 3], offset: [0.0; 3] }
}

/// Grid for decimal text with this number of digits after the point on each axis (at most 15 are
/// kept).
pub fn decimal_grid(decimals: [u32; 3]) -> Grid {
    // Parsed rather than computed: `powi` of a negative exponent is not the nearest double.
    let scale = decimals.map(|d| format!("1e-{}", d.min(15)).parse().unwrap_or(1.0));
    Grid { scale, offset: [0.0; 3] }
}

/// The least `e` with `v <= 2^e`; -30 for zero.
fn ceil_log2(v: f64) -> i32 {
    if v <= 0.0 {
        return -30;
    }
    let mut e = v.log2().ceil() as i32;
    while 2f64.powi(e) < v {
        e += 1;
    }
    e
}

/// The integer grid of all coordinates of a file: `world = (u - 2^31 + shift) * scale + offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Length of a step on each axis, the file's unit.
    pub scale: [f64; 3],
    /// World coordinate of step 0.
    pub offset: [f64; 3],
    /// Whole steps by which the lattice is moved along the inputs' grid.
    pub shift: [i64; 3],
}

impl Default for Lattice {
    fn default() -> Self {
        Self { scale: [1.0; 3], offset: [0.0; 3], shift: [0; 3] }
    }
}

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

impl Lattice {
    /// Chooses the lattice for these inputs (see the head of this module).
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
            Self { scale: first.grid.scale, offset: first.grid.offset, shift: [0; 3] };
        if inputs.iter().all(alike) {
            return Ok(lattice);
        }
        for axis in 0..3 {
            lattice.choose_axis(inputs, axis)?;
        }
        Ok(lattice)
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
        let fits = |(lo, hi): (f64, f64)| {
            hi - lo <= u32::MAX as f64 - 2.0 && lo.abs().max(hi.abs()) < STEPS_MAX
        };
        while !fits(steps(scale)) {
            scale *= 10.0;
        }
        self.scale[axis] = scale;
        let (lo, hi) = steps(scale);
        if lo < -(ORIGIN as f64) || hi >= ORIGIN as f64 {
            self.shift[axis] = ((lo + hi) / 2.0).floor() as i64;
        }
        Ok(())
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

    /// Placement of the coordinates of an input on the lattice.
    pub fn placement(&self, input: &InputGrid) -> Placement {
        let axes = [0, 1, 2].map(|axis| self.axis_map(&input.grid, axis));
        Placement { lattice: *self, axes, refuses: false }
    }

    fn axis_map(&self, grid: &Grid, axis: usize) -> AxisMap {
        let ratio = grid.scale[axis] / self.scale[axis];
        let delta = (grid.offset[axis] - self.offset[axis]) / self.scale[axis]
            - self.shift[axis] as f64
            + ORIGIN as f64;
        let whole = |v: f64| (v - v.round()).abs() < NOISE_STEPS && v.abs() < STEPS_MAX;
        // The product with a raw coordinate of up to 2^31 must stay whole as well.
        let ratio_whole = (ratio - ratio.round()).abs() * ORIGIN as f64 <= NOISE_STEPS * 1e3;
        if ratio_whole && ratio.round() >= 1.0 && ratio < 2f64.powi(31) && whole(delta) {
            AxisMap::Whole { factor: ratio.round() as i64, delta: delta.round() as i64 }
        } else {
            AxisMap::Real { ratio, delta }
        }
    }
}

impl InputGrid {
    fn check(&self) -> Result<(), LatticeError> {
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

    fn unusable(&self, what: &'static str, axis: usize, value: f64) -> LatticeError {
        let axis = ['x', 'y', 'z'][axis];
        LatticeError::Unusable { name: self.name.clone(), what, axis, value }
    }

    /// Bounds of one axis if they are numbers, for integers clamped to the range of `i32`.
    fn axis_bounds(&self, axis: usize) -> Option<(f64, f64)> {
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
    /// Whether points that do not fit are placed at [`REFUSED`] instead of causing an error.
    refuses: bool,
}

/// Position of refused points: the last point of the lattice, which then holds no other point.
pub const REFUSED: [u32; 3] = [u32::MAX; 3];

/// A point that does not fit the lattice that was chosen from the headers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OffLattice {
    /// World coordinates.
    pub world: [f64; 3],
}

impl Placement {
    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Placement on a lattice that cannot change any more: points that do not fit are placed at
    /// [`REFUSED`], for the caller to leave out, and cause no error.
    pub fn refusing(self) -> Self {
        Self { refuses: true, ..self }
    }

    /// Whether no integer coordinate of the input is rounded.
    pub fn is_exact(&self) -> bool {
        self.axes.iter().all(|a| matches!(a, AxisMap::Whole { .. }))
    }

    /// Places raw integer coordinates; `error` collects the greatest rounding error in world units.
    ///
    /// # Errors
    /// [`OffLattice`] if the point does not fit.
    pub fn integer(
        &self,
        raw: [i32; 3],
        grid: &Grid,
        error: &mut f64,
    ) -> Result<[u32; 3], OffLattice> {
        let (mut out, mut off) = ([0; 3], *error);
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
                return self
                    .off(|| [0, 1, 2].map(|i| f64::from(raw[i]) * grid.scale[i] + grid.offset[i]));
            };
            out[axis] = placed;
        }
        *error = off;
        Ok(out)
    }

    /// Places world coordinates (finite); `error` as in [`Placement::integer`].
    ///
    /// # Errors
    /// [`OffLattice`] if the point does not fit.
    pub fn real(&self, world: [f64; 3], error: &mut f64) -> Result<[u32; 3], OffLattice> {
        let mut out = [0; 3];
        for axis in 0..3 {
            let rounded = self.lattice.steps_axis(axis, world[axis]).round_ties_even();
            if !(0.0..=f64::from(u32::MAX)).contains(&rounded) {
                return self.off(|| world);
            }
            out[axis] = rounded as u32;
        }
        // Compared in world units: of large step numbers even a millionth exceeds small
        // coordinates.
        let there = self.lattice.world(out);
        for axis in 0..3 {
            let off = (there[axis] - world[axis]).abs();
            let size = world[axis].abs() + self.lattice.offset[axis].abs();
            if off > size * (NOISE_ULPS * f64::EPSILON) {
                *error = error.max(off);
            }
        }
        Ok(out)
    }

    /// Result for a point that does not fit.
    fn off(&self, world: impl FnOnce() -> [f64; 3]) -> Result<[u32; 3], OffLattice> {
        if self.refuses { Ok(REFUSED) } else { Err(OffLattice { world: world() }) }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn input(name: &str, scale: f64, offset: f64, bounds: (f64, f64)) -> InputGrid {
        InputGrid {
            name: name.into(),
            kind: GridKind::Integer,
            grid: Grid { scale: [scale; 3], offset: [offset; 3] },
            bounds: Some([[bounds.0; 3], [bounds.1; 3]]),
        }
    }

    #[test]
    fn equal_grids_keep_the_files_own_integers() {
        let a = input("b.las", 0.01, 500_000.0, (0.0, 1e300));
        let lattice = Lattice::choose(&[a.clone(), a.clone()]).unwrap();
        assert_eq!(
            (lattice.scale, lattice.offset, lattice.shift),
            ([0.01; 3], [500_000.0; 3], [0; 3])
        );
        let placement = lattice.placement(&a);
        assert!(placement.is_exact());
        let mut error = 0.0;
        for raw in [i32::MIN, -1, 0, 7, i32::MAX] {
            let p = placement.integer([raw; 3], &a.grid, &mut error).unwrap();
            assert_eq!(i64::from(p[0]), i64::from(raw) + ORIGIN);
            assert_eq!(lattice.world(p)[0], f64::from(raw) * 0.01 + 500_000.0);
        }
        assert_eq!(error, 0.0);
    }

    #[test]
    fn whole_ratios_and_differences_stay_exact() {
        let fine = input("b.las", 0.001, 1_000.0, (900.0, 1_100.0));
        let coarse = input("a.las", 0.01, 2_000.5, (1_900.0, 2_100.0));
        let lattice = Lattice::choose(&[fine.clone(), coarse.clone()]).unwrap();
        assert_eq!((lattice.scale[0], lattice.offset[0]), (0.001, 2_000.5));
        let mut error = 0.0;
        for grid in [&fine, &coarse] {
            let placement = lattice.placement(grid);
            assert!(placement.is_exact());
            let p = placement.integer([-1234; 3], &grid.grid, &mut error).unwrap();
            let want = -1234.0 * grid.grid.scale[0] + grid.grid.offset[0];
            assert!((lattice.world(p)[0] - want).abs() < 1e-9);
        }
        assert_eq!(error, 0.0);
    }

    #[test]
    fn far_apart_inputs_move_then_coarsen_the_lattice() {
        let a = input("a", 0.001, 0.0, (0.0, 10.0));
        let far = input("b", 0.001, 3_000_000.0, (3_000_000.0, 3_000_010.0));
        let moved = Lattice::choose(&[a.clone(), far.clone()]).unwrap();
        assert_eq!(moved.scale[0], 0.001);
        assert_ne!(moved.shift[0], 0);
        let very_far = input("c", 0.001, 30_000_000.0, (30_000_000.0, 30_000_010.0));
        let coarse = Lattice::choose(&[a.clone(), very_far.clone()]).unwrap();
        assert_eq!(coarse.scale[0], 0.01);
        let mut error = 0.0;
        let p = coarse.placement(&very_far).integer([4567; 3], &very_far.grid, &mut error).unwrap();
        assert!((coarse.world(p)[0] - 30_000_004.57).abs() < 1e-6);
        assert!((error - 0.003).abs() < 1e-8, "{error}");
    }

    #[test]
    fn inputs_too_far_apart_for_any_scale_are_refused() {
        let a = input("a", 0.001, 1.7e308, (1.7e308, 1.7e308));
        let b = input("b", 0.001, -1.7e308, (-1.7e308, -1.7e308));
        let error = Lattice::choose(&[a.clone(), b.clone()]).unwrap_err().to_string();
        assert!(error.starts_with("b: a bound of axis x is -"), "{error}");
        // Within that range there is a lattice.
        let half = input("c", 0.001, -1.0, (-1.0, 1.0));
        assert!(Lattice::choose(&[a, half]).unwrap().scale[0] > 1e290);
    }

    #[test]
    fn a_point_outside_the_hint_is_reported_not_wrapped() {
        let a = input("a", 0.001, 0.0, (0.0, 10.0));
        let b = input("b", 0.002, 0.0, (0.0, 10.0));
        let lattice = Lattice::choose(&[a, b.clone()]).unwrap();
        let off = lattice.placement(&b).integer([i32::MAX; 3], &b.grid, &mut 0.0).unwrap_err();
        assert!((off.world[0] - f64::from(i32::MAX) * 0.002).abs() < 1e-6);
    }

    #[test]
    fn a_refusing_placement_marks_points_that_do_not_fit_and_counts_no_rounding() {
        let a = input("a", 0.001, 0.0, (0.0, 10.0));
        let b = input("b", 0.0015, 0.0, (0.0, 10.0));
        let lattice = Lattice::choose(std::slice::from_ref(&a)).unwrap();
        let placement = lattice.placement(&b).refusing();
        let mut error = 0.0;
        for off in [[7, 7, i32::MAX], [7, i32::MIN, 7]] {
            assert_eq!(placement.integer(off, &b.grid, &mut error).unwrap(), REFUSED);
        }
        assert_eq!(placement.real([0.0005, 1.0, 1e9], &mut error).unwrap(), REFUSED);
        assert_eq!(error, 0.0);
        assert_ne!(placement.integer([7; 3], &b.grid, &mut error).unwrap(), REFUSED);
        assert!((error - 0.0005).abs() < 1e-9, "{error}");
    }

    #[test]
    fn damaged_scales_are_refused_by_name() {
        for scale in [f64::NAN, 0.0, -0.01, f64::INFINITY, 1e-320] {
            let error = Lattice::choose(&[input("bad.las", scale, 0.0, (0.0, 1.0))]).unwrap_err();
            assert!(error.to_string().starts_with("bad.las: the scale of axis x"), "{error}");
        }
    }

    #[test]
    fn hostile_bounds_end_in_a_lattice() {
        for bounds in [
            [[-1e308; 3], [1e308; 3]],
            [[1e-300; 3], [2e-300; 3]],
            [[0.0; 3], [0.0; 3]],
            [[1e18; 3], [1e18 + 256.0; 3]],
        ] {
            let input = InputGrid {
                name: "f".into(),
                kind: GridKind::Float,
                grid: float_grid(bounds),
                bounds: Some(bounds),
            };
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            for b in bounds {
                lattice.placement(&input).real(b, &mut 0.0).unwrap();
            }
        }
    }

    #[test]
    fn decimal_scales_are_the_nearest_doubles() {
        assert_eq!(decimal_grid([3, 2, 0]).scale, [0.001, 0.01, 1.0]);
    }

    proptest! {
        #[test]
        fn floats_of_like_size_stay_exact(raw in prop::collection::vec([1.0f32..2.0, 1.0f32..2.0, 1.0f32..2.0], 1..20), exponent in -20i32..20) {
            let points: Vec<[f64; 3]> = raw.iter().map(|p| p.map(|c| f64::from(c) * 2f64.powi(exponent))).collect();
            let mut bounds = [points[0], points[0]];
            for p in &points { for i in 0..3 { bounds[0][i] = bounds[0][i].min(p[i]); bounds[1][i] = bounds[1][i].max(p[i]); } }
            let input = InputGrid { name: "f".into(), kind: GridKind::Float, grid: float_grid(bounds), bounds: Some(bounds) };
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            let mut error = 0.0;
            for p in &points {
                let placed = lattice.placement(&input).real(*p, &mut error).unwrap();
                prop_assert_eq!(lattice.world(placed), *p);
            }
            prop_assert_eq!(error, 0.0);
        }

        #[test]
        fn rounding_is_never_more_than_half_a_step(a in -1e6f64..1e6, b in -1e6f64..1e6, t in 0.0f64..1.0) {
            let bounds = [[a.min(b); 3], [a.max(b); 3]];
            let input = InputGrid { name: "f".into(), kind: GridKind::Float, grid: float_grid(bounds), bounds: Some(bounds) };
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            let w = bounds[0][0] + t * (bounds[1][0] - bounds[0][0]);
            let mut error = 0.0;
            let p = lattice.placement(&input).real([w; 3], &mut error).unwrap();
            prop_assert!(error <= lattice.scale[0] * (0.5 + NOISE_STEPS));
            prop_assert!((lattice.world(p)[0] - w).abs() <= lattice.scale[0] * 0.5 + 1e-9);
        }

        #[test]
        fn no_rounding_goes_unreported(far in -1e18f64..1e18, near in -100.0f64..100.0, decimals in 0u32..8) {
            // Floats next to one that is far away.
            let bounds = [[far.min(near); 3], [far.max(near); 3]];
            let float = InputGrid { name: "f".into(), kind: GridKind::Float, grid: float_grid(bounds), bounds: Some(bounds) };
            let lattice = Lattice::choose(std::slice::from_ref(&float)).unwrap();
            let mut error = 0.0;
            let p = lattice.placement(&float).real([near; 3], &mut error).unwrap();
            prop_assert!((lattice.world(p)[0] - near).abs() <= error + near.abs() * 4.0 * f64::EPSILON);
            // Decimals are placed exactly, despite the rounding of doubles.
            let text: f64 = format!("{near:.*}", decimals as usize).parse().unwrap();
            let decimal = InputGrid { name: "d".into(), kind: GridKind::Decimal, grid: decimal_grid([decimals; 3]), bounds: Some([[-100.0; 3], [100.0; 3]]) };
            let lattice = Lattice::choose(std::slice::from_ref(&decimal)).unwrap();
            let mut error = 0.0;
            lattice.placement(&decimal).real([text; 3], &mut error).unwrap();
            prop_assert_eq!(error, 0.0);
        }
    }
}
