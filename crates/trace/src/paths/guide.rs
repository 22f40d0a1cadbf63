//! Guide rays: the first ray of each pixel goes through its centre (`bauszat2011`, section 3.2).
//! In: a camera. Out: what each sees, which guides the filter and is where indirect light is
//! estimated.

use super::direct::World;
use super::stats::Stats;
use super::surface::Surface;
use super::surfaces::Surfaces;
use crate::camera::Camera;
use crate::ray::Ray;
use glam::Vec3;

/// What a ray from the eye sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seen {
    pub surface: Surface,
    /// Eye depth; infinite if nothing is hit.
    pub depth: f32,
}

impl Seen {
    pub(crate) const NOTHING: Self = Self {
        surface: Surface {
            point: Vec3::ZERO,
            normal: Vec3::ZERO,
            albedo: Vec3::ZERO,
            emission: Vec3::ZERO,
            lift: 0.0,
            is_back: false,
        },
        depth: f32::INFINITY,
    };

    pub(crate) fn is_hit(&self) -> bool {
        self.depth < f32::INFINITY
    }

    /// Whether it reflects light by its Lambert term: lights and black surfaces do not, and take no
    /// part in the filter.
    pub(crate) fn receives(&self) -> bool {
        self.surface.albedo != Vec3::ZERO
    }
}

impl<S: Surfaces> World<'_, S> {
    /// What a ray from the eye sees: a surface, an area light, or nothing.
    pub(crate) fn see(&self, camera: &Camera, ray: &Ray, stats: &mut Stats) -> Seen {
        stats.eye_rays += 1;
        let hit = self.scene.seen(ray);
        let distance = hit.map_or(f32::INFINITY, |hit| hit.distance);
        let light = self.lights.meet(ray.origin, ray.direction);
        let surface = match (light, hit) {
            (Some((at, radiance)), _) if at < distance => Surface {
                point: ray.at(at),
                normal: -ray.direction,
                emission: radiance,
                ..Surface::default()
            },
            (_, Some(hit)) => Surface::of(ray, &hit, self.matte()),
            _ => return Seen::NOTHING,
        };
        let depth = camera.depth(surface.point);
        if depth.is_finite() { Seen { surface, depth } } else { Seen::NOTHING }
    }
}

/// Half width of a pixel at an eye depth.
pub(crate) fn footprint(camera: &Camera, depth: f32) -> f32 {
    0.5 * depth / camera.focal_px
}
