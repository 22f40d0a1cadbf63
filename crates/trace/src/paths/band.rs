//! Sums of the samples of a band of rows. Bands are the tasks of the threads: each writes its own
//! pixels, so that a picture has the same bits for any number of threads. A band goes through its
//! pixels in squares, so that neighbouring rays meet the same nodes.

use super::batches::Batches;
use super::direct::{Kind, World};
use super::guide::Seen;
use super::lookup::most_similar;
use super::sequence::{Sample, Sampler};
use super::stats::Stats;
use super::surfaces::Surfaces;
use crate::camera::Camera;
use glam::Vec3;

/// Rows of a band, and columns of the squares that it is traced in.
pub(crate) const BAND_ROWS: usize = 16;

/// Dimension of the numbers for places within a pixel.
pub(crate) const PIXEL_DIMENSION: u32 = 0;

/// Neighbouring guides that a pixel's samples looked up: the sum of the samples' albedos for each
/// of the 3 x 3 pixels around it. With the sums, the filter can change without a new trace.
pub(crate) type Links = [Vec3; 9];

/// Sums of the samples of a band.
#[derive(Clone, Debug, Default)]
pub(crate) struct Band {
    /// First row.
    pub top: usize,
    /// Samples of which indirect light is summed.
    pub paths: u32,
    /// Samples of which direct light is summed.
    pub samples: u32,
    /// Incident indirect light of even and odd samples.
    pub halves: [Vec<Vec3>; 2],
    /// Incident direct light of lights of some extent with and without shadows, if visibility is
    /// filtered.
    pub soft: [Vec<Vec3>; 2],
    /// Reflected direct light, emission and the sky behind.
    pub direct: Vec<Vec3>,
    /// Reflected indirect light that is not looked up: glossy, and of samples without a guide.
    pub own: Vec<Vec3>,
    /// Samples that hit a surface.
    pub covered: Vec<u32>,
    /// Absent while all samples are the guides' own.
    pub links: Vec<Links>,
    pub stats: Stats,
}

/// What all bands share.
#[derive(Clone, Copy)]
pub(crate) struct Pass<'a, S> {
    pub world: World<'a, S>,
    pub camera: &'a Camera,
    pub guides: &'a [Seen],
    pub sampler: Sampler,
    pub number: u32,
    pub filters_visibility: bool,
    pub shows_sky: bool,
}

impl<'a, S: Surfaces> Pass<'a, S> {
    fn sample(&self, x: usize, y: usize) -> Sample {
        self.sampler.sample(x as u32, y as u32, self.number)
    }
}

/// Numbers of sample `index` of all pixels.
pub(crate) fn sampler_of(
    batches: &Batches,
    index: u32,
    make: impl Fn(u32, u32) -> Sampler,
) -> (Sampler, u32) {
    let place = batches.place(index);
    (make(place.batch, place.log2_samples), place.number)
}

impl Band {
    /// A band of `rows` rows of `width` pixels without samples.
    pub(crate) fn new(top: usize, rows: usize, width: usize, filters_visibility: bool) -> Self {
        let zeros = || vec![Vec3::ZERO; rows * width];
        let soft = if filters_visibility { [zeros(), zeros()] } else { Default::default() };
        Self {
            top,
            halves: [zeros(), zeros()],
            soft,
            direct: zeros(),
            own: zeros(),
            covered: vec![0; rows * width],
            ..Self::default()
        }
    }

    /// Bytes of the sums.
    pub(crate) fn bytes(&self) -> usize {
        let planes = self.halves.iter().chain(&self.soft).chain([&self.direct, &self.own]);
        planes.map(|plane| size_of_val(&**plane)).sum::<usize>()
            + size_of_val(&*self.covered)
            + size_of_val(&*self.links)
    }

    /// Adds a sample of incident indirect light at each guide.
    pub(crate) fn add_paths<S: Surfaces>(&mut self, pass: &Pass<'_, S>) {
        let half = (self.paths & 1) as usize;
        let width = pass.camera.width;
        self.for_pixels(width, |band, i, [x, y]| {
            let seen = &pass.guides[y * width + x];
            if !seen.receives() {
                return;
            }
            let (surface, sample) = (&seen.surface, pass.sample(x, y));
            let light = pass.world.incident(surface, &sample, &mut band.stats);
            band.halves[half][i] += light;
            if pass.filters_visibility {
                let to_eye = (pass.camera.eye - surface.point).normalize_or(surface.normal);
                let sums = pass.world.direct(surface, to_eye, Kind::Soft, &sample, &mut band.stats);
                for (plane, received) in band.soft.iter_mut().zip(sums) {
                    plane[i] += finite(received.diffuse);
                }
            }
        });
        self.paths += 1;
    }

    /// Adds a sample of what the eye sees of each pixel: direct light, and which guides its
    /// indirect light is looked up from. The first goes through the centre.
    pub(crate) fn add_seen<S: Surfaces>(&mut self, pass: &Pass<'_, S>) {
        let width = pass.camera.width;
        let is_first = self.samples == 0;
        if !is_first && self.links.is_empty() {
            let own = |i: usize| {
                let mut links = [Vec3::ZERO; 9];
                links[4] = pass.guides[self.top * width + i].surface.albedo;
                links
            };
            self.links = (0..self.direct.len()).map(own).collect();
        }
        self.for_pixels(width, |band, i, [x, y]| {
            let sample = pass.sample(x, y);
            let guide = &pass.guides[y * width + x];
            if is_first {
                let ray = pass.camera.ray(x as f32 + 0.5, y as f32 + 0.5);
                band.add_sample(pass, i, guide, ray.direction, &sample);
                return;
            }
            let [u, v] = sample.pair(PIXEL_DIMENSION);
            let at = [x as f32 + u, y as f32 + v];
            let ray = pass.camera.ray(at[0], at[1]);
            let seen = pass.world.see(pass.camera, &ray, &mut band.stats);
            band.add_sample(pass, i, &seen, ray.direction, &sample);
            if !seen.receives() {
                return;
            }
            match most_similar(pass.camera, pass.guides, [x, y], at, &seen) {
                Some(found) => band.links[i][found.slot] += seen.surface.albedo,
                None => band.add_without_guide(pass, i, &seen, &sample),
            }
        });
        self.samples += 1;
    }

    /// Adds direct light of a sample, and its glossy reflection.
    fn add_sample<S: Surfaces>(
        &mut self,
        pass: &Pass<'_, S>,
        i: usize,
        seen: &Seen,
        direction: Vec3,
        sample: &Sample,
    ) {
        if !seen.is_hit() {
            if pass.shows_sky {
                self.direct[i] += finite(pass.world.lights.sky(direction));
            }
            return;
        }
        let kind = if pass.filters_visibility { Kind::Sharp } else { Kind::All };
        let (surface, to_eye) = (&seen.surface, -direction);
        self.covered[i] += 1;
        self.direct[i] += surface.emission;
        if seen.receives() || pass.world.gloss.is_some() {
            let [light, _] = pass.world.direct(surface, to_eye, kind, sample, &mut self.stats);
            self.direct[i] += finite(surface.albedo * light.diffuse + light.glossy);
            self.own[i] += pass.world.mirrored(surface, to_eye, sample, &mut self.stats);
        }
    }

    /// Adds indirect light of a sample that no guide fits (figure 3b), and the soft light that is
    /// looked up with it.
    fn add_without_guide<S: Surfaces>(
        &mut self,
        pass: &Pass<'_, S>,
        i: usize,
        seen: &Seen,
        sample: &Sample,
    ) {
        self.stats.without_guide += 1;
        let surface = &seen.surface;
        let light = pass.world.incident(surface, sample, &mut self.stats);
        self.own[i] += surface.albedo * light;
        if pass.filters_visibility {
            let to_eye = (pass.camera.eye - surface.point).normalize_or(surface.normal);
            let [soft, _] = pass.world.direct(surface, to_eye, Kind::Soft, sample, &mut self.stats);
            self.direct[i] += finite(surface.albedo * soft.diffuse);
        }
    }

    /// Calls `each` with the index in the band and the place of all pixels, square by square.
    fn for_pixels(&mut self, width: usize, mut each: impl FnMut(&mut Self, usize, [usize; 2])) {
        let rows = self.direct.len() / width.max(1);
        for left in (0..width).step_by(BAND_ROWS) {
            for row in 0..rows {
                for x in left..(left + BAND_ROWS).min(width) {
                    each(self, row * width + x, [x, self.top + row]);
                }
            }
        }
    }
}

fn finite(value: Vec3) -> Vec3 {
    if value.is_finite() { value } else { Vec3::ZERO }
}
