//! Moves depths along the plane of a disc. The published depth intervals (`marroquim2007`, section
//! 3.2) compare depths of different positions as they are, so they have to be long on a slope, and
//! grow with each level of the pyramid until they include the surface behind. Here the depth of a
//! pixel holds at its ellipse's centre, and is moved along its plane to where it is compared,
//! averaged or shown: on a plane intervals do not grow, at any slope.
//!
//! The point at (x, y) from the picture's middle (y down) with depth d is (x, -y, -f) d / f. On a
//! plane with normal n its dot product with n is constant, so d is proportional to 1 / q with `q =
//! n.x x - n.y y - n.z f`, which is linear in the picture. The normal of a plane fitted to depths
//! is scaled so that q is -1: then n.x and n.y suffice.

use crate::inputs::camera::Camera;
use crate::simd::values::{Lane, Values};
use glam::Vec2;

/// Steepest slope (depth over width) along which depths are moved: of discs nearly edge-on the
/// slope is unreliable.
pub(crate) const SLOPE_MAX: f32 = 32.0;
/// Greatest factor by which a move changes a depth.
pub(crate) const FACTOR_MAX: f32 = 2.0;

/// Projection of a picture: the part of the camera that planes need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lens {
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle, pixels.
    pub centre_px: Vec2,
}

impl Lens {
    /// Lens of `camera`.
    pub fn new(camera: &Camera) -> Self {
        Self { focal_px: camera.focal_px, centre_px: Vec2::from_array(camera.centre_px) }
    }

    /// Depth at `from + by` (pixels) over that at `from`, on planes with these normals (view space,
    /// any length). One if the normal is zero.
    #[cfg(test)]
    fn along<V: Values>(&self, normal: [V; 3], from: [V; 2], by: [V; 2]) -> V {
        factor(self.facing(normal, from), turn([normal[0], normal[1]], by))
    }

    /// Extent in depth of plates of unit thickness along the rays at positions `at` (pixels);
    /// normals have unit length.
    #[inline(always)]
    pub fn thickness(&self, normal: [Lane; 3], at: [Lane; 2]) -> Lane {
        -self.focal_px / self.facing(normal, at)
    }

    /// q (see the head of this file) at positions in pixels, on planes that face the eye, with
    /// slopes limited to [`SLOPE_MAX`]. Always negative.
    #[inline(always)]
    pub(crate) fn facing<V: Values>(&self, [nx, ny, nz]: [V; 3], [x, y]: [V; 2]) -> V {
        let q = nx * (x - self.centre_px.x) - ny * (y - self.centre_px.y) - nz * self.focal_px;
        let steepest = (nx.abs() + ny.abs()) * (-self.focal_px / SLOPE_MAX);
        q.min(steepest) - f32::MIN_POSITIVE
    }
}

/// Change of q (see the head of this file) over a distance in pixels; `nx` and `ny` are the
/// normal's parts to the right and upwards.
#[inline(always)]
pub(crate) fn turn<V: Values>([nx, ny]: [V; 2], [x, y]: [V; 2]) -> V {
    nx * x - ny * y
}

/// Depth after a move over the depth before it, from q before the move and its change by the move.
#[inline(always)]
pub(crate) fn factor<V: Values>(q: V, turn: V) -> V {
    q / (q + turn).max(q * FACTOR_MAX).min(q * (1.0 / FACTOR_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, Vec4};

    const LENS: Lens = Lens { focal_px: 100.0, centre_px: Vec2::new(40.0, 30.0) };

    /// Depth of the plane through (0, 0, -5) at a position.
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
        // Edge-on and turned away: finite, and no longer than at the steepest slope.
        for edge_on in [Vec3::X, Vec3::new(0.8, 0.0, -0.6)] {
            assert!((1.0..=SLOPE_MAX * 1.01).contains(&(thickness(edge_on, middle) * 0.8)));
            assert!((0.5..=2.0).contains(&along(edge_on, middle, Vec2::X * 50.0)));
        }
    }
}
