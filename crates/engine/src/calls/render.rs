//! Drawing as a call: opens a file (or builds one from scans first), chooses what the view needs,
//! reads just the planes that the frame asks for, draws, and writes the picture.

use crate::calls::explain;
use crate::draw::empty_picture;
use crate::draw::scene::{PictureRequest, PictureScene, ms, open};
use crate::draw::whole;
use crate::io::output;
use crate::io::picture;
use crate::io::stages::taken;
use crate::machine::backend::{Backend, Drawer};
use crate::machine::pool;
use anyhow::Result;
use esker_format::{Forest, Planes};
use esker_lod::CompactOctree;
use esker_points::Task;
use esker_render::{Pass, Picture, Renderer};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Draws `inputs` (one `.esker` file with those that it names, or scans) to the PNG file `out`;
/// what it did, for machines.
///
/// # Errors
/// Where the input cannot be read, a filter leaves no point of it, or the picture cannot be
/// written.
pub fn render(
    inputs: &[PathBuf],
    out: &Path,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<Value> {
    pool::run(request.threads, || {
        let start = Instant::now();
        output::may_write(out, inputs)?;
        picture::check_name(out)?;
        picture::check_size(request.size, request.method)?;
        let (file, _folder) = open(inputs, request, task)?;
        let open_ms = ms(start);
        let (picture, mut report) = draw(&file, request, task)?;
        let start = Instant::now();
        picture::write_png(&picture, out)?;
        report["stages_ms"]["open"] = json!(open_ms);
        report["stages_ms"]["write"] = json!(ms(start));
        report["picture"] = json!(out.display().to_string());
        Ok(report)
    })
}

/// What a picture of `inputs` would take, without reading or drawing any of it: the plan of its
/// frame.
///
/// # Errors
/// Where the input cannot be read, or has not what is asked for.
pub fn explain(inputs: &[PathBuf], request: &PictureRequest, task: &dyn Task) -> Result<Value> {
    pool::run(request.threads, || {
        let (file, _folder) = open(inputs, request, task)?;
        explain::explain(&file, request)
    })
}

/// Draws an opened file; the picture and what it took.
///
/// # Errors
/// Where planes cannot be read, the filter leaves no point, or a GPU is asked for and there is
/// none, or it fails.
pub fn draw(file: &Forest, request: &PictureRequest, task: &dyn Task) -> Result<(Picture, Value)> {
    let scene = PictureScene::read(file, request, task)?;
    let (gpu, mut drawer) = request.with.choose(None)?;
    let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
    let start = Instant::now();
    let drawn = gpu.map(|gpu| whole::draw(&gpu, file, &scene, &octree));
    let picture = match drawn {
        Some(Ok(picture)) => picture,
        Some(Err(fault)) if request.with.backend != Backend::Auto => return Err(fault.into()),
        fault => {
            if let Some(Err(fault)) = fault {
                drawer = Drawer::cpu(fault.to_string());
            }
            let draws = scene.draws(file);
            let frame = scene.look.frame(file, &scene.view, &draws, &octree);
            Renderer::default().render(&frame)?
        }
    };
    if picture.stats.pixels_covered == 0 {
        empty_picture::check_wanted(file, &scene.look.shown)?;
    }
    let mut report = report(&picture, &scene);
    report["notes"] = json!(notes(file, request, &scene, &picture)?);
    report["drawn_by"] = drawer.report();
    report["stages_ms"]["all_drawing"] = json!(ms(start));
    Ok((picture, report))
}

/// What the user should know of a picture that may not be what was meant, a line each.
fn notes(
    file: &Forest,
    request: &PictureRequest,
    scene: &PictureScene,
    picture: &Picture,
) -> Result<Vec<&'static str>> {
    let counters = &scene.selection.counters;
    let is_empty = picture.stats.pixels_covered == 0;
    let nothing =
        is_empty.then(|| empty_picture::why_nothing(file, request.budget_points, counters));
    Ok(nothing.into_iter().chain(explain::exposure_note(file, scene)?).collect())
}

fn report(picture: &Picture, scene: &PictureScene) -> Value {
    let stats = &picture.stats;
    let (view, counters) = (scene.view.with_margin(0), &scene.selection.counters);
    json!({
        "points_drawn": stats.points_drawn,
        "nodes_drawn": stats.nodes_drawn,
        "pixels_covered": stats.pixels_covered,
        "pixels_projected": stats.pixels_projected,
        "splats_drawn": stats.splats_drawn,
        "splats_dropped": stats.splats_dropped,
        "width": picture.width,
        "height": picture.height,
        "camera": {
            "eye": view.eye.to_array(), "forward": view.forward().to_array(),
            "up": view.world_from_view.y_axis.to_array(), "fovy": view.fovy_rad.to_degrees(),
        },
        "colour": scene.look.colouring.legend.json(),
        "legend": scene.look.colouring.legend.text(),
        "bytes_read": scene.read_bytes,
        "bytes_resident": scene.planes.iter().map(Planes::bytes).sum::<u64>(),
        "nodes_visited": counters.visited,
        "nodes_filtered": counters.filtered,
        "nodes_culled": counters.culled + counters.contour_culled,
        "stages_ms": stages_ms(scene, picture),
    })
}

/// What each stage of a picture took, by its name.
fn stages_ms(scene: &PictureScene, picture: &Picture) -> Value {
    let stages = &picture.stats.stages;
    let mut all =
        json!({ "select": scene.select_ms, "read": scene.read_ms, "draw": stages.total_ms });
    for pass in Pass::ALL {
        all[pass.name()] = json!(stages.ms(pass));
    }
    all
}

/// [`render`]'s report for people.
pub fn text(report: &Value) -> String {
    let n = |name: &str| crate::io::quantity::grouped(report[name].as_u64().unwrap_or(0));
    let mut lines = vec![format!(
        "{}: {} points of {} nodes, {} of {} pixels covered{}\n{}\
         ms: {}",
        report["picture"].as_str().unwrap_or("?"),
        n("points_drawn"),
        n("nodes_drawn"),
        n("pixels_covered"),
        crate::io::quantity::grouped(
            report["width"].as_u64().unwrap_or(0) * report["height"].as_u64().unwrap_or(0)
        ),
        report["drawn_by"]["adapter"].as_str().map_or(String::new(), |name| format!(", by {name}")),
        legend_line(report),
        taken(&report["stages_ms"], &["select", "read"], "draw"),
    )];
    let notes = report["notes"].as_array().into_iter().flatten();
    lines.extend(notes.filter_map(Value::as_str).map(|note| format!("note: {note}")));
    lines.join("\n")
}

/// What the colours mean, a line.
fn legend_line(report: &Value) -> String {
    report["legend"].as_str().map_or(String::new(), |text| format!("colour: {text}\n"))
}
