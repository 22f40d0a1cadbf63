//! What the first pass over a text file learns of the values of a column: their range, whether they
//! are whole numbers, how many there are; and of three columns, whether they are unit vectors.

use crate::fields::values::Values;
use esker_points::AttrType;

/// All whole numbers up to this are singles.
const SINGLE_WHOLE_MAX: f64 = (1u64 << 24) as f64;
/// Allowed difference of the squared length of a normal from 1, for normals of two digits.
const LENGTH_TOLERANCE: f64 = 0.05;

/// The values of a column, and how many there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    /// The values that are there.
    pub values: Values,
    /// Number of values.
    pub numbers: u64,
    /// Number of points without a value, by a word for it or NaN.
    pub missing: u64,
    /// Number of points with a word in place of a value.
    pub words: u64,
}

impl Range {
    /// The range of no values.
    pub const EMPTY: Self = Self::empty(false);

    /// The range of no values of a column that `is_watched`: see [`Values::empty`].
    pub const fn empty(is_watched: bool) -> Self {
        Self { values: Values::empty(is_watched), numbers: 0, missing: 0, words: 0 }
    }

    /// Adds a value; NaN is a missing one.
    pub fn add(&mut self, v: f64) {
        if v.is_nan() {
            self.missing += 1;
            return;
        }
        self.numbers += 1;
        self.values.add(v);
    }

    /// The range of the values of both.
    pub fn merge(mut self, other: Self) -> Self {
        self.values.merge(&other.values);
        Self {
            numbers: self.numbers + other.numbers,
            missing: self.missing + other.missing,
            words: self.words + other.words,
            ..self
        }
    }

    /// Whether all values are whole numbers from `min` to `max`.
    pub fn is_whole_within(&self, min: f64, max: f64) -> bool {
        self.values.is_whole_within(min, max)
    }

    /// Number of points without a value.
    pub fn lacking(&self) -> u64 {
        self.missing + self.words
    }

    /// The type of a column of which points lack values, with NaN for these; `None` if none do.
    pub fn type_with_gaps(&self) -> Option<AttrType> {
        let is_single = self.is_whole_within(-SINGLE_WHOLE_MAX, SINGLE_WHOLE_MAX);
        let ty = if is_single { AttrType::F32 } else { AttrType::F64 };
        (self.lacking() > 0).then_some(ty)
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
