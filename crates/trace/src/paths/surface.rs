//! Places on surfaces that are lit. In: a ray and its hit. Out: the point, and where rays leave it.

use crate::ray::{Hit, Ray};
use glam::Vec3;

/// A place on a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Surface {
    pub point: Vec3,
    /// Unit normal, turned to where the surface was seen from.
    pub normal: Vec3,
    /// Lambert albedo; black where the values of the hit were not finite.
    pub albedo: Vec3,
    pub emission: Vec3,
    /// Distance along the normal at which rays that leave the surface start.
    pub lift: f32,
    /// Whether the stored normal points the other way: its back was seen.
    pub is_back: bool,
}

impl Surface {
    /// The place that `ray` hit. `matte` is the share of light left for the Lambert term.
    pub(crate) fn of(ray: &Ray, hit: &Hit, matte: f32) -> Self {
        let clean =
            |value: Vec3| if value.is_finite() { value.max(Vec3::ZERO) } else { Vec3::ZERO };
        Self {
            point: ray.at(hit.distance),
            normal: hit.normal,
            albedo: clean(hit.albedo).min(Vec3::ONE) * matte,
            emission: clean(hit.emission),
            lift: hit.lift,
            is_back: hit.is_back,
        }
    }

    /// Start of rays that leave the surface.
    pub(crate) fn start(&self) -> Vec3 {
        self.point + self.normal * self.lift
    }
}
