//! The plan of a picture as a call (`esker render --explain`): passes, planes, pipelines with their
//! constants, and what the frame leaves out and why. Reads no more than node tables and statistics.

use crate::cameras::legend::Legend;
use crate::draw::empty_picture;
use crate::draw::frame::Appearance;
use crate::draw::method::Method;
use crate::draw::scene::{PictureRequest, PictureScene, completed, open_in_parts};
use crate::io::quantity::{grouped, readable_bytes};
use crate::light::settings::LightSettings;
use crate::light::{self, check_built};
use crate::machine::pool;
use anyhow::Result;
use esker_format::{Forest, PlaneKind};
use esker_lod::needs_residual;
use esker_points::Task;
use esker_render::{Pass, Variant};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Plan of a picture.
#[derive(Clone, Debug, Serialize)]
pub struct ExplainReport {
    /// Nodes that would be drawn.
    pub nodes: usize,
    /// Points that would be drawn.
    pub points: u64,
    /// Nodes that the filter rejects.
    pub nodes_filtered: u64,
    /// Passes of the frame, in their order.
    pub passes: Vec<&'static str>,
    /// Planes that would be read.
    pub planes: Vec<PlaneReport>,
    /// Pipelines that a GPU would run.
    pub variants: Vec<VariantReport>,
    /// What the frame leaves out, and why.
    pub left_out: Vec<&'static str>,
    /// Meaning of the colours.
    pub colour: Legend,
    /// Meaning of the colours as text.
    pub legend: String,
}

/// Planes of a kind.
#[derive(Clone, Debug, Serialize)]
pub struct PlaneReport {
    /// Name of the plane, or of its attribute.
    pub plane: String,
    /// Nodes that it would be read for.
    pub nodes: usize,
    /// Bytes of these planes in memory.
    pub bytes_resident: u64,
}

/// A pipeline.
#[derive(Clone, Debug, Serialize)]
pub struct VariantReport {
    /// Name of the shader.
    pub shader: &'static str,
    /// Its constants, by name.
    pub constants: BTreeMap<&'static str, u32>,
}

/// Reports on what a picture of `inputs` would take: the plan of its frame. Reads no points, and
/// draws nothing.
///
/// # Errors
/// If an input cannot be read, or lacks what the request needs.
pub fn explain(
    inputs: &[PathBuf],
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<ExplainReport> {
    if request.method == Method::Lit {
        check_built()?;
    }
    pool::run(request.threads, || {
        let (file, _folder) = open_in_parts(inputs, request, task)?;
        let grown = completed(&file, request, task)?;
        plan(grown.as_ref().unwrap_or(&file), request)
    })
}

/// Reports on what a picture of an open file would take.
///
/// # Errors
/// If the file lacks what the request needs, or statistics cannot be read.
pub fn plan(file: &Forest, request: &PictureRequest) -> Result<ExplainReport> {
    let scene = PictureScene::choose(file, request)?;
    let is_lit = request.method == Method::Lit;
    let (plan, counters) = (&scene.plan, &scene.selection.counters);
    if counters.points == 0 {
        empty_picture::check_wanted(file, &scene.appearance.shown)?;
    }
    let legend = &scene.appearance.colouring.legend;
    Ok(ExplainReport {
        nodes: scene.selection.drawn.len(),
        points: counters.points,
        nodes_filtered: counters.filtered,
        passes: if is_lit {
            light::passes(&request.light)
        } else {
            plan.passes.iter().map(|p| p.name()).collect()
        },
        planes: scene.kinds.iter().map(|&kind| plane_report(file, &scene, kind)).collect(),
        variants: if is_lit {
            Vec::new()
        } else {
            plan.variants().into_iter().map(VariantReport::from).collect()
        },
        left_out: if is_lit {
            left_out_of_light(file, &scene, &request.light)
        } else {
            left_out(file, &scene)
        },
        colour: legend.clone(),
        legend: legend.text(),
    })
}

/// Nodes and bytes of the planes of a kind.
fn plane_report(file: &Forest, scene: &PictureScene, kind: PlaneKind) -> PlaneReport {
    let (lattice, view) = (file.metric(), &scene.view);
    let drawn = scene.selection.drawn.iter().map(|d| d.node);
    let has = |node: &u32| {
        file.has_plane(*node, kind)
            && (kind != PlaneKind::Residual || needs_residual(file.record(*node), lattice, view))
    };
    let bytes = |node: u32| match file.plane_range(node, kind) {
        Some(range) if !scene.appearance.shown.changes(node, kind) => range.end - range.start,
        _ => {
            let each = scene.appearance.shown.value_bytes(kind);
            let each = each.unwrap_or_else(|| file.value_bytes(node, kind));
            each * file.record(node).points() as u64
        }
    };
    let nodes: Vec<u32> = drawn.filter(has).collect();
    let bytes_resident = nodes.iter().map(|&node| bytes(node)).sum();
    PlaneReport { plane: plane_name(file, kind), nodes: nodes.len(), bytes_resident }
}

impl From<Variant> for VariantReport {
    fn from(variant: Variant) -> Self {
        Self { shader: variant.shader, constants: variant.constants.into_iter().collect() }
    }
}

/// Why exposure compensation changes nothing where colours are not those of the scans.
const ONLY_OWN_COLOURS: &str =
    "exposure compensation: applies only to surfaces in the scans' own colours";

/// Why it changes nothing where there is one scan.
const ONE_SCAN: &str = "exposure compensation: all points are of one scan";

/// Note on exposure compensation that was requested and changes nothing.
pub(crate) fn exposure_note(scene: &PictureScene) -> Option<&'static str> {
    let Appearance { evens_exposure, is_one_scan, .. } = scene.appearance;
    let is_left_out = evens_exposure && !scene.plan.evens_exposure();
    is_left_out.then_some(if is_one_scan { ONE_SCAN } else { ONLY_OWN_COLOURS })
}

/// Name of a plane: that of its attribute, if it holds one.
fn plane_name(file: &Forest, kind: PlaneKind) -> String {
    let index = usize::from(kind.attribute());
    file.schema().attributes.get(index).map_or_else(|| kind.name(), |a| a.name.clone())
}

/// Why no back faces are left out where the file has normals.
fn draws_backs(file: &Forest) -> &'static str {
    match file.has_oriented_normals() {
        true => "back-face test: surfaces are drawn from both sides (--cull-back: from the front)",
        false => "back-face test: the normals do not distinguish front from back",
    }
}

/// What the frame leaves out, and why.
fn left_out(file: &Forest, scene: &PictureScene) -> Vec<&'static str> {
    let plan = &scene.plan;
    let is_splats = plan.passes.contains(&Pass::Place);
    let has_surface = !plan.passes.contains(&Pass::Resolve);
    let is_pulled = has_surface && !is_splats;
    let mut out = Vec::new();
    let mut add = |is_left_out: bool, what: &'static str| {
        if is_left_out {
            out.push(what);
        }
    };
    let has_normals = file.has(PlaneKind::Normal);
    let fits_planes = plan.passes.contains(&Pass::FitPlanes);
    add(!has_normals && !fits_planes, "normal plane, normal target: the file has no normals");
    add(
        fits_planes && !is_splats,
        "normal plane: the file has no normals; the target has planes fitted to depths",
    );
    add(
        fits_planes && is_splats,
        "normal plane, normal target: the file has no normals; splats are tilted as planes fitted to \
         depths",
    );
    add(has_normals && !plan.reads_normals, "normal plane: points alone are not lit");
    add(has_normals && !plan.carries_normals && has_surface, "normal target: nothing is lit");
    add(
        !plan.culls_back_faces,
        match (has_normals, has_surface) {
            (false, _) => "back-face test: no normals",
            (true, false) => "back-face test: points alone are drawn from both sides",
            (true, true) => draws_backs(file),
        },
    );
    add(is_splats && !plan.clips, "clip lines: the file has none, or no normals");
    add(is_splats && !plan.tangents, "shapes of splats: the file has none, or no normals");
    let is_compact = scene.appearance.colouring.positions() == PlaneKind::Compact;
    add(
        is_compact,
        "colour plane: numbers of a palette's colours come with the positions (--full: exact ones)",
    );
    add(!plan.reads_colours, "colour plane: colours come from elsewhere");
    add(!plan.hides_points, "filter's test of points: no node lies across its border");
    add(!plan.shines && has_surface, "direction to the eye: no highlights");
    add(
        !plan.evens_exposure() && !scene.appearance.evens_exposure,
        "exposure compensation: not requested",
    );
    let unneeded = exposure_note(scene);
    add(unneeded.is_some(), unneeded.unwrap_or_default());
    add(
        is_pulled && !plan.passes.contains(&Pass::Silhouette),
        "silhouettes: in a dense view nothing sticks out beyond the points",
    );
    add(is_pulled && !plan.averages(), "means of the points that share a pixel: they do not crowd");
    add(
        is_pulled && plan.has_pyramid && !plan.smooths,
        "smoothing of pixels: points are averaged, or colours are names",
    );
    add(!has_surface, "pyramid, lighting, antialiasing: points alone");
    add(is_splats, "pyramid: splats cover their pixels themselves");
    add(is_pulled && !plan.has_pyramid, "pull, push, levels above the picture: a dense view");
    out
}

/// What a lit picture leaves out, and why.
fn left_out_of_light(
    file: &Forest,
    scene: &PictureScene,
    light: &LightSettings,
) -> Vec<&'static str> {
    let has = |kind| file.has(kind);
    let plan = &scene.plan;
    let all = [
        (
            !has(PlaneKind::Normal),
            "normal plane: the file has none; build it with --normals estimate",
        ),
        (has(PlaneKind::Normal) && !plan.culls_back_faces, draws_backs(file)),
        (has(PlaneKind::ClipLines), "clip lines: light is traced on whole discs"),
        (has(PlaneKind::Tangents), "shapes of splats: light is traced on discs"),
        (!plan.reads_colours, "colour plane: colours come from elsewhere"),
        (!plan.hides_points, "filter's test of points: no node lies across its border"),
        (light.gloss.is_none(), "highlights: surfaces are matte (--gloss: glossy ones)"),
        (
            !light.filters_shadows || light.gloss.is_some(),
            "filter of shadows: not requested, or surfaces are glossy",
        ),
        (true, "pyramid, smoothing of depths, antialiasing: rays meet surfaces themselves"),
    ];
    all.into_iter().filter(|(is_left_out, _)| *is_left_out).map(|(_, what)| what).collect()
}

/// Text of a report.
pub fn text(report: &ExplainReport) -> String {
    let mut lines = vec![
        format!("{} points of {} nodes", grouped(report.points), grouped(report.nodes as u64)),
        format!("colour: {}", report.legend),
        format!("passes: {}", report.passes.join(", ")),
    ];
    for plane in &report.planes {
        lines.push(format!(
            "plane: {}, {} nodes, {}",
            plane.plane,
            grouped(plane.nodes as u64),
            readable_bytes(plane.bytes_resident)
        ));
    }
    for variant in &report.variants {
        let constants = variant.constants.iter();
        let constants: Vec<_> = constants.map(|(name, value)| format!("{name}={value}")).collect();
        lines.push(format!("pipeline: {} {}", variant.shader, constants.join(" ")));
    }
    lines.extend(report.left_out.iter().map(|what| format!("left out: {what}")));
    lines.join("\n")
}
