//! Typical distances of points: that of a node's, which choice of detail rests on, and that around each point, its
//! covering radius.

use crate::sample::turns::radius_at;

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
pub struct TurnCounts {
    first: u16,
    counts: Vec<usize>,
    /// Points of all turns.
    points: usize,
}

impl TurnCounts {
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
/// [`shared_log2`](crate::sample::candidates::Candidates::shared_log2): the local spacing, that is the edge
/// of the square that a point has for itself where the points around it stand evenly. "Around it" is the smallest
/// octree cell with at least [`LOCAL_POINTS`] points. The greatest gap of an even sample is 0.84 of it, so an even
/// sample is covered; the diagonal of the square made silhouettes swell without closing a hole that the renderer's
/// own margin does not close. Laser scans are surfaces also where their node is a volume, so the local dimension
/// is at most 2. What coincides counts once: it covers no more, and counted each, returns stored twice leave gaps between
/// scan lines. Strays, and points that all coincide, get 0, which the node's spacing replaces.
pub fn radii(shared: &[u8], dimension: u32) -> Vec<f32> {
    if !shared.contains(&0) {
        return radii_of_places(shared, dimension);
    }
    let places: Vec<u8> = shared.iter().copied().filter(|&log2| log2 > 0).collect();
    let of_places = radii_of_places(&places, dimension);
    let mut place = 0;
    let of_point = shared.iter().map(|&log2| {
        place += usize::from(log2 > 0);
        of_places[place - 1]
    });
    of_point.collect()
}

/// The same, of points of which none coincide.
fn radii_of_places(shared: &[u8], dimension: u32) -> Vec<f32> {
    let points = shared.len();
    let smallest = smallest_cells(shared);
    let mut out = Vec::with_capacity(points);
    while let Some(&log2) = smallest.get(out.len())
        && points > 1
    {
        // The cell reaches as far as neighbours share one that is no larger. It is looked through once for each of its at
        // most eight parts, and so is any around it.
        let from = out.len();
        let is_outside = |&shared: &u8| shared > log2;
        let start = shared[..=from].iter().rposition(is_outside).unwrap_or(0);
        let end = shared[from + 1..].iter().position(is_outside);
        let end = end.map_or(points, |others| from + 1 + others);
        let around = end - start;
        let edge = if log2 == 0 { 0.0 } else { (1u64 << log2) as f32 };
        let across = if dimension <= 1 { around as f32 } else { (around as f32).sqrt() };
        // Its parts, while they have too few points to tell by themselves.
        while out.len() < end && smallest[out.len()] == log2 {
            let behind = shared[out.len() + 1..end].iter().position(|&shared| shared >= log2);
            let part_end = behind.map_or(end, |others| out.len() + 1 + others);
            let is_stray = (part_end - out.len()) * STRAY_SHARE < around;
            out.resize(part_end, if is_stray { 0.0 } else { edge / across });
        }
    }
    out.resize(points, 0.0);
    out
}

/// The log2 of the edge of the smallest cell around each point that has [`LOCAL_POINTS`] points or more, or all there
/// are. So many that follow each other along the curve lie in the largest cell that two neighbours among them share; a
/// point has the smallest of those that it is among.
fn smallest_cells(shared: &[u8]) -> Vec<u8> {
    const OTHERS: usize = LOCAL_POINTS - 1;
    /// Points looked at in step.
    const BLOCK: usize = 64;
    let Some(inner) = shared.get(1..).filter(|inner| inner.len() >= OTHERS) else {
        let all = shared.iter().skip(1).copied().max().unwrap_or(0);
        return vec![all; shared.len()];
    };
    let blocks = shared.len().div_ceil(BLOCK);
    // Nothing shares a cell with what is not there.
    let mut links = vec![u8::MAX; blocks * BLOCK + 2 * OTHERS];
    links[OTHERS..OTHERS + inner.len()].copy_from_slice(inner);
    let mut out = Vec::with_capacity(blocks * BLOCK);
    for first in (0..blocks * BLOCK).step_by(BLOCK) {
        // The largest of seven links, the least of eight of these: by pairs, then pairs of those.
        let mut cells = [0; BLOCK + 2 * OTHERS];
        cells.copy_from_slice(&links[first..][..BLOCK + 2 * OTHERS]);
        for step in [1, 2, 3] {
            for i in 0..cells.len() - step {
                cells[i] = cells[i].max(cells[i + step]);
            }
        }
        for step in [1, 2, 4] {
            for i in 0..cells.len() - step {
                cells[i] = cells[i].min(cells[i + step]);
            }
        }
        out.extend_from_slice(&cells[..BLOCK]);
    }
    out.truncate(shared.len());
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use esker_points::morton;
    use proptest::prelude::*;

    /// The radius of a place by the definition: from the smallest cell around it that has enough places.
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
            let mut places = q.clone();
            places.dedup();
            let place = |p| places.iter().position(|place| place == p).unwrap();
            let plain: Vec<f32> = q.iter().map(|p| plain(&places, place(p))).collect();
            prop_assert_eq!(found, plain);
        }
    }
}
