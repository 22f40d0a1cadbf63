//! Depth along a disc's plane. The published depth intervals (marroquim2007 section 3.2) compare
//! depths of different places directly, so that on a slope they must be long, and grow with each
//! level of the pyramid until they include surfaces behind. Here the depths of a pixel hold at the
//! centre of its ellipse and are moved along its plane to the place where they are compared,
//! averaged or shown: on a plane no interval grows, at any slope.
//!
//! The point at (x, y) from the middle of the picture (y down) with depth d is (x, -y, -f) d / f.
//! Its dot product with the normal n of a plane is constant, so that d is proportional to the
//! inverse of `q = n.x x - n.y y - n.z f`, which is linear in the picture. The normal of a fitted
//! plane is scaled so that q is -1; then only n.x and n.y are needed.

use crate::inputs::camera::Camera;
use crate::simd::values::{Lane, Values};
use glam::Vec2;

/// Steepest slope (depth over width) of planes: a nearly edge-on plane says little of its slope.
pub(crate) const SLOPE_MAX: f32 = 32.0;
/// Greatest factor by which one move changes a depth.
pub(crate) const FACTOR_MAX: f32 = 2.0;

/// Parameters of the camera that planes need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// Middle of the picture, pixels.
    pub centre_px: Vec2,
}

impl Lens {
    /// Takes the parameters from a camera.
    pub fn new(camera: &Camera) -> Self {
        Self { focal_px: camera.focal_px, centre_px: Vec2::from_array(camera.centre_px) }
    }

    /// Depth on planes with these normals (view space, any length) at `from + by` (pixels), over
    /// that at `from`. One for a zero normal.
    #[cfg(test)]
    fn along<V: Values>(&self, normal: [V; 3], from: [V; 2], by: [V; 2]) -> V {
        factor(self.facing(normal, from), turn([normal[0], normal[1]], by))
    }

    /// Depth of plates of unit thickness along the rays at `at`; normals have unit length.
    #[inline(always)]
    pub fn thickness(&self, normal: [Lane; 3], at: [Lane; 2]) -> Lane {
        -self.focal_px / self.facing(normal, at)
    }

    /// q (see the head of this file) at places (pixels), of planes turned to the eye and limited to
    /// the steepest slope. Below zero.
    #[inline(always)]
    pub(crate) fn facing<V: Values>(&self, [nx, ny, nz]: [V; 3], [x, y]: [V; 2]) -> V {
        let q = nx * (x - self.centre_px.x) - ny * (y - self.centre_px.y) - nz * self.focal_px;
        let steepest = (nx.abs() + ny.abs()) * (-self.focal_px / SLOPE_MAX);
        q.min(steepest) - f32::MIN_POSITIVE
    }
}

/// Change of q over an offset in pixels, for the parts of normals to the right and up.
#[inline(always)]
pub(crate) fn turn<V: Values>([nx, ny]: [V; 2], [x, y]: [V; 2]) -> V {
    nx * x - ny * y
}

/// Depth after a move over that before it, from q before the move and its change.
#[inline(always)]
pub(crate) fn factor<V: Values>(q: V, turn: V) -> V {
    q / (q + turn).max(q * FACTOR_MAX).min(q * (1.0 / FACTOR_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, Vec4};

    const LENS: Lens = Lens { focal_px: 100.0, centre_px: Vec2::new(40.0, 30.0) };

    /// Depth of the plane through (0, 0, -5) at `place`.
    fn depth(normal: Vec3, place: Vec2) -> f32 {
        let at = place - LENS.centre_px;
        let ray = Vec3::new(at.x / LENS.focal_px, -at.y / LENS.focal_px, -1.0);
        normal.dot(Vec3::NEG_Z * 5.0) / normal.dot(ray)
    }

    fn along(normal: Vec3, from: Vec2, by: Vec2) -> f32 {
        let [from, by] = [from, by].map(|v| v.to_array().map(Vec4::splat));
        LENS.along(normal.to_array().map(Vec4::splat), from, by).x
    }

    fn thickness(normal: Vec3, at: Vec2) -> f32 {
        let at = at.to_array().map(Vec4::splat);
        LENS.thickness(normal.to_array().map(Vec4::splat), at).x
    }

    #[test]
    fn depths_moved_along_a_plane_are_the_planes_own_at_any_place_and_slope() {
        for normal in [Vec3::Z, Vec3::new(0.6, -0.2, 1.0), Vec3::new(-2.0, 7.0, 1.2)] {
            let n = normal.normalize_or(Vec3::Z);
            for (from, by) in [([12.0, 50.0], [3.0, -4.0]), ([40.0, 30.0], [1.0, 1.0])] {
                let (from, by) = (Vec2::from_array(from), Vec2::from_array(by));
                let moved = depth(n, from) * along(n, from, by);
                assert!((moved / depth(n, from + by) - 1.0).abs() < 1e-5, "{moved} for {n}");
            }
        }
    }

    #[test]
    fn a_plate_is_thicker_along_slanting_rays_and_no_normal_moves_nothing() {
        let middle = LENS.centre_px;
        let slanting = Vec3::new(0.8, 0.0, 0.6);
        assert!((thickness(slanting, middle) - 1.0 / 0.6).abs() < 1e-6);
        assert_eq!(along(Vec3::ZERO, middle, Vec2::splat(30.0)), 1.0);
        // Planes seen edge on or turned away give finite values, limited by the steepest slope.
        for edge_on in [Vec3::X, Vec3::new(0.8, 0.0, -0.6)] {
            assert!((1.0..=SLOPE_MAX * 1.01).contains(&(thickness(edge_on, middle) * 0.8)));
            assert!((0.5..=2.0).contains(&along(edge_on, middle, Vec2::X * 50.0)));
        }
    }
}
