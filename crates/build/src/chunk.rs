//! A chunk: the points of one cell, few enough for memory. Its rows are sorted along the Morton curve, ties
//! by the record; then its part of the tree is built in parallel over contiguous ranges.

use crate::row::{Rows, position};
use crate::tree::{Context, Pending};
use esker_points::{Cell, Task, morton};
use rayon::prelude::*;
use std::ops::Range;

/// Below so many points a cell is built by one task.
const TASK_POINTS: usize = 1 << 14;

/// The rows of a chunk, wherever they lie, as whole runs.
pub struct Runs<'a> {
    runs: Vec<&'a [u8]>,
    /// Rows before each run.
    before: Vec<u32>,
    stride: usize,
    rows: usize,
}

impl<'a> Runs<'a> {
    /// Runs of whole rows, below 2^32 in all.
    pub fn new(runs: Vec<&'a [u8]>, stride: usize) -> Self {
        let mut rows = 0;
        let before = runs
            .iter()
            .map(|run| {
                rows += run.len() / stride;
                (rows - run.len() / stride) as u32
            })
            .collect();
        Self { runs, before, stride, rows }
    }

    fn row(&self, index: u32) -> &'a [u8] {
        let run = self.before.partition_point(|&b| b <= index) - 1;
        &self.runs[run][(index - self.before[run]) as usize * self.stride..][..self.stride]
    }

    /// All rows along the Morton curve, ties by the rest of the record.
    pub fn sorted(&self) -> Vec<u8> {
        let mut keys: Vec<u128> = Vec::with_capacity(self.rows);
        for (run, &before) in self.runs.iter().zip(&self.before) {
            let key = |(i, row): (usize, &[u8])| {
                morton::encode3(position(row)) << 32 | u128::from(before + i as u32)
            };
            keys.par_extend(run.par_chunks_exact(self.stride).enumerate().map(key));
        }
        keys.par_sort_unstable();
        let mut start = 0;
        while start < keys.len() {
            let code = keys[start] >> 32;
            let len = keys[start..].iter().take_while(|k| *k >> 32 == code).count();
            if len > 1 {
                self.sort_ties(&mut keys[start..start + len]);
            }
            start += len;
        }
        let mut out = vec![0u8; self.rows * self.stride];
        out.par_chunks_exact_mut(self.stride)
            .zip(&keys)
            .with_min_len(TASK_POINTS)
            .for_each(|(slot, key)| slot.copy_from_slice(self.row(*key as u32)));
        out
    }

    /// Sorts the keys of coincident rows by the rows; each is looked up once, not for each comparison.
    fn sort_ties(&self, keys: &mut [u128]) {
        let mut ties: Vec<(&[u8], u32)> =
            keys.iter().map(|&key| (self.row(key as u32), key as u32)).collect();
        ties.par_sort_unstable_by_key(|tie| tie.0);
        let code = keys[0] >> 32 << 32;
        keys.iter_mut().zip(ties).for_each(|(key, tie)| *key = code | u128::from(tie.1));
    }
}

impl Context {
    /// Builds the tree over a range of sorted rows (at least one), down to single lattice points. Void
    /// where the task was cancelled.
    pub fn build(&self, rows: &Rows<'_>, range: Range<u32>, task: &dyn Task) -> Pending {
        let cell = Cell::enclosing(rows.position(range.start), rows.position(range.end - 1));
        let n = range.len();
        if task.is_cancelled() {
            // Nothing is offered: what is above has nothing to do, and the caller asks again.
            return self.leaf(rows, range.start..range.start, cell);
        }
        if n <= self.capacity {
            task.advance(n as u64);
            return self.leaf(rows, range, cell);
        }
        if cell.log2 == 0 {
            task.advance(n as u64);
            return self.coincident(rows, range, cell);
        }
        let parts = octants(rows, range, &cell);
        let children = if n > TASK_POINTS {
            parts.into_par_iter().map(|part| self.build(rows, part, task)).collect()
        } else {
            parts.into_iter().map(|part| self.build(rows, part, task)).collect()
        };
        self.combine(rows, cell, children)
    }
}

/// The occupied octants of a cell as ranges of its sorted rows.
fn octants(rows: &Rows<'_>, range: Range<u32>, cell: &Cell) -> Vec<Range<u32>> {
    let mut parts = Vec::with_capacity(8);
    let mut start = range.start;
    for octant in 0..8 {
        let (mut low, mut high) = (start, range.end);
        while low < high {
            let middle = low + (high - low) / 2;
            if cell.octant(rows.position(middle)) <= octant {
                low = middle + 1
            } else {
                high = middle
            }
        }
        if low > start {
            parts.push(start..low);
        }
        start = low;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::rows_of;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sorting_does_not_depend_on_the_order_of_arrival(points in prop::collection::vec([0u32..9, 0u32..9, 0u32..9], 1..200), cut in 0usize..200) {
            // Position and one more byte as the rest of the record.
            let bytes: Vec<u8> = rows_of(&points).chunks(12).enumerate().flat_map(|(i, p)| [p, &[(i % 5) as u8]].concat()).collect();
            let reversed: Vec<u8> = bytes.chunks(13).rev().flatten().copied().collect();
            let (a, b) = bytes.split_at(cut.min(points.len()) * 13);
            let one = Runs::new(vec![a, b], 13).sorted();
            prop_assert_eq!(&one, &Runs::new(vec![&reversed], 13).sorted());
            let rows = Rows { bytes: &one, stride: 13 };
            for i in 1..rows.len() as u32 {
                let key = |i: u32| (morton::encode3(rows.position(i)), rows.row(i));
                prop_assert!(key(i - 1) <= key(i));
            }
        }
    }
}
