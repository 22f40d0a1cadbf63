//! Compares a figure of two rows by ratio, against the noise of both.

use super::kinds::{Figure, Noise, SHARE_LEAST, Source};
use serde_json::Value;

/// A figure of both rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Name of the figure.
    pub field: &'static str,
    /// Value and range of what the same program measures again: of the old row, and of the new one.
    pub old: Measured,
    pub new: Measured,
    /// Whether it is a time.
    pub is_time: bool,
    least: f64,
}

/// A value, and the range of what the same program measures again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    pub value: f64,
    pub range: [f64; 2],
}

/// What became of a figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Worse,
    Better,
    /// No difference beyond the noise.
    Same,
}

impl Pair {
    /// The figure of both rows; none if a row lacks it.
    pub fn of(figure: &Figure, old: &Value, new: &Value) -> Option<Self> {
        figure.sources.iter().find_map(|source| {
            let (old, new) = (Measured::of(source, old)?, Measured::of(source, new)?);
            let field = source.field.rsplit('/').next().unwrap_or(source.field);
            Some(Self { field, old, new, is_time: figure.is_time, least: figure.least })
        })
    }

    /// New value over the old one; none if that is no number.
    pub fn ratio(&self) -> Option<f64> {
        Some(self.new.value / self.old.value).filter(|ratio| ratio.is_finite() && *ratio > 0.0)
    }

    /// What became of it where the new machine takes `slower` times as long. Each value must be
    /// outside the range of the other one.
    pub fn change(&self, slower: f64) -> Change {
        let slower = if self.is_time { slower } else { 1.0 };
        let [low, high] = self.new.range.map(|value| value / slower);
        let (old, value) = (self.old, self.new.value / slower);
        let off = value - old.value;
        let least = if self.is_time { old.value.abs() * SHARE_LEAST } else { self.least };
        if off > least && value > old.range[1] && old.value < low {
            Change::Worse
        } else if -off > least && value < old.range[0] && old.value > high {
            Change::Better
        } else {
            Change::Same
        }
    }
}

impl Measured {
    fn of(source: &Source, row: &Value) -> Option<Self> {
        let value = row.pointer(source.field)?.as_f64()?;
        let around = |share: f64| [value * (1.0 - share), value * (1.0 + share)];
        let range = match source.noise {
            Noise::Share(share) => around(share),
            Noise::Range(field) => range_at(row, field).unwrap_or(around(UNKNOWN)),
            Noise::Quartiles(field) => match range_at(row, field) {
                Some([low, high]) => {
                    let reach = FENCE * (high - low);
                    [low - reach, high + reach]
                }
                None => around(UNKNOWN),
            },
            Noise::SpreadOf(field) => match (range_at(row, field), median_at(row, field)) {
                (Some([low, high]), Some(median)) if median > 0.0 => {
                    [value * low / median, value * high / median]
                }
                _ => around(UNKNOWN),
            },
        };
        Some(Self { value, range: [range[0].min(value), range[1].max(value)] })
    }
}

/// Distance from the quartiles, over their own, from which a value is an outlier (Tukey's fences).
const FENCE: f64 = 1.5;
/// Share of a value that is noise where a row does not have its range.
const UNKNOWN: f64 = 0.1;

/// The numbers of an array, in order of size.
fn numbers_at(row: &Value, field: &str) -> Option<Vec<f64>> {
    let all = row.pointer(field)?.as_array()?;
    let mut numbers: Vec<f64> = all.iter().map(Value::as_f64).collect::<Option<_>>()?;
    numbers.sort_by(f64::total_cmp);
    Some(numbers)
}

fn range_at(row: &Value, field: &str) -> Option<[f64; 2]> {
    let numbers = numbers_at(row, field)?;
    Some([*numbers.first()?, *numbers.last()?])
}

fn median_at(row: &Value, field: &str) -> Option<f64> {
    let numbers = numbers_at(row, field)?;
    numbers.get(numbers.len() / 2).copied()
}
