//! Converts values of an E57 file to numbers, and finds types that hold all values of a field.

use e57::{RecordDataType as Kind, RecordValue as Value};
use esker_points::AttrType;

/// Set of numbers that the values of a field may have.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum NumberType {
    Integers { min: i64, max: i64 },
    Single,
    Double,
}

/// The number that a value stands for.
pub(crate) fn real(value: &Value, kind: &Kind) -> f64 {
    match (value, kind) {
        (Value::Single(v), _) => f64::from(*v),
        (Value::Double(v), _) => *v,
        (Value::ScaledInteger(n), Kind::ScaledInteger { scale, offset, .. }) => {
            *n as f64 * scale + offset
        }
        (Value::Integer(n) | Value::ScaledInteger(n), _) => *n as f64,
    }
}

/// Whether integers of a kind stand for themselves.
pub(crate) fn is_plain(kind: &Kind) -> bool {
    match *kind {
        Kind::Integer { .. } => true,
        Kind::ScaledInteger { scale, offset, .. } => [scale, offset] == [1.0, 0.0],
        _ => false,
    }
}

impl NumberType {
    pub fn of(kind: &Kind) -> Self {
        match *kind {
            Kind::Single { .. } => Self::Single,
            Kind::Integer { min, max } | Kind::ScaledInteger { min, max, .. } if is_plain(kind) => {
                Self::Integers { min, max }
            }
            _ => Self::Double,
        }
    }

    /// The least set that includes both.
    pub fn with(self, other: Self) -> Self {
        match (self, other) {
            (Self::Integers { min, max }, Self::Integers { min: low, max: high }) => {
                Self::Integers { min: min.min(low), max: max.max(high) }
            }
            _ if self == other => self,
            _ => Self::Double,
        }
    }

    /// The narrowest type that holds all of them.
    pub fn ty(self) -> AttrType {
        let (min, max) = match self {
            Self::Single => return AttrType::F32,
            Self::Double => return AttrType::F64,
            Self::Integers { min, max } => (min, max),
        };
        let within = |low: i64, high: i64| low <= min && max <= high;
        if within(0, u8::MAX.into()) {
            AttrType::U8
        } else if within(i8::MIN.into(), i8::MAX.into()) {
            AttrType::I8
        } else if within(0, u16::MAX.into()) {
            AttrType::U16
        } else if within(i16::MIN.into(), i16::MAX.into()) {
            AttrType::I16
        } else if within(0, u32::MAX.into()) {
            AttrType::U32
        } else if within(i32::MIN.into(), i32::MAX.into()) {
            AttrType::I32
        } else {
            AttrType::I64
        }
    }
}
