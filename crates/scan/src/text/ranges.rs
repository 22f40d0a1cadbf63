//! What the first pass over a text file learns of the values of a column: their range, whether they
//! are whole numbers, how many there are; and of three columns, whether they are unit vectors.

use esker_points::AttrType;

/// All whole numbers below this are doubles; a value that reads as this may have been one more.
const WHOLE_MAX: f64 = (1u64 << 53) as f64;
/// All whole numbers up to this are singles.
const SINGLE_WHOLE_MAX: f64 = (1u64 << 24) as f64;
/// Allowed difference of the squared length of a normal from 1, for normals of two digits.
const LENGTH_TOLERANCE: f64 = 0.05;

/// Range of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    min: f64,
    max: f64,
    whole: bool,
    /// Number of values.
    pub numbers: u64,
    /// Number of points without a value, by a word for it or NaN.
    pub missing: u64,
    /// Number of points with a word in place of a value.
    pub words: u64,
}

impl Range {
    /// The range of no values.
    pub const EMPTY: Self = Self {
        min: f64::INFINITY,
        max: f64::NEG_INFINITY,
        whole: true,
        numbers: 0,
        missing: 0,
        words: 0,
    };

    /// Adds a value; NaN is a missing one.
    pub fn add(&mut self, v: f64) {
        if v.is_nan() {
            self.missing += 1;
            return;
        }
        self.numbers += 1;
        self.min = self.min.min(v);
        self.max = self.max.max(v);
        // Minus zero is no integer: its sign would be lost. Infinity has no whole part.
        self.whole &= v.fract() == 0.0 && !(v == 0.0 && v.is_sign_negative());
    }

    /// The range of the values of both.
    pub fn merge(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            whole: self.whole && other.whole,
            numbers: self.numbers + other.numbers,
            missing: self.missing + other.missing,
            words: self.words + other.words,
        }
    }

    /// This range with the values of `of`: their type, but not their number.
    pub fn widened(self, of: Self) -> Self {
        let all = self.merge(of);
        Self { min: all.min, max: all.max, whole: all.whole, ..self }
    }

    /// Whether all values are whole numbers from `min` to `max`.
    pub fn is_whole_within(&self, min: f64, max: f64) -> bool {
        self.whole && min <= self.min && self.max <= max
    }

    /// Whether values are whole numbers too large for a double to keep all digits.
    pub fn is_rounded(&self) -> bool {
        let greatest = self.max.max(-self.min);
        self.whole && greatest >= WHOLE_MAX && greatest <= u64::MAX as f64
    }

    /// Number of points without a value.
    pub fn lacking(&self) -> u64 {
        self.missing + self.words
    }

    /// The narrowest type that holds every value exactly; with NaN for those that are missing,
    /// unless `fills_whole`: then those of whole numbers are 0.
    pub fn narrowest(&self, fills_whole: bool) -> AttrType {
        if self.lacking() > 0 && !fills_whole {
            return match self.is_whole_within(-SINGLE_WHOLE_MAX, SINGLE_WHOLE_MAX) {
                true => AttrType::F32,
                false => AttrType::F64,
            };
        }
        if self.is_whole_within(0.0, 255.0) {
            AttrType::U8
        } else if self.is_whole_within(0.0, 65_535.0) {
            AttrType::U16
        } else if self.is_whole_within(f64::from(i32::MIN), f64::from(i32::MAX)) {
            AttrType::I32
        } else {
            AttrType::F64
        }
    }
}

/// Whether the vectors in three columns have length 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct Unit {
    has_other: bool,
    has_unit: bool,
}

impl Unit {
    /// Adds a vector; the zero vector stands for no normal.
    pub fn add(&mut self, vector: &[f64]) {
        let squared: f64 = vector.iter().map(|v| v * v).sum();
        let is_unit = (squared - 1.0).abs() <= LENGTH_TOLERANCE;
        self.has_unit |= is_unit;
        self.has_other |= !is_unit && squared != 0.0;
    }

    /// Adds those of a later block.
    pub fn merge(&mut self, later: Self) {
        self.has_unit |= later.has_unit;
        self.has_other |= later.has_other;
    }

    /// Whether there are unit vectors, and no others.
    pub fn is_normal(&self) -> bool {
        self.has_unit && !self.has_other
    }
}
