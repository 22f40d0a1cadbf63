//! Colours packed into one value of a PCD file: `0x00RRGGBB`, as an integer or as the single with
//! these bits. Some programs write the integer as a number into a field of type F. A single with
//! the bits of a colour is far below 1, so the values of all points tell both apart.

use crate::text::number::number;

/// The values of packed fields of type F.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Packed {
    /// Number of whole numbers of 32 bits, without zeros, which are black in either form.
    whole: u64,
    /// Number of other numbers.
    others: u64,
    /// Number of values that are NaN or infinite.
    lacking: u64,
}

impl Packed {
    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        if !value.is_finite() {
            self.lacking += 1;
        } else if value != 0.0 {
            match whole(value) {
                Some(_) => self.whole += 1,
                None => self.others += 1,
            }
        }
    }

    /// Adds the values of another pass.
    pub fn merge(&mut self, other: Self) {
        self.whole += other.whole;
        self.others += other.others;
        self.lacking += other.lacking;
    }

    /// Whether the values are integers, not the bits of colours.
    pub fn are_numbers(&self) -> bool {
        self.whole > 0 && self.others == 0
    }

    /// What is assumed. `is_text` for values whose bits are lost if they are NaN.
    pub fn notes(&self, is_text: bool) -> Vec<String> {
        let mut notes = Vec::new();
        if self.are_numbers() {
            let what = "packed colours are of type F, but all are whole numbers: they are read as \
                integers (0xRRGGBB)";
            notes.push(what.to_owned());
        }
        if self.lacking > 0 && (is_text || self.are_numbers()) {
            let lacking = self.lacking;
            notes.push(format!("{lacking} packed colours are no numbers: they are black"));
        }
        notes
    }
}

/// The bytes of a packed colour that is written as a number: blue, green, red, alpha. Black if the
/// number is none.
pub(crate) fn of_number(value: f64) -> [u8; 4] {
    whole(value).unwrap_or_default().to_le_bytes()
}

/// The bytes of a packed colour in text, written as the single with its bits. Black if the single
/// is NaN or infinite; `None` if the word is no number.
pub(crate) fn of_single(word: &[u8]) -> Option<[u8; 4]> {
    let value = fast_float2::parse::<f32, _>(word).ok();
    let value = value.or_else(|| number(word).map(|v| v as f32))?;
    Some(if value.is_finite() { value.to_le_bytes() } else { [0; 4] })
}

/// A whole number of 32 bits, signed or not.
pub(crate) fn whole(value: f64) -> Option<u32> {
    let range = f64::from(i32::MIN)..=f64::from(u32::MAX);
    (value.fract() == 0.0 && range.contains(&value)).then_some(value as i64 as u32)
}
