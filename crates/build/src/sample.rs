//! Which points represent a cell: as many as a node holds, evenly, from the points that its children
//! offer (kanzok2015, section 3.1, figure 1, bottom-up). They are thinned from a large radius down until the
//! node is full.
//!
//! When a point was picked is its *turn*, and stays with it: the cell above looks at points in the order of
//! their turns, and so does the node when its own points are ordered. So the samples of all levels, and the
//! prefixes of each node, are beginnings of nearly one sequence, and the gaps of a prefix are those that it
//! leaves among all points of the cell, not those in the sample on top of the sample's own.

use crate::ntree::NTree;
use crate::thin::Thinning;

/// Radius of a first step, in units of the spacing that the node's points would have on a grid: a sample so
/// thinned has one point in twelve, and what is coarser hardly shows the difference.
const FIRST_RADIUS: f64 = 4.0;
/// Steps in which the radius halves.
const STEPS_PER_LEVEL: u32 = 16;

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
    let mut radius = tree.steps(spacing * FIRST_RADIUS) as f64;
    loop {
        if let Some(chosen) = fill(tree, capacity, radius) {
            return Sample { chosen, spacing };
        }
        // The estimate was off, as it can be where densities differ: fewer, then.
        radius *= 1.5;
    }
}

/// The turn of points picked at a radius in the file's unit: the larger the radius, the earlier, the same for
/// all cells of a file; sixteen to an octave.
fn turn_at(radius: f64) -> u16 {
    let octaves = 2000.0 - radius.max(f64::MIN_POSITIVE).log2();
    (octaves * 16.0).clamp(0.0, f64::from(crate::ntree::LAST_TURN - 1)) as u16
}

/// Thins from a radius down until `capacity` are chosen; `None` where the first step gives more.
fn fill(tree: &NTree, capacity: usize, radius: f64) -> Option<Vec<Option<u16>>> {
    let mut chosen = vec![None; tree.entries.len()];
    let mut room = capacity;
    let mut thinning = Thinning::new(tree, |_| false, radius, STEPS_PER_LEVEL);
    let mut first = true;
    while room > 0 {
        let indistinct = thinning.radius() <= 1.0;
        let turn = turn_at(tree.length(thinning.radius()));
        let mut new = thinning.step();
        if first && new.len() > capacity && !indistinct {
            return None;
        }
        first = false;
        if new.is_empty() && indistinct {
            // Positions that the n-tree cannot tell apart: any of them is as good.
            new = thinning.left();
        }
        let take = room.min(new.len());
        for j in 0..take {
            chosen[new[(2 * j + 1) * new.len() / (2 * take)] as usize] = Some(turn);
        }
        room -= take;
    }
    Some(chosen)
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
