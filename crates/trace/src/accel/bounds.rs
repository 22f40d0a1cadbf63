//! Axis-aligned boxes.

use glam::{Affine3A, Vec3};

/// An axis-aligned box; empty if its least corner lies above its greatest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least corner.
    pub min: Vec3,
    /// Greatest corner.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Bounds {
    /// The box of nothing.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The box of one point.
    #[inline(always)]
    pub(crate) fn of_point(at: Vec3) -> Self {
        Self { min: at, max: at }
    }

    /// Whether the box holds no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// Box of both.
    #[inline(always)]
    pub fn union(&self, other: &Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Centre; NaN for an empty box.
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// Box of the moved box.
    pub(crate) fn placed(&self, place: &Affine3A) -> Self {
        if self.is_empty() {
            return *self;
        }
        let corner = |k: u32| {
            let pick = |i: u32, low: f32, high: f32| if k >> i & 1 == 0 { low } else { high };
            let (min, max) = (self.min, self.max);
            let p = Vec3::new(pick(0, min.x, max.x), pick(1, min.y, max.y), pick(2, min.z, max.z));
            let p = place.transform_point3(p);
            Self::of_point(p)
        };
        (0..8).fold(Self::EMPTY, |all, k| all.union(&corner(k)))
    }
}
