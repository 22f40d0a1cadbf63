//! Pull (`marroquim2007`, section 3.2): averages each level of the pyramid into the next coarser
//! one.
//!
//! A coarse pixel is the mean of those of its four finer pixels that are valid and whose depth
//! interval meets that of the frontmost (the one of least depth; of equal ones the first, row by
//! row). Its own interval is the union of theirs. The vector from the finer pixel's centre to the
//! coarser one's is added to each displacement, so that it still points from the ellipse's exact
//! centre to the pixel's.
//!
//! Where pixels have planes, depths are moved along them ([`crate::passes::tangent`]): to the mean
//! centre of the valid pixels to be compared, and to the mean centre of those that take part to be
//! averaged.

use crate::passes::tangent::Lens;
use crate::picture::pyramid::{
    FITTED, FLAT, INVALID, Level, NORMALS, Planes, Pyramid, RowMut, for_each_row,
};
use crate::simd::lanes::{
    LANES, Pixels, counting, halves, halves_of_planes, halves_of_values, is_empty, moved, only,
    valid,
};
use crate::simd::values::{Lane, Mask};
use fearless_simd::{Level as Simd, dispatch};
use glam::Vec4;
use std::ops::Range;

/// Square of the length from which a mean of normals is one. Shorter means are of pixels most of
/// which have none, or that do not agree, as in leaves: no plane goes through them.
pub(crate) const AGREE2: f32 = 0.16;

/// Fills all levels above the finest.
pub fn pull(pyramid: &mut Pyramid) {
    let (planes, lens) = (pyramid.planes(), pyramid.lens);
    for i in 1..pyramid.levels.len() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        let (finer, coarser) = (&finer[i - 1], &mut coarser[0]);
        match planes {
            Planes::None => pull_level::<FLAT>(&lens, finer, coarser),
            Planes::Fitted => pull_level::<FITTED>(&lens, finer, coarser),
            Planes::Normals => pull_level::<NORMALS>(&lens, finer, coarser),
        }
    }
}

fn pull_level<const PLANE: usize>(lens: &Lens, finer: &Level, coarser: &mut Level) {
    let edge_px = coarser.edge_px;
    for_each_row(coarser, |row| {
        dispatch!(Simd::new(), _ => pull_row::<PLANE>(lens, finer, edge_px, row));
    });
}

/// Averages two rows of `finer` into a row, four coarser pixels at a time.
#[inline(always)]
fn pull_row<const PLANE: usize>(lens: &Lens, finer: &Level, edge_px: f32, mut row: RowMut<'_>) {
    let quarter = finer.edge_px * 0.5;
    for first in (0..row.front.len()).step_by(LANES) {
        let end = row.front.len().min(first + LANES);
        let (upper, lower) = (run(finer, first, 2 * row.y), run(finer, first, 2 * row.y + 1));
        if is_empty(&finer.front[upper.clone()]) && is_empty(&finer.front[lower.clone()]) {
            row.front[first..end].fill(INVALID);
            continue;
        }
        let centre = [
            counting((first as f32 + 0.5) * edge_px, edge_px),
            Vec4::splat((row.y as f32 + 0.5) * edge_px),
        ];
        let [a, b] = pixels::<PLANE>(finer, upper);
        let [c, d] = pixels::<PLANE>(finer, lower);
        let out = Four::new([a, b, c, d], quarter).mean::<PLANE>(lens, centre);
        row.front[first..end].fill(INVALID);
        out.write::<PLANE>(valid(out.front[0]), &mut row, first, 1);
    }
}

/// Range of the finer pixels in row `y` below four coarser ones from `first` on.
#[inline(always)]
fn run(finer: &Level, first: usize, y: usize) -> Range<usize> {
    let start = y * finer.width;
    let run = start + 2 * first..start + finer.width.min(2 * (first + LANES));
    if y < finer.height { run } else { 0..0 }
}

/// Pixels of a run: the left one of each pair, and the right one.
#[inline(always)]
fn pixels<const PLANE: usize>(finer: &Level, run: Range<usize>) -> [Pixels; 2] {
    let front = halves(&finer.front[run.clone()], INVALID);
    let tint = halves(&finer.tint[run.clone()], Vec4::ZERO);
    let depth = halves_of_values(&finer.depth[run.clone()]);
    let normals = finer.normal.get(run.clone()).unwrap_or_default();
    let plane = halves_of_planes::<PLANE>(normals, finer.tilt.get(run).unwrap_or_default());
    let of = |i: usize| (front[i], tint[i], depth[i], plane[i]);
    let [left, right] = [of(0), of(1)];
    [
        Pixels { front: left.0, tint: left.1, depth: left.2, plane: left.3 },
        Pixels { front: right.0, tint: right.1, depth: right.2, plane: right.3 },
    ]
}

/// Finer pixels of four coarser ones, four of each: left and right, above and below.
struct Four {
    pixels: [Pixels; 4],
    /// Which pixels take part.
    kept: [Mask; 4],
    /// Displacements from the ellipses' centres to the coarser pixels' centres.
    displaced: [[Lane; 2]; 4],
}

impl Four {
    #[inline(always)]
    fn new(pixels: [Pixels; 4], quarter: f32) -> Self {
        // From the finer centre to the coarser one: half a finer pixel to the right or left, and
        // down or up.
        let mut displaced = [[Vec4::ZERO; 2]; 4];
        for (i, (displaced, pixels)) in displaced.iter_mut().zip(&pixels).enumerate() {
            let right = if i & 1 == 0 { quarter } else { -quarter };
            let down = if i >> 1 == 0 { quarter } else { -quarter };
            *displaced = [pixels.front[2] + right, pixels.front[3] + down];
        }
        let [a, b, c, d] = &pixels;
        let kept = [valid(a.front[0]), valid(b.front[0]), valid(c.front[0]), valid(d.front[0])];
        Self { pixels, kept, displaced }
    }

    /// Computes the coarser pixels, whose centres are `centre`. Their least depth is infinite if
    /// they are invalid.
    #[inline(always)]
    fn mean<const PLANE: usize>(mut self, lens: &Lens, centre: [Lane; 2]) -> Pixels {
        // q at the ellipses' centres ([`crate::passes::tangent`]).
        let mut facing = [Vec4::ZERO; 4];
        if PLANE == NORMALS {
            for (i, [x, y]) in self.displaced.into_iter().enumerate() {
                let [right, up, back, _] = self.pixels[i].plane;
                facing[i] = lens.facing([right, up, back], [centre[0] - x, centre[1] - y]);
            }
        }
        let mut middle = self.middle();
        let mut factors = self.factors::<PLANE>(&facing, middle);
        if self.keep_frontmost(&factors) {
            middle = self.middle();
            factors = self.factors::<PLANE>(&facing, middle);
        }
        let share = self.share();
        let (mut least, mut most) = (Vec4::INFINITY, Vec4::ZERO);
        let mut out = Pixels {
            front: [Vec4::ZERO; 4],
            tint: [Vec4::ZERO; 4],
            depth: Vec4::ZERO,
            plane: [Vec4::ZERO; 4],
        };
        for ((pixels, kept), factor) in self.pixels.iter().zip(self.kept).zip(factors) {
            let [near, far] = [pixels.front[0] * factor, pixels.front[1] * factor];
            least = Vec4::select(kept, least.min(near), least);
            most = Vec4::select(kept, most.max(far), most);
            out.depth += only(kept, pixels.depth * factor);
            for i in 0..4 {
                out.tint[i] += only(kept, pixels.tint[i]);
            }
            for i in 0..PLANE {
                out.plane[i] += only(kept, pixels.plane[i]);
            }
        }
        out.front = [least, most, middle[0], middle[1]];
        out.depth *= share;
        for i in 0..4 {
            out.tint[i] *= share;
            out.plane[i] *= share;
        }
        if PLANE == NORMALS {
            let [x, y, z, _] = out.plane;
            let agree = Vec4::splat(AGREE2).cmple(x * x + y * y + z * z);
            (0..3).for_each(|i| out.plane[i] = only(agree, out.plane[i]));
        }
        out
    }

    /// One over the number of pixels that take part; one if there are none.
    #[inline(always)]
    fn share(&self) -> Lane {
        let count = self.kept.iter().fold(Vec4::ZERO, |sum, &kept| sum + only(kept, Vec4::ONE));
        1.0 / count.max(Vec4::ONE)
    }

    /// Mean displacement of the pixels that take part.
    #[inline(always)]
    fn middle(&self) -> [Lane; 2] {
        let mut sum = [Vec4::ZERO; 2];
        for (&kept, displaced) in self.kept.iter().zip(&self.displaced) {
            sum[0] += only(kept, displaced[0]);
            sum[1] += only(kept, displaced[1]);
        }
        let share = self.share();
        [sum[0] * share, sum[1] * share]
    }

    /// Factors by which depths change from the ellipses' centres to the position whose displacement
    /// is `middle`.
    #[inline(always)]
    fn factors<const PLANE: usize>(&self, facing: &[Lane; 4], middle: [Lane; 2]) -> [Lane; 4] {
        let mut factors = [Vec4::ONE; 4];
        for i in (0..4).filter(|_| PLANE != FLAT) {
            let [x, y] = self.displaced[i];
            let [right, up, ..] = self.pixels[i].plane;
            let by = [x - middle[0], y - middle[1]];
            let moved = moved::<PLANE, _>([right, up], facing[i], by);
            factors[i] = Vec4::select(self.kept[i], moved, Vec4::ONE);
        }
        factors
    }

    /// Drops pixels whose depth interval does not meet that of the frontmost. Returns whether any
    /// was dropped.
    #[inline(always)]
    fn keep_frontmost(&mut self, factors: &[Lane; 4]) -> bool {
        let (mut least, mut limit) = (Vec4::INFINITY, Vec4::INFINITY);
        for (pixels, &factor) in self.pixels.iter().zip(factors) {
            let [near, far] = [pixels.front[0] * factor, pixels.front[1] * factor];
            let is_nearer = near.cmplt(least);
            limit = Vec4::select(is_nearer, far, limit);
            least = Vec4::select(is_nearer, near, least);
        }
        let mut drops = false;
        for ((kept, pixels), &factor) in self.kept.iter_mut().zip(&self.pixels).zip(factors) {
            let meets = (pixels.front[0] * factor).cmple(limit);
            drops |= (*kept & !meets).any();
            *kept &= meets;
        }
        drops
    }
}
