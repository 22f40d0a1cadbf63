//! Triangles.

use crate::accel::bounds::Bounds;
use crate::ray::Ray;
use glam::Vec3;

/// A triangle: a corner and the two edges from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
}

/// Overlap of neighbouring triangles in barycentric coordinates: some roundings of `f32`, so that
/// no ray passes between them.
const OVERLAP: f32 = 1e-6;

impl Triangle {
    pub(crate) fn new([a, b, c]: [Vec3; 3]) -> Self {
        Self { corner: a, edges: [b - a, c - a] }
    }

    pub(crate) fn corners(&self) -> [Vec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
    }

    /// Box of the triangle.
    pub(crate) fn bounds(&self) -> Bounds {
        let [a, b, c] = self.corners();
        Bounds { min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    /// Normal, not of unit length.
    pub(crate) fn normal(&self) -> Vec3 {
        self.edges[0].cross(self.edges[1])
    }

    /// Barycentric coordinates of a point of the triangle.
    pub(crate) fn weights(&self, p: Vec3) -> [f32; 3] {
        let n = self.normal();
        let scale = 1.0 / n.length_squared();
        let to = p - self.corner;
        let v = to.cross(self.edges[1]).dot(n) * scale;
        let w = self.edges[0].cross(to).dot(n) * scale;
        [1.0 - v - w, v, w]
    }

    /// Distance at which a ray meets the triangle.
    pub(crate) fn meet(&self, ray: &Ray) -> Option<f32> {
        let p = ray.direction.cross(self.edges[1]);
        let inverse = 1.0 / self.edges[0].dot(p);
        let to = ray.origin - self.corner;
        let v = to.dot(p) * inverse;
        let q = to.cross(self.edges[0]);
        let w = ray.direction.dot(q) * inverse;
        let t = self.edges[1].dot(q) * inverse;
        (v >= -OVERLAP && w >= -OVERLAP && v + w <= 1.0 + OVERLAP && t > 0.0).then_some(t)
    }
}
