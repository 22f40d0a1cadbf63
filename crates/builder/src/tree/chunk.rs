//! Samples the cells of a chunk: the points of one cell, few enough for memory, sorted along the
//! Morton curve. Its cells are contiguous ranges of rows, and are sampled in parallel.

use crate::rows::row::Rows;
use crate::sample::cell::Context;
use crate::sample::pending::PendingCell;
use esker_points::{Cell, Task};
use rayon::prelude::*;
use std::ops::Range;

/// Cells with at most this many points are built by one task.
const TASK_POINTS: usize = 1 << 14;

impl Context {
    /// Samples all cells over a range of sorted rows, at least one, down to single lattice points.
    /// Nodes are finished later. After a cancellation the result is meaningless.
    pub fn build(&self, rows: &Rows<'_>, range: Range<u32>, task: &dyn Task) -> PendingCell {
        let cell = Cell::enclosing(rows.position(range.start), rows.position(range.end - 1));
        let n = range.len();
        if task.is_cancelled() {
            // Without points, the cells above have nothing to do; the caller checks the task again.
            return self.leaf(rows, range.start..range.start, cell);
        }
        if n <= self.leaf_points_max() || self.is_uneven(rows, range.clone(), &cell) {
            let mut leaf = self.leaf(rows, range, cell);
            if (n as u64) < self.points {
                leaf.withheld = self.withheld(rows, &leaf);
            }
            return leaf;
        }
        if cell.log2 == 0 {
            return self.coincident(rows, range, cell);
        }
        let octants = octants(rows, range, &cell);
        let children = if n > TASK_POINTS {
            octants.into_par_iter().map(|own| self.build(rows, own, task)).collect()
        } else {
            octants.into_iter().map(|own| self.build(rows, own, task)).collect()
        };
        self.combine(rows, cell, children)
    }
}

/// The occupied octants of a cell, as ranges of its sorted rows.
fn octants(rows: &Rows<'_>, range: Range<u32>, cell: &Cell) -> Vec<Range<u32>> {
    let mut octants = Vec::with_capacity(8);
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
            octants.push(start..low);
        }
        start = low;
    }
    octants
}
