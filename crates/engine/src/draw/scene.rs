//! What a still picture is drawn from: the request, the file (opened, or built from scans), and the
//! nodes, prefixes and planes that the view needs, which are read completely.

use crate::cameras::boxes::Boxes;
use crate::cameras::camera::Camera;
use crate::cameras::up::{GuessedUp, upright};
use crate::draw::frame::{Appearance, draw_node};
use crate::draw::method::Method;
use crate::draw::window::windowed;
use crate::io::file::{is_esker, open_copc};
use crate::io::{inputs, output};
use crate::light;
use crate::light::settings::LightSettings;
use crate::machine::backend::DrawWith;
use anyhow::{Result, ensure};
use esker_builder::NormalsMode;
use esker_builder::budget::memory;
use esker_format::{Forest, ForestFilter, PlaneKind, Planes};
use esker_lod::{
    CompactOctree, Drawn, Lacking, Options, Residency, Selection, Surroundings, View, Window,
    needs_residual, select, surround,
};
use esker_points::{Filter, Lattice, Task};
use esker_render::inputs::density::sparsest_px;
use esker_render::{Dots, DrawNode, FramePlan};
use rayon::prelude::*;
use std::path::PathBuf;
use std::time::Instant;

/// Greatest distance of the eye from the origin of the lattice along an axis, steps.
const EYE_STEPS_MAX: f64 = (1u64 << 46) as f64;

/// Request for a still picture.
#[derive(Clone, Debug)]
pub struct PictureRequest {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Part of the picture that is drawn; none for all of it.
    pub window: Option<Window>,
    /// Points only, or surfaces.
    pub method: Method,
    /// Camera; fitted to the file if it has no eye.
    pub camera: Camera,
    /// Most points that are drawn.
    pub budget_points: u64,
    /// Distance of adjacent points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Time of a frame, milliseconds, that settings are chosen for; none for the settings of this
    /// request ([`crate::draw::pace`]).
    pub budget_ms: Option<f64>,
    /// Source of colours; none for the best that the file has.
    pub colour_by: Option<String>,
    /// Which points are drawn.
    pub filter: Filter,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether differences of exposure between scans are removed.
    pub evens_exposure: bool,
    /// Whether points of surfaces are left out whose normal looks away from the eye.
    pub culls_back: bool,
    /// How points look that are drawn alone.
    pub dots: Dots,
    /// Whether mapped values are drawn from as they are stored, instead of codes of a byte: for
    /// comparisons.
    pub keeps_values: bool,
    /// Whether full planes are drawn although there are compact ones.
    pub full: bool,
    /// How a lit picture is lit.
    pub light: LightSettings,
    /// CPU or GPU.
    pub with: DrawWith,
    /// Threads; 0 for one a core.
    pub threads: usize,
    /// Options of the build, if the inputs are scans.
    pub build: esker_builder::Options,
    /// What is added to the coordinates of each input, their unit; of the first ones or of all.
    pub offsets: Vec<[f64; 3]>,
}

impl Default for PictureRequest {
    fn default() -> Self {
        let lod = Options::default();
        Self {
            size: [1024, 1024],
            window: None,
            method: Method::PullPush,
            camera: Camera::default(),
            budget_points: lod.points_budget,
            target_spacing_px: lod.target_spacing_px,
            budget_ms: None,
            colour_by: None,
            filter: Filter::default(),
            shines: true,
            evens_exposure: false,
            culls_back: false,
            dots: Dots::default(),
            keeps_values: false,
            full: false,
            light: LightSettings::default(),
            with: DrawWith::default(),
            threads: 0,
            build: esker_builder::Options::default(),
            offsets: Vec::new(),
        }
    }
}

impl PictureRequest {
    /// Request that `esker render` makes without options.
    #[must_use]
    pub fn of_options() -> Self {
        Self { method: Method::default(), ..Self::default() }
    }

    /// Options of the build, if the inputs are scans: light needs normals.
    pub fn build_options(&self) -> esker_builder::Options {
        let options = self.build.clone();
        match (self.method, options.normals) {
            (Method::Lit, NormalsMode::Keep) => {
                esker_builder::Options { normals: NormalsMode::Estimate, ..options }
            }
            _ => options,
        }
    }

    /// Size of the picture that is written: of the window, if there is one.
    pub fn shown_size(&self) -> [u32; 2] {
        self.window.map_or(self.size, |window| [window.width, window.height])
    }

    /// Most points that are drawn, and what is read around them: lit ones have to fit in memory
    /// with their tree.
    fn points_max(&self) -> (u64, Option<Surroundings>) {
        if self.method != Method::Lit {
            return (self.budget_points, None);
        }
        let granted_bytes = memory::granted().unwrap_or(u64::MAX);
        let (points_max, around) = light::shares(light::splats_max(granted_bytes / 2));
        (points_max.min(self.budget_points), Some(around))
    }
}

/// Opens inputs as [`open_in_parts`] does, with whole node tables.
///
/// # Errors
/// As for [`open_in_parts`].
pub fn open(
    inputs: &[PathBuf],
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<(Forest, Option<tempfile::TempDir>)> {
    let (forest, folder) = open_in_parts(inputs, request, task)?;
    Ok((forest.whole()?, folder))
}

/// Opens `.esker` files, several of them as clouds beside each other, or builds scans and folders
/// of scans into one in a temporary folder, which is removed when the second value is dropped. Of
/// large files at addresses only what pictures need is read ([`completed`]).
///
/// # Errors
/// If an input cannot be read, `.esker` files are mixed with scans or do not fit one lattice, or
/// scans have offsets.
pub fn open_in_parts(
    inputs: &[PathBuf],
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<(Forest, Option<tempfile::TempDir>)> {
    if let Some(forest) = open_together(inputs, &request.offsets)? {
        return Ok((forest, None));
    }
    let build = request.build_options();
    if let [one] = inputs
        && request.offsets.iter().all(|offset| *offset == [0.0; 3])
        && let Some(forest) = open_copc(one, &build)?
    {
        return Ok((forest, None));
    }
    let scans = inputs::scans(inputs, task)?;
    let folder = output::temporary(request.build.scratch.as_deref())?;
    let built = folder.path().join("scan.esker");
    esker_builder::build(&scans, &built, &build, task)?;
    Ok((Forest::open(&built)?.called(name_of(inputs)), Some(folder)))
}

/// Opens `.esker` files as one, each moved by its offset; `None` if all inputs are scans. Of a
/// large file at an address that is alone only what pictures need is read.
///
/// # Errors
/// If they are mixed with scans, one cannot be opened, or they do not fit one lattice; if scans
/// have offsets.
pub fn open_together(inputs: &[PathBuf], offsets: &[[f64; 3]]) -> Result<Option<Forest>> {
    let are_built = inputs.iter().map(|input| is_esker(input)).collect::<Result<Vec<_>>>()?;
    let offset = |at: usize| offsets.get(at).copied().unwrap_or_default();
    if let Some(scan) = are_built.iter().position(|is_built| !is_built) {
        let shown = inputs[scan].display();
        ensure!(
            !are_built.contains(&true),
            "{shown}: scans are not drawn together with .esker files; build it with `esker build`, and name \
             the built file instead"
        );
        let is_moved = (0..inputs.len()).any(|at| offset(at) != [0.0; 3]);
        ensure!(
            !is_moved,
            "{shown}: scans are drawn where their coordinates are, and only .esker files have offsets; \
             build each with `esker build`, and name the built files instead"
        );
        return Ok(None);
    }
    let open = |(at, path): (usize, &PathBuf)| Ok((Forest::open_in_parts(path)?, offset(at)));
    let mut clouds = inputs.iter().enumerate().map(open).collect::<Result<Vec<_>>>()?;
    match &clouds[..] {
        [] => Ok(None),
        [(_, [0.0, 0.0, 0.0])] => Ok(clouds.pop().map(|(forest, _)| forest)),
        _ => Ok(Some(Forest::together(clouds)?)),
    }
}

/// Makes what a picture needs of a tree whose nodes become known when they are read
/// ([`esker_format::growing`]), or reads it of a node table that is partly known. `None` if it is
/// known already.
///
/// # Errors
/// If nodes cannot be read, or as for [`PictureScene::choose`].
pub fn completed(
    file: &Forest,
    request: &PictureRequest,
    task: &dyn Task,
) -> Result<Option<Forest>> {
    let mut grown = None;
    if !file.grows() {
        return Ok(grown);
    }
    loop {
        task.check()?;
        let newest = grown.as_ref().unwrap_or(file);
        let Selection { drawn, hidden, surroundings, lacking, .. } =
            PictureScene::choose(newest, request)?.selection;
        let nodes = drawn.iter().chain(&hidden).chain(&surroundings).map(|d| d.node);
        let unknown = if newest.is_partial() { Lacking::urgent(&lacking) } else { nodes.collect() };
        newest.complete(&unknown)?;
        match newest.newer() {
            Some(newer) => grown = Some(newer),
            None => return Ok(grown),
        }
    }
}

/// Name of the file that is built from `inputs`, for messages.
fn name_of(inputs: &[PathBuf]) -> PathBuf {
    match inputs {
        [first, _, ..] => format!("{} and {} more", first.display(), inputs.len() - 1).into(),
        [one] => one.clone(),
        [] => PathBuf::new(),
    }
}

/// Nodes that are said to be read next, for files at addresses.
const READ_AHEAD: usize = 32;

/// What the view needs of a file: nodes, prefixes, and the planes of the frame.
pub struct PictureScene {
    /// The camera.
    pub view: View,
    /// Place of the requested part in what the camera draws; none if all of it is requested.
    pub window: Option<Window>,
    /// Lattice of the scan's coordinates; the view is on its metric lattice.
    pub lattice: Lattice,
    /// Whether the view is fitted to nearly all points, and a few lie far outside of it.
    pub leaves_out_far: bool,
    /// The up direction, if the camera has none and another one than z was guessed.
    pub guessed_up: Option<GuessedUp>,
    /// Nodes to draw, and their prefixes.
    pub selection: Selection,
    /// Planes of each node, in the order of the selection, and behind them those of the nodes in
    /// its surroundings.
    pub planes: Vec<Planes>,
    /// What is shown, and how.
    pub appearance: Appearance,
    /// Plan of the frame.
    pub plan: FramePlan,
    /// Most points that are drawn.
    pub points_max: u64,
    /// Plane of the classes of points, if lights choose points by them.
    class_plane: Option<PlaneKind>,
    /// Kinds of planes that are read for any node.
    pub(crate) kinds: Vec<PlaneKind>,
    /// Bytes that were read.
    pub read_bytes: u64,
    /// Duration of the choice, milliseconds.
    pub(crate) select_ms: f64,
    /// Duration of reading, milliseconds.
    pub(crate) read_ms: f64,
}

impl PictureScene {
    /// Chooses nodes and reads their planes.
    ///
    /// # Errors
    /// If planes cannot be read, or as for [`PictureScene::choose`].
    pub fn read(file: &Forest, request: &PictureRequest, task: &dyn Task) -> Result<Self> {
        let mut scene = Self::choose(file, request)?;
        let start = Instant::now();
        let before = file.read_bytes();
        scene.planes =
            read(file, &scene.view, &scene.selection, &scene.appearance, &scene.kinds, task)?;
        scene.read_bytes += file.read_bytes() - before;
        scene.read_ms = ms(start);
        Ok(scene)
    }

    /// Chooses nodes; reads only statistics.
    ///
    /// # Errors
    /// If statistics cannot be read, or the file lacks what the request needs.
    pub fn choose(file: &Forest, request: &PictureRequest) -> Result<Self> {
        let start = Instant::now();
        let PictureRequest { colour_by, filter, method, shines, evens_exposure, .. } = request;
        let before = file.read_bytes();
        let bounds = Boxes::all(file, &request.filter, &[]);
        let camera = request.camera.measured(file.lattice());
        let (camera, vertical, guessed_up) = upright(file, camera, bounds);
        let colour = colour_by.as_deref();
        let appearance = Appearance::new(file, colour, vertical, filter, *method, *shines)?;
        let appearance = appearance.evened(file, *evens_exposure)?.culled(request.culls_back);
        let appearance = appearance.dotted(request.dots).aimed(request.target_spacing_px);
        let appearance = if request.full { appearance } else { appearance.compacted(file) };
        let class_plane = light::class_plane(file, *method, &request.light);
        // Classes are read as they are stored, also where colours are made of them.
        let keeps_values = request.keeps_values || class_plane.is_some();
        let mut appearance = if keeps_values { appearance.with_values() } else { appearance };
        let boxes = match camera.eye {
            Some(_) if !appearance.colouring.is_by_depth() => Boxes::equal(bounds),
            _ => Boxes::of(file, &request.filter, &[], &appearance.shown)?,
        };
        let view = appearance.drawn_view(&camera.view_in(&boxes, request.size));
        appearance.colouring = appearance.colouring.seen(&view, boxes.fitted, colour);
        // Without points, the steps are those of no scan.
        let steps = (0..3).map(|axis| file.metric().steps_axis(axis, view.eye[axis]).abs());
        anyhow::ensure!(
            file.points() == 0 || steps.fold(0.0, f64::max) <= EYE_STEPS_MAX,
            "the camera's eye is over 2^46 steps of the coordinates from the scan: move it nearer"
        );
        let (points_max, surroundings) = request.points_max();
        let options = Options {
            points_budget: points_max,
            target_spacing_px: request.target_spacing_px,
            ..Options::default()
        };
        let known = FilteredResidency(&appearance.shown);
        let (table, lattice) = (file.table(), file.metric());
        let mut selection = select(table, lattice, &view, &options, &known, None);
        let octree = CompactOctree::with_hidden(table, &selection.drawn, &selection.hidden);
        if let Some(around) = surroundings {
            surround(table, lattice, &view, &options, &around, &known, &mut selection);
        }
        let drawn = || selection.drawn.iter().map(|d| (file.record(d.node), d.prefix)).enumerate();
        let nodes = drawn().map(|(entry, (node, _))| (entry, node));
        let sparsest_px = sparsest_px(&view, file.metric(), &octree, nodes);
        let apart = (file.has(PlaneKind::Normal), sparsest_px);
        let (view, window) = windowed(view, request.window, request.size, *method, apart)?;
        let mut lacking = Vec::new();
        let crowding = appearance.crowding_lacking(file, &view, &mut lacking);
        let lacking = lacking.into_iter();
        let lacking = lacking.map(|node| Lacking { node, spacing_px: f64::INFINITY });
        selection.lacking.extend(lacking);
        let plan = appearance.plan(file, sparsest_px, crowding);
        let mut kinds = planes_of(&plan, &appearance);
        kinds.extend(class_plane.filter(|plane| !kinds.contains(plane)));
        Ok(Self {
            view,
            window,
            lattice: *file.lattice(),
            leaves_out_far: camera.eye.is_none() && boxes.fitted != bounds,
            guessed_up,
            selection,
            planes: Vec::new(),
            appearance,
            plan,
            points_max,
            class_plane,
            kinds,
            read_bytes: file.read_bytes() - before,
            select_ms: ms(start),
            read_ms: 0.0,
        })
    }

    /// Nodes of the picture and of its surroundings with their planes, for light; the octree for
    /// them is [`esker_lod::light_octree`].
    pub fn lit_draws<'a>(&'a self, file: &'a Forest) -> Vec<DrawNode<'a>> {
        let nodes = self.selection.drawn.iter().chain(&self.selection.surroundings);
        self.nodes(file, nodes)
    }

    /// Classes of the points of each node, where lights choose points by them.
    pub fn classes(&self) -> Vec<Option<&[u8]>> {
        self.planes.iter().map(|planes| planes.get(self.class_plane?)).collect()
    }

    /// Nodes with their planes, for a frame.
    pub fn draws<'a>(&'a self, file: &'a Forest) -> Vec<DrawNode<'a>> {
        self.nodes(file, self.selection.drawn.iter())
    }

    fn nodes<'a>(
        &'a self,
        file: &'a Forest,
        nodes: impl Iterator<Item = &'a Drawn>,
    ) -> Vec<DrawNode<'a>> {
        let nodes = nodes.zip(&self.planes).enumerate();
        nodes
            .map(|(entry, (drawn, planes))| {
                let colouring = &self.appearance.colouring;
                draw_node(file.table(), drawn.node, entry, drawn.prefix, colouring, |kind| {
                    planes.get(kind)
                })
            })
            .collect()
    }
}

/// Residency of a file that is read on demand: every node is there, as far as the filter accepts
/// its points.
struct FilteredResidency<'a>(&'a ForestFilter);

impl Residency for FilteredResidency<'_> {
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

/// Kinds of planes that a plan needs. Residuals are read only for nodes in which the dropped bits
/// are visible.
fn planes_of(plan: &FramePlan, appearance: &Appearance) -> Vec<PlaneKind> {
    let mut kinds = vec![appearance.colouring.positions(), PlaneKind::Residual];
    kinds.extend(plan.reads_normals.then_some(PlaneKind::Normal));
    kinds.extend(plan.clips.then_some(PlaneKind::ClipLines));
    kinds.extend(plan.tangents.then_some(PlaneKind::Tangents));
    let colour = appearance.colouring.plane.filter(|_| plan.reads_colours);
    kinds.extend(colour.map(|(kind, _)| kind).filter(|kind| !kind.has_positions()));
    kinds
}

/// Reads planes of several nodes at a time.
fn read(
    file: &Forest,
    view: &View,
    selection: &Selection,
    appearance: &Appearance,
    kinds: &[PlaneKind],
    task: &dyn Task,
) -> Result<Vec<Planes>> {
    let nodes: Vec<&Drawn> = selection.drawn.iter().chain(&selection.surroundings).collect();
    let points = nodes.iter().map(|d| d.prefix as u64).sum();
    task.phase("reading", Some(points), "points");
    let lattice = file.metric();
    nodes
        .par_iter()
        .enumerate()
        .map(|(i, drawn)| {
            task.check()?;
            let next = nodes[i..].iter().take(READ_AHEAD).map(|drawn| drawn.node);
            file.will_read_planes(next, kinds);
            let mut kinds = kinds.to_vec();
            if !needs_residual(&file.table().nodes[drawn.node as usize], lattice, view) {
                kinds.retain(|&kind| kind != PlaneKind::Residual);
            }
            let planes = appearance.shown.read(file, drawn.node, &kinds)?;
            task.advance(drawn.prefix as u64);
            Ok(planes)
        })
        .collect()
}

/// Milliseconds since `start`.
pub(crate) fn ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
