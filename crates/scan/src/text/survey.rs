//! The first pass over a text file: bounds, digits after the point, the ranges of columns of whole
//! numbers, and the number of malformed lines. From it follows the plan of the second pass:
//! attributes, their types and the grid.

use super::blocks::LineBlock;
use super::layout::{Layout, count, excerpt, is_end};
use super::naming::{axes, named, schema_of, usual};
use super::number::{decimals, fields, number};
use esker_points::attribute::names;
use esker_points::{AttrType, Schema, Spread};
use std::sync::Arc;

/// Range of the values of a column.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Range {
    min: f64,
    max: f64,
    whole: bool,
}

impl Range {
    const EMPTY: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY, whole: true };

    fn add(&mut self, v: f64) {
        self.min = self.min.min(v);
        self.max = self.max.max(v);
        // Minus zero is no integer: its sign would be lost. Infinity and NaN have no whole part.
        self.whole &= v.fract() == 0.0 && !(v == 0.0 && v.is_sign_negative());
    }

    fn merge(self, other: Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            whole: self.whole && other.whole,
        }
    }

    fn is_whole_within(&self, min: f64, max: f64) -> bool {
        self.whole && min <= self.min && self.max <= max
    }

    /// Whether values are whole numbers too large for a double to keep all digits.
    fn is_rounded(&self) -> bool {
        let greatest = self.max.max(-self.min);
        self.whole && greatest >= WHOLE_MAX && greatest <= u64::MAX as f64
    }

    /// The narrowest type that holds every value exactly.
    fn narrowest(&self) -> AttrType {
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

/// All whole numbers below this are doubles; a value that reads as this may have been one more.
const WHOLE_MAX: f64 = (1u64 << 53) as f64;

/// What a pass over some lines finds.
#[derive(Clone, Debug)]
pub(crate) struct Survey {
    /// Points with a finite position.
    pub points: u64,
    /// Points without a finite position.
    pub not_finite: u64,
    /// Number of points according to lines with counts.
    pub claimed: u64,
    /// Number of malformed lines.
    pub malformed: u64,
    /// Number and beginning of the first malformed line.
    pub first_malformed: Option<(u64, String)>,
    /// Digits after the point that x, y and z need.
    pub decimals: [u32; 3],
    /// Distribution of the points with a finite position.
    pub spread: Spread,
    ranges: Vec<Range>,
}

/// Parses a line of exactly `columns` numbers into `row`; `false` if it is no such line. Empty
/// fields or a comment may follow.
pub(crate) fn parse_row(line: &[u8], columns: usize, row: &mut Vec<f64>) -> bool {
    row.clear();
    let mut fields = fields(line);
    while let Some(field) = fields.next() {
        match number(field) {
            Some(v) if row.len() < columns => row.push(v),
            Some(_) => return false,
            None => return row.len() == columns && is_end(field, fields),
        }
    }
    row.len() == columns
}

impl Survey {
    /// The survey of no lines.
    pub fn empty(columns: usize) -> Self {
        Self {
            points: 0,
            not_finite: 0,
            claimed: 0,
            malformed: 0,
            first_malformed: None,
            decimals: [0; 3],
            spread: Spread::default(),
            ranges: vec![Range::EMPTY; columns],
        }
    }

    /// Surveys the lines of a block; `axes` are the columns of x, y and z.
    pub fn of_block(block: &LineBlock, layout: &Layout, axes: [usize; 3]) -> Self {
        let mut found = Self::empty(layout.columns);
        let mut row = Vec::with_capacity(layout.columns);
        for (n, line) in block.lines() {
            if layout.is_beside(n, line) {
                found.claimed = found.claimed.saturating_add(count(line).unwrap_or(0));
                continue;
            }
            if !parse_row(line, layout.columns, &mut row) {
                found.malformed += 1;
                found.first_malformed.get_or_insert_with(|| (n, excerpt(line)));
            } else if axes.iter().any(|&a| !row[a].is_finite()) {
                found.not_finite += 1;
            } else {
                found.add(line, &row, axes);
            }
        }
        found
    }

    fn add(&mut self, line: &[u8], row: &[f64], axes: [usize; 3]) {
        self.points += 1;
        self.spread.add(axes.map(|a| row[a]));
        for (range, &v) in self.ranges.iter_mut().zip(row) {
            range.add(v);
        }
        for (column, field) in
            fields(line).enumerate().take(1 + axes.into_iter().fold(0, usize::max))
        {
            if let Some(i) = axes.iter().position(|&a| a == column) {
                self.decimals[i] = self.decimals[i].max(decimals(field));
            }
        }
    }

    /// Adds the survey of a later block.
    pub fn merge(&mut self, later: Self) {
        self.points += later.points;
        self.not_finite += later.not_finite;
        self.claimed = self.claimed.saturating_add(later.claimed);
        self.malformed += later.malformed;
        self.first_malformed = self.first_malformed.take().or(later.first_malformed);
        for (a, b) in self.decimals.iter_mut().zip(later.decimals) {
            *a = (*a).max(b);
        }
        self.spread.merge(later.spread);
        for (a, b) in self.ranges.iter_mut().zip(later.ranges) {
            *a = a.merge(b);
        }
    }
}

/// How the columns of a file become coordinates and attributes.
#[derive(Clone, Debug)]
pub(crate) struct ColumnPlan {
    /// Columns of x, y and z.
    pub axes: [usize; 3],
    /// The attributes.
    pub schema: Arc<Schema>,
    /// The text column of each attribute of the schema.
    pub sources: Vec<usize>,
    /// Assumptions, a line each.
    pub notes: Vec<String>,
}

/// The columns of x, y and z: by name, else the first three.
pub(crate) fn axes_of(layout: &Layout) -> [usize; 3] {
    let named = layout.names.as_ref().and_then(|n| axes(n.iter().map(String::as_str)));
    named.unwrap_or([0, 1, 2])
}

impl ColumnPlan {
    /// Chooses names and types after the survey.
    pub fn new(layout: &Layout, survey: &Survey) -> Self {
        let axes = axes_of(layout);
        let mut notes = Vec::new();
        let names = match &layout.names {
            Some(names) => names.clone(),
            None => guessed_names(layout.columns, &survey.ranges, &mut notes),
        };
        if !axes.iter().all(|&a| super::naming::axis(&names[a]).is_some()) {
            notes.push("no columns are named x, y and z: the first three are taken".into());
        }
        let ranges = with_equal_colours(&names, &survey.ranges);
        let others: Vec<usize> = (0..names.len()).filter(|c| !axes.contains(c)).collect();
        let typed = |&c: &usize| (names[c].as_str(), type_of(&names[c], &ranges[c]));
        let attributes: Vec<_> = others.iter().map(typed).collect();
        let (schema, columns) = schema_of(named(&attributes));
        if schema.normals().is_some() {
            notes.push("normals are kept as 32-bit floats".into());
        }
        let rounded = attributes.iter().zip(&others).filter(|(_, c)| ranges[**c].is_rounded());
        let rounded: Vec<_> = rounded.map(|((name, _), _)| *name).collect();
        if !rounded.is_empty() {
            let names = rounded.join(", ");
            notes.push(format!("whole numbers from 2^53 on are rounded to doubles: {names}"));
        }
        let mut sources = vec![0; others.len()];
        for (&text_column, column) in others.iter().zip(columns) {
            sources[column] = text_column;
        }
        Self { axes, schema, sources, notes }
    }
}

/// Names for columns that the file does not name: `column_4` and so on. But the fourth of four is
/// the intensity if it is whole and fits 16 bits; the last three of six are colours if they are
/// bytes; and seven have both, if the values allow only one of the orders `r g b i` and `i r g b`.
fn guessed_names(columns: usize, ranges: &[Range], notes: &mut Vec<String>) -> Vec<String> {
    let mut names: Vec<String> = ["x", "y", "z"].map(str::to_owned).to_vec();
    names.extend((4..=columns).map(|n| format!("column_{n}")));
    let bytes = |from: usize| ranges[from..from + 3].iter().all(|r| r.is_whole_within(0.0, 255.0));
    let (colours, intensity) = match columns {
        4 => (None, Some(3)),
        6 => (bytes(3).then_some(3), None),
        7 => match (bytes(3), bytes(4)) {
            (true, false) => (Some(3), Some(6)),
            (false, true) => (Some(4), Some(3)),
            // All four are bytes, so the intensity cannot be distinguished from colours.
            _ => (None, None),
        },
        _ => (None, None),
    };
    let mut guess = |column: usize, name: &str| {
        names[column] = name.to_owned();
        let n = column + 1;
        notes.push(format!("column {n} is taken for {name}; a first line of names decides else"));
    };
    for (i, name) in [names::RED, names::GREEN, names::BLUE].into_iter().enumerate() {
        if let Some(first) = colours {
            guess(first + i, name);
        }
    }
    if let Some(column) = intensity.filter(|&c| ranges[c].is_whole_within(0.0, 65_535.0)) {
        guess(column, names::INTENSITY);
    }
    names
}

/// The ranges of the columns, but red, green and blue get their common range, so that they have the
/// same type.
fn with_equal_colours(names: &[String], ranges: &[Range]) -> Vec<Range> {
    let mut ranges = ranges.to_vec();
    let at = |colour| names.iter().position(|n| usual(n) == Some(colour));
    if let (Some(r), Some(g), Some(b)) = (at(names::RED), at(names::GREEN), at(names::BLUE)) {
        let all = ranges[r].merge(ranges[g]).merge(ranges[b]);
        for c in [r, g, b] {
            ranges[c] = all;
        }
    }
    ranges
}

/// The type of a column: that of LAS if it has such a field and the values fit; `f32` for normals,
/// as the renderer needs them; else the narrowest that holds all values.
fn type_of(name: &str, range: &Range) -> AttrType {
    match usual(name) {
        Some(names::NX | names::NY | names::NZ) => AttrType::F32,
        Some(names::GPS_TIME) => AttrType::F64,
        Some(names::INTENSITY | names::POINT_SOURCE_ID | names::NIR)
            if range.is_whole_within(0.0, 65_535.0) =>
        {
            AttrType::U16
        }
        _ => range.narrowest(),
    }
}
