//! Numbers as text, and whole numbers of decimal steps as the doubles nearest to them.

use std::io::Write;

/// Digits after the point at most: the readers keep as many.
const DIGITS_MAX: u32 = 15;
/// Relative deviation of a scale from a decimal number that counts as none: a few units in the last
/// place.
const NOISE: f64 = 1e-15;
/// Whole numbers up to here are exact in `f64`.
const WHOLE_MAX: i128 = 1 << 53;

/// What a whole number of steps is: `(n * step + base) / 10^digits`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal {
    step: i128,
    base: i128,
    digits: u32,
}

impl Decimal {
    /// Of `n * scale + offset`, with the least digits with which both are whole; `None` where none
    /// have few enough, or the scale is not above zero.
    pub fn new(scale: f64, offset: f64) -> Option<Self> {
        (0..=DIGITS_MAX).find_map(|digits| {
            let unit = 10f64.powi(digits as i32);
            let whole = |v: f64| {
                let scaled = v * unit;
                let near = (scaled - scaled.round()).abs() <= scaled.abs() * NOISE;
                (near && scaled.abs() < WHOLE_MAX as f64).then_some(scaled.round() as i128)
            };
            let step = whole(scale).filter(|&s| s > 0)?;
            Some(Self { step, base: whole(offset)?, digits })
        })
    }

    /// Formats `n + start` instead of `n`.
    pub fn from(self, start: i128) -> Self {
        Self { base: self.base + start * self.step, ..self }
    }

    /// The nearest double, where that can be told.
    pub fn value(&self, n: i128) -> Option<f64> {
        let whole = n * self.step + self.base;
        // Both are exact, so that the quotient is rounded once.
        (whole.abs() < WHOLE_MAX).then(|| whole as f64 / 10f64.powi(self.digits as i32))
    }

    /// The nearest double, of any number.
    pub fn nearest(&self, n: i128) -> f64 {
        self.value(n).unwrap_or_else(|| {
            let mut digits = Vec::new();
            self.text(n, &mut digits);
            // Digits are a number.
            String::from_utf8_lossy(&digits).parse().unwrap_or(f64::NAN)
        })
    }

    /// Appends all digits.
    pub fn text(&self, n: i128, out: &mut Vec<u8>) {
        let whole = n * self.step + self.base;
        if whole < 0 {
            out.push(b'-');
        }
        let (whole, unit) = (whole.unsigned_abs(), 10u128.pow(self.digits));
        put(out, format_args!("{}", whole / unit));
        if self.digits > 0 {
            put(out, format_args!(".{:0width$}", whole % unit, width = self.digits as usize));
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
