//! Which points represent a cell: as many as a node holds, evenly, from the points that its children
//! offer (kanzok2015, section 3.1, figure 1, bottom-up). They are thinned from a large radius down until the
//! node is full.
//!
//! When a point was picked is its *turn*, and stays with it: the cell above looks at points in the order of
//! their turns, and so does the node when its own points are ordered, and both rather pick a point in its turn than
//! keep the whole radius. So the samples of all levels, and the prefixes of each node, are beginnings of nearly one
//! sequence, and the gaps of a prefix are those that it leaves among all points of the cell, not those in the
//! sample on top of the sample's own.

use crate::ntree::NTree;
use crate::thin::{Part, Step, Thinning};
use crate::turn::{LAST_TURN, turn_at};

/// Down to this radius, in units of the spacing that the node's points would have on a grid, a part of the points
/// is enough to thin among, which saves time: a sample so thinned has one point in twelve.
const COARSE_RADIUS: f64 = 4.0;
/// And no longer than until this part of the room is taken, as it can be earlier where densities differ.
const COARSE_SHARE: usize = 8;
/// One in so many of the points that no sample has placed, beside those placed at the spacing or above it.
const COARSE_EVERY: usize = 4;

/// The chosen points of a node.
pub struct Sample {
    /// For each entry of the n-tree, its turn where it was chosen.
    pub chosen: Vec<Option<u16>>,
    /// Typical distance of the chosen points, in the file's unit.
    pub spacing: f64,
}

/// Chooses `capacity` points, or all where there are fewer.
pub fn choose(tree: &NTree, capacity: usize) -> Sample {
    let n = tree.entries.len();
    let spacing = tree.spacing(&tree.occupied(), n.min(capacity));
    if n <= capacity {
        return Sample { chosen: tree.entries.iter().map(|e| Some(e.turn)).collect(), spacing };
    }
    Sample { chosen: fill(tree, capacity, spacing), spacing }
}

/// Thins until `capacity` are chosen: from the whole cell's radius down among a part of the points, then among all.
fn fill(tree: &NTree, capacity: usize, spacing: f64) -> Vec<Option<u16>> {
    let mut chosen = vec![None; tree.entries.len()];
    let mut room = capacity;
    let placed = turn_at(spacing);
    let is_coarse = |i: usize| match tree.entries[i].turn {
        LAST_TURN => i.is_multiple_of(COARSE_EVERY),
        turn => turn <= placed,
    };
    let part = |i| if is_coarse(i) { Part::Candidate } else { Part::Absent };
    let mut turn = turn_at(tree.cell_edge(0));
    let coarse_turns = turn_at(spacing * COARSE_RADIUS);
    for step in Thinning::new(tree, part, turn).take_while(|s| s.turn < coarse_turns) {
        take(&step, &mut chosen, &mut room);
        turn = step.turn + 1;
        if (capacity - room) * COARSE_SHARE >= capacity {
            break;
        }
    }
    let part = |i: usize| if chosen[i].is_some() { Part::Picked } else { Part::Candidate };
    let mut thinning = Thinning::new(tree, part, turn);
    while room > 0 {
        // At the end are positions that the n-tree cannot tell apart: any of them is as good.
        let left = |t: &Thinning<'_>| Step { turn: t.turn(), entries: t.left() };
        let step = thinning.next().unwrap_or_else(|| left(&thinning));
        take(&step, &mut chosen, &mut room);
    }
    chosen
}

/// Takes what is picked at a turn, or as much of it as there is room for.
fn take(step: &Step, chosen: &mut [Option<u16>], room: &mut usize) {
    let (new, take) = (&step.entries, step.entries.len().min(*room));
    for j in 0..take {
        chosen[new[(2 * j + 1) * new.len() / (2 * take)] as usize] = Some(step.turn);
    }
    *room -= take;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::{rows_of, tree_of};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exactly_as_many_as_asked_are_chosen(points in prop::collection::vec([0u32..5000, 0u32..5000, 0u32..40], 1..600), capacity in 1usize..300) {
            let bytes = rows_of(&points);
            let tree = tree_of(&points, &bytes, [0.01; 3]);
            let sample = choose(&tree, capacity);
            prop_assert_eq!(sample.chosen.iter().flatten().count(), capacity.min(points.len()));
        }
    }

    #[test]
    fn coincident_points_fill_the_room() {
        let points = vec![[9; 3]; 100];
        let bytes = rows_of(&points);
        let sample = choose(&tree_of(&points, &bytes, [1.0; 3]), 64);
        assert_eq!(sample.chosen.iter().flatten().count(), 64);
    }
}
