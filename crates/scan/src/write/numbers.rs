//! Formats numbers as text, and converts whole numbers of decimal steps to the nearest doubles.

use std::io::Write;

/// Greatest number of digits after the point; the readers keep as many.
const DIGITS_MAX: u32 = 15;
/// Relative deviation of a scale from a decimal number that counts as rounding noise: a few units
/// in the last place.
const NOISE: f64 = 1e-15;
/// Whole numbers up to here are exact in `f64`.
const WHOLE_MAX: i128 = 1 << 53;

/// Conversion of a whole number `n` of steps to a decimal number: `(n * step + base) / 10^digits`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal {
    step: i128,
    base: i128,
    digits: u32,
}

impl Decimal {
    /// Conversion to `n * scale + offset`, with the fewest digits that make both whole; `None` if
    /// they need too many digits, or if the scale is not positive.
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

    /// The conversion of `n + start` in place of `n`.
    pub fn from(self, start: i128) -> Self {
        Self { base: self.base + start * self.step, ..self }
    }

    /// The nearest double, if numerator and denominator are exact.
    pub fn value(&self, n: i128) -> Option<f64> {
        let whole = n * self.step + self.base;
        // Both are exact, so the quotient is rounded once.
        (whole.abs() < WHOLE_MAX).then(|| whole as f64 / 10f64.powi(self.digits as i32))
    }

    /// The nearest double, for any `n`.
    pub fn nearest(&self, n: i128) -> f64 {
        self.value(n).unwrap_or_else(|| {
            let mut digits = Vec::new();
            self.text(n, &mut digits);
            // Digits always parse as a number.
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

/// Appends a number in the fewest digits that parse to the same number.
pub fn float(value: impl std::fmt::Debug + std::fmt::Display, out: &mut Vec<u8>) {
    let start = out.len();
    put(out, format_args!("{value:?}"));
    // A whole number is written without `.0`; -0 keeps its sign.
    if out[start..].ends_with(b".0") {
        out.truncate(out.len() - 2);
    }
}
