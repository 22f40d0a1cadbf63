//! Which points represent a cell: as many as a node holds, evenly, from the points that its children
//! offer (kanzok2015, section 3.1, figure 1, bottom-up). They are thinned from a large radius down until the
//! node is full.
//!
//! When a point was picked is its *turn*, and stays with it: it is the place of the point in its node's order, and
//! the cell above rather picks a point in its turn than keep the whole radius. So the samples of all levels, and the
//! prefixes of each node, are beginnings of nearly one sequence. Points that no cell above has picked get their turns
//! last, cell by cell: what is drawn of a cell must not depend on its neighbours.

use crate::sample::candidates::Candidates;
use crate::sample::thin::PoissonSampler;
use crate::sample::turns::LAST_TURN;

/// How far from the points that the cell above took sampler begins, in units of their spacing: beyond the
/// greatest gap of an even sample, also where what covers the rim of the cell lies beyond it.
const TAKEN_REACH: f64 = 1.5;

/// The turns, by offered point, of the `capacity` points chosen, or all where there are fewer; [`LAST_TURN`] for the
/// others. `turns_below` has the turns that cells below have given, or is empty. `edge` is that of the whole, in the file's
/// unit.
pub fn choose(
    candidates: &Candidates,
    turns_below: &[u16],
    capacity: usize,
    edge: f64,
    dimension: u32,
) -> Vec<u16> {
    let turns_below = candidates.along_curve(turns_below);
    let none = vec![LAST_TURN; candidates.len()];
    let mut sampler = PoissonSampler::new(candidates, &turns_below, none, edge, dimension);
    sampler.pick(capacity);
    let mut step = sampler.picked.split_off(sampler.picked_before);
    step.sort_unstable();
    // As much of the last turn as there is room for, spread over all of it.
    let room = (capacity - sampler.picked.len()).min(step.len());
    let mut turns = sampler.turns;
    let kept = |j: usize| step[(2 * j + 1) * step.len() / (2 * room)] as usize;
    let kept: Vec<_> = (0..room).map(|j| (kept(j), turns[kept(j)])).collect();
    step.iter().for_each(|&i| turns[i as usize] = LAST_TURN);
    kept.into_iter().for_each(|(i, turn)| turns[i] = turn);
    candidates.as_offered(turns)
}

/// Gives turns to all offered points but those that the cell above took, whose turns are told and whose sample has the
/// spacing `above`. `edge` is as in [`choose`].
pub fn assign_turns(
    candidates: &Candidates,
    taken: &[u16],
    above: Option<f64>,
    edge: f64,
    dimension: u32,
) -> Vec<u16> {
    let before = match taken {
        [] => vec![LAST_TURN; candidates.len()],
        taken => candidates.along_curve(taken).into_owned(),
    };
    let radius = above.map_or(edge, |above| (above * TAKEN_REACH).min(edge));
    let mut sampler = PoissonSampler::new(candidates, &[], before, radius, dimension).of_all();
    sampler.pick(usize::MAX);
    candidates.as_offered(sampler.turns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exactly_as_many_points_as_requested_are_chosen(points in prop::collection::vec([0u32..5000, 0u32..5000, 0u32..40], 1..600), capacity in 1usize..300) {
            let candidates = candidates_of(&points, [0.01; 3]);
            let turns = choose(&candidates, &[], capacity, 81.92, 2);
            let chosen = turns.iter().filter(|turn| **turn != LAST_TURN);
            prop_assert_eq!(chosen.count(), capacity.min(points.len()));
            let assigned = assign_turns(&candidates, &turns, Some(0.5), 81.92, 2);
            prop_assert!(assigned.iter().zip(&turns).all(|(p, t)| *p != LAST_TURN && (*t == LAST_TURN || p == t)));
        }
    }

    #[test]
    fn coincident_points_fill_the_capacity() {
        let candidates = candidates_of(&[[9; 3]; 100], [1.0; 3]);
        let turns = choose(&candidates, &[], 64, 1.0, 0);
        assert_eq!(turns.iter().filter(|turn| **turn != LAST_TURN).count(), 64);
    }
}
