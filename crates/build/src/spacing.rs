//! Typical distances of points: that of a node's, which choice of detail rests on, and that around each point, its
//! covering radius.

use crate::candidates::shared_log2;
use crate::turn::radius_at;
use std::ops::Range;

/// Edge of the square that a point has for itself in a sample that was thinned to a radius, over the radius.
const SQUARE_EDGE: f64 = 1.15;
/// Up to this share of all points a thinned sample is as even as can be; with more, what else there is shows.
const EVEN_SHARE: usize = 4;
/// Points in a cell from which the local spacing is taken: enough that chance evens out.
const LOCAL_POINTS: usize = 8;
/// Few points with less than this share of the cell above are strays (a bird over a field): the density
/// around them is not theirs.
const STRAY_SHARE: usize = 16;

/// Typical distance, in the file's unit, of the first `drawn` of the points with these turns, in a cell of
/// `total` points: they stand as evenly as on a grid of this edge. For a part of all points it follows from the
/// radius at which they were picked, for more by how the number grows with shrinking radius.
pub fn spacing(turns: &[u16], drawn: usize, total: usize, dimension: u32) -> f64 {
    let first = turns.iter().copied().min().unwrap_or(0);
    let last = turns.iter().copied().max().unwrap_or(0);
    let mut counts = vec![0usize; usize::from(last - first) + 1];
    turns.iter().for_each(|turn| counts[usize::from(turn - first)] += 1);
    // Log2 of the radius at which so many are picked, between turns by their logarithms.
    let radius_log2 = |wanted: usize| -> f64 {
        let wanted = wanted.max(1);
        let mut before = 0;
        for (turn, n) in (first..).zip(&counts) {
            if before + n >= wanted {
                let log2 = radius_at(turn).log2();
                if before == 0 {
                    return log2;
                }
                let ratio = |a: usize, b: usize| (a as f64 / b as f64).log2();
                let share = ratio(wanted, before) / ratio(before + n, before);
                return log2 + (1.0 - share) * (radius_at(turn - 1).log2() - log2);
            }
            before += n;
        }
        radius_at(last).log2()
    };
    let even = (total / EVEN_SHARE).max(1);
    if drawn <= even {
        return SQUARE_EDGE * radius_log2(drawn).exp2();
    }
    let at = radius_log2(even);
    let octaves = radius_log2(even / EVEN_SHARE) - at;
    let growth = (EVEN_SHARE as f64).log2() / octaves;
    let local_dimension = growth.clamp(1.0, f64::from(dimension.max(1)));
    SQUARE_EDGE * at.exp2() * (even as f64 / drawn as f64).powf(1.0 / local_dimension)
}

/// The covering radius of each of some points along the Morton curve, in steps: the local spacing, that is the edge
/// of the square that a point has for itself where the points around it stand evenly. "Around it" is the smallest
/// octree cell with at least [`LOCAL_POINTS`] points. The greatest gap of an even sample is 0.84 of it, so an even
/// sample is covered; the diagonal of the square made silhouettes swell without closing a hole that the renderer's
/// own margin does not close. Laser scans are surfaces also where their node is a volume, so the local dimension
/// is at most 2. Coincident points and strays get 0, which the node's spacing replaces.
pub fn radii(q: impl Iterator<Item = [i32; 3]>, dimension: u32) -> Vec<f32> {
    let shared = shared_log2(q);
    let mut out = vec![0.0; shared.len()];
    let mut open = vec![(0..shared.len(), (0, 0.0))];
    while let Some((run, above)) = open.pop() {
        spread(&shared, run, above, dimension, &mut out, &mut open);
    }
    out
}

/// The points of the cell above, and the radius that they would have.
type Above = (usize, f32);

/// Gives the points of a cell their radius, or opens the cells in it.
fn spread(
    shared: &[u8],
    run: Range<usize>,
    above: Above,
    dimension: u32,
    out: &mut [f32],
    open: &mut Vec<(Range<usize>, Above)>,
) {
    let points = run.len();
    if points < LOCAL_POINTS && points < shared.len() {
        let is_stray = points * STRAY_SHARE < above.0;
        return out[run].fill(if is_stray { 0.0 } else { above.1 });
    }
    let inside = shared.get(run.start + 1..run.end).unwrap_or_default();
    let log2 = inside.iter().copied().max().unwrap_or(0);
    let edge = if log2 == 0 { 0.0 } else { (1u64 << log2) as f32 };
    let spacing = if dimension <= 1 { edge / points as f32 } else { edge / (points as f32).sqrt() };
    if log2 == 0 {
        return out[run].fill(spacing);
    }
    let mut start = run.start;
    let parts = inside.iter().enumerate().filter(|(_, l)| **l == log2);
    for end in parts.map(|(i, _)| run.start + 1 + i).chain([run.end]) {
        open.push((start..end, (points, spacing)));
        start = end;
    }
}
