//! From a splat's tangent plane to the picture (zwicker2004 sections 4.1 to 4.4), each equation one function.
//! Lengths in the picture are pixels, x to the right and y down, from the picture's middle.
//!
//! The printed formulas invert the mapping and then cancel large numbers: in `f32` they miss by over a pixel
//! in a fifth of ordinary splats. Here the mapping is first moved to where the splat's own centre is projected
//! to and divided by its depth. Then the *dual* conic is formed, the tangents' outer products, which needs no
//! inverse: all that is left are sums of squares. The determinant comes from the mapping's own
//! ([`Mapping::area`]), never as a difference of products of the conic's coefficients.

use glam::{Vec2, Vec3};

/// The homogeneous mapping of equation 4, recentred: the rows of `M`, with the splat's centre in the third.
#[derive(Clone, Copy, Debug)]
pub struct Mapping {
    /// Where the centre is projected to.
    pub centre: Vec2,
    /// Inverse depth of the centre.
    pub nearness: f32,
    /// Distance of the centre over its depth.
    pub stretch: f32,
    /// First tangent: x and y in pixels at the centre's depth, z over that depth. It reaches from the centre
    /// to the cut-off isocontour.
    pub a: Vec3,
    /// Second tangent.
    pub b: Vec3,
    /// Product of the lengths of the rows before they were moved, in the units of [`Mapping::area`].
    pub lengths: f32,
}

/// Equation 4: the mapping of a splat. `p` is its centre, `tangents` reach from there to the cut-off
/// isocontour; right, down and depth from the eye.
#[inline(always)]
pub fn mapping(p: Vec3, tangents: [Vec3; 2], focal_px: f32) -> Mapping {
    let inverse = 1.0 / p.z;
    let slope = Vec2::new(p.x, p.y) * inverse;
    let row = |t: Vec3| {
        let across = (Vec2::new(t.x, t.y) - slope * t.z) * (focal_px * inverse);
        Vec3::new(across.x, across.y, t.z * inverse)
    };
    let [a, b] = tangents.map(row);
    let [u, v] = tangents.map(|t| t.length() * (focal_px * inverse));
    let stretch = (slope.length_squared() + 1.0).sqrt();
    let (centre, lengths) = (slope * focal_px, u * v * stretch);
    Mapping { centre, nearness: inverse, stretch, a, b, lengths }
}

impl Mapping {
    /// Determinant of the mapping: the signed area that the tangents span in the picture, at the centre's
    /// depth. Nothing is seen of a splat where it is 0: the eye lies in its plane.
    #[inline(always)]
    pub fn area(&self) -> f32 {
        self.a.x * self.b.y - self.a.y * self.b.x
    }

    /// Share of the depth by which the disc reaches before and behind its centre.
    #[inline(always)]
    pub fn reach(&self) -> f32 {
        (self.a.z * self.a.z + self.b.z * self.b.z).sqrt()
    }

    /// The discriminant of section 4.2, of the projected isocontour: positive for an ellipse, 0 for a
    /// parabola, negative for a hyperbola. 1 where the disc has the same depth everywhere.
    #[inline(always)]
    pub fn discriminant(&self) -> f32 {
        1.0 - (self.a.z * self.a.z + self.b.z * self.b.z)
    }

    /// How ill-conditioned the mapping is, 1 at best: Hadamard's condition number, the product of the lengths of
    /// its rows over its determinant, over the discriminant. Neither the splat's size nor its distance changes it.
    #[inline(always)]
    pub fn condition(&self) -> f32 {
        self.lengths / (self.area().abs() * self.discriminant().max(0.0))
    }

    /// Equation 7: the middle of the projected isocontour, from [`Mapping::centre`]. For ellipses.
    #[inline(always)]
    pub fn middle(&self) -> Vec2 {
        let (a, b) = (Vec2::new(self.a.x, self.a.y), Vec2::new(self.b.x, self.b.y));
        (a * self.a.z + b * self.b.z) * (-1.0 / self.discriminant())
    }

    /// Inverse depth on the tangent plane: its growth a pixel, over that of the centre. Infinite where the eye
    /// lies in the plane.
    #[inline(always)]
    pub fn inverse_depth_slope(&self) -> Vec2 {
        let Self { a, b, .. } = *self;
        Vec2::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z) / self.area()
    }

    /// Equations 10 and 11: the shape of the projected isocontour, whose points `x` from its middle have
    /// `x shape^-1 x = 1`. It is the variance matrix R' = Q'''^-1 of the affine approximation times the square
    /// of the cutoff. For ellipses.
    #[inline(always)]
    pub fn isocontour(&self) -> Shape {
        let Self { a, b, .. } = *self;
        let d = 1.0 / self.discriminant();
        let m = self.middle();
        // With d = 1/discriminant and z the tangents' depths, the determinant is area^2 d^2 (1 + z.z d),
        // and 1 + z.z d = d.
        Shape {
            xx: (a.x * a.x + b.x * b.x) * d + m.x * m.x,
            xy: (a.x * a.y + b.x * b.y) * d + m.x * m.y,
            yy: (a.y * a.y + b.y * b.y) * d + m.y * m.y,
            root: self.area().abs() * d * d.sqrt(),
        }
    }
}

/// A symmetric matrix with its determinant: the shape of an ellipse.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Coefficient.
    pub xx: f32,
    /// Coefficient.
    pub xy: f32,
    /// Coefficient.
    pub yy: f32,
    /// Square root of the determinant.
    pub root: f32,
}

impl Shape {
    /// The shape of the resampling filter (equation 3): the low-pass of variance `lowpass` (square pixels)
    /// times the square of the cutoff is added, `h` of both.
    #[inline(always)]
    pub fn with_lowpass(self, h: f32) -> Self {
        let (xx, yy) = (self.xx + h, self.yy + h);
        // det + h trace + h^2; no difference in it.
        let root = (self.root * self.root + h * (self.xx + self.yy) + h * h).sqrt();
        Self { xx, yy, root, ..self }
    }

    /// Equations 8 and 9: half the width and height of the box around the ellipse.
    #[inline(always)]
    pub fn bounds(&self) -> Vec2 {
        Vec2::new(self.xx.sqrt(), self.yy.sqrt())
    }

    /// The central conic (equation 10) as a sum of squares, which cannot cancel.
    #[inline(always)]
    pub fn conic(&self) -> Conic {
        let height = 1.0 / self.yy.sqrt();
        Conic {
            across: 1.0 / (self.root * height),
            shear: self.xy * height / self.root,
            along: height,
        }
    }
}

/// Amplitude of the resampling filter (equation 3, where it is printed inverted): what the low-pass leaves of
/// the projected kernel's height, |R'|^(1/2) / |R' + H|^(1/2). Kept, so that where splats of unlike tilt or
/// size meet each counts by the area that it has in the picture.
#[inline(always)]
pub fn amplitude(kernel: &Shape, filter: &Shape) -> f32 {
    kernel.root / filter.root
}

/// A central conic: `(across x - shear y)^2 + (along y)^2 <= 1`.
#[derive(Clone, Copy, Debug)]
pub struct Conic {
    /// Of x.
    pub across: f32,
    /// Of y, in the same square.
    pub shear: f32,
    /// Of y.
    pub along: f32,
}

impl Conic {
    /// Square of the distance from the middle over that of the isocontour in the same direction.
    #[inline(always)]
    pub fn at(&self, x: f32, y: f32) -> f32 {
        let (u, v) = (self.across * x - self.shear * y, self.along * y);
        u * u + v * v
    }
}

/// The mapping from the picture back to the tangent plane, for splats whose isocontour is no ellipse or that
/// are too near for an affine approximation: rows over the homogeneous pixel (x, y, 1). A pixel's place on the
/// plane is `(u, v) / inverse_depth`, in tangents: exact.
#[derive(Clone, Copy, Debug)]
pub struct Inverse {
    /// First coordinate over depth.
    pub u: Vec3,
    /// Second coordinate over depth.
    pub v: Vec3,
    /// Inverse depth.
    pub inverse_depth: Vec3,
}

/// The inverse of equation 4 (`u = x M^-1`), from a place in the picture; `None` where the eye lies in the
/// plane as far as `f32` can tell.
#[inline]
pub fn inverse(p: Vec3, tangents: [Vec3; 2], focal_px: f32, from: Vec2) -> Option<Inverse> {
    /// Sine between plane and line of sight under which rounding decides what is seen.
    const SINE_MIN: f32 = 1e-6;
    let [a, b] = tangents;
    let normal = a.cross(b);
    let seen = normal.dot(p);
    // What is not a number is in no range.
    if !(SINE_MIN..2.0).contains(&(seen.abs() / (normal.length() * p.length()))) {
        return None;
    }
    let row = |n: Vec3| {
        let n = n / seen;
        let (x, y) = (n.x / focal_px, n.y / focal_px);
        Vec3::new(x, y, n.z + x * from.x + y * from.y)
    };
    Some(Inverse { u: row(b.cross(p)), v: row(p.cross(a)), inverse_depth: row(normal) })
}
