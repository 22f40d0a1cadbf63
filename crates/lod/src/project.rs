//! Exact projection of boxes: a box is cut at the near plane, its corners are projected, and their
//! convex hull is its silhouette, with area, bounds and depths (kanzok2015, section 3.2.2: contours
//! are transformed to the screen in software, "as strictly as possible"). All in `f64`.

use crate::oriented_box::OrientedBox;
use crate::polygon::Polygon;
use crate::view::View;
use glam::{DMat3, DVec2, DVec3};

/// A view's projection, computed once for many boxes.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    eye: DVec3,
    view_from_world: DMat3,
    focal_px: f64,
    centre_px: DVec2,
    near: f64,
    /// As in the view.
    parallel_at: Option<f64>,
}

impl Projection {
    /// The projection of a view.
    pub fn of(view: &View) -> Self {
        Self {
            eye: view.eye,
            view_from_world: view.view_from_world(),
            focal_px: view.focal_px(),
            centre_px: DVec2::new(f64::from(view.width), f64::from(view.height)) * 0.5,
            near: view.near,
            parallel_at: view.parallel_at,
        }
    }

    /// Width and height of the picture, pixels.
    pub fn size_px(&self) -> DVec2 {
        self.centre_px * 2.0
    }

    /// Whether its eye and direction are those of `view`.
    pub fn is_from(&self, view: &View) -> bool {
        self.eye == view.eye
            && self.view_from_world == view.view_from_world()
            && self.parallel_at == view.parallel_at
    }

    /// Position of the eye, world coordinates.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Pixels of a unit of length at unit eye depth.
    pub fn focal_px(&self) -> f64 {
        self.focal_px
    }

    /// Depth of the near plane, the file's unit.
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Eye depth of a world point.
    pub fn depth(&self, world: DVec3) -> f64 {
        -self.view_from_world.row(2).dot(world - self.eye)
    }

    /// Projects a world point in front of the eye to the picture, pixels.
    pub fn on_picture(&self, world: DVec3) -> DVec2 {
        self.project(self.view_from_world * (world - self.eye))
    }

    /// The world point at a position of the picture, pixels, and an eye depth.
    pub fn place(&self, px: DVec2, depth: f64) -> DVec3 {
        let xy = (px - self.centre_px) * (self.parallel_at.unwrap_or(depth) / self.focal_px);
        self.eye + self.view_from_world.transpose() * DVec3::new(xy.x, -xy.y, -depth)
    }

    /// Least and greatest eye depth of a box, not cut at the near plane.
    pub fn depths(&self, b: &OrientedBox) -> [f64; 2] {
        let forward = -self.view_from_world.row(2);
        let (depth, reach) = (forward.dot(b.centre - self.eye), b.extent_along(forward));
        [depth - reach, depth + reach]
    }

    /// The silhouette of a box; `None` if all of it is nearer than the near plane, or if it is not
    /// finite.
    pub fn silhouette(&self, b: &OrientedBox) -> Option<Silhouette> {
        let mut corners = Polygon::default();
        let [nearest, farthest] = self.each_corner(b, |corner| corners.push(corner))?;
        Some(Silhouette { polygon: corners.convex_hull(), nearest, farthest })
    }

    /// Lowest and highest x and y of the silhouette of a box, pixels; cheaper than the silhouette.
    pub(crate) fn bounds(&self, b: &OrientedBox) -> Option<[DVec2; 2]> {
        let mut bounds = [DVec2::INFINITY, DVec2::NEG_INFINITY];
        self.each_corner(b, |p| bounds = [bounds[0].min(p), bounds[1].max(p)])?;
        Some(bounds)
    }

    /// Calls `each` with the projected corners of the part of a box behind the near plane, in no
    /// order. Returns the least and greatest depth of that part.
    #[inline]
    fn each_corner(&self, b: &OrientedBox, mut each: impl FnMut(DVec2)) -> Option<[f64; 2]> {
        let centre = self.view_from_world * (b.centre - self.eye);
        let axes = self.view_from_world * b.axes * DMat3::from_diagonal(b.half);
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis];
        let reach = x.z.abs() + y.z.abs() + z.z.abs();
        let (nearest, farthest) = (-centre.z - reach, -centre.z + reach);
        if !(farthest >= self.near && farthest.is_finite() && nearest.is_finite()) {
            return None;
        }
        let corners: [DVec3; 8] = std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            centre + x * sign(0) + y * sign(1) + z * sign(2)
        });
        for (i, corner) in corners.iter().enumerate() {
            if -corner.z >= self.near {
                each(self.project(*corner));
                continue;
            }
            // Cuts those edges at the near plane that start at this corner.
            for bit in 0..3 {
                let other = corners[i ^ (1 << bit)];
                if -other.z >= self.near {
                    let t = (self.near + corner.z) / (corner.z - other.z);
                    let cut = corner.lerp(other, t);
                    each(self.project(cut.with_z(-self.near)));
                }
            }
        }
        Some([nearest.max(self.near), farthest])
    }

    fn project(&self, v: DVec3) -> DVec2 {
        let depth = self.parallel_at.unwrap_or(-v.z);
        self.centre_px + DVec2::new(v.x, -v.y) * (self.focal_px / depth)
    }
}

/// The outline of a box on the picture.
#[derive(Clone, Copy, Debug)]
pub struct Silhouette {
    polygon: Polygon,
    /// Least eye depth of the box behind the near plane.
    pub nearest: f64,
    /// Greatest eye depth of the box.
    pub farthest: f64,
}

impl Silhouette {
    pub(crate) fn polygon(&self) -> &Polygon {
        &self.polygon
    }

    /// Corners in pixels, in order around it; convex.
    pub fn corners(&self) -> &[DVec2] {
        self.polygon.corners()
    }

    /// Area, pixels.
    pub fn area_px(&self) -> f64 {
        let corners = self.corners();
        let Some(&first) = corners.first() else { return 0.0 };
        // About the first corner, so that large coordinates cancel before they are multiplied.
        let doubled: f64 = corners.windows(2).map(|w| (w[0] - first).perp_dot(w[1] - first)).sum();
        doubled.abs() * 0.5
    }

    /// Number of squares with a side of `side_px` pixels: by its area, or by its length if it is
    /// thinner than a square.
    pub fn squares(&self, side_px: f64) -> f64 {
        let corners = self.corners();
        let next = corners.iter().cycle().skip(1);
        let outline: f64 = corners.iter().zip(next).map(|(a, b)| a.distance(*b)).sum();
        (self.area_px() / (side_px * side_px)).max(outline / (2.0 * side_px))
    }

    /// Lowest and highest x and y, pixels; `None` without corners.
    pub fn bounds(&self) -> Option<[DVec2; 2]> {
        self.polygon.bounds()
    }

    /// The part within a rectangle.
    pub fn clipped(&self, low: DVec2, high: DVec2) -> Self {
        let polygon = self.polygon.clipped(low, high).unwrap_or(self.polygon);
        Self { polygon, ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = OrientedBox> {
        let c = -8.0f64..8.0;
        let half = prop_oneof![Just(0.0), 0.01f64..6.0];
        ([c.clone(), c.clone(), c], [half.clone(), half.clone(), half], [-3.0f64..3.0, -3.0..3.0])
            .prop_map(|(centre, half, turn)| OrientedBox {
                centre: centre.into(),
                half: half.into(),
                axes: DMat3::from_rotation_x(turn[0]) * DMat3::from_rotation_z(turn[1]),
            })
    }

    fn view(near: f64) -> View {
        let mut view = View::look_at(DVec3::NEG_Y * 4.0, DVec3::ZERO, DVec3::Z, 1.2, 64, 48);
        view.near = near;
        view
    }

    /// Whether the ray through a pixel meets the box behind the near plane: slabs in the box's own
    /// axes.
    fn is_hit(view: &View, b: &OrientedBox, px: DVec2) -> bool {
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let xy = (px - size * 0.5) / view.focal_px();
        let direction = b.axes.transpose() * (view.world_from_view * DVec3::new(xy.x, -xy.y, -1.0));
        let from = b.axes.transpose() * (view.eye - b.centre);
        // The parameter of the ray is the eye depth.
        let (mut enter, mut leave) = (view.near, f64::INFINITY);
        for i in 0..3 {
            let [a, c] = [-b.half[i], b.half[i]].map(|h| (h - from[i]) / direction[i]);
            enter = enter.max(a.min(c));
            leave = leave.min(a.max(c));
        }
        enter <= leave
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn area_is_the_number_of_pixels_whose_rays_meet_the_box(b in boxes(), near in 0.01f64..6.0) {
            let view = view(near);
            let size = DVec2::new(64.0, 48.0);
            let silhouette = Projection::of(&view).silhouette(&b);
            let area = silhouette.map_or(0.0, |s| s.clipped(DVec2::ZERO, size).area_px());
            // 4 x 4 rays a pixel. An outline of at most 224 pixels crosses as many of their
            // squares.
            let mut hits = 0u32;
            for i in 0..64 * 48 * 16 {
                let px = DVec2::new(f64::from(i % 256) + 0.5, f64::from(i / 256) + 0.5) / 4.0;
                hits += u32::from(is_hit(&view, &b, px));
            }
            let counted = f64::from(hits) / 16.0;
            let outline = silhouette.map_or(0.0, |s| {
                let s = s.clipped(DVec2::ZERO, size);
                let corners = s.corners();
                (0..corners.len()).map(|i| corners[i].distance(corners[(i + 1) % corners.len()])).sum()
            });
            prop_assert!((area - counted).abs() <= 0.02 + outline * 0.25, "{area} {counted} {outline}");
        }

        #[test]
        fn every_point_in_front_is_inside_the_outline_and_between_the_depths(
            b in boxes(), near in 0.01f64..6.0, at in prop::collection::vec([-1.0f64..=1.0, -1.0..=1.0, -1.0..=1.0], 30),
        ) {
            let view = view(near);
            let silhouette = Projection::of(&view).silhouette(&b);
            for at in at {
                let p = b.centre + b.axes * (b.half * DVec3::from_array(at));
                let Some(on) = view.project(p) else { continue };
                let s = silhouette.expect("a point is in front");
                prop_assert!(on.z >= s.nearest - 1e-9 && on.z <= s.farthest + 1e-9);
                let [low, high] = s.bounds().expect("it has corners");
                prop_assert!(on.x >= low.x - 1e-6 && on.x <= high.x + 1e-6);
                prop_assert!(on.y >= low.y - 1e-6 && on.y <= high.y + 1e-6);
                let corners = s.corners();
                for i in 0..corners.len() {
                    let (a, c) = (corners[i], corners[(i + 1) % corners.len()]);
                    let side = (c - a).perp_dot(on.truncate() - a);
                    prop_assert!(side >= -1e-6 * (1.0 + a.distance(c)), "{side} outside of an edge");
                }
            }
        }
    }

    #[test]
    fn parallel_outlines_have_their_size_at_any_depth() {
        let bounds = [DVec3::splat(-20.0), DVec3::splat(20.0)];
        let view = View::look_at(DVec3::NEG_Y * 30.0, DVec3::ZERO, DVec3::Z, 1.0, 300, 200);
        let view = view.parallel(20.0, bounds[0], bounds[1]);
        let projection = Projection::of(&view);
        for at in [DVec3::ZERO, DVec3::new(3.0, 15.0, -2.0), DVec3::new(-7.0, -18.0, 4.0)] {
            let b = OrientedBox { centre: at, half: DVec3::ONE, axes: DMat3::IDENTITY };
            let s = projection.silhouette(&b).expect("in front");
            assert!((s.area_px() - 400.0).abs() < 1e-6, "{}", s.area_px());
            assert!((s.nearest - view.near - (29.0 + at.y)).abs() < 1e-9);
            let middle = DVec2::new(150.0 + 10.0 * at.x, 100.0 - 10.0 * at.z);
            assert!(projection.on_picture(at).distance(middle) < 1e-9);
            assert!(projection.place(middle, view.depth(at)).distance(at) < 1e-9);
        }
        assert!(
            projection.is_from(&view) && !projection.is_from(&View { parallel_at: None, ..view })
        );
    }

    #[test]
    fn a_line_has_squares_along_it() {
        let line = |half| OrientedBox { centre: DVec3::ZERO, half, axes: DMat3::IDENTITY };
        let projection = Projection::of(&view(0.1));
        let squares = |half, side| projection.silhouette(&line(half)).unwrap().squares(side);
        let length_px = 2.0 * view(0.1).focal_px() / 4.0;
        assert!((squares(DVec3::new(1.0, 0.0, 0.0), 0.5) - length_px / 0.5).abs() < 1e-9);
        // A wall counts by its area.
        let wall = squares(DVec3::new(1.0, 0.0, 1.0), 0.5);
        assert!((wall - (length_px / 0.5).powi(2)).abs() < 1e-6);
    }

    #[test]
    fn what_is_behind_or_not_a_number_has_no_outline() {
        let cube = |centre| OrientedBox { centre, half: DVec3::ONE, axes: DMat3::IDENTITY };
        let projection = Projection::of(&view(0.1));
        assert!(projection.silhouette(&cube(DVec3::NEG_Y * 6.0)).is_none());
        assert!(projection.silhouette(&cube(DVec3::splat(f64::NAN))).is_none());
        assert!(projection.silhouette(&cube(DVec3::splat(f64::INFINITY))).is_none());
        assert!(projection.silhouette(&cube(DVec3::ZERO)).is_some());
    }

    #[test]
    fn a_cube_face_on_has_the_area_of_its_near_face() {
        let view = View::look_at(DVec3::NEG_Y * 11.0, DVec3::ZERO, DVec3::Z, 1.0, 100, 100);
        let b = OrientedBox { centre: DVec3::ZERO, half: DVec3::ONE, axes: DMat3::IDENTITY };
        let s = Projection::of(&view).silhouette(&b).expect("in front");
        let side = 2.0 * view.focal_px() / 10.0;
        assert!((s.area_px() - side * side).abs() < 1e-9);
        assert!((s.nearest - 10.0).abs() < 1e-12 && (s.farthest - 12.0).abs() < 1e-12);
    }
}
