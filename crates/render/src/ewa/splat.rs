//! From a disc or ellipse in space to the record of its splat, which is evaluated in the picture;
//! the record is the same on the CPU and the GPU (`shaders/ewa/`). Most splats are the ellipses of
//! `zwicker2004`. A disc that reaches through the near plane, or so far towards the eye that the
//! affine approximation fails, is evaluated by the ray of each pixel, where the paper drops it. A
//! disc wholly before the near plane is culled by its depth, since the projection of a disc behind
//! the eye may pass as an ellipse.

use crate::ewa::mapping::{Conic, Mapping, amplitude, inverse, mapping};
use crate::simd::values::{Values, WHOLE, dot};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// Extent in depth over depth above which a splat is evaluated by rays.
pub(crate) const REACH_MAX: f32 = 0.7;
/// Condition number from which a splat is dropped: in `f32` the eye lies in its plane.
pub(crate) const CONDITION_MAX: f32 = 1e6;
/// Extent in depth over depth above which weights follow the exact projected Gaussian. Below it,
/// the centre of the ellipse is off by less than this share of the size of the splat.
pub(crate) const EXACT_REACH: f32 = 0.02;
/// Distance over radius by which the visibility pass moves a splat back: splats that lie less than
/// that behind the front are blended with it.
pub(crate) const BACK: f32 = 1.0;

/// Width of a splat on a fitted plane across the slope, over that of a disc on the plane: discs
/// that are turned wholly would open gaps of uneven points that discs facing the eye close.
pub(crate) const ACROSS_SLOPE: f32 = 1.5;

/// Projection of splats.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// Centre of the picture, pixels; of the whole picture where a window of it is drawn.
    pub centre_px: Vec2,
    /// First column and row of the window in the whole picture, pixels.
    pub origin_px: Vec2,
    /// Width and height of the picture, pixels.
    pub size: Vec2,
    /// Depth of the near plane.
    pub near: f32,
    /// Square of the cutoff times the variance of the low-pass filter (square pixels); 0 without a
    /// filter.
    pub lowpass: f32,
}

/// A disc or ellipse in space, right, down and depth from the eye.
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// Its centre.
    pub centre: Vec3,
    /// From the centre to the cutoff.
    pub tangents: [Vec3; 2],
    /// Mean length of the tangents.
    pub radius: f32,
}

/// The record of a splat in the picture, one cache line long.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Splat {
    /// Origin of its coordinates, pixels from the upper left corner of the picture.
    pub origin: [f32; 2],
    /// Ellipse: its [`crate::ewa::mapping::Conic`]; its amplitude, negative where weights follow
    /// the exact Gaussian; its least and greatest inverse depth. Splat evaluated by rays: the rows
    /// u and v of [`crate::ewa::mapping::Inverse`].
    pub form: [f32; 6],
    /// Inverse depth on its plane: at the origin, and its growth per pixel to the right and down.
    pub inverse_depth: [f32; 3],
    /// Ellipse: what the visibility pass subtracts from its inverse depth. Splat evaluated by rays:
    /// the negative of what that pass adds to its depth.
    pub back: f32,
    /// Its colour and normal.
    pub attributes: SplatAttributes,
}

/// Attributes of a splat that are blended.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SplatAttributes {
    /// Colour, linear light.
    pub tint: [f32; 3],
    /// World normal, turned to the eye, of ten bits a component; in clouds without normals the bits
    /// of the radius in pixels.
    pub normal: u32,
}

/// Bounds of the pixels that a splat may touch: least x, one past the greatest x, and the same of
/// y.
pub type Box4 = [u32; 4];

/// The projection of a disc.
#[derive(Clone, Copy, Debug)]
pub enum Placement {
    /// The disc is drawn as this splat within these bounds.
    Drawn(Splat, Box4),
    /// The disc is outside the picture.
    Outside,
    /// The splat cannot be evaluated in `f32`.
    Dropped,
}

impl Disc {
    /// A round disc. `normal` has unit length; a disc whose normal is zero faces the eye.
    #[inline(always)]
    pub fn round(centre: Vec3, normal: Vec3, radius: f32) -> Self {
        let normal = if normal == Vec3::ZERO { centre.normalize_or(Vec3::Z) } else { normal };
        let tangents = across(normal.to_array()).map(|t| Vec3::from_array(t) * radius);
        Self { centre, tangents, radius }
    }

    /// Its mapping to the picture (equation 4).
    #[inline(always)]
    pub fn mapping(&self, focal_px: f32) -> Mapping {
        mapping(self.centre.to_array(), self.tangents.map(|t| t.to_array()), focal_px)
    }

    /// Half of its extent in depth.
    #[inline(always)]
    fn depth_extent(&self) -> f32 {
        let [a, b] = self.tangents;
        (a.z * a.z + b.z * b.z).sqrt()
    }

    /// Projects the disc; the caller sets the attributes of the splat.
    #[inline(always)]
    pub fn place(&self, lens: &Lens) -> Placement {
        let (depth, extent) = (self.centre.z, self.depth_extent());
        // NaN is in no range.
        if !(lens.near..f32::INFINITY).contains(&(depth + extent)) {
            return Placement::Outside;
        }
        if depth - extent >= lens.near && extent <= REACH_MAX * depth {
            ellipse(lens, self.centre.to_array(), self.tangents.map(|t| t.to_array()), self.radius)
                .placement(lens)
        } else {
            self.by_rays(lens)
        }
    }

    /// Projects the disc to a splat that is evaluated by rays.
    pub fn by_rays(&self, lens: &Lens) -> Placement {
        let Some([low, high]) = self.bounds_before_near(lens) else { return Placement::Outside };
        let Some(bounds) = lens.clip(low, high) else { return Placement::Outside };
        let origin = lens.middle_of(low, high);
        let from = origin - lens.centre_px;
        let Some(rows) = inverse(self.centre, self.tangents, lens.focal_px, from) else {
            return Placement::Dropped;
        };
        let z = rows.inverse_depth;
        let splat = Splat {
            origin: origin.to_array(),
            form: [rows.u.x, rows.u.y, rows.u.z, rows.v.x, rows.v.y, rows.v.z],
            inverse_depth: [z.z, z.x, z.y],
            back: -back(self.radius, self.centre.length() / self.centre.z.abs()),
            ..Splat::default()
        };
        if splat.is_finite() { Placement::Drawn(splat, bounds) } else { Placement::Dropped }
    }

    /// Bounds in the picture of the part of the disc behind the near plane: those of a
    /// circumscribed octagon that is clipped at the near plane.
    fn bounds_before_near(&self, lens: &Lens) -> Option<[Vec2; 2]> {
        const CORNERS: [[f32; 2]; 8] = [
            [1.0, HALF],
            [HALF, 1.0],
            [-HALF, 1.0],
            [-1.0, HALF],
            [-1.0, -HALF],
            [-HALF, -1.0],
            [HALF, -1.0],
            [1.0, -HALF],
        ];
        let [a, b] = self.tangents;
        let corner = |k: usize| self.centre + a * CORNERS[k & 7][0] + b * CORNERS[k & 7][1];
        let (mut low, mut high) = (Vec2::splat(f32::INFINITY), Vec2::splat(f32::NEG_INFINITY));
        let mut add = |p: Vec3| {
            let at = Vec2::new(p.x, p.y) * (lens.focal_px / p.z);
            (low, high) = (low.min(at), high.max(at));
        };
        for k in 0..8 {
            let (p, q) = (corner(k), corner(k + 1));
            if p.z >= lens.near {
                add(p);
            }
            if (p.z >= lens.near) != (q.z >= lens.near) {
                let mut cut = p + (q - p) * ((lens.near - p.z) / (q.z - p.z));
                cut.z = lens.near;
                add(cut);
            }
        }
        (low.x <= high.x).then(|| [low + lens.centre_px, high + lens.centre_px])
    }
}

/// Growth of a depth that moves back along its line of sight by [`BACK`] radii; `stretch` is
/// distance over depth.
#[inline(always)]
fn back<T: Values>(radius: T, stretch: T) -> T {
    // The bound keeps the distance positive for centres beside the eye.
    radius * BACK / stretch.min(radius.like(10.0))
}

/// The projection of a disc, or of several, as an ellipse. Whether it is one is checked afterwards.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse<T> {
    /// See [`Splat::origin`].
    pub origin: [T; 2],
    /// See [`Splat::form`].
    pub form: [T; 6],
    /// See [`Splat::inverse_depth`].
    pub inverse_depth: [T; 3],
    /// See [`Splat::back`].
    pub back: T,
    /// Half the width and height of its bounds.
    pub half: [T; 2],
    /// Condition number of its mapping.
    pub condition: T,
}

/// Projects a disc, or several, as an ellipse.
#[inline(always)]
pub fn ellipse<T: Values>(
    lens: &Lens,
    centre: [T; 3],
    tangents: [[T; 3]; 2],
    radius: T,
) -> Ellipse<T> {
    let one = radius.like(1.0);
    let m = mapping(centre, tangents, lens.focal_px);
    let kernel = m.isocontour();
    let filter = kernel.with_lowpass(lens.lowpass);
    let middle = m.middle();
    let at = [m.centre[0] + middle[0], m.centre[1] + middle[1]];
    let origin = lens.placed(at);
    // The factor makes up for rounding in wide ellipses.
    let half = filter.bounds().map(|h| h * 1.000_002);
    let conic = filter.conic();
    let (nearness, reach) = (m.nearness, m.reach());
    // The discriminant is 1 less the square of `reach`.
    let nearness_over = nearness / m.discriminant();
    let slope = m.inverse_depth_slope().map(|s| s * nearness);
    let back = back(radius, m.stretch);
    let amplitude = amplitude(&kernel, &filter).max(radius.like(AMPLITUDE_MIN));
    let at_origin = nearness + (slope[0] * middle[0] + slope[1] * middle[1]);
    Ellipse {
        origin,
        form: [
            conic.across,
            conic.shear,
            conic.along,
            // Negative where weights follow the exact Gaussian.
            amplitude.copysign(radius.like(EXACT_REACH) - reach),
            nearness_over * (one - reach),
            nearness_over * (one + reach),
        ],
        inverse_depth: [at_origin, slope[0], slope[1]],
        back: nearness * back / (centre[2] + back),
        half,
        condition: m.condition(),
    }
}

/// Normal of a disc on a fitted plane, on which depth grows by `growth` per pixel to the right and
/// down: that of the plane, turned to the eye so far that the disc is [`ACROSS_SLOPE`] times as
/// wide across the slope. Right, down and depth; zero where there is no plane.
#[inline(always)]
pub fn widened_normal<T: Values>(focal_px: f32, centre: [T; 3], growth: [T; 2]) -> [T; 3] {
    let [right, down] = growth;
    let (zero, one) = (right.like(0.0), right.like(1.0));
    let scale = one / centre[2];
    let (x, y) = (centre[0] * scale, centre[1] * scale);
    // Per unit of the picture at unit depth.
    let (right, down) = (right * focal_px, down * focal_px);
    let away = -(right * x + down * y + 1.0);
    let plane = [right, down, away];
    let to_eye = (x * x + y * y + 1.0).sqrt();
    let to_eye = [-(x / to_eye), -(y / to_eye), -(one / to_eye)];
    let length = dot(plane, plane).sqrt();
    let cosine = dot(plane, to_eye) / length;
    let wide = (cosine.abs() * ACROSS_SLOPE).min(one);
    let sine = (one - cosine * cosine).max(zero).sqrt();
    let share = (one - wide * wide).max(zero).sqrt() / sine;
    let part = |k: usize| (plane[k] / length - to_eye[k] * cosine) * share + to_eye[k] * wide;
    let is_plane = zero.cmplt(right.abs() + down.abs()) & zero.cmplt(sine);
    let or_zero = |own: T| T::select(is_plane, own, zero);
    [or_zero(part(0)), or_zero(part(1)), or_zero(part(2))]
}

impl<T: Values> Ellipse<T> {
    /// Makes depths follow a plane through the centre of the disc instead of that of the disc.
    /// `growth` is the relative growth of depth per pixel to the right and down; with
    /// zeros nothing changes.
    #[inline(always)]
    pub fn along_plane(self, centre: [T; 3], growth: [T; 2], lens: &Lens) -> Self {
        let zero = growth[0].like(0.0);
        let nearness = zero.like(1.0) / centre[2];
        let scale = nearness * lens.focal_px;
        let [x, y] = lens.placed([centre[0] * scale, centre[1] * scale]);
        let middle = [self.origin[0] - x, self.origin[1] - y];
        let slope = [-(growth[0] * nearness), -(growth[1] * nearness)];
        let at_origin = nearness + (slope[0] * middle[0] + slope[1] * middle[1]);
        // Greatest change of the inverse depth within the bounds of the ellipse.
        let reach = slope[0].abs() * self.half[0] + slope[1].abs() * self.half[1];
        let least = (nearness - reach).max(nearness * (1.0 - REACH_MAX));
        let is_plane = zero.cmplt(growth[0].abs() + growth[1].abs());
        let or = |own: T, old: T| T::select(is_plane, own, old);
        let [across, shear, along, amplitude, old_least, old_greatest] = self.form;
        let [z, z_x, z_y] = self.inverse_depth;
        Self {
            form: [
                across,
                shear,
                along,
                or(amplitude.abs(), amplitude),
                or(least, old_least),
                or(nearness + reach, old_greatest),
            ],
            inverse_depth: [or(at_origin, z), or(slope[0], z_x), or(slope[1], z_y)],
            ..self
        }
    }
}

impl Ellipse<f32> {
    fn placement(&self, lens: &Lens) -> Placement {
        let (origin, half) = (Vec2::from_array(self.origin), Vec2::from_array(self.half));
        let Some(bounds) = lens.clip(origin - half, origin + half) else {
            return Placement::Outside;
        };
        // NaN is in no range.
        if !(0.0..CONDITION_MAX).contains(&self.condition) {
            return Placement::Dropped;
        }
        let Self { origin, form, inverse_depth, back, .. } = *self;
        let splat = Splat { origin, form, inverse_depth, back, ..Splat::default() };
        if splat.is_finite() { Placement::Drawn(splat, bounds) } else { Placement::Dropped }
    }
}

/// Bound on how far the plane of a splat is followed over the pixels that the low-pass adds: its
/// inverse depth there is at least this factor of the least one of the disc, and at most the
/// greatest one over this factor. Near the horizon the low-pass covers rows of the surface that lie
/// farther off and nearer, which would hide each other without the plane; the bound is for planes
/// seen edge-on (`docs/design/splats.md`).
pub const WIDENED: f32 = 0.875;
/// Least amplitude, which keeps sums of weights, which are divided by, away from 0.
pub(crate) const AMPLITUDE_MIN: f32 = 1e-12;

/// Half the side of an octagon around the unit circle, rounded up.
pub(crate) const HALF: f32 = 0.414_22;
/// Bound on the rounding of positions in the picture, pixels.
pub(crate) const MARGIN: f32 = 0.01;

/// First pixels whose centres lie beyond `low` and beyond `high`, clamped to a picture of `size`
/// pixels, with [`WHOLE`] added. A pixel with its centre exactly there may be in or out. NaN
/// becomes 0.
#[inline(always)]
pub(super) fn edges<V: Values>(low: V, high: V, size: f32) -> [V; 2] {
    [low - MARGIN, high + MARGIN].map(|at| at.max(at.like(0.0)).min(at.like(size)) + WHOLE)
}

impl Lens {
    /// Place on the picture from that relative to its centre, pixels. It is rounded on the whole
    /// picture, alike in all of its windows.
    #[inline(always)]
    pub(super) fn placed<T: Values>(&self, [x, y]: [T; 2]) -> [T; 2] {
        let Self { centre_px, origin_px, .. } = *self;
        [
            x + (centre_px.x + origin_px.x) - origin_px.x,
            y + (centre_px.y + origin_px.y) - origin_px.y,
        ]
    }

    /// Middle of the pixels of the whole picture whose centres lie between `low` and `high`.
    fn middle_of(&self, low: Vec2, high: Vec2) -> Vec2 {
        let size = (self.centre_px + self.origin_px) * 2.0;
        let middle = |i: usize| {
            let shift = self.origin_px[i];
            let [first, past] =
                edges(low[i] + shift, high[i] + shift, size[i]).map(|at| at - WHOLE);
            (first + past) * 0.5 - shift
        };
        Vec2::new(middle(0), middle(1))
    }

    /// The pixels whose centres lie between `low` and `high`; `None` if there are none.
    #[inline(always)]
    fn clip(&self, low: Vec2, high: Vec2) -> Option<Box4> {
        let [[left, right], [top, bottom]] =
            [0, 1].map(|i| edges(low[i], high[i], self.size[i]).map(|at| (at - WHOLE) as u32));
        (left < right && top < bottom).then_some([left, right, top, bottom])
    }
}

impl Splat {
    /// Whether it is evaluated by rays.
    #[inline(always)]
    pub fn is_by_rays(&self) -> bool {
        self.back < 0.0
    }

    /// Whether it is an ellipse whose weights follow the affine approximation.
    #[inline(always)]
    pub fn is_plain(&self) -> bool {
        self.back > 0.0 && self.form[3] > 0.0
    }

    /// Evaluates the splat at `place` in the picture: the squared distance from its centre, 1 at
    /// the cutoff, and the inverse depth on its plane; `None` outside. The blend pass does this for
    /// several pixels at once.
    pub fn at(&self, place: Vec2, near: f32) -> Option<[f32; 2]> {
        let d = place - Vec2::from_array(self.origin);
        let [z, z_x, z_y] = self.inverse_depth;
        let plane = z_x * d.x + (z + z_y * d.y);
        let [squared, inverse_depth] = if self.is_by_rays() {
            let [ux, uy, u, vx, vy, v] = self.form;
            let (u, v) = ((ux * d.x + (u + uy * d.y)) / plane, (vx * d.x + (v + vy * d.y)) / plane);
            let is_seen = plane > 0.0 && plane <= 1.0 / near;
            [if is_seen { u * u + v * v } else { f32::INFINITY }, plane]
        } else {
            let [across, shear, along, _, least, greatest] = self.form;
            let inverse_depth = plane.clamp(least * WIDENED, greatest / WIDENED);
            [Conic { across, shear, along }.at(d.x, d.y), inverse_depth]
        };
        (squared < 1.0).then(|| [self.exact_squared(squared, inverse_depth), inverse_depth])
    }

    /// Squared distance that the weight is computed from: that of the exact projected Gaussian
    /// where the affine approximation is too coarse. The conic of section 4.4 is that of the plane
    /// times the square of the inverse depth, so the difference to the cutoff scales with that
    /// square.
    #[inline(always)]
    fn exact_squared(&self, squared: f32, inverse_depth: f32) -> f32 {
        let [_, _, _, amplitude, least, greatest] = self.form;
        if self.is_by_rays() || amplitude > 0.0 {
            return squared;
        }
        let inverse_depth = inverse_depth.clamp(least, greatest);
        let lacking = (1.0 - squared) * (least * greatest) / (inverse_depth * inverse_depth);
        (1.0 - lacking).max(0.0)
    }

    #[inline(always)]
    fn is_finite(&self) -> bool {
        // A sum with an infinite or NaN term is not 0.
        let sum: f32 = self.form.iter().chain(&self.inverse_depth).map(|v| v * 0.0).sum();
        sum == 0.0 && self.back != 0.0
    }
}

/// Two unit vectors that form an orthonormal basis with `n` (`duff2017`).
#[inline(always)]
pub fn across<T: Values>(n: [T; 3]) -> [[T; 3]; 2] {
    let one = n[2].like(1.0);
    let sign = one.copysign(n[2]);
    let a = -one / (sign + n[2]);
    let b = n[0] * n[1] * a;
    let u = [one + sign * n[0] * n[0] * a, sign * b, -sign * n[0]];
    let v = [b, sign + n[1] * n[1] * a, -n[1]];
    [u, v]
}
