//! Surfaces of the scene that shine and are sampled as lights: discs and triangles. In: the list of
//! a scene. Out: a point chosen in proportion to emitted power, so that emission is direct light
//! (`bauszat2011`, section 3.1).

use super::lamp::Arrival;
use glam::Vec3;
use std::f32::consts::PI;

/// A surface that shines on both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Emitter {
    /// A splat.
    Disc {
        /// Centre.
        centre: Vec3,
        /// Unit normal.
        normal: Vec3,
        /// Radius.
        radius: f32,
        /// Share of the disc's area that it stands for: discs of a scan overlap.
        share: f32,
        /// Radiance.
        radiance: Vec3,
    },
    /// A triangle.
    Triangle {
        /// Corners.
        corners: [Vec3; 3],
        /// Radiance.
        radiance: Vec3,
    },
}

impl Emitter {
    /// Area that counts.
    fn area(&self) -> f32 {
        match *self {
            Self::Disc { radius, share, .. } => PI * radius * radius * share,
            Self::Triangle { corners: [a, b, c], .. } => (b - a).cross(c - a).length() * 0.5,
        }
    }

    fn radiance(&self) -> Vec3 {
        match *self {
            Self::Disc { radiance, .. } | Self::Triangle { radiance, .. } => radiance,
        }
    }

    /// Point by two numbers in [0, 1), the normal there, and how far in front of it rays end.
    fn point(&self, u: [f32; 2]) -> (Vec3, Vec3, f32) {
        match *self {
            Self::Disc { centre, normal, radius, .. } => {
                let (x, y) = normal.any_orthonormal_pair();
                let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
                let r = radius * u[0].sqrt();
                // Rays end where those that leave the disc start: two radii in front of it.
                (centre + (x * cos + y * sin) * r, normal, radius * 2.0)
            }
            Self::Triangle { corners: [a, b, c], .. } => {
                let s = u[0].sqrt();
                let point = a * (1.0 - s) + b * (s * (1.0 - u[1])) + c * (s * u[1]);
                (point, (b - a).cross(c - a).normalize_or_zero(), 0.0)
            }
        }
    }
}

/// Emitters with the running sum of their power.
#[derive(Clone, Debug, Default)]
pub(crate) struct Emitters {
    list: Vec<Emitter>,
    /// Power of all emitters up to and with each; `f64`, since lists may be of millions.
    sums: Vec<f64>,
}

impl Emitters {
    pub(crate) fn new(list: &[Emitter]) -> Self {
        let mut emitters = Self::default();
        let mut sum = 0.0;
        for emitter in list {
            let power = f64::from(emitter.area() * emitter.radiance().element_sum());
            if power.is_finite() && power > 0.0 {
                sum += power;
                emitters.list.push(*emitter);
                emitters.sums.push(sum);
            }
        }
        emitters
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Light that arrives at `from` from a point of one emitter.
    pub(crate) fn sample(&self, from: Vec3, u: [f32; 2], least: f32) -> Option<Arrival> {
        let total = *self.sums.last()?;
        let target = f64::from(u[0]) * total;
        let i = self.sums.partition_point(|&sum| sum <= target).min(self.list.len() - 1);
        let emitter = &self.list[i];
        let before = if i == 0 { 0.0 } else { self.sums[i - 1] };
        let power = self.sums[i] - before;
        // The rest of the number that chose the emitter is uniform again.
        let rest = ((target - before) / power).clamp(0.0, 1.0 - 1e-7) as f32;
        let (point, normal, lift) = emitter.point([rest, u[1]]);
        let towards = point - from;
        let side = if towards.dot(normal) > 0.0 { -normal } else { normal };
        let towards = point + side * lift - from;
        let distance = towards.length();
        let direction = towards.try_normalize()?;
        let cos = direction.dot(normal).abs();
        let squared = (distance * distance).max(least * least);
        let area = emitter.area() * (total / power) as f32;
        Some(Arrival {
            direction,
            distance,
            normal_irradiance: emitter.radiance() * (area * cos / squared),
        })
    }
}
