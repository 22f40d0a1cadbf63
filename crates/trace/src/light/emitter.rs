//! Surfaces of the scene that emit, sampled as lights. In: the list of a scene. Out: light from a
//! point chosen in proportion to emitted power, so that emission is direct light (`bauszat2011`,
//! section 3.1).

use super::lamp::Arrival;
use crate::scene::{AreaLight, Shape};
use glam::Vec3;

/// Emitting surfaces with the running sum of their power.
#[derive(Clone, Debug, Default)]
pub(crate) struct Emitters {
    list: Vec<AreaLight>,
    /// Power of all surfaces up to and with each; `f64`, since there may be millions.
    sums: Vec<f64>,
}

impl Emitters {
    /// The surfaces of `list` that emit a finite power.
    pub(crate) fn new(list: &[AreaLight]) -> Self {
        let mut emitters = Self::default();
        let mut sum = 0.0;
        for light in list {
            let power = f64::from(light.area * light.radiance.element_sum());
            if power.is_finite() && power > 0.0 {
                sum += power;
                emitters.list.push(*light);
                emitters.sums.push(sum);
            }
        }
        emitters
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&*self.list) + size_of_val(&*self.sums)
    }

    /// Light that arrives at `from` from a point of one surface.
    pub(crate) fn sample(&self, from: Vec3, u: [f32; 2], least: f32) -> Option<Arrival> {
        let total = *self.sums.last()?;
        let target = f64::from(u[0]) * total;
        let i = self.sums.partition_point(|&sum| sum <= target).min(self.list.len() - 1);
        let light = &self.list[i];
        let before = if i == 0 { 0.0 } else { self.sums[i - 1] };
        let power = self.sums[i] - before;
        // The rest of the number that chose the surface is uniform again.
        let rest = ((target - before) / power).clamp(0.0, 1.0 - 1e-7) as f32;
        let point = light.point([rest, u[1]], from);
        let normal = light.normal(from);
        let towards = point - from;
        let cos = towards.normalize_or_zero().dot(normal).abs();
        let squared = towards.length_squared().max(least * least);
        // Rays to a splat end where those that leave it start, two radii in front of it: else its
        // neighbours, which overlap it, would block them.
        let lift = match light.shape {
            Shape::Disc { radius, .. } => radius * 2.0,
            Shape::Triangle(_) => 0.0,
        };
        let side = if towards.dot(normal) > 0.0 { -normal } else { normal };
        let area = light.area * (total / power) as f32;
        Some(Arrival {
            direction: towards.try_normalize()?,
            target: Some(point + side * lift),
            normal_irradiance: light.radiance * (area * cos / squared),
        })
    }
}
