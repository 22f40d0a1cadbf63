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
//! - All attributes are interpolated, the two ends of the depth interval as well; to displacements the
//!   vector between the centres is added, as in the pull phase.
//!
//! Where pixels have normals, depths are moved along their planes ([`crate::tangent`]): compared where the pixel's own
//! ellipse has its centre, or at the pixel's centre where it has none, and interpolated where the new one's is.

use crate::ellipse::covers_at;
use crate::lanes::{
    LANES, Lane, Line, Mask, Pixels, Run, counting, halves, has_pixels, only, valid,
};
use crate::pyramid::{INVALID, Level, Pyramid, RowMut, Rows, for_each_band};
use crate::tangent::{Lens, factor, turn};
use fearless_simd::{Level as Simd, dispatch};
use glam::Vec4;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal one:
/// the biquadratic B-spline's, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// A rounding less than one: what a pixel has given to the coarser one is not to be in front of it.
const ROUNDING: f32 = 0.99999;

/// Fills the levels from the second coarsest down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    push_with(pyramid, &mut []);
}

/// The same, and writes the picture's depth image ([`crate::pyramid::Level::depth_image`]) while its rows are at hand.
pub fn push_with(pyramid: &mut Pyramid, image: &mut [f32]) {
    if let [base] = &pyramid.levels[..] {
        return base.depth_image(&pyramid.lens, image);
    }
    let (has_normals, lens) = (pyramid.has_normals(), pyramid.lens);
    for i in (1..pyramid.levels.len()).rev() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        let (finer, coarser) = (&mut finer[i - 1], &coarser[0]);
        let edge_px = finer.edge_px;
        let image: &mut [f32] = if i == 1 { &mut *image } else { &mut [] };
        if has_normals {
            for_each_band(finer, image, |rows| {
                dispatch!(Simd::new(), _ => push_rows::<true>(&lens, coarser, edge_px, rows));
            });
        } else {
            for_each_band(finer, image, |rows| {
                dispatch!(Simd::new(), _ => push_rows::<false>(&lens, coarser, edge_px, rows));
            });
        }
    }
}

/// Recomputes the invalid and occluded pixels of rows from `coarser`.
#[inline(always)]
fn push_rows<const NORMALS: bool>(lens: &Lens, coarser: &Level, edge_px: f32, rows: Rows<'_>) {
    // The coarser rows in use, by the last bit of their number.
    let mut lines = [(None, Line::default()), (None, Line::default())];
    for mut row in rows {
        let over = row.y / 2;
        // The nearer neighbour up or down; none at the picture's edge.
        let beside = if row.y & 1 == 1 { over + 1 } else { over.wrapping_sub(1) };
        for y in [over, beside] {
            let (held, line) = &mut lines[y & 1];
            if *held != Some(y) {
                line.take(coarser, Some(y).filter(|&y| y < coarser.height));
                *held = Some(y);
            }
        }
        let (over, beside) = (&lines[over & 1].1, &lines[beside & 1].1);
        for block in 0..coarser.width.div_ceil(LANES) {
            let runs = [over.run(block), beside.run(block)];
            if has_pixels(runs[0]) || has_pixels(runs[1]) {
                push_block::<NORMALS>(lens, edge_px, runs, block * LANES, &mut row);
            }
        }
        row.write_image(lens, edge_px);
    }
}

/// Recomputes the pixels of a row below four coarser ones. `runs` are of the row above it and of the nearer one beside
/// that.
#[inline(always)]
fn push_block<const NORMALS: bool>(
    lens: &Lens,
    edge_px: f32,
    runs: [&Run; 2],
    first: usize,
    row: &mut RowMut<'_>,
) {
    let below = 2 * first..row.front.len().min(2 * (first + LANES));
    let [even, odd] = halves(&row.front[below], INVALID);
    push_half::<NORMALS, 0>(lens, edge_px, runs, first, row, even);
    push_half::<NORMALS, 1>(lens, edge_px, runs, first, row, odd);
}

/// Those of them to the left (`ODD` is 0) or to the right, whose fronts are `own`.
#[inline(always)]
fn push_half<const NORMALS: bool, const ODD: usize>(
    lens: &Lens,
    edge_px: f32,
    runs: [&Run; 2],
    first: usize,
    row: &mut RowMut<'_>,
    own: [Lane; 4],
) {
    let across = if ODD == 1 { 0.5 } else { -0.5 } * edge_px;
    let down = if row.y & 1 == 1 { 0.5 } else { -0.5 } * edge_px;
    // To the finer centre from the coarser one above, half a finer pixel; from its neighbours, which lie on the
    // same side, one and a half the other way.
    let near = |run, at, right, down| Near { run, at, to_finer: [right, down] };
    let near = [
        near(runs[0], 1, across, down),
        near(runs[0], 2 * ODD, across * -3.0, down),
        near(runs[1], 1, across, down * -3.0),
        near(runs[1], 2 * ODD, across * -3.0, down * -3.0),
    ];
    let centre = [
        counting(((2 * first + ODD) as f32 + 0.5) * edge_px, 2.0 * edge_px),
        Vec4::splat((row.y as f32 + 0.5) * edge_px),
    ];
    let is_valid = valid(own[0]);
    let place = [centre[0] - only(is_valid, own[2]), centre[1] - only(is_valid, own[3])];
    let block = Block { least: own[0], centre, place };
    let asking = !(is_valid & block.is_within::<NORMALS>(lens, &near[0]));
    if asking.any() {
        block.fill::<NORMALS>(lens, &near, asking, row, 2 * first + ODD);
    }
}

/// The coarser pixels that lie on one side of finer ones.
struct Near<'a> {
    run: &'a Run,
    /// Where the first of them is in the run.
    at: usize,
    /// From their centres to the finer ones.
    to_finer: [f32; 2],
}

impl Near<'_> {
    #[inline(always)]
    fn lane(&self, plane: usize) -> Lane {
        Vec4::from_slice(&self.run[plane][self.at..self.at + LANES])
    }

    #[inline(always)]
    fn normal(&self) -> [Lane; 3] {
        let at = Line::NORMAL;
        [self.lane(at), self.lane(at + 1), self.lane(at + 2)]
    }

    /// From the ellipses' centres to the finer pixels'.
    #[inline(always)]
    fn displaced(&self) -> [Lane; 2] {
        let at = Line::FRONT + 2;
        [self.lane(at) + self.to_finer[0], self.lane(at + 1) + self.to_finer[1]]
    }
}

/// Coarser pixels as seen from the finer ones.
struct Seen {
    /// Depths where they are compared; infinite where the ellipse does not cover the finer pixel.
    depths: [Lane; 2],
    /// q of their planes at the ellipses' centres ([`crate::tangent`]).
    facing: Lane,
}

/// Every second pixel of a run of finer ones.
struct Block {
    /// Their own least depths.
    least: Lane,
    centre: [Lane; 2],
    /// Where depths are compared: at their ellipses' centres, or at their own where they are invalid.
    place: [Lane; 2],
}

impl Block {
    /// Which are within the intervals of the coarser pixels above.
    #[inline(always)]
    fn is_within<const NORMALS: bool>(&self, lens: &Lens, above: &Near<'_>) -> Mask {
        let (least, most) = (above.lane(Line::FRONT), above.lane(Line::FRONT + 1));
        if !NORMALS {
            return self.least.cmpge(least) & self.least.cmple(most);
        }
        let (normal, from) = (above.normal(), self.from(above));
        let moved = factor(lens.facing(normal, from), turn(normal, self.by(from)));
        self.least.cmpge(least * moved * ROUNDING) & self.least.cmple(most * moved)
    }

    /// The centres of coarser pixels' ellipses.
    #[inline(always)]
    fn from(&self, near: &Near<'_>) -> [Lane; 2] {
        let displaced = near.displaced();
        [self.centre[0] - displaced[0], self.centre[1] - displaced[1]]
    }

    /// From a place to where depths are compared.
    #[inline(always)]
    fn by(&self, from: [Lane; 2]) -> [Lane; 2] {
        [self.place[0] - from[0], self.place[1] - from[1]]
    }

    #[inline(always)]
    fn see<const NORMALS: bool>(&self, lens: &Lens, near: &Near<'_>) -> Seen {
        let (least, most) = (near.lane(Line::FRONT), near.lane(Line::FRONT + 1));
        let (mut facing, mut moved) = (Vec4::ZERO, Vec4::ONE);
        let mut disc = [Vec4::ZERO, Vec4::ZERO, Vec4::ONE];
        if NORMALS {
            let (normal, from) = (near.normal(), self.from(near));
            facing = lens.facing(normal, from);
            moved = factor(facing, turn(normal, self.by(from)));
            disc = [normal[0], normal[1], near.lane(Line::NORMAL + 3)];
        }
        let covers = covers_at(near.displaced(), near.lane(Line::TINT + 3), disc) & valid(least);
        let seen = |depth: Lane| Vec4::select(covers, depth * moved, Vec4::INFINITY);
        Seen { depths: [seen(least), seen(most)], facing }
    }

    /// Interpolates those that are `asking`, and writes those that something covers.
    #[inline(always)]
    fn fill<const NORMALS: bool>(
        &self,
        lens: &Lens,
        near: &[Near<'_>; 4],
        asking: Mask,
        row: &mut RowMut<'_>,
        first: usize,
    ) {
        let [a, b, c, d] = near;
        let seen = [
            self.see::<NORMALS>(lens, a),
            self.see::<NORMALS>(lens, b),
            self.see::<NORMALS>(lens, c),
            self.see::<NORMALS>(lens, d),
        ];
        let (mut nearest, mut limit) = (Vec4::INFINITY, Vec4::INFINITY);
        for Seen { depths: [least, most], .. } in &seen {
            let is_nearer = least.cmplt(nearest);
            limit = Vec4::select(is_nearer, *most, limit);
            nearest = Vec4::select(is_nearer, *least, nearest);
        }
        // Else nothing covers it; or it is valid (finite) and not behind what does.
        let is_new = asking & valid(nearest) & self.least.cmpgt(limit);
        if !is_new.any() {
            return;
        }
        let (mut weights, mut sum) = ([Vec4::ZERO; 4], Vec4::ZERO);
        for (t, weight) in weights.iter_mut().enumerate() {
            let least = seen[t].depths[0];
            *weight = only(valid(least) & least.cmple(limit), Vec4::splat(WEIGHTS[t]));
            sum += *weight;
        }
        let mut middle = [Vec4::ZERO; 2];
        for (near, weight) in near.iter().zip(&mut weights) {
            *weight /= sum;
            let displaced = near.displaced();
            middle[0] += displaced[0] * *weight;
            middle[1] += displaced[1] * *weight;
        }
        let place = [self.centre[0] - middle[0], self.centre[1] - middle[1]];
        let mut moved = weights;
        for (t, near) in near.iter().enumerate().filter(|_| NORMALS) {
            let (normal, from) = (near.normal(), self.from(near));
            let by = [place[0] - from[0], place[1] - from[1]];
            moved[t] *= factor(seen[t].facing, turn(normal, by));
        }
        let of = |plane: usize, weights: &[Lane; 4]| mean_of(near, plane, weights);
        let mut out = Pixels {
            front: [of(Line::FRONT, &moved), of(Line::FRONT + 1, &moved), middle[0], middle[1]],
            tint: [Vec4::ZERO; 4],
            depth: of(Line::DEPTH, &moved),
            normal: [Vec4::ZERO; 4],
        };
        let of = |plane: usize| mean_of(near, plane, &weights);
        for i in 0..4 {
            out.tint[i] = of(Line::TINT + i);
            if NORMALS {
                out.normal[i] = of(Line::NORMAL + i);
            }
        }
        out.write::<NORMALS>(is_new, row, first, 2);
    }
}

/// The weighted mean of a plane. What has no weight may be no number.
#[inline(always)]
fn mean_of(near: &[Near<'_>; 4], plane: usize, weights: &[Lane; 4]) -> Lane {
    let [a, b, c, d] = near;
    let part =
        |near: &Near<'_>, weight: Lane| only(weight.cmpgt(Vec4::ZERO), near.lane(plane) * weight);
    part(a, weights[0]) + part(b, weights[1]) + part(c, weights[2]) + part(d, weights[3])
}
