//! Discs, the shape of splats.

use crate::accel::bounds::Bounds;
use crate::ray::Ray;
use glam::Vec3;

/// A disc; without a normal it faces each ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Disc {
    pub(crate) centre: Vec3,
    /// Unit length, or zero.
    pub(crate) normal: Vec3,
    pub(crate) radius: f32,
}

impl Disc {
    /// Box of the disc.
    #[inline(always)]
    pub(crate) fn bounds(&self) -> Bounds {
        let n = self.normal;
        let half = (Vec3::ONE - n * n).max(Vec3::ZERO).map(f32::sqrt) * self.radius;
        Bounds { min: self.centre - half, max: self.centre + half }
    }

    /// Distance at which a ray meets the disc, and the weight of the disc there: 1 at its centre, 0
    /// at its rim.
    pub(crate) fn meet(&self, ray: &Ray) -> Option<(f32, f32)> {
        let to = self.centre - ray.origin;
        let n = if self.normal == Vec3::ZERO { ray.direction } else { self.normal };
        let t = n.dot(to) / n.dot(ray.direction);
        let off = (ray.direction * t - to).length_squared() / (self.radius * self.radius);
        (t > 0.0 && off < 1.0).then_some((t, 1.0 - off))
    }
}
