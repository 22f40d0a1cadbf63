//! The plan of a frame (DESIGN section 8): from what the scene has, what the view asks and how it is drawn to the
//! passes, the planes and the variants of pipelines that it takes. What a scene does not need is left out: it is
//! not read, not resident, not bound and not computed. Both renderers follow it, and so does who reads planes.

use crate::frame::{ColourPlane, Frame, Method};
use crate::inputs::colour::ColourBy;
use crate::inputs::density::{is_crowded, is_dense};
use crate::picture::pyramid::Planes;
use std::ops::Deref;

/// A pass of the renderers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Pass {
    /// Projects points to single pixels.
    Project,
    /// Fits planes to the depths of clouds without normals.
    FitPlanes,
    /// Gathers the attributes of visible points into level 0 of the pyramid.
    Gather,
    /// Averages the points that share a pixel.
    Average,
    /// Removes differences of exposure between scans.
    Exposure,
    /// Averages upwards in the pyramid.
    Pull,
    /// Fills pixels downwards in the pyramid.
    Push,
    /// Fills small holes through which a farther surface shows.
    FillHoles,
    /// Trims silhouettes back to the samples.
    Silhouette,
    /// Projects points to splats and sorts them into tiles of the picture.
    Place,
    /// Blends the splats of each tile: visibility, attributes, normalisation.
    Blend,
    /// Smooths the depths of clouds without normals, which shading derives normals from.
    SmoothDepth,
    /// Lights the surface and encodes its colours.
    Shade,
    /// Antialiases silhouettes and creases.
    Antialias,
    /// Writes the colours of visible points straight to the picture.
    Resolve,
}

impl Pass {
    /// All passes, in the order in which a frame runs them.
    pub const ALL: [Self; 15] = [
        Self::Project,
        Self::FitPlanes,
        Self::Gather,
        Self::Average,
        Self::Exposure,
        Self::Pull,
        Self::Push,
        Self::FillHoles,
        Self::Silhouette,
        Self::Place,
        Self::Blend,
        Self::SmoothDepth,
        Self::Shade,
        Self::Antialias,
        Self::Resolve,
    ];

    /// Name of the pass, the same in shaders, JSON and documents.
    pub fn name(self) -> &'static str {
        match self {
            Self::Project => "project",
            Self::FitPlanes => "fit_planes",
            Self::Gather => "gather",
            Self::Average => "average",
            Self::Exposure => "exposure",
            Self::Pull => "pull",
            Self::Push => "push",
            Self::FillHoles => "fill_holes",
            Self::Silhouette => "silhouette",
            Self::Place => "place",
            Self::Blend => "blend",
            Self::SmoothDepth => "smooth_depth",
            Self::Shade => "shade",
            Self::Antialias => "antialias",
            Self::Resolve => "resolve",
        }
    }
}

/// Passes in their order.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PassList {
    all: [Pass; PASSES_MAX],
    count: usize,
}

/// Passes of the longest list.
const PASSES_MAX: usize = 12;

impl PassList {
    /// Those of `passes` that are wanted.
    fn of(passes: &[(Pass, bool)]) -> Self {
        let mut list = Self { all: [Pass::Project; PASSES_MAX], count: 0 };
        let wanted = passes.iter().filter(|(_, wanted)| *wanted);
        for ((pass, _), to) in wanted.zip(&mut list.all) {
            *to = *pass;
            list.count += 1;
        }
        list
    }

    /// All but one.
    fn without(self, pass: Pass) -> Self {
        let left: Vec<_> = self.iter().map(|&p| (p, p != pass)).collect();
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

/// What a scene has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneHas {
    /// Normals, in some node at least.
    pub normals: bool,
    /// Whether the normals tell front from back.
    pub oriented_normals: bool,
    /// The plane that the colours asked for come from.
    pub colour_plane: bool,
    /// Marks of points that a filter leaves out.
    pub hidden_points: bool,
    /// Clip lines of splats, in some node at least.
    pub clip_lines: bool,
    /// Shapes of splats, in some node at least.
    pub tangents: bool,
}

/// What is asked of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Asked {
    /// How points become a picture.
    pub method: Method,
    /// What gives points their colour.
    pub colour: ColourBy,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether points are dense in the whole view, see [`crate::inputs::density::DENSE_PX`].
    pub is_dense: bool,
    /// Whether pixels that show one point are smoothed.
    pub smooths: bool,
    /// Whether planes are told from depths where there are no normals.
    pub fits_planes: bool,
    /// Whether points crowd, see [`crate::inputs::density::CROWDED_PX`].
    pub is_crowded: bool,
    /// Whether differences of exposure between scans are evened out; the colour plane's spare bytes then tell scans apart.
    pub evens_exposure: bool,
}

/// What a frame takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FramePlan {
    /// Its passes in their order.
    pub passes: PassList,
    /// Whether the colour plane is read.
    pub reads_colours: bool,
    /// Whether the normal plane is read.
    pub reads_normals: bool,
    /// Whether pixels carry normals on their way to the picture.
    pub carries_normals: bool,
    /// Whether points are dropped by their normals while projecting.
    pub culls_back_faces: bool,
    /// Whether points are dropped that a filter has marked.
    pub hides_points: bool,
    /// Whether splats are clipped at lines, whose plane is read.
    pub clips: bool,
    /// Whether splats have their own shapes, whose plane is read.
    pub tangents: bool,
    /// Whether the highlight is lit, which needs the direction to the eye.
    pub shines: bool,
    /// Whether pixels find a surface above level 0 of the pyramid.
    pub has_pyramid: bool,
    /// Whether pixels of surfaces take a part of what is interpolated there ([`crate::passes::push`]): where that is asked, points
    /// do not crowd and colours are no names.
    pub smooths: bool,
    /// What a frame draws beyond the picture on each side, pixels ([`crate::picture::margin`]); 0 while no view is known.
    pub margin_px: u32,
    /// What gives points their colour, as the shaders number it.
    colour: u32,
    /// Which words of the points that won are fetched: positions, colours, normals.
    pub(crate) fetches: [bool; 3],
}

/// A pipeline and the values of its constants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Variant {
    /// The shader: folder and file.
    pub shader: &'static str,
    /// Its `override` constants.
    pub constants: Vec<(&'static str, u32)>,
}

impl FramePlan {
    /// The plan of a scene that is looked at.
    pub fn of(has: &SceneHas, asked: &Asked) -> Self {
        use Pass::{Antialias, Average, Blend, Exposure, FillHoles, FitPlanes, Gather, Place};
        use Pass::{Project, Pull, Push, Resolve, Shade, Silhouette, SmoothDepth};
        let has_surface = asked.method != Method::Points;
        let has_pyramid = asked.method == Method::PullPush && !asked.is_dense;
        let carries_normals = has.normals && has_surface;
        let tells = asked.fits_planes && has_pyramid && !has.normals;
        let passes = match asked.method {
            Method::Points => PassList::of(&[Project, Resolve].map(|pass| (pass, true))),
            Method::PullPush => PassList::of(&[
                (Project, true),
                (FitPlanes, tells),
                (Gather, true),
                (Average, asked.is_crowded),
                (
                    Exposure,
                    asked.evens_exposure && has.colour_plane && asked.colour == ColourBy::Rgb,
                ),
                (Pull, has_pyramid),
                (Push, has_pyramid),
                (FillHoles, true),
                (Silhouette, true),
                (SmoothDepth, !has.normals),
                (Shade, true),
                (Antialias, true),
            ]),
            Method::Ewa => PassList::of(&[
                (Place, true),
                (Blend, true),
                (SmoothDepth, !has.normals),
                (Shade, true),
                (Antialias, true),
            ]),
        };
        let culls_back_faces = has.oriented_normals && has.normals;
        let fetches_normals = carries_normals || (has.normals && asked.colour == ColourBy::Normal);
        Self {
            passes,
            reads_colours: has.colour_plane && asked.colour.reads_plane(),
            reads_normals: fetches_normals || culls_back_faces,
            carries_normals,
            culls_back_faces,
            hides_points: has.hidden_points,
            // The kept side of a line is told by the splat's normal.
            clips: has.clip_lines && carries_normals && asked.method == Method::Ewa,
            // They lie in the plane of the normal.
            tangents: has.tangents && carries_normals && asked.method == Method::Ewa,
            shines: asked.shines && has_surface,
            has_pyramid,
            smooths: has_pyramid && asked.smooths && !asked.is_crowded && !asked.colour.names(),
            margin_px: 0,
            colour: asked.colour.number(),
            fetches: [
                has_surface || matches!(asked.colour, ColourBy::Elevation(_)),
                has.colour_plane && asked.colour.reads_plane(),
                fetches_normals,
            ],
        }
    }

    /// The plan of a frame, wherever its planes lie.
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
        let is_dense = method == Method::PullPush
            && frame.skips_push
            && frame.octree.is_some_and(|o| is_dense(frame.view, frame.lattice, o, nodes()));
        let drawn = frame.draws.iter().map(|draw| (draw.entry, draw.node, draw.prefix));
        let is_crowded = method == Method::PullPush
            && frame.averages
            && is_crowded(frame.view, frame.lattice, frame.octree, drawn);
        let Frame { shines, smooths, fits_planes, evens_exposure, .. } = *frame;
        let asked = Asked {
            method,
            colour,
            shines,
            is_dense,
            smooths,
            fits_planes,
            is_crowded,
            evens_exposure,
        };
        let plan = Self::of(&has, &asked);
        let margin_px = if plan.has_pyramid { frame.view.margin_px } else { 0 };
        Self { margin_px, ..plan }
    }

    /// The planes that are told or read in this frame.
    pub fn planes(&self) -> Planes {
        match (self.carries_normals, self.passes.contains(&Pass::FitPlanes)) {
            (true, _) => Planes::Normals,
            (false, true) => Planes::Fitted,
            (false, false) => Planes::None,
        }
    }

    /// Whether the points of a pixel's front surface are averaged.
    pub fn averages(&self) -> bool {
        self.passes.contains(&Pass::Average)
    }

    /// The same where one point wins a pixel, however many share it.
    pub fn without_averages(self) -> Self {
        Self { passes: self.passes.without(Pass::Average), ..self }
    }

    /// Whether differences of exposure between scans are evened out.
    pub fn evens_exposure(&self) -> bool {
        self.passes.contains(&Pass::Exposure)
    }

    /// The same with exposures as they are.
    pub fn without_exposure(self) -> Self {
        Self { passes: self.passes.without(Pass::Exposure), ..self }
    }

    /// Whether colours and normals are read point by point to be averaged.
    pub(crate) fn averages_read(&self) -> [bool; 2] {
        let [_, colours, normals] = self.fetches;
        [colours, normals].map(|reads| reads && self.averages())
    }

    /// Constants of the pass that adds points up.
    pub fn average_constants(&self) -> [(&'static str, u32); 5] {
        let [culls, hides] = self.project_constants();
        let [normals, colour] = self.colour_constants();
        [culls, hides, normals, ("COLOURS", u32::from(self.fetches[1])), colour]
    }

    /// Constants of the pass that projects, by compute or by primitives.
    pub fn project_constants(&self) -> [(&'static str, u32); 2] {
        let flags = [self.culls_back_faces, self.hides_points].map(u32::from);
        [("CULLS_BACK_FACES", flags[0]), ("HIDES_POINTS", flags[1])]
    }

    /// Words of the points that won which are fetched: positions, colours, normals.
    pub fn fetch_constants(&self) -> [(&'static str, u32); 3] {
        let flags = self.fetches.map(u32::from);
        [("GEOMETRY", flags[0]), ("COLOURS", flags[1]), ("NORMALS", flags[2])]
    }

    /// Constants of the pass that makes the pyramid's pixels of words.
    pub fn gather_constants(&self) -> [(&'static str, u32); 3] {
        let [normals, colour] = self.colour_constants();
        [normals, ("PLANES", u32::from(self.planes() != Planes::None)), colour]
    }

    /// Constants of the pass that makes pixels of words.
    pub fn colour_constants(&self) -> [(&'static str, u32); 2] {
        [("NORMALS", u32::from(self.carries_normals)), ("COLOUR", self.colour)]
    }

    /// The pipelines of a frame on a GPU, in the order of the passes.
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
                let crowded = ("CROWDED", u32::from(self.averages()));
                vec![variant("fit_planes/nearest", &[]), variant("fit_planes/fit", &[crowded])]
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
            Pass::Resolve => vec![
                variant("gather/fetch", &self.fetch_constants()),
                variant("resolve", &self.colour_constants()[1..]),
            ],
            Pass::Shade => {
                vec![variant("shade", &[normals, ("SHINES", u32::from(self.shines))])]
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
                vec![
                    variant("gather/fetch", &self.fetch_constants()),
                    variant("ewa/place", &[normals, colour, hides, clips, tangents]),
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
                vec![variant("smooth_depth/radius", &[]), variant("smooth_depth/smooth", &[])]
            }
            other => vec![variant(other.name(), &[normals])],
        };
        self.passes.iter().flat_map(of).collect()
    }
}

#[cfg(test)]
mod tests;
