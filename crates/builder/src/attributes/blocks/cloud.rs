//! The points of a cloud in cells of all levels, and the limits of these.

use crate::attributes::density::{Distances, excess_bits};
use esker_points::Cell;
use rayon::prelude::*;
use std::ops::Range;

/// A cell with fewer points is not divided.
const DIVIDED: u32 = 4;
/// Edge of the coarsest cells, at most, in typical spacings.
const COARSEST_SPACINGS: f64 = 16.0;
/// Log2 of the edge of the coarsest cells, at most.
const LOG2_MAX: u32 = 31;
/// Points from which a task makes cells.
const TASK_POINTS: usize = 1 << 14;
/// Code of a point whose plane is still to be fitted; no direction has it.
pub const OPEN: [i16; 2] = [i16::MIN, 0];
/// Difference between unsigned and signed coordinates.
pub const SIGN: f64 = (1u32 << 31) as f64;

/// Cells of one level, as ranges of points.
pub type Cells = Vec<Range<u32>>;

/// Limits of blocks.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// Length of a lattice step on each axis.
    pub scale: [f64; 3],
    /// Log2 of the edge of the coarsest cells, in the longest steps.
    pub coarsest: u32,
    /// Log2 of the edge of the cells that influence a normal: wires are counted in a level more.
    pub reach: u32,
    /// Bits of each axis below the least cells, which are about cubes also where steps differ.
    pub shift: [u32; 3],
}

impl Blocks {
    /// Limits for a cloud whose points are so far apart.
    pub fn new(scale: [f64; 3], distances: &Distances) -> Self {
        let most_log2 = distances.steps_max.log2().min(f64::from(LOG2_MAX)) as u32;
        let shift = excess_bits(scale).map(|excess| excess.min(most_log2));
        let room = most_log2 - shift.into_iter().fold(0, u32::max);
        let edge = (distances.spacing * COARSEST_SPACINGS).clamp(1.0, f64::from(1u32 << LOG2_MAX));
        let coarsest = (edge.log2() as u32).min(room);
        Self { scale, coarsest, reach: (coarsest + 1).min(room), shift }
    }

    /// The cell of a level that holds a position, as multiples of its edges.
    pub fn cell_at(&self, p: [u32; 3], level: u32) -> [u32; 3] {
        [0, 1, 2].map(|i| p[i] >> self.shift[i] >> level)
    }

    /// Edges of the cells of the level of the reach, in steps. Points farther from the faces of a
    /// cell of the octree influence no normal outside of it.
    pub fn steps(&self) -> [u32; 3] {
        self.shift.map(|shift| 1 << (self.reach + shift))
    }

    /// The least and the greatest position that influence normals in a cell.
    pub fn around(&self, cell: &Cell) -> [[u32; 3]; 2] {
        let (steps, last) = (self.steps(), cell.last());
        let low = |i: usize| (cell.corner[i] & !(steps[i] - 1)).saturating_sub(steps[i]);
        let high = |i: usize| (last[i] | (steps[i] - 1)).saturating_add(steps[i]);
        [[0, 1, 2].map(low), [0, 1, 2].map(high)]
    }
}

/// Distinct points along the Morton curve of cubes.
pub struct Cloud<'a> {
    pub points: &'a [[u32; 3]],
    pub blocks: &'a Blocks,
}

impl Cloud<'_> {
    /// The cell of a level that has a point, as multiples of its edge.
    pub fn cell(&self, point: u32, level: u32) -> [u32; 3] {
        self.blocks.cell_at(self.points[point as usize], level)
    }

    /// Cells of each level, the finest first. A level has no cells within cells that are not
    /// divided: they would hold hardly any points.
    pub fn levels(&self) -> Vec<Cells> {
        let (coarsest, count) = (self.blocks.coarsest, self.points.len());
        let mut tasks = Vec::new();
        let mut start = 0;
        while start < count {
            // Tasks end with a cell of the coarsest level.
            let mut end = (start + TASK_POINTS).min(count);
            let last = self.cell(end as u32 - 1, coarsest);
            end +=
                self.points[end..].partition_point(|&p| self.blocks.cell_at(p, coarsest) == last);
            tasks.push(start as u32..end as u32);
            start = end;
        }
        let of_task = |task: Range<u32>| {
            let mut levels = vec![Cells::new(); coarsest as usize + 1];
            self.divide(task, coarsest, &mut levels);
            levels
        };
        let parts: Vec<Vec<Cells>> = tasks.into_par_iter().map(of_task).collect();
        let level = |level: usize| parts.iter().flat_map(|part| part[level].clone()).collect();
        (0..=coarsest as usize).map(level).collect()
    }

    /// Adds the cells of `level` and below that hold these points, which begin and end with a cell.
    fn divide(&self, points: Range<u32>, level: u32, levels: &mut [Cells]) {
        /// Points of a cell that are walked; more are searched.
        const WALKED: u32 = 16;
        let mut start = points.start;
        while start < points.end {
            let cell = self.cell(start, level);
            let mut end = start + 1;
            while end < points.end && end - start < WALKED && self.cell(end, level) == cell {
                end += 1;
            }
            if end - start == WALKED {
                let rest = &self.points[end as usize..points.end as usize];
                end += rest.partition_point(|&p| self.blocks.cell_at(p, level) == cell) as u32;
            }
            levels[level as usize].push(start..end);
            if end - start >= DIVIDED && level > 0 {
                self.divide(start..end, level - 1, levels);
            }
            start = end;
        }
    }
}
