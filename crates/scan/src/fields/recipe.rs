//! How the value of an attribute is made from the values of one or more columns of a source.

use super::values::ANGLE_STEP;
use esker_points::AttrType;

/// How the value of an attribute is made.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Recipe {
    /// The value of this column, which has the attribute's type.
    Same(usize),
    /// The number of this column, which the attribute's type holds exactly.
    Number(usize),
    /// The number of this column, rounded to the nearest that the attribute's type holds.
    Rounded(usize),
    /// The number of a column times `factor`, rounded; black where it is not a number.
    Colour { column: usize, factor: f64 },
    /// Degrees, in steps of the scan angle of LAS.
    Angle(usize),
    /// Whole numbers, each shifted to its bits.
    Packed(Vec<Bits>),
    /// The lower and the upper 32 bits of a whole number.
    Halves { low: usize, high: usize },
}

/// The bits of a packed byte that a column has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bits {
    pub column: usize,
    pub shift: u32,
}

impl Recipe {
    /// The same recipe where column `i` is column `columns[i]` of a larger set.
    pub fn of_columns(self, columns: &[usize]) -> Self {
        match self {
            Self::Same(c) => Self::Same(columns[c]),
            Self::Number(c) => Self::Number(columns[c]),
            Self::Rounded(c) => Self::Rounded(columns[c]),
            Self::Colour { column, factor } => Self::Colour { column: columns[column], factor },
            Self::Angle(c) => Self::Angle(columns[c]),
            Self::Packed(parts) => {
                let of = |part: Bits| Bits { column: columns[part.column], ..part };
                Self::Packed(parts.into_iter().map(of).collect())
            }
            Self::Halves { low, high } => Self::Halves { low: columns[low], high: columns[high] },
        }
    }

    /// Whether the value is made from this column.
    pub fn reads(&self, column: usize) -> bool {
        match *self {
            Self::Same(c) | Self::Number(c) | Self::Rounded(c) | Self::Angle(c) => c == column,
            Self::Colour { column: c, .. } => c == column,
            Self::Packed(ref parts) => parts.iter().any(|part| part.column == column),
            Self::Halves { low, high } => low == column || high == column,
        }
    }

    /// Appends a value; `number` gives the number in a column. `false` if the type does not hold
    /// it, which the first pass rules out unless the file changes.
    pub fn put(&self, ty: AttrType, number: impl Fn(usize) -> f64, out: &mut Vec<u8>) -> bool {
        let v = match *self {
            Self::Same(column) | Self::Number(column) => {
                let v = number(column);
                put(v, ty, out);
                return same(ty.to_f64(&out[out.len() - ty.size()..]), v);
            }
            Self::Rounded(column) => number(column),
            Self::Colour { column, factor } => {
                // Infinity would be white; the note on values that are no numbers says 0.
                let v = number(column);
                if v.is_finite() { (v * factor).round() } else { 0.0 }
            }
            Self::Angle(column) => (number(column) / ANGLE_STEP).round(),
            Self::Packed(ref parts) => {
                parts.iter().map(|part| number(part.column) * f64::from(1u32 << part.shift)).sum()
            }
            Self::Halves { low, high } => {
                // The upper half of a negative number is negative; both halves are exact.
                let bits = (number(high) as i64) << 32 | number(low) as u32 as i64;
                out.extend(bits.to_le_bytes());
                return true;
            }
        };
        put(v, ty, out);
        true
    }
}

/// Whether two numbers are the same, or both none.
fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

/// Appends a number as this type; `as` saturates.
pub(crate) fn put(v: f64, ty: AttrType, out: &mut Vec<u8>) {
    match ty {
        AttrType::U8 => out.extend((v as u8).to_le_bytes()),
        AttrType::I8 => out.extend((v as i8).to_le_bytes()),
        AttrType::U16 => out.extend((v as u16).to_le_bytes()),
        AttrType::I16 => out.extend((v as i16).to_le_bytes()),
        AttrType::U32 => out.extend((v as u32).to_le_bytes()),
        AttrType::I32 => out.extend((v as i32).to_le_bytes()),
        AttrType::U64 => out.extend((v as u64).to_le_bytes()),
        AttrType::I64 => out.extend((v as i64).to_le_bytes()),
        AttrType::F32 => out.extend((v as f32).to_le_bytes()),
        AttrType::F64 => out.extend(v.to_le_bytes()),
    }
}
