//! Push (marroquim2007 section 3.3): from the coarsest level down, pixels that are invalid or
//! occluded are interpolated from the coarser level, which has itself been pushed already.
//!
//! A valid pixel is occluded if its least depth is outside the depth interval of the coarser pixel
//! above it. The four nearest coarser pixels have weights 9, 3, 3, 1; those that are invalid or
//! whose ellipse does not cover the centre of the pixel are dropped, and the rest is renormalised.
//!
//! Where the paper is silent:
//! - Of the remaining coarser pixels, only those take part whose depth interval meets that of the
//!   frontmost, as in pull: at a silhouette two surfaces may cover a pixel, and their mean is
//!   neither.
//! - An occluded pixel is replaced only by a surface in front of it: it keeps its attributes if
//!   nothing covers it, or if its least depth is not behind the frontmost interval.
//! - A wide ellipse also hides pixels below the coarser pixels beside its own: with sparse points,
//!   pixels of coarse levels may hold only points of a surface behind, which would show as squares.
//! - With normals, a pixel behind all four coarser pixels and between the centres of their ellipses
//!   is occluded too, if none of these ellipses ends much before it: a mean of discs covers less
//!   than they do.
//! - With `smooths`, colours and normals of unchanged pixels of the picture are mixed with up to
//!   half of the interpolated value, by the weights of the coarser pixels that cover them, whose
//!   intervals meet theirs and whose normals are close: at about a point a pixel, the winner of a
//!   pixel is chance and shows as speckle.
//! - All attributes are interpolated, also both ends of the depth interval; to displacements the
//!   vector between the centres is added, as in pull.
//!
//! If pixels have planes, depths are moved along them ([`crate::passes::tangent`]): they are
//! compared at the centre of the pixel's own ellipse, or at the pixel's centre if it is invalid,
//! and interpolated at the centre of the new ellipse.

use crate::passes::ellipse::covers_at;
use crate::passes::tangent::Lens;
use crate::picture::pyramid::{
    FITTED, FLAT, INVALID, Level, NORMALS, Planes, Pyramid, RowMut, Rows, for_each_band,
};
use crate::simd::lanes::{LANES, Line, Pixels, Run, halves, has_pixels, is_empty, moved, turned};
use crate::simd::values::{Values, bits, dot, join, only};
use fearless_simd::{
    ExtractToken, Level as Support, Simd, SimdBase, SimdMask, dispatch, f32x4, f32x8, mask32x8,
};
use glam::Vec4;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal
/// one: those of the biquadratic B-spline, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// Least radius of an ellipse that hides pixels below the coarser pixels beside its own, pixels.
/// Narrower ellipses are in every pixel, and would widen outlines.
pub(crate) const HIDING_PX: f32 = 24.0;

/// Greatest distance of a pixel from the centres of four enclosing ellipses, over their radii.
pub(crate) const ENCLOSING: f32 = 1.15;

/// Share of the interpolated value in a smoothed pixel if all four coarser pixels take part. With
/// 0.8 surfaces of a point a pixel flicker less, but colours are less accurate.
pub(crate) const SMOOTH: f32 = 0.5;

/// Square of the cosine (15 degrees) from which on normals are close: at the edge of a cube, a
/// coarser pixel with three parts of one side and one of the other takes part in neither.
pub(crate) const NEAR: f32 = 0.933;

/// Slightly less than one: a pixel that the coarser one was made from must not count as in front of
/// it.
pub(crate) const ROUNDING: f32 = 0.99999;

/// Fills the levels from the second coarsest down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    push_with(pyramid, false, &mut []);
}

/// Fills the levels as [`push`] does and, with `smooths`, smooths pixels of the picture that stay.
/// Writes the depth image of the picture ([`crate::picture::pyramid::Level::depth_image`]) while
/// its rows are in the cache.
pub fn push_with(pyramid: &mut Pyramid, smooths: bool, image: &mut [f32]) {
    if let [base] = &pyramid.levels[..] {
        return base.depth_image(&pyramid.lens, image);
    }
    let (planes, lens) = (pyramid.planes(), pyramid.lens);
    for i in (1..pyramid.levels.len()).rev() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        let (finer, coarser) = (&mut finer[i - 1], &coarser[0]);
        let image: &mut [f32] = if i == 1 { &mut *image } else { &mut [] };
        let smooths = smooths && i == 1;
        match planes {
            Planes::None => push_level::<FLAT>(&lens, coarser, finer, smooths, image),
            Planes::Fitted => push_level::<FITTED>(&lens, coarser, finer, smooths, image),
            Planes::Normals => push_level::<NORMALS>(&lens, coarser, finer, smooths, image),
        }
    }
}

fn push_level<const PLANE: usize>(
    lens: &Lens,
    coarser: &Level,
    finer: &mut Level,
    smooths: bool,
    image: &mut [f32],
) {
    let edge_px = finer.edge_px;
    for_each_band(finer, image, |rows| {
        dispatch!(Support::new(), simd => if smooths {
            push_rows::<_, PLANE, true>(simd, lens, coarser, edge_px, rows);
        } else {
            push_rows::<_, PLANE, false>(simd, lens, coarser, edge_px, rows);
        });
    });
}

/// Recomputes the invalid and occluded pixels of rows from `coarser`.
#[inline(always)]
fn push_rows<S: Simd, const PLANE: usize, const SMOOTHS: bool>(
    simd: S,
    lens: &Lens,
    coarser: &Level,
    edge_px: f32,
    rows: Rows<'_>,
) {
    // Coarser rows in use, by the lowest bit of their number.
    let mut lines = [(None, Line::default()), (None, Line::default())];
    for mut row in rows {
        let over = row.y / 2;
        // Nearer neighbour above or below; none at the border of the picture.
        let beside = if row.y & 1 == 1 { over + 1 } else { over.wrapping_sub(1) };
        for y in [over, beside] {
            let (held, line) = &mut lines[y & 1];
            if *held != Some(y) {
                line.take::<PLANE>(lens, coarser, Some(y).filter(|&y| y < coarser.height));
                *held = Some(y);
            }
        }
        let (over, beside) = (&lines[over & 1].1, &lines[beside & 1].1);
        for (block, runs) in over.runs().zip(beside.runs()).enumerate() {
            let first = 2 * LANES * block;
            if has_pixels(runs.0) || has_pixels(runs.1) {
                let runs = [runs.0, runs.1];
                push_block::<S, PLANE, SMOOTHS>(simd, edge_px, runs, first, &mut row);
                row.write_image::<PLANE>(lens, edge_px, first);
            } else {
                // A valid pixel here would have made the coarser ones valid.
                row.write_nothing(first);
            }
        }
    }
}

/// Recomputes the pixels of a row from `first` on, below four coarser ones. `runs` are the coarser
/// row above them and the nearer one beside that.
#[inline(always)]
fn push_block<S: Simd, const PLANE: usize, const SMOOTHS: bool>(
    simd: S,
    edge_px: f32,
    runs: [&Run; 2],
    first: usize,
    row: &mut RowMut<'_>,
) {
    let own = &row.front[first..row.front.len().min(first + 2 * LANES)];
    let half = 0.5 * edge_px;
    let beside = join(simd, Vec4::splat(-half), Vec4::splat(half));
    let (above, below) = if row.y & 1 == 1 { (half, half * -3.0) } else { (-half, half * 3.0) };
    let [above, below] = [simd.splat_f32x8(above), simd.splat_f32x8(below)];
    // From the centre of a coarser pixel to that of the finer one: half a finer pixel from the one
    // above; one and a half, in the other direction, from its neighbours, which are on the same
    // side.
    let near = [
        Near { simd, run: runs[0], at: [1, 1], to_finer: [beside, above] },
        Near { simd, run: runs[0], at: [0, 2], to_finer: [beside * -3.0, above] },
        Near { simd, run: runs[1], at: [1, 1], to_finer: [beside, below] },
        Near { simd, run: runs[1], at: [0, 2], to_finer: [beside * -3.0, below] },
    ];
    let (zero, infinite) = (simd.splat_f32x8(0.0), simd.splat_f32x8(f32::INFINITY));
    if is_empty(own) {
        // Most blocks have no valid pixel.
        let finer = FinerPixels { least: infinite, most: infinite, displaced: [zero; 2] };
        return finer.fill::<PLANE, false>(&near, zero.cmpeq(zero), row, first);
    }
    let own = halves(own, INVALID);
    let [least, most] = [0, 1].map(|i| join(simd, own[0][i], own[1][i]));
    let is_valid = least.cmplt(infinite);
    let displaced = [
        only(is_valid, join(simd, own[0][2], own[1][2])),
        only(is_valid, join(simd, own[0][3], own[1][3])),
    ];
    let finer = FinerPixels { least, most, displaced };
    let [above, beside @ ..] = &near;
    let mut is_wanted = !(is_valid & finer.is_within::<PLANE>(above));
    for near in beside {
        let is_wide = infinite.like(HIDING_PX).cmple(near.lane(Line::TINT + 3));
        if is_wide.any_true() {
            is_wanted |= is_wide & finer.is_behind::<PLANE>(near);
        }
    }
    if SMOOTHS || is_wanted.any_true() {
        finer.fill::<PLANE, SMOOTHS>(&near, is_wanted, row, first);
    }
}

/// Splits values into those of every second pixel, and those of the others.
#[inline(always)]
fn part<S: Simd>(values: f32x8<S>) -> [Vec4; 2] {
    let (even, odd) = values.token().split_f32x8(values);
    [Vec4::from_array(even.into()), Vec4::from_array(odd.into())]
}

/// Coarser pixels on one side of finer ones.
struct Near<'a, S: Simd> {
    simd: S,
    run: &'a Run,
    /// Index of the first coarser pixel in the run, for the left and for the right finer pixels.
    at: [usize; 2],
    /// From the centres of the coarser pixels to those of the finer ones.
    to_finer: [f32x8<S>; 2],
}

impl<S: Simd> Near<'_, S> {
    #[inline(always)]
    fn lane(&self, plane: usize) -> f32x8<S> {
        let (run, [even, odd]) = (&self.run[plane], self.at);
        self.simd.combine_f32x4(
            f32x4::from_slice(self.simd, &run[even..even + LANES]),
            f32x4::from_slice(self.simd, &run[odd..odd + LANES]),
        )
    }

    /// Factors of depths that are moved by `by` pixels from the centres of the ellipses.
    #[inline(always)]
    fn moved<const PLANE: usize>(&self, by: [f32x8<S>; 2]) -> f32x8<S> {
        let tilt = [self.lane(Line::PLANE), self.lane(Line::PLANE + 1)];
        let facing = if PLANE == NORMALS { self.lane(Line::FACING) } else { tilt[0] };
        moved::<PLANE, _>(tilt, facing, by)
    }

    /// From the centres of the ellipses to those of the finer pixels.
    #[inline(always)]
    fn displaced(&self) -> [f32x8<S>; 2] {
        let at = Line::FRONT + 2;
        [self.lane(at) + self.to_finer[0], self.lane(at + 1) + self.to_finer[1]]
    }

    /// Whether the ellipses cover the centres of the finer pixels.
    #[inline(always)]
    fn covers<const PLANE: usize>(&self) -> mask32x8<S> {
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

/// Eight finer pixels: every second one, then the others.
struct FinerPixels<S: Simd> {
    /// Depth intervals of the pixels.
    least: f32x8<S>,
    most: f32x8<S>,
    /// From the place where depths are compared to the centre of the pixel: from the centre of its
    /// ellipse, or zero for an invalid pixel.
    displaced: [f32x8<S>; 2],
}

impl<S: Simd> FinerPixels<S> {
    /// Whether pixels are within the intervals of the coarser pixels above.
    #[inline(always)]
    fn is_within<const PLANE: usize>(&self, above: &Near<'_, S>) -> mask32x8<S> {
        let (least, most) = (above.lane(Line::FRONT), above.lane(Line::FRONT + 1));
        if PLANE == FLAT {
            return least.cmple(self.least) & self.least.cmple(most);
        }
        let moved = above.moved::<PLANE>(self.from(above.displaced()));
        (least * moved * ROUNDING).cmple(self.least) & self.least.cmple(most * moved)
    }

    /// Whether pixels are behind the interval of a coarser pixel.
    #[inline(always)]
    fn is_behind<const PLANE: usize>(&self, near: &Near<'_, S>) -> mask32x8<S> {
        let [least, mut most] = [0, 1].map(|i| near.lane(Line::FRONT + i));
        if PLANE != FLAT {
            most *= near.moved::<PLANE>(self.from(near.displaced()));
        }
        least.cmplt(least.like(f32::INFINITY)) & most.cmplt(self.least)
    }

    /// From the centres of ellipses with these displacements to the place where depths are
    /// compared.
    #[inline(always)]
    fn from(&self, displaced: [f32x8<S>; 2]) -> [f32x8<S>; 2] {
        [displaced[0] - self.displaced[0], displaced[1] - self.displaced[1]]
    }

    /// Depth intervals of coarser pixels at the place of comparison; infinite for invalid ones.
    #[inline(always)]
    fn see<const PLANE: usize>(&self, near: &Near<'_, S>) -> [f32x8<S>; 2] {
        let (mut least, mut most) = (near.lane(Line::FRONT), near.lane(Line::FRONT + 1));
        let infinite = least.like(f32::INFINITY);
        let is_valid = least.cmplt(infinite);
        if PLANE != FLAT {
            let moved = near.moved::<PLANE>(self.from(near.displaced()));
            (least, most) = (least * moved, most * moved);
        }
        [least, most].map(|depth| f32x8::select(is_valid, depth, infinite))
    }

    /// Whether pixels are behind all four coarser pixels and between the centres of their ellipses.
    #[inline(always)]
    fn is_enclosed(&self, near: &[Near<'_, S>; 4], seen: &[[f32x8<S>; 2]; 4]) -> mask32x8<S> {
        let zero = self.least.like(0.0);
        let mut is_enclosed = self.least.cmplt(zero.like(f32::INFINITY));
        // Greatest distances of the centres along four lines, in both directions.
        let (mut low, mut high) = ([zero; 4], [zero; 4]);
        for (near, [_, most]) in near.iter().zip(seen) {
            let [x, y] = near.displaced();
            let reach = near.lane(Line::TINT + 3) * ENCLOSING;
            is_enclosed &= most.cmplt(self.least) & (x * x + y * y).cmple(reach * reach);
            for (i, along) in [x, y, x + y, x - y].into_iter().enumerate() {
                low[i] = Values::min(low[i], along);
                high[i] = Values::max(high[i], along);
            }
        }
        for (low, high) in low.into_iter().zip(high) {
            is_enclosed &= low.cmplt(zero) & zero.cmplt(high);
        }
        is_enclosed
    }

    /// Interpolates those that are `is_wanted`, and writes those that something covers. Others take
    /// a part of it.
    #[inline(always)]
    fn fill<const PLANE: usize, const SMOOTHS: bool>(
        &self,
        near: &[Near<'_, S>; 4],
        is_wanted: mask32x8<S>,
        row: &mut RowMut<'_>,
        first: usize,
    ) {
        let [a, b, c, d] = near;
        let mut seen = [
            self.see::<PLANE>(a),
            self.see::<PLANE>(b),
            self.see::<PLANE>(c),
            self.see::<PLANE>(d),
        ];
        let (zero, infinite) = (self.least.like(0.0), self.least.like(f32::INFINITY));
        let is_valid = is_wanted & self.least.cmplt(infinite);
        let mut is_enclosed = zero.cmplt(zero);
        if PLANE == NORMALS && is_valid.any_true() {
            is_enclosed = is_valid & self.is_enclosed(near, &seen);
        }
        for (near, seen) in near.iter().zip(&mut seen) {
            let covers = near.covers::<PLANE>() | is_enclosed;
            *seen = seen.map(|depth| f32x8::select(covers, depth, infinite));
        }
        let (mut nearest, mut limit) = (infinite, infinite);
        for [least, most] in &seen {
            let is_nearer = least.cmplt(nearest);
            limit = f32x8::select(is_nearer, *most, limit);
            nearest = f32x8::select(is_nearer, *least, nearest);
        }
        // Else nothing covers it; or it is valid (finite) and not behind what does.
        let is_new = is_wanted & nearest.cmplt(infinite) & limit.cmplt(self.least);
        let is_kept = !is_new & self.least.cmplt(infinite);
        let smooths = SMOOTHS && is_kept.any_true();
        if !smooths && !is_new.any_true() {
            return;
        }
        let mut own_normal = [zero; 3];
        if smooths && PLANE == NORMALS {
            let own = &row.normal[first..row.normal.len().min(first + 2 * LANES)];
            let own = halves(own, Vec4::ZERO);
            for (i, normal) in own_normal.iter_mut().enumerate() {
                *normal = join(zero.token(), own[0][i], own[1][i]);
            }
        }
        let (mut weights, mut sum) = ([zero; 4], zero);
        for (t, weight) in weights.iter_mut().enumerate() {
            let [least, most] = seen[t];
            let mut takes_part = least.cmple(limit);
            if smooths {
                let mut meets = is_kept & least.cmple(self.most) & self.least.cmple(most);
                if PLANE == NORMALS {
                    let normal = [0, 1, 2].map(|i| near[t].lane(Line::PLANE + i));
                    meets &= are_near(own_normal, normal);
                }
                takes_part = is_new & takes_part | meets;
            }
            *weight = only(least.cmplt(infinite) & takes_part, zero.like(WEIGHTS[t]));
            sum += *weight;
        }
        weights.iter_mut().for_each(|weight| *weight /= sum);
        let (mut tint, mut plane) = ([[Vec4::ZERO; 2]; 4], [[Vec4::ZERO; 2]; 4]);
        for (i, tint) in tint.iter_mut().take(3).enumerate() {
            *tint = part(mean_of(near, Line::TINT + i, &weights));
        }
        for (i, plane) in plane.iter_mut().take(PLANE.min(3)).enumerate() {
            *plane = part(mean_of(near, Line::PLANE + i, &weights));
        }
        if smooths {
            let share = part(sum * (SMOOTH / WEIGHTS.iter().sum::<f32>()));
            smooth::<PLANE>(bits(is_kept), share, [tint, plane], row, first);
            if !is_new.any_true() {
                return;
            }
        }
        let mut middle = [zero; 2];
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
        let least = part(mean_of(near, Line::FRONT, &moved));
        let most = part(mean_of(near, Line::FRONT + 1, &moved));
        let depth = part(mean_of(near, Line::DEPTH, &moved));
        let [x, y] = [part(middle[0]), part(middle[1])];
        tint[3] = part(mean_of(near, Line::TINT + 3, &weights));
        if PLANE == NORMALS {
            plane[3] = part(mean_of(near, Line::PLANE + 3, &weights));
        }
        let is_all = is_new.all_true();
        // Every second pixel, then the others.
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

/// Moves colours and normals of the pixels whose bit is set towards `means` by `shares`: every
/// second pixel, then the others.
#[inline(always)]
fn smooth<const PLANE: usize>(
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

/// Whether normals of any length make a small angle, or both are zero. NaN is close to nothing.
#[inline(always)]
fn are_near<V: Values>(a: [V; 3], b: [V; 3]) -> V::Mask {
    let along = dot(a, b);
    (dot(a, a) * NEAR * dot(b, b)).cmple(along * along.max(along.like(0.0)))
}

/// First three attributes of a pixel, moved towards others by a share.
#[inline(always)]
fn towards(own: Vec4, mean: Vec4, share: f32) -> Vec4 {
    (own * (1.0 - share) + mean * share).truncate().extend(own.w)
}

/// Weighted mean of a plane. Values without weight may be NaN.
#[inline(always)]
fn mean_of<S: Simd>(near: &[Near<'_, S>; 4], plane: usize, weights: &[f32x8<S>; 4]) -> f32x8<S> {
    let mut sum = weights[0].like(0.0);
    for (near, &weight) in near.iter().zip(weights) {
        sum += only(weight.like(0.0).cmplt(weight), near.lane(plane) * weight);
    }
    sum
}
