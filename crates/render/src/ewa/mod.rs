//! Perspective-accurate EWA splatting (zwicker2004): each point is a disc on its tangent plane, drawn with the
//! exact shape of its projection, filtered against aliasing, and blended with its neighbours by Gaussian
//! weights. [`mapping`] has the equations, [`splat`] makes a splat's record, [`ellipses`] eight of them, [`clip`] the lines
//! at which they end, [`place`] sorts splats into tiles, [`blend`] draws these.
//!
//! Two remarks on the paper. It uses Q''' as the inverse of a variance (section 4.4) and as a variance
//! (section 6); meant is R' = Q'''^-1, with the filter (Q'''^-1 + H)^-1. And equation 3 prints the inverse of
//! its amplitude, which is |R'|^(1/2). Both follow from numerical convolution, in the tests.

pub mod blend;
pub mod clip;
pub mod cover;
pub mod ellipses;
pub mod gauss;
pub mod mapping;
pub mod place;
pub mod planes;
pub mod shape;
pub mod splat;
pub mod sums;
pub mod tiles;

pub use blend::Passes;

use crate::frame::Frame;
use crate::inputs::camera::Camera;
use crate::inputs::lookup::{DrawList, Lookup};
use crate::plan::FramePlan;
use blend::Blend;
use clip::Clipping;
use esker_points::Grain;
use gauss::Falloff;
use glam::Vec2;
use place::Placing;
use planes::Planes;
use splat::Lens;
use tiles::{Run, Tiles};

/// How splats are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Standard deviations from a kernel's middle to its end; within [`gauss::CUTOFF`]. The end is where the
    /// drawn radius says, so a greater cutoff makes narrower kernels, not larger ones.
    pub cutoff: f32,
    /// Cutoff radius over the drawn radius. That is the spacing of the points: discs on a square grid cover the
    /// plane from 0.71 on.
    pub radius_factor: f32,
    /// Whether the low-pass filter is added (its variance is a square pixel).
    pub lowpass: bool,
    /// How many passes.
    pub passes: Passes,
}

impl Default for Options {
    fn default() -> Self {
        Self { cutoff: 1.5, radius_factor: 1.2, lowpass: true, passes: Passes::Three }
    }
}

/// The method and the memory that it keeps from frame to frame.
#[derive(Debug, Default)]
pub struct Ewa {
    /// How splats are drawn.
    pub options: Options,
    shapes: shape::Codes,
    /// What is shaded of the last picture.
    pub planes: Planes,
    runs: Vec<Run>,
}

/// What a frame's splats came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Splats in the picture.
    pub drawn: u64,
    /// Splats that could not be evaluated: the eye lies in their plane.
    pub dropped: u64,
}

impl Ewa {
    /// Makes splats of the frame's points, in tiles.
    pub fn place(
        &mut self,
        frame: &Frame<'_>,
        camera: &Camera,
        list: &DrawList,
        lookup: &Lookup<'_>,
        plan: &FramePlan,
    ) -> Counts {
        let [width, height] = camera.size.map(|s| s as usize);
        let options = self.options.within_bounds();
        let lens = Lens {
            focal_px: camera.focal_px,
            centre_px: Vec2::from_array(camera.centre_px),
            size: Vec2::new(width as f32, height as f32),
            near: camera.near,
            lowpass: if options.lowpass { options.cutoff * options.cutoff } else { 0.0 },
        };
        let radius_factor = options.radius_factor;
        let has_normals = plan.carries_normals;
        let grain = Grain::new(frame.lattice.scale);
        let clipping = plan.clips.then_some(Clipping { camera, grain });
        let shapes = &self.shapes;
        let placing = Placing {
            frame,
            camera,
            list,
            lookup,
            lens,
            radius_factor,
            has_normals,
            shapes,
            clipping,
        };
        placing.place(Tiles::new(width, height), &mut self.runs);
        Counts {
            drawn: self.runs.iter().map(|r| r.count() as u64).sum(),
            dropped: self.runs.iter().map(|r| r.dropped).sum(),
        }
    }

    /// Draws the splats placed to [`Ewa::planes`], with normals or without, and their depths to `depth`. Returns the
    /// number of pixels covered.
    pub fn draw(&mut self, camera: &Camera, has_normals: bool, depth: &mut [f32]) -> u64 {
        let options = self.options.within_bounds();
        let falloff = Falloff::new(options.cutoff);
        let Self { planes, runs, .. } = self;
        planes.fit(camera.size.map(|s| s as usize), has_normals);
        Blend { runs, falloff, passes: options.passes, camera }.draw(planes, depth)
    }
}

impl Options {
    /// The same, with a cutoff that the weights are made for.
    pub(crate) fn within_bounds(self) -> Self {
        let (least, greatest) = (*gauss::CUTOFF.start(), *gauss::CUTOFF.end());
        Self { cutoff: self.cutoff.clamp(least, greatest), ..self }
    }
}
