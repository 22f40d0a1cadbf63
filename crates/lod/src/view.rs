//! The view: a camera in world coordinates (the file's unit, `f64`) and the picture's size. View
//! space has x to the right, y up, and looks along -z; pixels count from the top left corner. A
//! view is made from eye and target, or fitted to a box; selection and renderer read it.
//!
//! A parallel (orthographic) view is that of a distant pinhole in which each point is projected as
//! if it were at one depth. Positions on the picture are exact. What depends on the distance to the
//! eye is off by 1/256 at most, directions to it by 1/256 of a radian ([`View::parallel`]).

use glam::{DMat3, DVec2, DVec3, Vec3Swizzles};

/// Least and greatest vertical field of view, radians: other values are clamped.
const FOVY_MIN_RAD: f64 = 1e-4;
const FOVY_MAX_RAD: f64 = 3.1;
/// Distance of the near plane, divided by that of the target.
const NEAR_SHARE: f64 = 1e-4;
/// Room left around a fitted box, as a factor on the distance.
const FIT_MARGIN: f64 = 1.02;
/// Distance of the pinhole of a parallel view, over the extents of scan and picture. With a longer
/// one, depths in `f32` have fewer bits left for the scan.
const PARALLEL_EXTENTS: f64 = 128.0;

/// A part of a picture, pixels of the picture with its margin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Number of columns, at least 1.
    pub width: u32,
    /// Number of rows, at least 1.
    pub height: u32,
}

/// A camera and the size of its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Position of the eye, world coordinates, the file's unit.
    pub eye: DVec3,
    /// Its axes in world coordinates, orthonormal: right, up, back (it looks along -z).
    pub world_from_view: DMat3,
    /// Vertical field of view, radians, in (0, pi).
    pub fovy_rad: f64,
    /// Width of the picture, pixels, at least 1.
    pub width: u32,
    /// Height of the picture, pixels, at least 1.
    pub height: u32,
    /// Depth of the near plane: nearer points are not drawn; positive, the file's unit.
    pub near: f64,
    /// Width, pixels, of the margin on each side of the picture. Nodes are selected for the margin
    /// as for the rest; it is not shown.
    pub margin_px: u32,
    /// Depth at which lengths have their size on the picture, if the projection is parallel; `None`
    /// for a pinhole.
    pub parallel_at: Option<f64>,
    /// Part of the picture that is drawn, without a margin of its own; `None` for all of it. Nodes
    /// are selected for the whole picture, so that its parts show the same points.
    pub window: Option<Window>,
}

impl View {
    /// Looks from `eye` at `target`, with `up` as far upwards as possible. A target at the eye is
    /// replaced by one along the world's y; an `up` that is zero or along the view is replaced by
    /// the world's z, or by y if z is along the view too.
    pub fn look_at(
        eye: DVec3,
        target: DVec3,
        up: DVec3,
        fovy_rad: f64,
        width: u32,
        height: u32,
    ) -> Self {
        let towards = target - eye;
        let forward = direction_or(towards, DVec3::Y);
        let distance = towards.length();
        let distance = if distance.is_finite() && distance > 0.0 { distance } else { 1.0 };
        Self {
            eye,
            world_from_view: axes(forward, up),
            fovy_rad: clamp_fovy(fovy_rad),
            width: width.max(1),
            height: height.max(1),
            near: (distance * NEAR_SHARE).max(f64::MIN_POSITIVE),
            margin_px: 0,
            parallel_at: None,
            window: None,
        }
    }

    /// The parallel view with the direction and the middle of this one, of a picture that is
    /// `height` units high, of a scan in the box from `low` to `high`. Nothing behind the eye of
    /// this view is drawn.
    pub fn parallel(self, height: f64, low: DVec3, high: DVec3) -> Self {
        let forward = self.forward();
        let half = (high - low).abs() * 0.5;
        let reach = half.dot(forward.abs());
        // Depths of the scan's middle: from the eye, and from the pinhole.
        let own = forward.dot(low.midpoint(high) - self.eye);
        let width = height * f64::from(self.width) / f64::from(self.height);
        let depth = (2.0 * reach).max(height).max(width) * PARALLEL_EXTENTS;
        // The eye's depth from the pinhole.
        let near = (depth - own).max(depth / PARALLEL_EXTENTS);
        Self {
            eye: self.eye + forward * (own - depth),
            fovy_rad: 2.0 * (height * 0.5 / depth).atan(),
            near,
            parallel_at: Some(depth),
            ..self
        }
    }

    /// [`View::fit_upright`] with the world's z upwards.
    pub fn fit(
        bounds_min: DVec3,
        bounds_max: DVec3,
        direction: DVec3,
        fovy_rad: f64,
        width: u32,
        height: u32,
    ) -> Self {
        let bounds = [bounds_min, bounds_max];
        Self::fit_upright(bounds, direction, DVec3::Z, fovy_rad, [width, height])
    }

    /// Looks along `direction` (from the eye into the scene) at a box, given by its least and
    /// greatest corner, from the nearest position that shows all of it with a small margin, with
    /// `up` as far upwards as possible. The box is centred along the axis of the picture that
    /// limits the distance ([`View::centred`]: along both). A box without extent is seen from
    /// distance 1. `size` is that of the picture, pixels.
    pub fn fit_upright(
        [bounds_min, bounds_max]: [DVec3; 2],
        direction: DVec3,
        up: DVec3,
        fovy_rad: f64,
        [width, height]: [u32; 2],
    ) -> Self {
        let centre = bounds_min.midpoint(bounds_max);
        let half = (bounds_max - bounds_min) * 0.5;
        let forward = direction_or(direction, DVec3::NEG_Z);
        let world_from_view = axes(forward, up);
        let fovy_rad = clamp_fovy(fovy_rad);
        let tan_y = (fovy_rad * 0.5).tan();
        let tan = DVec2::new(tan_y * f64::from(width.max(1)) / f64::from(height.max(1)), tan_y);
        // From a distance d behind the centre and shifted by p, a corner v, in view space, is in
        // the picture if |v.x - p.x| is at most tan.x (d - v.z). So over all corners, the greatest
        // v.x + tan.x v.z, minus p.x, and the greatest tan.x v.z - v.x, plus p.x, are at most tan.x
        // d. The same holds for y.
        let mut ends = [DVec2::ZERO; 2];
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let v = world_from_view.transpose() * (DVec3::new(sign(0), sign(1), sign(2)) * half);
            ends[0] = ends[0].max(tan * v.z + v.xy());
            ends[1] = ends[1].max(tan * v.z - v.xy());
        }
        let beside = (ends[0] - ends[1]) * 0.5;
        let mut distance = ((ends[0] + ends[1]) * 0.5 / tan).max_element() * FIT_MARGIN;
        if !(distance.is_finite() && distance > 0.0) {
            distance = 1.0;
        }
        let target = centre + world_from_view * beside.extend(0.0);
        Self::look_at(target - forward * distance, target, up, fovy_rad, width, height)
    }

    /// Shifts the view so that a box, all of which is in front of the eye, has the same margin on
    /// the left and right, and above and below.
    pub fn centred(self, bounds_min: DVec3, bounds_max: DVec3) -> Self {
        let corners: [DVec3; 8] = std::array::from_fn(|corner| {
            let pick =
                |axis: usize| if corner >> axis & 1 == 1 { bounds_max } else { bounds_min }[axis];
            self.to_view(DVec3::new(pick(0), pick(1), pick(2)))
        });
        let [right, up] = [0, 1].map(|axis| middle(corners.map(|v| (v[axis], -v.z))));
        let by = self.world_from_view * DVec3::new(right, up, 0.0);
        Self { eye: self.eye + by, ..self }
    }

    /// The view with another margin; the shown part of the picture stays the same.
    pub fn with_margin(self, margin_px: u32) -> Self {
        if margin_px == self.margin_px {
            return self;
        }
        let side = |length: u32| {
            let shown = length.saturating_sub(self.margin_px.saturating_mul(2)).max(1);
            shown.saturating_add(margin_px.saturating_mul(2))
        };
        let (width, height) = (side(self.width), side(self.height));
        let more = f64::from(height) / f64::from(self.height);
        let fovy_rad = ((self.fovy_rad * 0.5).tan() * more).atan() * 2.0;
        Self { width, height, fovy_rad, margin_px, ..self }
    }

    /// Tangents of half the fields of view: horizontal, vertical.
    pub fn tan_half(&self) -> DVec2 {
        let y = (self.fovy_rad * 0.5).tan();
        DVec2::new(y * f64::from(self.width) / f64::from(self.height), y)
    }

    /// Pixels of a unit of length at unit eye depth; pixels are square.
    pub fn focal_px(&self) -> f64 {
        f64::from(self.height) * 0.5 / (self.fovy_rad * 0.5).tan()
    }

    /// Direction of the view, unit length.
    pub fn forward(&self) -> DVec3 {
        -self.world_from_view.z_axis
    }

    /// Rotation from world axes to view axes.
    pub fn view_from_world(&self) -> DMat3 {
        self.world_from_view.transpose()
    }

    /// Transforms a world point to view space: right, up, back.
    pub fn to_view(&self, world: DVec3) -> DVec3 {
        self.view_from_world() * (world - self.eye)
    }

    /// Eye depth of a world point: its distance along the view direction, the file's unit.
    pub fn depth(&self, world: DVec3) -> f64 {
        self.forward().dot(world - self.eye)
    }

    /// Projects a point of view space: x, y in pixels from the top left corner (pixel centres at
    /// one half), z its eye depth. `None` if it is nearer than the near plane.
    pub fn project_view(&self, v: DVec3) -> Option<DVec3> {
        let depth = -v.z;
        if depth.is_nan() || depth < self.near {
            return None;
        }
        let scale = self.focal_px() / self.parallel_at.unwrap_or(depth);
        Some(DVec3::new(
            f64::from(self.width) * 0.5 + v.x * scale,
            f64::from(self.height) * 0.5 - v.y * scale,
            depth,
        ))
    }

    /// Projects a world point, see [`View::project_view`].
    pub fn project(&self, world: DVec3) -> Option<DVec3> {
        self.project_view(self.to_view(world))
    }

    /// Whether a projected point lies on the picture.
    pub fn is_on_picture(&self, projected: DVec3) -> bool {
        (0.0..f64::from(self.width)).contains(&projected.x)
            && (0.0..f64::from(self.height)).contains(&projected.y)
    }
}

/// Right, up and back for a view along `forward` (unit length).
fn axes(forward: DVec3, up: DVec3) -> DMat3 {
    let back = -forward;
    let right = [up, DVec3::Z, DVec3::Y]
        .into_iter()
        .find_map(|up| sideways(forward, up))
        .unwrap_or(DVec3::X);
    DMat3::from_cols(right, back.cross(right), back)
}

/// Direction to the right; `None` if `up` is (nearly) along the view or not a direction.
fn sideways(forward: DVec3, up: DVec3) -> Option<DVec3> {
    let up = unit(up)?;
    let right = forward.cross(up);
    if right.length() < 1e-6 { None } else { unit(right) }
}

fn direction_or(v: DVec3, fallback: DVec3) -> DVec3 {
    unit(v).unwrap_or(fallback)
}

/// Unit vector, also of very short and very long ones; `None` for zero and for non-finite vectors.
fn unit(v: DVec3) -> Option<DVec3> {
    let greatest = v.abs().max_element();
    if !(greatest > 0.0 && v.is_finite()) {
        return None;
    }
    (v / greatest).try_normalize()
}

fn clamp_fovy(fovy_rad: f64) -> f64 {
    if fovy_rad.is_finite() { fovy_rad.clamp(FOVY_MIN_RAD, FOVY_MAX_RAD) } else { 1.0 }
}

/// Position of an eye from which the outermost points on both sides are equally far from the
/// picture's middle. Points are (beside, before): offsets from the eye to the side and along the
/// view. Moving to one side moves all points to the other, so bisection finds the position.
fn middle(points: [(f64, f64); 8]) -> f64 {
    let sum = |at: f64| {
        let places = points.map(|(beside, before)| (beside - at) / before.max(f64::MIN_POSITIVE));
        let greatest = places.into_iter().fold(f64::NEG_INFINITY, f64::max);
        greatest + places.into_iter().fold(f64::INFINITY, f64::min)
    };
    let beside = points.map(|(beside, _)| beside);
    let mut low = beside.into_iter().fold(f64::INFINITY, f64::min);
    let mut high = beside.into_iter().fold(f64::NEG_INFINITY, f64::max);
    for _ in 0..f64::MANTISSA_DIGITS {
        let at = low.midpoint(high);
        if sum(at) > 0.0 {
            low = at;
        } else {
            high = at;
        }
    }
    low.midpoint(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(range: f64) -> impl Strategy<Value = DVec3> {
        (-range..range, -range..range, -range..range).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn assert_orthonormal(m: DMat3) {
        assert!((m.determinant() - 1.0).abs() < 1e-9, "{m}");
        let identity = m.transpose() * m;
        assert!(identity.abs_diff_eq(DMat3::IDENTITY, 1e-9), "{identity}");
    }

    #[test]
    fn degenerate_directions_still_give_a_camera() {
        let ups = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::splat(f64::NAN)];
        let targets = [DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Z, DVec3::X * 1e-300];
        for up in ups {
            for target in targets {
                let view = View::look_at(DVec3::ZERO, target, up, 1.0, 64, 64);
                assert_orthonormal(view.world_from_view);
                assert!(view.near > 0.0);
            }
        }
    }

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        let view = View::look_at(DVec3::new(0.0, -10.0, 0.0), DVec3::ZERO, DVec3::Z, 1.0, 200, 100);
        let middle = view.project(DVec3::ZERO).unwrap();
        assert!(middle.abs_diff_eq(DVec3::new(100.0, 50.0, 10.0), 1e-9));
        assert!(view.project(DVec3::Z).unwrap().y < 50.0, "the world's up is up in the picture");
        assert!(view.project(DVec3::X).unwrap().x > 100.0, "the world's x is to the right");
        assert_eq!(view.project(DVec3::new(0.0, -10.0, 0.0)), None);
    }

    #[test]
    fn a_box_without_extent_can_be_fitted() {
        let p = DVec3::new(1e7, 2e7, 3.0);
        let view = View::fit(p, p, -DVec3::Z, 1.0, 10, 10);
        assert_orthonormal(view.world_from_view);
        assert!(view.is_on_picture(view.project(p).unwrap()));
    }

    proptest! {
        #[test]
        fn a_fitted_box_is_wholly_on_the_picture(
            a in vector(1e4), extent in vector(1e3), direction in vector(1.0),
            fovy in 0.1f64..2.5, width in 1u32..500, height in 1u32..500,
        ) {
            let b = a + extent.abs();
            let view = View::fit(a, b, direction, fovy, width, height);
            assert_orthonormal(view.world_from_view);
            let corners = (0..8u32).map(|corner| {
                let pick = |axis: usize| if corner >> axis & 1 == 1 { b[axis] } else { a[axis] };
                DVec3::new(pick(0), pick(1), pick(2))
            });
            for p in corners.clone() {
                let on = view.project(p);
                prop_assert!(on.is_some_and(|on| view.is_on_picture(on)), "{:?}", on);
            }
            let on = corners.clone().filter_map(|p| view.centred(a, b).project(p));
            let size = DVec2::new(f64::from(width), f64::from(height));
            let (mut low, mut high) = (size, DVec2::ZERO);
            for at in on.map(|on| on.truncate()) {
                (low, high) = (low.min(at), high.max(at));
            }
            prop_assert!((low / size - (1.0 - high / size)).abs().max_element() < 1e-6, "{} {}", low, high);
            prop_assert!((low / size).min_element() > -1e-6, "{} {}", low, high);
            // Without the margin the box touches two opposite sides: no nearer view shows all of
            // it.
            let middle = view.depth(a.midpoint(b));
            let ahead = -view.world_from_view.z_axis * middle * (1.0 - 1.0 / FIT_MARGIN);
            let nearest = View { eye: view.eye + ahead, ..view };
            let (mut low, mut high) = (size, DVec2::ZERO);
            for p in corners {
                // In the plane of the eye a corner is on the border, or anywhere.
                let v = nearest.to_view(p);
                prop_assume!(v.z < -1e-6 * middle);
                let at = size * 0.5 + DVec2::new(v.x, -v.y) / -v.z * nearest.focal_px();
                (low, high) = (low.min(at), high.max(at));
            }
            let spare = (low / size).max(1.0 - high / size);
            prop_assert!(spare.min_element().abs() < 1e-6 && (low / size).min(1.0 - high / size).min_element() > -1e-6, "{} {}", low, high);
        }

        #[test]
        fn to_view_keeps_lengths_and_depth_is_minus_z(eye in vector(1e6), target in vector(1e6), p in vector(1e6)) {
            let view = View::look_at(eye, target, DVec3::Z, 1.0, 640, 480);
            let v = view.to_view(p);
            prop_assert!((v.length() - (p - eye).length()).abs() < 1e-6);
            prop_assert!((view.depth(p) + v.z).abs() < 1e-6);
        }
    }
}
