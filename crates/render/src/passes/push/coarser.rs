//! The coarser pixels that [`crate::passes::push`] interpolates a run of finer ones from: their
//! attributes, as registers that hold one coarser pixel for each finer one.

use crate::passes::ellipse::covers_at;
use crate::picture::pyramid::NORMALS;
use crate::simd::lanes::{LANES, Line, Run, moved};
use crate::simd::values::Values;
use fearless_simd::{Simd, SimdBase, f32x4, f32x8, mask32x8};

/// One of the four coarser pixels for each finer pixel of a run: the one above, beside it, or
/// diagonal.
pub(super) struct CoarserPixels<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) run: &'a Run,
    /// Index in the run of the first coarser pixel, for the left and for the right finer pixels.
    pub(super) at: [usize; 2],
    /// From the centres of the coarser pixels to those of the finer ones, pixels.
    pub(super) to_finer: [f32x8<S>; 2],
}

/// The four coarser pixels that finer pixels are interpolated from, in the order of
/// [`crate::passes::push::WEIGHTS`].
pub(super) type Near<'a, S> = [CoarserPixels<'a, S>; 4];
/// Least and greatest depth.
pub(super) type Interval<S> = [f32x8<S>; 2];

impl<S: Simd> CoarserPixels<'_, S> {
    /// Component `plane` of a [`Line`], for each finer pixel.
    #[inline(always)]
    pub(super) fn lane(&self, plane: usize) -> f32x8<S> {
        let (run, [even, odd]) = (&self.run[plane], self.at);
        self.simd.combine_f32x4(
            f32x4::from_slice(self.simd, &run[even..even + LANES]),
            f32x4::from_slice(self.simd, &run[odd..odd + LANES]),
        )
    }

    /// Factor by which depths change when they are moved by `by` (pixels) from the centres of the
    /// ellipses.
    #[inline(always)]
    pub(super) fn moved<const PLANE: usize>(&self, by: [f32x8<S>; 2]) -> f32x8<S> {
        let tilt = [self.lane(Line::PLANE), self.lane(Line::PLANE + 1)];
        let facing = if PLANE == NORMALS { self.lane(Line::FACING) } else { tilt[0] };
        moved::<PLANE, _>(tilt, facing, by)
    }

    /// From the centres of the ellipses to those of the finer pixels, pixels.
    #[inline(always)]
    pub(super) fn displaced(&self) -> [f32x8<S>; 2] {
        let at = Line::FRONT + 2;
        [self.lane(at) + self.to_finer[0], self.lane(at + 1) + self.to_finer[1]]
    }

    /// Whether the ellipses cover the centres of the finer pixels.
    #[inline(always)]
    pub(super) fn covers<const PLANE: usize>(&self) -> mask32x8<S> {
        let radius = self.lane(Line::TINT + 3);
        let disc = if PLANE == NORMALS {
            let at = Line::PLANE;
            [self.lane(at), self.lane(at + 1), self.lane(at + 3)]
        } else {
            [radius.like(0.0), radius.like(0.0), radius.like(1.0)]
        };
        covers_at(self.displaced(), radius, disc)
    }
}
