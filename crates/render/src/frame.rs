//! Input and output of a frame: the view, the nodes to draw with their planes and the settings; the
//! picture with its counts and times. Plain data that borrows its planes.

use crate::inputs::colour::ColourBy;
use crate::pass::{Pass, PassChoice};
use esker_lod::{CompactOctree, View};
use esker_points::{AttrType, Lattice, Node};
use std::time::Duration;

/// Most pixels on a side of a picture.
pub const SIDE_MAX: u32 = 16_384;
/// Most pixels of a picture. The passes need about 90 bytes a pixel.
pub const PIXELS_MAX: u64 = 1 << 26;

/// A node of the cut with the planes that the frame needs: their bytes, or their addresses on a
/// GPU. A plane that is shorter than the prefix ends the prefix; any bits in planes are drawn
/// harmlessly.
#[derive(Clone, Copy, Debug)]
pub struct DrawNode<'a, P = &'a [u8]> {
    /// Record of the node.
    pub node: &'a Node,
    /// Index of the node in the list of drawn nodes that the octree of the frame was made from.
    pub entry: usize,
    /// Number of its points that are drawn, from the first.
    pub prefix: usize,
    /// Share of the density in its cell, 0 to 1, that the points of its ancestors have
    /// ([`esker_lod::share_above`]).
    pub above: f32,
    /// Hot positions, [`esker_points::quant::HOT_POSITION_BYTES`] a point.
    pub position: P,
    /// Bits that hot positions drop ([`esker_points::quant::residual_bytes`] a point). Without
    /// them, points are drawn in the middle of their step.
    pub residual: Option<P>,
    /// Plane that colours are computed from.
    pub colour: ColourPlane<P>,
    /// Octahedral normals, two little-endian `i16` a point.
    pub normal: Option<P>,
    /// Clip lines of splats, [`esker_points::clip::CLIP_BYTES`] a point.
    pub clip: Option<P>,
    /// Shapes of splats, [`esker_points::tangents::TANGENT_BYTES`] a point; without them splats are
    /// discs.
    pub tangents: Option<P>,
}

/// The plane that the colours of a node are computed from.
#[derive(Clone, Copy, Debug)]
pub enum ColourPlane<P> {
    /// No plane: for colours that need none (plain, elevation, depth ...).
    None,
    /// Red, green, blue (sRGB) and an unused byte a point.
    Rgba(P),
    /// The last bytes of hot positions, which are numbers of [`ColourBy::Codes`]
    /// ([`esker_points::quant::INDEX_AT`]).
    Indexed,
    /// One value a point, little-endian, mapped by [`ColourBy`].
    Scalar {
        /// The values.
        bytes: P,
        /// Their type.
        ty: AttrType,
    },
}

/// How points become a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Method {
    /// Points alone: a dot each, without lighting.
    Points,
    /// Surfaces closed by pull-push interpolation, and lit (`marroquim2007`).
    #[default]
    PullPush,
    /// Splats of exact perspective shape, filtered and blended (`zwicker2004`).
    Ewa,
}

/// How points look that are drawn alone ([`Method::Points`], [`Frame::mixes_dots`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dots {
    /// Size of the dots.
    pub size: PointSize,
    /// Strength of eye-dome lighting (`boucheny2009`); 0 for none.
    pub eye_dome: f32,
}

/// Size of round dots.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointSize {
    /// Diameter, pixels, 1 to [`POINT_SIZE_MAX`].
    Pixels(f32),
    /// Dots of points next to each other touch, but are at most 10 pixels wide.
    Adaptive,
}

/// Greatest radius of adaptive dots, pixels: points farther apart are no surface.
pub(crate) const ADAPTIVE_MAX: f32 = 5.0;

/// Greatest diameter of dots, pixels.
pub const POINT_SIZE_MAX: f32 = 64.0;

impl Default for PointSize {
    /// One pixel a point.
    fn default() -> Self {
        Self::Pixels(1.0)
    }
}

impl PointSize {
    /// Whether any dot may be wider than a pixel.
    pub fn grows(self) -> bool {
        self.radius_max() >= 1.0
    }

    /// Greatest radius of a dot, pixels. Dots with less than 1 are one pixel.
    pub(crate) fn radius_max(self) -> f32 {
        match self {
            Self::Pixels(diameter) => diameter.clamp(1.0, POINT_SIZE_MAX) / 2.0,
            Self::Adaptive => ADAPTIVE_MAX,
        }
    }
}

/// Background of a picture; sRGB, alpha last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// One colour; alpha 0 makes the background transparent.
    Plain([u8; 4]),
    /// Gradient from the top row to the bottom row.
    Gradient([u8; 3], [u8; 3]),
}

impl Default for Background {
    fn default() -> Self {
        Self::Gradient([30, 34, 41], [92, 99, 108])
    }
}

/// Everything that a frame is drawn from. [`Frame::new`] has defaults for the settings.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a, P = &'a [u8]> {
    /// The camera and the size of the picture. The margin of the view is drawn only if surfaces are
    /// filled ([`crate::picture::margin`]).
    pub view: &'a View,
    /// The grid of all coordinates.
    pub lattice: &'a Lattice,
    /// The cut. Points beyond the first 2^32 - 1 are neither drawn nor counted as drawn.
    pub draws: &'a [DrawNode<'a, P>],
    /// The cells of the cut with their effective spacings, from which radii of points follow;
    /// without it points have their stored radii.
    pub octree: Option<&'a CompactOctree>,
    /// How points become a picture.
    pub method: Method,
    /// Source of the colours.
    pub colour: ColourBy,
    /// Whether points whose normal looks away are dropped (`marroquim2007`, section 3.1). It has to
    /// be off for normals without a consistent side, which are turned towards the viewer instead.
    pub cull_back_faces: bool,
    /// Whether normals tell the front of a surface from its back. Fronts then hide the backs just
    /// behind them, and normals of backs are not reversed where they are nearly edge-on.
    pub has_fronts: bool,
    /// Whether points that a filter has marked are left out ([`esker_points::quant::HIDDEN_AT`]).
    pub hides_points: bool,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether views that are dense everywhere are drawn without pull and push
    /// ([`crate::inputs::density::DENSE_PX`]).
    pub skips_push: bool,
    /// Whether the points of the front surface of a pixel are averaged in crowded views
    /// ([`Frame::crowding`]); else a pixel shows one of them.
    pub averages: bool,
    /// How crowded the view is, 0 to 1 ([`esker_lod::crowding`]): the share of averages in pixels.
    /// `None`: 1 if most of the drawn points crowd, else 0
    /// ([`crate::inputs::density::is_crowded`]).
    pub crowding: Option<f32>,
    /// Whether pixels that show one point are smoothed ([`crate::passes::push`]).
    pub smooths: bool,
    /// Whether planes are fitted to depths if points have no normals
    /// ([`crate::passes::fit_planes`]).
    pub fits_planes: bool,
    /// Whether differences of exposure between scans are removed ([`crate::passes::exposure`]). The
    /// spare byte of a colour is then the number of its scan.
    pub evens_exposure: bool,
    /// How points look that are drawn alone.
    pub dots: Dots,
    /// Distance of adjacent points on the picture that is fine enough, pixels; 0 if all points of
    /// the cut are to be drawn. Points that are drawn alone ([`Method::Points`]) are thinned to it.
    pub target_spacing_px: f64,
    /// Whether points that are too far apart on the picture for a surface, or of no surface, are
    /// drawn as dots in the picture of surfaces ([`crate::passes::split`]). The dots are adaptive.
    pub mixes_dots: bool,
    /// Passes that are chosen otherwise than by the plan.
    pub passes: PassChoice,
    /// Background of the picture.
    pub background: Background,
}

impl<'a, P> Frame<'a, P> {
    /// A frame with the usual settings: pull-push with highlights, in one colour, on the default
    /// background; without an octree, and without dropping or hiding points.
    pub fn new(view: &'a View, lattice: &'a Lattice, draws: &'a [DrawNode<'a, P>]) -> Self {
        Self {
            view,
            lattice,
            draws,
            octree: None,
            method: Method::PullPush,
            colour: ColourBy::Plain,
            cull_back_faces: false,
            has_fronts: false,
            hides_points: false,
            shines: true,
            skips_push: true,
            averages: true,
            crowding: None,
            smooths: true,
            fits_planes: true,
            evens_exposure: false,
            dots: Dots::default(),
            target_spacing_px: 0.0,
            mixes_dots: false,
            passes: PassChoice::default(),
            background: Background::default(),
        }
    }

    /// Whether points are left out that are closer together than asked.
    pub(crate) fn thins_points(&self) -> bool {
        self.method == Method::Points && self.target_spacing_px > 0.0
    }

    /// The same frame of other nodes, or of nodes whose planes are elsewhere.
    pub fn with_draws<'b, Q>(&self, draws: &'b [DrawNode<'b, Q>]) -> Frame<'b, Q>
    where
        'a: 'b,
    {
        let Self { view, lattice, draws: _, octree, method, colour, .. } = *self;
        let Self { cull_back_faces, has_fronts, hides_points, shines, .. } = *self;
        let Self { skips_push, averages, crowding, target_spacing_px, .. } = *self;
        let Self { smooths, fits_planes, evens_exposure, dots, mixes_dots, .. } = *self;
        let Self { passes, background, .. } = *self;
        Frame {
            view,
            lattice,
            draws,
            octree,
            method,
            colour,
            cull_back_faces,
            has_fronts,
            hides_points,
            shines,
            skips_push,
            averages,
            crowding,
            smooths,
            fits_planes,
            evens_exposure,
            dots,
            target_spacing_px,
            mixes_dots,
            passes,
            background,
        }
    }
}

/// A drawn picture.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// sRGB with straight alpha, four bytes a pixel, the top row first.
    pub rgba: Vec<u8>,
    /// Linear eye depth in the unit of the file; infinite where nothing was drawn.
    pub depth: Vec<f32>,
    /// Counts and times.
    pub stats: Stats,
}

/// Counts and times of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Points that were projected.
    pub points_drawn: u64,
    /// Nodes with at least one such point.
    pub nodes_drawn: u32,
    /// Splats in the picture (EWA splatting).
    pub splats_drawn: u64,
    /// Splats that could not be evaluated, since the eye lies in their plane.
    pub splats_dropped: u64,
    /// Pixels that show a point or splat before surfaces are filled.
    pub pixels_projected: u64,
    /// Pixels of the finished picture that show a surface.
    pub pixels_covered: u64,
    /// Times of the passes.
    pub stages: PassTimes,
}

/// Times of a frame: one a pass, in the order of [`Pass::ALL`], and the total.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PassTimes {
    /// Time of each pass, milliseconds.
    pub passes_ms: [f64; Pass::ALL.len()],
    /// Time of the whole frame, milliseconds.
    pub total_ms: f64,
}

impl PassTimes {
    /// Time of a pass, milliseconds.
    pub fn ms(&self, pass: Pass) -> f64 {
        self.passes_ms[pass as usize]
    }

    /// Adds milliseconds to the time of a pass, not to the total.
    pub fn add(&mut self, pass: Pass, ms: f64) {
        self.passes_ms[pass as usize] += ms;
    }

    /// Sum of the times of some passes, milliseconds.
    pub fn sum_ms(&self, passes: &[Pass]) -> f64 {
        passes.iter().map(|&pass| self.ms(pass)).sum()
    }
}

/// Converts a duration to milliseconds.
pub(crate) fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pass_has_one_name_and_one_time() {
        let mut stages = PassTimes::default();
        for (index, &pass) in Pass::ALL.iter().enumerate() {
            assert_eq!(pass as usize, index);
            stages.add(pass, f64::from(1u32 << index));
        }
        for (index, &pass) in Pass::ALL.iter().enumerate() {
            assert_eq!(stages.ms(pass), f64::from(1u32 << index));
            assert_eq!(Pass::ALL.iter().filter(|other| other.name() == pass.name()).count(), 1);
        }
    }
}
