//! From a disc or ellipse in space to what is evaluated in the picture: one record a splat, the same for the
//! CPU and the GPU (`shaders/ewa/`). Most splats are the paper's ellipses. A disc that reaches through the
//! near plane, or so far towards the eye that no affine approximation is any good, is evaluated by the
//! pixel's ray instead, where the paper drops it; one wholly before the near plane is culled by its depth,
//! for behind the eye a projection passes the test for an ellipse too.

use super::mapping::{Conic, Mapping, Shape, amplitude, inverse, mapping};
use glam::{Vec2, Vec3};

/// Reach over depth from which a splat is evaluated by rays.
const REACH_MAX: f32 = 0.7;
/// Condition from which a splat is dropped: the eye lies in its plane as far as `f32` can tell.
const CONDITION_MAX: f32 = 1e6;
/// Reach over depth from which weights follow the exact projected Gaussian. Under it a centre is less than
/// this share of the splat's size from where it should be.
const MEND_REACH: f32 = 0.02;
/// How far the visibility pass moves a splat back, over its radius: what lies less than that behind the front
/// is blended with it.
const BACK: f32 = 1.0;

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

/// What a splat is in the picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Splat {
    /// Where its coordinates start, pixels from the picture's upper left.
    pub origin: [f32; 2],
    /// Of an ellipse: the conic ([`super::mapping::Conic`]), the amplitude, which is negative where weights follow
    /// the exact Gaussian, least and greatest inverse depth.
    /// Of a splat evaluated by rays: the rows u and v of [`super::mapping::Inverse`].
    pub form: [f32; 6],
    /// Inverse depth on its plane: at the origin, and its growth a pixel to the right and down.
    pub inverse_depth: [f32; 3],
    /// Of an ellipse: by how much the visibility pass lessens its inverse depth. Of one evaluated by rays: by
    /// how much it lengthens its depth, negative.
    pub back: f32,
    /// Linear light.
    pub tint: [f32; 3],
    /// Its world normal, turned to the eye ([`super::place::packed`]); where the cloud has none, its radius in pixels as bits.
    pub normal: u32,
}

/// The pixels that a splat may touch: least and one past the greatest x, and y.
pub type Box4 = [u16; 4];

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
        let (u, v) = across(normal);
        Self { centre, tangents: [u * radius, v * radius], radius }
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
            self.ellipse(lens)
        } else {
            self.by_rays(lens)
        }
    }

    /// How much longer a depth gets where it moves back along its line of sight; `stretch` is distance over depth.
    #[inline(always)]
    fn back(&self, stretch: f32) -> f32 {
        // A centre beside the eye still hides what is behind it.
        BACK * self.radius / stretch.min(10.0)
    }

    #[inline(always)]
    fn ellipse(&self, lens: &Lens) -> Placed {
        let depth = self.centre.z;
        let m: Mapping = mapping(self.centre, self.tangents, lens.focal_px);
        let kernel: Shape = m.isocontour();
        let filter = kernel.with_lowpass(lens.lowpass);
        let origin = m.centre + m.middle() + lens.centre_px;
        // What rounding may take from wide ones.
        let half = filter.bounds() * 1.000_002;
        let Some(bounds) = lens.clip(origin - half, origin + half) else { return Placed::Outside };
        // What is not a number is in no range.
        if !(0.0..CONDITION_MAX).contains(&m.condition()) {
            return Placed::Dropped;
        }
        let conic = filter.conic();
        let (nearness, reach) = (m.nearness, m.reach());
        let slope = m.inverse_depth_slope() * nearness;
        let back = self.back(m.stretch);
        let is_mended = reach > MEND_REACH;
        let amplitude = amplitude(&kernel, &filter).max(AMPLITUDE_MIN);
        let splat = Splat {
            origin: origin.to_array(),
            form: [
                conic.across,
                conic.shear,
                conic.along,
                if is_mended { -amplitude } else { amplitude },
                nearness / (1.0 + reach),
                nearness / (1.0 - reach),
            ],
            inverse_depth: [nearness + slope.dot(m.middle()), slope.x, slope.y],
            back: nearness * back / (depth + back),
            ..Splat::default()
        };
        if splat.is_finite() { Placed::Drawn(splat, bounds) } else { Placed::Dropped }
    }

    fn by_rays(&self, lens: &Lens) -> Placed {
        let Some([low, high]) = self.bounds_before_near(lens) else { return Placed::Outside };
        let Some(bounds) = lens.clip(low, high) else { return Placed::Outside };
        let [left, right, top, bottom] = bounds.map(f32::from);
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
            back: -self.back(self.centre.length() / self.centre.z.abs()),
            ..Splat::default()
        };
        if splat.is_finite() { Placed::Drawn(splat, bounds) } else { Placed::Dropped }
    }

    /// A box around what of the disc is behind the near plane, in the picture: that of an octagon around it,
    /// clipped.
    fn bounds_before_near(&self, lens: &Lens) -> Option<[Vec2; 2]> {
        /// Half the side of an octagon around a circle, with something for rounding.
        const HALF: f32 = 0.414_22;
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

/// Inverse depth, over the disc's least and of its greatest over it, up to where a splat's plane is followed over
/// what the low-pass adds. There it is still the surface, so that on floors seen flat the splats of rows farther
/// off and nearer don't hide each other; but seen edge-on a plane is anywhere.
pub const WIDENED: f32 = 0.875;
/// Amplitudes are at least this: the least sum of weights that is divided by stays far from 0.
const AMPLITUDE_MIN: f32 = 1e-12;

impl Lens {
    /// The pixels whose centres lie in a box; `None` where none does.
    #[inline(always)]
    fn clip(&self, low: Vec2, high: Vec2) -> Option<Box4> {
        /// Rounding of places in the picture.
        const MARGIN: f32 = 0.01;
        // Pixels from the first whose middle is right of `low`; `as` rounds down and takes what is not a number
        // for 0, where nothing is inside.
        let past = |place: f32, size: f32| (place + 0.5).clamp(0.0, size) as u16;
        let (left, right) = (past(low.x - MARGIN, self.size.x), past(high.x + MARGIN, self.size.x));
        let (top, bottom) = (past(low.y - MARGIN, self.size.y), past(high.y + MARGIN, self.size.y));
        (left < right && top < bottom).then_some([left, right, top, bottom])
    }
}

impl Splat {
    /// Whether it is evaluated by rays.
    #[inline(always)]
    pub fn is_by_rays(&self) -> bool {
        self.back < 0.0
    }

    /// What a place in the picture sees of it: the square of the place in the splat, 1 at the cutoff, and the
    /// inverse depth on its plane; `None` outside. [`super::blend`] does the same for several pixels at once.
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
fn across(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let u = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let v = Vec3::new(b, sign + n.y * n.y * a, -n.y);
    (u, v)
}
