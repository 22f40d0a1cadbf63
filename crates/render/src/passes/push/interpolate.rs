//! Weighted means of the coarser pixels of [`crate::passes::push`], written to finer pixels: in
//! place of their attributes, or mixed with them.

use crate::passes::push::coarser::Near;
use crate::picture::pyramid::{FLAT, NORMALS, RowMut};
use crate::simd::lanes::{LANES, Line, Pixels, halves, turned};
use crate::simd::values::{Values, bits, join, only};
use fearless_simd::{ExtractToken, Simd, SimdMask, f32x8, mask32x8};
use glam::Vec4;

/// An attribute of every second pixel and of the others, component by component.
pub(super) type Halves = [[Vec4; 2]; 4];

/// Splits a register into the values of every second pixel and those of the others.
#[inline(always)]
pub(super) fn split<S: Simd>(values: f32x8<S>) -> [Vec4; 2] {
    let (even, odd) = values.token().split_f32x8(values);
    [Vec4::from_array(even.into()), Vec4::from_array(odd.into())]
}

/// The pixels' own normals.
#[inline(always)]
pub(super) fn normals_of<S: Simd>(simd: S, row: &RowMut<'_>, first: usize) -> [f32x8<S>; 3] {
    let own = &row.normal[first..row.normal.len().min(first + 2 * LANES)];
    let own = halves(own, Vec4::ZERO);
    let mut normals = [simd.splat_f32x8(0.0); 3];
    for (i, normal) in normals.iter_mut().enumerate() {
        *normal = join(simd, own[0][i], own[1][i]);
    }
    normals
}

/// Means of colours and of planes, without radii and minor axes.
#[inline(always)]
pub(super) fn mean_attributes<const PLANE: usize, S: Simd>(
    near: &Near<'_, S>,
    weights: &[f32x8<S>; 4],
) -> [Halves; 2] {
    let (mut tint, mut plane) = ([[Vec4::ZERO; 2]; 4], [[Vec4::ZERO; 2]; 4]);
    for (i, tint) in tint.iter_mut().take(3).enumerate() {
        *tint = split(mean_of(near, Line::TINT + i, weights));
    }
    for (i, plane) in plane.iter_mut().take(PLANE.min(3)).enumerate() {
        *plane = split(mean_of(near, Line::PLANE + i, weights));
    }
    [tint, plane]
}

/// Interpolated attributes of a run of finer pixels.
pub(super) struct Interpolated {
    front: Halves,
    tint: Halves,
    depth: [Vec4; 2],
    plane: Halves,
}

impl Interpolated {
    /// Interpolates depths at the mean centre of the ellipses, and what [`mean_attributes`] leaves
    /// out of `tint` and `plane`.
    #[inline(always)]
    pub(super) fn new<const PLANE: usize, S: Simd>(
        near: &Near<'_, S>,
        weights: [f32x8<S>; 4],
        [mut tint, mut plane]: [Halves; 2],
    ) -> Self {
        let mut middle = [weights[0].like(0.0); 2];
        for (near, weight) in near.iter().zip(&weights) {
            let displaced = near.displaced();
            middle[0] += displaced[0] * *weight;
            middle[1] += displaced[1] * *weight;
        }
        let mut moved = weights;
        for (near, moved) in near.iter().zip(&mut moved).filter(|_| PLANE != FLAT) {
            let displaced = near.displaced();
            *moved *= near.moved::<PLANE>([displaced[0] - middle[0], displaced[1] - middle[1]]);
        }
        let least = split(mean_of(near, Line::FRONT, &moved));
        let most = split(mean_of(near, Line::FRONT + 1, &moved));
        let depth = split(mean_of(near, Line::DEPTH, &moved));
        let [x, y] = [split(middle[0]), split(middle[1])];
        tint[3] = split(mean_of(near, Line::TINT + 3, &weights));
        if PLANE == NORMALS {
            plane[3] = split(mean_of(near, Line::PLANE + 3, &weights));
        }
        Self { front: [least, most, x, y], tint, depth, plane }
    }

    /// Writes the pixels of `is_new` to a row, from pixel `first` on: every second pixel, then the
    /// others.
    #[inline(always)]
    pub(super) fn write<const PLANE: usize, S: Simd>(
        self,
        is_new: mask32x8<S>,
        row: &mut RowMut<'_>,
        first: usize,
    ) {
        let Self { front: [least, most, x, y], tint, depth, plane } = self;
        let is_all = is_new.all_true();
        let is_new = bits(is_new);
        for odd in 0..2 {
            let out = Pixels {
                front: [least[odd], most[odd], x[odd], y[odd]],
                tint: [tint[0][odd], tint[1][odd], tint[2][odd], tint[3][odd]],
                depth: depth[odd],
                plane: [plane[0][odd], plane[1][odd], plane[2][odd], plane[3][odd]],
            };
            if is_all && out.write_half::<PLANE>(row, first, odd) {
                continue;
            }
            let mut to = [usize::MAX; LANES];
            for (k, to) in to.iter_mut().enumerate() {
                if is_new >> (odd * LANES + k) & 1 > 0 {
                    *to = first + 2 * k + odd;
                }
            }
            out.scatter::<PLANE>(to, row);
        }
    }
}

/// Moves colours and normals of `pixels` (a bit each, every second one before the others) towards
/// `means` by `shares`.
#[inline(always)]
pub(super) fn smooth<const PLANE: usize>(
    pixels: u32,
    shares: [Vec4; 2],
    means: [[[Vec4; 2]; 4]; 2],
    row: &mut RowMut<'_>,
    first: usize,
) {
    for odd in 0..2 {
        let [tints, normals] = means.map(|means| turned(means.map(|plane| plane[odd])));
        for k in (0..LANES).filter(|k| pixels >> (odd * LANES + k) & 1 > 0) {
            let (x, share) = (first + 2 * k + odd, shares[odd][k]);
            row.tint[x] = towards(row.tint[x], tints[k], share);
            if PLANE == NORMALS {
                row.normal[x] = towards(row.normal[x], normals[k], share);
            }
        }
    }
}

/// Moves the first three components of `own` towards `mean` by `share`.
#[inline(always)]
fn towards(own: Vec4, mean: Vec4, share: f32) -> Vec4 {
    (own * (1.0 - share) + mean * share).truncate().extend(own.w)
}

/// Weighted mean of component `plane`. Values of weight zero are masked, for they may be NaN.
#[inline(always)]
fn mean_of<S: Simd>(near: &Near<'_, S>, plane: usize, weights: &[f32x8<S>; 4]) -> f32x8<S> {
    let mut sum = weights[0].like(0.0);
    for (near, &weight) in near.iter().zip(weights) {
        sum += only(weight.like(0.0).cmplt(weight), near.lane(plane) * weight);
    }
    sum
}
