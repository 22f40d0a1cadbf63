//! Plans the second pass over a text file after the first: the attributes, their types, the columns
//! that they come from, and the values that stand for missing ones.

use super::guess::guessed_names;
use super::layout::Layout;
use super::ranges::Range;
use super::survey::{Survey, Width};
use crate::fields::recipe::Recipe;
use crate::fields::{self, Column, FieldPlan, Writer};
use esker_points::attribute::names;
use esker_points::{AttrType, Schema};
use std::sync::Arc;

/// How the columns of a file become attributes.
#[derive(Clone, Debug)]
pub(crate) struct ColumnPlan {
    /// The attributes.
    pub schema: Arc<Schema>,
    /// How each attribute of the schema is made from the values of the file.
    pub recipes: Vec<Recipe>,
    /// For each number of columns of a scan, the column of each value of the file, if the scan has
    /// it.
    pub sources: Vec<(usize, Vec<Option<usize>>)>,
    /// For each attribute of the schema, the value in place of a missing one.
    pub fills: Vec<f64>,
    /// The names of the columns of most lines, with `x`, `y` and `z`.
    pub columns: Vec<String>,
    /// Assumptions, a line each.
    pub notes: Vec<String>,
    /// See [`fields::FieldPlan`].
    pub are_colours_full: bool,
    /// See [`fields::FieldPlan`].
    pub is_legacy: bool,
    /// See [`fields::FieldPlan`].
    pub are_times_beyond_week: bool,
}

/// A column of the file that becomes an attribute.
struct Found {
    /// Its name in the file, and how many columns of this name come before it.
    key: (String, usize),
    range: Range,
    /// The widths that have it, and the column.
    at: Vec<(usize, usize)>,
}

impl ColumnPlan {
    /// Chooses names and types after the survey.
    pub fn new(layout: &Layout, survey: &Survey) -> Self {
        let used = |width: &&Width| width.points > 0 || width.columns == layout.columns;
        let mut widths: Vec<&Width> = survey.widths.iter().filter(used).collect();
        if survey.points > 0 {
            widths.retain(|width| width.points > 0);
        }
        let all_names: Vec<_> = widths.iter().map(|width| names_of(layout, width)).collect();
        let mut found = found(layout, &widths, &all_names);
        let mut notes = Vec::new();
        drop_empty(&mut found, layout, survey, &mut notes);
        for of in &mut found {
            let has = |width: &Width| of.at.iter().any(|(columns, _)| *columns == width.columns);
            let lacking: Vec<_> = widths.iter().filter(|width| !has(width)).collect();
            of.range.missing += lacking.iter().map(|width| width.points).sum::<u64>();
        }
        fn column(of: &Found) -> Column<'_> {
            Column {
                name: &of.key.0,
                ty: None,
                values: of.range.values,
                type_with_gaps: of.range.type_with_gaps(),
            }
        }
        let file_columns: Vec<Column<'_>> = found.iter().map(column).collect();
        let fields = fields::plan(&file_columns, writer_of(layout));
        let fills: Vec<f64> =
            fields.schema.attributes.iter().map(|a| fill_of(&a.name, a.ty)).collect();
        note_missing(&found, &fields, &fills, &widths, &mut notes);
        notes.extend(fields.notes);
        if fields.schema.normals().is_some() {
            notes.push("normals are kept as 32-bit floats".into());
        }
        notes.extend(file_columns.iter().filter_map(changed_numbers));
        let mut plan = Self {
            sources: widths.iter().map(|width| (width.columns, vec![None; found.len()])).collect(),
            recipes: fields.recipes,
            fills,
            columns: all_names.into_iter().next().unwrap_or_default(),
            schema: fields.schema,
            notes,
            are_colours_full: fields.are_colours_full,
            is_legacy: fields.is_legacy,
            are_times_beyond_week: fields.are_times_beyond_week,
        };
        for (index, of) in found.iter().enumerate() {
            for &(columns, at) in &of.at {
                let sources = plan.sources.iter_mut().find(|(of, _)| *of == columns);
                sources.into_iter().for_each(|(_, sources)| sources[index] = Some(at));
            }
        }
        for (axis, &column) in layout.axes.iter().enumerate() {
            if let Some(name) = plan.columns.get_mut(column) {
                *name = ["x", "y", "z"][axis].to_owned();
            }
        }
        plan
    }
}

/// A note on numbers of a column that no type holds.
fn changed_numbers(column: &Column<'_>) -> Option<String> {
    let (name, values) = (column.name, &column.values);
    let are_doubles = column.type_with_gaps.is_some() || values.narrowest() == AttrType::F64;
    let mut changed = Vec::new();
    if values.rounded > 0 && are_doubles {
        let rounded = values.rounded;
        changed.push(format!("{rounded} whole numbers from 2^53 on are rounded to doubles"));
    }
    if values.not_finite > 0 {
        let infinite = values.not_finite;
        changed.push(format!("{infinite} values are infinite, or too large for a double"));
    }
    (!changed.is_empty()).then(|| format!("{name}: {}", changed.join("; ")))
}

/// Whether a table may be of Esker, which writes x, y and z, then all other columns by name.
fn writer_of(layout: &Layout) -> Writer {
    let names = layout.names.as_deref().unwrap_or_default();
    let is_ordered =
        |(place, others): (&[String], &[String])| place == ["x", "y", "z"] && others.is_sorted();
    let is_table = !layout.has_counts && layout.chosen.is_empty();
    if is_table && names.split_at_checked(3).is_some_and(is_ordered) {
        Writer::PerhapsEsker
    } else {
        Writer::Any
    }
}

/// The names of the columns of a width: those of the file, else guesses; those of the user first.
fn names_of(layout: &Layout, width: &Width) -> Vec<String> {
    let columns = width.columns;
    let mut names = match &layout.names {
        Some(names) if names.len() == columns => names.clone(),
        _ if layout.axes == [0, 1, 2] => {
            // Columns behind the last separator that are always empty are none.
            let is_used = |range: &Range| range.numbers + range.words > 0;
            let used = width.ranges.iter().rposition(is_used).map_or(3, |last| (last + 1).max(3));
            let ranges = &width.ranges[..used.min(columns)];
            let mut names = guessed_names(ranges, &width.units, layout.has_counts);
            names.extend((names.len() + 1..=columns).map(|n| format!("column_{n}")));
            names.truncate(columns);
            names
        }
        _ => (1..=columns).map(|n| format!("column_{n}")).collect(),
    };
    let chosen = layout.chosen.iter().filter(|(_, at)| *at < columns);
    for (name, at) in chosen {
        for (column, other) in names.iter_mut().enumerate() {
            if other == name && column != *at {
                *other = format!("column_{}", column + 1);
            }
        }
        names[*at].clone_from(name);
    }
    names
}

fn found(layout: &Layout, widths: &[&Width], all_names: &[Vec<String>]) -> Vec<Found> {
    let mut found: Vec<Found> = Vec::new();
    // Names of a wide table are many: look them up in a map.
    let mut index = std::collections::HashMap::new();
    for (width, names) in widths.iter().zip(all_names) {
        let mut seen = std::collections::HashMap::new();
        for (column, name) in names.iter().enumerate().filter(|(c, _)| !layout.axes.contains(c)) {
            let earlier = seen.entry(name.as_str()).or_insert(0);
            let key = (name.clone(), *earlier);
            *earlier += 1;
            let at = *index.entry(key.clone()).or_insert_with(|| {
                found.push(Found { key, range: Range::EMPTY, at: Vec::new() });
                found.len() - 1
            });
            found[at].range = found[at].range.merge(width.ranges[column]);
            found[at].at.push((width.columns, column));
        }
    }
    found
}

/// Leaves out columns of words, and those behind the last separator that are always empty.
fn drop_empty(found: &mut Vec<Found>, layout: &Layout, survey: &Survey, notes: &mut Vec<String>) {
    if survey.points == 0 {
        return;
    }
    let mut words = Vec::new();
    found.retain(|of| {
        let is_behind = !layout.has_counts
            && of.at.iter().all(|(_, column)| *column >= layout.least)
            && of.key.0.starts_with("column_");
        let has_none = of.range.numbers == 0;
        if has_none && of.range.words > 0 {
            words.push(of.key.0.clone());
        }
        !(has_none && (of.range.words > 0 || is_behind))
    });
    match &words[..] {
        [] => {}
        [one] => notes.push(format!("column {one} has words, not numbers, and is left out")),
        _ => notes.push(format!("columns of words are left out: {}", words.join(", "))),
    }
}

/// The value in place of a missing one: 0 for whole numbers and normals, else NaN.
pub(super) fn fill_of(name: &str, ty: AttrType) -> f64 {
    let is_float = matches!(ty, AttrType::F32 | AttrType::F64);
    let is_normal = [names::NX, names::NY, names::NZ].contains(&name);
    if is_float && !is_normal { f64::NAN } else { 0.0 }
}

fn note_missing(
    found: &[Found],
    fields: &FieldPlan,
    fills: &[f64],
    widths: &[&Width],
    notes: &mut Vec<String>,
) {
    let scans: u64 = widths.iter().map(|width| width.scans).sum();
    for (index, of) in found.iter().enumerate() {
        let attribute = fields.recipes.iter().position(|recipe| recipe.reads(index));
        let is_nan = attribute.is_some_and(|attribute| fills[attribute].is_nan());
        let (name, fill) = (&of.key.0, if is_nan { "NaN" } else { "0" });
        let has = |width: &&&Width| of.at.iter().any(|(columns, _)| *columns == width.columns);
        let lacking = widths.iter().filter(|width| !has(width));
        let (lacking, points) =
            lacking.fold((0, 0), |sum, width| (sum.0 + width.scans, sum.1 + width.points));
        if points > 0 {
            notes.push(format!("{lacking} of {scans} scans have no {name}: it is {fill} there"));
        }
        let empty = of.range.missing - points;
        if empty > 0 {
            notes.push(format!("{empty} points have no value for {name}: {fill} stands for it"));
        }
        if of.range.words > 0 {
            let words = of.range.words;
            notes.push(format!(
                "{words} points have a word, not a number, for {name}: {fill} stands for it"
            ));
        }
    }
}
