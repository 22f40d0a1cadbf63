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

use crate::ellipse::{FACING, covers};
use crate::pyramid::{INVALID, Level, Pyramid, RowMut, for_each_row};
use crate::tangent::Lens;
use glam::{Vec2, Vec4};
use std::ops::Range;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal one:
/// the biquadratic B-spline's, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// A rounding less than one: what a pixel has given to the coarser one is not to be in front of it.
const ROUNDING: f32 = 0.99999;

/// Fills the levels from the second coarsest down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    let (has_normals, lens) = (pyramid.has_normals(), pyramid.lens);
    for i in (1..pyramid.levels.len()).rev() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        let above = Above { lens, level: &coarser[0] };
        if has_normals {
            push_level::<true>(&above, &mut finer[i - 1]);
        } else {
            push_level::<false>(&above, &mut finer[i - 1]);
        }
    }
}

/// The coarser level.
struct Above<'a> {
    lens: Lens,
    level: &'a Level,
}

impl Above<'_> {
    /// What depths of a pixel at `centre` change by to `place`.
    #[inline(always)]
    fn factor<const NORMALS: bool>(&self, pixel: usize, centre: Vec2, place: Vec2) -> f32 {
        if !NORMALS {
            return 1.0;
        }
        let front = self.level.front[pixel];
        let from = centre - Vec2::new(front.z, front.w);
        self.lens.along(self.level.normal[pixel], from, place - from)
    }
}

/// Recomputes the invalid and occluded pixels of `finer` from `coarser`.
fn push_level<const NORMALS: bool>(above: &Above<'_>, finer: &mut Level) {
    let edge_px = finer.edge_px;
    for_each_row(finer, |row| push_row::<NORMALS>(above, edge_px, row));
}

fn push_row<const NORMALS: bool>(above: &Above<'_>, edge_px: f32, mut row: RowMut<'_>) {
    let coarser = above.level;
    let over = (row.y / 2) * coarser.width;
    // The nearer neighbour up or down; none at the picture's edge.
    let odd_row = row.y & 1 == 1;
    let beside = if odd_row { row.y / 2 + 1 < coarser.height } else { row.y > 1 };
    let beside = beside.then(|| if odd_row { over + coarser.width } else { over - coarser.width });
    for x in reached(coarser, over, beside, row.front.len()) {
        let (own, parent) = (row.front[x], over + x / 2);
        let cover = coarser.front[parent];
        let odd = x & 1 == 1;
        // To the finer centre from the coarser one above, half a finer pixel; from its neighbours,
        // which lie on the same side, one and a half the other way.
        let half =
            Vec2::new(if odd { 0.5 } else { -0.5 }, if odd_row { 0.5 } else { -0.5 }) * edge_px;
        let far = half * -3.0;
        let to_finer = [half, Vec2::new(far.x, half.y), Vec2::new(half.x, far.y), far];
        let centre = Vec2::new(x as f32 + 0.5, row.y as f32 + 0.5) * edge_px;
        let is_valid = own.x < f32::INFINITY;
        // Where depths are compared.
        let place = if is_valid { centre - Vec2::new(own.z, own.w) } else { centre };
        if is_valid {
            let factor = above.factor::<NORMALS>(parent, centre - half, place);
            let least = if NORMALS { factor * ROUNDING } else { factor };
            if own.x >= cover.x * least && own.x <= cover.y * factor {
                continue;
            }
        }
        let has_side = if odd { x / 2 + 1 < coarser.width } else { x > 1 };
        let sideways = |p: usize| if odd { p + 1 } else { p - 1 };
        let [side, below] = [has_side.then(|| sideways(parent)), beside.map(|b| b + x / 2)];
        let diagonal = if has_side { below.map(sideways) } else { None };
        let near = [Some(parent), side, below, diagonal];
        let fronts = near.map(|p| p.map_or(INVALID, |p| coarser.front[p]));
        if fronts.iter().all(|f| f.x == f32::INFINITY) {
            continue;
        }
        let mut taken = [Taken {
            pixel: 0,
            weight: 0.0,
            front: INVALID,
            to_finer: Vec2::ZERO,
            depths: Vec2::MAX,
        }; 4];
        for k in 0..4 {
            let (Some(pixel), front) = (near[k], fronts[k]) else { continue };
            if front.x == f32::INFINITY {
                continue;
            }
            let from_ellipse = to_finer[k] + Vec2::new(front.z, front.w);
            let normal = if NORMALS { coarser.normal[pixel] } else { FACING };
            if covers(from_ellipse, coarser.tint[pixel].w, normal) {
                let factor = above.factor::<NORMALS>(pixel, centre - to_finer[k], place);
                let depths = Vec2::new(front.x, front.y) * factor;
                taken[k] =
                    Taken { pixel, weight: WEIGHTS[k], front, to_finer: to_finer[k], depths };
            }
        }
        if choose(own.x, &mut taken) {
            blend::<NORMALS>(above, &taken, centre, x, &mut row);
        }
    }
}

/// The pixels of a finer row of `width` that something of its two coarser rows may reach; others stay as they are.
fn reached(coarser: &Level, above: usize, beside: Option<usize>, width: usize) -> Range<usize> {
    let rows = [Some(above), beside].into_iter().flatten();
    let valid = rows.filter_map(|first| {
        let row = &coarser.front[first..first + coarser.width];
        let is_valid = |front: &Vec4| front.x < f32::INFINITY;
        Some((row.iter().position(is_valid)?, row.iter().rposition(is_valid)?))
    });
    let both = valid.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    // A coarser pixel reaches the two below it and one on either side.
    both.map_or(0..0, |(first, last)| (2 * first).saturating_sub(1)..(2 * last + 3).min(width))
}

/// A coarser pixel that takes part.
#[derive(Clone, Copy)]
struct Taken {
    pixel: usize,
    weight: f32,
    front: Vec4,
    /// From the coarser centre to the finer.
    to_finer: Vec2,
    /// Its least and greatest depth where they are compared.
    depths: Vec2,
}

/// Gives those that a pixel is interpolated from weights that add up to one, the others none. Whether the pixel does
/// not stay as it is.
fn choose(own_depth: f32, taken: &mut [Taken; 4]) -> bool {
    let (mut nearest, mut limit) = (f32::INFINITY, f32::INFINITY);
    for t in taken.iter().filter(|t| t.weight > 0.0) {
        if t.depths.x < nearest {
            (nearest, limit) = (t.depths.x, t.depths.y);
        }
    }
    // Nothing covers it; or it is valid (finite) and not behind what does.
    if nearest == f32::INFINITY || own_depth <= limit {
        return false;
    }
    let mut sum = 0.0;
    for t in taken.iter_mut() {
        if t.depths.x > limit {
            t.weight = 0.0;
        }
        sum += t.weight;
    }
    taken.iter_mut().for_each(|t| t.weight /= sum);
    true
}

/// Writes the weighted mean of the pixels taken.
fn blend<const NORMALS: bool>(
    above: &Above<'_>,
    taken: &[Taken; 4],
    centre: Vec2,
    x: usize,
    row: &mut RowMut<'_>,
) {
    let coarser = above.level;
    let taken = || taken.iter().filter(|t| t.weight > 0.0);
    let displaced = |t: &Taken| Vec2::new(t.front.z, t.front.w) + t.to_finer;
    let middle = taken().fold(Vec2::ZERO, |sum, t| sum + displaced(t) * t.weight);
    let (mut depths, mut tint, mut depth, mut normal) = (Vec2::ZERO, Vec4::ZERO, 0.0, Vec4::ZERO);
    for t in taken() {
        let factor = above.factor::<NORMALS>(t.pixel, centre - t.to_finer, centre - middle);
        depths += Vec2::new(t.front.x, t.front.y) * (factor * t.weight);
        tint += coarser.tint[t.pixel] * t.weight;
        depth += coarser.depth[t.pixel] * (factor * t.weight);
        if NORMALS {
            normal += coarser.normal[t.pixel] * t.weight;
        }
    }
    row.front[x] = Vec4::new(depths.x, depths.y, middle.x, middle.y);
    row.tint[x] = tint;
    row.depth[x] = depth;
    if NORMALS {
        row.normal[x] = normal;
    }
}
