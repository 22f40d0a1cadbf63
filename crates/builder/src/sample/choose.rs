//! Chooses the points that represent a cell, as many as a node holds, evenly, from the points that
//! its children offer (`kanzok2015`, section 3.1, figure 1, but bottom-up). The *turn* of a point
//! is the rung of the radius at which it was picked; it is its place in the order of its node, and
//! the cell above accepts the point in its turn. So the samples of all levels are beginnings of
//! nearly one sequence. Points that no cell above has picked get their turns last, cell by cell:
//! what is drawn of a cell must not depend on its neighbours.

use crate::sample::candidates::Candidates;
use crate::sample::thin::PoissonSampler;
use crate::sample::turns::LAST_TURN;

/// Radius at which thinning begins beside points that the cell above took, in units of their
/// spacing. It exceeds the greatest gap of an even sample, also where the nearest point of that
/// sample is in another cell.
const TAKEN_REACH: f64 = 1.5;

/// Chooses `capacity` of the offered points, or all if there are fewer. Returns the turn of each
/// offered point, [`LAST_TURN`] for those not chosen. `turns_below` has the turns that cells below
/// have assigned, or is empty. `edge` is the edge of the cell in the file's unit.
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
    // The last turn fills the room that is left with points spread over all of it.
    let room = (capacity - sampler.picked.len()).min(step.len());
    let mut turns = sampler.turns;
    let kept = |j: usize| step[(2 * j + 1) * step.len() / (2 * room)] as usize;
    let kept: Vec<_> = (0..room).map(|j| (kept(j), turns[kept(j)])).collect();
    step.iter().for_each(|&i| turns[i as usize] = LAST_TURN);
    kept.into_iter().for_each(|(i, turn)| turns[i] = turn);
    candidates.as_offered(turns)
}

/// Assigns turns to all offered points except those that the cell above took, which have a turn in
/// `taken`. `above` is the spacing of the sample above. `edge` is as in [`choose`].
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
