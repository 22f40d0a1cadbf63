//! The plan of a picture in words (`esker render --explain`): the passes, the planes that are read,
//! the pipelines and their constants, and what is left out and why. Nothing but the node table and
//! statistics is read for it.

use crate::cameras::colour;
use crate::cameras::ranges;
use crate::draw::empty_picture;
use crate::draw::scene::{PictureRequest, PictureScene};
use crate::io::quantity::{grouped, readable_bytes};
use anyhow::Result;
use esker_format::{Forest, PlaneKind};
use esker_lod::needs_residual;
use esker_render::Pass;
use serde_json::{Value, json};

/// What a picture of a file would take.
pub(crate) fn explain(file: &Forest, request: &PictureRequest) -> Result<Value> {
    let scene = PictureScene::choose(file, request)?;
    if scene.selection.counters.points == 0 {
        empty_picture::check_wanted(file, &scene.look.shown)?;
    }
    let plan = &scene.plan;
    let (lattice, view) = (file.lattice(), &scene.view);
    let planes: Vec<Value> = scene
        .kinds
        .iter()
        .map(|&kind| {
            let drawn = scene.selection.drawn.iter().map(|d| d.node);
            let has = |node: &u32| {
                file.has_plane(*node, kind)
                    && (kind != PlaneKind::Residual
                        || needs_residual(file.record(*node), lattice, view))
            };
            let bytes = |node: u32| match file.plane_range(node, kind) {
                Some(range) if !scene.look.shown.changes(node, kind) => range.end - range.start,
                _ => {
                    let each = scene.look.shown.value_bytes(kind);
                    let each = each.unwrap_or_else(|| file.value_bytes(node, kind));
                    each * file.record(node).points() as u64
                }
            };
            let nodes: Vec<u32> = drawn.filter(has).collect();
            let bytes = nodes.iter().map(|&node| bytes(node)).sum::<u64>();
            json!({ "plane": plane_name(file, kind), "nodes": nodes.len(), "bytes_resident": bytes })
        })
        .collect();
    let variants: Vec<Value> = plan
        .variants()
        .into_iter()
        .map(|v| {
            let constants =
                v.constants.iter().map(|&(name, value)| (name.to_owned(), json!(value)));
            json!({ "shader": v.shader, "constants": constants.collect::<serde_json::Map<_, _>>() })
        })
        .collect();
    Ok(json!({
        "nodes": scene.selection.drawn.len(),
        "points": scene.selection.counters.points,
        "nodes_filtered": scene.selection.counters.filtered,
        "passes": plan.passes.iter().map(|p| p.name()).collect::<Vec<_>>(),
        "planes": planes,
        "variants": variants,
        "left_out": left_out(file, &scene),
        "colour": scene.look.colouring.legend.json(),
        "legend": scene.look.colouring.legend.text(),
    }))
}

/// Why exposures that shall be evened out stay as they are.
const ONLY_OWN_COLOURS: &str =
    "exposure compensation: only surfaces in the scans' own colours are evened out";

/// What to say where evening out exposures was asked and changes nothing.
pub(crate) fn exposure_note(file: &Forest, scene: &PictureScene) -> Result<Option<&'static str>> {
    if !scene.look.evens_exposure {
        return Ok(None);
    }
    if !scene.plan.evens_exposure() {
        return Ok(Some(ONLY_OWN_COLOURS));
    }
    let (kind, _) = colour::scans(file)?;
    let whole = ranges::whole(file, usize::from(kind.attribute()))?;
    Ok(whole
        .is_none_or(|(least, greatest)| least >= greatest)
        .then_some("exposure compensation: all points are of one scan"))
}

/// The name of a plane; that of its attribute, where it is one's.
fn plane_name(file: &Forest, kind: PlaneKind) -> String {
    let index = usize::from(kind.attribute());
    file.schema().attributes.get(index).map_or_else(|| kind.name(), |a| a.name.clone())
}

/// What the frame does without, and why.
fn left_out(file: &Forest, scene: &PictureScene) -> Vec<String> {
    let plan = &scene.plan;
    let is_splats = plan.passes.contains(&Pass::Place);
    let has_surface = !plan.passes.contains(&Pass::Resolve);
    let is_pulled = has_surface && !is_splats;
    let mut out = Vec::new();
    let mut say = |is_out: bool, what: &str| {
        if is_out {
            out.push(what.to_owned());
        }
    };
    let has_normals = file.has(PlaneKind::Normal);
    let tells = plan.passes.contains(&Pass::FitPlanes);
    say(!has_normals && !tells, "normal plane, normal target: the file has no normals");
    say(tells, "normal plane: the file has no normals; the target has planes told from depths");
    say(has_normals && !plan.reads_normals, "normal plane: points alone are not lit");
    say(has_normals && !plan.carries_normals && has_surface, "normal target: nothing is lit");
    say(
        !plan.culls_back_faces,
        match (has_normals, has_surface) {
            (false, _) => "back-face test: no normals",
            (true, true) if is_splats => "back-face test: splats are drawn from both sides",
            (true, false) => "back-face test: points alone are drawn from both sides",
            (true, true) => "back-face test: the normals do not tell front from back",
        },
    );
    say(is_splats && !plan.clips, "clip lines: the file has none, or no normals");
    say(is_splats && !plan.tangents, "shapes of splats: the file has none, or no normals");
    let is_compact = scene.look.colouring.positions() == PlaneKind::Compact;
    say(
        is_compact,
        "colour plane: numbers of a palette's colours come with the positions (--full: exact ones)",
    );
    say(!plan.reads_colours, "colour plane: colours come from elsewhere");
    say(!plan.hides_points, "filter's test of points: no node lies across its border");
    say(!plan.shines && has_surface, "direction to the eye: no highlights");
    say(!plan.evens_exposure() && !scene.look.evens_exposure, "exposure compensation: not asked");
    say(!plan.evens_exposure() && scene.look.evens_exposure, ONLY_OWN_COLOURS);
    say(is_pulled && !plan.averages(), "means of the points that share a pixel: they do not crowd");
    say(
        is_pulled && plan.has_pyramid && !plan.smooths,
        "smoothing of pixels: points are averaged, or colours are names",
    );
    say(!has_surface, "pyramid, lighting, antialiasing: points alone");
    say(is_splats, "pyramid: splats cover their pixels themselves");
    say(is_pulled && !plan.has_pyramid, "pull, push, levels above the picture: a dense view");
    out
}

/// The report for people.
pub fn text(report: &Value) -> String {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let word = |value: &Value| value.as_str().unwrap_or("?").to_owned();
    let number = |value: &Value| grouped(value.as_u64().unwrap_or(0));
    let mut lines = vec![
        format!("{} points of {} nodes", number(&report["points"]), number(&report["nodes"])),
        format!("colour: {}", word(&report["legend"])),
        format!(
            "passes: {}",
            list(&report["passes"]).iter().map(word).collect::<Vec<_>>().join(", ")
        ),
    ];
    for plane in list(&report["planes"]) {
        lines.push(format!(
            "plane: {}, {} nodes, {}",
            word(&plane["plane"]),
            number(&plane["nodes"]),
            readable_bytes(plane["bytes_resident"].as_u64().unwrap_or(0))
        ));
    }
    for variant in list(&report["variants"]) {
        let constants = variant["constants"].as_object().into_iter().flatten();
        let constants: Vec<_> = constants.map(|(name, value)| format!("{name}={value}")).collect();
        lines.push(format!("pipeline: {} {}", word(&variant["shader"]), constants.join(" ")));
    }
    lines.extend(list(&report["left_out"]).iter().map(|what| format!("left out: {}", word(what))));
    lines.join("\n")
}
