//! The lattice: the integer grid of all points of a file, its choice from the grids of the inputs,
//! and the placement of an input's coordinates on it.
//!
//! If all inputs are integers of bit-equal scale and offset, a lattice coordinate is the raw `i32`
//! plus 2^31. Otherwise the lattice has the finest scale of each axis and the offset of the first
//! input in byte order of names, moved by whole steps to where all inputs fit; whole ratios and
//! differences stay exact, other values are rounded half to even. If the extent exceeds 2^32 steps,
//! the scale grows by tens. Steps of text and floats differ by at most ten between axes where 32
//! bits allow it, since cells of the octree are cubes of steps. Points far from nearly all others
//! ([`crate::spread`]) do not count: they may lie outside of the lattice.
//!
//! Coordinates may be degrees: the lattice then has the metres of a degree on each axis, and
//! lengths are measured on its metric lattice ([`Lattice::metric`]).

mod choice;
mod grids;
mod placement;

pub use choice::Lattice;
pub use grids::{Grid, GridKind, InputGrid, LatticeError, ORIGIN};
pub use grids::{decimal_grid, float_grid, float_grid_within};
pub use placement::Placement;

#[cfg(test)]
mod tests {
    use super::grids::{power_of_ten, tenfold};
    use super::*;
    use crate::Rounding;
    use crate::Spread;
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
        let mut error = Rounding::default();
        for raw in [i32::MIN, -1, 0, 7, i32::MAX] {
            let p = placement.integer([raw; 3], &a.grid, &mut error);
            assert_eq!(i64::from(p[0]), i64::from(raw) + ORIGIN);
            assert_eq!(lattice.world(p)[0], f64::from(raw) * 0.01 + 500_000.0);
        }
        assert_eq!(error.error_max, 0.0);
    }

    #[test]
    fn the_metric_lattice_has_the_same_points_in_metres() {
        let exact = Lattice {
            scale: [1e-7, 1e-7, 0.001],
            offset: [8.5, 47.25, -0.125],
            shift: [0, -7, 1 << 33],
            factor: [75_840.0, 111_176.0, 1.0],
        };
        let metric = exact.metric();
        assert!(exact.is_scaled() && !metric.is_scaled());
        for p in [[0; 3], [1, 1 << 31, u32::MAX], [u32::MAX; 3]] {
            let (world, metres) = (exact.world(p), metric.world(p));
            for axis in 0..3 {
                let size = metres[axis].abs() + metric.offset[axis].abs();
                let off = (metres[axis] - world[axis] * exact.factor[axis]).abs();
                assert!(off <= 8.0 * f64::EPSILON * size, "{axis}: {off:e}");
                let back = exact.unmeasure(metres)[axis];
                assert!((back - world[axis]).abs() <= 8.0 * f64::EPSILON * size, "{back}");
            }
        }
        // Without factors it is the lattice itself, bit by bit.
        let plain = Lattice { factor: [1.0; 3], ..exact };
        assert_eq!(plain.metric(), plain);
        assert_eq!(plain.measure([0.1, -0.0, 1e300]), [0.1, -0.0, 1e300]);
    }

    #[test]
    fn whole_ratios_and_differences_stay_exact() {
        let fine = input("b.las", 0.001, 1_000.0, (900.0, 1_100.0));
        let coarse = input("a.las", 0.01, 2_000.5, (1_900.0, 2_100.0));
        let lattice = Lattice::choose(&[fine.clone(), coarse.clone()]).unwrap();
        assert_eq!((lattice.scale[0], lattice.offset[0]), (0.001, 2_000.5));
        let mut error = Rounding::default();
        for grid in [&fine, &coarse] {
            let placement = lattice.placement(grid);
            assert!(placement.is_exact());
            let p = placement.integer([-1234; 3], &grid.grid, &mut error);
            let want = -1234.0 * grid.grid.scale[0] + grid.grid.offset[0];
            assert!((lattice.world(p)[0] - want).abs() < 1e-9);
        }
        assert_eq!(error.error_max, 0.0);
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
        let mut error = Rounding::default();
        let p = coarse.placement(&very_far).integer([4567; 3], &very_far.grid, &mut error);
        assert!((coarse.world(p)[0] - 30_000_004.57).abs() < 1e-6);
        assert!((error.error_max - 0.003).abs() < 1e-8, "{error:?}");
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

    fn decimal(decimals: [u32; 3], high: [f64; 3]) -> InputGrid {
        let grid = decimal_grid(decimals);
        InputGrid {
            name: "t".into(),
            kind: GridKind::Decimal,
            grid,
            bounds: Some([[0.0; 3], high]),
        }
    }

    #[test]
    fn steps_of_text_are_about_cubes() {
        for (decimals, high, scale) in [
            ([3, 3, 4], [9e4, 9e4, 900.0], [1e-3, 1e-3, 1e-4]),
            ([0, 2, 5], [90.0, 90.0, 900.0], [1e-4, 1e-4, 1e-5]),
            ([9, 1, 1], [1.0, 1.0, 1.0], [1e-9, 1e-8, 1e-8]),
            // As far as there is room.
            ([2, 2, 7], [800.0, 80.0, 1.0], [1e-5, 1e-6, 1e-7]),
            ([2, 2, 7], [9e6, 9e6, 1.0], [1e-2, 1e-2, 1e-7]),
        ] {
            let input = decimal(decimals, high);
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            assert_eq!(lattice.scale, scale, "{decimals:?} {high:?}");
            let mut rounding = Rounding::default();
            let placed = lattice.placement(&input).real([0.0; 3], &mut rounding);
            assert_eq!((lattice.world(placed), rounding.error_max), ([0.0; 3], 0.0));
            // Scans beside the first still find room.
            for axis in (0..3).filter(|&i| lattice.scale[i] < input.grid.scale[i]) {
                let free = lattice.steps_axis(axis, 6.9 * high[axis]);
                assert!(free < 2f64.powi(32), "{decimals:?} {high:?}: {free}");
            }
        }
        // The integers of LAS are kept as they are.
        let las = InputGrid { kind: GridKind::Integer, ..decimal([2, 2, 7], [800.0, 80.0, 1.0]) };
        assert_eq!(Lattice::choose(&[las]).unwrap().scale, [1e-2, 1e-2, 1e-7]);
    }

    #[test]
    fn points_that_do_not_fit_are_set_aside_and_count_no_rounding() {
        let a = input("a", 0.001, 0.0, (0.0, 10.0));
        let b = input("b", 0.0015, 0.0, (0.0, 10.0));
        let lattice = Lattice::choose(std::slice::from_ref(&a)).unwrap();
        let placement = lattice.placement(&b);
        let mut rounding = Rounding::default();
        for off in [[7, 7, i32::MAX], [7, i32::MIN, 7]] {
            placement.integer(off, &b.grid, &mut rounding);
        }
        placement.real([0.0005, 1.0, 1e9], &mut rounding);
        assert_eq!(rounding.error_max, 0.0);
        let far = f64::from(i32::MAX) * 0.0015;
        assert_eq!(rounding.outside[0], (0, [7.0 * 0.0015, 7.0 * 0.0015, far]));
        assert_eq!(rounding.outside[2], (2, [0.0005, 1.0, 1e9]));
        placement.integer([7; 3], &b.grid, &mut rounding);
        assert_eq!((rounding.placed, rounding.outside.len()), (4, 3));
        assert!((rounding.error_max - 0.0005).abs() < 1e-9, "{rounding:?}");
    }

    #[test]
    fn damaged_scales_are_refused_by_name() {
        for scale in [f64::NAN, 0.0, -0.01, f64::INFINITY, 1e-320] {
            let error = Lattice::choose(&[input("bad.las", scale, 0.0, (0.0, 1.0))]).unwrap_err();
            assert!(error.to_string().starts_with("bad.las: the scale of axis x"), "{error}");
        }
    }

    fn floats(points: &[[f64; 3]], is_single: bool) -> InputGrid {
        let mut spread = Spread::default();
        points.iter().for_each(|p| spread.add(*p));
        let (grid, bounds) = float_grid(&spread, is_single);
        InputGrid { name: "f".into(), kind: GridKind::Float, grid, bounds }
    }

    #[test]
    fn hostile_bounds_end_in_a_lattice() {
        for bounds in [
            [[-1e308; 3], [1e308; 3]],
            [[1e-300; 3], [2e-300; 3]],
            [[0.0; 3], [0.0; 3]],
            [[1e18; 3], [1e18 + 256.0; 3]],
        ] {
            for is_single in [false, true] {
                let input = floats(&bounds, is_single);
                let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
                let mut rounding = Rounding::default();
                for b in bounds {
                    lattice.placement(&input).real(b, &mut rounding);
                }
                assert!(rounding.outside.is_empty(), "{bounds:?}");
            }
        }
    }

    #[test]
    fn floats_get_decimal_steps_and_room_on_all_sides() {
        let room = [[-4.0, 0.0, 0.0], [4.0, 6.0, 3.0]];
        for (offset, is_single, step) in [
            (0.0, true, 1e-7),
            (0.0, false, 1e-7),
            (500_000.0, true, 0.01),
            (500_000.0, false, 1e-7),
            (5e9, false, 1e-7),
        ] {
            let points = room.map(|p| p.map(|c| c + offset));
            let input = floats(&points, is_single);
            assert_eq!(input.grid.scale, [step; 3], "{offset} {is_single}");
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            for axis in 0..3 {
                let [low, high] = points.map(|p| lattice.steps_axis(axis, p[axis]));
                let free = low.min(f64::from(u32::MAX) - high);
                assert!(free > 5.9 * (high - low), "{offset} {is_single}: {low} {high}");
            }
        }
    }

    #[test]
    fn a_stray_changes_no_step() {
        let room: Vec<_> = (0..1000).map(|i| [0.008 * f64::from(i), 1.0, 3.0]).collect();
        for stray in [1e9, 60_000.0, 1e30, f64::from(f32::MAX)] {
            for is_single in [false, true] {
                let with = [room.clone(), vec![[stray; 3]]].concat();
                let (alone, with) = (floats(&room, is_single), floats(&with, is_single));
                assert_eq!((alone.grid, alone.bounds), (with.grid, with.bounds), "{stray}");
            }
        }
    }

    #[test]
    fn doubles_next_to_each_other_stay_apart() {
        let mut at = 5_403_586.1_f64;
        let points = std::iter::repeat_with(|| {
            at = at.next_up();
            [at, 1.0, 1.0]
        });
        let points: Vec<_> = points.take(8).collect();
        let input = floats(&points, false);
        let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
        let mut rounding = Rounding::default();
        for p in points {
            let placed = lattice.placement(&input).real(p, &mut rounding);
            assert_eq!(lattice.world(placed), p);
        }
        assert_eq!(rounding.error_max, 0.0);
    }

    #[test]
    fn scales_that_grow_by_tens_stay_the_nearest_doubles() {
        let mut scale = 1e-15;
        for exponent in -14..20 {
            scale = tenfold(scale);
            assert_eq!(scale, format!("1e{exponent}").parse::<f64>().unwrap());
        }
        assert_eq!(tenfold(0.0254), 0.254);
        assert_eq!((power_of_ten(1e-3), power_of_ten(9.99e-4)), (1e-3, 1e-4));
    }

    #[test]
    fn decimal_scales_are_the_nearest_doubles() {
        assert_eq!(decimal_grid([3, 2, 0]).scale, [0.001, 0.01, 1.0]);
    }

    proptest! {
        #[test]
        fn floats_are_rounded_by_at_most_half_a_step(
            raw in prop::collection::vec([-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0], 1..20),
            exponent in -20i32..20,
            is_single: bool,
        ) {
            let size = 2f64.powi(exponent);
            let points: Vec<_> = raw.iter().map(|p| p.map(|c| f64::from(c) * size)).collect();
            let input = floats(&points, is_single);
            let lattice = Lattice::choose(std::slice::from_ref(&input)).unwrap();
            let mut rounding = Rounding::default();
            for p in &points {
                let placed = lattice.placement(&input).real(*p, &mut rounding);
                for (there, own) in lattice.world(placed).into_iter().zip(*p) {
                    prop_assert!((there - own).abs() <= lattice.scale[0] * 0.5001);
                }
            }
            prop_assert!(rounding.error_max <= lattice.scale[0] * 0.5001);
            // No coarser than the floats themselves.
            let largest = points.iter().flatten().fold(0.0f64, |m, c| m.max(c.abs()));
            prop_assert!(lattice.scale[0] <= largest * 2f64.powi(-22));
            prop_assert!(rounding.outside.is_empty());
        }

        #[test]
        fn no_rounding_goes_unreported(far in -1e18f64..1e18, near in -100.0f64..100.0, decimals in 0u32..8) {
            // Floats next to one that is far away.
            let float = floats(&[[far; 3], [near; 3]], false);
            let lattice = Lattice::choose(std::slice::from_ref(&float)).unwrap();
            let mut rounding = Rounding::default();
            let p = lattice.placement(&float).real([near; 3], &mut rounding);
            let noise = near.abs() * 4.0 * f64::EPSILON;
            prop_assert!((lattice.world(p)[0] - near).abs() <= rounding.error_max + noise);
            // Decimals are placed exactly, despite the rounding of doubles.
            let text: f64 = format!("{near:.*}", decimals as usize).parse().unwrap();
            let decimal = InputGrid { name: "d".into(), kind: GridKind::Decimal, grid: decimal_grid([decimals; 3]), bounds: Some([[-100.0; 3], [100.0; 3]]) };
            let lattice = Lattice::choose(std::slice::from_ref(&decimal)).unwrap();
            let mut rounding = Rounding::default();
            lattice.placement(&decimal).real([text; 3], &mut rounding);
            prop_assert_eq!(rounding.error_max, 0.0);
        }
    }
}
