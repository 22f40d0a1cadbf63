//! Sampling of one light: the direction and the strength of what arrives at a point. In: a point
//! and two numbers in [0, 1). Out: an [`Arrival`], without the cosine and the shadow of the
//! receiver.

use glam::Vec3;
use std::f32::consts::PI;

/// Light that arrives at a point from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arrival {
    /// Direction to the light, unit length.
    pub direction: Vec3,
    /// Where shadow rays to the light end; `None` for the sun.
    pub target: Option<Vec3>,
    /// Irradiance of a surface that faces the light.
    pub normal_irradiance: Vec3,
}

/// A light relative to the origin of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Lamp {
    Sun {
        direction: Vec3,
        x: Vec3,
        y: Vec3,
        tan_radius: f32,
        irradiance: Vec3,
    },
    Point {
        position: Vec3,
        intensity: Vec3,
    },
    Spot {
        position: Vec3,
        axis: Vec3,
        intensity: Vec3,
        cos_inner: f32,
        cos_outer: f32,
    },
    Area {
        corner: Vec3,
        edges: [Vec3; 2],
        normal: Vec3,
        area: f32,
        radiance: Vec3,
        two_sided: bool,
    },
}

impl Lamp {
    /// Whether it has an extent, so that its shadows are soft and several rays are needed.
    pub(crate) fn is_soft(&self) -> bool {
        match self {
            Self::Sun { tan_radius, .. } => *tan_radius > 0.0,
            Self::Area { .. } => true,
            Self::Point { .. } | Self::Spot { .. } => false,
        }
    }

    /// Light that arrives at `from`; `None` if none does. `least` bounds the distance from below,
    /// so that a lamp on a surface does not shine on it without limit.
    pub(crate) fn sample(&self, from: Vec3, u: [f32; 2], least: f32) -> Option<Arrival> {
        match *self {
            Self::Sun { direction, x, y, tan_radius, irradiance } => {
                let direction = if tan_radius > 0.0 {
                    let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
                    let r = tan_radius * u[0].sqrt();
                    (direction + (x * cos + y * sin) * r).normalize_or(direction)
                } else {
                    direction
                };
                Some(Arrival { direction, target: None, normal_irradiance: irradiance })
            }
            Self::Point { position, intensity } => from_point(position, from, intensity, least),
            Self::Spot { position, axis, intensity, cos_inner, cos_outer } => {
                let arrival = from_point(position, from, intensity, least)?;
                let cos = -arrival.direction.dot(axis);
                let share = smooth_step(cos_outer, cos_inner, cos);
                (share > 0.0).then(|| Arrival {
                    normal_irradiance: arrival.normal_irradiance * share,
                    ..arrival
                })
            }
            Self::Area { corner, edges, normal, area, radiance, two_sided } => {
                let point = corner + edges[0] * u[0] + edges[1] * u[1];
                let towards = point - from;
                let direction = towards.try_normalize()?;
                let cos = -direction.dot(normal);
                let cos = if two_sided { cos.abs() } else { cos };
                let squared = towards.length_squared().max(least * least);
                (cos > 0.0).then(|| Arrival {
                    direction,
                    target: Some(point),
                    normal_irradiance: radiance * (area * cos / squared),
                })
            }
        }
    }

    /// Distance at which a ray meets the light, and its radiance in that direction. Only areas can
    /// be met.
    pub(crate) fn meet(&self, origin: Vec3, direction: Vec3) -> Option<(f32, Vec3)> {
        let Self::Area { corner, edges, normal, radiance, two_sided, .. } = *self else {
            return None;
        };
        let cos = direction.dot(normal);
        if cos == 0.0 || (cos > 0.0 && !two_sided) {
            return None;
        }
        let distance = (corner - origin).dot(normal) / cos;
        let offset = origin + direction * distance - corner;
        // Coordinates along both edges, by Cramer's rule on their Gram matrix.
        let [a, b] = edges;
        let (aa, ab, bb) = (a.dot(a), a.dot(b), b.dot(b));
        let (pa, pb) = (offset.dot(a), offset.dot(b));
        let scale = 1.0 / (aa * bb - ab * ab);
        let (u, v) = ((pa * bb - pb * ab) * scale, (pb * aa - pa * ab) * scale);
        let inside = (0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v);
        (distance > 0.0 && inside).then_some((distance, radiance))
    }
}

fn from_point(position: Vec3, from: Vec3, intensity: Vec3, least: f32) -> Option<Arrival> {
    let towards = position - from;
    let squared = towards.length_squared().max(least * least);
    Some(Arrival {
        direction: towards.try_normalize()?,
        target: Some(position),
        normal_irradiance: intensity / squared,
    })
}

/// Smooth step from 0 at `low` to 1 at `high`; a step where both are equal.
fn smooth_step(low: f32, high: f32, x: f32) -> f32 {
    if x >= high {
        return 1.0;
    }
    let t = ((x - low) / (high - low)).max(0.0);
    t * t * (3.0 - 2.0 * t)
}
