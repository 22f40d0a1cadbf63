//! Push (`marroquim2007`, section 3.3): interpolates invalid and occluded pixels of each level of
//! the pyramid from the coarser level, which has itself been pushed already; from the second
//! coarsest level down to the picture.
//!
//! A valid pixel is occluded if its least depth lies outside the depth interval of the coarser
//! pixel above it. The four nearest coarser pixels have weights 9, 3, 3 and 1; those that are
//! invalid, or whose ellipse does not cover the pixel's centre, drop out, and the weights left are
//! normalised.
//!
//! Where the paper is silent (`docs/design/surfaces.md`):
//! - Only coarser pixels whose depth interval meets that of the frontmost take part, as in pull. At
//!   a silhouette two surfaces may cover a pixel, and their mean is neither.
//! - An occluded pixel keeps its attributes if nothing covers it, or if its least depth is not
//!   behind the frontmost interval.
//! - A wide ellipse also hides pixels below the neighbours of its coarser pixel: where points are
//!   far apart, whole pixels of coarse levels hold only points of the surface behind, which would
//!   show as squares.
//! - With normals, a pixel is occluded too if it lies behind all four coarser pixels and between
//!   the centres of their ellipses, none of them much more than a radius away: a mean of discs
//!   covers less than the discs do.
//! - On request, colours and normals of pixels of the picture that keep their attributes take up to
//!   half of what is interpolated from the coarser pixels that cover them, whose intervals meet
//!   theirs and whose normals are near theirs. At about a point a pixel it is chance which point
//!   wins a pixel, which shows as speckles.
//! - All attributes are interpolated, also both ends of the depth interval. The vector between the
//!   centres is added to displacements, as in pull.
//!
//! Where pixels have planes, depths are moved along them ([`crate::passes::tangent`]): compared at
//! the centre of the pixel's ellipse, or of the pixel if it has none, and interpolated at the
//! centre of the new ellipse.

mod coarser;
mod interpolate;

use crate::passes::push::coarser::{CoarserPixels, Interval, Near};
use crate::passes::push::interpolate::{Interpolated, mean_attributes, normals_of, smooth, split};
use crate::passes::tangent::Lens;
use crate::picture::pyramid::{
    FITTED, FLAT, INVALID, Level, NORMALS, Planes, Pyramid, RowMut, Rows, for_each_band,
};
use crate::simd::lanes::{LANES, Line, Run, halves, has_pixels, is_empty};
use crate::simd::values::{Values, bits, dot, join, only};
use fearless_simd::{ExtractToken, Level as Support, Simd, SimdMask, dispatch, f32x8, mask32x8};
use glam::Vec4;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal
/// one: those of the biquadratic B-spline, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// Radius from which an ellipse also hides pixels below the neighbours of its coarser pixel,
/// pixels. Narrower ellipses exist in every pixel and would make outlines swell.
pub(crate) const HIDING_PX: f32 = 24.0;

/// Greatest distance of a pixel from the centre of each of the four ellipses that enclose it, over
/// their radius.
pub(crate) const ENCLOSING: f32 = 1.15;

/// Share of the interpolated value in a smoothed pixel, if all four coarser pixels take part. A
/// greater share flickers less, but blurs colours.
pub(crate) const SMOOTH: f32 = 0.5;

/// Square of the cosine (15 degrees) from which two normals are near each other. A coarser pixel at
/// the edge of a cube, with three parts of one side and one of the other, is near neither side.
pub(crate) const NEAR: f32 = 0.933;

/// Just below one, by a rounding: a pixel must not lie in front of the coarser pixel that was
/// averaged from it.
pub(crate) const ROUNDING: f32 = 0.99999;

/// Fills the levels from the second coarsest one down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    push_with(pyramid, 0.0, &mut []);
}

/// Version of [`push`] that also smooths the pixels of the picture that keep their attributes, by
/// the share `smoothing` (0 to 1) of the usual smoothing, and writes the depth image of the picture
/// ([`crate::picture::pyramid::Level::depth_image`]) to `image` while its rows are in the cache.
pub fn push_with(pyramid: &mut Pyramid, smoothing: f32, image: &mut [f32]) {
    if let [base] = &pyramid.levels[..] {
        return base.depth_image(&pyramid.lens, image);
    }
    let (planes, lens) = (pyramid.planes(), pyramid.lens);
    for i in (1..pyramid.levels.len()).rev() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        let (finer, coarser) = (&mut finer[i - 1], &coarser[0]);
        let image: &mut [f32] = if i == 1 { &mut *image } else { &mut [] };
        let smoothing = if i == 1 { smoothing } else { 0.0 };
        match planes {
            Planes::None => push_level::<FLAT>(&lens, coarser, finer, smoothing, image),
            Planes::Fitted => push_level::<FITTED>(&lens, coarser, finer, smoothing, image),
            Planes::Normals => push_level::<NORMALS>(&lens, coarser, finer, smoothing, image),
        }
    }
}

fn push_level<const PLANE: usize>(
    lens: &Lens,
    coarser: &Level,
    finer: &mut Level,
    smoothing: f32,
    image: &mut [f32],
) {
    let edge_px = finer.edge_px;
    for_each_band(finer, image, |rows| {
        dispatch!(Support::new(), simd => if smoothing > 0.0 {
            push_rows::<_, PLANE, true>(simd, lens, coarser, edge_px, smoothing, rows);
        } else {
            push_rows::<_, PLANE, false>(simd, lens, coarser, edge_px, smoothing, rows);
        });
    });
}

/// Recomputes the invalid and occluded pixels of `rows` from `coarser`.
#[inline(always)]
fn push_rows<S: Simd, const PLANE: usize, const SMOOTHS: bool>(
    simd: S,
    lens: &Lens,
    coarser: &Level,
    edge_px: f32,
    smoothing: f32,
    rows: Rows<'_>,
) {
    // Coarser rows in use, indexed by the last bit of their number.
    let mut lines = [(None, Line::default()), (None, Line::default())];
    for mut row in rows {
        let over = row.y / 2;
        // The nearer neighbour up or down; outside the level at its border.
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
                push_run::<S, PLANE, SMOOTHS>(simd, edge_px, smoothing, runs, first, &mut row);
                row.write_image::<PLANE>(lens, edge_px, first);
            } else {
                // Valid pixels here would have made the coarser ones valid.
                row.write_nothing(first);
            }
        }
    }
}

/// Recomputes the pixels of a row below four coarser pixels, from pixel `first` on. `runs` are
/// those of the coarser row above, and of the nearer neighbour of that row.
#[inline(always)]
fn push_run<S: Simd, const PLANE: usize, const SMOOTHS: bool>(
    simd: S,
    edge_px: f32,
    smoothing: f32,
    runs: [&Run; 2],
    first: usize,
    row: &mut RowMut<'_>,
) {
    let own = &row.front[first..row.front.len().min(first + 2 * LANES)];
    let half = 0.5 * edge_px;
    let beside = join(simd, Vec4::splat(-half), Vec4::splat(half));
    let (above, below) = if row.y & 1 == 1 { (half, half * -3.0) } else { (-half, half * 3.0) };
    let [above, below] = [simd.splat_f32x8(above), simd.splat_f32x8(below)];
    // From the coarser pixel above to the finer centre it is half a finer pixel; from the
    // neighbours on the same side it is one and a half the other way.
    let near = [
        CoarserPixels { simd, run: runs[0], at: [1, 1], to_finer: [beside, above] },
        CoarserPixels { simd, run: runs[0], at: [0, 2], to_finer: [beside * -3.0, above] },
        CoarserPixels { simd, run: runs[1], at: [1, 1], to_finer: [beside, below] },
        CoarserPixels { simd, run: runs[1], at: [0, 2], to_finer: [beside * -3.0, below] },
    ];
    let (zero, infinite) = (simd.splat_f32x8(0.0), simd.splat_f32x8(f32::INFINITY));
    if is_empty(own) {
        // Most runs have no valid pixel of their own.
        let (least, displaced) = (infinite, [zero; 2]);
        let finer = FinerPixels { least, most: least, displaced, smoothing };
        return finer.fill::<PLANE, false>(&near, zero.cmpeq(zero), row, first);
    }
    let own = halves(own, INVALID);
    let [least, most] = [0, 1].map(|i| join(simd, own[0][i], own[1][i]));
    let is_valid = least.cmplt(infinite);
    let displaced = [
        only(is_valid, join(simd, own[0][2], own[1][2])),
        only(is_valid, join(simd, own[0][3], own[1][3])),
    ];
    let finer = FinerPixels { least, most, displaced, smoothing };
    let [above, beside @ ..] = &near;
    let mut candidates = !(is_valid & finer.is_within::<PLANE>(above));
    for near in beside {
        let is_wide = infinite.like(HIDING_PX).cmple(near.lane(Line::TINT + 3));
        if is_wide.any_true() {
            candidates |= is_wide & finer.is_behind::<PLANE>(near);
        }
    }
    if SMOOTHS || candidates.any_true() {
        finer.fill::<PLANE, SMOOTHS>(&near, candidates, row, first);
    }
}

/// A run of finer pixels: every second one, then the others.
struct FinerPixels<S: Simd> {
    /// Ends of their depth intervals; infinite where a pixel is invalid.
    least: f32x8<S>,
    most: f32x8<S>,
    /// To the pixels' centres from where depths are compared: the centres of their ellipses, or of
    /// the pixels where they are invalid.
    displaced: [f32x8<S>; 2],
    /// Share of the usual smoothing of pixels that stay.
    smoothing: f32,
}

impl<S: Simd> FinerPixels<S> {
    /// Which pixels lie within the intervals of the coarser pixels above.
    #[inline(always)]
    fn is_within<const PLANE: usize>(&self, above: &CoarserPixels<'_, S>) -> mask32x8<S> {
        let (least, most) = (above.lane(Line::FRONT), above.lane(Line::FRONT + 1));
        if PLANE == FLAT {
            return least.cmple(self.least) & self.least.cmple(most);
        }
        let moved = above.moved::<PLANE>(self.from(above.displaced()));
        (least * moved * ROUNDING).cmple(self.least) & self.least.cmple(most * moved)
    }

    /// Which pixels lie behind the interval of a coarser pixel.
    #[inline(always)]
    fn is_behind<const PLANE: usize>(&self, near: &CoarserPixels<'_, S>) -> mask32x8<S> {
        let [least, mut most] = [0, 1].map(|i| near.lane(Line::FRONT + i));
        if PLANE != FLAT {
            most *= near.moved::<PLANE>(self.from(near.displaced()));
        }
        least.cmplt(least.like(f32::INFINITY)) & most.cmplt(self.least)
    }

    /// From the centres of ellipses, whose distance to the pixels is `displaced`, to where depths
    /// are compared.
    #[inline(always)]
    fn from(&self, displaced: [f32x8<S>; 2]) -> [f32x8<S>; 2] {
        [displaced[0] - self.displaced[0], displaced[1] - self.displaced[1]]
    }

    /// Depth intervals of coarser pixels, moved to where depths are compared; infinite where a
    /// coarser pixel is invalid.
    #[inline(always)]
    fn interval<const PLANE: usize>(&self, near: &CoarserPixels<'_, S>) -> Interval<S> {
        let (mut least, mut most) = (near.lane(Line::FRONT), near.lane(Line::FRONT + 1));
        let infinite = least.like(f32::INFINITY);
        let is_valid = least.cmplt(infinite);
        if PLANE != FLAT {
            let moved = near.moved::<PLANE>(self.from(near.displaced()));
            (least, most) = (least * moved, most * moved);
        }
        [least, most].map(|depth| f32x8::select(is_valid, depth, infinite))
    }

    /// Which pixels lie behind all four coarser pixels and between the centres of their ellipses.
    #[inline(always)]
    fn is_enclosed(&self, near: &Near<'_, S>, intervals: &[Interval<S>; 4]) -> mask32x8<S> {
        let zero = self.least.like(0.0);
        let mut is_enclosed = self.least.cmplt(zero.like(f32::INFINITY));
        // Extent of the centres along four directions, on both sides of the pixel.
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

    /// Interpolates the pixels of `candidates` that an ellipse covers in front of them, and writes
    /// them. If `SMOOTHS`, also smooths the valid pixels that stay.
    #[inline(always)]
    fn fill<const PLANE: usize, const SMOOTHS: bool>(
        &self,
        near: &Near<'_, S>,
        candidates: mask32x8<S>,
        row: &mut RowMut<'_>,
        first: usize,
    ) {
        let cover = self.cover::<PLANE>(near, candidates);
        let (zero, infinite) = (self.least.like(0.0), self.least.like(f32::INFINITY));
        // Otherwise nothing covers the pixel, or it is valid (finite) and not behind the cover.
        let is_new = candidates & cover.nearest.cmplt(infinite) & cover.limit.cmplt(self.least);
        let is_kept = !is_new & self.least.cmplt(infinite);
        let smooths = SMOOTHS && is_kept.any_true();
        if !smooths && !is_new.any_true() {
            return;
        }
        let mut own_normal = [zero; 3];
        if smooths && PLANE == NORMALS {
            own_normal = normals_of(zero.token(), row, first);
        }
        let smoothed = smooths.then_some((is_kept, own_normal));
        let (weights, sum) = self.weights::<PLANE>(near, &cover, is_new, smoothed);
        let [tint, plane] = mean_attributes::<PLANE, S>(near, &weights);
        if smooths {
            let share = split(sum * (SMOOTH * self.smoothing / WEIGHTS.iter().sum::<f32>()));
            smooth::<PLANE>(bits(is_kept), share, [tint, plane], row, first);
            if !is_new.any_true() {
                return;
            }
        }
        Interpolated::new::<PLANE, S>(near, weights, [tint, plane])
            .write::<PLANE, S>(is_new, row, first);
    }

    /// Depth intervals of the coarser pixels whose ellipses cover the finer ones, and the frontmost
    /// of them.
    #[inline(always)]
    fn cover<const PLANE: usize>(&self, near: &Near<'_, S>, candidates: mask32x8<S>) -> Cover<S> {
        let [a, b, c, d] = near;
        let mut intervals = [
            self.interval::<PLANE>(a),
            self.interval::<PLANE>(b),
            self.interval::<PLANE>(c),
            self.interval::<PLANE>(d),
        ];
        let (zero, infinite) = (self.least.like(0.0), self.least.like(f32::INFINITY));
        let is_valid = candidates & self.least.cmplt(infinite);
        let mut is_enclosed = zero.cmplt(zero);
        if PLANE == NORMALS && is_valid.any_true() {
            is_enclosed = is_valid & self.is_enclosed(near, &intervals);
        }
        for (near, interval) in near.iter().zip(&mut intervals) {
            let covers = near.covers::<PLANE>() | is_enclosed;
            *interval = interval.map(|depth| f32x8::select(covers, depth, infinite));
        }
        let (mut nearest, mut limit) = (infinite, infinite);
        for [least, most] in &intervals {
            let is_nearer = least.cmplt(nearest);
            limit = f32x8::select(is_nearer, *most, limit);
            nearest = f32x8::select(is_nearer, *least, nearest);
        }
        Cover { intervals, nearest, limit }
    }

    /// Weights of the coarser pixels, which add up to one, and their sum before they were
    /// normalised. `smoothed` has the pixels to be smoothed and their normals, if there are any.
    #[inline(always)]
    fn weights<const PLANE: usize>(
        &self,
        near: &Near<'_, S>,
        cover: &Cover<S>,
        is_new: mask32x8<S>,
        smoothed: Option<(mask32x8<S>, [f32x8<S>; 3])>,
    ) -> ([f32x8<S>; 4], f32x8<S>) {
        let (zero, infinite) = (self.least.like(0.0), self.least.like(f32::INFINITY));
        let (mut weights, mut sum) = ([zero; 4], zero);
        for (t, weight) in weights.iter_mut().enumerate() {
            let [least, most] = cover.intervals[t];
            let mut takes_part = least.cmple(cover.limit);
            if let Some((is_kept, own_normal)) = smoothed {
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
        (weights, sum)
    }
}

/// Depth intervals of the coarser pixels that cover finer ones; infinite where a coarser pixel does
/// not.
struct Cover<S: Simd> {
    intervals: [Interval<S>; 4],
    /// Least depth of the frontmost interval.
    nearest: f32x8<S>,
    /// Greatest depth of the frontmost interval.
    limit: f32x8<S>,
}

/// Whether two normals of any length make a small angle, or one of them is zero. False where a
/// component is NaN.
#[inline(always)]
fn are_near<V: Values>(a: [V; 3], b: [V; 3]) -> V::Mask {
    let along = dot(a, b);
    (dot(a, a) * NEAR * dot(b, b)).cmple(along * along.max(along.like(0.0)))
}
