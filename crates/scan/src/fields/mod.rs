//! From the columns of a source (text, PLY, PCD) to attributes: which column is a field of LAS, a
//! colour or a part of one of these by its name and its values, and how the attribute is made from
//! it. What does not fit its field stays an attribute under its own name, with a note.

mod colours;
pub(crate) mod names;
mod planner;
pub(crate) mod recipe;
pub(crate) mod values;

use esker_points::attribute::names as esker;
use esker_points::{AttrType, Schema};
use names::{ALPHA, Meaning, meaning};
use planner::Planner;
use recipe::Recipe;
use std::sync::Arc;
use values::Values;

/// Block of a source that states that its values fit the fields of point formats 0 to 5, which hold
/// whole degrees exactly.
pub(crate) const LEGACY_BLOCK: &str = "LAS fields";
/// Content of that block.
pub(crate) const LEGACY: &[u8] = b"as in point formats 0 to 5";
/// Red, green and blue.
const RGB: [&str; 3] = [esker::RED, esker::GREEN, esker::BLUE];
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
}

/// Whether more than the range is needed of the values of a column of this name.
pub(crate) fn is_watched(name: &str) -> bool {
    meaning(name).is_some()
}

/// Whether the values of a column of this name and type decide what it means. A pass over them
/// costs time, so columns of common types are left out.
pub(crate) fn is_watched_as(name: &str, ty: AttrType) -> bool {
    let Some(meaning) = meaning(name) else { return false };
    let Meaning::Field(field) = meaning else { return true };
    let is_byte_anyway = RGB.contains(&field) || [ALPHA, esker::USER_DATA].contains(&field);
    match ty {
        AttrType::U8 => !is_byte_anyway && field != esker::INTENSITY,
        AttrType::U16 => field != esker::INTENSITY && field != esker::POINT_SOURCE_ID,
        AttrType::F32 | AttrType::F64 => ![esker::NX, esker::NY, esker::NZ].contains(&field),
        _ => true,
    }
}

/// Plans the attributes made from `columns`.
pub(crate) fn plan(columns: &[Column<'_>]) -> FieldPlan {
    let mut planner = Planner::new(columns);
    planner.join_halves();
    planner.colours();
    planner.packed();
    planner.angles();
    planner.fields();
    planner.own();
    planner.finish()
}
