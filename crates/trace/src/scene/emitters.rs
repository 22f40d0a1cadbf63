//! Surfaces of a scene that emit light, as a list that lights are sampled from.

use crate::scene::splats::RADIUS_FACTOR;
use glam::Vec3;
use std::f32::consts::PI;

/// A splat or triangle that emits light to both sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaLight {
    /// Where it emits.
    pub shape: Shape,
    /// Area of the surface it stands for, the unit of the file squared. Splats overlap, so theirs
    /// is less than that of their disc.
    pub area: f32,
    /// Emitted radiance, linear light.
    pub radiance: Vec3,
}

/// Shape of an [`AreaLight`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Corners of a triangle.
    Triangle([Vec3; 3]),
    /// A disc.
    Disc {
        /// Centre.
        centre: Vec3,
        /// Unit normal; zero if the splat has none: it then faces each point.
        normal: Vec3,
        /// Radius of the disc that rays meet.
        radius: f32,
    },
}

impl AreaLight {
    /// A light with the area of its shape.
    pub(crate) fn new(shape: Shape, radiance: Vec3) -> Self {
        let area = match shape {
            Shape::Triangle([a, b, c]) => 0.5 * (b - a).cross(c - a).length(),
            // A splat stands for a square of its spacing.
            Shape::Disc { radius, .. } => (radius / RADIUS_FACTOR).powi(2),
        };
        Self { shape, area, radiance }
    }

    /// Point of the light for two numbers in 0 to 1, evenly distributed over its shape. `toward` is
    /// the point lit, which splats without a normal face.
    pub fn point(&self, [u, v]: [f32; 2], toward: Vec3) -> Vec3 {
        match self.shape {
            Shape::Triangle([a, b, c]) => {
                let root = u.sqrt();
                a * (1.0 - root) + b * (root * (1.0 - v)) + c * (root * v)
            }
            Shape::Disc { centre, radius, .. } => {
                let (x, y) = self.normal(toward).any_orthonormal_pair();
                let (sin, cos) = (2.0 * PI * v).sin_cos();
                centre + (x * cos + y * sin) * (radius * u.sqrt())
            }
        }
    }

    /// Unit normal of the light, seen from `toward`; to which side it points is arbitrary.
    pub fn normal(&self, toward: Vec3) -> Vec3 {
        match self.shape {
            Shape::Triangle([a, b, c]) => (b - a).cross(c - a).normalize_or(Vec3::Z),
            Shape::Disc { centre, normal, .. } if normal == Vec3::ZERO => {
                (toward - centre).normalize_or(Vec3::Z)
            }
            Shape::Disc { normal, .. } => normal,
        }
    }

    /// Centre of the light.
    pub fn centre(&self) -> Vec3 {
        match self.shape {
            Shape::Triangle([a, b, c]) => (a + b + c) / 3.0,
            Shape::Disc { centre, .. } => centre,
        }
    }
}
