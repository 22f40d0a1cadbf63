//! Progressive Poisson-disk thinning (after `mccool1992`): at each turn no two picked points are
//! closer than the radius and no point is farther than it from a picked one; the radius shrinks
//! turn by turn. So every prefix of the sequence is an even sample. Each point that is not picked
//! yet keeps its distance to the nearest picked one, which a pick updates within the radius. A turn
//! is a pass over these distances along the Morton curve. See docs/design/building.md.

use crate::sample::candidates::Candidates;
use crate::sample::compact::{GROUP, indices_of, mask_of, push_indices};
use crate::sample::turns::{LAST_TURN, radius_at, turn_at};
use crate::sample::unpicked::{Unpicked, octave};
use fearless_simd::{Level, Simd, dispatch};

/// Share of the radius from which a point is picked that a cell below has picked at an earlier
/// turn. The points of a turn leave no gap in the cell below; if one of them is dropped for a point
/// out of turn, the gap can be almost twice the radius. Between 0.6 and 0.7 gaps stay within the
/// bound of `crates/builder/tests/evenness.rs`.
const DUE_SHARE: f32 = 0.65;

/// While the radius is large, a part of the points is enough: the first in each octree cell whose
/// edge is at most this share of the radius, and those that a cell below has picked by then.
const PART_EDGE: f64 = 0.25;

/// Neighbour cells are made finer, at most by `FINER` powers of two, while they hold at least
/// `DENSE` points on average.
const DENSE: usize = 16;
const FINER: u32 = 2;

/// If all points are to be picked and 1 / `BESIDE_SHARE` of them are, a pick updates only those
/// beside it along the curve, which are most of those near it.
const BESIDE_SHARE: usize = 3;

/// Pairs of picked and other points in one cell, for each point, above which distances are searched
/// point by point. The cell above may have picked points much closer than the radius.
const PAIRS_EACH: usize = 32;

/// Fraction of the golden ratio, of `GOLDEN_BITS` bits: its multiples are spread evenly, however
/// many.
const GOLDEN: usize = 0x9e37_79b9;
const GOLDEN_BITS: u32 = 32;

/// Sampler that picks points turn by turn.
pub struct PoissonSampler<'a> {
    candidates: &'a Candidates,
    /// Turn at which a cell below has picked each point; empty if none has.
    turns_below: &'a [u16],
    /// Turn at which each point was picked; [`LAST_TURN`] if it is not.
    pub turns: Vec<u16>,
    /// Points in the order in which they were picked.
    pub picked: Vec<u32>,
    /// Number of points that were picked before the last turn.
    pub picked_before: usize,
    /// Whether the points lie along a line.
    is_line: bool,
    /// The next turn.
    turn: u16,
    unpicked: Unpicked,
    /// Points to consider while not all are.
    part: Vec<u32>,
    /// Octave of radii for which `unpicked` was filled; `None` before.
    octave: Option<u32>,
    /// No two points of `unpicked` share a cell of this log2, unless a cell below has picked them;
    /// 0 if it has all points.
    part_log2: u8,
    is_over: bool,
    /// Number of points to pick; coincident ones count once if all points are to be picked.
    points: usize,
    /// Number of picked points from which on a pick updates only those beside it along the curve.
    beside_from: usize,
    is_beside: bool,
}

impl<'a> PoissonSampler<'a> {
    /// Begins at `radius`, in the file's unit. `turns_below` is empty or has a turn for each
    /// candidate; `turns` has those of the points that are picked already, [`LAST_TURN`] for the
    /// others.
    pub fn new(
        candidates: &'a Candidates,
        turns_below: &'a [u16],
        turns: Vec<u16>,
        radius: f64,
        dimension: u32,
    ) -> Self {
        let picked = indices_of(&turns, |&turn| turn != LAST_TURN);
        Self {
            candidates,
            turns_below,
            picked_before: picked.len(),
            turns,
            picked,
            is_line: dimension == 1,
            turn: turn_at(radius),
            unpicked: Unpicked::default(),
            part: Vec::new(),
            octave: None,
            part_log2: Candidates::ALONE,
            is_over: false,
            points: candidates.len(),
            beside_from: usize::MAX,
            is_beside: false,
        }
    }

    /// Picks all points, the last of them faster (see [`BESIDE_SHARE`]).
    pub fn of_all(mut self) -> Self {
        self.points = self.candidates.places();
        if !self.is_line {
            self.beside_from = self.points / BESIDE_SHARE;
        }
        self
    }

    /// Continues turn by turn until `wanted` points are picked, or all.
    pub fn pick(&mut self, wanted: usize) {
        while self.picked.len() < wanted && !self.is_over {
            self.picked_before = self.picked.len();
            dispatch!(Level::new(), simd => self.pick_turn(simd));
        }
    }

    #[inline(always)]
    fn pick_turn<S: Simd>(&mut self, simd: S) {
        if self.octave != Some(octave(self.radius())) {
            if self.is_complete() {
                // Skips to the turn at which there is something to pick.
                let farthest2 = self.unpicked.farthest2();
                if farthest2 < 1.0 {
                    return self.finish();
                }
                let farthest = f64::from(farthest2).sqrt() * self.candidates.step;
                self.turn = self.turn.max(turn_at(farthest));
            }
            self.prepare(simd);
        }
        if !self.is_beside && self.is_complete() && self.picked.len() >= self.beside_from {
            self.is_beside = true;
            self.unpicked.shrink();
        }
        self.pick_at(simd, self.radius());
        if self.radius() <= 1.0 {
            self.finish();
        }
        self.turn += 1;
    }

    /// Radius of the next turn, in steps.
    fn radius(&self) -> f64 {
        (radius_at(self.turn) / self.candidates.step).max(1.0)
    }

    /// Whether `unpicked` has all points that are to be picked, except coincident ones.
    fn is_complete(&self) -> bool {
        self.octave.is_some() && self.part_log2 == 0
    }

    /// Chooses the points to consider, and the cells to find neighbours by, for the next turns.
    #[inline(always)]
    fn prepare<S: Simd>(&mut self, simd: S) {
        let radius = self.radius();
        let until = turn_at(radius * self.candidates.step / 2.0);
        if self.is_complete() {
            // Some of the points picked before may coincide.
            let points = self.points.saturating_sub(self.picked.len());
            let log2 = self.cell_log2(radius, points);
            // Cells may be twice as large as needed while little would be removed. On a line they
            // are always rebuilt, since the order there depends on what is removed.
            let is_much = self.unpicked.points() / 4 * 3 > points;
            if self.is_beside {
                if is_much {
                    self.unpicked.shrink();
                }
            } else if self.is_line || is_much || self.unpicked.log2() > log2 + 1 {
                self.unpicked.rebuild(log2);
            }
        } else {
            self.part_log2 = self.part_log2(radius);
            self.choose_part(until);
            let q = &self.candidates.q;
            let log2 = self.cell_log2(radius, self.part.len());
            self.unpicked.refill(q, &self.part, log2);
            // Of coincident points one is enough.
            let mut picked = indices_of(&self.turns, |&turn| turn != LAST_TURN);
            picked.dedup_by_key(|i| q[*i as usize]);
            let places: Vec<[i32; 3]> = picked.iter().map(|&i| q[i as usize]).collect();
            let reach = (radius as i32).saturating_add(1);
            let pairs = pairs([&picked, &self.part], |i| q[i as usize].map(|c| c >> log2));
            if pairs > PAIRS_EACH * (picked.len() + self.part.len()) {
                self.unpicked.find_nearest(&places, reach);
            } else {
                places.iter().for_each(|p| self.unpicked.update_near(simd, p, reach));
            }
        }
        if !self.turns_below.is_empty() {
            self.unpicked.set_due(self.turns_below);
        }
        self.octave = Some(octave(radius));
    }

    /// Log2 of the edge of cells by which neighbours within a radius are found. The less a cell
    /// reaches beyond the radius the better, while cells hold many of `points` points.
    fn cell_log2(&self, radius: f64, points: usize) -> u32 {
        let octave = octave(radius);
        let is_dense =
            |log2: &u32| self.candidates.firsts[*log2 as usize] as usize * DENSE <= points;
        (octave.saturating_sub(FINER)..octave).find(is_dense).unwrap_or(octave)
    }

    /// Lists the points to consider for turns up to `until`.
    #[inline(always)]
    fn choose_part(&mut self, until: u16) {
        let shared = self.candidates.shared_log2.chunks(GROUP);
        let turns = self.turns.chunks(GROUP);
        self.part.clear();
        for (start, (shared, turns)) in (0..).step_by(GROUP).zip(shared.zip(turns)) {
            let turns_below = self.turns_below.get(start..start + shared.len()).unwrap_or_default();
            let wanted = mask_of(shared, |&log2| log2 > self.part_log2)
                | mask_of(turns_below, |&turn| turn <= until);
            // Mostly there is none, which this branch predicts well.
            if wanted != 0 {
                let left = mask_of(turns, |&turn| turn == LAST_TURN);
                push_indices(start as u32, wanted & left, &mut self.part);
            }
        }
    }

    /// Log2 of the edge of cells whose first points are enough down to half of `radius`; 0 if most
    /// points are needed.
    fn part_log2(&self, radius: f64) -> u8 {
        let log2 = (radius / 2.0 * PART_EDGE).log2().floor().clamp(0.0, 31.0) as u8;
        if self.candidates.firsts[usize::from(log2)] as usize * 2 > self.points { 0 } else { log2 }
    }

    /// Picks points at a radius: first those that a cell below has picked, then the others along
    /// the curve. On a line the order of the curve would pack points as tightly as possible and
    /// leave gaps of almost twice the radius, so there the order jumps back and forth.
    #[inline(always)]
    fn pick_at<S: Simd>(&mut self, simd: S, radius: f64) {
        let radius2 = (radius * radius) as f32;
        let reach = (radius as i32).saturating_add(1);
        if !self.turns_below.is_empty() {
            let due2 = (radius2 * DUE_SHARE * DUE_SHARE).max(1.0);
            let mut from = 0;
            while let Some(i) = self.unpicked.next_due_from(from, self.turn, due2) {
                self.pick_one(simd, i, reach);
                from = i + 1;
            }
        }
        if self.is_line {
            let bits = self.unpicked.len().next_power_of_two().ilog2();
            let multiplier = GOLDEN >> (GOLDEN_BITS - bits) | 1;
            let spread =
                (0..1 << bits).map(|i: usize| i.wrapping_mul(multiplier) & ((1 << bits) - 1));
            for i in spread {
                if i < self.unpicked.len() && self.unpicked.nearest2(i) >= radius2 {
                    self.pick_one(simd, i, reach);
                }
            }
        } else {
            let mut from = 0;
            while let Some(i) = self.unpicked.next_from(from, radius2) {
                self.pick_one(simd, i, reach);
                from = i + 1;
            }
        }
    }

    #[inline(always)]
    fn pick_one<S: Simd>(&mut self, simd: S, i: usize, reach: i32) {
        let candidate = self.unpicked.candidate(i);
        self.turns[candidate as usize] = self.turn;
        self.picked.push(candidate);
        if self.is_beside {
            self.unpicked.update_beside(simd, i);
        } else {
            self.unpicked.update_around(simd, i, reach);
        }
    }

    /// Appends the points that are left, which coincide with picked ones.
    fn finish(&mut self) {
        self.is_over = true;
        for i in 0..self.turns.len() {
            if self.turns[i] == LAST_TURN {
                self.turns[i] = self.turn;
                self.picked.push(i as u32);
            }
        }
    }
}

/// Counts the pairs of two points in the same cell, one of each list. Both lists are along the
/// curve.
fn pairs([a, b]: [&[u32]; 2], cell: impl Fn(u32) -> [i32; 3]) -> usize {
    let (mut b, mut sum) = (b.iter().copied().peekable(), 0);
    for a in a.chunk_by(|&a, &b| cell(a) == cell(b)) {
        let own = cell(a[0]);
        while b.next_if(|&b| b < a[0] && cell(b) != own).is_some() {}
        while b.next_if(|&b| cell(b) == own).is_some() {
            sum += a.len();
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use crate::sample::choose::{assign_turns, choose};
    use crate::sample::effort;
    use proptest::prelude::*;

    /// Updates of eight points, and boxes, for each point of any cloud.
    const OPERATIONS_EACH: usize = 250;

    proptest! {
        #[test]
        fn every_turn_is_maximal_and_keeps_its_distance(points in prop::collection::vec([0u32..4000, 0u32..4000, 0u32..4000], 2..400), flat: bool, placed_every in 1usize..9) {
            let points: Vec<_> = points.into_iter().map(|p| if flat { [p[0], p[1], 7] } else { p }).collect();
            let candidates = candidates_of(&points, [0.01; 3]);
            let first = turn_at(20.0);
            let turns_below = |i: usize| if i % placed_every == 1 { first + i as u16 % 20 } else { LAST_TURN };
            let turns_below: Vec<u16> = (0..points.len()).map(turns_below).collect();
            let mut sampler = PoissonSampler::new(&candidates, &turns_below, vec![LAST_TURN; points.len()], 40.96, 3);
            let away2 = |a: u32, b: u32| -> f64 { (0..3).map(|i| f64::from(candidates.q[a as usize][i] - candidates.q[b as usize][i]).powi(2)).sum() };
            while !sampler.is_over {
                sampler.pick(sampler.picked.len() + 1);
                let turn = sampler.turn - 1;
                let radius2 = (radius_at(turn) / 0.01).max(1.0).powi(2);
                for k in sampler.picked_before..sampler.picked.len() {
                    let is_due = |i: u32| turns_below[i as usize] <= turn;
                    for other in 0..k {
                        let (a, b) = (sampler.picked[k], sampler.picked[other]);
                        let share2: f64 = if is_due(a) || is_due(b) { 0.42 } else { 1.0 - 1e-6 };
                        prop_assert!(sampler.is_over || away2(a, b) >= (radius2 * share2).max(1.0));
                    }
                }
                for left in (0..points.len() as u32).filter(|&i| sampler.turns[i as usize] == LAST_TURN) {
                    prop_assert!(sampler.part_log2 > 0 || sampler.picked.iter().any(|&p| away2(left, p) < radius2 * (1.0 + 1e-6)));
                }
            }
            prop_assert_eq!(sampler.picked.len(), points.len());
        }
    }

    proptest! {
        #[test]
        fn pairs_are_those_of_all_points(points in prop::collection::vec([0u32..99, 0u32..99, 0u32..9], 1..200), log2 in 0u32..7, every in 1usize..9) {
            let candidates = candidates_of(&points, [1.0; 3]);
            let cell = |i: u32| candidates.q[i as usize].map(|c| c >> log2);
            let all = 0..points.len() as u32;
            let (a, b): (Vec<u32>, Vec<u32>) = all.partition(|i| (*i as usize).is_multiple_of(every));
            let of = |&i: &u32| b.iter().filter(|&&j| cell(j) == cell(i)).count();
            prop_assert_eq!(pairs([&a, &b], cell), a.iter().map(of).sum::<usize>());
        }
    }

    #[test]
    fn work_grows_with_the_number_of_points_however_they_are_spread() {
        for (name, cloud) in effort::CLOUDS {
            let edge = f64::from(1u32 << 31);
            effort::assert_linear(
                &format!("{name}, an upper cell"),
                (4000, OPERATIONS_EACH),
                |n| {
                    let candidates = candidates_of(&cloud(n), [1.0; 3]);
                    effort::restart();
                    choose(&candidates, &[], n / 2, edge, 2);
                },
            );
            effort::assert_linear(&format!("{name}, a leaf below"), (4000, OPERATIONS_EACH), |n| {
                let candidates = candidates_of(&cloud(n), [1.0; 3]);
                // The cell above took every third point.
                let taken: Vec<u16> =
                    (0..n).map(|i| if i % 3 == 0 { 4000 } else { LAST_TURN }).collect();
                effort::restart();
                assign_turns(&candidates, &taken, Some(1e6), edge, 2);
            });
        }
    }
}
