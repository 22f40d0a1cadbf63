//! The renderer's frame: gathers the nodes of a cut with their planes, wherever these are, and the
//! settings of a picture. Pictures of files that are read whole and sessions that stream share it.

use crate::calls::info;
use crate::cameras::boxes::Boxes;
use crate::cameras::colour::{self, Colouring, filtered_colouring};
use crate::cameras::vertical::Vertical;
use crate::draw::empty_picture;
use crate::draw::method::{AUTO_DOTS, Method};
use crate::draw::options::Settings;
use crate::light::class_plane;
use crate::light::settings::LightSettings;
use anyhow::{Context, Result};
use esker_format::{Forest, ForestFilter, OverviewNode, PlaneKind};
use esker_lod::{CompactOctree, Options, View, crowding, share_above};
use esker_points::{Codes, Coding, Filter, NodeTable};
use esker_render::inputs::camera::is_drawable;
use esker_render::picture::margin::{MARGIN_PX, goes_beyond};
use esker_render::{
    Codebook, ColourBy, ColourMap, ColourPlane, Dots, DrawNode, Frame, FrameOptions, FramePlan,
    Method as Passes, PassChoice, SceneHas,
};
use esker_stream::{Needs, Shown};
use std::sync::Arc;

/// What is shown of a file, and how: everything that the plan of a frame depends on, except the
/// view.
#[derive(Clone, Debug)]
pub struct Appearance {
    /// Source of the colours.
    pub colouring: Colouring,
    /// Which points are shown, and how their planes change when they are loaded.
    pub shown: Arc<ForestFilter>,
    /// Points only, or surfaces.
    pub method: Method,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether the removal of differences of exposure between scans is requested.
    pub evens_exposure: bool,
    /// Whether exposure is requested of points that are all of one scan, so that every factor would
    /// be 1.
    pub is_one_scan: bool,
    /// Whether points of surfaces are left out whose normal looks away from the eye.
    pub culls_back: bool,
    /// How points look that are drawn alone.
    pub dots: Dots,
    /// Distance of adjacent points in the picture that is fine enough, pixels.
    pub target_spacing_px: f64,
    /// Depth of the near plane, the file's unit.
    near: f64,
    /// Box of all points of the clouds that are shown, on the metric lattice.
    bounds: [[f64; 3]; 2],
}

/// Depth of the near plane over the typical distance of points: a nearer point would cover the
/// whole picture.
const NEAR_SPACINGS: f64 = 0.1;
/// The near plane is at most `DENSE_SPACINGS` times as far as that of the densest part that has
/// 1 / `DENSE_SHARE` of the points.
const DENSE_SHARE: u64 = 16;
const DENSE_SPACINGS: f64 = 8.0;
/// About how many leaves give the typical distance of points.
const NEAR_LEAVES: usize = 1 << 13;

impl Appearance {
    /// Appearance of the points that `filter` accepts, coloured by `colour`
    /// ([`crate::cameras::colour::colouring`]) with elevations along `vertical`.
    ///
    /// # Errors
    /// If the file lacks the source of colours, or the filter is invalid.
    pub fn new(
        file: &Forest,
        colour: Option<&str>,
        vertical: Vertical,
        filter: &Filter,
        method: Method,
        shines: bool,
    ) -> Result<Self> {
        let shown = Self::filter(file, filter)?;
        Self::filtered(file, colour, vertical, (shown, &[]), method, shines)
    }

    /// Points that `filter` accepts.
    fn filter(file: &Forest, filter: &Filter) -> Result<ForestFilter> {
        empty_picture::check_classes(file, filter)?;
        let on_lattice = (!filter.is_all()).then(|| filter.on(file.lattice(), file.schema()));
        let on_lattice = on_lattice.transpose();
        let on_lattice = on_lattice.with_context(|| file.path().display().to_string())?;
        Ok(ForestFilter::of(file, on_lattice, None)?)
    }

    /// As [`Appearance::new`], of the points that `shown` accepts, which leaves out the clouds
    /// `hidden`.
    fn filtered(
        file: &Forest,
        colour: Option<&str>,
        vertical: Vertical,
        (shown, hidden): (ForestFilter, &[usize]),
        method: Method,
        shines: bool,
    ) -> Result<Self> {
        let bounds = info::bounds_without(file, hidden);
        let colouring = filtered_colouring(file, colour, vertical, bounds, &shown)?;
        let codes = colouring.plane.map(|(kind, _)| kind).zip(colouring.codes);
        let shown = Arc::new(shown.coded(codes));
        let (evens_exposure, culls_back, dots) = (false, false, Dots::default());
        let (near, target_spacing_px) = (near(file, &shown), Options::default().target_spacing_px);
        Ok(Self {
            colouring,
            shown,
            method,
            shines,
            evens_exposure,
            is_one_scan: false,
            culls_back,
            dots,
            target_spacing_px,
            near,
            bounds,
        })
    }

    /// Appearance of a session with these settings.
    ///
    /// # Errors
    /// If the file lacks the source of colours or what distinguishes scans, or the filter is
    /// invalid.
    pub fn of(file: &Forest, settings: &Settings) -> Result<Self> {
        let Settings { colour_by, filter, method, shines, light, evens_exposure, full, .. } =
            settings;
        let colour = colour_by.as_deref();
        let hidden = &*settings.hidden_clouds;
        let shown = Self::filter(file, filter)?.without_clouds(file, hidden);
        let shown = (shown, hidden);
        let appearance = Self::filtered(file, colour, settings.vertical, shown, *method, *shines)?;
        let appearance = appearance.evened(file, *evens_exposure)?.culled(settings.culls_back);
        let appearance = appearance.dotted(settings.dots).aimed(settings.target_spacing_px);
        let appearance = if *full { appearance } else { appearance.compacted(file) };
        // Classes are read as they are stored, also where colours are made of them.
        let has_classes = class_plane(file, *method, light).is_some();
        Ok(if has_classes { appearance.with_values() } else { appearance })
    }

    /// Boxes of what a session with this appearance and these settings shows; of all points where a
    /// node cannot be read.
    pub(crate) fn boxes(&self, file: &Forest, settings: &Settings) -> Boxes {
        let Settings { filter, hidden_clouds, .. } = settings;
        Boxes::of(file, filter, hidden_clouds, &self.shown)
            .unwrap_or_else(|_| Boxes::equal(Boxes::all(file, filter, hidden_clouds)))
    }

    /// What a session with this appearance reads, without a look.
    pub(crate) fn shown_by(&self, file: &Forest, light: &LightSettings) -> Shown {
        let classes = class_plane(file, self.method, light);
        let needs = Needs { classes, ..self.needs(file) };
        Shown { needs, filter: Arc::clone(&self.shown), ..Shown::default() }
    }

    /// This appearance drawn as `drawn` is in all that needs no other planes: a cut that was chosen
    /// for this one is drawn by it.
    pub(crate) fn drawn_as(&self, drawn: &Self) -> Self {
        let Self { method, shines, culls_back, dots, target_spacing_px, .. } = *drawn;
        Self { method, shines, culls_back, dots, target_spacing_px, ..self.clone() }
    }

    /// This appearance with the colours of depths in `view`, if its colours are those of depths,
    /// which `colour` requests.
    pub(crate) fn seen(&self, view: &View, boxes: &Boxes, colour: Option<&str>) -> Option<Self> {
        self.colouring.is_by_depth().then(|| {
            let colouring = self.colouring.clone().seen(view, boxes.fitted, colour);
            Self { colouring, ..self.clone() }
        })
    }

    /// Whether the same planes, filter and colours are drawn.
    pub(crate) fn reads_as(&self, other: &Self) -> bool {
        self.colouring == other.colouring
            && self.evens_exposure == other.evens_exposure
            && self.is_one_scan == other.is_one_scan
            && self.shown == other.shown
    }

    /// Adds exposure compensation, if `evens_exposure` and the file has several scans.
    ///
    /// # Errors
    /// If no attribute of the file differs between scans.
    pub fn evened(mut self, file: &Forest, evens_exposure: bool) -> Result<Self> {
        let scans = evens_exposure.then(|| colour::scans(file)).transpose()?;
        let is_one_scan = evens_exposure && colour::is_one_scan(file)?;
        if let Some(scans) = scans.filter(|_| !is_one_scan) {
            self.shown = Arc::new(ForestFilter::clone(&self.shown).with_scans(Some(scans)));
        }
        Ok(Self { evens_exposure, is_one_scan, ..self })
    }

    /// Leaves out points that face away, if `culls_back` and where normals tell front from back.
    /// Those of closed surfaces are left out in any case.
    pub fn culled(self, culls_back: bool) -> Self {
        Self { culls_back, ..self }
    }

    /// Draws points alone as these dots.
    pub fn dotted(self, dots: Dots) -> Self {
        Self { dots, ..self }
    }

    /// Draws points as close together as this, pixels, where the file has that many.
    pub fn aimed(self, target_spacing_px: f64) -> Self {
        Self { target_spacing_px, ..self }
    }

    /// How crowded a view is ([`esker_lod::crowding`]).
    pub fn crowding(&self, file: &Forest, view: &View) -> f32 {
        self.crowding_lacking(file, view, &mut Vec::new())
    }

    /// How crowded a view is; adds nodes to `lacking` whose children would change it.
    pub(crate) fn crowding_lacking(
        &self,
        file: &Forest,
        view: &View,
        lacking: &mut Vec<u32>,
    ) -> f32 {
        if self.method.passes() != Passes::PullPush {
            return 0.0;
        }
        let roots = file.table().roots().filter(|root| !self.shown.leaves_out(*root));
        crowding(file.table(), roots, file.metric(), view, self.target_spacing_px, lacking)
    }

    /// How points look that are drawn alone, and whether they are mixed with surfaces.
    fn dots_of_frames(&self) -> (Dots, bool) {
        match self.method {
            Method::Auto => (AUTO_DOTS, true),
            _ => (self.dots, false),
        }
    }

    fn culls_back_faces(&self, file: &Forest) -> bool {
        let culls = self.culls_back || file.is_closed();
        culls && file.has_oriented_normals() && self.method != Method::Points
    }

    /// Draws from compact planes, if all trees have them and the picture needs nothing that they
    /// lack.
    pub fn compacted(mut self, file: &Forest) -> Self {
        let needs_full =
            self.evens_exposure || self.shown.hides_any() || self.colouring.by != ColourBy::Rgb;
        if let Some(palette) = file.palette().filter(|_| !needs_full) {
            self.colouring.by = ColourBy::Codes(Codebook::Own(palette.table()));
            self.colouring.plane = Some((PlaneKind::Compact, None));
        }
        self
    }

    /// Draws from values as they are stored, instead of codes of a byte, where they are mapped
    /// along a range.
    pub fn with_values(mut self) -> Self {
        let Colouring { by, plane, codes, .. } = &mut self.colouring;
        if let (ColourBy::Codes(Codebook::Along(gradient)), Some(Codes { ty, coding })) =
            (*by, *codes)
            && let (Coding::Along { low, high }, Some((_, stored))) = (coding, plane)
        {
            *by = ColourBy::Scalar(ColourMap { low, high, gradient });
            (*stored, *codes) = (Some(ty), None);
            self.shown = Arc::new(ForestFilter::clone(&self.shown).coded(None));
        }
        self
    }

    /// Plan of the frames. `sparsest_px`: distance of points where they are farthest
    /// apart ([`esker_render::inputs::density::sparsest_px`]); `crowding`: how
    /// crowded the view is.
    pub fn plan(&self, file: &Forest, sparsest_px: f64, crowding: f32) -> FramePlan {
        let normals = file.has(PlaneKind::Normal);
        let has = SceneHas {
            normals,
            oriented_normals: self.culls_back_faces(file),
            colour_plane: self.colouring.plane.is_some_and(|(kind, _)| file.has(kind)),
            hidden_points: self.shown.hides_any(),
            // Light is traced on discs.
            clip_lines: file.has(PlaneKind::ClipLines) && self.method != Method::Lit,
            tangents: file.has(PlaneKind::Tangents) && self.method != Method::Lit,
        };
        let (method, colour) = (self.method.passes(), self.colouring.by);
        let shines = self.shines;
        let evens_exposure = self.evens_exposure && !self.is_one_scan;
        let (dots, mixes_dots) = self.dots_of_frames();
        let (smooths, fits_planes) = (true, true);
        let options = FrameOptions {
            method,
            colour,
            shines,
            sparsest_px,
            smooths,
            fits_planes,
            crowding,
            evens_exposure,
            dots,
            mixes_dots,
            thins_points: self.target_spacing_px > 0.0,
            passes: PassChoice::default(),
        };
        FramePlan::of(&has, &options)
    }

    /// Planes of each node that frames need, except residuals, which views request node by node,
    /// and classes ([`crate::light::class_plane`]).
    pub fn needs(&self, file: &Forest) -> Needs {
        let plan = self.plan(file, f64::INFINITY, 0.0);
        let colour = self.colouring.plane.map(|(kind, _)| kind).filter(|_| plan.reads_colours);
        let (normals, clip_lines, tangents) = (plan.reads_normals, plan.clips, plan.tangents);
        Needs { colour, normals, clip_lines, tangents, classes: None }
    }

    /// The view that is drawn: with the near plane of the file, which does not depend on the
    /// camera, and the margin of pictures ([`esker_render::picture::margin`]). There is no margin
    /// if the whole file is in the picture, or the picture would be too large.
    pub fn drawn_view(&self, view: &View) -> View {
        // A parallel view draws nothing behind its eye, which is its near plane.
        let near = if view.parallel_at.is_some() { view.near } else { self.near };
        let view = View { near, ..*view };
        let shown = view.with_margin(0);
        let wide = view.with_margin(MARGIN_PX);
        let takes = self.method.passes() == Passes::PullPush
            && is_drawable(wide.width, wide.height)
            && goes_beyond(&shown, self.bounds);
        if takes { wide } else { shown }
    }

    /// Frame of nodes that are already collected. `view` includes its margin.
    pub fn frame<'a, P>(
        &self,
        file: &'a Forest,
        view: &'a View,
        draws: &'a [DrawNode<'a, P>],
        octree: &'a CompactOctree,
    ) -> Frame<'a, P> {
        let hides_points = self.shown.hides_any();
        let shines = self.shines;
        let evens_exposure = self.evens_exposure && !self.is_one_scan;
        let (dots, mixes_dots) = self.dots_of_frames();
        Frame {
            octree: Some(octree),
            method: self.method.passes(),
            colour: self.colouring.by,
            cull_back_faces: self.culls_back_faces(file),
            has_fronts: file.has_oriented_normals(),
            hides_points,
            shines,
            evens_exposure,
            crowding: Some(self.crowding(file, view)),
            dots,
            target_spacing_px: self.target_spacing_px,
            mixes_dots,
            ..Frame::new(view, file.metric(), draws)
        }
    }
}

/// Depth of the near plane, in steps of the coordinates, where the distances of points are not
/// known: these are at least as far apart in most scans.
const NEAR_STEPS: f64 = 1.0;

/// Depth of the near plane of pictures of a file: from the median distance of the points of leaves;
/// less where a part of the file is far denser, so that it is not clipped from nearby.
fn near(file: &Forest, shown: &ForestFilter) -> f64 {
    let is_sound = |spacing: f64| spacing.is_finite() && spacing > 0.0;
    if file.is_growing() {
        // Spacings are not known yet, and pictures must not depend on what is.
        let steps = file.files().map(|file| file.exact_lattice().metric().scale);
        let least = steps.flatten().fold(f64::INFINITY, f64::min);
        return (least * NEAR_STEPS).max(f64::from(f32::MIN_POSITIVE));
    }
    let nodes: Vec<_> = file.overview().into_iter().filter(|n| !shown.leaves_out(n.node)).collect();
    let every = nodes.len() / NEAR_LEAVES + 1;
    // Of a node that stands for those below it, nearly all points are below it.
    let points = |node: &OverviewNode| node.points_below.max(node.points);
    let leaves =
        nodes.iter().filter_map(|node| Some((f64::from(node.leaf_spacing?), points(node))));
    // A sample of the leaves of a large file.
    let leaves = leaves.step_by(every);
    let mut leaves: Vec<_> = leaves.filter(|&(spacing, _)| is_sound(spacing)).collect();
    leaves.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let all = leaves.iter().map(|leaf| leaf.1).sum::<u64>();
    let quantile = |mut left: u64| {
        let of = leaves.iter().find(|(_, points)| {
            let is_quantile = left < *points;
            left = left.saturating_sub(*points);
            is_quantile
        });
        of.map(|&(spacing, _)| spacing)
    };
    let median = quantile(all / 2).zip(quantile(all / DENSE_SHARE));
    let median = median.map(|(median, dense)| median.min(dense * DENSE_SPACINGS));
    let step = file.metric().scale.into_iter().fold(f64::INFINITY, f64::min);
    median.map_or(step, |spacing| spacing * NEAR_SPACINGS).max(f64::from(f32::MIN_POSITIVE))
}

/// Node `index` of a file; `entry` is its index in the cut, `plane` returns its planes.
pub fn draw_node<'a, P: Default>(
    table: &'a NodeTable,
    index: u32,
    entry: usize,
    prefix: usize,
    colouring: &Colouring,
    plane: impl Fn(PlaneKind) -> Option<P>,
) -> DrawNode<'a, P> {
    let positions = colouring.positions();
    let colour = match colouring.plane.and_then(|(kind, ty)| Some((plane(kind)?, ty))) {
        Some(_) if positions == PlaneKind::Compact => ColourPlane::Indexed,
        Some((bytes, None)) => ColourPlane::Rgba(bytes),
        Some((bytes, Some(ty))) => ColourPlane::Scalar { bytes, ty },
        None => ColourPlane::None,
    };
    let node = &table.nodes[index as usize];
    let above = share_above(node, table.nodes.get(node.parent as usize)) as f32;
    DrawNode {
        node,
        entry,
        prefix,
        above,
        position: plane(positions).unwrap_or_default(),
        residual: plane(PlaneKind::Residual),
        colour,
        normal: plane(PlaneKind::Normal),
        clip: plane(PlaneKind::ClipLines),
        tangents: plane(PlaneKind::Tangents),
    }
}
