//! Thinning: points picked so that no two are nearer than a radius and none is farther from a picked one,
//! with a radius that shrinks step by step (progressive Poisson-disk sampling; maximal at each step). Every
//! beginning of the sequence so is an even sample, given the points that were there before.
//!
//! Each point that is not yet picked knows its distance to the nearest picked one: a picked point tells all
//! within the radius. Neighbours are found by the n-tree's cells, so along a line or in a plane where that is
//! the local shape; distances are in space, in its quantised coordinates; all arithmetic is on integers.

use crate::ntree::NTree;

/// A point that is not yet picked.
#[derive(Clone, Copy)]
struct Rest {
    q: [u32; 3],
    /// Its entry in the n-tree; [`PICKED`] once picked.
    entry: u32,
    /// Square of the distance to the nearest picked point, where it is within the radius.
    nearest2: u64,
}

const PICKED: u32 = u32::MAX;

/// The points still to be picked from, along the n-tree's order.
pub struct Thinning<'a> {
    tree: &'a NTree,
    rest: Vec<Rest>,
    cells: Cells,
    /// Level of the n-tree whose cells are no smaller than the radius. (Half as large they follow the ball more
    /// closely, but finding them costs more than it saves: twice the time in a volume.)
    level: u32,
    radius: f64,
    shrink: f64,
    /// The order in which points are looked at, where they have turns; else empty.
    visits: Vec<u32>,
    ready: bool,
}

impl<'a> Thinning<'a> {
    /// Begins with points `there` before (entries; others may be picked), at a radius in quantised steps, which
    /// halves in `steps_per_level` steps.
    pub fn new(
        tree: &'a NTree,
        there: impl Fn(usize) -> bool,
        radius: f64,
        steps_per_level: u32,
    ) -> Self {
        let rest = tree.entries.iter().enumerate().filter(|(i, _)| !there(*i));
        let rest =
            rest.map(|(i, e)| Rest { q: e.q, entry: i as u32, nearest2: u64::MAX }).collect();
        let mut thinning = Self {
            tree,
            rest,
            cells: Cells::default(),
            level: 0,
            radius: radius.max(1.0),
            shrink: (-1.0 / f64::from(steps_per_level)).exp2(),
            visits: Vec::new(),
            ready: false,
        };
        thinning.settle();
        for (i, entry) in tree.entries.iter().enumerate() {
            if there(i) {
                thinning.tell(entry.q);
            }
        }
        thinning
    }

    /// How many points are left, some of them perhaps picked in this level.
    pub fn is_exhausted(&self) -> bool {
        self.rest.iter().all(|r| r.entry == PICKED)
    }

    /// The points left, in the n-tree's order.
    pub fn left(&self) -> Vec<u32> {
        self.rest.iter().map(|r| r.entry).filter(|&e| e != PICKED).collect()
    }

    /// The radius of the next step, in quantised steps.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Picks until every point left is within the radius of a picked one; entries in the n-tree's order.
    /// Then shrinks the radius: by a step, or to the farthest point left where that is nearer still.
    pub fn step(&mut self) -> Vec<u32> {
        let radius2 = square(self.radius);
        let mut picked = Vec::new();
        let mut farthest2 = 0;
        let (n, stride) = (self.rest.len(), self.stride());
        for turn in 0..n {
            let i = match self.visits.get(turn) {
                Some(&i) => i as usize,
                None => (turn as u64 * stride % n as u64) as usize,
            };
            let Rest { q, entry, nearest2 } = self.rest[i];
            if entry == PICKED {
                continue;
            }
            if nearest2 >= radius2 {
                picked.push(entry);
                self.rest[i].entry = PICKED;
                self.tell(q);
            } else {
                farthest2 = farthest2.max(nearest2);
            }
        }
        picked.sort_unstable();
        let farthest = (farthest2 as f64).sqrt();
        self.radius = (self.radius * self.shrink).min(farthest);
        self.settle();
        picked
    }

    /// The order in which points are looked at: along the curve, which is fast; but on a line that would pack
    /// them as tightly as can be and leave gaps of almost twice the radius, so there by a stride that leaves
    /// no point out.
    fn stride(&self) -> u64 {
        let n = self.rest.len() as u64;
        if self.tree.dimension != 1 || n < 3 {
            return 1;
        }
        let golden = (n as f64 * 0.618_033_988_749_895) as u64;
        (golden.max(1)..n).find(|&k| coprime(k, n)).unwrap_or(1)
    }

    /// Tells all points within the radius how near a picked point is.
    fn tell(&mut self, q: [u32; 3]) {
        let radius2 = square(self.radius);
        let log2 = self.tree.cell_log2(self.level);
        // Nearer than the radius is at most this far along each axis.
        let reach = (self.radius.max(1.0) as u64 - 1).min(u64::from(u32::MAX)) as u32;
        let end = ((1u64 << self.tree.cell_log2(0)) - 1) as u32;
        let cells = |axis: usize| {
            if axis >= self.tree.dimension as usize {
                return 0..=0;
            }
            q[axis].saturating_sub(reach) >> log2..=q[axis].saturating_add(reach).min(end) >> log2
        };
        // Square of the distance to a cell along an axis; cells are unbounded along axes beyond the dimension.
        let gap2 = |axis: usize, cell: u32| {
            if axis >= self.tree.dimension as usize {
                return 0;
            }
            let (low, high) = (cell << log2, (cell << log2) + ((1 << log2) - 1));
            u64::from(low.saturating_sub(q[axis]).max(q[axis].saturating_sub(high))).pow(2)
        };
        for z in cells(2) {
            for y in cells(1) {
                let gap2_yz = gap2(2, z) + gap2(1, y);
                for x in cells(0) {
                    if gap2_yz + gap2(0, x) >= radius2 {
                        continue;
                    }
                    let cell = self.tree.cell_number([x, y, z]);
                    let Some(range) = self.cells.find(cell) else { continue };
                    for rest in &mut self.rest[range] {
                        let d2 = distance2(rest.q, q);
                        if d2 < radius2 {
                            rest.nearest2 = rest.nearest2.min(d2);
                        }
                    }
                }
            }
        }
    }

    /// Chooses the cells for the radius; points already picked leave the list when the cells change.
    fn settle(&mut self) {
        let mut level = 0;
        while level < self.tree.depth()
            && (1u64 << self.tree.cell_log2(level + 1)) as f64 >= self.radius
        {
            level += 1;
        }
        if level == self.level && self.ready {
            return;
        }
        self.level = level;
        self.ready = true;
        self.rest.retain(|r| r.entry != PICKED);
        let turn = |r: &Rest| self.tree.entries[r.entry as usize].turn;
        self.visits.clear();
        if self.rest.windows(2).any(|pair| turn(&pair[0]) != turn(&pair[1])) {
            self.visits.extend(0..self.rest.len() as u32);
            self.visits.sort_by_key(|&i| turn(&self.rest[i as usize]));
        }
        self.cells = Cells::new(self.rest.iter().map(|r| self.tree.cell_at(r.q, level)));
    }
}

fn coprime(mut a: u64, mut b: u64) -> bool {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a == 1
}

fn square(radius: f64) -> u64 {
    let r = radius.max(1.0) as u64;
    r.saturating_mul(r)
}

/// Of quantised coordinates, which are below 2^31: three squares of differences fit, so nothing is
/// checked for overflow in what is the innermost loop of a build.
fn distance2(a: [u32; 3], b: [u32; 3]) -> u64 {
    let d2 = |i: usize| {
        let d = u64::from(a[i].abs_diff(b[i]));
        d.wrapping_mul(d)
    };
    d2(0).wrapping_add(d2(1)).wrapping_add(d2(2))
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

    fn find(&self, cell: u64) -> Option<std::ops::Range<usize>> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::{rows_of, tree_of};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_step_is_maximal_and_keeps_its_distance(points in prop::collection::vec([0u32..4000, 0u32..4000, 0u32..4000], 2..300), flat: bool, there_every in 2usize..20) {
            let points: Vec<_> = points.into_iter().map(|p| if flat { [p[0], p[1], 7] } else { p }).collect();
            let bytes = rows_of(&points);
            let tree = tree_of(&points, &bytes, [0.01; 3]);
            let there = |i: usize| i.is_multiple_of(there_every);
            let mut thinning = Thinning::new(&tree, there, tree.steps(20.0) as f64, 16);
            let mut picked: Vec<usize> = (0..points.len()).filter(|&i| there(i)).collect();
            for _ in 0..30 {
                let radius2 = square(thinning.radius());
                let new = thinning.step();
                let away = |a: usize, b: usize| distance2(tree.entries[a].q, tree.entries[b].q);
                for (k, &e) in new.iter().enumerate() {
                    let before = picked.iter().copied().chain(new[..k].iter().map(|&i| i as usize));
                    for other in before {
                        prop_assert!(away(e as usize, other) >= radius2);
                    }
                }
                picked.extend(new.iter().map(|&i| i as usize));
                for left in thinning.left() {
                    prop_assert!(picked.iter().any(|&p| away(left as usize, p) < radius2));
                }
            }
        }
    }
}
