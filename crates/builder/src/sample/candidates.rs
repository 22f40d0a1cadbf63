//! The points that a cell may choose from, in columns along the Morton curve. In this order the
//! points of any octree cell are contiguous, so neighbours are found by cells without sorting
//! anything.

use crate::rows::row::Rows;
use crate::sample::marks::WireMarks;
use esker_points::{Cell, morton};
use std::borrow::Cow;

/// Bits of a coordinate where the steps of the axes differ, and points are quantised and sorted
/// anew.
const BITS: u32 = 21;

/// Points in integer coordinates whose steps are cubes.
pub struct Candidates {
    /// Coordinates in steps, none negative.
    pub q: Vec<[i32; 3]>,
    /// Index of each point among the offered points; empty if the points are in the offered order.
    offer: Vec<u32>,
    /// Log2 of the edge, in steps, of the smallest octree cell that a point shares with the one
    /// before it; [`Candidates::ALONE`] for the first.
    pub shared_log2: Vec<u8>,
    /// Number of occupied octree cells, by the log2 of their edge.
    pub firsts: [u32; Self::ALONE as usize],
    /// Length of a step, in the file's unit.
    pub step: f64,
    /// Whether each point is on a wire; empty if none has a mark.
    pub wires: Vec<bool>,
}

impl Candidates {
    /// Greater than the log2 of any cell's edge.
    pub const ALONE: u8 = 32;

    /// Collects the rows `offered` of `cell`, which are sorted along the curve. `marks` tell
    /// which of them are on wires, if that is needed.
    pub fn new(
        rows: &Rows<'_>,
        offered: &[u32],
        cell: &Cell,
        scale: [f64; 3],
        marks: Option<WireMarks>,
    ) -> Self {
        let mut wires = Vec::with_capacity(marks.map_or(0, |_| offered.len()));
        if scale[0] == scale[1] && scale[1] == scale[2] {
            // In a cell as large as the lattice the lowest bit is dropped, so that differences fit
            // `i32`.
            let shift = u32::from(cell.log2 == 32);
            let local = |row| {
                let ([x, y, z], [x0, y0, z0]) = (rows.position(row), cell.corner);
                // Read here, beside the position, the mark is mostly in the cache.
                wires.extend(marks.map(|marks| marks.is_wire(rows.row(row))));
                [((x - x0) >> shift) as i32, ((y - y0) >> shift) as i32, ((z - z0) >> shift) as i32]
            };
            let q = offered.iter().copied().map(local).collect();
            return Self::sorted(q, Vec::new(), scale[0] * f64::from(1 + shift), wires);
        }
        Self::resorted(rows, offered, scale, marks)
    }

    /// Quantises positions to cubes and sorts them, for axes with different steps.
    fn resorted(
        rows: &Rows<'_>,
        offered: &[u32],
        scale: [f64; 3],
        marks: Option<WireMarks>,
    ) -> Self {
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
        let offer: Vec<u32> = keyed.iter().map(|k| k.1).collect();
        let is_wire = |&i: &u32| marks.map(|marks| marks.is_wire(rows.row(offered[i as usize])));
        let wires = offer.iter().filter_map(is_wire).collect();
        Self::sorted(keyed.iter().map(q).collect(), offer, step, wires)
    }

    fn sorted(q: Vec<[i32; 3]>, offer: Vec<u32>, step: f64, wires: Vec<bool>) -> Self {
        let shared_log2 = shared_log2(&q);
        let mut firsts = [0; Self::ALONE as usize];
        // Neighbours are mostly equal. Four tables of counts keep an increment from waiting for the
        // one before it.
        let mut counts = [[0u32; 1 << u8::BITS]; 4];
        for alike in shared_log2.chunks(counts.len()) {
            let counted = counts.iter_mut().zip(alike);
            counted.for_each(|(counts, &log2)| counts[usize::from(log2)] += 1);
        }
        let mut above = 0;
        for log2 in (0..firsts.len()).rev() {
            above += counts.iter().map(|counts| counts[log2 + 1]).sum::<u32>();
            firsts[log2] = above;
        }
        Self { q, offer, shared_log2, firsts, step, wires }
    }

    /// Brings values of the offered points into the order of the curve; an empty slice stays empty.
    pub fn along_curve<'a, T: Copy>(&self, values: &'a [T]) -> Cow<'a, [T]> {
        if values.is_empty() || self.offer.is_empty() {
            return values.into();
        }
        self.offer.iter().map(|&offer| values[offer as usize]).collect()
    }

    /// Brings values of the points along the curve into the order in which they were offered.
    pub fn as_offered<T: Copy + Default>(&self, values: Vec<T>) -> Vec<T> {
        if self.offer.is_empty() {
            return values;
        }
        let mut out = vec![T::default(); values.len()];
        self.offer.iter().zip(values).for_each(|(&offer, value)| out[offer as usize] = value);
        out
    }

    /// Variant of [`Candidates::as_offered`] for the wanted points only; `is_wanted` is in the
    /// order of the curve.
    pub fn some_as_offered<T>(
        &self,
        values: Vec<T>,
        is_wanted: impl Iterator<Item = bool>,
    ) -> Vec<T> {
        if self.offer.is_empty() {
            return values;
        }
        let wanted = self.offer.iter().zip(is_wanted).filter(|(_, is_wanted)| *is_wanted);
        let mut keyed: Vec<(u32, T)> = wanted.map(|(&offer, _)| offer).zip(values).collect();
        keyed.sort_unstable_by_key(|(offer, _)| *offer);
        keyed.into_iter().map(|(_, value)| value).collect()
    }

    /// Returns [`Candidates::shared_log2`] of the wanted points alone; `is_wanted` is in the order
    /// of the curve.
    pub fn shared_of(&self, is_wanted: impl Iterator<Item = bool>) -> Vec<u8> {
        let mut shared = vec![0; self.len()];
        let mut wanted = 0;
        // The smallest cell that two points share is the largest that any neighbours between them
        // share.
        let mut outer = Self::ALONE;
        for (&log2, is_wanted) in self.shared_log2.iter().zip(is_wanted) {
            outer = outer.max(log2);
            // The value is written in any case and overwritten if the point is not wanted: without
            // a branch nothing is mispredicted.
            shared[wanted] = outer;
            wanted += usize::from(is_wanted);
            outer = if is_wanted { 0 } else { outer };
        }
        shared.truncate(wanted);
        shared
    }

    /// Number of distinct positions.
    pub fn places(&self) -> usize {
        self.firsts[0] as usize
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.q.len()
    }
}

/// Returns, for points along the Morton curve without negative coordinates, the log2 of the edge of
/// the smallest cell that each shares with the point before it.
fn shared_log2(q: &[[i32; 3]]) -> Vec<u8> {
    // Flipped signs: no cell contains the first point and this one.
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

    /// Rows that hold positions only.
    pub fn rows_of(points: &[[u32; 3]]) -> Vec<u8> {
        points.iter().flatten().flat_map(|c| c.to_le_bytes()).collect()
    }

    /// Makes positions to candidates of the smallest cell that holds them.
    pub fn candidates_of(points: &[[u32; 3]], scale: [f64; 3]) -> Candidates {
        let mut points = points.to_vec();
        points.sort_unstable_by_key(|&p| morton::encode3(p));
        let bytes = rows_of(&points);
        let all: Vec<u32> = (0..points.len() as u32).collect();
        let cell = Cell::enclosing(points[0], points[points.len() - 1]);
        Candidates::new(&Rows { bytes: &bytes, stride: 12 }, &all, &cell, scale, None)
    }

    proptest! {
        #[test]
        fn shared_cells_of_a_subset_are_those_of_the_subset_alone(points in prop::collection::vec(any::<[u32; 3]>(), 1..200), small in 0u32..32, every in 1usize..9) {
            let points: Vec<_> = points.iter().map(|p| p.map(|c| c >> small)).collect();
            let all = candidates_of(&points, [0.5; 3]);
            let part: Vec<_> = all.q.iter().copied().skip(every / 2).step_by(every).collect();
            let shared = all.shared_of((0..all.len()).map(|i| i % every == every / 2 % every));
            prop_assert_eq!(shared, shared_log2(&part));
        }

        #[test]
        fn points_of_a_cell_are_contiguous(points in prop::collection::vec(any::<[u32; 3]>(), 1..200), small in 0u32..32, cubic: bool) {
            let points: Vec<_> = points.iter().map(|p| p.map(|c| c >> small)).collect();
            let candidates = candidates_of(&points, if cubic { [0.5; 3] } else { [0.5, 2.0, 0.1] });
            let places = candidates.as_offered((0..points.len() as u16).collect());
            prop_assert!(candidates.along_curve(&places).iter().zip(0..).all(|(&place, i)| place == i));
            // Values of wanted points come back in the order of the offered points.
            let numbers: Vec<u16> = (0..points.len() as u16).collect();
            let along = candidates.along_curve(&numbers);
            let is_wanted = |number: &u16| number % 3 == 1;
            let some = along.iter().copied().filter(is_wanted).collect();
            let some = candidates.some_as_offered(some, along.iter().map(is_wanted));
            prop_assert_eq!(some, numbers.iter().copied().filter(is_wanted).collect::<Vec<_>>());
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
