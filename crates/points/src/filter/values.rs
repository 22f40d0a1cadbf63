//! Ranges of the values of attributes: `NAME:MIN..MAX`, with either end open. Values are compared
//! as they are stored: whole numbers of up to 64 bits and `f64` without rounding. An end is a value
//! as people write it: for `f32` it is the nearest one, and for scaled whole numbers the step
//! that it names. Least and greatest values of a node decide for the node first.

use super::condition::{FilterError, PARTS, Side};
use crate::attribute::AttrType;
use crate::named::{NUMBER_OF_RETURNS_SHIFT, Part, RETURN_NUMBER_MASK};
use crate::schema::Schema;
use std::fmt;
use std::str::FromStr;

/// End of a range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// A whole number.
    Whole(i128),
    /// A finite number that is not whole, or has more than 127 bits.
    Real(f64),
}

/// Points whose value of an attribute lies within a range, its ends included. Values that are not
/// numbers, and points without the attribute, lie outside of any range.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueRange {
    /// Name of the attribute, as users give it ([`Schema::find_named`]).
    pub name: String,
    /// Least and greatest value as users see them, not in the wrong order; none where it is open.
    pub ends: [Option<Bound>; 2],
}

impl Bound {
    /// A number as the end of a range; `None` if it is not finite.
    pub fn new(number: f64) -> Option<Self> {
        // Such floats fit, without rounding.
        let is_whole = number.fract() == 0.0 && number.abs() < (i128::MAX as f64);
        let end = if is_whole { Self::Whole(number as i128) } else { Self::Real(number) };
        number.is_finite().then_some(end)
    }

    /// The nearest `f64`.
    pub fn to_f64(self) -> f64 {
        match self {
            Self::Whole(number) => number as f64,
            Self::Real(number) => number,
        }
    }

    fn is_above(self, other: Self) -> bool {
        match (self, other) {
            (Self::Whole(a), Self::Whole(b)) => a > b,
            (a, b) => a.to_f64() > b.to_f64(),
        }
    }
}

impl FromStr for Bound {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let real = || text.parse().ok().and_then(Self::new);
        text.parse().map(Self::Whole).ok().or_else(real).ok_or_else(|| {
            FilterError(format!("`{text}` is no number; a range is given as ATTRIBUTE:MIN..MAX"))
        })
    }
}

impl fmt::Display for Bound {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole(number) => number.fmt(f),
            Self::Real(number) => number.fmt(f),
        }
    }
}

impl FromStr for ValueRange {
    type Err = FilterError;

    /// Parses `NAME:MIN..MAX`, with either end open.
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let parts = text.rsplit_once(':').and_then(|(name, r)| Some((name, r.split_once("..")?)));
        let Some((name, (low, high))) = parts.filter(|(name, _)| !name.trim().is_empty()) else {
            return Err(FilterError(format!(
                "`{text}` is no range of an attribute; it is given as ATTRIBUTE:MIN..MAX, such as \
                 intensity:100..4000 or intensity:..4000"
            )));
        };
        let end = |word: &str| {
            let word = word.trim();
            (!word.is_empty()).then(|| word.parse()).transpose()
        };
        let ends: [Option<Bound>; 2] = [end(low)?, end(high)?];
        if let [Some(low), Some(high)] = ends
            && low.is_above(high)
        {
            return Err(FilterError(format!(
                "`{text}` holds no value: the least one comes first, as ATTRIBUTE:MIN..MAX"
            )));
        }
        Ok(Self { name: name.trim().to_owned(), ends })
    }
}

impl fmt::Display for ValueRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.ends.map(|end| end.map_or(String::new(), |end| end.to_string()));
        write!(f, "{}:{low}..{high}", self.name)
    }
}

impl ValueRange {
    /// Finds the attribute in `schema`.
    ///
    /// # Errors
    /// If there is none; the message has the names of those that there are.
    pub(super) fn check(&self, schema: &Schema) -> Result<(), FilterError> {
        if schema.find_named(&self.name).is_some() {
            return Ok(());
        }
        let known = match schema.names() {
            names if names.is_empty() => "the points have none".to_owned(),
            names => format!("there are {}", names.join(", ")),
        };
        Err(FilterError(format!(
            "there is no attribute `{}` to choose points by; {known}",
            self.name
        )))
    }

    /// Tests of each attribute of the file that has the name.
    fn tests(&self, schema: &Schema) -> Vec<ValueTest> {
        let Some(found) = schema.find_named(&self.name) else { return Vec::new() };
        let name = &schema.attributes[found.index].name;
        let alike = schema.attributes.iter().enumerate().filter(|(_, a)| a.name == *name);
        alike
            .map(|(attribute, _)| ValueTest::new(schema, attribute, found.part, self.ends))
            .collect()
    }
}

/// Wanted values of one attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ValueTest {
    /// Index in the schema of the file.
    attribute: usize,
    ty: AttrType,
    part: Part,
    interval: Interval,
}

/// Least and greatest wanted value.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Interval {
    /// Of stored whole numbers.
    Whole([i128; 2]),
    /// Of stored values times `scale` plus `offset`.
    Real { ends: [f64; 2], scale: f64, offset: f64 },
}

impl ValueTest {
    fn new(schema: &Schema, attribute: usize, part: Part, ends: [Option<Bound>; 2]) -> Self {
        let of = &schema.attributes[attribute];
        // Only bytes have parts.
        let part = if of.ty == AttrType::U8 { part } else { Part::Whole };
        let (scale, offset) = match (part, schema.shown_scale(attribute)) {
            (Part::Whole, 0.0) => (1.0, of.offset),
            (Part::Whole, scale) => (scale, of.offset),
            _ => (1.0, 0.0),
        };
        let is_scaled = (scale, offset) != (1.0, 0.0);
        let interval = match of.ty {
            AttrType::F32 if !is_scaled => {
                Interval::Real { ends: ends_of_f32(ends), scale, offset }
            }
            AttrType::F32 | AttrType::F64 => {
                Interval::Real { ends: ends_of_f64(ends), scale, offset }
            }
            _ if is_scaled => Interval::Whole(ends_of_steps(ends, scale, offset)),
            _ => Interval::Whole(ends_of_whole(ends)),
        };
        Self { attribute, ty: of.ty, part, interval }
    }

    /// Whether a value is wanted, given by its bytes.
    fn keeps(&self, value: &[u8]) -> bool {
        match self.interval {
            Interval::Whole([low, high]) => {
                (low..=high).contains(&self.of_part(whole(self.ty, value)))
            }
            Interval::Real { ends: [low, high], scale, offset } => {
                let value = self.ty.to_f64(value) * scale + offset;
                low <= value && value <= high
            }
        }
    }

    fn of_part(&self, value: i128) -> i128 {
        match self.part {
            Part::Whole => value,
            Part::ReturnNumber => value & i128::from(RETURN_NUMBER_MASK),
            Part::ReturnCount => value >> NUMBER_OF_RETURNS_SHIFT,
        }
    }

    /// Side of values from `least` to `greatest`.
    fn side(&self, least: &[u8], greatest: &[u8]) -> Side {
        fn of<T: PartialOrd>([low, high]: [T; 2], [least, greatest]: [T; 2]) -> Side {
            if greatest < low || least > high {
                Side::Outside
            } else if low <= least && greatest <= high {
                Side::Inside
            } else {
                Side::Across
            }
        }
        match self.interval {
            Interval::Whole(wanted) => {
                let ends = [least, greatest].map(|value| whole(self.ty, value));
                let counts = ends.map(|value| value >> NUMBER_OF_RETURNS_SHIFT);
                if self.part == Part::ReturnNumber && counts[0] != counts[1] {
                    return of(wanted, [0, i128::from(RETURN_NUMBER_MASK)]);
                }
                of(wanted, ends.map(|value| self.of_part(value)))
            }
            Interval::Real { ends, scale, offset } => {
                // Rounding keeps the order, so that ends lie around all values between them.
                let [a, b] = [least, greatest].map(|v| self.ty.to_f64(v) * scale + offset);
                if a.is_nan() || b.is_nan() {
                    return Side::Across;
                }
                of(ends, [a.min(b), a.max(b)])
            }
        }
    }
}

/// A stored whole number.
fn whole(ty: AttrType, bytes: &[u8]) -> i128 {
    let mut raw = [0; 8];
    raw[..ty.size()].copy_from_slice(&bytes[..ty.size()]);
    let bits = u64::from_le_bytes(raw);
    let signed =
        |bits: u64| i128::from((bits as i64) << (64 - 8 * ty.size()) >> (64 - 8 * ty.size()));
    match ty {
        AttrType::I8 | AttrType::I16 | AttrType::I32 | AttrType::I64 => signed(bits),
        _ => i128::from(bits),
    }
}

fn ends_of_whole([low, high]: [Option<Bound>; 2]) -> [i128; 2] {
    let low = low.map_or(i128::MIN, |end| match end {
        Bound::Whole(number) => number,
        Bound::Real(number) => number.ceil() as i128,
    });
    let high = high.map_or(i128::MAX, |end| match end {
        Bound::Whole(number) => number,
        Bound::Real(number) => number.floor() as i128,
    });
    [low, high]
}

/// Stored whole numbers whose scaled values lie in the range. An end that lies within a 512th of a
/// step is on the step, since scaled values are rounded.
fn ends_of_steps(ends: [Option<Bound>; 2], scale: f64, offset: f64) -> [i128; 2] {
    let parts = i128::from(PARTS);
    let at = |end: Bound| ((end.to_f64() - offset) / scale * PARTS as f64).round() as i128;
    let [low, high] = if scale < 0.0 { [ends[1], ends[0]] } else { ends };
    let low = low.map_or(i128::MIN, |end| at(end).saturating_add(parts - 1).div_euclid(parts));
    [low, high.map_or(i128::MAX, |end| at(end).div_euclid(parts))]
}

/// Nearest `f32` of the ends; of ends beyond all finite ones the nearest that lies within.
fn ends_of_f32([low, high]: [Option<Bound>; 2]) -> [f64; 2] {
    let low = low.map_or(f32::NEG_INFINITY, |end| (end.to_f64() as f32).max(f32::MIN));
    let high = high.map_or(f32::INFINITY, |end| (end.to_f64() as f32).min(f32::MAX));
    [low.into(), high.into()]
}

/// Outermost `f64` within the ends.
fn ends_of_f64([low, high]: [Option<Bound>; 2]) -> [f64; 2] {
    let low = low.map_or(f64::NEG_INFINITY, |end| match end {
        Bound::Whole(number) if ((number as f64) as i128) < number => (number as f64).next_up(),
        end => end.to_f64(),
    });
    let high = high.map_or(f64::INFINITY, |end| match end {
        Bound::Whole(number) if is_above(number as f64, number) => (number as f64).next_down(),
        end => end.to_f64(),
    });
    [low, high]
}

/// Whether a whole float is above a number. Converted back it is exact, but for 2^127.
fn is_above(float: f64, number: i128) -> bool {
    float >= i128::MAX as f64 || float as i128 > number
}

/// Wanted values of the attributes of one file. Points meet all conditions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ValueTests {
    /// Of each condition the attributes of its name, which may have several types: one of them is
    /// enough.
    conditions: Vec<Vec<ValueTest>>,
}

/// Values of an attribute of a node's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeValues<'a> {
    /// Least and greatest number, as stored; none if no point has one.
    pub range: Option<[&'a [u8]; 2]>,
    /// Whether all points have the attribute, and no value is not a number.
    pub are_all: bool,
}

impl ValueTests {
    /// Tests of `ranges` on the attributes of `schema`.
    pub(super) fn new(ranges: &[ValueRange], schema: &Schema) -> Self {
        Self { conditions: ranges.iter().map(|range| range.tests(schema)).collect() }
    }

    /// Whether values do not matter.
    pub fn is_empty(&self) -> bool {
        self.conditions.is_empty()
    }

    /// Indices of the attributes that matter, ascending.
    pub fn attributes(&self) -> Vec<usize> {
        let mut all: Vec<usize> = self.conditions.iter().flatten().map(|t| t.attribute).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Side of points, given what is known of each attribute's values.
    pub fn side<'a>(&self, values: impl Fn(usize) -> NodeValues<'a>) -> Side {
        let of_test = |test: &ValueTest| {
            let NodeValues { range, are_all } = values(test.attribute);
            match range.map_or(Side::Outside, |[least, greatest]| test.side(least, greatest)) {
                Side::Inside if !are_all => Side::Across,
                side => side,
            }
        };
        let sides = self
            .conditions
            .iter()
            .map(|tests| tests.iter().map(of_test).reduce(Side::or).unwrap_or(Side::Outside));
        sides.fold(Side::Inside, Side::and)
    }

    /// Whether a point is wanted; `value` has the bytes of its value of an attribute, if it has it.
    pub fn keep<'a>(&self, value: impl Fn(usize) -> Option<&'a [u8]>) -> bool {
        let keeps = |test: &ValueTest| value(test.attribute).is_some_and(|bytes| test.keeps(bytes));
        self.conditions.iter().all(|tests| tests.iter().any(keeps))
    }
}

#[cfg(test)]
mod tests;
