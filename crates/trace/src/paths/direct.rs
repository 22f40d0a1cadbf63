//! Direct light: what arrives at a surface from lamps and emitting surfaces, by shadow rays
//! (`bauszat2011`, section 3.1). In: a surface. Out: incident light, and its glossy reflection.

use super::gloss::Gloss;
use super::sequence::Sample;
use super::stats::Stats;
use super::surface::Surface;
use super::surfaces::Surfaces;
use crate::light::{Arrival, Emitters, PreparedLights};
use crate::ray::Ray;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// Dimensions of the numbers for lights: one a light.
pub(crate) const LIGHT_DIMENSION: u32 = 16;
/// Share of the distance to a light at which shadow rays end, so that surfaces at the light do not
/// block it: above the rounding of `f32`.
pub(crate) const SHADOW_REACH: f32 = 1.0 - 1e-4;

/// All that rays meet, and how they are followed.
#[derive(Clone, Copy)]
pub(crate) struct World<'a, S> {
    pub scene: &'a S,
    pub lights: &'a PreparedLights,
    pub emitters: &'a Emitters,
    pub gloss: Option<Gloss>,
    pub bounces: u32,
    pub shadow_log2: u32,
}

/// Light that a surface receives from some lights.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Received {
    /// Irradiance over pi: what a white Lambert surface reflects.
    pub diffuse: Vec3,
    /// Radiance of the glossy reflection to the eye.
    pub glossy: Vec3,
}

/// Which lights are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    All,
    /// Those without extent.
    Sharp,
    /// Those with some extent.
    Soft,
}

impl<S: Surfaces> World<'_, S> {
    /// Share of light that is left for the Lambert term.
    pub(crate) fn matte(&self) -> f32 {
        self.gloss.map_or(1.0, |gloss| 1.0 - gloss.reflectance)
    }

    /// Number of lights; all emitting surfaces count as one.
    fn sources(&self) -> usize {
        self.lights.lamps().len() + usize::from(!self.emitters.is_empty())
    }

    fn is_soft(&self, source: usize) -> bool {
        self.lights.lamps().get(source).is_none_or(|lamp| lamp.is_soft())
    }

    fn arrival(&self, source: usize, surface: &Surface, u: [f32; 2]) -> Option<Arrival> {
        let (point, least) = (surface.point, surface.lift);
        let arrival = match self.lights.lamps().get(source) {
            Some(lamp) => lamp.sample(point, u, least),
            None => self.emitters.sample(point, u, least),
        }?;
        (arrival.direction.dot(surface.normal) > 0.0).then_some(arrival)
    }

    /// What the surface receives of an arrival if nothing is between.
    fn unshadowed(&self, surface: &Surface, to_eye: Vec3, arrival: &Arrival) -> Received {
        let cos = arrival.direction.dot(surface.normal);
        let glossy = self
            .gloss
            .map_or(0.0, |gloss| gloss.reflected(surface.normal, to_eye, arrival.direction));
        Received {
            diffuse: arrival.normal_irradiance * (cos * FRAC_1_PI),
            glossy: arrival.normal_irradiance * glossy,
        }
    }

    fn is_visible(&self, surface: &Surface, arrival: &Arrival, stats: &mut Stats) -> bool {
        stats.shadow_rays += 1;
        let start = surface.start();
        let ray = match arrival.target.map(|target| target - start) {
            Some(towards) => {
                let reach = towards.length() * SHADOW_REACH;
                Ray { origin: start, direction: towards.normalize_or(arrival.direction), reach }
            }
            None => Ray::new(start, arrival.direction),
        };
        !self.scene.is_blocked(&ray)
    }

    /// Light from all lights of a kind at a surface that the eye sees; the second value is without
    /// shadows. Lights of some extent get `2^shadow_log2` rays each.
    pub(crate) fn direct(
        &self,
        surface: &Surface,
        to_eye: Vec3,
        kind: Kind,
        sample: &Sample,
        stats: &mut Stats,
    ) -> [Received; 2] {
        let mut sums = [Received::default(); 2];
        for source in 0..self.sources() {
            let is_soft = self.is_soft(source);
            if kind == Kind::Sharp && is_soft || kind == Kind::Soft && !is_soft {
                continue;
            }
            let log2 = if is_soft { self.shadow_log2 } else { 0 };
            let share = 1.0 / (1u32 << log2) as f32;
            for part in 0..1 << log2 {
                let u = match is_soft {
                    true => sample.part(LIGHT_DIMENSION + source as u32, part, log2),
                    false => [0.5; 2],
                };
                let Some(arrival) = self.arrival(source, surface, u) else { continue };
                let received = self.unshadowed(surface, to_eye, &arrival);
                sums[1].add(&received, share);
                if self.is_visible(surface, &arrival, stats) {
                    sums[0].add(&received, share);
                }
            }
        }
        sums
    }

    /// Radiance that a surface reflects to `to_eye`, by a ray to one light, chosen in proportion to
    /// what each would add without shadow. `dimension` is the first of two or more that are free.
    pub(crate) fn reflected_of_one(
        &self,
        surface: &Surface,
        to_eye: Vec3,
        sample: &Sample,
        dimension: u32,
        stats: &mut Stats,
    ) -> Vec3 {
        let sources = self.sources();
        let mut choice = if sources > 1 { sample.pair(dimension)[0] } else { 0.0 };
        let (mut total, mut chosen) = (0.0, None);
        for source in 0..sources {
            let u = match self.is_soft(source) {
                true => sample.pair(dimension + 1 + source as u32),
                false => [0.5; 2],
            };
            let Some(arrival) = self.arrival(source, surface, u) else { continue };
            let received = self.unshadowed(surface, to_eye, &arrival);
            let radiance = surface.albedo * received.diffuse + received.glossy;
            let weight = radiance.element_sum();
            if weight.is_nan() || weight <= 0.0 {
                continue;
            }
            total += weight;
            // The number that decided is uniform again within the part that it fell into.
            let share = weight / total;
            if choice < share || chosen.is_none() {
                choice = (choice / share).min(1.0 - f32::EPSILON);
                chosen = Some((arrival, radiance, weight));
            } else {
                choice = (choice - share) / (1.0 - share);
            }
        }
        match chosen {
            Some((arrival, radiance, weight)) if self.is_visible(surface, &arrival, stats) => {
                radiance * (total / weight)
            }
            _ => Vec3::ZERO,
        }
    }
}

impl Received {
    fn add(&mut self, other: &Self, share: f32) {
        self.diffuse += other.diffuse * share;
        self.glossy += other.glossy * share;
    }
}
