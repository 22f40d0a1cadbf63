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

use crate::ellipse::{FACING, covers};
use crate::pyramid::{INVALID, Level, Pyramid, RowMut, for_each_row};
use glam::{Vec2, Vec4};
use std::ops::Range;

/// Weights of the coarser pixel above, its neighbours to the side and up or down, and the diagonal one:
/// the biquadratic B-spline's, times 16.
const WEIGHTS: [f32; 4] = [9.0, 3.0, 3.0, 1.0];

/// Fills the levels from the second coarsest down to the picture.
pub fn push(pyramid: &mut Pyramid) {
    let has_normals = pyramid.has_normals();
    for i in (1..pyramid.levels.len()).rev() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        if has_normals {
            push_level::<true>(&coarser[0], &mut finer[i - 1]);
        } else {
            push_level::<false>(&coarser[0], &mut finer[i - 1]);
        }
    }
}

/// Recomputes the invalid and occluded pixels of `finer` from `coarser`.
fn push_level<const NORMALS: bool>(coarser: &Level, finer: &mut Level) {
    let edge_px = finer.edge_px;
    for_each_row(finer, |row| push_row::<NORMALS>(coarser, edge_px, row));
}

fn push_row<const NORMALS: bool>(coarser: &Level, edge_px: f32, mut row: RowMut<'_>) {
    let above = (row.y / 2) * coarser.width;
    // The nearer neighbour up or down; none at the picture's edge.
    let odd_row = row.y & 1 == 1;
    let beside = if odd_row { row.y / 2 + 1 < coarser.height } else { row.y > 1 };
    let beside =
        beside.then(|| if odd_row { above + coarser.width } else { above - coarser.width });
    for x in reached(coarser, above, beside, row.front.len()) {
        let (own, parent) = (row.front[x], above + x / 2);
        let cover = coarser.front[parent];
        if own.x < f32::INFINITY && own.x >= cover.x && own.x <= cover.y {
            continue;
        }
        let odd = x & 1 == 1;
        let has_side = if odd { x / 2 + 1 < coarser.width } else { x > 1 };
        let sideways = |p: usize| if odd { p + 1 } else { p - 1 };
        let [side, below] = [has_side.then(|| sideways(parent)), beside.map(|b| b + x / 2)];
        let diagonal = if has_side { below.map(sideways) } else { None };
        let near = [Some(parent), side, below, diagonal];
        let fronts = near.map(|p| p.map_or(INVALID, |p| coarser.front[p]));
        if fronts.iter().all(|f| f.x == f32::INFINITY) {
            continue;
        }
        // To the finer centre from the coarser one above, half a finer pixel; from its neighbours,
        // which lie on the same side, one and a half the other way.
        let half =
            Vec2::new(if odd { 0.5 } else { -0.5 }, if odd_row { 0.5 } else { -0.5 }) * edge_px;
        let far = half * -3.0;
        let to_finer = [half, Vec2::new(far.x, half.y), Vec2::new(half.x, far.y), far];
        if let Some(taken) = choose::<NORMALS>(coarser, own.x, near, fronts, to_finer) {
            blend::<NORMALS>(coarser, &taken, x, &mut row);
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
}

/// The coarser pixels that a pixel is interpolated from, with weights that add up to one; those that
/// take no part have weight 0. `None` where the pixel stays as it is.
fn choose<const NORMALS: bool>(
    coarser: &Level,
    own_depth: f32,
    near: [Option<usize>; 4],
    fronts: [Vec4; 4],
    to_finer: [Vec2; 4],
) -> Option<[Taken; 4]> {
    let mut taken = [Taken { pixel: 0, weight: 0.0, front: INVALID, to_finer: Vec2::ZERO }; 4];
    let mut nearest = INVALID;
    for k in 0..4 {
        let (Some(pixel), front) = (near[k], fronts[k]) else { continue };
        if front.x == f32::INFINITY {
            continue;
        }
        let from_ellipse = to_finer[k] + Vec2::new(front.z, front.w);
        let normal = if NORMALS { coarser.normal[pixel] } else { FACING };
        if covers(from_ellipse, coarser.tint[pixel].w, normal) {
            taken[k] = Taken { pixel, weight: WEIGHTS[k], front, to_finer: to_finer[k] };
            if front.x < nearest.x {
                nearest = front;
            }
        }
    }
    // Nothing covers it; or it is valid (finite) and not behind what does.
    if nearest.x == f32::INFINITY || own_depth <= nearest.y {
        return None;
    }
    let mut sum = 0.0;
    for t in &mut taken {
        if t.front.x > nearest.y {
            t.weight = 0.0;
        }
        sum += t.weight;
    }
    for t in &mut taken {
        t.weight /= sum;
    }
    Some(taken)
}

/// Writes the weighted mean of the pixels taken.
fn blend<const NORMALS: bool>(coarser: &Level, taken: &[Taken; 4], x: usize, row: &mut RowMut<'_>) {
    let (mut front, mut tint, mut depth, mut normal) = (Vec4::ZERO, Vec4::ZERO, 0.0, Vec4::ZERO);
    for t in taken {
        if t.weight == 0.0 {
            continue;
        }
        front += (t.front + Vec4::new(0.0, 0.0, t.to_finer.x, t.to_finer.y)) * t.weight;
        tint += coarser.tint[t.pixel] * t.weight;
        depth += coarser.depth[t.pixel] * t.weight;
        if NORMALS {
            normal += coarser.normal[t.pixel] * t.weight;
        }
    }
    row.front[x] = front;
    row.tint[x] = tint;
    row.depth[x] = depth;
    if NORMALS {
        row.normal[x] = normal;
    }
}
