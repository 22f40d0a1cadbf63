//! From the columns of a source (text, PLY, PCD) to attributes: which column is a field of LAS, a
//! colour or a part of one of these by its name and its values, and how the attribute is made from
//! it. What does not fit its field stays an attribute under its own name, with a note.

mod colours;
mod column;
pub(crate) mod names;
mod planner;
pub(crate) mod recipe;
pub(crate) mod values;

pub(crate) use column::{Column, FieldPlan, HALVES, Writer};
use esker_points::AttrType;
use esker_points::attribute::names as esker;

use column::RGB;
use names::{ALPHA, Meaning, meaning};
use planner::Planner;

/// Block of a source that states that its values fit the fields of point formats 0 to 5, which hold
/// whole degrees exactly.
pub(crate) const LEGACY_BLOCK: &str = "LAS fields";
/// Content of that block.
pub(crate) const LEGACY: &[u8] = b"as in point formats 0 to 5";
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

/// Plans the attributes made from `columns` of a source of this `writer`.
pub(crate) fn plan(columns: &[Column<'_>], writer: Writer) -> FieldPlan {
    let mut planner = Planner::new(columns, writer);
    planner.join_halves();
    planner.colours();
    planner.packed();
    planner.angles();
    planner.fields();
    planner.own();
    planner.finish()
}
