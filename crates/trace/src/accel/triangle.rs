//! Triangles, and leaves of eight (`moller1997`).

use crate::accel::WIDTH;
use crate::accel::bounds::Bounds;
use crate::accel::tree::{Leaf, Primitive};
use crate::accel::walk::{Lanes, cross, dot, load3, sub};
use bytemuck::{Pod, Zeroable};
use fearless_simd::{Simd, f32x8, mask32x8};
use glam::Vec3;

/// A triangle: a corner and the two edges from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
}

/// Eight triangles, axis by axis.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct TriangleLeaf {
    /// First corners.
    pub corner: [[f32; WIDTH]; 3],
    /// Edges from the first corner to the second and to the third; zero for an unused place.
    pub edges: [[[f32; WIDTH]; 3]; 2],
}

/// Overlap of neighbouring triangles in barycentric coordinates: some roundings of `f32`, so that
/// no ray passes between them.
const OVERLAP: f32 = 1e-6;

impl Triangle {
    pub(crate) fn new([a, b, c]: [Vec3; 3]) -> Self {
        Self { corner: a, edges: [b - a, c - a] }
    }

    /// Whether the triangle has an area, and finite coordinates that can be squared.
    pub(crate) fn is_fine(&self, greatest: f32) -> bool {
        let is_near = self.corners().iter().all(|c| c.abs().cmple(Vec3::splat(greatest)).all());
        is_near && self.normal().try_normalize().is_some()
    }

    pub(crate) fn corners(&self) -> [Vec3; 3] {
        [self.corner, self.corner + self.edges[0], self.corner + self.edges[1]]
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
}

impl Primitive for Triangle {
    type Leaf = TriangleLeaf;

    #[inline(always)]
    fn bounds(&self) -> Bounds {
        let [a, b, c] = self.corners();
        Bounds { min: a.min(b).min(c), max: a.max(b).max(c) }
    }

    #[inline(always)]
    fn centre(&self) -> Vec3 {
        self.bounds().centre()
    }
}

impl Leaf for TriangleLeaf {
    type Primitive = Triangle;

    #[inline(always)]
    fn set(&mut self, k: usize, triangle: &Triangle) {
        for axis in 0..3 {
            self.corner[axis][k] = triangle.corner[axis];
            for edge in 0..2 {
                self.edges[edge][axis][k] = triangle.edges[edge][axis];
            }
        }
    }

    #[inline(always)]
    fn bounds(&self, count: usize) -> Bounds {
        (0..count).fold(Bounds::EMPTY, |all, k| all.union(&self.get(k).bounds()))
    }

    #[inline(always)]
    fn get(&self, k: usize) -> Triangle {
        let of = |rows: &[[f32; WIDTH]; 3]| Vec3::new(rows[0][k], rows[1][k], rows[2][k]);
        Triangle { corner: of(&self.corner), edges: [of(&self.edges[0]), of(&self.edges[1])] }
    }
}

impl TriangleLeaf {
    /// Distances at which a ray meets the triangles, and those that are met before the limit.
    #[inline(always)]
    pub(crate) fn meet<S: Simd>(
        &self,
        simd: S,
        ray: &Lanes<S>,
        limit: f32,
    ) -> (f32x8<S>, mask32x8<S>) {
        let corner = load3(simd, &self.corner);
        let (first, second) = (load3(simd, &self.edges[0]), load3(simd, &self.edges[1]));
        let p = cross(ray.direction, second);
        let inverse = simd.splat_f32x8(1.0) / dot(first, p);
        let to = sub(ray.origin, corner);
        let q = cross(to, first);
        let v = dot(to, p) * inverse;
        let w = dot(ray.direction, q) * inverse;
        let distance = dot(second, q) * inverse;
        let least = simd.splat_f32x8(-OVERLAP);
        let is_met = simd.simd_le_f32x8(least, v)
            & simd.simd_le_f32x8(least, w)
            & simd.simd_le_f32x8(v + w, simd.splat_f32x8(1.0 + OVERLAP))
            & simd.simd_lt_f32x8(simd.splat_f32x8(0.0), distance)
            & simd.simd_lt_f32x8(distance, simd.splat_f32x8(limit));
        (distance, is_met)
    }
}
