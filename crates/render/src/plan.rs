//! The plan of a frame: which passes run, which planes are read and which variants of pipelines are
//! used, from the planes of the scene, the density of the view and the settings. Attributes that a
//! frame does not need are not read, not resident, not bound and not computed. Both renderers
//! follow the plan, and so does the code that reads planes.

use crate::frame::{ColourPlane, Dots, Frame, Method, PointSize};
use crate::inputs::colour::ColourBy;
use crate::inputs::density::{DENSE_PX, FITTED_PX, is_crowded, sparsest_px};
use crate::pass::{Pass, PassChoice, PassSet};
use crate::passes::fit_planes::LEVELS;
use crate::picture::pyramid::Planes;
use std::ops::Deref;

/// A list of passes in the order in which they run.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PassList {
    all: [Pass; PASSES_MAX],
    count: usize,
}

/// Greatest length of a list.
const PASSES_MAX: usize = Pass::ALL.len();

impl PassList {
    /// The passes that are marked `true`.
    fn of(passes: &[(Pass, bool)]) -> Self {
        let mut list = Self { all: [Pass::Project; PASSES_MAX], count: 0 };
        let wanted = passes.iter().filter(|(_, wanted)| *wanted);
        for ((pass, _), to) in wanted.zip(&mut list.all) {
            *to = *pass;
            list.count += 1;
        }
        list
    }

    /// The list without `pass`.
    fn without(self, pass: Pass) -> Self {
        self.skipping(PassSet::of(&[pass]))
    }

    /// The list without the optional passes of `skipped`.
    fn skipping(self, skipped: PassSet) -> Self {
        let stays = |pass: Pass| !(pass.is_optional() && skipped.has(pass));
        let left: Vec<_> = self.iter().map(|&pass| (pass, stays(pass))).collect();
        Self::of(&left)
    }
}

impl Deref for PassList {
    type Target = [Pass];

    fn deref(&self) -> &[Pass] {
        &self.all[..self.count]
    }
}

impl std::fmt::Debug for PassList {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

/// Planes that a scene has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneHas {
    /// Whether some node has normals.
    pub normals: bool,
    /// Whether the normals have a consistent side, so that points can be dropped by them.
    pub oriented_normals: bool,
    /// Whether some node has the plane that colours are computed from.
    pub colour_plane: bool,
    /// Whether points may be marked as left out by a filter.
    pub hidden_points: bool,
    /// Whether some node has clip lines of splats.
    pub clip_lines: bool,
    /// Whether some node has shapes of splats.
    pub tangents: bool,
}

/// Settings of a frame, and the density of its view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameOptions {
    /// How points become a picture.
    pub method: Method,
    /// Source of the colours.
    pub colour: ColourBy,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Distance of the points of the view where they are farthest apart, pixels
    /// ([`crate::inputs::density::sparsest_px`]).
    pub sparsest_px: f64,
    /// Whether pixels that show one point are smoothed.
    pub smooths: bool,
    /// Whether planes are fitted to depths if points have no normals.
    pub fits_planes: bool,
    /// How crowded the view is, 0 to 1 ([`Frame::crowding`]).
    pub crowding: f32,
    /// Whether differences of exposure between scans are removed. The spare byte of a colour is
    /// then the number of its scan.
    pub evens_exposure: bool,
    /// How points look that are drawn alone.
    pub dots: Dots,
    /// Whether points that are no surface on the picture are drawn as dots.
    pub mixes_dots: bool,
    /// Whether points that are drawn alone are left out where they are closer together than asked
    /// ([`Frame::target_spacing_px`]).
    pub thins_points: bool,
    /// Passes that are chosen otherwise than by the plan.
    pub passes: PassChoice,
}

/// The passes and planes of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FramePlan {
    /// The passes that run.
    pub passes: PassList,
    /// Whether the colour plane is read.
    pub reads_colours: bool,
    /// Whether the normal plane is read.
    pub reads_normals: bool,
    /// Whether pixels have normals, from gathering or blending to shading.
    pub carries_normals: bool,
    /// Whether points whose normal looks away are dropped.
    pub culls_back_faces: bool,
    /// Whether points that a filter has marked are dropped.
    pub hides_points: bool,
    /// Whether points are dropped that are closer together than asked.
    pub thins_points: bool,
    /// Whether splats are clipped; then the plane of clip lines is read.
    pub clips: bool,
    /// Whether splats have shapes; then their plane is read.
    pub tangents: bool,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether the pyramid has levels above level 0.
    pub has_pyramid: bool,
    /// Whether pixels that show one point are mixed with their interpolation
    /// ([`crate::passes::push`]): if the options want it, the view is not wholly crowded and
    /// colours are not names.
    pub smooths: bool,
    /// How crowded the view is, 0 to 1: the share of averages in the attributes of pixels, and of
    /// smoothing that is left out.
    crowding: f32,
    /// Share of fitted planes in the tilt and the depth intervals of pixels, 0 to 1.
    fitting: f32,
    /// Whether points that are drawn alone have sizes of their own.
    pub adapts: bool,
    /// Width of the margin around the picture, pixels ([`crate::picture::margin`]); 0 if the plan
    /// is not that of a view.
    pub margin_px: u32,
    /// [`ColourBy::number`] of the frame.
    colour: u32,
    /// Whether words of positions, colours and normals are fetched for the winning points.
    pub(crate) fetches: [bool; 3],
}

/// A variant of a shader: the values of its constants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// Folder and file of the shader.
    pub shader: &'static str,
    /// Its `override` constants.
    pub constants: Vec<(&'static str, u32)>,
}

impl FramePlan {
    /// The plan for a scene with these planes and these options.
    pub fn of(has: &SceneHas, options: &FrameOptions) -> Self {
        use Pass::{Antialias, Average, Blend, Exposure, EyeDome, FillHoles, FitPlanes, Gather};
        use Pass::{Grow, Overlay, Place, Project, Pull, Push, Resolve, Shade, Silhouette};
        use Pass::{SmoothDepth, Split};
        let PassChoice { skipped, forced } = options.passes;
        let skips_any = |passes: &[Pass]| passes.iter().any(|&pass| skipped.has(pass));
        let has_surface = options.method != Method::Points;
        let is_dense = options.sparsest_px <= DENSE_PX;
        let is_surface = options.method == Method::PullPush;
        let has_pyramid = is_surface && !is_dense && !skips_any(&[Pull, Push]);
        let averages = is_surface && !skipped.has(Average);
        let crowding = if averages { options.crowding.clamp(0.0, 1.0) } else { 0.0 };
        let mixes_dots = options.mixes_dots && is_surface && !skips_any(&[Split, Grow, Overlay]);
        let carries_normals = has.normals && has_surface;
        let is_splats = options.method == Method::Ewa;
        let fits = options.fits_planes && (has_pyramid || is_splats) && !has.normals;
        let fits = fits && !skipped.has(FitPlanes);
        // Without push a pixel is at most half a pixel from its sample along each axis, or a gap
        // between samples: nothing sticks out.
        let may_stick_out = has_pyramid || forced.has(Silhouette);
        let passes = match options.method {
            Method::Points => PassList::of(&[
                (Project, true),
                (Grow, options.dots.size.grows()),
                (Resolve, true),
                (EyeDome, options.dots.eye_dome > 0.0),
            ]),
            Method::PullPush => PassList::of(&[
                (Project, true),
                (Split, mixes_dots),
                (FitPlanes, fits),
                (Gather, true),
                (Average, crowding > 0.0),
                (
                    Exposure,
                    options.evens_exposure && has.colour_plane && options.colour == ColourBy::Rgb,
                ),
                (Pull, has_pyramid),
                (Push, has_pyramid),
                (FillHoles, true),
                (Silhouette, may_stick_out),
                (SmoothDepth, !has.normals),
                (Shade, true),
                (Antialias, true),
                (Grow, mixes_dots),
                (Overlay, mixes_dots),
                (EyeDome, mixes_dots && options.dots.eye_dome > 0.0),
            ]),
            Method::Ewa => PassList::of(&[
                (Project, fits),
                (FitPlanes, fits),
                (Place, true),
                (Blend, true),
                (SmoothDepth, !has.normals),
                (Shade, true),
                (Antialias, true),
            ]),
        };
        let passes = passes.skipping(skipped);
        let adapts = mixes_dots || !has_surface && options.dots.size == PointSize::Adaptive;
        let culls_back_faces = has.oriented_normals && has.normals;
        let fetches_normals =
            carries_normals || (has.normals && options.colour == ColourBy::Normal);
        Self {
            passes,
            reads_colours: has.colour_plane && options.colour.reads_plane(),
            reads_normals: fetches_normals || culls_back_faces,
            carries_normals,
            culls_back_faces,
            hides_points: has.hidden_points,
            thins_points: options.thins_points && !has_surface,
            // The normal of a splat decides which side of a line is kept.
            clips: has.clip_lines && carries_normals && options.method == Method::Ewa,
            // Shapes lie in the plane of the normal.
            tangents: has.tangents && carries_normals && options.method == Method::Ewa,
            shines: options.shines && has_surface,
            has_pyramid,
            smooths: has_pyramid && options.smooths && crowding < 1.0 && !options.colour.names(),
            crowding,
            fitting: ((options.sparsest_px - DENSE_PX) / (FITTED_PX - DENSE_PX)).clamp(0.0, 1.0)
                as f32,
            adapts,
            margin_px: 0,
            colour: options.colour.number(),
            fetches: [
                has_surface || adapts || matches!(options.colour, ColourBy::Coordinate(..)),
                has.colour_plane && options.colour.reads_plane(),
                fetches_normals,
            ],
        }
    }

    /// The plan of `frame`.
    pub fn new<P>(frame: &Frame<'_, P>) -> Self {
        let normals = frame.draws.iter().any(|d| d.normal.is_some());
        let has = SceneHas {
            normals,
            oriented_normals: normals && frame.cull_back_faces,
            colour_plane: frame.draws.iter().any(|d| !matches!(d.colour, ColourPlane::None)),
            hidden_points: frame.hides_points,
            clip_lines: frame.draws.iter().any(|d| d.clip.is_some()),
            tangents: frame.draws.iter().any(|d| d.tangents.is_some()),
        };
        let (method, colour) = (frame.method, frame.colour);
        let nodes = || frame.draws.iter().map(|draw| (draw.entry, draw.node));
        let octree = frame.octree.filter(|_| method == Method::PullPush && frame.skips_push);
        let sparsest_px =
            octree.map_or(f64::INFINITY, |o| sparsest_px(frame.view, frame.lattice, o, nodes()));
        let drawn = || frame.draws.iter().map(|draw| (draw.entry, draw.node, draw.prefix));
        let crowding = match frame.crowding {
            _ if method != Method::PullPush || !frame.averages => 0.0,
            Some(crowding) => crowding,
            None => f32::from(is_crowded(frame.view, frame.lattice, frame.octree, drawn())),
        };
        let Frame { shines, smooths, fits_planes, evens_exposure, dots, mixes_dots, .. } = *frame;
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
            thins_points: frame.thins_points(),
            passes: frame.passes,
        };
        let plan = Self::of(&has, &options);
        // A window is drawn as it is; the caller crops it.
        let is_whole = frame.view.window.is_none();
        let margin_px = if plan.has_pyramid && is_whole { frame.view.margin_px } else { 0 };
        Self { margin_px, ..plan }
    }

    /// The planes that pixels carry in this frame.
    pub fn planes(&self) -> Planes {
        // Fitted planes tilt splats; their pixels have none.
        let fits = self.fits_planes() && self.passes.contains(&Pass::Gather);
        match (self.carries_normals, fits) {
            (true, _) => Planes::Normals,
            (false, true) => Planes::Fitted,
            (false, false) => Planes::None,
        }
    }

    /// Whether planes are fitted to depths.
    pub fn fits_planes(&self) -> bool {
        self.passes.contains(&Pass::FitPlanes)
    }

    /// Levels of squares that planes are fitted to: splats of all sizes get planes, of pixels only
    /// those that show narrow discs.
    pub fn plane_levels(&self) -> usize {
        if self.passes.contains(&Pass::Gather) { 1 } else { LEVELS }
    }

    /// Whether points that are no surface on the picture are drawn as dots.
    pub fn mixes_dots(&self) -> bool {
        self.passes.contains(&Pass::Split)
    }

    /// Whether the points of the front surface of a pixel are averaged.
    pub fn averages(&self) -> bool {
        self.passes.contains(&Pass::Average)
    }

    /// Whether pixels with a normal are darkened behind edges: those of splats are not.
    pub fn darkens_edges(&self) -> bool {
        !self.passes.contains(&Pass::Blend)
    }

    /// The plan without [`Pass::Average`].
    pub fn without_averages(self) -> Self {
        Self { passes: self.passes.without(Pass::Average), crowding: 0.0, ..self }
    }

    /// How crowded the view is, 0 to 1; 0 without [`Pass::Average`].
    pub fn crowding(&self) -> f32 {
        self.crowding
    }

    /// Share of fitted planes in the tilt and the depth intervals of pixels, 0 to 1: dense views
    /// have no planes.
    pub fn fitting(&self) -> f32 {
        self.fitting
    }

    /// [`FramePlan::crowding`] and [`FramePlan::fitting`].
    pub fn shares(&self) -> [f32; 2] {
        [self.crowding, self.fitting]
    }

    /// The share of smoothing in pixels that show one point ([`crate::passes::push`]), 0 to 1.
    pub fn smoothing(&self) -> f32 {
        if self.smooths { 1.0 - self.crowding } else { 0.0 }
    }

    /// Whether differences of exposure between scans are removed.
    pub fn evens_exposure(&self) -> bool {
        self.passes.contains(&Pass::Exposure)
    }

    /// The plan without [`Pass::Exposure`].
    pub fn without_exposure(self) -> Self {
        Self { passes: self.passes.without(Pass::Exposure), ..self }
    }

    /// Whether averaging reads colours and normals.
    pub(crate) fn averages_read(&self) -> [bool; 2] {
        let [_, colours, normals] = self.fetches;
        [colours, normals].map(|reads| reads && self.averages())
    }

    /// Constants of the shader that adds up points.
    pub fn average_constants(&self) -> [(&'static str, u32); 5] {
        let [culls, hides, _] = self.project_constants();
        let [normals, colour] = self.colour_constants();
        [culls, hides, normals, ("COLOURS", u32::from(self.fetches[1])), colour]
    }

    /// Constants of the shaders that project points, by compute or by primitives.
    pub fn project_constants(&self) -> [(&'static str, u32); 3] {
        [
            ("CULLS_BACK_FACES", u32::from(self.culls_back_faces)),
            ("HIDES_POINTS", u32::from(self.hides_points)),
            ("THINS_POINTS", u32::from(self.thins_points)),
        ]
    }

    /// Constants of the shader that fetches words of the winning points.
    pub fn fetch_constants(&self) -> [(&'static str, u32); 3] {
        let flags = self.fetches.map(u32::from);
        [("GEOMETRY", flags[0]), ("COLOURS", flags[1]), ("NORMALS", flags[2])]
    }

    /// Constants of the shader that converts words to pixels of the pyramid.
    pub fn gather_constants(&self) -> [(&'static str, u32); 3] {
        let [normals, colour] = self.colour_constants();
        [normals, ("PLANES", u32::from(self.planes() != Planes::None)), colour]
    }

    /// Constants of the shader that gives dots their sizes.
    pub fn sizes_constants(&self) -> [(&'static str, u32); 2] {
        [("SPLITS", u32::from(self.mixes_dots())), ("NORMALS", u32::from(self.carries_normals))]
    }

    /// Constants of the shader that draws dots over surfaces.
    pub fn overlay_constants(&self) -> [(&'static str, u32); 3] {
        let [normals, colour] = self.colour_constants();
        [normals, ("SHINES", u32::from(self.shines)), colour]
    }

    /// Constants of the shaders that compute colours from words.
    pub fn colour_constants(&self) -> [(&'static str, u32); 2] {
        [("NORMALS", u32::from(self.carries_normals)), ("COLOUR", self.colour)]
    }

    /// The shader variants of a frame on a GPU, in the order of the passes.
    pub fn variants(&self) -> Vec<Variant> {
        let normals = ("NORMALS", u32::from(self.carries_normals));
        let planes = ("PLANE", self.planes().values() as u32);
        let clips = ("CLIPS", u32::from(self.clips));
        let tangents = ("TANGENTS", u32::from(self.tangents));
        let variant = |shader, constants: &[(&'static str, u32)]| Variant {
            shader,
            constants: constants.to_vec(),
        };
        let of = |pass: &Pass| match pass {
            Pass::Project => vec![variant("project", &self.project_constants())],
            Pass::FitPlanes => {
                let join = (self.plane_levels() > 1).then_some("fit_planes/join");
                let steps = ["fit_planes/nearest"].into_iter().chain(join);
                steps.chain(["fit_planes/fit"]).map(|step| variant(step, &[])).collect()
            }
            Pass::Gather => {
                let mut all = vec![
                    variant("gather/fetch", &self.fetch_constants()),
                    variant("gather/gather", &self.gather_constants()),
                ];
                if self.planes() == Planes::Fitted {
                    all.push(variant("fit_planes/tilt", &[]));
                }
                all
            }
            Pass::Split => vec![
                variant("gather/fetch", &self.fetch_constants()),
                variant("grow/sizes", &self.sizes_constants()),
            ],
            Pass::Overlay => {
                vec![
                    variant("gather/fetch", &self.fetch_constants()),
                    variant("overlay", &self.overlay_constants()),
                ]
            }
            Pass::Grow => {
                let sizes = self.adapts && !self.mixes_dots();
                let sizes = sizes.then(|| variant("grow/sizes", &self.sizes_constants()));
                let grow = variant("grow/grow", &[("ADAPTS", u32::from(self.adapts))]);
                sizes.into_iter().chain([grow]).collect()
            }
            Pass::EyeDome => {
                vec![variant("eye_dome", &[("DOTS_ONLY", u32::from(self.mixes_dots()))])]
            }
            Pass::Resolve => vec![
                variant("gather/fetch", &self.fetch_constants()),
                variant("resolve", &self.colour_constants()[1..]),
            ],
            Pass::Shade => {
                let edges = ("EDGES", u32::from(self.darkens_edges()));
                vec![variant("shade", &[normals, ("SHINES", u32::from(self.shines)), edges])]
            }
            Pass::Average => vec![
                variant("average/begin", &[planes]),
                variant("average/add", &self.average_constants()),
                variant("average/finish", &[normals]),
            ],
            Pass::Exposure => ["exposure/slot", "exposure/add", "exposure/apply"]
                .map(|step| variant(step, &[]))
                .into(),
            Pass::Place => {
                let [normals, colour] = self.colour_constants();
                let hides = ("HIDES_POINTS", u32::from(self.hides_points));
                let fitted = ("FITTED", u32::from(self.fits_planes()));
                vec![
                    variant("gather/fetch", &self.fetch_constants()),
                    variant("ewa/place", &[normals, colour, hides, clips, tangents, fitted]),
                ]
            }
            Pass::Blend => {
                vec![variant("ewa/blend", &[normals, clips]), variant("ewa/normalise", &[normals])]
            }
            Pass::Pull => vec![variant("pull", &[planes])],
            Pass::Push => vec![variant("push", &[planes, ("SMOOTHS", u32::from(self.smooths))])],
            Pass::FillHoles => vec![
                variant("fill_holes/depth", &[planes]),
                variant("fill_holes/find", &[normals]),
                variant("fill_holes/fill", &[normals]),
            ],
            Pass::Silhouette => vec![
                variant("silhouette/start", &[]),
                variant("silhouette/rims", &[normals]),
                variant("silhouette/tiles", &[]),
                variant("silhouette/waves", &[normals]),
                variant("silhouette/settle", &[]),
            ],
            Pass::SmoothDepth => {
                ["smooth_depth/tiles", "smooth_depth/corners", "smooth_depth/smooth"]
                    .map(|shader| variant(shader, &[]))
                    .into()
            }
            Pass::Antialias => vec![variant("antialias", &[normals])],
        };
        self.passes.iter().flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests;
