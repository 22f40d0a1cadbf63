//! Indirect light: paths that leave a visible surface (`bauszat2011`, section 3.1). In: a surface.
//! Out: an estimate of the mean radiance that arrives, weighted by the cosine, from the sky and
//! from what other surfaces reflect. The albedo of the visible surface is left out, so that the
//! filter keeps textures.

use super::direct::World;
use super::directions::cosine;
use super::sequence::Sample;
use super::stats::Stats;
use super::surface::Surface;
use super::surfaces::Surfaces;
use crate::ray::{Hit, Ray};
use glam::Vec3;

/// First dimension of the numbers of bounces, and dimensions of each: lights have one each.
pub(crate) const BOUNCE_DIMENSION: u32 = 1024;
/// Bounces from which on paths end at random: enough that few paths of usual scenes get there.
pub(crate) const ROULETTE_BOUNCE: u32 = 8;
/// Distance in lifts within which a ray may hit the surface that it left: layers of several scans
/// lie two lifts above each other at most, and a concave surface is met beyond.
pub(crate) const OWN_LIFTS: f32 = 4.0;
/// Cosine between stored normals above which such a hit is on the same surface.
pub(crate) const OWN_COS: f32 = 0.5;

/// Whether a ray from a surface has hit that surface. Most such hits are from behind, on a layer
/// that lies above the start, so that normals are compared as they are stored, not as turned.
fn is_own(from: &Surface, hit: &Hit) -> bool {
    let cos = hit.normal.dot(from.normal);
    let stored_cos = if hit.is_back == from.is_back { cos } else { -cos };
    hit.distance < from.lift * OWN_LIFTS && stored_cos > OWN_COS
}

impl<S: Surfaces> World<'_, S> {
    /// Incident indirect light at a surface by one path.
    pub(crate) fn incident(&self, surface: &Surface, sample: &Sample, stats: &mut Stats) -> Vec3 {
        if self.bounces == 0 {
            return Vec3::ZERO;
        }
        let direction = cosine(surface.normal, sample.pair(BOUNCE_DIMENSION));
        self.follow(surface, direction, sample, stats)
    }

    /// Glossy reflection of indirect light to the eye, by one path.
    pub(crate) fn mirrored(
        &self,
        surface: &Surface,
        to_eye: Vec3,
        sample: &Sample,
        stats: &mut Stats,
    ) -> Vec3 {
        let Some(gloss) = self.gloss.filter(|_| self.bounces > 0) else { return Vec3::ZERO };
        // The path itself takes the same dimensions as that of the Lambert term, of which only the
        // first pair must differ.
        match gloss.sample(surface.normal, to_eye, sample.pair(BOUNCE_DIMENSION - 1)) {
            Some((direction, weight)) => weight * self.follow(surface, direction, sample, stats),
            None => Vec3::ZERO,
        }
    }

    /// Radiance that arrives at a surface along `direction`, of the sky and of reflected light.
    fn follow(&self, from: &Surface, direction: Vec3, sample: &Sample, stats: &mut Stats) -> Vec3 {
        let (mut sum, mut throughput) = (Vec3::ZERO, Vec3::ONE);
        let mut from = *from;
        let mut ray = Ray::new(from.start(), direction);
        for bounce in 1..=self.bounces {
            let dimension = BOUNCE_DIMENSION * (bounce + 1);
            stats.bounce_rays += 1;
            let Some(hit) = self.scene.hit(&ray) else {
                stats.escaped += 1;
                sum += throughput * self.lights.sky(ray.direction);
                break;
            };
            stats.self_hits += u64::from(is_own(&from, &hit));
            let surface = Surface::of(&ray, &hit, self.matte());
            if self.emitters.is_empty() {
                sum += throughput * surface.emission;
            }
            let to_eye = -ray.direction;
            sum +=
                throughput * self.reflected_of_one(&surface, to_eye, sample, dimension + 2, stats);
            if bounce == self.bounces {
                break;
            }
            let Some((next, weight)) = self.scatter(&surface, to_eye, sample, dimension) else {
                break;
            };
            throughput *= weight;
            if bounce >= ROULETTE_BOUNCE {
                let survival = throughput.max_element().min(1.0);
                if sample.pair(dimension + 1)[1] >= survival {
                    break;
                }
                throughput /= survival;
            }
            ray = Ray::new(surface.start(), next);
            from = surface;
        }
        if sum.is_finite() { sum } else { Vec3::ZERO }
    }

    /// Next direction of a path and its weight: one of both lobes, by what each reflects.
    fn scatter(
        &self,
        surface: &Surface,
        to_eye: Vec3,
        sample: &Sample,
        dimension: u32,
    ) -> Option<(Vec3, Vec3)> {
        let u = sample.pair(dimension);
        let Some(gloss) = self.gloss else {
            return Some((cosine(surface.normal, u), surface.albedo));
        };
        let diffuse = surface.albedo.max_element();
        let chance = (gloss.reflectance / (gloss.reflectance + diffuse).max(1e-6)).max(0.05);
        if sample.pair(dimension + 1)[0] < chance {
            let (direction, weight) = gloss.sample(surface.normal, to_eye, u)?;
            Some((direction, Vec3::splat(weight / chance)))
        } else {
            Some((cosine(surface.normal, u), surface.albedo / (1.0 - chance)))
        }
    }
}
