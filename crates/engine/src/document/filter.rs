//! The filter of a document, without its clips, from and to the one that is drawn.

use super::values::{in_field, joined};
use crate::io::{polygon, quantity};
use anyhow::{Result, ensure};
use esker_points::filter::{Bounds, Filter, Flags, Polygon};
use esker_scene::PolygonForm;
use std::path::Path;

/// The filter of a document in `folder`, without clips.
pub(super) fn filter(form: &esker_scene::Filter, folder: &Path) -> Result<Filter> {
    let flags = |field: &str, text: &Option<String>| -> Result<Flags> {
        text.as_ref().map_or(Ok(Flags::default()), |text| in_field(field, text.parse()))
    };
    let bounds = form.bounds.as_ref().map(|numbers| joined(numbers).parse::<Bounds>());
    let shape = form.polygon.as_ref().map(|form| shape(form, folder));
    let classes = form.classes.as_ref().map(|text| text.parse());
    let length = form.max_spacing.map(|length| quantity::length(&length.to_string()));
    Ok(Filter {
        bounds: in_field("filter.box", bounds.transpose())?,
        polygon: in_field("filter.polygon", shape.transpose())?,
        clips: Vec::new(),
        classes: in_field("filter.classes", classes.transpose())?,
        flags: flags("filter.flags", &form.flags)?,
        without_flags: flags("filter.without_flags", &form.without_flags)?,
        values: in_field("filter.where", form.values.iter().map(|text| text.parse()).collect())?,
        max_spacing: in_field("filter.max_spacing", length.transpose())?,
    })
}

fn shape(form: &PolygonForm, folder: &Path) -> Result<Polygon> {
    match form {
        PolygonForm::Word(word) => polygon::read_in(word, folder),
        PolygonForm::Polygons(polygons) => Ok(Polygon::any_of(polygons.clone())?),
    }
}

/// The document's form of a filter.
pub(super) fn form(filter: &Filter) -> Result<esker_scene::Filter> {
    let classes = filter.classes.map(|classes| classes.to_string());
    ensure!(classes.as_deref() != Some(""), "a filter of no classes cannot be written");
    let flags = |flags: Flags| (!flags.is_empty()).then(|| flags.to_string());
    Ok(esker_scene::Filter {
        bounds: filter.bounds.map(|Bounds { min: [x0, y0, z0], max: [x1, y1, z1] }| {
            let is_flat = z0 == f64::NEG_INFINITY && z1 == f64::INFINITY;
            if is_flat { vec![x0, y0, x1, y1] } else { vec![x0, y0, z0, x1, y1, z1] }
        }),
        polygon: filter.polygon.as_ref().map(polygon_form),
        classes,
        flags: flags(filter.flags),
        without_flags: flags(filter.without_flags),
        values: filter.values.iter().map(ToString::to_string).collect(),
        max_spacing: filter.max_spacing,
    })
}

/// One ring is written as on the command line.
fn polygon_form(polygon: &Polygon) -> PolygonForm {
    match polygon.polygons() {
        [rings] if rings.len() == 1 => {
            let corners = rings[0].iter().map(|[x, y]| format!("{x},{y}"));
            PolygonForm::Word(corners.collect::<Vec<_>>().join(" "))
        }
        polygons => PolygonForm::Polygons(polygons.to_vec()),
    }
}
