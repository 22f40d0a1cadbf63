//! The clips of a document, from and to those of a filter.

use super::values::in_field;
use anyhow::Result;
use esker_points::filter::{Bounds, Clip, ClipShape};
use esker_scene::{Keep, OrientedBox, Plane};

/// The clips of a document, also those that are not enabled.
pub(super) fn clips(forms: &[esker_scene::Clip]) -> Result<Vec<Clip>> {
    let clip = |(i, form)| in_field(format!("clips[{i}]"), clip(form));
    forms.iter().enumerate().map(clip).collect()
}

fn clip(form: &esker_scene::Clip) -> Result<Clip> {
    let shape = match (&form.bounds, &form.oriented_box, &form.plane) {
        (Some([x0, y0, z0, x1, y1, z1]), None, None) => {
            ClipShape::Box(Bounds { min: [*x0, *y0, *z0], max: [*x1, *y1, *z1] })
        }
        (None, Some(OrientedBox { centre, size, rotation }), None) => {
            ClipShape::Oriented { centre: *centre, size: *size, rotation: *rotation }
        }
        (None, None, Some(Plane { point, normal })) => {
            ClipShape::Plane { point: *point, normal: *normal }
        }
        _ => anyhow::bail!("needs one of `box`, `oriented_box` and `plane`"),
    };
    let keeps_outside = form.keep == Keep::Outside;
    let clip = Clip { name: form.name.clone(), is_on: form.enabled, keeps_outside, shape };
    clip.check()?;
    Ok(clip)
}

/// The document's form of clips.
pub(super) fn forms(clips: &[Clip]) -> Result<Vec<esker_scene::Clip>> {
    clips.iter().map(form).collect()
}

fn form(clip: &Clip) -> Result<esker_scene::Clip> {
    clip.check()?;
    let empty = esker_scene::Clip {
        name: clip.name.clone(),
        enabled: clip.is_on,
        keep: if clip.keeps_outside { Keep::Outside } else { Keep::Inside },
        bounds: None,
        oriented_box: None,
        plane: None,
    };
    Ok(match clip.shape {
        ClipShape::Box(Bounds { min: [x0, y0, z0], max: [x1, y1, z1] }) => {
            esker_scene::Clip { bounds: Some([x0, y0, z0, x1, y1, z1]), ..empty }
        }
        ClipShape::Oriented { centre, size, rotation } => {
            let oriented_box = Some(OrientedBox { centre, size, rotation });
            esker_scene::Clip { oriented_box, ..empty }
        }
        ClipShape::Plane { point, normal } => {
            esker_scene::Clip { plane: Some(Plane { point, normal }), ..empty }
        }
    })
}
