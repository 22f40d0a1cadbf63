//! Accumulates samples of a picture and combines them (`bauszat2011`, figure 1). In: a scene,
//! lights, a camera. Out: linear radiance, filtered.

use crate::camera::Camera;
use crate::filter::Guides;
use crate::image::Image;
use crate::light::PreparedLights;
use crate::paths::{Frame, LitImage, Options, Stats, Surfaces};

/// A progressive path tracer of one picture.
#[derive(Debug, Default)]
pub struct Tracer {
    options: Options,
    frame: Option<Frame>,
}

impl Tracer {
    /// A tracer without samples.
    pub fn new(options: Options) -> Self {
        Self { options, frame: None }
    }

    /// Its options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the options. Samples are kept if only the filter, convergence or reprojection
    /// changes.
    pub fn set_options(&mut self, options: Options) {
        if !options.keeps_samples_of(&self.options) {
            self.frame = None;
        }
        self.options = options;
    }

    /// Adds `samples` samples to each pixel. If the scene (by its epoch), the lights or the camera
    /// differ from those of the last call, the picture begins afresh. If the lights are the same,
    /// indirect light of the last picture is used again where it fits, until there are enough new
    /// samples. `should_stop` is asked often: if it returns true, the call returns false soon, and
    /// the next call goes on where this one stopped.
    ///
    /// `lights` and `camera` must be relative to the origin of the scene. If that changes, call
    /// [`Tracer::clear`] first.
    pub fn trace(
        &mut self,
        scene: &impl Surfaces,
        scene_epoch: u64,
        lights: &PreparedLights,
        camera: &Camera,
        samples: u32,
        should_stop: &(dyn Fn() -> bool + Sync),
    ) -> bool {
        if camera.pixels() == 0 {
            self.frame = None;
            return true;
        }
        let is_same = self.frame.as_ref().is_some_and(|frame| {
            frame.scene_epoch == scene_epoch && frame.camera == *camera && frame.lights == *lights
        });
        let options = &self.options;
        if !is_same {
            let last = self.frame.take().and_then(Frame::into_last);
            let last = last.filter(|last| options.reprojects && last.lights == *lights);
            let frame = Frame::new(scene, scene_epoch, lights, camera, options, samples, last);
            self.frame = Some(frame);
        }
        let Some(frame) = &mut self.frame else { return false };
        frame.add_guides(scene, options, should_stop)
            && (0..samples).all(|_| frame.add_sample(scene, options, should_stop))
    }

    /// Samples that each pixel has.
    pub fn samples(&self) -> u32 {
        self.frame.as_ref().map_or(0, Frame::samples)
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.frame = None;
    }

    /// Counts and times since the picture was begun.
    pub fn stats(&self) -> Stats {
        self.frame.as_ref().map(Frame::stats).unwrap_or_default()
    }

    /// Bytes that the samples take.
    pub fn bytes(&self) -> usize {
        self.frame.as_ref().map_or(0, Frame::bytes)
    }

    /// The picture of the samples so far. Empty before the first call of [`Tracer::trace`].
    pub fn resolve(&mut self) -> LitImage {
        self.frame.as_mut().map(|frame| frame.resolve(&self.options)).unwrap_or_default()
    }

    /// Unfiltered incident indirect light, which the filter gets: mean radiance over directions
    /// weighted by their cosine.
    pub fn incident(&self) -> Image<3> {
        self.frame.as_ref().map(Frame::noisy).unwrap_or_default()
    }

    /// Guides of the filter.
    pub fn guides(&self) -> Guides {
        self.frame.as_ref().map(Frame::filter_guides).unwrap_or_default()
    }
}
