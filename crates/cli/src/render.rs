//! `esker render`: the picture of the options, of a scene document, or of a document with options
//! that replace some of its fields; and the document of that picture.

use crate::args::Render;
use crate::shared::note_built;
use anyhow::{Result, ensure};
use esker_engine::Method;
use esker_engine::calls::{explain, render};
use esker_engine::cameras::vertical::Vertical;
use esker_engine::document::{self, Document};
use esker_engine::draw::scene::PictureRequest;
use esker_engine::io::visible::visible;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What a command line asks for.
struct Asked {
    document: Option<Document>,
    inputs: Vec<PathBuf>,
    request: PictureRequest,
}

/// Draws the picture and prints the report; or explains it; or writes its document.
pub fn run(args: Render, stop: Arc<AtomicBool>) -> Result<()> {
    let Asked { document, inputs, request } = asked(&args)?;
    let Render { how, output, .. } = &args;
    note_built(&inputs, how);
    let from = document.as_ref();
    for note in from.filter(|_| args.out.is_some()).iter().flat_map(|document| document.notes()) {
        eprintln!("note: {}", visible(&note));
    }
    let scene = args.save_scene.as_deref();
    if let Some(scene) = scene {
        document::may_save(scene, &inputs, from)?;
    }
    match (args.out.as_deref().filter(|_| !args.explain), scene) {
        (None, None) => {
            output.report(stop, |p| explain::explain(&inputs, &request, p), explain::text)
        }
        (None, Some(scene)) => {
            output.report(stop, |_| document::save(scene, &inputs, from, &request), document::text)
        }
        (Some(out), scene) => output.report(
            stop,
            |progress| {
                let mut report = render::render(&inputs, out, &request, progress)?;
                if let Some(scene) = scene {
                    report.scene = Some(document::save(scene, &inputs, from, &request)?.scene);
                }
                Ok(report)
            },
            render::text,
        ),
    }
}

/// Reads the document, if one is named, and replaces what options state.
fn asked(args: &Render) -> Result<Asked> {
    let document = Document::among(&args.inputs)?;
    let (inputs, base) = match &document {
        Some(document) => {
            let request = document.request()?;
            (document.inputs()?, request)
        }
        None => (args.inputs.clone(), PictureRequest::of_options()),
    };
    let request = replaced(args, base);
    args.camera.map(|camera| camera.with_up(args.up)).transpose()?;
    args.light.check(request.method)?;
    let has_dots = args.point_size.is_some() || args.eye_dome.is_some();
    ensure!(
        !has_dots || request.method == Method::Points,
        "--point-size and --eye-dome are for points that are drawn alone: add --method points"
    );
    let light = &request.light;
    ensure!(
        light.gloss.is_none() || !light.filters_shadows,
        "--gloss and --filter-shadows exclude each other, and the document has one of them"
    );
    Ok(Asked { document, inputs, request })
}

/// A request with the options that are given in place of its own.
fn replaced(args: &Render, base: PictureRequest) -> PictureRequest {
    let mut camera = args.camera.unwrap_or(base.camera);
    camera.up = args.up.map(Vertical::direction).or(camera.up);
    if args.fit {
        (camera.eye, camera.target) = (None, None);
    }
    let mut dots = base.dots;
    dots.size = args.point_size.unwrap_or(dots.size);
    dots.eye_dome = args.eye_dome.unwrap_or(dots.eye_dome);
    PictureRequest {
        size: args.size.unwrap_or(base.size),
        window: args.window.or(base.window),
        method: args.method.unwrap_or(base.method),
        camera,
        budget_points: args.budget_points.unwrap_or(base.budget_points),
        budget_ms: args.budget_ms.or(base.budget_ms),
        target_spacing_px: args.target_spacing.unwrap_or(base.target_spacing_px),
        colour_by: args.light.colour_by(args.colour.clone()).or(base.colour_by),
        filter: args.filter.over(base.filter),
        shines: base.shines && !args.no_highlights,
        evens_exposure: base.evens_exposure || args.even_exposure,
        culls_back: base.culls_back || args.cull_back,
        dots,
        full: base.full || args.full,
        light: args.light.over(base.light),
        with: (&args.with).into(),
        threads: args.how.threads.count,
        build: args.how.over(base.build),
        offsets: base.offsets,
        keeps_values: base.keeps_values,
    }
}
