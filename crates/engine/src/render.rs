//! Drawing as a call: opens a file (or builds one from scans first), chooses what the view needs, reads
//! just the planes that the frame asks for, draws, and writes the picture.

use crate::backend::{Backend, DrawWith, Drawer};
use crate::camera::Camera;
use crate::drawing::{Look, draw_node};
use crate::explain;
use crate::stages::taken;
use crate::{info, output, picture, pool, seen, whole};
use anyhow::{Context, Result};
use esker_format::footer::HEADER_MAGIC;
use esker_format::{Forest, PlaneKind, Planes, Shown};
use esker_lod::{CompactOctree, Options, Residency, Selection, View, needs_residual, select};
use esker_points::place::no_file_at;
use esker_points::{Filter, Task};
use esker_render::density::{is_crowded, is_dense};
use esker_render::{DrawNode, FramePlan, Method, Picture, Renderer, Stages};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What the user asks of a picture.
#[derive(Clone, Debug)]
pub struct Request {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Points alone, or surfaces.
    pub method: Method,
    /// The camera; fitted where it names no eye.
    pub camera: Camera,
    /// Points drawn at most.
    pub budget_points: u64,
    /// Distance of neighbouring points on the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Where colours come from; the best there is where not said.
    pub colour_by: Option<String>,
    /// Which points are drawn.
    pub filter: Filter,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether differences of exposure between scans are evened out.
    pub evens: bool,
    /// Whether values that are mapped are kept as they are, and not as codes of a byte: to compare with.
    pub keeps_values: bool,
    /// Whether full planes are drawn where there are compact ones, too.
    pub full: bool,
    /// What draws.
    pub with: DrawWith,
    /// Threads; 0 is one a core.
    pub threads: usize,
    /// How scans are built that are given in place of a file.
    pub build: esker_build::Options,
}

impl Default for Request {
    fn default() -> Self {
        let lod = Options::default();
        Self {
            size: [1024, 1024],
            method: Method::PullPush,
            camera: Camera::default(),
            budget_points: lod.points_budget,
            target_spacing_px: lod.target_spacing_px,
            colour_by: None,
            filter: Filter::default(),
            shines: true,
            evens: false,
            keeps_values: false,
            full: false,
            with: DrawWith::default(),
            threads: 0,
            build: esker_build::Options::default(),
        }
    }
}

/// Whether a file is an `.esker` file, by its first bytes; a generated scan is none.
///
/// # Errors
/// Where it cannot be read.
pub fn is_esker(path: &Path) -> Result<bool> {
    use std::io::Read;
    if esker_scan::synthetic::is_spec(path) {
        return Ok(false);
    }
    let mut head = Vec::new();
    let context = || format!("{}: cannot open", path.display());
    if let Some(what) = no_file_at(path).with_context(context)? {
        anyhow::bail!("{}: {what}", path.display());
    }
    let file = std::fs::File::open(path).with_context(context)?;
    file.take(HEADER_MAGIC.len() as u64)
        .read_to_end(&mut head)
        .with_context(|| format!("{}: cannot read", path.display()))?;
    Ok(head == HEADER_MAGIC)
}

/// Draws `inputs` (one `.esker` file with those that it names, or scans) to the PNG file `out`; what it did, for machines.
///
/// # Errors
/// Where the input cannot be read, a filter leaves no point of it, or the picture cannot be written.
pub fn render(inputs: &[PathBuf], out: &Path, request: &Request, task: &dyn Task) -> Result<Value> {
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

/// What a picture of `inputs` would take, without reading or drawing any of it: the plan of its frame.
///
/// # Errors
/// Where the input cannot be read, or has not what is asked for.
pub fn explain(inputs: &[PathBuf], request: &Request, task: &dyn Task) -> Result<Value> {
    pool::run(request.threads, || {
        let (file, _folder) = open(inputs, request, task)?;
        explain::explain(&file, request)
    })
}

/// Opens the file, or builds scans into one in a temporary folder, which goes with the second value.
pub(crate) fn open(
    inputs: &[PathBuf],
    request: &Request,
    task: &dyn Task,
) -> Result<(Forest, Option<tempfile::TempDir>)> {
    if let [one] = inputs
        && is_esker(one)?
    {
        return Ok((Forest::open(one)?, None));
    }
    for input in inputs {
        if is_esker(input)? {
            anyhow::bail!(
                "{}: several inputs are drawn together only where all are scans",
                input.display()
            );
        }
    }
    let folder = output::temporary(request.build.scratch.as_deref())?;
    let built = folder.path().join("scan.esker");
    esker_build::build(inputs, &built, &request.build, task)?;
    Ok((Forest::open(&built)?.called(name_of(inputs)), Some(folder)))
}

/// What a file is called that was built from these.
fn name_of(inputs: &[PathBuf]) -> PathBuf {
    match inputs {
        [first, _, ..] => format!("{} and {} more", first.display(), inputs.len() - 1).into(),
        [one] => one.clone(),
        [] => PathBuf::new(),
    }
}

/// What the view needs of a file: nodes, prefixes, and just the planes that the frame asks for.
pub struct Scene {
    /// The camera.
    pub view: View,
    /// What is drawn.
    pub selection: Selection,
    /// The planes of each drawn node, in the selection's order.
    pub planes: Vec<Planes>,
    /// What is shown, and how.
    pub look: Look,
    /// The plan of its frame.
    pub plan: FramePlan,
    /// The kinds of planes that any node has been read for.
    pub(crate) kinds: Vec<PlaneKind>,
    /// Bytes that were read for it.
    pub read_bytes: u64,
    select_ms: f64,
    read_ms: f64,
}

impl Scene {
    /// Chooses and reads.
    ///
    /// # Errors
    /// Where planes cannot be read.
    pub fn read(file: &Forest, request: &Request, task: &dyn Task) -> Result<Self> {
        let mut scene = Self::choose(file, request)?;
        let start = Instant::now();
        let before = file.read_bytes();
        scene.planes = read(file, &scene.view, &scene.selection, &scene.look, &scene.kinds, task)?;
        scene.read_bytes += file.read_bytes() - before;
        scene.read_ms = ms(start);
        Ok(scene)
    }

    /// Chooses, and reads no more than statistics.
    ///
    /// # Errors
    /// Where these cannot be read, or the file has not what is asked for.
    pub fn choose(file: &Forest, request: &Request) -> Result<Self> {
        let start = Instant::now();
        let shown = request.camera.view(bounds_of(file, &request.filter), request.size);
        let Request { colour_by, filter, method, shines, evens, .. } = request;
        let before = file.read_bytes();
        let look = Look::new(file, colour_by.as_deref(), filter, *method, *shines)?;
        let look = look.evened(file, *evens)?;
        let look = if request.full { look } else { look.compacted(file) };
        let look = if request.keeps_values { look.with_values() } else { look };
        let view = look.with_margin(file, &shown);
        let options = Options {
            points_budget: request.budget_points,
            target_spacing_px: request.target_spacing_px,
            ..Options::default()
        };
        let known = AtHand(&look.shown);
        let selection = select(file.table(), file.lattice(), &view, &options, &known, None);
        let octree = CompactOctree::new(file.table(), &selection.drawn);
        let drawn = || selection.drawn.iter().map(|d| (file.record(d.node), d.prefix)).enumerate();
        let nodes = drawn().map(|(entry, (node, _))| (entry, node));
        let is_dense = is_dense(&view, file.lattice(), &octree, nodes);
        let nodes = drawn().map(|(entry, (node, prefix))| (entry, node, prefix));
        let is_crowded = is_crowded(&view, file.lattice(), Some(&octree), nodes);
        let plan = look.plan(file, is_dense, is_crowded);
        let kinds = planes_of(&plan, &look);
        Ok(Self {
            view,
            selection,
            planes: Vec::new(),
            look,
            plan,
            kinds,
            read_bytes: file.read_bytes() - before,
            select_ms: ms(start),
            read_ms: 0.0,
        })
    }

    /// What the renderer is given.
    pub fn draws<'a>(&'a self, file: &'a Forest) -> Vec<DrawNode<'a>> {
        let nodes = self.selection.drawn.iter().zip(&self.planes).enumerate();
        nodes
            .map(|(entry, (drawn, planes))| {
                let node = file.record(drawn.node);
                draw_node(node, entry, drawn.prefix, &self.look.colouring, |kind| planes.get(kind))
            })
            .collect()
    }
}

/// Draws an opened file; the picture and what it took.
///
/// # Errors
/// Where planes cannot be read, the filter leaves no point, or a GPU is asked for and there is none, or it fails.
pub fn draw(file: &Forest, request: &Request, task: &dyn Task) -> Result<(Picture, Value)> {
    let scene = Scene::read(file, request, task)?;
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
        seen::check_wanted(file, &scene.look.shown)?;
    }
    let mut report = report(&picture, &scene);
    report["notes"] = json!(notes(file, request, &scene, &picture)?);
    report["drawn_by"] = drawer.report();
    report["stages_ms"]["all_drawing"] = json!(ms(start));
    Ok((picture, report))
}

/// The bounds of what is fitted: of the points, within the box that is asked for.
fn bounds_of(file: &Forest, filter: &Filter) -> [[f64; 3]; 2] {
    let [low, high] = info::bounds(file);
    let Some(wanted) = filter.bounds else { return [low, high] };
    let least = [0, 1, 2].map(|i| low[i].max(wanted.min[i]));
    let greatest = [0, 1, 2].map(|i| high[i].min(wanted.max[i]));
    if (0..3).all(|i| least[i] <= greatest[i]) { [least, greatest] } else { [low, high] }
}

/// Everything is at hand; a filter says what may be shown.
struct AtHand<'a>(&'a Shown);

impl Residency for AtHand<'_> {
    fn is_resident(&self, _: u32) -> bool {
        true
    }
    fn slot_bytes(&self, _: u32) -> u64 {
        0
    }
    fn points_max(&self, node: u32) -> usize {
        self.0.points_max(node)
    }
    fn is_barren(&self, node: u32) -> bool {
        self.0.is_barren(node)
    }
}

/// The planes that a plan needs; the residual of those nodes whose dropped bits show.
fn planes_of(plan: &FramePlan, look: &Look) -> Vec<PlaneKind> {
    let mut kinds = vec![look.colouring.positions(), PlaneKind::Residual];
    kinds.extend(plan.reads_normals.then_some(PlaneKind::Normal));
    kinds.extend(plan.clips.then_some(PlaneKind::ClipLines));
    kinds.extend(plan.tangents.then_some(PlaneKind::Tangents));
    let colour = look.colouring.plane.filter(|_| plan.reads_colours);
    kinds.extend(colour.map(|(kind, _)| kind).filter(|kind| !kind.has_positions()));
    kinds
}

/// Reads the planes that the frame needs, several nodes at a time.
fn read(
    file: &Forest,
    view: &View,
    selection: &Selection,
    look: &Look,
    kinds: &[PlaneKind],
    task: &dyn Task,
) -> Result<Vec<Planes>> {
    let points = selection.drawn.iter().map(|d| d.prefix as u64).sum();
    task.phase("reading", Some(points), "points");
    let lattice = file.lattice();
    selection
        .drawn
        .par_iter()
        .map(|drawn| {
            task.check()?;
            let mut kinds = kinds.to_vec();
            if !needs_residual(&file.table().nodes[drawn.node as usize], lattice, view) {
                kinds.retain(|&kind| kind != PlaneKind::Residual);
            }
            let planes = look.shown.read(file, drawn.node, &kinds)?;
            task.advance(drawn.prefix as u64);
            Ok(planes)
        })
        .collect()
}

/// What the user should know of a picture that may not be what was meant, a line each.
fn notes(
    file: &Forest,
    request: &Request,
    scene: &Scene,
    picture: &Picture,
) -> Result<Vec<&'static str>> {
    let counters = &scene.selection.counters;
    let is_empty = picture.stats.pixels_covered == 0;
    let nothing = is_empty.then(|| seen::why_nothing(file, request.budget_points, counters));
    Ok(nothing.into_iter().chain(explain::not_evened(file, scene)?).collect())
}

fn report(picture: &Picture, scene: &Scene) -> Value {
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
fn stages_ms(scene: &Scene, picture: &Picture) -> Value {
    let stages = &picture.stats.stages;
    let mut all =
        json!({ "select": scene.select_ms, "read": scene.read_ms, "draw": stages.total_ms });
    for (name, ms) in Stages::NAMED {
        all[name] = json!(ms(stages));
    }
    all
}

/// [`render`]'s report for people.
pub fn text(report: &Value) -> String {
    let n = |name: &str| crate::quantity::grouped(report[name].as_u64().unwrap_or(0));
    let mut lines = vec![format!(
        "{}: {} points of {} nodes, {} of {} pixels covered{}\n{}\
         ms: {}",
        report["picture"].as_str().unwrap_or("?"),
        n("points_drawn"),
        n("nodes_drawn"),
        n("pixels_covered"),
        crate::quantity::grouped(
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

fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
