//! What a frame is made from, and what comes out: the view, the nodes to draw with the planes that
//! they bring, how to colour them, and the picture with its counts and times. Plain borrowed data.

use crate::inputs::colour::ColourBy;
use crate::plan::Pass;
use esker_lod::{CompactOctree, View};
use esker_points::{AttrType, Lattice, Node};
use std::time::Duration;

/// Most pixels on a side of a picture.
pub const SIDE_MAX: u32 = 16_384;
/// Most pixels of a picture: the passes hold about 90 bytes a pixel.
pub const PIXELS_MAX: u64 = 1 << 26;

/// One node of the cut, with the planes that the frame needs: their bytes, or their place on a GPU. Planes shorter than the prefix end the
/// prefix; any bits in them are drawn harmlessly.
#[derive(Clone, Copy, Debug)]
pub struct DrawNode<'a, P = &'a [u8]> {
    /// Its record.
    pub node: &'a Node,
    /// Its place in the list of drawn nodes that the frame's octree was made from.
    pub entry: usize,
    /// How many of its points are drawn, from the first.
    pub prefix: usize,
    /// Hot positions, [`esker_points::quant::HOT_POSITION_BYTES`] a point.
    pub position: P,
    /// Dropped bits of the positions, where they are at hand ([`esker_points::quant::residual_bytes`]
    /// a point); without them points are drawn at mid-step.
    pub residual: Option<P>,
    /// What colours come from.
    pub colour: ColourPlane<P>,
    /// Octahedral normals, two little-endian `i16` a point.
    pub normal: Option<P>,
    /// Clip lines of splats, [`esker_points::clip::CLIP_BYTES`] a point.
    pub clip: Option<P>,
    /// Shapes of splats, [`esker_points::tangents::TANGENT_BYTES`] a point; discs without them.
    pub tangents: Option<P>,
}

/// The plane that a node's colours come from.
#[derive(Clone, Copy, Debug)]
pub enum ColourPlane<P> {
    /// None: the plain colour, or what needs no plane (elevation, depth ...).
    None,
    /// Red, green, blue (sRGB) and an unused byte a point.
    Rgba(P),
    /// The last bytes of the positions, numbers of [`ColourBy::Codes`] ([`esker_points::quant::INDEX_AT`]).
    Indexed,
    /// One value a point, little-endian; coloured as [`ColourBy`] says.
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
    /// One pixel a point, colours as they are.
    Points,
    /// Surfaces closed by pull-push interpolation and lit (marroquim2007).
    #[default]
    PullPush,
    /// Splats of exact perspective shape, filtered and blended (zwicker2004).
    Ewa,
}

/// What lies behind the points; sRGB, alpha last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Background {
    /// One colour; alpha 0 gives a cut-out.
    Plain([u8; 4]),
    /// From the top row to the bottom row.
    Gradient([u8; 3], [u8; 3]),
}

impl Default for Background {
    fn default() -> Self {
        Self::Gradient([30, 34, 41], [92, 99, 108])
    }
}

/// Everything that a frame is drawn from.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a, P = &'a [u8]> {
    /// The camera and the size of the picture. Its margin is drawn where surfaces are filled ([`crate::picture::margin`]).
    pub view: &'a View,
    /// The grid of all coordinates.
    pub lattice: &'a Lattice,
    /// The cut. At most 2^32 - 1 points; what goes beyond is not drawn and shows in the counts.
    pub draws: &'a [DrawNode<'a, P>],
    /// The cells of the cut with their effective spacings, which size the points; without it points
    /// have their stored radii.
    pub octree: Option<&'a CompactOctree>,
    /// How points become a picture.
    pub method: Method,
    /// What gives points their colour.
    pub colour: ColourBy,
    /// Whether points whose normal looks away are dropped (marroquim2007 section 3.1). Scans whose
    /// normals have no consistent side need it off; normals are then turned towards the viewer.
    pub cull_back_faces: bool,
    /// Whether points are left out whose positions are marked
    /// ([`esker_points::quant::HIDDEN_AT`]).
    pub hides_points: bool,
    /// Whether surfaces have highlights.
    pub shines: bool,
    /// Whether views that are dense everywhere are drawn without pull and push
    /// ([`crate::inputs::density::DENSE_PX`]).
    pub skips_push: bool,
    /// Whether the points of a pixel's front surface are averaged where points crowd
    /// ([`crate::inputs::density::CROWDED_PX`]); else one wins it.
    pub averages: bool,
    /// Whether pixels that show one point are smoothed ([`crate::passes::push`]).
    pub smooths: bool,
    /// Whether planes are told from depths where points have no normals ([`crate::passes::fit_planes`]).
    pub fits_planes: bool,
    /// Whether differences of exposure between scans are evened out ([`crate::passes::exposure`]): the spare bytes of colour planes then
    /// tell scans apart.
    pub evens_exposure: bool,
    /// What lies behind the points.
    pub background: Background,
}

/// A drawn picture.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows, the top one first.
    pub height: u32,
    /// sRGB with straight alpha, four bytes a pixel.
    pub rgba: Vec<u8>,
    /// Linear eye depth in the file's unit; infinite where nothing was drawn.
    pub depth: Vec<f32>,
    /// Counts and times.
    pub stats: Stats,
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stats {
    /// Points that went through projection.
    pub points_drawn: u64,
    /// Nodes with at least one such point.
    pub nodes_drawn: u32,
    /// Splats in the picture, of EWA splatting.
    pub splats_drawn: u64,
    /// Splats that could not be drawn: the eye lies in their plane.
    pub splats_dropped: u64,
    /// Pixels that a point itself won.
    pub pixels_projected: u64,
    /// Pixels that show a surface in the end.
    pub pixels_covered: u64,
    /// Times.
    pub stages: Stages,
}

/// Times of a frame, milliseconds: one a pass, indexed by [`Pass::ALL`], and the total.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stages {
    /// Time of each pass, in the order of [`Pass::ALL`].
    pub passes_ms: [f64; Pass::ALL.len()],
    /// Time of the whole frame, milliseconds.
    pub total_ms: f64,
}

impl Stages {
    /// Time of a pass, milliseconds.
    pub fn ms(&self, pass: Pass) -> f64 {
        self.passes_ms[pass as usize]
    }

    /// Adds to the time of a pass, milliseconds; the total stays as it is.
    pub fn add(&mut self, pass: Pass, ms: f64) {
        self.passes_ms[pass as usize] += ms;
    }

    /// Sum of the times of some passes, milliseconds.
    pub fn sum_ms(&self, passes: &[Pass]) -> f64 {
        passes.iter().map(|&pass| self.ms(pass)).sum()
    }
}

/// Milliseconds of a duration.
pub(crate) fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_pass_has_one_name_and_one_time() {
        let mut stages = Stages::default();
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
