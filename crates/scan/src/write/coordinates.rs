//! Lattice coordinates as numbers and as text, exactly where numbers can be exact: on a decimal lattice the
//! nearest double of the decimal number and its digits; on a lattice of binary steps the double itself.

use esker_points::Lattice;
use esker_points::lattice::ORIGIN;
use std::io::Write;

/// Digits after the point at most: the readers keep as many.
const DIGITS_MAX: u32 = 15;
/// Relative deviation of a scale from a decimal number that counts as none: a few units in the last place.
const NOISE: f64 = 1e-15;
/// Whole numbers up to here are exact in `f64`.
const WHOLE_MAX: i128 = 1 << 53;

/// How the coordinates of one axis become numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Axis {
    /// `(u * step + base) / 10^digits`.
    Decimal { step: i128, base: i128, digits: u32 },
    /// As [`Lattice::world_axis`] has it.
    Real,
}

/// How lattice coordinates become numbers.
#[derive(Clone, Copy, Debug)]
pub struct Coordinates {
    lattice: Lattice,
    axes: [Axis; 3],
    /// Whether single-precision numbers hold them. As text they are doubles all the same: the fewest digits of a
    /// single would lie beside it by more than a step.
    pub single: bool,
}

impl Coordinates {
    /// Of a lattice; `single` where all sources held singles.
    pub fn new(lattice: &Lattice, single: bool) -> Self {
        let axes = [0, 1, 2].map(|axis| decimal(lattice, axis).unwrap_or(Axis::Real));
        let is_binary = (0..3).all(|i| {
            let mantissa = lattice.scale[i].to_bits() & ((1 << 52) - 1);
            mantissa == 0 && lattice.offset[i] == 0.0
        });
        // Singles on such a lattice are multiples of its step, and rounded to it they have fewer bits.
        Self { lattice: *lattice, axes, single: single && is_binary }
    }

    /// A coordinate as the nearest double.
    pub fn value(&self, axis: usize, u: u32) -> f64 {
        if let Axis::Decimal { step, base, digits } = self.axes[axis] {
            let whole = i128::from(u) * step + base;
            if whole.abs() < WHOLE_MAX {
                // Both are exact, so that the quotient is rounded once.
                return whole as f64 / 10f64.powi(digits as i32);
            }
        }
        self.lattice.world_axis(axis, f64::from(u))
    }

    /// Appends a coordinate as text.
    pub fn text(&self, axis: usize, u: u32, out: &mut Vec<u8>) {
        let Axis::Decimal { step, base, digits } = self.axes[axis] else {
            return float(self.value(axis, u), out);
        };
        let whole = i128::from(u) * step + base;
        if whole < 0 {
            out.push(b'-');
        }
        let (whole, unit) = (whole.unsigned_abs(), 10u128.pow(digits));
        put(out, format_args!("{}", whole / unit));
        if digits > 0 {
            put(out, format_args!(".{:0width$}", whole % unit, width = digits as usize));
        }
    }
}

/// Appends text.
pub fn put(out: &mut Vec<u8>, text: std::fmt::Arguments<'_>) {
    // Writing into memory does not fail.
    let _ = out.write_fmt(text);
}

/// Appends a number in the fewest digits that give it again.
pub fn float(value: impl std::fmt::Debug + std::fmt::Display, out: &mut Vec<u8>) {
    let start = out.len();
    put(out, format_args!("{value:?}"));
    // A whole number is written without `.0`; -0 keeps its sign by the digit.
    if out[start..].ends_with(b".0") {
        out.truncate(out.len() - 2);
    }
}

/// The least digits with which scale and offset of an axis are whole.
fn decimal(lattice: &Lattice, axis: usize) -> Option<Axis> {
    let (scale, offset) = (lattice.scale[axis], lattice.offset[axis]);
    (0..=DIGITS_MAX).find_map(|digits| {
        let unit = 10f64.powi(digits as i32);
        let whole = |v: f64| {
            let scaled = v * unit;
            let near = (scaled - scaled.round()).abs() <= scaled.abs() * NOISE;
            (near && scaled.abs() < WHOLE_MAX as f64).then_some(scaled.round() as i128)
        };
        let step = whole(scale).filter(|&s| s > 0)?;
        let shift = i128::from(lattice.shift[axis]) - i128::from(ORIGIN);
        Some(Axis::Decimal { step, base: whole(offset)? + shift * step, digits })
    })
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
        Lattice { scale: [scale; 3], offset: [offset; 3], shift: [shift; 3] }
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
        fn text_is_the_nearest_double_of_each_step(u: u32, digits in 0u32..10, at in -10_000i64..10_000) {
            let scale: f64 = format!("1e-{digits}").parse().unwrap();
            let lattice = lattice(scale, at as f64, at * 1000);
            let value = Coordinates::new(&lattice, false).value(1, u);
            prop_assert_eq!(text(&lattice, u).parse::<f64>().unwrap(), value);
            // The lattice's own is rounded twice: far from zero that is more than a part of a fine step.
            let rounding = value.abs() * f64::EPSILON;
            prop_assert!((value - lattice.world([u; 3])[1]).abs() < scale * 1e-4 + rounding);
        }
    }
}
