//! A chunk: the points of one cell, few enough for memory, sorted along the Morton curve. Its part of the tree
//! is built in parallel over contiguous ranges.

use crate::row::Rows;
use crate::tree::{Context, Pending};
use esker_points::{Cell, Task};
use rayon::prelude::*;
use std::ops::Range;

/// Below so many points a cell is built by one task.
const TASK_POINTS: usize = 1 << 14;

/// A cell before its own points are chosen.
pub enum Opened {
    /// One that is not split.
    Whole(Box<Pending>),
    /// One made of these.
    Split(Cell, Vec<Pending>),
}

impl Context {
    /// Builds the tree over a range of sorted rows (at least one), down to single lattice points. Void
    /// where the task was cancelled.
    pub fn build(&self, rows: &Rows<'_>, range: Range<u32>, task: &dyn Task) -> Pending {
        self.close(rows, self.open(rows, range, task))
    }

    /// The same but for the last step, which is not parallel.
    pub fn open(&self, rows: &Rows<'_>, range: Range<u32>, task: &dyn Task) -> Opened {
        let cell = Cell::enclosing(rows.position(range.start), rows.position(range.end - 1));
        let n = range.len();
        if task.is_cancelled() {
            // Nothing is offered: what is above has nothing to do, and the caller asks again.
            return Opened::Whole(Box::new(self.leaf(rows, range.start..range.start, cell)));
        }
        if n <= self.leaf_points_max() {
            task.advance(n as u64);
            return Opened::Whole(Box::new(self.leaf(rows, range, cell)));
        }
        if cell.log2 == 0 {
            task.advance(n as u64);
            return Opened::Whole(Box::new(self.coincident(rows, range, cell)));
        }
        let parts = octants(rows, range, &cell);
        let children = if n > TASK_POINTS {
            parts.into_par_iter().map(|part| self.build(rows, part, task)).collect()
        } else {
            parts.into_iter().map(|part| self.build(rows, part, task)).collect()
        };
        Opened::Split(cell, children)
    }

    /// The last step.
    pub fn close(&self, rows: &Rows<'_>, opened: Opened) -> Pending {
        match opened {
            Opened::Whole(pending) => *pending,
            Opened::Split(cell, children) => self.combine(rows, cell, children),
        }
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
