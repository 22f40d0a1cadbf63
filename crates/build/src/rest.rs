//! The points that thinning has not yet picked, in columns along the n-tree's order: how far each is from the picked
//! ones, and which of them are near a place. Neighbours are found by the n-tree's cells, so along a line or in a
//! plane where that is the local shape; distances are in space, in its quantised coordinates.

use crate::ntree::{Entry, NTree};
use std::ops::Range;

/// Instead of an entry, of a point that is picked.
pub const PICKED: u32 = u32::MAX;

/// Points in columns, over which the innermost loop of a build runs.
#[derive(Default)]
pub struct Rest {
    /// Quantised coordinates.
    q: [Vec<i32>; 3],
    /// Square of the distance to the nearest picked point, where that is within the radius; else any that is not.
    pub nearest2: Vec<f32>,
    /// The turn at which a cell below has picked it.
    pub placed: Vec<u16>,
    /// Its entry in the n-tree; [`PICKED`] once picked.
    pub entry: Vec<u32>,
    cells: Cells,
    /// Level of the n-tree whose cells are no smaller than the radius. (Half as large they follow the ball more
    /// closely, but finding them costs more than it saves: twice the time in a volume.)
    level: u32,
}

impl Rest {
    /// The entries of a tree that are candidates, when the radius has this square.
    pub fn new(tree: &NTree, is_candidate: impl Fn(usize) -> bool, radius2: f32) -> Self {
        let mut rest = Self::default();
        for (i, entry) in tree.entries.iter().enumerate() {
            if is_candidate(i) {
                rest.add(i as u32, entry);
            }
        }
        rest.level = level_at(tree, radius2);
        rest.find_cells(tree);
        rest
    }

    fn add(&mut self, index: u32, entry: &Entry) {
        (0..3).for_each(|axis| self.q[axis].push(entry.q[axis] as i32));
        self.nearest2.push(f32::INFINITY);
        self.placed.push(entry.turn);
        self.entry.push(index);
    }

    /// Quantised coordinates of a point.
    pub fn position(&self, i: usize) -> [i32; 3] {
        [self.q[0][i], self.q[1][i], self.q[2][i]]
    }

    /// Chooses the cells for a radius. Points already picked leave, and others move up, when the cells change:
    /// then it answers yes.
    pub fn settle(&mut self, tree: &NTree, radius2: f32) -> bool {
        let level = level_at(tree, radius2);
        if level == self.level {
            return false;
        }
        self.level = level;
        self.forget_picked();
        self.find_cells(tree);
        true
    }

    fn forget_picked(&mut self) {
        let kept: Vec<usize> = (0..self.entry.len()).filter(|&i| self.entry[i] != PICKED).collect();
        for (to, &from) in kept.iter().enumerate() {
            self.q.iter_mut().for_each(|column| column[to] = column[from]);
            self.nearest2[to] = self.nearest2[from];
            self.placed[to] = self.placed[from];
            self.entry[to] = self.entry[from];
        }
        self.q.iter_mut().for_each(|column| column.truncate(kept.len()));
        self.nearest2.truncate(kept.len());
        self.placed.truncate(kept.len());
        self.entry.truncate(kept.len());
    }

    fn find_cells(&mut self, tree: &NTree) {
        let cell = |i| tree.cell_at(self.position(i).map(|c| c as u32), self.level);
        self.cells = Cells::new((0..self.entry.len()).map(cell));
    }

    /// Tells all points within the radius that one is picked.
    pub fn tell(&mut self, tree: &NTree, picked: [i32; 3], radius2: f32) {
        let radius2 = f64::from(radius2);
        let q = picked.map(|c| c as u32);
        let log2 = tree.cell_log2(self.level);
        let reach = radius2.sqrt() as u32;
        let end = ((1u64 << tree.cell_log2(0)) - 1) as u32;
        let cells = |axis: usize| {
            if axis >= tree.dimension as usize {
                return 0..=0;
            }
            q[axis].saturating_sub(reach) >> log2..=q[axis].saturating_add(reach).min(end) >> log2
        };
        // Square of the distance to a cell along an axis; cells are unbounded along axes beyond the dimension.
        let gap2 = |axis: usize, cell: u32| {
            if axis >= tree.dimension as usize {
                return 0;
            }
            let (low, high) = (cell << log2, (cell << log2) + ((1 << log2) - 1));
            u64::from(low.saturating_sub(q[axis]).max(q[axis].saturating_sub(high))).pow(2)
        };
        for z in cells(2) {
            for y in cells(1) {
                let gap2_yz = gap2(2, z) + gap2(1, y);
                for x in cells(0) {
                    if (gap2_yz + gap2(0, x)) as f64 >= radius2 {
                        continue;
                    }
                    let cell = tree.cell_number([x, y, z]);
                    let Some(range) = self.cells.find(cell) else { continue };
                    self.tell_run(range, picked);
                }
            }
        }
    }

    /// Tells a run of points that one is picked.
    fn tell_run(&mut self, run: Range<usize>, picked: [i32; 3]) {
        let [x, y, z] = self.q.each_ref().map(|column| &column[run.clone()]);
        let nearest2 = &mut self.nearest2[run];
        for (((nearest2, x), y), z) in nearest2.iter_mut().zip(x).zip(y).zip(z) {
            let d2 = distance2([*x, *y, *z], picked);
            if d2 < *nearest2 {
                *nearest2 = d2;
            }
        }
    }
}

/// The level of the n-tree whose cells are no smaller than a radius.
fn level_at(tree: &NTree, radius2: f32) -> u32 {
    let radius = f64::from(radius2).sqrt();
    let is_enough = |level: &u32| (1u64 << tree.cell_log2(level + 1)) as f64 >= radius;
    (0..tree.depth()).take_while(is_enough).count() as u32
}

/// Of quantised coordinates, which are below 2^31: differences are exact, and the rounding of their squares, the same
/// everywhere, moves a radius by a ten millionth.
fn distance2(a: [i32; 3], b: [i32; 3]) -> f32 {
    let d = |i: usize| a[i].wrapping_sub(b[i]) as f32;
    d(0) * d(0) + d(1) * d(1) + d(2) * d(2)
}

/// Where the points of each cell stand: a table of cell numbers with open addressing.
#[derive(Default)]
struct Cells {
    slots: Vec<(u64, u32, u32)>,
    mask: usize,
}

impl Cells {
    /// From the cell of each point; equal ones stand together.
    fn new(cells: impl Iterator<Item = u64>) -> Self {
        let mut runs: Vec<(u64, u32, u32)> = Vec::new();
        for (i, cell) in cells.enumerate() {
            match runs.last_mut() {
                Some(last) if last.0 == cell => last.2 += 1,
                _ => runs.push((cell, i as u32, i as u32 + 1)),
            }
        }
        let size = (runs.len() * 2).next_power_of_two().max(2);
        let mut table = Self { slots: vec![(0, 0, 0); size], mask: size - 1 };
        for run in runs {
            let mut at = table.home(run.0);
            while table.slots[at].2 > 0 {
                at = (at + 1) & table.mask;
            }
            table.slots[at] = run;
        }
        table
    }

    fn home(&self, cell: u64) -> usize {
        (cell.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32) as usize & self.mask
    }

    fn find(&self, cell: u64) -> Option<Range<usize>> {
        let mut at = self.home(cell);
        loop {
            match self.slots[at] {
                (_, _, 0) => return None,
                (c, first, end) if c == cell => return Some(first as usize..end as usize),
                _ => at = (at + 1) & self.mask,
            }
        }
    }
}
