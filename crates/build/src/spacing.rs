//! Typical distances of points: that of a node's, which choice of detail rests on, and that around each point, its
//! covering radius.

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

/// How many points were picked at each turn.
pub struct Picked {
    first: u16,
    counts: Vec<usize>,
    /// Points of all turns.
    points: usize,
}

impl Picked {
    /// Of points with these turns.
    pub fn of(turns: &[u16]) -> Self {
        let first = turns.iter().copied().min().unwrap_or(0);
        let last = turns.iter().copied().max().unwrap_or(0);
        let mut counts = vec![0usize; usize::from(last - first) + 1];
        turns.iter().for_each(|turn| counts[usize::from(turn - first)] += 1);
        Self { first, counts, points: turns.len() }
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.points
    }

    /// Log2 of the radius, in the file's unit, at which so many are picked, between turns by their logarithms.
    fn radius_log2(&self, wanted: usize) -> f64 {
        let wanted = wanted.max(1);
        let (mut before, mut last) = (0, self.first);
        for (turn, n) in (self.first..).zip(&self.counts) {
            if before + n >= wanted {
                let log2 = radius_at(turn).log2();
                if before == 0 {
                    return log2;
                }
                let ratio = |a: usize, b: usize| (a as f64 / b as f64).log2();
                let share = ratio(wanted, before) / ratio(before + n, before);
                return log2 + (1.0 - share) * (radius_at(turn - 1).log2() - log2);
            }
            (before, last) = (before + n, turn);
        }
        radius_at(last).log2()
    }

    /// Typical distance, in the file's unit, of the first `drawn` of the points, in a cell of `total` points: they stand
    /// as evenly as on a grid of this edge. For a part of all points it follows from the radius at which they were
    /// picked, for more by how the number grows with shrinking radius.
    pub fn spacing(&self, drawn: usize, total: usize, dimension: u32) -> f64 {
        let even = (total / EVEN_SHARE).max(1);
        if drawn <= even {
            return SQUARE_EDGE * self.radius_log2(drawn).exp2();
        }
        let at = self.radius_log2(even);
        let octaves = self.radius_log2(even / EVEN_SHARE) - at;
        let growth = (EVEN_SHARE as f64).log2() / octaves;
        let local_dimension = growth.clamp(1.0, f64::from(dimension.max(1)));
        SQUARE_EDGE * at.exp2() * (even as f64 / drawn as f64).powf(1.0 / local_dimension)
    }
}

/// The covering radius of each of some points along the Morton curve, in steps, told by
/// [`shared_log2`](crate::candidates::Candidates::shared_log2): the local spacing, that is the edge
/// of the square that a point has for itself where the points around it stand evenly. "Around it" is the smallest
/// octree cell with at least [`LOCAL_POINTS`] points. The greatest gap of an even sample is 0.84 of it, so an even
/// sample is covered; the diagonal of the square made silhouettes swell without closing a hole that the renderer's
/// own margin does not close. Laser scans are surfaces also where their node is a volume, so the local dimension
/// is at most 2. Coincident points and strays get 0, which the node's spacing replaces.
pub fn radii(shared: &[u8], dimension: u32) -> Vec<f32> {
    let mut cells =
        Cells { dimension, open: Vec::new(), small: Vec::new(), out: vec![0.0; shared.len()] };
    for (i, &log2) in shared.iter().enumerate() {
        if i > 0 {
            cells.step(log2, i);
        }
        cells.small.push(i..i + 1);
    }
    while let Some((log2, start)) = cells.open.pop() {
        cells.close(log2, start..shared.len());
    }
    cells.out
}

/// Octree cells along the curve: each is closed where the next point lies outside.
struct Cells {
    dimension: u32,
    /// The log2 of the edge, and the first point, of the cells that are not closed, each within the one before.
    open: Vec<(u8, usize)>,
    /// Cells with few points, and single points, whose radius follows from a cell around them.
    small: Vec<Range<usize>>,
    out: Vec<f32>,
}

impl Cells {
    /// Goes on to point `i`, whose smallest cell shared with the one before has this edge's log2.
    #[inline]
    fn step(&mut self, log2: u8, i: usize) {
        let mut start = i - 1;
        while let Some(&(inner, first)) = self.open.last()
            && inner < log2
        {
            self.open.pop();
            self.close(inner, first..i);
            start = first;
        }
        if self.open.last().is_none_or(|&(outer, _)| outer > log2) {
            self.open.push((log2, start));
        }
    }

    /// Gives the few points in parts of a cell their radius, if the cell has enough points to tell, or is the whole.
    fn close(&mut self, log2: u8, run: Range<usize>) {
        let points = run.len();
        if points < LOCAL_POINTS && points < self.out.len() {
            while self.small.last().is_some_and(|part| part.start >= run.start) {
                self.small.pop();
            }
            return self.small.push(run);
        }
        let edge = if log2 == 0 { 0.0 } else { (1u64 << log2) as f32 };
        let across = if self.dimension <= 1 { points as f32 } else { (points as f32).sqrt() };
        let spacing = edge / across;
        while let Some(part) = self.small.pop_if(|part| part.start >= run.start) {
            let is_stray = part.len() * STRAY_SHARE < points;
            self.out[part].fill(if is_stray { 0.0 } else { spacing });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidates::tests::candidates_of;
    use esker_points::morton;
    use proptest::prelude::*;

    /// The radius of a point by the definition: from the smallest cell around it that has enough points.
    fn plain(q: &[[i32; 3]], i: usize) -> f32 {
        let count = |log2: u32| {
            q.iter().filter(|p| (0..3).all(|a| p[a] >> log2 == q[i][a] >> log2)).count()
        };
        let log2 = (0..31).find(|&log2| count(log2) >= LOCAL_POINTS.min(q.len())).unwrap_or(31);
        let inside = (0..log2).rev().map(count).find(|&n| n < count(log2)).unwrap_or(count(log2));
        let edge = if log2 == 0 { 0.0 } else { (1u64 << log2) as f32 };
        if inside * STRAY_SHARE < count(log2) { 0.0 } else { edge / (count(log2) as f32).sqrt() }
    }

    proptest! {
        #[test]
        fn radii_follow_from_the_smallest_cells_with_enough_points(points in prop::collection::vec([0u32..600, 0u32..600, 0u32..40], 1..300), shift in 0u32..6) {
            let mut points: Vec<_> = points.into_iter().map(|p| p.map(|c| c >> shift)).collect();
            points.sort_unstable_by_key(|&p| morton::encode3(p));
            let q: Vec<[i32; 3]> = points.iter().map(|p| p.map(|c| c as i32)).collect();
            let found = radii(&candidates_of(&points, [1.0; 3]).shared_log2, 2);
            let plain: Vec<f32> = (0..q.len()).map(|i| plain(&q, i)).collect();
            prop_assert_eq!(found, plain);
        }
    }
}
