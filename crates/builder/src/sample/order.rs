//! The order of a node's points: level by level; within a level in strata; within a stratum along
//! the Morton curve. A level is an octave of turns, in which the radius of thinning halves, so a
//! prefix of whole strata is an even sample.

use crate::sample::turns::TURNS_PER_OCTAVE;
use esker_points::node::LEVELS_MAX;
use esker_points::strata::{STRATA, residue, stratum_len};

/// Points up to which the first levels are joined, since they are too small to be worth a prefix
/// each.
const FIRST_LEVEL_POINTS: usize = 32;

/// Points in drawing order, and the points of each level.
pub struct Order {
    /// Indices into the points given.
    pub points: Vec<u32>,
    /// Points of each level, at most [`LEVELS_MAX`] levels.
    pub levels: Vec<usize>,
}

/// Numbers points along the curve by their turns. Within a turn every 16th point along the curve
/// comes first, so that a part of a turn is spread over all of it.
pub struct Sequence {
    first_turn: u16,
    steps: Vec<Step>,
}

/// The points of a turn.
#[derive(Clone, Copy, Default)]
struct Step {
    points: usize,
    /// Number of points that have been numbered.
    numbered: usize,
    /// Next number for points whose index along the curve has this residue.
    next: [usize; STRATA],
}

impl Sequence {
    /// Counts the points of each turn.
    pub fn new(turns: &[u16]) -> Self {
        let first_turn = turns.iter().copied().min().unwrap_or(0);
        let last_turn = turns.iter().copied().max().unwrap_or(0);
        let mut steps = vec![Step::default(); usize::from(last_turn - first_turn) + 1];
        turns.iter().for_each(|turn| steps[usize::from(turn - first_turn)].points += 1);
        let mut before = 0;
        for step in &mut steps {
            for stratum in 0..STRATA {
                step.next[residue(stratum)] = before;
                before += stratum_len(step.points, stratum);
            }
        }
        Self { first_turn, steps }
    }

    /// Returns the number of the next point along the curve, which has this turn.
    pub fn number(&mut self, turn: u16) -> usize {
        let step = &mut self.steps[usize::from(turn - self.first_turn)];
        let next = &mut step.next[step.numbered % STRATA];
        let number = *next;
        *next += 1;
        step.numbered += 1;
        number
    }

    /// Counts the points of each level: one level an octave, except that the first ones, and those
    /// beyond the last, are joined.
    fn levels(&self) -> Vec<usize> {
        let mut levels: Vec<usize> = Vec::new();
        let mut octave = None;
        for (turn, step) in (self.first_turn..).zip(&self.steps).filter(|s| s.1.points > 0) {
            let new = turn / TURNS_PER_OCTAVE;
            let same = octave == Some(new);
            octave = Some(new);
            let full = levels.len() == LEVELS_MAX;
            let small = levels.len() == 1 && levels[0] < FIRST_LEVEL_POINTS;
            match levels.last_mut() {
                Some(last) if same || full || small => *last += step.points,
                _ => levels.push(step.points),
            }
        }
        levels
    }
}

/// Orders points along the curve by their turns.
pub fn order(turns: &[u16]) -> Order {
    let mut sequence = Sequence::new(turns);
    let levels = sequence.levels();
    let mut strata = Vec::with_capacity(levels.len() * STRATA + 1);
    let mut end = 0;
    for s in levels.iter().flat_map(|&n| (0..STRATA).map(move |s| stratum_len(n, s))) {
        end += s;
        strata.push(end);
    }
    let stratum_of = stratum_by_number(&strata, turns.len());
    let mut next: Vec<usize> = std::iter::once(0).chain(strata.iter().copied()).collect();
    let mut points = vec![0; turns.len()];
    for (i, &turn) in (0..).zip(turns) {
        let slot = &mut next[usize::from(stratum_of[sequence.number(turn)])];
        points[*slot] = i;
        *slot += 1;
    }
    Order { points, levels }
}

/// Expands the ends of strata to the stratum of each number.
fn stratum_by_number(ends: &[usize], points: usize) -> Vec<u16> {
    let mut out = Vec::with_capacity(points);
    ends.iter().zip(0..).for_each(|(&end, stratum)| out.resize(end, stratum));
    out
}

/// Divides points along the curve into `parts` consecutive parts of their sequence, as equal in
/// number as possible. Returns the part of each point.
pub fn parts(turns: &[u16], parts: usize) -> Vec<u32> {
    let mut sequence = Sequence::new(turns);
    turns.iter().map(|&turn| (sequence.number(turn) * parts / turns.len()) as u32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_point_comes_once_in_its_turn_and_along_the_curve(turns in prop::collection::vec(40u16..90, 0..700)) {
            let order = order(&turns);
            let mut seen = vec![false; turns.len()];
            order.points.iter().for_each(|&i| seen[i as usize] = true);
            prop_assert!(seen.iter().all(|&s| s));
            prop_assert!(order.levels.len() <= LEVELS_MAX);
            prop_assert_eq!(order.levels.iter().sum::<usize>(), turns.len());
            prop_assert!(order.levels.iter().all(|&l| l > 0));
            let (mut start, mut last_turn) = (0, 0);
            for n in order.levels {
                let of_level = |range: std::ops::Range<usize>| order.points[range].iter().map(|&i| turns[i as usize]);
                let level = start..start + n;
                prop_assert!(of_level(level.clone()).min() >= Some(last_turn));
                last_turn = of_level(level).max().unwrap_or(0);
                for s in 0..STRATA {
                    let stratum = start..start + stratum_len(n, s);
                    prop_assert!(order.points[stratum.clone()].is_sorted());
                    start = stratum.end;
                }
            }
        }

        #[test]
        fn parts_are_even_and_in_sequence(turns in prop::collection::vec(40u16..60, 1..700), count in 1usize..5) {
            let parts = parts(&turns, count);
            for part in 0..count as u32 {
                let points = parts.iter().filter(|p| **p == part).count();
                prop_assert!(points.abs_diff(turns.len() / count) <= 1);
            }
            let before = |a: usize, b: usize| turns[a] >= turns[b] || parts[a] <= parts[b];
            prop_assert!((1..turns.len()).all(|i| before(i - 1, i) && before(i, i - 1)));
        }
    }

    #[test]
    fn a_part_of_a_turn_is_spread_over_all_of_it() {
        let order = order(&[7; 64]);
        assert_eq!(order.points[..4], [0, 16, 32, 48]);
        assert_eq!(order.points[4..8], [8, 24, 40, 56]);
    }
}
