//! Combination of a picture: indirect light is filtered before it is multiplied by the albedo,
//! looked up by all samples, and added to direct light (`bauszat2011`, figure 1). In: a frame. Out:
//! the lit picture.

use super::band::Band;
use super::frame::{Frame, milliseconds};
use super::options::Options;
use crate::filter::{FilterKind, Halves, Settings, filter};
use crate::image::Image;
use glam::Vec3;
use std::time::Instant;

/// Radius of the filter of visibility, pixels, at most: shadows are sharper than indirect light.
const VISIBILITY_RADIUS: usize = 8;

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

impl Frame {
    /// The picture of the samples so far.
    pub(crate) fn resolve(&mut self, options: &Options) -> LitImage {
        let began = Instant::now();
        let lookup = self.filtered(options);
        let soft = self.filtered_soft(options);
        self.stats.filter_ms = milliseconds(began);
        let began = Instant::now();
        let indirect = self.image(|band, i| self.looked_up(&lookup, band, i) + own(band, i));
        let direct = self.image(|band, i| {
            let looked_up = soft.as_ref().map_or(Vec3::ZERO, |soft| self.looked_up(soft, band, i));
            band.direct[i] * share(band) + looked_up
        });
        let mut radiance = direct.clone();
        for (plane, other) in radiance.planes.iter_mut().zip(&indirect.planes) {
            plane.iter_mut().zip(other).for_each(|(sum, value)| *sum += value);
        }
        let covered = self
            .bands
            .iter()
            .flat_map(|band| band.covered.iter().map(|&covered| covered as f32 * share(band)));
        let coverage = covered.collect();
        let depth = self.guides.iter().map(|seen| seen.depth).collect();
        self.stats.resolve_ms = milliseconds(began);
        LitImage { radiance, direct, indirect, depth, coverage }
    }

    /// Unfiltered incident indirect light.
    pub(crate) fn noisy(&self) -> Image<3> {
        let light = self.incident();
        let width = self.camera.width;
        self.image(|band, i| light[band.top * width + i].light)
    }

    /// Filtered incident indirect light.
    fn filtered(&self, options: &Options) -> Image<3> {
        let noisy = self.noisy();
        if options.filter.kind == FilterKind::None {
            return noisy;
        }
        let guides = self.filter_guides();
        let filtered = filter(&noisy, &guides, self.samples().max(1), &options.filter);
        if !options.converges || self.samples() < 2 {
            return filtered;
        }
        let half = |k: usize| {
            self.image(|band, i| {
                let samples = (band.paths + 1 - k as u32) / 2;
                band.halves[k][i] / samples.max(1) as f32
            })
        };
        Halves { a: half(0), b: half(1) }.mix(&filtered, &guides.is_hit)
    }

    /// Direct light of lights of some extent: without shadows, times the filtered share of it that
    /// shadows leave. `None` if visibility is not filtered.
    fn filtered_soft(&self, options: &Options) -> Option<Image<3>> {
        if !options.filters_visibility || options.gloss.is_some() {
            return None;
        }
        let visibility = self.image(|band, i| {
            let [shadowed, full] = [0, 1].map(|k| band.soft[k][i].element_sum());
            Vec3::splat(if full > 0.0 { shadowed / full } else { 1.0 })
        });
        let radius = options.filter.radius.map_or(VISIBILITY_RADIUS, |r| r.min(VISIBILITY_RADIUS));
        let mut settings = Settings { radius: Some(radius), ..options.filter.clone() };
        if settings.kind == FilterKind::Nested {
            // Its radii are fixed, and the greater one is too wide for shadows.
            settings = Settings { kind: FilterKind::Guided, is_noise_scaled: true, ..settings };
        }
        let visibility = match settings.kind {
            FilterKind::None => visibility,
            _ => filter(&visibility, &self.filter_guides(), self.samples().max(1), &settings),
        };
        let width = self.camera.width;
        Some(self.image(|band, i| {
            let full = band.soft[1][i] / band.paths.max(1) as f32;
            full * visibility.planes[0][band.top * width + i].clamp(0.0, 1.0)
        }))
    }

    /// Mean over the samples of albedo times the light that each looks up.
    fn looked_up(&self, light: &Image<3>, band: &Band, i: usize) -> Vec3 {
        let width = self.camera.width;
        let at = |index: usize| Vec3::from(light.planes.each_ref().map(|plane| plane[index]));
        let index = band.top * width + i;
        if band.links.is_empty() {
            return if band.samples > 0 {
                self.guides[index].surface.albedo * at(index)
            } else {
                Vec3::ZERO
            };
        }
        let mut sum = Vec3::ZERO;
        for (slot, albedo) in band.links[i].iter().enumerate() {
            if *albedo != Vec3::ZERO {
                sum += *albedo * at(index + slot % 3 + slot / 3 * width - width - 1);
            }
        }
        sum * share(band)
    }
}

/// One over the number of samples.
fn share(band: &Band) -> f32 {
    1.0 / band.samples.max(1) as f32
}

fn own(band: &Band, i: usize) -> Vec3 {
    band.own[i] * share(band)
}
