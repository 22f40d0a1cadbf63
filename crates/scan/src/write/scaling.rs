//! Scales attribute values for formats that cannot store a scale, so that other programs read the
//! intended values. Values counted in steps (extra bytes of LAS with a scale or an offset, scan
//! angles) become a double, or a decimal number with all its digits; others are unchanged.

use super::numbers::{Decimal, float, put};
use esker_points::{AttrType, Attribute, Schema};

/// How the values of an attribute are scaled.
#[derive(Clone, Copy, Debug)]
pub struct Scaling {
    ty: AttrType,
    how: How,
}

#[derive(Clone, Copy, Debug)]
enum How {
    /// Not at all.
    Stored,
    /// Whole numbers of decimal steps.
    Steps(Decimal),
    /// Multiplied by the first number, then added to the second.
    Times(f64, f64),
}

impl Scaling {
    /// Scaling of an attribute of a schema. A scale that is zero or not finite is ignored.
    pub fn of(schema: &Schema, attribute: usize) -> Self {
        let Attribute { ty, offset, .. } = schema.attributes[attribute];
        let scale = schema.shown_scale(attribute);
        let is_plain = (scale == 1.0 && offset == 0.0) || scale == 0.0;
        let how = if is_plain || !scale.is_finite() || !offset.is_finite() {
            How::Stored
        } else {
            let decimal = Decimal::new(scale, offset).filter(|_| is_whole(ty));
            decimal.map_or(How::Times(scale, offset), How::Steps)
        };
        Self { ty, how }
    }

    /// Whether written values differ from stored ones.
    pub fn is_scaled(&self) -> bool {
        !matches!(self.how, How::Stored)
    }

    /// The type of written values.
    pub fn ty(&self) -> AttrType {
        if self.is_scaled() { AttrType::F64 } else { self.ty }
    }

    /// Appends the bytes of a stored value after scaling, of type [`Scaling::ty`].
    pub fn bytes(&self, stored: &[u8], out: &mut Vec<u8>) {
        match self.how {
            How::Stored => out.extend_from_slice(stored),
            How::Steps(_) | How::Times(..) => {
                out.extend_from_slice(&self.value(stored).to_le_bytes());
            }
        }
    }

    /// Appends a stored value, after scaling, as text.
    pub fn text(&self, stored: &[u8], out: &mut Vec<u8>) {
        match self.how {
            How::Stored => number(self.ty, stored, out),
            How::Steps(decimal) => decimal.text(whole(self.ty, stored), out),
            How::Times(..) => float(self.value(stored), out),
        }
    }

    fn value(&self, stored: &[u8]) -> f64 {
        match self.how {
            How::Stored => self.ty.to_f64(stored),
            How::Times(scale, offset) => self.ty.to_f64(stored) * scale + offset,
            How::Steps(decimal) => decimal.nearest(whole(self.ty, stored)),
        }
    }
}

/// A note that names the attributes whose written values differ from stored ones, if there are any.
pub fn notes(schema: &Schema) -> Vec<String> {
    let all = schema.attributes.iter().enumerate();
    let scaled = all.filter(|(index, _)| Scaling::of(schema, *index).is_scaled());
    let names: Vec<&str> = scaled.map(|(_, a)| a.name.as_str()).collect();
    let note = || format!("written as scaled values: {}", names.join(", "));
    (!names.is_empty()).then(note).into_iter().collect()
}

fn is_whole(ty: AttrType) -> bool {
    !matches!(ty, AttrType::F32 | AttrType::F64)
}

/// A stored integer, or the bits of a float.
fn whole(ty: AttrType, stored: &[u8]) -> i128 {
    let mut wide = [0; 8];
    wide[..stored.len()].copy_from_slice(stored);
    let bits = u64::from_le_bytes(wide);
    match ty {
        AttrType::I8 => (bits as i8).into(),
        AttrType::I16 => (bits as i16).into(),
        AttrType::I32 => (bits as i32).into(),
        AttrType::I64 => (bits as i64).into(),
        _ => bits.into(),
    }
}

/// Appends a stored value as text, unscaled.
fn number(ty: AttrType, stored: &[u8], out: &mut Vec<u8>) {
    let bits = whole(ty, stored);
    match ty {
        AttrType::F32 => float(f32::from_bits(bits as u32), out),
        AttrType::F64 => float(f64::from_bits(bits as u64), out),
        _ => put(out, format_args!("{bits}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scaling(ty: AttrType, scale: f64, offset: f64) -> Scaling {
        let attributes = vec![Attribute { scale, offset, ..Attribute::new("own", ty) }];
        Scaling::of(&Schema { attributes }, 0)
    }

    fn text(scaling: Scaling, stored: &[u8]) -> String {
        let mut out = Vec::new();
        scaling.text(stored, &mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn steps_become_decimals_and_other_values_are_unchanged() {
        let reflectance = scaling(AttrType::I16, 0.01, 0.0);
        assert_eq!(text(reflectance, &(-1234i16).to_le_bytes()), "-12.34");
        assert_eq!(reflectance.ty(), AttrType::F64);
        assert_eq!(text(scaling(AttrType::U8, 0.5, -3.0), &[7]), "0.5");
        assert_eq!(text(scaling(AttrType::U64, 1.0, 0.5), &[255; 8]), "18446744073709551615.5");
        assert_eq!(text(scaling(AttrType::I32, -2.0, 1.0), &3i32.to_le_bytes()), "-5");
        assert_eq!(text(scaling(AttrType::F32, 0.5, 1.0), &3f32.to_le_bytes()), "2.5");
        for (scale, offset) in [(1.0, 0.0), (0.0, 9.0), (f64::NAN, 0.0), (0.1, f64::INFINITY)] {
            let plain = scaling(AttrType::I16, scale, offset);
            assert_eq!((text(plain, &[3, 0]).as_str(), plain.ty()), ("3", AttrType::I16));
        }
    }

    proptest! {
        #[test]
        fn bytes_and_text_give_the_same_value(raw: i64, digits in 0u32..9, wide: bool) {
            let scale: f64 = format!("1e-{digits}").parse().unwrap();
            let (ty, stored) = if wide { (AttrType::I64, raw.to_le_bytes().to_vec()) } else { (AttrType::I16, (raw as i16).to_le_bytes().to_vec()) };
            let scaling = scaling(ty, scale, 0.25);
            let mut bytes = Vec::new();
            scaling.bytes(&stored, &mut bytes);
            let value = f64::from_le_bytes(bytes.try_into().unwrap());
            prop_assert_eq!(text(scaling, &stored).parse::<f64>().unwrap(), value);
        }
    }
}
