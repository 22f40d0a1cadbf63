//! Thinning: points picked so that no two are nearer than a radius and none is farther from a picked one,
//! with a radius that shrinks turn by turn (progressive Poisson-disk sampling; maximal at each turn). Every
//! beginning of the sequence so is an even sample, given the points that were there before.
//!
//! Each point that is not yet picked knows its distance to the nearest picked one: a picked point tells all
//! within the radius. It waits for the turn at which that distance is enough, and is looked at only then.

use crate::ntree::NTree;
use crate::rest::{PICKED, Rest};
use crate::turn::{TURNS_PER_OCTAVE, radius_at};

/// Multiplier of the golden ratio: multiples are spread evenly, however few or many.
const GOLDEN: u32 = 0x9e37_79b9;
/// Undoes it, modulo 2^32.
const GOLDEN_INVERSE: u32 = 0x144c_bc89;

/// A point that a cell below has picked at an earlier turn is picked so many turns before its distance is enough,
/// that is from 0.65 of the radius on: the points of a turn leave no gap in the cell below, but without one of them,
/// for the sake of a point out of turn, the gap can be almost twice the radius. (Gaps over 1.5 times those of
/// Poisson-disk samples: 8 of 7,838 prefixes where the cell above waits for the whole radius, none where it and
/// the node's own order wait for 0.6 to 0.7 of it.)
const DUE_TURNS: usize = 10;

/// What a point is to a thinning.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Picked before.
    Picked,
    /// May be picked.
    Candidate,
    /// Not there.
    Absent,
}

/// What is picked at a turn.
pub struct Step {
    /// The turn.
    pub turn: u16,
    /// Entries, in the n-tree's order.
    pub entries: Vec<u32>,
}

/// The points still to be picked from, along the n-tree's order. Iterates over turns at which there is something to
/// pick, until what is left coincides, as far as the n-tree can tell, with what is picked.
pub struct Thinning<'a> {
    tree: &'a NTree,
    first_turn: u16,
    /// Square of the radius of each turn, from the first to that of quantising, in quantised steps.
    radii2: Vec<f32>,
    /// The next turn, after the first.
    next: usize,
    rest: Rest,
    /// Those that wait for each turn, as they are looked at: see [`Thinning::place`].
    waiting: Vec<Vec<u64>>,
}

impl<'a> Thinning<'a> {
    /// Begins at a turn, with the part that each entry plays.
    pub fn new(tree: &'a NTree, part: impl Fn(usize) -> Part, first_turn: u16) -> Self {
        let radius = |turn| tree.quantised(radius_at(turn)) as f32;
        let radii2 = (first_turn..).map(radius).take_while(|r| *r > 1.0).map(|r| r * r);
        let radii2: Vec<f32> = radii2.chain([1.0]).collect();
        let rest = Rest::new(tree, |i| part(i) == Part::Candidate, radii2[0]);
        let mut thinning = Self {
            tree,
            first_turn,
            waiting: vec![Vec::new(); radii2.len()],
            radii2,
            next: 0,
            rest,
        };
        for (i, entry) in tree.entries.iter().enumerate() {
            if part(i) == Part::Picked {
                thinning.rest.tell(tree, entry.q.map(|c| c as i32), thinning.radii2[0]);
            }
        }
        thinning.wait();
        thinning
    }

    /// The points left, in the n-tree's order.
    pub fn left(&self) -> Vec<u32> {
        self.rest.entry.iter().copied().filter(|&e| e != PICKED).collect()
    }

    /// The next turn.
    pub fn turn(&self) -> u16 {
        self.first_turn + self.next as u16
    }

    /// The first turn whose radius a distance is enough for.
    fn enough(&self, nearest2: f32) -> usize {
        // The bits of a float are nearly its logarithm: with 23 of them for an octave of squares, right within one.
        const SHIFT: u32 = 23 - (TURNS_PER_OCTAVE / 2).ilog2();
        let below = self.radii2[0].to_bits().saturating_sub(nearest2.to_bits()) >> SHIFT;
        let mut turn = (below as usize).min(self.radii2.len());
        while turn > 0 && self.radii2[turn - 1] <= nearest2 {
            turn -= 1;
        }
        while turn < self.radii2.len() && self.radii2[turn] > nearest2 {
            turn += 1;
        }
        turn
    }

    /// The turn for which a point waits; `None` where it coincides with a picked one.
    fn turn_of(&self, i: usize) -> Option<usize> {
        let enough = self.enough(self.rest.nearest2[i]);
        let placed = usize::from(self.rest.placed[i].saturating_sub(self.first_turn));
        let turn = enough.min(enough.saturating_sub(DUE_TURNS).max(placed));
        (turn < self.radii2.len()).then_some(turn)
    }

    /// Where a point stands among those that are looked at in a turn: first what a cell below has picked first.
    /// Then along the curve, which is fast; but on a line that would pack points as tightly as can be and leave
    /// gaps of almost twice the radius, so there in an order that leaves and returns.
    fn place(&self, i: u32) -> u64 {
        let order = if self.tree.dimension == 1 { i.wrapping_mul(GOLDEN) } else { i };
        u64::from(self.rest.placed[i as usize]) << 32 | u64::from(order)
    }

    /// The point that stands there.
    fn point_at(&self, place: u64) -> usize {
        let order = place as u32;
        let i = if self.tree.dimension == 1 { order.wrapping_mul(GOLDEN_INVERSE) } else { order };
        i as usize
    }

    /// Has all points left wait for their turns.
    fn wait(&mut self) {
        self.waiting.iter_mut().for_each(Vec::clear);
        for i in 0..self.rest.entry.len() {
            if let Some(turn) = self.turn_of(i) {
                let place = self.place(i as u32);
                self.waiting[turn.max(self.next)].push(place);
            }
        }
    }

    /// Picks what can be picked at a turn.
    fn pick(&mut self, turn: usize) -> Vec<u32> {
        let mut picked = Vec::new();
        let mut waiting = std::mem::take(&mut self.waiting[turn]);
        waiting.sort_unstable();
        for place in waiting {
            let i = self.point_at(place);
            match self.turn_of(i) {
                Some(later) if later > turn => self.waiting[later].push(place),
                Some(_) => {
                    picked.push(std::mem::replace(&mut self.rest.entry[i], PICKED));
                    self.rest.tell(self.tree, self.rest.position(i), self.radii2[turn]);
                }
                None => {}
            }
        }
        picked.sort_unstable();
        picked
    }
}

impl Iterator for Thinning<'_> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        while self.next < self.radii2.len() {
            let turn = self.next;
            if self.waiting[turn].is_empty() {
                self.next += 1;
                continue;
            }
            if self.rest.settle(self.tree, self.radii2[turn]) {
                self.wait();
            }
            let entries = self.pick(turn);
            self.next += 1;
            if !entries.is_empty() {
                return Some(Step { turn: self.first_turn + turn as u16, entries });
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::{rows_of, tree_of};
    use crate::turn::turn_at;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_step_is_maximal_and_keeps_its_distance(points in prop::collection::vec([0u32..4000, 0u32..4000, 0u32..4000], 2..300), flat: bool, there_every in 2usize..20, placed_every in 1usize..9) {
            let points: Vec<_> = points.into_iter().map(|p| if flat { [p[0], p[1], 7] } else { p }).collect();
            let bytes = rows_of(&points);
            let mut tree = tree_of(&points, &bytes, [0.01; 3]);
            let first_turn = turn_at(20.0);
            let placed = |i: usize| placed_every > 1 && i.is_multiple_of(placed_every);
            (0..points.len()).filter(|&i| placed(i)).for_each(|i| tree.entries[i].turn = first_turn + i as u16 % 40);
            let there = |i: usize| i.is_multiple_of(there_every);
            let part = |i: usize| if there(i) { Part::Picked } else { Part::Candidate };
            let mut thinning = Thinning::new(&tree, part, first_turn);
            let mut picked: Vec<usize> = (0..points.len()).filter(|&i| there(i)).collect();
            while let Some(step) = thinning.next() {
                let radius2 = tree.quantised(radius_at(step.turn)).max(1.0).powi(2);
                let away = |a: usize, b: usize| -> f64 { (0..3).map(|i| (f64::from(tree.entries[a].q[i]) - f64::from(tree.entries[b].q[i])).powi(2)).sum() };
                for (k, &e) in step.entries.iter().enumerate() {
                    let before = picked.iter().copied().chain(step.entries[..k].iter().map(|&i| i as usize));
                    for other in before {
                        let is_due = |i: usize| tree.entries[i].turn <= step.turn;
                        let share2: f64 = if is_due(e as usize) || is_due(other) { 0.42 } else { 1.0 - 1e-6 };
                        prop_assert!(away(e as usize, other) >= radius2 * share2);
                    }
                }
                picked.extend(step.entries.iter().map(|&i| i as usize));
                for left in thinning.left() {
                    prop_assert!(picked.iter().any(|&p| away(left as usize, p) < radius2 * (1.0 + 1e-6)));
                }
            }
            for left in thinning.left() {
                prop_assert!(picked.iter().any(|&p| tree.entries[p].q == tree.entries[left as usize].q));
            }
        }
    }
}
