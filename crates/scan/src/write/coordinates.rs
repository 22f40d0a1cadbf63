//! Converts lattice coordinates to numbers and text, exactly if possible: on a decimal lattice, the
//! nearest double of the decimal number and its digits; on a lattice of binary steps, the double
//! itself.

use super::numbers::{Decimal, float};
use esker_points::Lattice;
use esker_points::lattice::ORIGIN;

/// Converts lattice coordinates to numbers.
#[derive(Clone, Copy, Debug)]
pub struct Coordinates {
    lattice: Lattice,
    /// Conversion of each axis from lattice coordinates; axes that are not decimal use
    /// [`Lattice::world_axis`].
    axes: [Option<Decimal>; 3],
    /// Whether singles hold the coordinates exactly. Text uses doubles all the same: the fewest
    /// digits of a single may differ from the coordinate by more than a step.
    pub single: bool,
}

impl Coordinates {
    /// Makes the conversion for a lattice; `single` if all sources held singles.
    pub fn new(lattice: &Lattice, single: bool) -> Self {
        let axes = [0, 1, 2].map(|axis| {
            let shift = i128::from(lattice.shift[axis]) - i128::from(ORIGIN);
            Some(Decimal::new(lattice.scale[axis], lattice.offset[axis])?.from(shift))
        });
        let is_binary = (0..3).all(|i| {
            let mantissa = lattice.scale[i].to_bits() & ((1 << 52) - 1);
            mantissa == 0 && lattice.offset[i] == 0.0
        });
        // Singles on such a lattice are multiples of its step; rounding to steps only removes bits.
        Self { lattice: *lattice, axes, single: single && is_binary }
    }

    /// A coordinate as the nearest double: of the decimal number that [`Self::text`] writes, or of
    /// a lattice that is not decimal.
    pub fn value(&self, axis: usize, u: u32) -> f64 {
        match self.axes[axis] {
            Some(decimal) => decimal.nearest(u.into()),
            None => self.lattice.world_axis(axis, f64::from(u)),
        }
    }

    /// Appends a coordinate as text.
    pub fn text(&self, axis: usize, u: u32, out: &mut Vec<u8>) {
        match self.axes[axis] {
            Some(decimal) => decimal.text(u.into(), out),
            None => float(self.value(axis, u), out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(lattice: &Lattice, u: u32) -> String {
        let mut out = Vec::new();
        Coordinates::new(lattice, false).text(0, u, &mut out);
        String::from_utf8(out).unwrap()
    }

    fn lattice(scale: f64, offset: f64, shift: i64) -> Lattice {
        Lattice { scale: [scale; 3], offset: [offset; 3], shift: [shift; 3], ..Lattice::default() }
    }

    #[test]
    fn decimal_lattices_give_all_their_digits() {
        let middle = ORIGIN as u32;
        assert_eq!(text(&lattice(0.01, 500_000.0, 0), middle - 7), "499999.93");
        assert_eq!(text(&lattice(0.001, 0.0, -5), middle), "-0.005");
        assert_eq!(text(&lattice(0.0025, 0.5, 0), middle + 1), "0.5025");
        assert_eq!(text(&lattice(1.0, 0.0, 3_000_000_000), 0), "852516352");
        assert_eq!(text(&lattice(1e-15, 0.0, 0), middle + 3), "0.000000000000003");
        assert_eq!(text(&lattice(10.0, 5.0, 0), middle - 1), "-5");
    }

    #[test]
    fn binary_lattices_give_the_fewest_digits() {
        let fine = lattice(2f64.powi(-30), 0.0, 0);
        let at = (0.1f32 as f64 * 2f64.powi(30)) as u32 + ORIGIN as u32;
        assert_eq!(text(&fine, at), format!("{}", 0.1f32 as f64));
        assert!(Coordinates::new(&fine, true).single && !Coordinates::new(&fine, false).single);
        assert!(!Coordinates::new(&lattice(0.01, 0.0, 0), true).single);
    }

    proptest! {
        #[test]
        fn text_and_doubles_are_equal_whatever_the_offset(u: u32, digits in 0u32..10, offset in "-?[0-9]{1,6}\\.[0-9]{1,12}") {
            let scale: f64 = format!("1e-{digits}").parse().unwrap();
            let lattice = lattice(scale, offset.parse().unwrap(), 0);
            let value = Coordinates::new(&lattice, false).value(0, u);
            prop_assert_eq!(text(&lattice, u).parse::<f64>().unwrap(), value);
        }

        #[test]
        fn text_is_the_nearest_double_of_each_step(u: u32, digits in 0u32..10, at in -10_000i64..10_000) {
            let scale: f64 = format!("1e-{digits}").parse().unwrap();
            let lattice = lattice(scale, at as f64, at * 1000);
            let value = Coordinates::new(&lattice, false).value(1, u);
            prop_assert_eq!(text(&lattice, u).parse::<f64>().unwrap(), value);
            // The lattice rounds its own value twice; far from zero the error exceeds a fraction of
            // a fine step.
            let rounding = value.abs() * f64::EPSILON;
            prop_assert!((value - lattice.world([u; 3])[1]).abs() < scale * 1e-4 + rounding);
        }
    }
}
