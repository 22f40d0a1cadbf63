//! The first pass over a text file: bounds, digits after the point, the ranges of columns of whole
//! numbers, and the number of malformed lines. From it follows the plan of the second pass:
//! attributes, their types and the grid.

use super::blocks::LineBlock;
use super::layout::{Layout, count, excerpt, is_end};
use super::naming::axes;
use super::number::{decimals, fields, number, unquoted};
use crate::fields::recipe::Recipe;
use crate::fields::values::Values;
use crate::fields::{self, Column};
use esker_points::Schema;
use esker_points::attribute::names;
use std::sync::Arc;

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
    ranges: Vec<Values>,
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
    pub fn empty(layout: &Layout) -> Self {
        let named = layout.names.iter().flatten().map(|name| fields::is_watched(name));
        let watched = named.chain(std::iter::repeat(false)).take(layout.columns);
        Self {
            points: 0,
            not_finite: 0,
            claimed: 0,
            malformed: 0,
            first_malformed: None,
            decimals: [0; 3],
            ranges: watched.map(Values::empty).collect(),
        }
    }

    /// Surveys the lines of a block; `axes` are the columns of x, y and z.
    pub fn of_block(block: &LineBlock, layout: &Layout, axes: [usize; 3]) -> Self {
        let mut found = Self::empty(layout);
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
        for (range, &v) in self.ranges.iter_mut().zip(row) {
            range.add(v);
        }
        if row.iter().any(|&v| Values::is_large(v)) {
            for ((range, &v), field) in self.ranges.iter_mut().zip(row).zip(fields(line)) {
                if Values::is_large(v) {
                    range.add_large(unquoted(field));
                }
            }
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
        for (a, b) in self.ranges.iter_mut().zip(later.ranges) {
            a.merge(&b);
        }
    }

    /// The bounds of all points with a finite position.
    pub fn bounds(&self, axes: [usize; 3]) -> Option<[[f64; 3]; 2]> {
        let of = |value: fn(&Values) -> f64| axes.map(|a| value(&self.ranges[a]));
        (self.points > 0).then(|| [of(|r| r.min), of(|r| r.max)])
    }
}

/// How the columns of a file become coordinates and attributes.
#[derive(Clone, Debug)]
pub(crate) struct ColumnPlan {
    /// Columns of x, y and z.
    pub axes: [usize; 3],
    /// The attributes.
    pub schema: Arc<Schema>,
    /// How each attribute of the schema is made from the columns of a line.
    pub recipes: Vec<Recipe>,
    /// Assumptions, a line each.
    pub notes: Vec<String>,
    /// See [`fields::FieldPlan`].
    pub are_colours_full: bool,
    /// See [`fields::FieldPlan`].
    pub is_legacy: bool,
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
        let others: Vec<usize> = (0..names.len()).filter(|c| !axes.contains(c)).collect();
        let column = |&c: &usize| Column { name: &names[c], ty: None, values: survey.ranges[c] };
        let columns: Vec<Column<'_>> = others.iter().map(column).collect();
        let fields = fields::plan(&columns);
        notes.extend(fields.notes);
        if fields.schema.normals().is_some() {
            notes.push("normals are kept as 32-bit floats".into());
        }
        let rounded: Vec<_> =
            columns.iter().filter(|c| c.values.is_rounded()).map(|c| c.name).collect();
        if !rounded.is_empty() {
            let names = rounded.join(", ");
            notes.push(format!("whole numbers from 2^53 on are rounded to doubles: {names}"));
        }
        let recipes = fields.recipes.into_iter().map(|r| r.of_columns(&others)).collect();
        Self {
            axes,
            schema: fields.schema,
            recipes,
            notes,
            are_colours_full: fields.are_colours_full,
            is_legacy: fields.is_legacy,
        }
    }
}

/// Names for columns that the file does not name: `column_4` and so on. But the fourth of four is
/// the intensity if it is whole and fits 16 bits; the last three of six are colours if they are
/// bytes; and seven have both, if the values allow only one of the orders `r g b i` and `i r g b`.
fn guessed_names(columns: usize, ranges: &[Values], notes: &mut Vec<String>) -> Vec<String> {
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
