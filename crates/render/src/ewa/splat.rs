//! From a disc or ellipse in space to what is evaluated in the picture: one record a splat, the same for the
//! CPU and the GPU (`shaders/ewa/`). Most splats are the paper's ellipses. A disc that reaches through the
//! near plane, or so far towards the eye that no affine approximation is any good, is evaluated by the
//! pixel's ray instead, where the paper drops it; one wholly before the near plane is culled by its depth,
//! for behind the eye a projection passes the test for an ellipse too.

use crate::ewa::mapping::{Conic, Mapping, amplitude, inverse, mapping};
use crate::simd::values::{Values, WHOLE};
use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};

/// Reach over depth from which a splat is evaluated by rays.
pub(crate) const REACH_MAX: f32 = 0.7;
/// Condition from which a splat is dropped: the eye lies in its plane as far as `f32` can tell.
pub(crate) const CONDITION_MAX: f32 = 1e6;
/// Reach over depth from which weights follow the exact projected Gaussian. Under it a centre is less than
/// this share of the splat's size from where it should be.
pub(crate) const MEND_REACH: f32 = 0.02;
/// How far the visibility pass moves a splat back, over its radius: what lies less than that behind the front
/// is blended with it.
pub(crate) const BACK: f32 = 1.0;

/// The camera, as splats need it.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle, pixels.
    pub centre_px: Vec2,
    /// Pixels in a row, rows.
    pub size: Vec2,
    /// What is nearer is not drawn.
    pub near: f32,
    /// Square of the cutoff times the low-pass's variance (square pixels), 0 without one.
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

/// What a splat is in the picture: a line of the cache.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Splat {
    /// Where its coordinates start, pixels from the picture's upper left.
    pub origin: [f32; 2],
    /// Of an ellipse: the conic ([`crate::ewa::mapping::Conic`]), the amplitude, which is negative where weights follow
    /// the exact Gaussian, least and greatest inverse depth.
    /// Of a splat evaluated by rays: the rows u and v of [`crate::ewa::mapping::Inverse`].
    pub form: [f32; 6],
    /// Inverse depth on its plane: at the origin, and its growth a pixel to the right and down.
    pub inverse_depth: [f32; 3],
    /// Of an ellipse: by how much the visibility pass lessens its inverse depth. Of one evaluated by rays: by
    /// how much it lengthens its depth, negative.
    pub back: f32,
    /// What it looks like.
    pub dye: Dye,
}

/// What a splat looks like.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Dye {
    /// Linear light.
    pub tint: [f32; 3],
    /// The world normal, turned to the eye ([`crate::ewa::place::unpacked`]); where the cloud has none, the radius in pixels as
    /// bits.
    pub normal: u32,
}

/// The pixels that a splat may touch: least and one past the greatest x, and y.
pub type Box4 = [u32; 4];

/// What becomes of a disc.
#[derive(Clone, Copy, Debug)]
pub enum Placed {
    /// It is drawn.
    Drawn(Splat, Box4),
    /// Nothing of it is in the picture.
    Outside,
    /// It cannot be evaluated.
    Dropped,
}

impl Disc {
    /// The disc of a normal (of unit length; none faces the eye) and a radius.
    #[inline(always)]
    pub fn round(centre: Vec3, normal: Vec3, radius: f32) -> Self {
        let normal = if normal == Vec3::ZERO { centre.normalize_or(Vec3::Z) } else { normal };
        let tangents = across(normal.to_array()).map(|t| Vec3::from_array(t) * radius);
        Self { centre, tangents, radius }
    }

    /// Equation 4.
    #[inline(always)]
    pub fn mapping(&self, focal_px: f32) -> Mapping {
        mapping(self.centre.to_array(), self.tangents.map(|t| t.to_array()), focal_px)
    }

    /// Half its extent in depth.
    #[inline(always)]
    fn depth_extent(&self) -> f32 {
        let [a, b] = self.tangents;
        (a.z * a.z + b.z * b.z).sqrt()
    }

    /// What it is in the picture; colour and normal are left to the caller.
    #[inline(always)]
    pub fn place(&self, lens: &Lens) -> Placed {
        let (depth, extent) = (self.centre.z, self.depth_extent());
        // What is not a number is in no range.
        if !(lens.near..f32::INFINITY).contains(&(depth + extent)) {
            return Placed::Outside;
        }
        if depth - extent >= lens.near && extent <= REACH_MAX * depth {
            ellipse(lens, self.centre.to_array(), self.tangents.map(|t| t.to_array()), self.radius)
                .placed(lens)
        } else {
            self.by_rays(lens)
        }
    }

    /// The same by rays.
    pub fn by_rays(&self, lens: &Lens) -> Placed {
        let Some([low, high]) = self.bounds_before_near(lens) else { return Placed::Outside };
        let Some(bounds) = lens.clip(low, high) else { return Placed::Outside };
        let [left, right, top, bottom] = bounds.map(|c| c as f32);
        let origin = Vec2::new((left + right) * 0.5, (top + bottom) * 0.5);
        let from = origin - lens.centre_px;
        let Some(rows) = inverse(self.centre, self.tangents, lens.focal_px, from) else {
            return Placed::Dropped;
        };
        let z = rows.inverse_depth;
        let splat = Splat {
            origin: origin.to_array(),
            form: [rows.u.x, rows.u.y, rows.u.z, rows.v.x, rows.v.y, rows.v.z],
            inverse_depth: [z.z, z.x, z.y],
            back: -back(self.radius, self.centre.length() / self.centre.z.abs()),
            ..Splat::default()
        };
        if splat.is_finite() { Placed::Drawn(splat, bounds) } else { Placed::Dropped }
    }

    /// A box around what of the disc is behind the near plane, in the picture: that of an octagon around it,
    /// clipped.
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

/// How much longer a depth gets where it moves back along its line of sight; `stretch` is distance over depth.
#[inline(always)]
fn back<T: Values>(radius: T, stretch: T) -> T {
    // A centre beside the eye still hides what is behind it.
    radius * BACK / stretch.min(radius.like(10.0))
}

/// The ellipse that a disc, or each of several, is in the picture, before it is known whether it is any.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse<T> {
    /// As in [`Splat`].
    pub origin: [T; 2],
    /// As in [`Splat`].
    pub form: [T; 6],
    /// As in [`Splat`].
    pub inverse_depth: [T; 3],
    /// As in [`Splat`].
    pub back: T,
    /// Half the width and height of its box.
    pub half: [T; 2],
    /// Condition of its mapping.
    pub condition: T,
}

/// The ellipse of a disc: its centre, tangents and radius.
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
    let origin = [at[0] + lens.centre_px.x, at[1] + lens.centre_px.y];
    // What rounding may take from wide ones.
    let half = filter.bounds().map(|h| h * 1.000_002);
    let conic = filter.conic();
    let (nearness, reach) = (m.nearness, m.reach());
    // Over the discriminant, 1 less the square of the reach.
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
            // Negative where it is mended.
            amplitude.copysign(radius.like(MEND_REACH) - reach),
            nearness_over * (one - reach),
            nearness_over * (one + reach),
        ],
        inverse_depth: [at_origin, slope[0], slope[1]],
        back: nearness * back / (centre[2] + back),
        half,
        condition: m.condition(),
    }
}

impl Ellipse<f32> {
    fn placed(&self, lens: &Lens) -> Placed {
        let (origin, half) = (Vec2::from_array(self.origin), Vec2::from_array(self.half));
        let Some(bounds) = lens.clip(origin - half, origin + half) else { return Placed::Outside };
        // What is not a number is in no range.
        if !(0.0..CONDITION_MAX).contains(&self.condition) {
            return Placed::Dropped;
        }
        let Self { origin, form, inverse_depth, back, .. } = *self;
        let splat = Splat { origin, form, inverse_depth, back, ..Splat::default() };
        if splat.is_finite() { Placed::Drawn(splat, bounds) } else { Placed::Dropped }
    }
}

/// Inverse depth, over the disc's least and of its greatest over it, up to where a splat's plane is followed over
/// what the low-pass adds. There it is still the surface, so that on floors seen flat the splats of rows farther
/// off and nearer don't hide each other; but seen edge-on a plane is anywhere.
pub const WIDENED: f32 = 0.875;
/// Amplitudes are at least this: the least sum of weights that is divided by stays far from 0.
pub(crate) const AMPLITUDE_MIN: f32 = 1e-12;

/// Half the side of an octagon around a circle, with something for rounding.
pub(crate) const HALF: f32 = 0.414_22;
/// Rounding of places in the picture.
pub(crate) const MARGIN: f32 = 0.01;

/// First pixels whose middles are past the least and the greatest of places, in a picture of so many pixels, with
/// [`WHOLE`] added; a middle that is the place itself may be either's. What is not a number is 0.
#[inline(always)]
pub(super) fn edges<V: Values>(low: V, high: V, size: f32) -> [V; 2] {
    [low - MARGIN, high + MARGIN].map(|at| at.max(at.like(0.0)).min(at.like(size)) + WHOLE)
}

impl Lens {
    /// The pixels whose centres lie in a box; `None` where none does.
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

    /// Whether it is an ellipse whose weights need no mending.
    #[inline(always)]
    pub fn is_plain(&self) -> bool {
        self.back > 0.0 && self.form[3] > 0.0
    }

    /// What a place in the picture sees of it: the square of the place in the splat, 1 at the cutoff, and the
    /// inverse depth on its plane; `None` outside. [`crate::ewa::blend`] does the same for several pixels at once.
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
        (squared < 1.0).then(|| [self.mended(squared, inverse_depth), inverse_depth])
    }

    /// What a weight is made from: where it pays, the place that the exact projected Gaussian has. Section 4.4's
    /// conic is that of the plane times the square of the inverse depth, so what a weight lacks to the cutoff
    /// goes by that.
    #[inline(always)]
    fn mended(&self, squared: f32, inverse_depth: f32) -> f32 {
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
        // A sum with something infinite or not a number in it is so itself.
        let sum: f32 = self.form.iter().chain(&self.inverse_depth).map(|v| v * 0.0).sum();
        sum == 0.0 && self.back != 0.0
    }
}

/// Two directions of unit length across one, and across each other (after Duff and others, Building an
/// Orthonormal Basis, Revisited, 2017).
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
