//! The picture of a document: from its fields to a request, by the parsers of the command line, so
//! that limits and messages are the same; and from a request to the fields.

use super::values::{decimal, in_field};
use super::{build, clips, filter, lights};
use crate::cameras::camera::{Camera, OrthoHeight};
use crate::cameras::colour_request::ColourRequest;
use crate::draw::method::{METHODS, method_of_name};
use crate::draw::scene::PictureRequest;
use crate::io::quantity;
use anyhow::{Context, Result, ensure};
use esker_lod::Window;
use esker_points::Filter;
use esker_render::{Dots, PointSize};
use esker_scene::{CameraParts, Quantity, Scene};
use std::path::Path;

/// Request of the picture of a document in `folder`.
pub(super) fn request(scene: &Scene, folder: &Path) -> Result<PictureRequest> {
    let default = PictureRequest::of_options();
    let size = scene.size.map(|[w, h]| quantity::picture_size(&format!("{w}x{h}")));
    let method = scene.method.as_ref().map(|name| {
        let names = || METHODS.map(|(_, name, _)| name).join(", ");
        method_of_name(name).with_context(|| format!("`{name}` is none of {}", names()))
    });
    let spacing = scene.target_spacing.map(|px| quantity::spacing_px(&px.to_string()));
    let budget = scene.budget_ms.map(|ms| quantity::milliseconds(&ms.to_string()));
    let colour = scene.colour.as_ref().map(|text| ColourRequest::parse(text).map(drop));
    in_field("colour", colour.transpose())?;
    let point_size = scene.point_size.as_ref().map(|s| quantity::point_size(&s.to_string()));
    let eye_dome = scene.eye_dome.map(|strength| quantity::strength(&strength.to_string()));
    Ok(PictureRequest {
        size: in_field("size", size.transpose())?.unwrap_or(default.size),
        window: scene.window.map(|[x, y, width, height]| Window { x, y, width, height }),
        method: in_field("method", method.transpose())?.unwrap_or(default.method),
        camera: in_field("camera", Camera::parse(&scene.camera.text()))?,
        budget_points: scene.budget_points.unwrap_or(default.budget_points),
        target_spacing_px: in_field("target_spacing", spacing.transpose())?
            .unwrap_or(default.target_spacing_px),
        budget_ms: in_field("budget_ms", budget.transpose())?,
        colour_by: scene.colour.clone(),
        filter: Filter {
            clips: clips::clips(&scene.clips)?,
            ..filter::filter(&scene.filter, folder)?
        },
        shines: !scene.no_highlights,
        evens_exposure: scene.even_exposure,
        culls_back: scene.cull_back,
        dots: Dots {
            size: in_field("point_size", point_size.transpose())?.unwrap_or_default(),
            eye_dome: in_field("eye_dome", eye_dome.transpose())?.unwrap_or_default(),
        },
        full: scene.full,
        light: lights::settings(&scene.light, folder)?,
        build: build::options(&scene.build)?,
        ..default
    })
}

/// A document in `folder` with the picture of a request, without clouds.
pub(super) fn scene(request: &PictureRequest, folder: &Path) -> Result<Scene> {
    // All fields are named, so that no new one is forgotten; the machine's are left out.
    let PictureRequest {
        size,
        window,
        method,
        camera,
        budget_points,
        target_spacing_px,
        budget_ms,
        colour_by,
        filter,
        shines,
        evens_exposure,
        culls_back,
        dots,
        keeps_values,
        full,
        light,
        build,
        with: _,
        threads: _,
        // Those of the clouds.
        offsets: _,
    } = request;
    ensure!(!keeps_values, "this picture is for comparisons, no document can hold it");
    let default = PictureRequest::of_options();
    let name = METHODS.iter().find(|(own, ..)| own == method && *own != default.method);
    Ok(Scene {
        build: build::form(build)?,
        camera: esker_scene::Camera::Parts(camera_parts(camera)),
        size: other(*size, default.size),
        window: window.map(|Window { x, y, width, height }| [x, y, width, height]),
        method: name.map(|(_, name, _)| (*name).to_owned()),
        budget_points: other(*budget_points, default.budget_points),
        budget_ms: *budget_ms,
        target_spacing: other(*target_spacing_px, default.target_spacing_px),
        colour: colour_by.clone(),
        filter: filter::form(filter)?,
        clips: clips::forms(&filter.clips)?,
        no_highlights: !shines,
        cull_back: *culls_back,
        point_size: other(dots.size, default.dots.size).map(|size| match size {
            PointSize::Pixels(pixels) => Quantity::Number(decimal(pixels)),
            PointSize::Adaptive => Quantity::Word("adaptive".into()),
        }),
        eye_dome: other(dots.eye_dome, default.dots.eye_dome).map(decimal),
        even_exposure: *evens_exposure,
        full: *full,
        light: lights::form(light, folder)?,
        ..Scene::default()
    })
}

/// A value, if it is not the default.
fn other<T: PartialEq>(value: T, default: T) -> Option<T> {
    (value != default).then_some(value)
}

fn camera_parts(camera: &Camera) -> CameraParts {
    let [eye, target, up, direction] =
        [camera.eye, camera.target, camera.up, camera.direction].map(|v| v.map(|v| v.to_array()));
    let ortho = camera.ortho.map(|height| match height {
        OrthoHeight::Units(height) => Quantity::Number(height),
        OrthoHeight::Fit => Quantity::Word("fit".into()),
    });
    CameraParts { eye, target, up, direction, fovy: camera.fovy_deg, ortho }
}
