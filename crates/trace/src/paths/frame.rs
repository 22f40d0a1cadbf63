//! A picture in progress: guides, bands of sums, and light of the last picture. In: passes over a
//! scene. Out: images of what the filter takes and of the sums.

use super::band::{BAND_ROWS, Band, Pass, sampler_of};
use super::batches::Batches;
use super::direct::World;
use super::guide::Seen;
use super::history::{HISTORY_SAMPLES, Last, Past, reproject};
use super::options::Options;
use super::sequence::{Sampler, Sequence};
use super::stats::Stats;
use super::surfaces::Surfaces;
use crate::camera::Camera;
use crate::filter::Guides;
use crate::image::Image;
use crate::light::{Emitters, PreparedLights};
use glam::Vec3;
use rayon::prelude::*;
use std::time::Instant;

/// Asks whether to stop; threads of the pool ask it.
pub(crate) type ShouldStop<'a> = &'a (dyn Fn() -> bool + Sync);

/// A picture in progress.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    pub camera: Camera,
    pub scene_epoch: u64,
    pub lights: PreparedLights,
    pub emitters: Emitters,
    pub guides: Vec<Seen>,
    /// Columns of each band that have guides.
    guided: Vec<usize>,
    /// Picture whose light is used again once there are guides.
    last: Option<Box<Self>>,
    /// Depth that guides are divided by.
    pub diagonal: f32,
    pub bands: Vec<Band>,
    /// Light of the last picture; empty for none.
    pub past: Vec<Past>,
    batches: Batches,
    /// Counts and times apart from those of the bands.
    pub stats: Stats,
}

impl Frame {
    /// A picture without guides and samples. `last` is a picture whose light is used again.
    pub(crate) fn new<S: Surfaces>(
        scene: &S,
        scene_epoch: u64,
        lights: &PreparedLights,
        camera: &Camera,
        options: &Options,
        samples: u32,
        last: Option<Self>,
    ) -> Self {
        let (width, height) = (camera.width, camera.height);
        let bands = (0..height).step_by(BAND_ROWS).map(|top| {
            let rows = BAND_ROWS.min(height - top);
            Band::new(top, rows, width, options.filters_visibility)
        });
        let bands: Vec<Band> = bands.collect();
        let most = match options.sequence {
            Sequence::ZOrder => Sampler::log2_samples_max([width, height], options.shadow_log2()),
            Sequence::Independent => 16,
        };
        Self {
            camera: *camera,
            scene_epoch,
            lights: lights.clone(),
            emitters: Emitters::new(scene.emitters()),
            guides: vec![Seen::NOTHING; width * height],
            guided: vec![0; bands.len()],
            last: last.map(Box::new),
            diagonal: scene.diagonal(),
            bands,
            past: Vec::new(),
            batches: Batches::new(samples, most),
            stats: Stats::default(),
        }
    }

    /// Traces the guides that are missing. False if it was stopped; the next call goes on.
    pub(crate) fn add_guides<S: Surfaces>(
        &mut self,
        scene: &S,
        options: &Options,
        should_stop: ShouldStop<'_>,
    ) -> bool {
        if self.has_guides() {
            return true;
        }
        let began = Instant::now();
        let Self { lights, emitters, camera, guides, guided, .. } = self;
        let world = world(scene, lights, emitters, options);
        let width = camera.width;
        let bands = guides.par_chunks_mut((BAND_ROWS * width).max(1)).zip(guided).enumerate();
        let counts = bands.map(|(band, (seen, columns))| {
            let mut stats = Stats::default();
            while *columns < width && !should_stop() {
                let left = *columns;
                *columns = (left + BAND_ROWS).min(width);
                for row in 0..seen.len() / width {
                    for x in left..*columns {
                        let y = band * BAND_ROWS + row;
                        let ray = camera.ray(x as f32 + 0.5, y as f32 + 0.5);
                        seen[row * width + x] = world.see(camera, &ray, &mut stats);
                    }
                }
            }
            stats
        });
        for stats in counts.collect::<Vec<Stats>>() {
            self.stats += stats;
        }
        self.stats.guide_ms += milliseconds(began);
        if !self.has_guides() {
            return false;
        }
        if let Some(last) = self.last.take() {
            self.reuse(&last);
        }
        true
    }

    fn has_guides(&self) -> bool {
        self.guided.iter().all(|&columns| columns == self.camera.width)
    }

    /// The picture whose light can be used again: this one, or the last one if this one has no
    /// guides yet.
    pub(crate) fn into_last(self) -> Option<Self> {
        if self.has_guides() { Some(self) } else { self.last.map(|last| *last) }
    }

    /// Uses light of `last` again.
    fn reuse(&mut self, last: &Self) {
        let light = last.incident();
        let last = Last { camera: &last.camera, guides: &last.guides, light: &light };
        self.past = reproject(&last, &self.camera, &self.guides);
    }

    /// Samples that all pixels have.
    pub(crate) fn samples(&self) -> u32 {
        self.bands.iter().map(|band| band.samples.min(band.paths)).min().unwrap_or(0)
    }

    /// Adds one sample to the bands that have as few as any. False if it was stopped; bands that
    /// were not reached are first in the next call.
    pub(crate) fn add_sample<S: Surfaces>(
        &mut self,
        scene: &S,
        options: &Options,
        should_stop: ShouldStop<'_>,
    ) -> bool {
        let index = self.samples();
        let size = [self.camera.width, self.camera.height];
        let (sampler, number) = sampler_of(&self.batches, index, |batch, log2| {
            Sampler::new(options.sequence, options.seed, batch, log2, size)
        });
        let pass = Pass {
            world: world(scene, &self.lights, &self.emitters, options),
            camera: &self.camera,
            guides: &self.guides,
            sampler,
            number,
            filters_visibility: options.filters_visibility && options.gloss.is_none(),
            shows_sky: options.shows_sky,
        };
        // Independent numbers are hashed by the sample's own number.
        let pass = match options.sequence {
            Sequence::ZOrder => pass,
            Sequence::Independent => Pass { number: index, ..pass },
        };
        let began = Instant::now();
        let went_on = self.bands.par_iter_mut().map(|band| {
            if band.paths == index && !should_stop() {
                band.add_paths(&pass);
            }
            band.paths > index
        });
        let went_on = went_on.reduce(|| true, |a, b| a && b);
        self.stats.indirect_ms += milliseconds(began);
        let began = Instant::now();
        let finished = self.bands.par_iter_mut().map(|band| {
            if band.samples == index && band.paths > index && !should_stop() {
                band.add_seen(&pass);
            }
            band.samples > index
        });
        let finished = finished.reduce(|| true, |a, b| a && b);
        self.stats.direct_ms += milliseconds(began);
        went_on && finished
    }

    /// Counts and times of all passes.
    pub(crate) fn stats(&self) -> Stats {
        let mut sum = self.stats;
        self.bands.iter().for_each(|band| sum += band.stats);
        sum
    }

    /// Incident indirect light of each pixel, with the samples that it stands for.
    pub(crate) fn incident(&self) -> Vec<Past> {
        let rows = self.bands.par_iter().flat_map_iter(|band| {
            let start = band.top * self.camera.width;
            (0..band.direct.len()).map(move |i| {
                let sum = band.halves[0][i] + band.halves[1][i];
                let past = self.past.get(start + i).copied().unwrap_or_default();
                let (sum, samples) = past.add(sum, band.paths as f32);
                let light = if samples > 0.0 { sum / samples } else { Vec3::ZERO };
                Past { light, samples: samples.min(HISTORY_SAMPLES) }
            })
        });
        rows.collect()
    }

    /// Guides of the filter. Pixels that reflect nothing are misses to it.
    pub(crate) fn filter_guides(&self) -> Guides {
        let from = self.camera.guides_from();
        let seen = |s: &Seen| s.receives().then_some((s.surface.normal, s.depth - from));
        let surfaces: Vec<_> = self.guides.iter().map(seen).collect();
        Guides::of_surfaces(self.camera.width, self.camera.height, &surfaces, self.diagonal)
    }

    /// Image of a value of each pixel of the bands, by band and index in it.
    pub(crate) fn image(&self, value: impl Fn(&Band, usize) -> Vec3 + Sync) -> Image<3> {
        let mut image = Image::new(self.camera.width, self.camera.height);
        let size = (BAND_ROWS * image.width).max(1);
        let [red, green, blue] = &mut image.planes;
        let planes = red.par_chunks_mut(size).zip(green.par_chunks_mut(size));
        let planes = planes.zip(blue.par_chunks_mut(size));
        planes.zip(&self.bands).for_each(|(((red, green), blue), band)| {
            for (i, ((r, g), b)) in red.iter_mut().zip(green).zip(blue).enumerate() {
                [*r, *g, *b] = value(band, i).to_array();
            }
        });
        image
    }

    /// Bytes of the picture.
    pub(crate) fn bytes(&self) -> usize {
        self.bands.iter().map(Band::bytes).sum::<usize>()
            + size_of_val(&*self.guides)
            + size_of_val(&*self.past)
            + self.emitters.bytes()
            + self.last.as_ref().map_or(0, |last| last.bytes())
    }
}

fn world<'a, S: Surfaces>(
    scene: &'a S,
    lights: &'a PreparedLights,
    emitters: &'a Emitters,
    options: &Options,
) -> World<'a, S> {
    World {
        scene,
        lights,
        emitters,
        gloss: options.gloss.map(|gloss| gloss.clamped()),
        bounces: options.bounces,
        shadow_log2: options.shadow_log2(),
    }
}

pub(crate) fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
