//! Lit frames of a session. While the view, the lights or the points change, each frame is a coarse
//! picture of one sample, so that the window follows; at rest the picture is refined, a part of a
//! sample a frame, until it has [`SAMPLES_FINAL`] samples a pixel. The scene is a copy of the
//! points, built anew when another cut arrives, so that no slot is read later. The CPU or a GPU
//! traces ([`crate::light::scene_tracer`]).

use crate::light::document::Emissive;
use crate::light::options::{lights_of, options};
use crate::light::scene::Meshes;
use crate::light::scene_tracer::{OnCpu, OnGpu, Quality, SceneTracer};
use crate::light::settings::{LightSettings, SAMPLES_FINAL};
use crate::light::status::LitStatus;
use crate::light::tone::Tones;
use anyhow::Result;
use esker_lod::View;
use esker_points::task::Silent;
use esker_render::gpu::Gpu;
use esker_render::{Frame, PassTimes, Picture, Stats};
use esker_trace::{Camera, LitImage, PreparedLights};
use glam::DVec3;
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// Time of a frame that refines a picture: the window answers ten times a second.
const FRAME_BUDGET: Duration = Duration::from_millis(90);
/// Time between two pictures that are shown while one is refined.
const SHOW_INTERVAL: Duration = Duration::from_millis(250);
/// Samples from which on a tree is refined: views that rest for a moment are not worth it.
const REFINED_FROM: u32 = 2;
/// Time of a coarse frame, milliseconds, from which its size follows.
const COARSE_MS: f64 = 70.0;
/// Factors by which the sides of coarse pictures are smaller.
const COARSER: [u32; 4] = [1, 2, 3, 4];
/// While points arrive, building scenes takes at most one part in this many of the time.
const BUILD_SHARE: u32 = 3;
/// Steps of the lattice from the origin of a scene at which `f32` still has an eighth of a step.
const NEAR_STEPS: f64 = (1 << 20) as f64;
/// Share of the way to the exposure of the new view that a frame of a moving view takes.
const EXPOSURE_STEP: f64 = 0.2;

/// What a lit picture depends on beside its scene.
#[derive(Clone, PartialEq)]
struct Seen {
    view: View,
    scene: u64,
    settings: LightSettings,
}

/// Draws lit frames, and keeps scene and samples between them.
pub(crate) struct Progressive<T> {
    tracer: T,
    scene: Option<Scene>,
    /// Number of the newest scene; pictures begin afresh with another one.
    scenes: u64,
    lights: Option<(LightSettings, PreparedLights)>,
    /// What the samples of the fine picture are of.
    seen: Option<Seen>,
    exposure: Option<f64>,
    /// Whether these samples are of what is seen.
    is_begun: bool,
    /// When the refined picture was shown last.
    shown: Option<Instant>,
    /// Milliseconds of a sample of a million pixels; 0 before the first one.
    cost_ms: f64,
    status: LitStatus,
}

/// Draws lit frames on the CPU.
pub(crate) type CpuProgressive = Progressive<OnCpu>;
/// Draws lit frames on a GPU.
pub(crate) type GpuProgressive = Progressive<OnGpu>;

/// What the newest scene was built of.
struct Scene {
    /// Place in the world that it is relative to.
    origin: DVec3,
    /// Points that shine in it.
    shining: Vec<Emissive>,
    /// Epoch of the cut.
    epoch: u64,
    built: Instant,
    took: Duration,
}

impl CpuProgressive {
    /// A drawer of lit frames with at most `splats_max` splats.
    ///
    /// # Errors
    /// If a mesh cannot be read.
    pub(crate) fn on_cpu(settings: &LightSettings, splats_max: u64) -> Result<Self> {
        let options = options(settings, &lights_of(settings));
        Ok(Self::new(OnCpu::new(Meshes::read(settings, &Silent)?, &options), splats_max))
    }
}

impl GpuProgressive {
    /// A drawer of lit frames with at most `splats_max` splats.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn on_gpu(gpu: &Gpu, settings: &LightSettings, splats_max: u64) -> Result<Self> {
        let options = options(settings, &lights_of(settings));
        Ok(Self::new(OnGpu::new(gpu, &options)?, splats_max))
    }
}

impl<T: SceneTracer> Progressive<T> {
    fn new(tracer: T, splats_max: u64) -> Self {
        Self {
            tracer,
            scene: None,
            scenes: 0,
            lights: None,
            seen: None,
            exposure: None,
            is_begun: false,
            shown: None,
            cost_ms: 0.0,
            status: LitStatus { splats_max, samples_final: SAMPLES_FINAL, ..LitStatus::default() },
        }
    }

    /// State of the last picture.
    pub(crate) fn status(&self) -> LitStatus {
        self.status
    }

    /// Whether the last picture has all its samples of the newest cut, so that the next one would
    /// be the same.
    pub(crate) fn is_converged(&self) -> bool {
        self.status.samples >= SAMPLES_FINAL
    }

    /// Draws a frame of a cut, by its epoch, whose planes are in `memory`.
    ///
    /// # Errors
    /// If a GPU fails, or does not draw such pictures.
    pub(crate) fn draw(
        &mut self,
        frame: &Frame<'_, T::Plane<'_>>,
        memory: &T::Memory<'_>,
        epoch: u64,
        settings: &LightSettings,
        picture: &mut Picture,
    ) -> Result<()> {
        let start = Instant::now();
        self.build(frame, memory, epoch, settings)?;
        let seen = Seen { view: *frame.view, scene: self.scenes, settings: settings.clone() };
        let is_same = self.seen.as_ref() == Some(&seen);
        let is_newest = self.scene.as_ref().is_some_and(|scene| scene.epoch == epoch);
        let is_at_rest = is_same && is_newest && self.status.samples >= REFINED_FROM;
        self.tracer.poll_refined(self.scenes, self.status.splats_max, is_at_rest);
        if is_same && is_newest {
            self.refine(frame, settings, picture)?;
        } else {
            self.glance(frame, settings, picture)?;
        }
        self.seen = Some(seen);
        picture.stats.stages =
            PassTimes { total_ms: start.elapsed().as_secs_f64() * 1e3, ..PassTimes::default() };
        Ok(())
    }

    /// Builds the scene of a cut, unless the last scene is too new to be replaced already.
    fn build(
        &mut self,
        frame: &Frame<'_, T::Plane<'_>>,
        memory: &T::Memory<'_>,
        epoch: u64,
        settings: &LightSettings,
    ) -> Result<()> {
        let is_moving = self.seen.as_ref().is_none_or(|seen| seen.view != *frame.view);
        let lights = lights_of(settings);
        let shines_same = self.scene.as_ref().is_some_and(|scene| scene.shining == lights.emissive);
        let keeps = self.scene.as_ref().is_some_and(|scene| {
            let is_new = scene.built.elapsed() < scene.took * BUILD_SHARE;
            shines_same && (scene.epoch == epoch || (is_moving && is_new))
        });
        if !keeps {
            let start = Instant::now();
            let origin = self.origin(frame);
            self.tracer.build(frame, memory, &lights, origin)?;
            let took = start.elapsed();
            let shining = lights.emissive.clone();
            self.scene = Some(Scene { origin, shining, epoch, built: Instant::now(), took });
            self.scenes += 1;
            self.lights = None;
        }
        let is_lit = self.lights.as_ref().is_some_and(|(of, _)| of == settings);
        if let (false, Some(scene)) = (is_lit, &self.scene) {
            if self.lights.as_ref().is_some_and(|(of, _)| of.lights != settings.lights) {
                self.exposure = None;
            }
            self.tracer.set_options(&options(settings, &lights), &lights)?;
            let prepared = esker_trace::Lights::from(lights.lights).prepare(scene.origin);
            self.lights = Some((settings.clone(), prepared));
        }
        Ok(())
    }

    /// Origin of the next scene: that of the last one while the eye stays near it, so that its
    /// light can be used again.
    fn origin<P>(&mut self, frame: &Frame<'_, P>) -> DVec3 {
        let eye = frame.view.eye;
        let step = frame.lattice.scale.iter().copied().fold(0.0, f64::max);
        let extent = step * NEAR_STEPS;
        let kept = self.scene.as_ref().map(|scene| scene.origin);
        if let Some(origin) = kept.filter(|origin| origin.distance(eye) <= extent) {
            return origin;
        }
        self.tracer.clear();
        eye
    }

    /// Draws a coarse picture of one sample.
    fn glance<P>(
        &mut self,
        frame: &Frame<'_, P>,
        settings: &LightSettings,
        picture: &mut Picture,
    ) -> Result<()> {
        let (Some(scene), Some((_, lights))) = (&self.scene, &self.lights) else { return Ok(()) };
        let pixels = f64::from(frame.view.width) * f64::from(frame.view.height);
        let fits = |by: &u32| self.cost_ms * pixels * 1e-6 <= COARSE_MS * f64::from(by * by);
        let by = COARSER.into_iter().find(fits).unwrap_or(COARSER[COARSER.len() - 1]);
        // Nothing is known of the first picture.
        let by = if self.cost_ms > 0.0 { by } else { COARSER[COARSER.len() - 1] };
        let side = |length: u32| length.div_ceil(by);
        let view =
            View { width: side(frame.view.width), height: side(frame.view.height), ..*frame.view };
        let camera = Camera::new(&view, scene.origin);
        let start = Instant::now();
        self.tracer.trace(Quality::Coarse, self.scenes, lights, &camera, &|| false)?;
        let image = self.tracer.resolve(Quality::Coarse)?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        self.cost_ms = ms / (camera.pixels() as f64 * 1e-6);
        (self.status.samples, self.is_begun) = (0, false);
        self.show(&image, by, frame, settings, picture);
        Ok(())
    }

    /// Refines the picture.
    fn refine<P>(
        &mut self,
        frame: &Frame<'_, P>,
        settings: &LightSettings,
        picture: &mut Picture,
    ) -> Result<()> {
        let (Some(scene), Some((_, lights))) = (&self.scene, &self.lights) else { return Ok(()) };
        let camera = Camera::new(frame.view, scene.origin);
        if self.status.samples >= SAMPLES_FINAL {
            return Ok(());
        }
        let start = Instant::now();
        // Until it is called, the tracer has the samples of another picture.
        while start.elapsed() < FRAME_BUDGET
            && (!self.is_begun || self.tracer.samples() < SAMPLES_FINAL)
        {
            self.is_begun = true;
            let is_over = || start.elapsed() >= FRAME_BUDGET;
            self.tracer.trace(Quality::Fine, self.scenes, lights, &camera, &is_over)?;
        }
        let samples = self.tracer.samples();
        // Filtering takes as long as a sample, so that not every sample is shown.
        let is_due = samples == SAMPLES_FINAL
            || self.status.samples == 0
            || self.shown.is_none_or(|shown| shown.elapsed() > SHOW_INTERVAL);
        if samples > 0 && samples != self.status.samples && is_due {
            let image = self.tracer.resolve(Quality::Fine)?;
            if image.coverage.is_empty() {
                return Ok(());
            }
            self.status.samples = samples;
            self.shown = Some(Instant::now());
            self.show(&image, 1, frame, settings, picture);
        }
        Ok(())
    }

    /// Shows light whose sides are smaller by a factor.
    fn show<P>(
        &mut self,
        image: &LitImage,
        by: u32,
        frame: &Frame<'_, P>,
        settings: &LightSettings,
        picture: &mut Picture,
    ) {
        let [width, height] = [frame.view.width, frame.view.height];
        let tones = Tones {
            width: image.radiance.width,
            radiance: &image.radiance.planes,
            coverage: &image.coverage,
            exposure: 1.0,
            background: (!lights_of(settings).have_sky()).then_some(frame.background),
        };
        let exposure = settings.exposure.unwrap_or_else(|| match self.exposure {
            Some(last) => {
                // That of the finished picture depends on nothing that was seen before.
                let refined = f64::from(self.status.samples) / f64::from(SAMPLES_FINAL);
                let step = if self.status.samples > 0 { refined.min(1.0) } else { EXPOSURE_STEP };
                if step == 1.0 {
                    tones.chosen_exposure()
                } else {
                    last * (tones.chosen_exposure() / last).powf(step)
                }
            }
            None => tones.chosen_exposure(),
        });
        self.exposure = Some(exposure);
        let mut rgba = vec![0; image.coverage.len() * 4];
        Tones { exposure, ..tones }.encode(&mut rgba);
        let covered = image.coverage.iter().filter(|&&covered| covered > 0.0).count();
        [picture.width, picture.height] = [width, height];
        enlarge(&rgba, &image.depth, image.radiance.width, by as usize, picture);
        let held = self.tracer.held();
        picture.stats = Stats {
            points_drawn: held.splats as u64,
            nodes_drawn: frame.draws.iter().filter(|draw| draw.prefix > 0).count() as u32,
            splats_drawn: (held.splats - held.dropped) as u64,
            splats_dropped: held.dropped as u64,
            pixels_projected: covered as u64 * u64::from(by * by),
            pixels_covered: covered as u64 * u64::from(by * by),
            stages: PassTimes::default(),
        };
        self.status.splats = held.splats;
        self.status.exposure = exposure;
        self.status.bytes = held.bytes;
    }
}

/// Enlarges a picture of `small_width` pixels a row to the size of `picture`, by a factor: colours
/// are interpolated, depths are those of the pixels.
fn enlarge(rgba: &[u8], depth: &[f32], small_width: usize, by: usize, picture: &mut Picture) {
    let [width, height] = [picture.width as usize, picture.height as usize];
    let small_height = depth.len() / small_width.max(1);
    picture.rgba.resize(width * height * 4, 0);
    picture.depth.resize(width * height, 0.0);
    // The two pixels beside a place along an axis, and the share of the second one.
    let beside = |at: usize, side: usize| {
        let place = ((at as f32 + 0.5) / by as f32 - 0.5).max(0.0);
        let first = (place as usize).min(side - 1);
        (first, (first + 1).min(side - 1), place - first as f32)
    };
    let rows = picture.rgba.par_chunks_exact_mut(width * 4);
    rows.zip(picture.depth.par_chunks_exact_mut(width)).enumerate().for_each(
        |(y, (row, depths))| {
            let (top, bottom, down) = beside(y, small_height);
            for x in 0..width {
                depths[x] = depth[y / by * small_width + x / by];
                let (left, right, across) = beside(x, small_width);
                for c in 0..4 {
                    let at = |x: usize, y: usize| f32::from(rgba[(y * small_width + x) * 4 + c]);
                    let mix = |y| at(left, y) + (at(right, y) - at(left, y)) * across;
                    row[x * 4 + c] = (mix(top) + (mix(bottom) - mix(top)) * down).round() as u8;
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn enlarged_pixels_are_interpolated_and_a_factor_of_one_changes_nothing() {
        let rgba: Vec<u8> = (0..4).flat_map(|i| [i * 80, 0, 0, 255]).collect();
        let enlarged = |by: u32, side: u32| {
            let mut picture = Picture { width: side, height: side, ..Picture::default() };
            enlarge(&rgba, &[0.0, 1.0, 2.0, 3.0], 2, by as usize, &mut picture);
            assert!(picture.rgba.iter().skip(3).step_by(4).all(|&alpha| alpha == 255));
            (picture.rgba.iter().step_by(4).copied().collect::<Vec<_>>(), picture.depth)
        };
        assert_eq!(enlarged(1, 2), (vec![0, 80, 160, 240], vec![0.0, 1.0, 2.0, 3.0]));
        // The last row and column of squares are cut off.
        let (reds, depths) = enlarged(2, 3);
        assert_eq!(depths, [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 2.0, 3.0]);
        assert_eq!(reds, [0, 20, 60, 40, 60, 100, 120, 140, 180]);
    }
}
