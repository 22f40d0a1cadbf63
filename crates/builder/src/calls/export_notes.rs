//! Notes of an export on what the points of its files lack or share: attributes that some points do
//! not have, and trees that overlap where points are thinned. In: the files; out: lines for the
//! user.

use esker_format::Forest;
use esker_points::attribute::names;
use esker_points::{AttrType, Attribute, Filter};
use esker_scan::write::Target;

/// A note if trees are thinned separately although their boxes overlap.
pub(super) fn note_overlap(forest: &Forest, filter: &Filter) -> Option<String> {
    let boxes: Vec<_> = forest.files().filter_map(|file| file.metadata().bounds).collect();
    let meet = |[low, high]: &[[u32; 3]; 2], [l, h]: &[[u32; 3]; 2]| {
        (0..3).all(|i| low[i] <= h[i] && l[i] <= high[i])
    };
    let overlap = (0..boxes.len()).any(|i| boxes[..i].iter().any(|other| meet(&boxes[i], other)));
    (filter.max_spacing.is_some() && overlap).then(|| {
        "the spacing is that of each tree by itself, and trees overlap: there are more points; esker build --merge makes one tree of them".into()
    })
}

/// A note on attributes that some points lack, and which are zero in the export. An attribute is
/// not missing where its output field was made from another attribute of the points.
pub(super) fn note_absent(forest: &Forest, fields: &[usize], target: Target) -> Vec<String> {
    let attributes = &forest.schema().attributes;
    // LAS demands the number of a return, so it is not 0 there: see `Output::remarks`.
    let is_zero =
        |at: &usize| !target.is_las() || attributes[*at].key() != (names::RETURNS, AttrType::U8);
    let absent: Vec<&Attribute> = (0..attributes.len())
        .filter(is_zero)
        .filter(|&at| {
            let of_field: Vec<_> = (0..attributes.len())
                .filter(|&other| fields.get(other) == fields.get(at))
                .map(|other| (attributes[other].name.as_str(), attributes[other].ty))
                .collect();
            // A tree without points lacks nothing.
            forest
                .files()
                .any(|file| file.footer().points > 0 && !file.layout().all_have_one_of(&of_field))
        })
        .map(|at| &attributes[at])
        .collect();
    // A stored zero means the offset, where an attribute has one.
    let (zero, offset): (Vec<_>, Vec<_>) = absent.into_iter().partition(|a| a.offset == 0.0);
    let zero: Vec<&str> = zero.iter().map(|a| a.name.as_str()).collect();
    let offset: Vec<String> = offset.iter().map(|a| format!("{} ({})", a.name, a.offset)).collect();
    let mut notes = Vec::new();
    if !zero.is_empty() {
        notes.push(format!("zero where a point's source had none: {}", zero.join(", ")));
    }
    if !offset.is_empty() {
        notes.push(format!(
            "their offset, which is a stored zero, where a point's source had none: {}",
            offset.join(", ")
        ));
    }
    notes
}
