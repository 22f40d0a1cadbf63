//! Typical distances of points: that of a node, which the choice of detail uses, and that around
//! each point, its covering radius.

use crate::sample::turns::radius_at;

/// Edge of the square that a point has for itself in a thinned sample, over the radius of thinning.
const SQUARE_EDGE: f64 = 1.15;
/// A thinned sample of up to 1 / `EVEN_SHARE` of all points is as even as possible; a larger one
/// shows the distribution of the input.
const EVEN_SHARE: usize = 4;
/// Points of the cell from which a local spacing follows: enough to average out chance.
const LOCAL_POINTS: usize = 8;
/// Points that are less than 1 / `STRAY_SHARE` of those in the cell above are strays (a bird over a
/// field): the density of that cell is not theirs.
const STRAY_SHARE: usize = 16;

/// Number of points picked at each turn.
pub struct TurnCounts {
    first: u16,
    counts: Vec<usize>,
    /// Sum over all turns.
    points: usize,
}

impl TurnCounts {
    /// Counts the points of each turn.
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

    /// Log2 of the radius, in the file's unit, at which `wanted` points are picked; interpolated
    /// between turns by the logarithms of their numbers.
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

    /// Typical distance, in the file's unit, of the first `drawn` of `total` points of a cell: the
    /// edge of the squares of a grid that is as dense. For a small part of the points it follows
    /// from the radius at which they were picked, else from how their number grows with a shrinking
    /// radius.
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

/// Computes the covering radii, in steps, of points along the Morton curve from
/// [`shared_log2`](crate::sample::candidates::Candidates::shared_log2).
///
/// The radius is the local spacing: the edge of the square that the point has for itself in the
/// smallest octree cell around it with at least [`LOCAL_POINTS`] points. The greatest gap of an
/// even sample is 0.84 of that, so the sample is covered. Laser scans are surfaces also where their
/// node is a volume, so the local dimension is at most 2. Coincident points count once, since they
/// cover no more. Strays, and points that all coincide, get 0, which stands for the spacing of the
/// node.
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

/// Variant of [`radii`] for points of which none coincide.
fn radii_of_places(shared: &[u8], dimension: u32) -> Vec<f32> {
    let points = shared.len();
    let smallest = smallest_cells(shared);
    let mut out = Vec::with_capacity(points);
    while let Some(&log2) = smallest.get(out.len())
        && points > 1
    {
        // The cell extends while neighbours share a cell that is not larger. It is scanned once for
        // each of its at most eight parts, and so is each cell around it.
        let from = out.len();
        let is_outside = |&shared: &u8| shared > log2;
        let start = shared[..=from].iter().rposition(is_outside).unwrap_or(0);
        let end = shared[from + 1..].iter().position(is_outside);
        let end = end.map_or(points, |others| from + 1 + others);
        let around = end - start;
        let edge = if log2 == 0 { 0.0 } else { (1u64 << log2) as f32 };
        let across = if dimension <= 1 { around as f32 } else { (around as f32).sqrt() };
        // Parts of the cell that have too few points for a cell of their own.
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

/// Log2 of the edge of the smallest cell around each point that has [`LOCAL_POINTS`] points or
/// more, or all points. A group of as many consecutive points lies in the largest cell that two
/// neighbours in it share; a point gets the smallest cell of the groups that it belongs to.
fn smallest_cells(shared: &[u8]) -> Vec<u8> {
    const OTHERS: usize = LOCAL_POINTS - 1;
    /// Points processed together.
    const BLOCK: usize = 64;
    let Some(inner) = shared.get(1..).filter(|inner| inner.len() >= OTHERS) else {
        let all = shared.iter().skip(1).copied().max().unwrap_or(0);
        return vec![all; shared.len()];
    };
    let blocks = shared.len().div_ceil(BLOCK);
    // Beyond the ends, points share no cell.
    let mut links = vec![u8::MAX; blocks * BLOCK + 2 * OTHERS];
    links[OTHERS..OTHERS + inner.len()].copy_from_slice(inner);
    let mut out = Vec::with_capacity(blocks * BLOCK);
    for first in (0..blocks * BLOCK).step_by(BLOCK) {
        // The largest of seven links, then the least of eight of these: pairs first, then pairs of
        // pairs.
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

    /// Radius of a position by its definition: from the smallest cell around it with enough
    /// positions.
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
