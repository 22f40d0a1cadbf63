//! What a source gives of a column, and what is planned for all of them.

use super::recipe::Recipe;
use super::values::Values;
use esker_points::attribute::names as esker;
use esker_points::{AttrType, Schema};
use std::sync::Arc;

/// Red, green and blue.
pub(super) const RGB: [&str; 3] = [esker::RED, esker::GREEN, esker::BLUE];
/// Endings of the two properties that a 64-bit integer is written as in PLY.
pub(crate) const HALVES: [&str; 2] = ["_low", "_high"];

/// A column of a source that is no coordinate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column<'a> {
    /// Name in the file.
    pub name: &'a str,
    /// Type in the file; `None` for text, whose values have none.
    pub ty: Option<AttrType>,
    /// What the first pass found.
    pub values: Values,
    /// The type of an attribute made from it that is no field, if points lack values: one that has
    /// NaN for them.
    pub type_with_gaps: Option<AttrType>,
}

/// Who wrote a source, as far as it shows that. Bytes that Esker packs have names that other
/// programs use for something else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Writer {
    /// Any program.
    #[default]
    Any,
    /// Perhaps Esker: a table with its names of coordinates, and its order of columns.
    PerhapsEsker,
    /// Esker, as a comment states.
    Esker,
}

/// Attributes made from the columns of a source.
#[derive(Clone, Debug)]
pub(crate) struct FieldPlan {
    /// The attributes.
    pub schema: Arc<Schema>,
    /// How each is made.
    pub recipes: Vec<Recipe>,
    /// What is converted, assumed or not fit, a line each.
    pub notes: Vec<String>,
    /// Whether 16-bit colours use all bits, however dark they are.
    pub are_colours_full: bool,
    /// Greatest value of 16-bit colours.
    pub colour_max: u16,
    /// Whether the values fit the fields of LAS point formats 0 to 5, and need them.
    pub is_legacy: bool,
    /// Whether GPS times lie outside of a week, so that they are no seconds of one.
    pub are_times_beyond_week: bool,
}
