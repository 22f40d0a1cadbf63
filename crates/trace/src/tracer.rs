//! Accumulates samples of a picture and combines them (`bauszat2011`, figure 1). In: a scene,
//! lights, a camera. Out: linear radiance, filtered.

use crate::camera::Camera;
use crate::filter::Guides;
use crate::image::Image;
use crate::light::PreparedLights;
use crate::paths::{Options, Stats, Surfaces};

/// A lit picture: linear light, row by row, the top row first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LitImage {
    /// Radiance: the sum of direct and indirect light.
    pub radiance: Image<3>,
    /// The part by light that arrives from lights at the visible surface, and emission (figure 2a).
    pub direct: Image<3>,
    /// The part by light from the sky and from other surfaces (figure 2b).
    pub indirect: Image<3>,
    /// Eye depth at pixel centres, the file's unit; infinite where nothing is hit.
    pub depth: Vec<f32>,
    /// Share of the samples of each pixel that hit a surface.
    pub coverage: Vec<f32>,
}

/// A progressive path tracer of one picture.
#[derive(Debug)]
pub struct Tracer {
    options: Options,
    stats: Stats,
}

impl Tracer {
    /// A tracer without samples.
    pub fn new(options: Options) -> Self {
        Self { options, stats: Stats::default() }
    }

    /// Its options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the options. Samples are kept if only the filter or convergence changes.
    pub fn set_options(&mut self, options: Options) {
        self.options = options;
    }

    /// Adds `samples` samples to each pixel. If the scene (by its epoch), the lights or the camera
    /// differ from those of the last call, the picture begins afresh; after a move of the camera,
    /// indirect light of the last picture is used again where it fits, until there are enough new
    /// samples. `should_stop` is asked often: if it returns true, the call returns false soon, and
    /// the next call goes on where this one stopped.
    ///
    /// `lights` and `camera` must be relative to the origin of the scene.
    pub fn trace(
        &mut self,
        _scene: &impl Surfaces,
        _scene_epoch: u64,
        _lights: &PreparedLights,
        _camera: &Camera,
        _samples: u32,
        _should_stop: &(dyn Fn() -> bool + Sync),
    ) -> bool {
        true
    }

    /// Samples of each pixel that the picture has.
    pub fn samples(&self) -> u32 {
        0
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {}

    /// Counts and times since the picture was begun.
    pub fn stats(&self) -> Stats {
        self.stats
    }

    /// Bytes that the samples take.
    pub fn bytes(&self) -> usize {
        0
    }

    /// The picture of the samples so far. Empty before the first call of [`Tracer::trace`].
    pub fn resolve(&mut self) -> LitImage {
        LitImage::default()
    }

    /// Unfiltered incident indirect light: mean radiance over directions weighted by their cosine.
    /// What the filter gets.
    pub fn incident(&self) -> Image<3> {
        Image::new(0, 0)
    }

    /// Guides of the filter.
    pub fn guides(&self) -> Guides {
        Guides::default()
    }
}
