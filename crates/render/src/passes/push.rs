//! Push (marroquim2007 section 3.3): from the coarsest level down, pixels that are invalid or occluded
//! are interpolated from the coarser level, which has itself been pushed already.
//!
//! A valid pixel is occluded where its least depth lies outside the depth interval of the coarser pixel
//! above it. The four nearest coarser pixels have weights 9, 3, 3, 1; those that are invalid or whose
//! ellipse does not cover the pixel's centre drop out, and the rest is renormalised.
//!
//! Where the paper is silent:
//! - Of the coarser pixels left, only those take part whose depth interval meets that of the frontmost,
//!   as in the pull phase: at a silhouette two surfaces may cover a pixel, and their mean is neither.
//! - An occluded pixel is replaced only by what lies in front of it: it keeps its own attributes where
//!   nothing covers it, or where its least depth is not behind the frontmost interval.
//! - A wide ellipse hides also what lies below the coarser pixels beside its own: where points are far apart, whole pixels of coarse
//!   levels hold but points of what lies behind, which would show as squares.
//! - With normals, what lies behind all four coarser pixels and between the centres of their ellipses is occluded too where none of
//!   these ends much before it: a mean of discs covers less than they do, and whole pixels of what lies behind would stay.
//! - Where asked, colours and normals of the picture's pixels that stay as they are take up to half of what is interpolated
//!   there, by the weights of those that cover them, whose intervals meet theirs and whose normals are near theirs: at about
//!   a point a pixel, which one wins a pixel is chance, and shows as speckles.
//! - All attributes are interpolated, the two ends of the depth interval as well; to displacements the
//!   vector between the centres is added, as in the pull phase.
//!
//! Where pixels have planes, depths are moved along them ([`crate::passes::tangent`]): compared where the pixel's own
//! ellipse has its centre, or at the pixel's centre where it has none, and interpolated where the new one's is.

use crate::passes::ellipse::covers_at;
use crate::passes::tangent::Lens;
use crate::picture::pyramid::{INVALID, Level, Planes, Pyramid, RowMut, Rows, for_each_band};
use crate::simd::lanes::{
    FITTED, FLAT, LANES, Line, NORMALS, Pixels, Run, halves, has_pixels, is_empty, moved, turned,
};
use crate::simd::values::{Values, bits, dot, join, only};
use fearless_simd::{
    ExtractToken, Level as Support, Simd, SimdBase, SimdMask, dispatch, f32x4, f32x8, mask32x8,
};
use glam::Vec4;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal one:
/// the biquadratic B-spline's, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// Radius from which on an ellipse hides also what lies below the coarser pixels beside its own, pixels. Of narrower ones
/// there is one in every pixel, and what they make of outlines is not to grow.
const HIDING_PX: f32 = 24.0;

/// So many of its radii a pixel may be from the centre of each of four ellipses that enclose it.
const ENCLOSING: f32 = 1.15;

/// How much of a pixel of the picture is what is interpolated there, where all four coarser ones have a part in it. With 0.8
/// surfaces of a point a pixel flicker an eighth less, but colours are off by 3 to 7 % more.
const SMOOTH: f32 = 0.5;

/// Square of the cosine (15 degrees) from which on normals are near each other: of a cube's edge a coarser pixel with three parts of
/// one side and one of the other has no part in either.
const NEAR: f32 = 0.933;

/// A rounding less than one: what a pixel has given to the coarser one is not to be in front of it.
const ROUNDING: f32 = 0.99999;

/// Fills the levels from the second coarsest down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    push_with(pyramid, false, &mut []);
}

/// The same, and `smooths` the picture's pixels that stay. Writes the picture's depth image
/// ([`crate::picture::pyramid::Level::depth_image`]) while its rows are at hand.
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
    // The coarser rows in use, by the last bit of their number.
    let mut lines = [(None, Line::default()), (None, Line::default())];
    for mut row in rows {
        let over = row.y / 2;
        // The nearer neighbour up or down; none at the picture's edge.
        let beside = if row.y & 1 == 1 { over + 1 } else { over.wrapping_sub(1) };
        for y in [over, beside] {
            let (taken, line) = &mut lines[y & 1];
            if *taken != Some(y) {
                line.take::<PLANE>(lens, coarser, Some(y).filter(|&y| y < coarser.height));
                *taken = Some(y);
            }
        }
        let (over, beside) = (&lines[over & 1].1, &lines[beside & 1].1);
        for (block, runs) in over.runs().zip(beside.runs()).enumerate() {
            let first = 2 * LANES * block;
            if has_pixels(runs.0) || has_pixels(runs.1) {
                let runs = [runs.0, runs.1];
                push_run::<S, PLANE, SMOOTHS>(simd, edge_px, runs, first, &mut row);
                row.write_image::<PLANE>(lens, edge_px, first);
            } else {
                // What is valid here would have made them so.
                row.write_nothing(first);
            }
        }
    }
}

/// Recomputes the pixels of a row, from `first` on, below four coarser ones. `runs` are of the row above it and of the
/// nearer one beside that.
#[inline(always)]
fn push_run<S: Simd, const PLANE: usize, const SMOOTHS: bool>(
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
    // To the finer centre from the coarser one above, half a finer pixel; from its neighbours, which lie on the
    // same side, one and a half the other way.
    let near = [
        CoarserPixels { simd, run: runs[0], at: [1, 1], to_finer: [beside, above] },
        CoarserPixels { simd, run: runs[0], at: [0, 2], to_finer: [beside * -3.0, above] },
        CoarserPixels { simd, run: runs[1], at: [1, 1], to_finer: [beside, below] },
        CoarserPixels { simd, run: runs[1], at: [0, 2], to_finer: [beside * -3.0, below] },
    ];
    let (zero, infinite) = (simd.splat_f32x8(0.0), simd.splat_f32x8(f32::INFINITY));
    if is_empty(own) {
        // Most blocks have no pixel of their own.
        let block = FinerPixels { least: infinite, most: infinite, displaced: [zero; 2] };
        return block.fill::<PLANE, false>(&near, zero.cmpeq(zero), row, first);
    }
    let own = halves(own, INVALID);
    let [least, most] = [0, 1].map(|i| join(simd, own[0][i], own[1][i]));
    let is_valid = least.cmplt(infinite);
    let displaced = [
        only(is_valid, join(simd, own[0][2], own[1][2])),
        only(is_valid, join(simd, own[0][3], own[1][3])),
    ];
    let block = FinerPixels { least, most, displaced };
    let [above, beside @ ..] = &near;
    let mut candidates = !(is_valid & block.is_within::<PLANE>(above));
    for near in beside {
        let is_wide = infinite.like(HIDING_PX).cmple(near.lane(Line::TINT + 3));
        if is_wide.any_true() {
            candidates |= is_wide & block.is_behind::<PLANE>(near);
        }
    }
    if SMOOTHS || candidates.any_true() {
        block.fill::<PLANE, SMOOTHS>(&near, candidates, row, first);
    }
}

/// The values of every second pixel, and those of the others.
#[inline(always)]
fn part<S: Simd>(values: f32x8<S>) -> [Vec4; 2] {
    let (even, odd) = values.token().split_f32x8(values);
    [Vec4::from_array(even.into()), Vec4::from_array(odd.into())]
}

/// The coarser pixels that lie on one side of finer ones.
struct CoarserPixels<'a, S: Simd> {
    simd: S,
    run: &'a Run,
    /// Where the first of them is in the run, for the finer ones to the left and to the right.
    at: [usize; 2],
    /// From their centres to the finer ones.
    to_finer: [f32x8<S>; 2],
}

impl<S: Simd> CoarserPixels<'_, S> {
    #[inline(always)]
    fn lane(&self, plane: usize) -> f32x8<S> {
        let (run, [even, odd]) = (&self.run[plane], self.at);
        self.simd.combine_f32x4(
            f32x4::from_slice(self.simd, &run[even..even + LANES]),
            f32x4::from_slice(self.simd, &run[odd..odd + LANES]),
        )
    }

    /// Of depths moved from the ellipses' centres by so many pixels, what they are multiplied by.
    #[inline(always)]
    fn moved<const PLANE: usize>(&self, by: [f32x8<S>; 2]) -> f32x8<S> {
        let tilt = [self.lane(Line::PLANE), self.lane(Line::PLANE + 1)];
        let facing = if PLANE == NORMALS { self.lane(Line::FACING) } else { tilt[0] };
        moved::<PLANE, _>(tilt, facing, by)
    }

    /// From the ellipses' centres to the finer pixels'.
    #[inline(always)]
    fn displaced(&self) -> [f32x8<S>; 2] {
        let at = Line::FRONT + 2;
        [self.lane(at) + self.to_finer[0], self.lane(at + 1) + self.to_finer[1]]
    }

    /// Whether the ellipses cover the finer pixels.
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

/// A run of finer pixels: every second one, then the others.
struct FinerPixels<S: Simd> {
    /// Their own depth intervals.
    least: f32x8<S>,
    most: f32x8<S>,
    /// To their centres from where depths are compared: from their ellipses' centres, from their own where they are invalid.
    displaced: [f32x8<S>; 2],
}

impl<S: Simd> FinerPixels<S> {
    /// Which are within the intervals of the coarser pixels above.
    #[inline(always)]
    fn is_within<const PLANE: usize>(&self, above: &CoarserPixels<'_, S>) -> mask32x8<S> {
        let (least, most) = (above.lane(Line::FRONT), above.lane(Line::FRONT + 1));
        if PLANE == FLAT {
            return least.cmple(self.least) & self.least.cmple(most);
        }
        let moved = above.moved::<PLANE>(self.from(above.displaced()));
        (least * moved * ROUNDING).cmple(self.least) & self.least.cmple(most * moved)
    }

    /// Which lie behind the interval of a coarser pixel.
    #[inline(always)]
    fn is_behind<const PLANE: usize>(&self, near: &CoarserPixels<'_, S>) -> mask32x8<S> {
        let [least, mut most] = [0, 1].map(|i| near.lane(Line::FRONT + i));
        if PLANE != FLAT {
            most *= near.moved::<PLANE>(self.from(near.displaced()));
        }
        least.cmplt(least.like(f32::INFINITY)) & most.cmplt(self.least)
    }

    /// To where depths are compared from the centres of ellipses that are so far from the pixels.
    #[inline(always)]
    fn from(&self, displaced: [f32x8<S>; 2]) -> [f32x8<S>; 2] {
        [displaced[0] - self.displaced[0], displaced[1] - self.displaced[1]]
    }

    /// Depth intervals of coarser pixels where they are compared, infinite where there are none.
    #[inline(always)]
    fn intervals<const PLANE: usize>(&self, near: &CoarserPixels<'_, S>) -> [f32x8<S>; 2] {
        let (mut least, mut most) = (near.lane(Line::FRONT), near.lane(Line::FRONT + 1));
        let infinite = least.like(f32::INFINITY);
        let is_valid = least.cmplt(infinite);
        if PLANE != FLAT {
            let moved = near.moved::<PLANE>(self.from(near.displaced()));
            (least, most) = (least * moved, most * moved);
        }
        [least, most].map(|depth| f32x8::select(is_valid, depth, infinite))
    }

    /// Which lie behind all four coarser pixels, and between the centres of their ellipses.
    #[inline(always)]
    fn is_enclosed(
        &self,
        near: &[CoarserPixels<'_, S>; 4],
        intervals: &[[f32x8<S>; 2]; 4],
    ) -> mask32x8<S> {
        let zero = self.least.like(0.0);
        let mut is_enclosed = self.least.cmplt(zero.like(f32::INFINITY));
        // How far the centres are at most along four lines, one way and the other.
        let (mut low, mut high) = ([zero; 4], [zero; 4]);
        for (near, [_, most]) in near.iter().zip(intervals) {
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

    /// Interpolates those that are `asking`, and writes those that something covers. Others take a part of it.
    #[inline(always)]
    fn fill<const PLANE: usize, const SMOOTHS: bool>(
        &self,
        near: &[CoarserPixels<'_, S>; 4],
        candidates: mask32x8<S>,
        row: &mut RowMut<'_>,
        first: usize,
    ) {
        let [a, b, c, d] = near;
        let mut intervals = [
            self.intervals::<PLANE>(a),
            self.intervals::<PLANE>(b),
            self.intervals::<PLANE>(c),
            self.intervals::<PLANE>(d),
        ];
        let (zero, infinite) = (self.least.like(0.0), self.least.like(f32::INFINITY));
        let is_valid = candidates & self.least.cmplt(infinite);
        let mut is_enclosed = zero.cmplt(zero);
        if PLANE == NORMALS && is_valid.any_true() {
            is_enclosed = is_valid & self.is_enclosed(near, &intervals);
        }
        for (near, intervals) in near.iter().zip(&mut intervals) {
            let covers = near.covers::<PLANE>() | is_enclosed;
            *intervals = intervals.map(|depth| f32x8::select(covers, depth, infinite));
        }
        let (mut nearest, mut limit) = (infinite, infinite);
        for [least, most] in &intervals {
            let is_nearer = least.cmplt(nearest);
            limit = f32x8::select(is_nearer, *most, limit);
            nearest = f32x8::select(is_nearer, *least, nearest);
        }
        // Else nothing covers it; or it is valid (finite) and not behind what does.
        let is_new = candidates & nearest.cmplt(infinite) & limit.cmplt(self.least);
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
            let [least, most] = intervals[t];
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

/// Moves colours and normals of some pixels, a bit each, towards means by shares: every second of them, then the others.
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

/// Whether normals of any length make a small angle, or there are none. What is no number is near nothing.
#[inline(always)]
fn are_near<V: Values>(a: [V; 3], b: [V; 3]) -> V::Mask {
    let along = dot(a, b);
    (dot(a, a) * NEAR * dot(b, b)).cmple(along * along.max(along.like(0.0)))
}

/// The first three attributes of a pixel moved towards others by a share.
#[inline(always)]
fn towards(own: Vec4, mean: Vec4, share: f32) -> Vec4 {
    (own * (1.0 - share) + mean * share).truncate().extend(own.w)
}

/// The weighted mean of a plane. What has no weight may be no number.
#[inline(always)]
fn mean_of<S: Simd>(
    near: &[CoarserPixels<'_, S>; 4],
    plane: usize,
    weights: &[f32x8<S>; 4],
) -> f32x8<S> {
    let mut sum = weights[0].like(0.0);
    for (near, &weight) in near.iter().zip(weights) {
        sum += only(weight.like(0.0).cmplt(weight), near.lane(plane) * weight);
    }
    sum
}
