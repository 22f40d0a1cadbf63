//! Parses vertices written as decimal text, one a line, into the records that binary files have.

use super::header::{Element, Shape};
use super::records::Record;
use crate::text::number::{fields, number};
use esker_points::AttrType;

/// Parses a line into a record of this layout (see [`super::plan::RecordPlan`]). Coordinates that
/// their declared type cannot hold become infinite, as in a binary file. `on_scalar` is called with
/// the index and the word of each scalar property.
///
/// # Errors
/// If the line is not what the header says; the error is the reason, in words.
pub(crate) fn parse_line(
    line: &[u8],
    element: &Element,
    record: &Record,
    out: &mut Vec<u8>,
    mut on_scalar: impl FnMut(usize, &[u8]),
) -> Result<(), String> {
    let mut words = fields(line);
    let mut targets = record.fields.iter().enumerate();
    let missing = || {
        format!("has fewer numbers than the {} properties of a vertex", element.properties.len())
    };
    for property in &element.properties {
        let word = words.next().ok_or_else(missing)?;
        match property.shape {
            Shape::Scalar(declared) => {
                // A record has a field for each scalar property.
                let target = targets.next().map_or(declared, |(i, field)| {
                    on_scalar(i, word);
                    field.ty
                });
                if !put(word, declared, target, out) {
                    let shown = String::from_utf8_lossy(&word[..word.len().min(40)]);
                    return Err(format!(
                        "has `{}` for {}, which is {}",
                        shown.escape_debug(),
                        property.name,
                        declared.name()
                    ));
                }
            }
            Shape::List { .. } => {
                let count = integer(word).filter(|&c| c >= 0).ok_or_else(missing)?;
                for _ in 0..count {
                    words.next().ok_or_else(missing)?;
                }
            }
        }
    }
    match words.next() {
        Some(_) => Err("has more numbers than a vertex has properties".into()),
        None => Ok(()),
    }
}

/// Appends the value of a word; `false` if the declared type does not hold it.
pub(crate) fn put(word: &[u8], declared: AttrType, target: AttrType, out: &mut Vec<u8>) -> bool {
    macro_rules! int {
        ($t:ty) => {
            match integer(word).and_then(|v| <$t>::try_from(v).ok()) {
                Some(v) => out.extend_from_slice(&v.to_le_bytes()),
                None => return false,
            }
        };
    }
    match target {
        AttrType::U8 => int!(u8),
        AttrType::I8 => int!(i8),
        AttrType::U16 => int!(u16),
        AttrType::I16 => int!(i16),
        AttrType::U32 => int!(u32),
        AttrType::I32 => int!(i32),
        AttrType::U64 => int!(u64),
        AttrType::I64 => int!(i64),
        AttrType::F32 => match single(word) {
            Some(v) => out.extend_from_slice(&v.to_le_bytes()),
            None => return false,
        },
        AttrType::F64 => match number(word) {
            Some(v) if declared == AttrType::F32 && !(v as f32).is_finite() => {
                out.extend_from_slice(&f64::from(v as f32).to_le_bytes());
            }
            Some(v) if is_floating(declared) || v.fract() == 0.0 => {
                out.extend_from_slice(&v.to_le_bytes());
            }
            _ => return false,
        },
    }
    true
}

fn is_floating(ty: AttrType) -> bool {
    matches!(ty, AttrType::F32 | AttrType::F64)
}

/// The nearest `f32`, rounded once.
fn single(word: &[u8]) -> Option<f32> {
    fast_float2::parse::<f32, _>(word).ok().or_else(|| number(word).map(|v| v as f32))
}

/// A whole number, also if written with a point or an exponent (`255.0`).
fn integer(word: &[u8]) -> Option<i128> {
    let whole = std::str::from_utf8(word).ok().and_then(|s| s.parse().ok());
    whole.or_else(|| number(word).filter(|v| v.fract() == 0.0 && v.abs() < 1e15).map(|v| v as i128))
}
