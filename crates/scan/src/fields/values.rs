//! What a first pass over a column finds, from which type and meaning of the column follow: range,
//! whether all values are whole, and how near they are to steps of scan angles and of colours.

use esker_points::AttrType;

/// Degrees of a step of the scan angle of LAS point formats 6 to 10.
pub(crate) const ANGLE_STEP: f64 = 0.006;
/// All whole numbers below this are doubles; a value that reads as this may have been one more.
const WHOLE_MAX: f64 = (1u64 << 53) as f64;

/// What is known of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Values {
    /// Least and greatest finite value; infinite if there is none.
    pub min: f64,
    /// See `min`.
    pub max: f64,
    /// Whether all values are finite whole numbers, and none is -0.
    pub whole: bool,
    /// Number of values that are not finite.
    pub not_finite: u64,
    /// Whether the digits of all large values are those of a `u64`, and those of an `i64`.
    large: [bool; 2],
    /// Number of whole numbers in text of which a double rounds digits away.
    pub rounded: u64,
    /// Whether the fields below are kept, which takes time.
    is_watched: bool,
    /// Bits that are set in any value, as whole numbers of 8 bits.
    pub bits: u8,
    /// Whether each value has the number of a return in bits 0 to 3 and a number of returns not
    /// below it in bits 4 to 7.
    pub are_returns: bool,
    /// Whether a value is 1 to 15: the number of a return without a number of returns.
    pub has_uncounted: bool,
    /// Greatest distance from a whole number of [`ANGLE_STEP`]s, degrees.
    pub off_angle: f64,
    /// Greatest distance of 255 times a value from a whole number.
    pub off_byte: f64,
}

impl Values {
    /// No values. `is_watched` for columns with a meaning, which depends on more than the range.
    pub const fn empty(is_watched: bool) -> Self {
        Self {
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            whole: true,
            not_finite: 0,
            large: [true; 2],
            rounded: 0,
            is_watched,
            bits: 0,
            are_returns: true,
            has_uncounted: false,
            off_angle: 0.0,
            off_byte: 0.0,
        }
    }

    /// Any values: what is known of a column that no pass was made over.
    pub const fn unknown() -> Self {
        Self {
            min: f64::NEG_INFINITY,
            max: f64::INFINITY,
            whole: false,
            not_finite: 1,
            large: [false; 2],
            rounded: 0,
            is_watched: true,
            bits: u8::MAX,
            are_returns: false,
            has_uncounted: true,
            off_angle: f64::INFINITY,
            off_byte: f64::INFINITY,
        }
    }

    /// Adds a value.
    pub fn add(&mut self, v: f64) {
        if v.is_finite() {
            self.min = self.min.min(v);
            self.max = self.max.max(v);
        } else {
            self.not_finite += 1;
        }
        // Minus zero is no integer: its sign would be lost. Infinity and NaN have no whole part.
        self.whole &= v.fract() == 0.0 && !(v == 0.0 && v.is_sign_negative());
        if self.is_watched {
            let off = |scaled: f64| (scaled - scaled.round()).abs();
            // `as` saturates; only used if all values fit.
            let byte = v as u8;
            self.bits |= byte;
            self.are_returns &= (1..=byte >> 4).contains(&(byte & 15));
            self.has_uncounted |= (1..16).contains(&byte);
            self.off_angle = self.off_angle.max(off(v / ANGLE_STEP) * ANGLE_STEP);
            self.off_byte = self.off_byte.max(off(v * 255.0));
        }
    }

    /// Whether a double may have rounded this number, so that its digits must be looked at.
    pub fn is_large(v: f64) -> bool {
        v.abs() >= WHOLE_MAX && v.is_finite()
    }

    /// Adds the text of a value that [`Values::is_large`].
    pub fn add_large(&mut self, text: &[u8]) {
        let text = std::str::from_utf8(text).unwrap_or_default();
        self.large[0] &= text.parse::<u64>().is_ok();
        self.large[1] &= text.parse::<i64>().is_ok();
        self.rounded += u64::from(is_rounded(text));
    }

    /// Adds the values of another pass.
    pub fn merge(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        self.whole &= other.whole;
        self.not_finite += other.not_finite;
        for (own, other) in self.large.iter_mut().zip(other.large) {
            *own &= other;
        }
        self.rounded += other.rounded;
        self.is_watched |= other.is_watched;
        self.bits |= other.bits;
        self.are_returns &= other.are_returns;
        self.has_uncounted |= other.has_uncounted;
        self.off_angle = self.off_angle.max(other.off_angle);
        self.off_byte = self.off_byte.max(other.off_byte);
    }

    /// Whether all values are whole and within this range. True if there are none.
    pub fn is_whole_within(&self, min: f64, max: f64) -> bool {
        self.whole && min <= self.min && self.max <= max
    }

    /// Whether there are finite values.
    pub fn is_any(&self) -> bool {
        self.min <= self.max
    }

    /// The narrowest type that holds every value exactly. Text may have whole numbers that a double
    /// rounds: they get 64 bits.
    pub fn narrowest(&self) -> AttrType {
        if self.is_whole_within(0.0, 255.0) {
            AttrType::U8
        } else if self.is_whole_within(0.0, 65_535.0) {
            AttrType::U16
        } else if self.is_whole_within(f64::from(i32::MIN), f64::from(i32::MAX)) {
            AttrType::I32
        } else if self.max.max(-self.min) < WHOLE_MAX {
            AttrType::F64
        } else if self.whole && self.min >= 0.0 && self.large[0] {
            AttrType::U64
        } else if self.whole && self.large[1] {
            AttrType::I64
        } else {
            AttrType::F64
        }
    }
}

/// Whether a double rounds digits of this whole number away.
fn is_rounded(text: &str) -> bool {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits = whole.strip_prefix(['-', '+']).unwrap_or(whole);
    let is_whole = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit());
    let Ok(double) = whole.parse::<f64>() else { return false };
    // Digits of numbers with an exponent are not meant to be exact.
    is_whole && fraction.bytes().all(|b| b == b'0') && whole.parse::<i128>() != Ok(double as i128)
}
