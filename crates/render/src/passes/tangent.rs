//! Depth along a disc's plane. The published depth intervals (marroquim2007 section 3.2) compare depths of different
//! places as they are, so on a slope they have to be long, and grow with each level of the pyramid until they take in
//! what lies behind. Here a pixel's depths hold at its ellipse's centre, and are moved along its plane to where they
//! are compared, averaged and shown: on a plane nothing grows, at any slope.
//!
//! The point at (x, y) from the picture's middle (y down) with depth d is (x, -y, -f) d / f. On a plane with normal n
//! its dot product with n is constant, so d is as one over `q = n.x x - n.y y - n.z f`, which is linear in the picture.
//! Of a plane told from depths n is so long that q is -1: then n.x and n.y are all that is needed of it.

use crate::inputs::camera::Camera;
use crate::simd::values::Values;
use glam::{Vec2, Vec4};

/// Steepest slope (depth over width) that planes are followed with: what is nearly edge on says little of its slope.
pub(crate) const SLOPE_MAX: f32 = 32.0;
/// Depths change by at most this factor in one move.
const FACTOR_MAX: f32 = 2.0;

/// How a picture's places see: what planes need of the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle, pixels.
    pub centre_px: Vec2,
}

impl Lens {
    /// Of a camera.
    pub fn new(camera: &Camera) -> Self {
        Self { focal_px: camera.focal_px, centre_px: Vec2::from_array(camera.centre_px) }
    }

    /// Depth on the planes with these normals (view space, any length) at `from + by` (pixels), over that at `from`.
    /// One where there is no normal.
    #[cfg(test)]
    fn along<V: Values>(&self, normal: [V; 3], from: [V; 2], by: [V; 2]) -> V {
        factor(self.facing(normal, from), turn([normal[0], normal[1]], by))
    }

    /// Depth that plates of unit thickness take along the rays at places; normals have unit length.
    #[inline(always)]
    pub fn thickness(&self, normal: [Vec4; 3], at: [Vec4; 2]) -> Vec4 {
        -self.focal_px / self.facing(normal, at)
    }

    /// q of the head at places (pixels), of planes turned to the eye, not steeper than can be followed. Below zero.
    #[inline(always)]
    pub(crate) fn facing<V: Values>(&self, [nx, ny, nz]: [V; 3], [x, y]: [V; 2]) -> V {
        let q = nx * (x - self.centre_px.x) - ny * (y - self.centre_px.y) - nz * self.focal_px;
        let steepest = (nx.abs() + ny.abs()) * (-self.focal_px / SLOPE_MAX);
        q.min(steepest) - f32::MIN_POSITIVE
    }
}

/// What q of the head changes by over so many pixels, where normals have these parts right and up.
#[inline(always)]
pub(crate) fn turn<V: Values>([nx, ny]: [V; 2], [x, y]: [V; 2]) -> V {
    nx * x - ny * y
}

/// Depths after moves over those before them, from q before them and what the moves change it by.
#[inline(always)]
pub(crate) fn factor<V: Values>(q: V, turn: V) -> V {
    q / (q + turn).max(q * FACTOR_MAX).min(q * (1.0 / FACTOR_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    const LENS: Lens = Lens { focal_px: 100.0, centre_px: Vec2::new(40.0, 30.0) };

    /// Depth of the plane through (0, 0, -5) at a place.
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
        // Edge on and turned away: finite, and no longer than the steepest slope.
        for edge_on in [Vec3::X, Vec3::new(0.8, 0.0, -0.6)] {
            assert!((1.0..=SLOPE_MAX * 1.01).contains(&(thickness(edge_on, middle) * 0.8)));
            assert!((0.5..=2.0).contains(&along(edge_on, middle, Vec2::X * 50.0)));
        }
    }
}
