//! Arithmetic of a register of floats of any width: one, four ([`crate::simd::lanes`]), or eight
//! where the processor has them. Names and meanings are those of the vectors of `glam`.

use fearless_simd::{ExtractToken, Select, Simd, SimdBase, SimdMask, f32x4, f32x8, mask32x8};
use glam::{BVec4A, Vec4};
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};

/// One value for each of four pixels.
pub type Lane = Vec4;
/// A mask of four pixels.
pub type Mask = BVec4A;

/// Pixels of a row that are computed together in registers of eight.
pub const EIGHT: usize = 8;
/// Least number from which floats have no fraction (2^23). Adding it rounds a number and leaves the
/// integer in the last bits of the mantissa.
pub const WHOLE: f32 = 8_388_608.0;

/// Joins two registers of four values.
#[inline(always)]
pub fn join<S: Simd>(simd: S, first: Vec4, second: Vec4) -> f32x8<S> {
    simd.combine_f32x4(
        f32x4::load_array(simd, first.to_array()),
        f32x4::load_array(simd, second.to_array()),
    )
}

/// Loads eight values. `SimdBase` can do so too, but importing it brings its `min` and `max` into
/// scope.
#[inline(always)]
pub fn load<S: Simd>(simd: S, values: &[f32; EIGHT]) -> f32x8<S> {
    f32x8::load_array_ref(simd, values)
}

/// `value` in the lanes of the mask, zero in the others.
#[inline(always)]
pub fn only<V: Values>(mask: V::Mask, value: V) -> V {
    value.only(mask)
}

/// Dot product.
#[inline(always)]
pub fn dot<V: Values>(a: [V; 3], b: [V; 3]) -> V {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// Cross product.
#[inline(always)]
pub fn cross<V: Values>(a: [V; 3], b: [V; 3]) -> [V; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A normal that looks away is taken for one at the outline of a surface if the square of the
/// cosine of its angle with the direction from the eye is less: it is within 20 degrees of edge-on.
pub(crate) const OUTLINE_COS2: f32 = 0.125;

/// Unit normals, turned to the eye where they look away: reversed where a surface is seen from
/// behind. If normals have fronts ([`crate::Frame::has_fronts`]), those that are edge-on, at an
/// outline, are mirrored at the plane across the view instead: reversed, their light would come
/// from the other side. Zero stays zero.
#[inline(always)]
pub fn towards_eye<V: Values>(normal: [V; 3], from_eye: [V; 3], has_fronts: bool) -> [V; 3] {
    let (away, distance2) = (dot(normal, from_eye), dot(from_eye, from_eye));
    let zero = away.like(0.0);
    let looks_away = zero.cmplt(away);
    let outline_cos2 = if has_fronts { OUTLINE_COS2 } else { 0.0 };
    let is_at_outline = (away * away).cmplt(distance2 * outline_cos2);
    let twice = only(looks_away, (away + away) / distance2);
    let mut turned = normal;
    for (c, along) in turned.iter_mut().zip(from_eye) {
        let from_behind = V::select(looks_away, -*c, *c);
        *c = V::select(is_at_outline, *c - along * twice, from_behind);
    }
    turned
}

/// Converts a mask of eight to bits.
#[inline(always)]
pub fn bits<S: Simd>(mask: mask32x8<S>) -> u32 {
    mask.to_bitmask() as u32
}

/// Decodes octahedral normals, like [`esker_points::quant::oct_direction`].
#[inline(always)]
pub fn directions<V: Values>(x: V, y: V) -> [V; 3] {
    let (zero, one) = (x.like(0.0), x.like(1.0));
    let none = x.like(f32::from(i16::MIN));
    let is_none = x.cmpeq(none) & y.cmpeq(none);
    let (scale, least) = (x.like(32767.0), x.like(-1.0));
    let (x, y) = ((x / scale).max(least), (y / scale).max(least));
    let z = one - x.abs() - y.abs();
    let is_folded = z.cmplt(zero);
    let folded_x = V::select(is_folded, (one - y.abs()).copysign(x), x);
    let folded_y = V::select(is_folded, (one - x.abs()).copysign(y), y);
    let or_none = |c: V| V::select(is_none, zero, c);
    [or_none(folded_x), or_none(folded_y), or_none(z)]
}

/// A register of floats. If one operand of `min` or `max` is NaN, the result is the second operand.
pub trait Values:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f32, Output = Self>
    + Sub<f32, Output = Self>
    + Mul<f32, Output = Self>
{
    /// A mask of the lanes.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask>;

    /// A register with `value` in all lanes.
    fn like(self, value: f32) -> Self;
    /// Minimum.
    fn min(self, other: Self) -> Self;
    /// Maximum.
    fn max(self, other: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Takes the signs of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// `self * factor + more`; rounded once if the processor has that instruction, else twice.
    fn mul_add(self, factor: Self, more: Self) -> Self;
    /// Lanes that are equal.
    fn cmpeq(self, other: Self) -> Self::Mask;
    /// Lanes that are less than those of `other`.
    fn cmplt(self, other: Self) -> Self::Mask;
    /// Lanes that are less than or equal to those of `other`.
    fn cmple(self, other: Self) -> Self::Mask;
    /// `a` in the lanes of the mask, `b` in the others.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// The values in the lanes of the mask, zeros in the others.
    #[inline(always)]
    fn only(self, mask: Self::Mask) -> Self {
        Self::select(mask, self, self.like(0.0))
    }
}

impl Values for f32 {
    type Mask = bool;

    #[inline(always)]
    fn like(self, value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.copysign(sign)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, more: Self) -> Self {
        self * factor + more
    }
    #[inline(always)]
    fn cmpeq(self, other: Self) -> bool {
        self == other
    }
    #[inline(always)]
    fn cmplt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn cmple(self, other: Self) -> bool {
        self <= other
    }
    #[inline(always)]
    fn select(mask: bool, a: Self, b: Self) -> Self {
        if mask { a } else { b }
    }
}

impl Values for Vec4 {
    type Mask = BVec4A;

    #[inline(always)]
    fn like(self, value: f32) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.min(other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.max(other)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.copysign(sign)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, more: Self) -> Self {
        self * factor + more
    }
    #[inline(always)]
    fn cmpeq(self, other: Self) -> BVec4A {
        self.cmpeq(other)
    }
    #[inline(always)]
    fn cmplt(self, other: Self) -> BVec4A {
        self.cmplt(other)
    }
    #[inline(always)]
    fn cmple(self, other: Self) -> BVec4A {
        self.cmple(other)
    }
    #[inline(always)]
    fn select(mask: BVec4A, a: Self, b: Self) -> Self {
        Self::select(mask, a, b)
    }
}

impl<S: Simd> Values for f32x8<S> {
    type Mask = mask32x8<S>;

    #[inline(always)]
    fn like(self, value: f32) -> Self {
        self.token().splat_f32x8(value)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.token().min_f32x8(self, other)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.token().max_f32x8(self, other)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.token().abs_f32x8(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.token().sqrt_f32x8(self)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        self.token().copysign_f32x8(self, sign)
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, more: Self) -> Self {
        self.token().mul_add_f32x8(self, factor, more)
    }
    #[inline(always)]
    fn cmpeq(self, other: Self) -> mask32x8<S> {
        self.token().simd_eq_f32x8(self, other)
    }
    #[inline(always)]
    fn cmplt(self, other: Self) -> mask32x8<S> {
        self.token().simd_lt_f32x8(self, other)
    }
    #[inline(always)]
    fn cmple(self, other: Self) -> mask32x8<S> {
        self.token().simd_le_f32x8(self, other)
    }
    #[inline(always)]
    fn select(mask: mask32x8<S>, a: Self, b: Self) -> Self {
        mask.select(a, b)
    }
}

#[cfg(test)]
mod tests {
    use super::towards_eye;
    use glam::Vec3;

    /// Turned normals face the eye and stay of unit length. Just beyond an outline they are what
    /// they are just before it; straight from behind they are reversed.
    #[test]
    fn normals_are_turned_without_a_jump_at_outlines() {
        let from_eye = Vec3::new(3.0, -4.0, 12.0);
        let side = Vec3::new(0.8, 0.6, 0.0);
        let away = from_eye / 13.0;
        let turned = |angle: f32| {
            let normal = side * angle.cos() + away * angle.sin();
            let turned = Vec3::from(towards_eye(normal.to_array(), from_eye.to_array(), true));
            assert!((turned.length() - 1.0).abs() < 1e-5 && turned.dot(away) < 1e-5, "{angle}");
            (normal, turned)
        };
        for step in -80..=80 {
            turned(step as f32 * 0.019);
        }
        for angle in [-1.5, -0.3, -0.01] {
            let (normal, turned) = turned(angle);
            assert_eq!(normal, turned);
        }
        let (near, beyond) = (turned(-0.01).1, turned(0.01).1);
        assert!(near.distance(beyond) < 1e-4, "{near} {beyond}");
        let (normal, reversed) = turned(1.2);
        assert_eq!(reversed, -normal);
        assert_eq!(towards_eye([0.0; 3], from_eye.to_array(), true), [0.0; 3]);
        let reversed = towards_eye((side + away * 0.01).to_array(), from_eye.to_array(), false);
        assert_eq!(Vec3::from(reversed), -(side + away * 0.01));
    }
}
