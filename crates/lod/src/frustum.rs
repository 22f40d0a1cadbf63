//! The view frustum as five half-spaces (left, right, bottom, top, near; there is no far plane),
//! and the conservative test of a box against them: a refused box is certainly outside, a kept one
//! may be.

use crate::oriented_box::OrientedBox;
use crate::view::View;
use glam::DVec3;

/// Relative rounding error of a sum of products in `f64`, with room.
const ROUNDING: f64 = 1e-12;

/// Half-spaces that bound the picture of a view: a pyramid, or a prism if the view is parallel.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    eye: DVec3,
    /// Inward normals (unit length) and the least distance along them, from the eye.
    planes: [(DVec3, f64); 5],
}

impl Frustum {
    /// The frustum of a view.
    pub fn of(view: &View) -> Self {
        let tan = view.tan_half();
        let side = |x: f64, y: f64, tan: f64| match view.parallel_at {
            Some(depth) => (view.world_from_view * DVec3::new(x, y, 0.0), -tan * depth),
            None => {
                let inward = DVec3::new(x, y, -tan) / (1.0 + tan * tan).sqrt();
                (view.world_from_view * inward, 0.0)
            }
        };
        Self {
            eye: view.eye,
            planes: [
                side(1.0, 0.0, tan.x),
                side(-1.0, 0.0, tan.x),
                side(0.0, 1.0, tan.y),
                side(0.0, -1.0, tan.y),
                (view.forward(), view.near),
            ],
        }
    }

    /// Whether some point of the box may be on the picture; never false if one is.
    pub fn touches(&self, b: &OrientedBox) -> bool {
        let towards = b.centre - self.eye;
        let slack = ROUNDING * (self.eye.length() + b.centre.length() + b.radius());
        self.planes.iter().all(|&(normal, least)| {
            let farthest = normal.dot(towards) + b.extent_along(normal);
            // A box that is not a number is kept rather than lost.
            farthest.is_nan() || farthest >= least - slack
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;

    fn coordinates(range: f64) -> impl Strategy<Value = DVec3> {
        (-range..range, -range..range, -range..range).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    #[test]
    fn what_is_behind_or_beside_is_refused() {
        let view = View::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, 1.0, 100, 100);
        let frustum = Frustum::of(&view);
        let cube = |centre: DVec3| OrientedBox { centre, half: DVec3::ONE, axes: DMat3::IDENTITY };
        assert!(frustum.touches(&cube(DVec3::Y * 10.0)));
        assert!(frustum.touches(&cube(DVec3::ZERO)), "the eye is inside");
        assert!(!frustum.touches(&cube(DVec3::Y * -10.0)));
        assert!(!frustum.touches(&cube(DVec3::new(20.0, 10.0, 0.0))));
        assert!(!frustum.touches(&cube(DVec3::new(0.0, 10.0, -20.0))));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn no_box_with_a_visible_point_is_refused(
            eye in coordinates(50.0), target in coordinates(50.0), far in prop_oneof![Just(0.0), Just(1e7)],
            fovy in 0.05f64..2.8, width in 1u32..2000, rows in 1u32..2000,
            centre in coordinates(50.0), half in coordinates(20.0), turn in coordinates(3.0),
            at in prop::collection::vec(coordinates(1.0), 20), height in prop::option::of(0.1f64..100.0),
        ) {
            let origin = DVec3::new(far, -far, 0.0);
            let view = View::look_at(origin + eye, origin + target, DVec3::Z, fovy, width, rows);
            let scan = [-50.0, 50.0].map(|c| origin + DVec3::splat(c));
            let view = height.map_or(view, |height| view.parallel(height, scan[0], scan[1]));
            let axes = DMat3::from_rotation_x(turn.x) * DMat3::from_rotation_y(turn.y) * DMat3::from_rotation_z(turn.z);
            let b = OrientedBox { centre: origin + centre, half: half.abs(), axes };
            let touches = Frustum::of(&view).touches(&b);
            for at in at {
                let p = b.centre + axes * (b.half * at);
                let seen = view.project(p).is_some_and(|on| view.is_on_picture(on));
                prop_assert!(touches || !seen, "{} is seen", p);
            }
        }
    }
}
