//! Maps values of an attribute to codes of one byte, which is all that a colour map needs: an
//! eighth of the bytes of a GPS time are resident and drawn. Codes are made while a plane is
//! loaded.

use crate::attribute::AttrType;

/// Code of a value that is not a number, or that is the greatest float, which stands for none; for
/// values coded along a range.
pub const NO_NUMBER: u8 = 255;
/// Greatest code of a value along a range.
pub const LAST: u8 = 254;
/// Number of distinct labels: values that differ by a multiple of it have one code.
pub const LABELS: u64 = 251;

/// How values become codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coding {
    /// From 0 at `low` to [`LAST`] at `high`, rounded; a value outside has the code of the nearer
    /// end, and one that is not a number has [`NO_NUMBER`].
    Along {
        /// Value of code 0.
        low: f64,
        /// Value of code [`LAST`].
        high: f64,
    },
    /// Some bits of a whole number.
    Bits {
        /// Number of low bits to drop.
        shift: u8,
        /// Mask of the bits kept after the shift.
        mask: u8,
    },
    /// The lowest bits of a whole number, along a range as in `Along`.
    BitsAlong {
        /// Mask of the bits that are kept.
        mask: u8,
        /// Value of code 0.
        low: f64,
        /// Value of code [`LAST`].
        high: f64,
    },
    /// Whole numbers that identify something: modulo [`LABELS`].
    Labels,
}

/// Codes of values of one type.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Codes {
    /// Type of the values.
    pub ty: AttrType,
    /// How they become codes.
    pub coding: Coding,
}

impl Codes {
    /// One code for each little-endian value.
    pub fn of(&self, values: &[u8]) -> Vec<u8> {
        match self.coding {
            Coding::Along { low, high } => self.each(values, along(low, high)),
            Coding::BitsAlong { mask, low, high } => {
                let code = along(low, high);
                self.each(values, |value| code(f64::from(value as u64 as u8 & mask)))
            }
            Coding::Bits { shift, mask } => {
                self.each(values, |value| (value as u64 >> (shift & 63)) as u8 & mask)
            }
            Coding::Labels => self.each(values, |value| (value as u64 % LABELS) as u8),
        }
    }

    fn each(&self, values: &[u8], code: impl Fn(f64) -> u8) -> Vec<u8> {
        values.chunks_exact(self.ty.size()).map(|value| code(self.ty.to_f64(value))).collect()
    }
}

/// Codes of values along a range; an empty range gives only code 0.
fn along(low: f64, high: f64) -> impl Fn(f64) -> u8 {
    let per_unit = f64::from(LAST) / (high - low);
    let per_unit = if per_unit.is_finite() { per_unit } else { 0.0 };
    move |value| {
        let at = (value - low) * per_unit;
        let is_missing = at.is_nan() || [f64::from(f32::MAX), f64::MAX].contains(&value.abs());
        if is_missing { NO_NUMBER } else { (at + 0.5).clamp(0.0, f64::from(LAST)) as u8 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn codes(coding: Coding, values: &[f64]) -> Vec<u8> {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Codes { ty: AttrType::F64, coding }.of(&bytes)
    }

    #[test]
    fn values_outside_a_range_have_the_code_of_the_nearer_end() {
        let coding = Coding::Along { low: 10.0, high: 20.0 };
        let values = [10.0, 15.0, 20.0, -1e300, f64::INFINITY, f64::NAN];
        assert_eq!(codes(coding, &values), [0, 127, LAST, 0, LAST, NO_NUMBER]);
        let greatest = [f64::from(f32::MAX), f64::from(f32::MIN), f64::MAX, f64::MIN];
        assert_eq!(codes(coding, &greatest), [NO_NUMBER; 4]);
        let down = Coding::Along { low: 20.0, high: 10.0 };
        assert_eq!(codes(down, &[20.0, 10.0]), [0, LAST]);
        let flat = Coding::Along { low: 3.0, high: 3.0 };
        assert_eq!(codes(flat, &[2.0, 3.0, 4.0]), [0; 3]);
    }

    #[test]
    fn bits_and_labels_are_of_whole_numbers() {
        let codes = |ty, coding, bytes: &[u8]| Codes { ty, coding }.of(bytes);
        let number = Coding::Bits { shift: 0, mask: 15 };
        let count = Coding::Bits { shift: 4, mask: 15 };
        assert_eq!(codes(AttrType::U8, number, &[0x21, 0x53]), [1, 3]);
        assert_eq!(codes(AttrType::U8, count, &[0x21, 0x53]), [2, 5]);
        let along = Coding::BitsAlong { mask: 15, low: 1.0, high: 3.0 };
        assert_eq!(codes(AttrType::U8, along, &[0x21, 0x52, 0x33, 0x50]), [0, 127, LAST, 0]);
        assert_eq!(codes(AttrType::U16, Coding::Labels, &[7, 0, 252, 0]), [7, 1]);
    }

    proptest! {
        #[test]
        fn a_code_is_the_value_to_half_a_step(
            low in -1e6f64..1e6, extent in 1e-3f64..1e6, share in 0.0f64..1.0,
        ) {
            let value = low + extent * share;
            let code = codes(Coding::Along { low, high: low + extent }, &[value])[0];
            let back = low + extent * f64::from(code) / f64::from(LAST);
            prop_assert!((back - value).abs() <= extent * (0.5 / f64::from(LAST) + 1e-6));
        }
    }
}
