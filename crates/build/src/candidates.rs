//! The points that a cell may choose from, in columns along the Morton curve: the points of any octree cell then
//! stand together, and neighbours are found by cells without sorting anything.

use crate::row::Rows;
use esker_points::{Cell, morton};

/// Bits of a coordinate along an axis where steps are no cubes, and points must be sorted anew.
const BITS: u32 = 21;

/// Points in integer coordinates, whose steps are cubes.
pub struct Candidates {
    /// Coordinates, none negative.
    pub q: Vec<[i32; 3]>,
    /// Which of the offered points each is.
    pub offer: Vec<u32>,
    /// Log2 of the edge, in steps, of the smallest octree cell that a point shares with the one before it;
    /// [`Candidates::ALONE`] for the first.
    pub shared_log2: Vec<u8>,
    /// How many points are the first in their octree cell, by the log2 of its edge.
    pub firsts: [u32; Self::ALONE as usize],
    /// Length of a step, in the file's unit.
    pub step: f64,
}

impl Candidates {
    /// Above the log2 of any cell's edge.
    pub const ALONE: u8 = 32;

    /// The rows `offered`, which are sorted along the curve, of a cell.
    pub fn new(rows: &Rows<'_>, offered: &[u32], cell: &Cell, scale: [f64; 3]) -> Self {
        if scale[0] == scale[1] && scale[1] == scale[2] {
            // A step is lost where a cell is the whole lattice, so that differences fit.
            let shift = u32::from(cell.log2 == 32);
            let local = |row| {
                let ([x, y, z], [x0, y0, z0]) = (rows.position(row), cell.corner);
                [((x - x0) >> shift) as i32, ((y - y0) >> shift) as i32, ((z - z0) >> shift) as i32]
            };
            let q = offered.iter().map(|&row| local(row)).collect();
            let offer = (0..offered.len() as u32).collect();
            return Self::sorted(q, offer, scale[0] * f64::from(1 + shift));
        }
        Self::resorted(rows, offered, scale)
    }

    /// Where steps have other lengths along other axes, positions are quantised to cubes and sorted.
    fn resorted(rows: &Rows<'_>, offered: &[u32], scale: [f64; 3]) -> Self {
        let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
        for p in offered.iter().map(|&row| rows.position(row)) {
            for i in 0..3 {
                low[i] = low[i].min(p[i]);
                high[i] = high[i].max(p[i]);
            }
        }
        let extent = |i: usize| f64::from(high[i].saturating_sub(low[i])) * scale[i];
        let extent = (0..3).map(extent).fold(0.0, f64::max);
        let least = scale.iter().fold(f64::INFINITY, |a, &b| a.min(b));
        let step = (extent / f64::from((1u32 << BITS) - 1)).max(least);
        let quantised = |row: u32| {
            let p = rows.position(row);
            [0, 1, 2].map(|i| (f64::from(p[i] - low[i]) * scale[i] / step) as u32)
        };
        let keyed = |(offer, &row): (u32, &u32)| (morton::encode3_21(quantised(row)), offer);
        let mut keyed: Vec<(u64, u32)> = (0..).zip(offered).map(keyed).collect();
        keyed.sort_unstable();
        let q = |(_, offer): &(u64, u32)| quantised(offered[*offer as usize]).map(|c| c as i32);
        Self::sorted(keyed.iter().map(q).collect(), keyed.iter().map(|k| k.1).collect(), step)
    }

    fn sorted(q: Vec<[i32; 3]>, offer: Vec<u32>, step: f64) -> Self {
        let shared_log2 = shared_log2(&q);
        let mut firsts = [0; Self::ALONE as usize];
        let mut counts = [0u32; 1 << u8::BITS];
        shared_log2.iter().for_each(|&log2| counts[usize::from(log2)] += 1);
        let mut above = 0;
        for log2 in (0..firsts.len()).rev() {
            above += counts[log2 + 1];
            firsts[log2] = above;
        }
        Self { q, offer, shared_log2, firsts, step }
    }

    /// Turns by offered point, brought along the curve; none stay none.
    pub fn along_curve(&self, turns: &[u16]) -> Vec<u16> {
        if turns.is_empty() {
            return Vec::new();
        }
        self.offer.iter().map(|&offer| turns[offer as usize]).collect()
    }

    /// Of those of the points that are wanted, which are told by their place along the curve, [`Candidates::shared_log2`] of
    /// their own.
    pub fn shared_of(&self, is_wanted: impl Fn(usize) -> bool) -> Vec<u8> {
        let mut shared = Vec::new();
        // What lies between two points along the curve shares no larger cell with them than they do.
        let mut outer = Self::ALONE;
        for (i, &log2) in self.shared_log2.iter().enumerate() {
            outer = outer.max(log2);
            if is_wanted(i) {
                shared.push(outer);
                outer = 0;
            }
        }
        shared
    }

    /// Number of places that have points: what coincides has one.
    pub fn places(&self) -> usize {
        self.firsts[0] as usize
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.q.len()
    }
}

/// Of points along the Morton curve, none with a negative coordinate, the log2 of the edge of the smallest cell shared
/// with the one before.
fn shared_log2(q: &[[i32; 3]]) -> Vec<u8> {
    // No cell has both.
    let mut before = q.first().map_or([0; 3], |first| first.map(|c| c ^ i32::MIN));
    let mut shared = Vec::with_capacity(q.len());
    shared.extend(q.iter().map(|p| {
        let differing = (p[0] ^ before[0]) | (p[1] ^ before[1]) | (p[2] ^ before[2]);
        before = *p;
        (i32::BITS - differing.leading_zeros()) as u8
    }));
    shared
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Rows of bare positions.
    pub fn rows_of(points: &[[u32; 3]]) -> Vec<u8> {
        points.iter().flatten().flat_map(|c| c.to_le_bytes()).collect()
    }

    /// Positions as candidates, in the smallest cell that holds them.
    pub fn candidates_of(points: &[[u32; 3]], scale: [f64; 3]) -> Candidates {
        let mut points = points.to_vec();
        points.sort_unstable_by_key(|&p| morton::encode3(p));
        let bytes = rows_of(&points);
        let all: Vec<u32> = (0..points.len() as u32).collect();
        let cell = Cell::enclosing(points[0], points[points.len() - 1]);
        Candidates::new(&Rows { bytes: &bytes, stride: 12 }, &all, &cell, scale)
    }

    proptest! {
        #[test]
        fn a_part_of_points_shares_what_it_does_alone(points in prop::collection::vec(any::<[u32; 3]>(), 1..200), small in 0u32..32, every in 1usize..9) {
            let points: Vec<_> = points.iter().map(|p| p.map(|c| c >> small)).collect();
            let all = candidates_of(&points, [0.5; 3]);
            let part: Vec<_> = all.q.iter().copied().skip(every / 2).step_by(every).collect();
            let shared = all.shared_of(|i| i % every == every / 2 % every);
            prop_assert_eq!(shared, shared_log2(&part));
        }

        #[test]
        fn points_of_a_cell_stand_together(points in prop::collection::vec(any::<[u32; 3]>(), 1..200), small in 0u32..32, cubic: bool) {
            let points: Vec<_> = points.iter().map(|p| p.map(|c| c >> small)).collect();
            let candidates = candidates_of(&points, if cubic { [0.5; 3] } else { [0.5, 2.0, 0.1] });
            let mut offers = candidates.offer.clone();
            offers.sort_unstable();
            prop_assert!(offers.iter().zip(0..).all(|(&o, i)| o == i));
            for log2 in [0, 3, 9, 20, 30] {
                let mut cells: Vec<_> = candidates.q.iter().map(|q| q.map(|c| c >> log2)).collect();
                cells.dedup();
                prop_assert_eq!(cells.len(), candidates.shared_log2.iter().filter(|&&l| l > log2).count());
                cells.sort_unstable();
                cells.dedup();
                prop_assert_eq!(cells.len(), candidates.shared_log2.iter().filter(|&&l| l > log2).count());
            }
        }
    }
}
