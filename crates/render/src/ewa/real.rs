//! What the equations of a splat are computed with: a number, or four numbers at once ([`Lane`]), the same steps for
//! both.

use crate::lanes::Lane;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number of a splat, or those of four splats.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The same number for all.
    fn of(value: f32) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Without its sign.
    fn abs(self) -> Self;
    /// The greater one; `other` where either is no number.
    fn max(self, other: Self) -> Self;
    /// The lesser one; `other` where either is no number.
    fn min(self, other: Self) -> Self;
    /// With another one's sign.
    fn copysign(self, sign: Self) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f32) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        if self > other { self } else { other }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        if self < other { self } else { other }
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        f32::copysign(self, sign)
    }
}

impl Real for Lane {
    #[inline(always)]
    fn of(value: f32) -> Self {
        Lane::splat(value)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Lane::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Lane::abs(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Lane::max(self, other)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Lane::min(self, other)
    }

    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Lane::copysign(self, sign)
    }
}

/// The scalar product.
#[inline(always)]
pub fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
#[inline(always)]
pub fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    let of = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    [of(1, 2), of(2, 0), of(0, 1)]
}
