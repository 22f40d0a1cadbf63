//! Perspective-accurate EWA splatting (`zwicker2004`): each point is a disc on its tangent plane,
//! drawn with the exact shape of its projection, filtered against aliasing, and blended with its
//! neighbours by Gaussian weights. `mapping.rs` has the equations, `splat.rs` computes the record
//! of a splat and `ellipses.rs` eight of them, `clip.rs` has clip lines, `shape.rs` ellipses in
//! space, `place.rs` sorts splats into tiles, `blend.rs` draws tiles.
//!
//! The paper uses Q''' as the inverse of a variance (section 4.4) and as a variance (section 6),
//! and equation 3 prints the inverse of its amplitude. Here R' = Q'''^-1, the filter is (R' + H)^-1
//! and the amplitude |R'|^(1/2), which numerical convolution confirms (`tests/ewa.rs`). Reasons are
//! in `docs/design/splats.md`.

pub(crate) mod blend;
pub mod clip;
pub(crate) mod cover;
pub(crate) mod ellipses;
pub(crate) mod gauss;
pub mod mapping;
pub(crate) mod normals;
pub(crate) mod place;
pub mod planes;
pub(crate) mod shape;
pub mod splat;
pub(crate) mod sums;
pub(crate) mod tiles;

pub use blend::Passes;

use crate::frame::Frame;
use crate::inputs::camera::Camera;
use crate::inputs::lookup::{DrawList, Lookup};
use crate::passes::fit_planes::FittedPlanes;
use crate::plan::FramePlan;
use blend::Blend;
use clip::Clipping;
use esker_points::Grain;
use gauss::Falloff;
use glam::Vec2;
use place::Placer;
use planes::Planes;
use splat::Lens;
use tiles::{SplatRun, Tiles};

/// How splats are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Standard deviations from the centre of a kernel to its end, 0.5 to 2. The end lies at the
    /// drawn radius, so a greater cutoff makes narrower kernels, not larger ones.
    pub cutoff: f32,
    /// Cutoff radius over the drawn radius, which is the spacing of the points. Discs on a square
    /// grid cover the plane from 0.71 on.
    pub radius_factor: f32,
    /// Whether splats are low-pass filtered; the variance of the filter is a square pixel.
    pub lowpass: bool,
    /// Number of passes.
    pub passes: Passes,
}

impl Default for Options {
    fn default() -> Self {
        Self { cutoff: 1.5, radius_factor: 1.2, lowpass: true, passes: Passes::Three }
    }
}

/// The renderer of splats, which keeps its memory from frame to frame.
#[derive(Debug, Default)]
pub struct Ewa {
    /// How splats are drawn.
    pub options: Options,
    shapes: shape::ShapeTable,
    /// Colours and normals of the last picture, to be shaded.
    pub planes: Planes,
    runs: Vec<SplatRun>,
}

/// Numbers of splats of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Splats in the picture.
    pub drawn: u64,
    /// Splats that could not be evaluated, since the eye lies in their plane.
    pub dropped: u64,
}

impl Ewa {
    /// Makes splats of the points of a frame and sorts them into tiles. Points without normals are
    /// tilted as the planes in `fitted`.
    pub fn place(
        &mut self,
        frame: &Frame<'_>,
        camera: &Camera,
        list: &DrawList,
        lookup: &Lookup<'_>,
        plan: &FramePlan,
        fitted: Option<&FittedPlanes>,
    ) -> Counts {
        let [width, height] = camera.size.map(|s| s as usize);
        let options = self.options.within_bounds();
        let lens = Lens {
            focal_px: camera.focal_px,
            centre_px: Vec2::from_array(camera.centre_px),
            origin_px: Vec2::from_array(camera.origin_px),
            size: Vec2::new(width as f32, height as f32),
            near: camera.near,
            lowpass: if options.lowpass { options.cutoff * options.cutoff } else { 0.0 },
        };
        let radius_factor = options.radius_factor;
        let has_normals = plan.carries_normals;
        let grain = Grain::new(frame.lattice.scale);
        let clipping = plan.clips.then_some(Clipping { camera, grain });
        let shapes = &self.shapes;
        let placer = Placer {
            frame,
            camera,
            list,
            lookup,
            lens,
            radius_factor,
            has_normals,
            fitted,
            shapes,
            clipping,
        };
        placer.place(Tiles::new(width, height), &mut self.runs);
        Counts {
            drawn: self.runs.iter().map(|r| r.count() as u64).sum(),
            dropped: self.runs.iter().map(|r| r.dropped).sum(),
        }
    }

    /// Draws the placed splats, with normals or without, and writes their depths to `depth`.
    /// Returns the number of pixels covered.
    pub fn draw(&mut self, camera: &Camera, has_normals: bool, depth: &mut [f32]) -> u64 {
        let options = self.options.within_bounds();
        let falloff = Falloff::new(options.cutoff);
        let Self { planes, runs, .. } = self;
        planes.fit(camera.size.map(|s| s as usize), has_normals);
        Blend { runs, falloff, passes: options.passes, camera }.draw(planes, depth)
    }
}

impl Options {
    /// Clamps the cutoff to the range that the approximation of the weights is made for.
    pub(crate) fn within_bounds(self) -> Self {
        let (least, greatest) = (*gauss::CUTOFF.start(), *gauss::CUTOFF.end());
        Self { cutoff: self.cutoff.clamp(least, greatest), ..self }
    }
}
