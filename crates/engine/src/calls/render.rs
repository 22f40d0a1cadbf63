//! Drawing a still picture as a call: opens a file, or builds scans into one; chooses what the view
//! needs, reads only the planes that the frame needs, draws, and writes a PNG. Returns a
//! [`RenderReport`].

use crate::calls::{explain, info};
use crate::cameras::legend::Legend;
use crate::cameras::up::GuessedUp;
use crate::draw::calibration;
use crate::draw::choice;
use crate::draw::empty_picture;
use crate::draw::enlarge::enlarged;
use crate::draw::facing;
use crate::draw::layers::{LayerChoice, Layers};
use crate::draw::method::{METHODS, Method};
use crate::draw::scene::{PictureRequest, PictureScene, completed, ms, open_in_parts};
use crate::draw::whole;
use crate::draw::window::{self, cropped};
use crate::io::output;
use crate::io::picture;
use crate::io::quantity::grouped;
use crate::io::stages;
use crate::light::check_built;
#[cfg(feature = "light")]
use crate::light::still;
use crate::machine::backend::{Backend, DrawWith, Drawer, DrawerReport};
use crate::machine::pool;
use anyhow::{Result, ensure};
use esker_format::{Forest, Planes};
use esker_lod::{CompactOctree, View};
use esker_points::{Lattice, Task};
use esker_render::gpu::Gpu;
use esker_render::{PassTimes, Picture, Renderer};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What drawing a picture did.
#[derive(Clone, Debug, Serialize)]
pub struct RenderReport {
    /// Path of the picture; none if it was not written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub picture: Option<String>,
    /// Path of the scene document of the picture; none if none was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// Points that were projected.
    pub points_drawn: u64,
    /// Nodes with such a point.
    pub nodes_drawn: u32,
    /// Pixels that show a surface.
    pub pixels_covered: u64,
    /// Pixels that a point was projected to.
    pub pixels_projected: u64,
    /// Splats in the picture.
    pub splats_drawn: u64,
    /// Splats that the eye is in the plane of.
    pub splats_dropped: u64,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Camera of the picture.
    pub camera: CameraReport,
    /// Meaning of the colours.
    pub colour: Legend,
    /// Meaning of the colours as text.
    pub legend: String,
    /// Bytes that were read.
    pub bytes_read: u64,
    /// Bytes of the planes that the picture was drawn from.
    pub bytes_resident: u64,
    /// Nodes that the choice visited.
    pub nodes_visited: u64,
    /// Nodes that the filter rejected.
    pub nodes_filtered: u64,
    /// Nodes outside the view.
    pub nodes_culled: u64,
    /// Times of all stages.
    pub stages_ms: RenderTimes,
    /// What drew the picture.
    pub drawn_by: DrawerReport,
    /// What lit the picture; none if nothing did.
    #[cfg(feature = "light")]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<still::LightReport>,
    /// Settings that were chosen for a budget of time; none without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pace: Option<PaceReport>,
    /// What the user should know, a line each.
    pub notes: Vec<&'static str>,
}

/// Settings that were chosen for a budget of time.
#[derive(Clone, Debug, Serialize)]
pub struct PaceReport {
    /// Time that a frame may take, milliseconds.
    pub budget_ms: f64,
    /// Time that the model of this machine predicts for a frame, after the first one.
    pub predicted_ms: f64,
    /// CPU time that it predicts, over all threads.
    pub predicted_cpu_ms: f64,
    /// CPU time of a small picture of the view over what the model of this machine predicts for
    /// it: the prediction is corrected by this factor.
    pub correction: f64,
    /// Method.
    pub method: &'static str,
    /// Side of the picture that was drawn and enlarged, over that of the written one.
    pub scale: f64,
    /// Target of points, pixels of the picture that was drawn.
    pub target_spacing_px: f64,
    /// Most points.
    pub budget_points: u64,
}

/// Camera of a picture.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct CameraReport {
    /// Position, in the scan's coordinates.
    pub eye: [f64; 3],
    /// Direction of view; in metres on all axes where the coordinates are degrees.
    pub forward: [f64; 3],
    /// Direction of the picture's upper side.
    pub up: [f64; 3],
    /// Vertical field of view, degrees; none if the projection is parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fovy: Option<f64>,
    /// Height of the picture, the file's unit, if the projection is parallel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ortho: Option<f64>,
}

/// Times of the stages of a picture, milliseconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RenderTimes {
    /// Opening the file, or building it; none if it was open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub open: Option<f64>,
    /// Choosing nodes.
    pub select: f64,
    /// Reading their planes.
    pub read: f64,
    /// The passes of the frame, and the whole frame as `draw`.
    #[serde(flatten, serialize_with = "stages::serialize_draw")]
    pub frame: PassTimes,
    /// The frame, and on a GPU the copy of the planes to it and of the picture from it.
    pub all_drawing: f64,
    /// Writing the picture; none if it was not written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub write: Option<f64>,
}

/// Draws `inputs`, an `.esker` file with the files that it names, or scans, to the PNG file `out`.
///
/// # Errors
/// If an input cannot be read, the filter leaves no point, or the picture cannot be written.
pub fn render(
    inputs: &[PathBuf],
    out: &Path,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<RenderReport> {
    pool::run(request.threads, || {
        let start = Instant::now();
        output::may_write(out, inputs)?;
        picture::check_name(out)?;
        let is_lit = request.method == Method::Lit;
        let size = if is_lit { request.size } else { request.shown_size() };
        picture::check_size(size, request.method)?;
        if is_lit {
            check_built()?;
        }
        let (file, _folder) = open_in_parts(inputs, request, task)?;
        let open_ms = ms(start);
        let (picture, mut report) = draw(&file, request, task)?;
        let start = Instant::now();
        picture::write_png(&picture, out)?;
        report.stages_ms.open = Some(open_ms);
        report.stages_ms.write = Some(ms(start));
        report.picture = Some(out.display().to_string());
        Ok(report)
    })
}

/// Draws a picture of an open file.
///
/// # Errors
/// If planes cannot be read, the filter leaves no point, or the user insists on a GPU and there is
/// none, or it fails.
pub fn draw(
    file: &Forest,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<(Picture, RenderReport)> {
    if let Some(grown) = completed(file, request, task)? {
        return draw(&grown, request, task);
    }
    if let Some(budget_ms) = request.budget_ms {
        return draw_within(file, request, budget_ms, task);
    }
    if request.method == Method::Lit {
        return draw_lit_window(file, request, task);
    }
    let (picture, report, _) = draw_with_layers(file, request, LayerChoice::default(), task)?;
    Ok((picture, report))
}

/// Draws a picture of an open file like [`draw`], without a budget of time and not lit, with the
/// `wanted` images beside it.
///
/// # Errors
/// As for [`draw`]; also if the picture is lit, or for a budget of time.
pub fn draw_with_layers(
    file: &Forest,
    request: &PictureRequest,
    wanted: LayerChoice,
    task: &dyn Task,
) -> Result<(Picture, RenderReport, Layers)> {
    ensure!(
        request.method != Method::Lit && request.budget_ms.is_none(),
        "normals and points are of pictures that are neither lit nor drawn for a time"
    );
    let scene = PictureScene::read(file, request, task)?;
    if let Some(drawn) = scene.view.window {
        picture::check_size([drawn.width, drawn.height], request.method)?;
    }
    let octree =
        CompactOctree::with_hidden(file.table(), &scene.selection.drawn, &scene.selection.hidden);
    let (gpu, mut drawer) = request.with.choose(None)?;
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
            let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
            Renderer::default().render(&frame)?
        }
    };
    let picture = cropped(picture, scene.window);
    if picture.stats.pixels_covered == 0 {
        empty_picture::check_wanted(file, &scene.appearance.shown)?;
    }
    let notes = notes(file, request, &scene, &picture)?;
    let report = RenderReport::new(&picture, &scene, &drawer, notes, ms(start));
    let layers = Layers::of(file, request, &scene, &octree, &picture, wanted)?;
    Ok((picture, report, layers))
}

/// Draws a picture with the settings that the model of this machine chooses for a time.
fn draw_within(
    file: &Forest,
    request: &PictureRequest,
    budget_ms: f64,
    task: &dyn Task,
) -> Result<(Picture, RenderReport)> {
    ensure!(
        request.with.backend != Backend::Gpu,
        "a budget of time is for the CPU, whose speed is measured: draw with --backend cpu"
    );
    let paced = choice::paced(file, request, &calibration::pace(task)?, budget_ms, task)?;
    let with = DrawWith { backend: Backend::Cpu, ..request.with };
    let chosen = PictureRequest { budget_ms: None, with, ..paced.request };
    let (picture, mut report) = draw(file, &chosen, task)?;
    let picture = enlarged(&picture, request.size);
    (report.width, report.height) = (picture.width, picture.height);
    let method = METHODS.iter().find(|(method, ..)| *method == chosen.method);
    report.pace = Some(PaceReport {
        budget_ms,
        predicted_ms: paced.wall_ms,
        predicted_cpu_ms: paced.cpu_ms,
        correction: paced.correction,
        method: method.map_or("", |(_, name, _)| *name),
        scale: paced.scale,
        target_spacing_px: chosen.target_spacing_px,
        budget_points: chosen.budget_points,
    });
    if paced.wall_ms > budget_ms {
        report.notes.push("no settings are fast enough for --budget-ms: these are the fastest");
    }
    Ok((picture, report))
}

/// Draws a lit picture, or a part of one. The noise of light, its filter and the exposure are those
/// of the whole picture, which is drawn and then cropped.
fn draw_lit_window(
    file: &Forest,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<(Picture, RenderReport)> {
    if let Some(window) = request.window {
        window::check(window, request.size)?;
    }
    let whole = PictureRequest { window: None, ..request.clone() };
    picture::check_size(whole.size, whole.method)?;
    let scene = PictureScene::read(file, &whole, task)?;
    let (gpu, drawer) = request.with.choose(None)?;
    let (picture, mut report) = draw_lit(file, &scene, gpu.as_ref(), drawer, &whole, task)?;
    let picture = cropped(picture, request.window);
    (report.width, report.height) = (picture.width, picture.height);
    report.pixels_covered = picture.stats.pixels_covered;
    Ok((picture, report))
}

/// Draws a lit picture.
#[cfg(feature = "light")]
fn draw_lit(
    file: &Forest,
    scene: &PictureScene,
    gpu: Option<&Gpu>,
    mut drawer: Drawer,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<(Picture, RenderReport)> {
    let start = Instant::now();
    let (picture, light, refusal) = still::draw(file, scene, &request.light, gpu, task)?;
    if let Some(why) = refusal {
        ensure!(request.with.backend != Backend::Gpu, "{why}; draw it with --backend cpu");
        drawer = Drawer::cpu(why);
    }
    let mut notes = notes(file, request, scene, &picture)?;
    notes.extend(still::notes(scene, &light));
    let report = RenderReport::new(&picture, scene, &drawer, notes, ms(start));
    Ok((picture, RenderReport { light: Some(light), ..report }))
}

#[cfg(not(feature = "light"))]
fn draw_lit(
    _: &Forest,
    _: &PictureScene,
    _: Option<&Gpu>,
    _: Drawer,
    _: &PictureRequest,
    _: &dyn Task,
) -> Result<(Picture, RenderReport)> {
    check_built().and(Err(anyhow::anyhow!("this program does not light")))
}

/// Reasons why a picture may not be what the user meant, a line each.
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
    let degrees = info::mixes_degrees(file).then_some(
        "x and y are degrees and heights are not: the picture is distorted; build the scan again, or transform it to a projected system first",
    );
    let exposure = explain::exposure_note(scene);
    let away = facing::note(file, scene, picture);
    let far = scene.leaves_out_far.then_some(
        "the view is fitted to nearly all points: a few lie far outside of it (esker info has the bounds of all)",
    );
    let up = scene.guessed_up.as_ref().map(GuessedUp::note);
    let all = nothing.into_iter().chain(exposure).chain(degrees).chain(away).chain(far);
    Ok(all.chain(up).collect())
}

impl RenderReport {
    fn new(
        picture: &Picture,
        scene: &PictureScene,
        drawer: &Drawer,
        notes: Vec<&'static str>,
        all_drawing_ms: f64,
    ) -> Self {
        let (stats, counters) = (&picture.stats, &scene.selection.counters);
        let legend = &scene.appearance.colouring.legend;
        Self {
            picture: None,
            scene: None,
            points_drawn: stats.points_drawn,
            nodes_drawn: stats.nodes_drawn,
            pixels_covered: stats.pixels_covered,
            pixels_projected: stats.pixels_projected,
            splats_drawn: stats.splats_drawn,
            splats_dropped: stats.splats_dropped,
            width: picture.width,
            height: picture.height,
            camera: CameraReport::of(&scene.view.with_margin(0), &scene.lattice),
            colour: legend.clone(),
            legend: legend.text(),
            bytes_read: scene.read_bytes,
            bytes_resident: scene.planes.iter().map(Planes::bytes).sum(),
            nodes_visited: counters.visited,
            nodes_filtered: counters.filtered,
            nodes_culled: counters.culled + counters.contour_culled,
            stages_ms: RenderTimes {
                open: None,
                select: scene.select_ms,
                read: scene.read_ms,
                frame: stats.stages,
                all_drawing: all_drawing_ms,
                write: None,
            },
            drawn_by: drawer.report(),
            #[cfg(feature = "light")]
            light: None,
            pace: None,
            notes,
        }
    }
}

impl CameraReport {
    /// Camera of a view, with the eye in the coordinates of the scan.
    fn of(view: &View, lattice: &Lattice) -> Self {
        let ortho = view.parallel_at.map(|depth| 2.0 * depth * view.tan_half().y);
        // The pinhole of a parallel view is far behind its eye.
        let eye = if ortho.is_some() { view.eye + view.forward() * view.near } else { view.eye };
        Self {
            eye: lattice.unmeasure(eye.to_array()),
            forward: view.forward().to_array(),
            up: view.world_from_view.y_axis.to_array(),
            fovy: ortho.is_none().then_some(view.fovy_rad.to_degrees()),
            ortho,
        }
    }
}

/// Text of a report.
pub fn text(report: &RenderReport) -> String {
    let times = &report.stages_ms;
    let by = report.drawn_by.adapter.as_ref();
    let mut lines = vec![
        format!(
            "{}: {} points of {} nodes, {} of {} pixels covered{}",
            report.picture.as_deref().unwrap_or("?"),
            grouped(report.points_drawn),
            grouped(report.nodes_drawn.into()),
            grouped(report.pixels_covered),
            grouped(u64::from(report.width) * u64::from(report.height)),
            by.map_or(String::new(), |adapter| format!(", by {adapter}")),
        ),
        format!("colour: {}", report.legend),
        format!(
            "ms: {}",
            stages::text(&[("select", times.select), ("read", times.read)], &times.frame, "draw")
        ),
    ];
    #[cfg(feature = "light")]
    lines.extend(report.light.iter().map(still::text));
    lines.extend(report.pace.iter().map(|pace| {
        format!(
            "for {} ms: {}, {:.2} of the resolution, points {} px apart; {:.1} ms predicted",
            pace.budget_ms, pace.method, pace.scale, pace.target_spacing_px, pace.predicted_ms
        )
    }));
    lines.extend(report.scene.iter().map(|scene| format!("scene document: {scene}")));
    lines.extend(report.notes.iter().map(|note| format!("note: {note}")));
    lines.join("\n")
}
