//! The reference: the formulas of zwicker2004 as printed (with R' = Q'''^-1), in `f64` and without
//! care for rounding; and the exact projection of a disc, by intersecting rays.

use crate::scene::Dice;
use esker_render::ewa::splat::{Disc, Lens};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};

/// A disc in `f64` with exactly the values of the `f32` disc.
#[derive(Clone, Copy)]
pub struct Exact {
    pub p: DVec3,
    pub a: DVec3,
    pub b: DVec3,
    pub focal: f64,
    /// Centre of the picture, pixels.
    pub centre: DVec2,
}

/// An ellipse in the picture: `(x - middle) q (x - middle) <= 1`.
#[derive(Clone, Copy)]
pub struct Ellipse {
    pub middle: DVec2,
    /// Coefficients A, B and C.
    pub q: [f64; 3],
}

impl Exact {
    pub fn new(disc: &Disc, lens: &Lens) -> Self {
        let [a, b] = disc.tangents.map(|t| t.as_dvec3());
        let centre = lens.centre_px.as_dvec2();
        Self { p: disc.centre.as_dvec3(), a, b, focal: f64::from(lens.focal_px), centre }
    }

    /// Projection of the centre, relative to the centre of the picture.
    fn projected(&self) -> DVec2 {
        self.p.truncate() * (self.focal / self.p.z)
    }

    /// Mapping of equation 4, transposed (the paper writes columns as rows), with the image plane
    /// at the focal length. The origin is the projected centre, because otherwise the printed
    /// formulas lose all digits to cancellation, even in `f64`.
    fn mapping(&self) -> DMat3 {
        let at = self.projected();
        let row = |v: DVec3| (v.truncate() * self.focal - at * v.z).extend(v.z);
        DMat3::from_cols(row(self.a), row(self.b), DVec3::Z * self.p.z)
    }

    /// Projected isocontour (equations 6 to 11), `None` if it is not an ellipse.
    pub fn isocontour(&self) -> Option<Ellipse> {
        let inverse = self.mapping().inverse();
        let q_h = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        let q = inverse.transpose() * q_h * inverse;
        let (a, b, c) = (q.x_axis.x, q.y_axis.x, q.y_axis.y);
        let (d, e, f) = (q.z_axis.x, q.z_axis.y, -q.z_axis.z);
        let discriminant = a * c - b * b;
        if discriminant <= 0.0 {
            return None;
        }
        let at = DVec2::new(b * e - c * d, b * d - a * e) / discriminant;
        let level = f - d * at.x - e * at.y;
        let q = [a / level, b / level, c / level];
        Some(Ellipse { middle: at + self.projected() + self.centre, q })
    }

    /// Middle of the projected isocontour, and squares of half its width and height, from its
    /// tangent lines: the inverse conic of a thin ellipse cancels, even in `f64`.
    pub fn extents(&self) -> (DVec2, DVec2) {
        let m = self.mapping();
        let dual = |i: usize, j: usize| {
            m.x_axis[i] * m.x_axis[j] + m.y_axis[i] * m.y_axis[j] - m.z_axis[i] * m.z_axis[j]
        };
        let middle = DVec2::new(dual(0, 2), dual(1, 2)) / dual(2, 2);
        let squares = middle * middle - DVec2::new(dual(0, 0), dual(1, 1)) / dual(2, 2);
        (middle + self.projected() + self.centre, squares)
    }

    /// Intersection of the ray through a place of the picture with the plane: coordinates in
    /// tangents, and depth.
    pub fn meets(&self, at: DVec2) -> (DVec2, f64) {
        let ray = ((at - self.centre) / self.focal).extend(1.0);
        let normal = self.a.cross(self.b);
        let depth = normal.dot(self.p) / normal.dot(ray);
        let on = ray * depth - self.p;
        let (aa, ab, bb) = (self.a.dot(self.a), self.a.dot(self.b), self.b.dot(self.b));
        let (oa, ob) = (on.dot(self.a), on.dot(self.b));
        let d = aa * bb - ab * ab;
        (DVec2::new(oa * bb - ob * ab, ob * aa - oa * ab) / d, depth)
    }

    /// Whether the ray meets the disc beyond the near plane.
    pub fn is_seen(&self, at: DVec2, near: f64) -> bool {
        let (u, depth) = self.meets(at);
        depth >= near && u.length_squared() <= 1.0
    }
}

impl Ellipse {
    /// Shape R', times the square of the cutoff.
    pub fn shape(&self) -> [f64; 3] {
        let [a, b, c] = self.q;
        let d = a * c - b * b;
        [c / d, -b / d, a / d]
    }

    /// The ellipse with a low-pass filter of variance `h` added.
    pub fn filtered(&self, h: f64) -> Self {
        let [xx, xy, yy] = self.shape();
        let (xx, yy) = (xx + h, yy + h);
        let d = xx * yy - xy * xy;
        Self { middle: self.middle, q: [yy / d, -xy / d, xx / d] }
    }

    pub fn at(&self, place: DVec2) -> f64 {
        let [a, b, c] = self.q;
        let d = place - self.middle;
        a * d.x * d.x + 2.0 * b * d.x * d.y + c * d.y * d.y
    }

    /// Signed distance to the isocontour, to first order, pixels; positive outside.
    pub fn distance(&self, place: DVec2) -> f64 {
        let [a, b, c] = self.q;
        let d = place - self.middle;
        let slope = 2.0 * DVec2::new(a * d.x + b * d.y, b * d.x + c * d.y);
        (self.at(place) - 1.0) / slope.length().max(1e-300)
    }

    /// A place on the ellipse.
    pub fn place(&self, angle: f64) -> DVec2 {
        let [xx, xy, yy] = self.shape();
        // A square root L of the shape: x = L (cos, sin).
        let l = xx.sqrt();
        let low = DVec2::new(l, xy / l);
        let rest = (yy - low.y * low.y).max(0.0).sqrt();
        self.middle + low * angle.cos() + DVec2::new(0.0, rest) * angle.sin()
    }
}

/// Lens of a picture of `width` x `height` pixels.
pub fn lens(width: u32, height: u32, focal_px: f32, near: f32, lowpass: f32) -> Lens {
    let size = Vec2::new(width as f32, height as f32);
    let origin_px = Vec2::ZERO;
    Lens { focal_px, centre_px: size * 0.5, origin_px, size, near, lowpass }
}

/// Greatest relative error of the coefficients of the conic in `f32`; `None` if it is not an
/// ellipse.
pub fn coefficient_error(disc: &Disc, lens: &Lens) -> Option<f64> {
    let exact = Exact::new(disc, lens).isocontour()?;
    let conic = disc.mapping(lens.focal_px).isocontour().conic();
    let [across, shear, along] = [conic.across, conic.shear, conic.along].map(f64::from);
    let q = [across * across, -across * shear, shear * shear + along * along];
    let [a, b, c] = exact.q;
    let errors = [(q[0] - a).abs() / a, (q[1] - b).abs() / (a * c).sqrt(), (q[2] - c).abs() / c];
    Some(errors.into_iter().fold(0.0, f64::max))
}

/// Random number whose logarithm is uniformly distributed.
pub fn log_even(dice: &mut Dice, low: f64, high: f64) -> f64 {
    (low.ln() + (high.ln() - low.ln()) * dice.unit()).exp()
}

pub fn direction(dice: &mut Dice) -> Vec3 {
    loop {
        let v = Vec3::from_array([0; 3].map(|_| (dice.unit() * 2.0 - 1.0) as f32));
        if v.length_squared() <= 1.0 && v.length_squared() > 1e-4 {
            return v.normalize_or_zero();
        }
    }
}

/// Random splat and camera: depths over six decades, up to 80 degrees off the axis, from far
/// smaller than a pixel to wider than the picture, a third edge on, half of them elliptical, some
/// around or behind the eye.
pub fn case(dice: &mut Dice) -> (Disc, Lens) {
    let lowpass = [0.0, 0.25, 2.25, 4.0][(dice.bits() % 4) as usize];
    let focal = log_even(dice, 40.0, 5000.0) as f32;
    let lens = lens(1024, 768, focal, 1e-3, lowpass);
    let depth = log_even(dice, 1e-2, 1e4) as f32;
    let at = Vec2::new(dice.unit() as f32, dice.unit() as f32) * 1.5 - 0.25;
    let slope = (at * lens.size - lens.centre_px) / focal;
    let slope = slope.clamp_length_max(5.7);
    let mut centre = Vec3::new(slope.x, slope.y, 1.0) * depth;
    let radius = depth * log_even(dice, 1e-6, 1.5) as f32;
    let mut normal = direction(dice);
    match dice.bits() % 6 {
        // Nearly edge-on.
        0 | 1 => {
            let edge = normal - centre * (normal.dot(centre) / centre.length_squared());
            let tilt = log_even(dice, 1e-5, 0.3) as f32;
            normal = (edge.normalize_or(Vec3::X) + centre.normalize_or_zero() * tilt)
                .normalize_or_zero();
        }
        // Around the plane of the camera, or behind it.
        2 if dice.bits().is_multiple_of(8) => {
            centre.z = (dice.unit() * 2.0 - 1.0) as f32 * radius * 2.0
        }
        _ => {}
    }
    let mut disc = Disc::round(centre, normal, radius);
    if dice.bits().is_multiple_of(2) {
        let [a, b] = disc.tangents;
        let turn = Vec2::from_angle(dice.unit() as f32 * 6.3);
        let thin = log_even(dice, 0.03, 1.0) as f32;
        disc.tangents = [a * turn.x + b * turn.y, (b * turn.x - a * turn.y) * thin];
    }
    (disc, lens)
}
