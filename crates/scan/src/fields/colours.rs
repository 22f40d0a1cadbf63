//! The scale of colours, from the types and the values of red, green and blue: bytes, 16 bits, or
//! fractions of 0 to 1, of 0 to 255 or of 0 to 65,535.

use super::column::Column;
use super::values::Values;
use esker_points::AttrType;

/// Greatest distance of 255 times a fraction from a whole number at which it stands for a byte: six
/// digits after the point are within 0.0002, singles within 0.00002.
const OFF_BYTE_MAX: f64 = 0.01;
/// By how much fractions may leave their range, as a share of it: rounding of interpolated colours.
const BEYOND_MAX: f64 = 0.001;

/// How colours are stored.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scale {
    /// `u8` or `u16`.
    pub ty: AttrType,
    /// Factor from numbers in the file; 1 if they are stored unchanged.
    pub factor: f64,
    /// Whether stored values use all bits of the type however dark they are.
    pub is_full: bool,
    /// What is assumed or rounded.
    pub note: Option<String>,
}

/// The scale of the colours in these three columns; `None` if they are no colours.
pub(crate) fn scale(rgb: [&Column<'_>; 3]) -> Option<Scale> {
    let all = |ty| rgb.iter().all(|c| c.ty == Some(ty));
    let plain = |ty| Some(Scale { ty, factor: 1.0, is_full: false, note: None });
    if all(AttrType::U8) {
        return plain(AttrType::U8);
    }
    if all(AttrType::U16) {
        return plain(AttrType::U16);
    }
    let mut values = Values::empty(true);
    rgb.iter().for_each(|c| values.merge(&c.values));
    let are_floats = all(AttrType::F32) || all(AttrType::F64);
    let is_one_white = are_floats && values.max == 1.0;
    if values.is_whole_within(0.0, 255.0) && !is_one_white {
        let note = "colours are 0 or 1, which is nearly black: they are read as 0 to 255";
        let is_dark = values.max == 1.0;
        return plain(AttrType::U8)
            .map(|scale| Scale { note: is_dark.then(|| note.to_owned()), ..scale });
    }
    if values.is_whole_within(0.0, 65_535.0) && !is_one_white {
        return plain(AttrType::U16);
    }
    if values.whole && !is_one_white {
        return None;
    }
    let tops = [1.0, 255.0, 65_535.0];
    let top = tops.into_iter().find(|top| values.max <= top * (1.0 + BEYOND_MAX))?;
    if values.min < -BEYOND_MAX * top {
        return None;
    }
    let scaled =
        |ty, factor, note: &str| Scale { ty, factor, is_full: true, note: Some(note.into()) };
    let mut scale = if top == 1.0 && values.off_byte <= OFF_BYTE_MAX {
        scaled(AttrType::U8, 255.0, "colours are read as fractions of 0 to 1, in steps of 1/255")
    } else if top == 1.0 {
        let note = "colours are read as fractions of 0 to 1, rounded to steps of 1/65,535";
        scaled(AttrType::U16, 65_535.0, note)
    } else if top == 255.0 {
        let note = "colours are read as fractions of 0 to 255, rounded to steps of 1/257";
        scaled(AttrType::U16, 257.0, note)
    } else {
        let note = "colours are read as fractions of 0 to 65,535, rounded to whole numbers";
        scaled(AttrType::U16, 1.0, note)
    };
    if values.not_finite > 0
        && let Some(note) = &mut scale.note
    {
        note.push_str(&format!("; {} values are no numbers and become 0", values.not_finite));
    }
    Some(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scale_of(ty: Option<AttrType>, numbers: &[f64]) -> Option<(AttrType, f64)> {
        let mut values = Values::empty(true);
        numbers.iter().for_each(|&v| values.add(v));
        let column = Column { name: "", ty, values, type_with_gaps: None };
        scale([&column; 3]).map(|scale| (scale.ty, scale.factor))
    }

    #[test]
    fn values_decide_where_types_do_not() {
        use AttrType::{F32, F64, I32, U8, U16};
        for (ty, numbers, want) in [
            (Some(U8), &[0.0, 1.0][..], Some((U8, 1.0))),
            (Some(U16), &[0.0, 200.0], Some((U16, 1.0))),
            (Some(I32), &[0.0, 255.0], Some((U8, 1.0))),
            (Some(I32), &[0.0, 256.0], Some((U16, 1.0))),
            (Some(I32), &[-1.0, 256.0], None),
            (Some(I32), &[0.0, 65_536.0], None),
            (Some(F32), &[0.0, 1.0], Some((U8, 255.0))),
            (Some(F32), &[0.0, 128.0], Some((U8, 1.0))),
            (Some(F32), &[f64::from(0.792_157f32), 0.0], Some((U8, 255.0))),
            (Some(F64), &[0.123, 0.0], Some((U16, 65_535.0))),
            (Some(F64), &[0.5, 254.25], Some((U16, 257.0))),
            (Some(F64), &[0.5, 60_000.0], Some((U16, 1.0))),
            (Some(F64), &[0.5, 70_000.0], None),
            (Some(F64), &[-0.5, 0.5], None),
            (Some(F64), &[1.0 / 255.0, f64::NAN], Some((U8, 255.0))),
            (None, &[0.792157, 0.368627], Some((U8, 255.0))),
            (None, &[0.0, 1.0], Some((U8, 1.0))),
            (None, &[0.0, 1000.0], Some((U16, 1.0))),
            (None, &[], Some((U8, 1.0))),
        ] {
            assert_eq!(scale_of(ty, numbers), want, "{ty:?} {numbers:?}");
        }
    }
}
