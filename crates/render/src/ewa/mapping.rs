//! From the tangent plane of a splat to the picture (`zwicker2004`, sections 4.1 to 4.4), one
//! function an equation. Lengths in the picture are pixels, x to the right and y down, from the
//! centre of the picture. All functions work on one splat or on several at once ([`Values`]).
//!
//! The printed formulas invert the mapping and then cancel large numbers. Here the mapping is first
//! moved to the projection of the splat's centre and divided by its depth. Then the *dual* conic is
//! formed, outer products of the tangents, which needs no inverse and leaves sums of squares only.
//! The determinant comes from that of the mapping ([`Mapping::area`]), not from a difference of
//! products of the conic's coefficients (`docs/design/splats.md`).

use crate::simd::values::{Values, dot};
use glam::{Vec2, Vec3};

/// The homogeneous mapping of equation 4, moved to the centre of the splat: the rows of `M`, with
/// the centre in the third.
#[derive(Clone, Copy, Debug)]
pub struct Mapping<T = f32> {
    /// Projection of the centre.
    pub centre: [T; 2],
    /// Inverse depth of the centre.
    pub nearness: T,
    /// Distance of the centre over its depth.
    pub stretch: T,
    /// First tangent: x and y in pixels at the centre's depth, z over that depth. It reaches from
    /// the centre to the cut-off isocontour.
    pub a: [T; 3],
    /// Second tangent.
    pub b: [T; 3],
    /// Product of the lengths of the rows before they were moved, in the units of
    /// [`Mapping::area`].
    pub lengths: T,
}

/// Computes the mapping of a splat (equation 4). `p` is its centre, `tangents` reach from there to
/// the cut-off isocontour; both are right, down and depth from the eye.
#[inline(always)]
pub fn mapping<T: Values>(p: [T; 3], tangents: [[T; 3]; 2], focal_px: f32) -> Mapping<T> {
    let inverse = p[2].like(1.0) / p[2];
    let slope = [p[0] * inverse, p[1] * inverse];
    let scale = inverse * focal_px;
    let [a, b] = [row(tangents[0], slope, scale, inverse), row(tangents[1], slope, scale, inverse)];
    let (u, v) = (length(tangents[0]) * scale, length(tangents[1]) * scale);
    let stretch = (slope[0] * slope[0] + slope[1] * slope[1] + 1.0).sqrt();
    let centre = [slope[0] * focal_px, slope[1] * focal_px];
    Mapping { centre, nearness: inverse, stretch, a, b, lengths: u * v * stretch }
}

/// Row of a tangent. Not a closure, which would be compiled for the baseline processor.
#[inline(always)]
fn row<T: Values>(t: [T; 3], slope: [T; 2], scale: T, inverse: T) -> [T; 3] {
    [(t[0] - slope[0] * t[2]) * scale, (t[1] - slope[1] * t[2]) * scale, t[2] * inverse]
}

#[inline(always)]
fn length<T: Values>(t: [T; 3]) -> T {
    dot(t, t).sqrt()
}

impl<T: Values> Mapping<T> {
    /// Determinant of the mapping: the signed area that the tangents span in the picture, at the
    /// depth of the centre. It is 0 where the eye lies in the plane of the splat, which then is
    /// invisible.
    #[inline(always)]
    pub fn area(&self) -> T {
        self.a[0] * self.b[1] - self.a[1] * self.b[0]
    }

    /// Square of [`Mapping::reach`].
    #[inline(always)]
    fn reach_squared(&self) -> T {
        self.a[2] * self.a[2] + self.b[2] * self.b[2]
    }

    /// Half the extent of the disc in depth, over the depth of its centre.
    #[inline(always)]
    pub fn reach(&self) -> T {
        self.reach_squared().sqrt()
    }

    /// Discriminant of the projected isocontour (section 4.2): positive for an ellipse, 0 for a
    /// parabola, negative for a hyperbola. It is 1 if the disc has the same depth everywhere.
    #[inline(always)]
    pub fn discriminant(&self) -> T {
        self.nearness.like(1.0) - self.reach_squared()
    }

    /// Condition number of the mapping, at least 1: Hadamard's condition number (the product of the
    /// lengths of its rows over its determinant), over the discriminant. It depends neither on the
    /// size of the splat nor on its distance.
    #[inline(always)]
    pub fn condition(&self) -> T {
        self.lengths / (self.area().abs() * self.discriminant().max(self.lengths.like(0.0)))
    }

    /// Centre of the projected isocontour (equation 7), relative to [`Mapping::centre`]. For
    /// ellipses.
    #[inline(always)]
    pub fn middle(&self) -> [T; 2] {
        let Self { a, b, .. } = *self;
        let scale = -(self.nearness.like(1.0) / self.discriminant());
        [(a[0] * a[2] + b[0] * b[2]) * scale, (a[1] * a[2] + b[1] * b[2]) * scale]
    }

    /// Growth of the inverse depth on the tangent plane per pixel, over the inverse depth of the
    /// centre. Infinite where the eye lies in the plane.
    #[inline(always)]
    pub fn inverse_depth_slope(&self) -> [T; 2] {
        let Self { a, b, .. } = *self;
        let scale = self.nearness.like(1.0) / self.area();
        [(a[1] * b[2] - a[2] * b[1]) * scale, (a[2] * b[0] - a[0] * b[2]) * scale]
    }

    /// Shape of the projected isocontour (equations 10 and 11), whose points `x`, relative to its
    /// centre, have `x shape^-1 x = 1`. It is the variance matrix R' = Q'''^-1 of the affine
    /// approximation times the square of the cutoff. For ellipses.
    #[inline(always)]
    pub fn isocontour(&self) -> Shape<T> {
        let Self { a, b, .. } = *self;
        let d = self.nearness.like(1.0) / self.discriminant();
        let m = self.middle();
        // With d = 1/discriminant and z the tangents' depths, the determinant is area^2 d^2 (1 +
        // z.z d), and 1 + z.z d = d.
        Shape {
            xx: (a[0] * a[0] + b[0] * b[0]) * d + m[0] * m[0],
            xy: (a[0] * a[1] + b[0] * b[1]) * d + m[0] * m[1],
            yy: (a[1] * a[1] + b[1] * b[1]) * d + m[1] * m[1],
            root: self.area().abs() * d * d.sqrt(),
        }
    }
}

/// A symmetric matrix with its determinant: the shape of an ellipse.
#[derive(Clone, Copy, Debug)]
pub struct Shape<T = f32> {
    /// First diagonal element.
    pub xx: T,
    /// Element beside the diagonal.
    pub xy: T,
    /// Second diagonal element.
    pub yy: T,
    /// Square root of the determinant.
    pub root: T,
}

impl<T: Values> Shape<T> {
    /// Shape of the resampling filter (equation 3). `h` is the variance of the low-pass filter
    /// (square pixels) times the square of the cutoff.
    #[inline(always)]
    pub fn with_lowpass(self, h: f32) -> Self {
        let (xx, yy) = (self.xx + h, self.yy + h);
        // det + h trace + h^2, without differences.
        let root = (self.root * self.root + (self.xx + self.yy) * h + h * h).sqrt();
        Self { xx, yy, root, ..self }
    }

    /// Half the width and height of the box around the ellipse (equations 8 and 9).
    #[inline(always)]
    pub fn bounds(&self) -> [T; 2] {
        [self.xx.sqrt(), self.yy.sqrt()]
    }

    /// The central conic (equation 10) as a sum of squares, in which nothing cancels.
    #[inline(always)]
    pub fn conic(&self) -> Conic<T> {
        let side = self.yy.sqrt();
        let along = side.like(1.0) / side;
        let inverse = side.like(1.0) / self.root;
        Conic { across: side * inverse, shear: self.xy * along * inverse, along }
    }
}

/// Amplitude of the resampling filter (equation 3, where it is printed inverted): the height of the
/// projected kernel after the low-pass, |R'|^(1/2) / |R' + H|^(1/2). With it, splats of different
/// tilt or size are weighted by their area in the picture.
#[inline(always)]
pub fn amplitude<T: Values>(kernel: &Shape<T>, filter: &Shape<T>) -> T {
    kernel.root / filter.root
}

/// A central conic: `(across x - shear y)^2 + (along y)^2 <= 1`.
#[derive(Clone, Copy, Debug)]
pub struct Conic<T = f32> {
    /// Factor of x.
    pub across: T,
    /// Factor of y in the same square.
    pub shear: T,
    /// Factor of y in the other square.
    pub along: T,
}

impl<T: Values> Conic<T> {
    /// Squared distance from the centre, over that of the isocontour in the same direction.
    #[inline(always)]
    pub fn at(&self, x: T, y: T) -> T {
        let (u, v) = (self.across * x - self.shear * y, self.along * y);
        u * u + v * v
    }
}

/// The exact mapping from the picture back to the tangent plane, for splats whose isocontour is no
/// ellipse or that are too near for the affine approximation: rows that are multiplied by the
/// homogeneous pixel (x, y, 1). The position of a pixel on the plane, in tangents, is `(u, v) /
/// inverse_depth`.
#[derive(Clone, Copy, Debug)]
pub struct Inverse {
    /// First coordinate over depth.
    pub u: Vec3,
    /// Second coordinate over depth.
    pub v: Vec3,
    /// Inverse depth.
    pub inverse_depth: Vec3,
}

/// Sine between the plane and the line of sight below which rounding decides what is visible.
pub(crate) const SINE_MIN: f32 = 1e-6;

/// Bits of the exponent of a number, and those of 1 twice.
pub(crate) const EXPONENT: u32 = 0x7f80_0000;
pub(crate) const TWICE_ONE: u32 = 254 << 23;

/// The power of two that brings a length to 1 to 2, so that products of lengths stay within `f32`
/// in any unit; 0 of infinity.
fn to_one(length: f32) -> f32 {
    f32::from_bits(TWICE_ONE - (length.to_bits() & EXPONENT).min(TWICE_ONE))
}

/// Inverse of equation 4 (`u = x M^-1`), relative to the position `from` in the picture; `None`
/// where the eye lies in the plane in `f32`.
#[inline]
pub fn inverse(p: Vec3, tangents: [Vec3; 2], focal_px: f32, from: Vec2) -> Option<Inverse> {
    let unit = to_one(p.abs().max_element());
    let p = p * unit;
    let [a, b] = tangents.map(|tangent| tangent * unit);
    let normal = a.cross(b);
    let seen = normal.dot(p);
    // NaN is in no range.
    if !(SINE_MIN..2.0).contains(&(seen.abs() / (normal.length() * p.length()))) {
        return None;
    }
    let row = |n: Vec3| {
        let n = n / seen * unit;
        let (x, y) = (n.x / focal_px, n.y / focal_px);
        Vec3::new(x, y, n.z + x * from.x + y * from.y)
    };
    Some(Inverse { u: row(b.cross(p)), v: row(p.cross(a)), inverse_depth: row(normal) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverses_in_any_unit_are_the_same_times_a_power_of_two() {
        let p = Vec3::new(3.0, -2.0, 1.5);
        let tangents = [Vec3::new(1.0, 0.5, 0.25), Vec3::new(-0.5, 1.0, 2.0)];
        let of = |unit: f32| {
            let tangents = tangents.map(|tangent| tangent * unit);
            let Inverse { u, v, inverse_depth } =
                inverse(p * unit, tangents, 300.0, Vec2::new(7.0, -9.0)).unwrap();
            [u, v, inverse_depth].map(|row| row * unit)
        };
        for log2 in [-60, -30, 30, 43, 60] {
            assert_eq!(of(2f32.powi(log2)), of(1.0), "2^{log2}");
        }
        assert!(inverse(p * f32::INFINITY, tangents, 300.0, Vec2::ZERO).is_none());
    }
}
