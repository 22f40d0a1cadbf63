//! A chunk: the points of one cell, few enough for memory, sorted along the Morton curve. Its part
//! of the tree is built in parallel over contiguous ranges.

use crate::rows::row::Rows;
use crate::sample::cell::Context;
use crate::sample::pending::PendingCell;
use esker_points::{Cell, Task};
use rayon::prelude::*;
use std::ops::Range;

/// Below so many points a cell is built by one task.
const TASK_POINTS: usize = 1 << 14;

impl Context {
    /// Chooses what each cell over a range of sorted rows (at least one) offers, down to single
    /// lattice points. Nodes are yet to be finished. Void where the task was cancelled.
    pub fn build(&self, rows: &Rows<'_>, range: Range<u32>, task: &dyn Task) -> PendingCell {
        let cell = Cell::enclosing(rows.position(range.start), rows.position(range.end - 1));
        let n = range.len();
        if task.is_cancelled() {
            // Nothing is offered: what is above has nothing to do, and the caller asks again.
            return self.leaf(rows, range.start..range.start, cell);
        }
        if n <= self.leaf_points_max() {
            return self.leaf(rows, range, cell);
        }
        if cell.log2 == 0 {
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
