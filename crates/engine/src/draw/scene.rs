//! What a still picture is drawn from: the request, the file (opened, or built from scans first),
//! and the nodes, prefixes and planes that the view needs, read whole.

use crate::calls::info;
use crate::cameras::camera::Camera;
use crate::draw::frame::{Look, draw_node};
use crate::io::file::is_esker;
use crate::io::output;
use crate::machine::backend::DrawWith;
use anyhow::Result;
use esker_format::{Forest, ForestFilter, PlaneKind, Planes};
use esker_lod::{CompactOctree, Options, Residency, Selection, View, needs_residual, select};
use esker_points::{Filter, Task};
use esker_render::inputs::density::{is_crowded, is_dense};
use esker_render::{DrawNode, FramePlan, Method};
use rayon::prelude::*;
use std::path::PathBuf;
use std::time::Instant;

/// What the user asks of a picture.
#[derive(Clone, Debug)]
pub struct PictureRequest {
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
    pub evens_exposure: bool,
    /// Whether values that are mapped are kept as they are, and not as codes of a byte: to compare
    /// with.
    pub keeps_values: bool,
    /// Whether full planes are drawn where there are compact ones, too.
    pub full: bool,
    /// What draws.
    pub with: DrawWith,
    /// Threads; 0 is one a core.
    pub threads: usize,
    /// How scans are built that are given in place of a file.
    pub build: esker_builder::Options,
}

impl Default for PictureRequest {
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
            evens_exposure: false,
            keeps_values: false,
            full: false,
            with: DrawWith::default(),
            threads: 0,
            build: esker_builder::Options::default(),
        }
    }
}

/// Opens the file, or builds scans into one in a temporary folder, which goes with the second
/// value.
pub fn open(
    inputs: &[PathBuf],
    request: &PictureRequest,
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
    esker_builder::build(inputs, &built, &request.build, task)?;
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
pub struct PictureScene {
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
    /// Milliseconds of the choice.
    pub(crate) select_ms: f64,
    /// Milliseconds of reading.
    pub(crate) read_ms: f64,
}

impl PictureScene {
    /// Chooses and reads.
    ///
    /// # Errors
    /// Where planes cannot be read.
    pub fn read(file: &Forest, request: &PictureRequest, task: &dyn Task) -> Result<Self> {
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
    pub fn choose(file: &Forest, request: &PictureRequest) -> Result<Self> {
        let start = Instant::now();
        let shown = request.camera.view(bounds_of(file, &request.filter), request.size);
        let PictureRequest { colour_by, filter, method, shines, evens_exposure, .. } = request;
        let before = file.read_bytes();
        let look = Look::new(file, colour_by.as_deref(), filter, *method, *shines)?;
        let look = look.evened(file, *evens_exposure)?;
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

/// The bounds of what is fitted: of the points, within the box that is asked for.
fn bounds_of(file: &Forest, filter: &Filter) -> [[f64; 3]; 2] {
    let [low, high] = info::bounds(file);
    let Some(wanted) = filter.bounds else { return [low, high] };
    let least = [0, 1, 2].map(|i| low[i].max(wanted.min[i]));
    let greatest = [0, 1, 2].map(|i| high[i].min(wanted.max[i]));
    if (0..3).all(|i| least[i] <= greatest[i]) { [least, greatest] } else { [low, high] }
}

/// Everything is at hand; a filter says what may be shown.
struct AtHand<'a>(&'a ForestFilter);

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
    fn rejects_subtree(&self, node: u32) -> bool {
        self.0.rejects_subtree(node)
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

/// Milliseconds since `start`.
pub(crate) fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
