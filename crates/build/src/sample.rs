//! Which points represent a cell: as many as a node holds, evenly, from the points that its children
//! offer (kanzok2015, section 3.1, figure 1, bottom-up). They are thinned at a radius that leaves a few
//! less than the node has room for; the room that is left goes to the next steps' points, evenly.

use crate::ntree::NTree;
use crate::thin::Thinning;

/// Radius of a first step, in units of the spacing that the node's points would have on a grid: maximal
/// Poisson-disk samples have about 0.7 points a squared radius, so this leaves room for 30 %.
const FIRST_RADIUS: f64 = 1.0;

/// The chosen points of a node.
pub struct Sample {
    /// For each entry of the n-tree, whether it was chosen.
    pub chosen: Vec<bool>,
    /// Typical distance of the chosen points, in the file's unit.
    pub spacing: f64,
}

/// Chooses `capacity` points, or all where there are fewer.
pub fn choose(tree: &NTree, capacity: usize) -> Sample {
    let n = tree.entries.len();
    let spacing = tree.spacing(&tree.occupied(), n.min(capacity));
    if n <= capacity {
        return Sample { chosen: vec![true; n], spacing };
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

/// Thins from a radius down until `capacity` are chosen; `None` where the first step gives more.
fn fill(tree: &NTree, capacity: usize, radius: f64) -> Option<Vec<bool>> {
    let mut chosen = vec![false; tree.entries.len()];
    let mut room = capacity;
    let mut thinning = Thinning::new(tree, |_| false, radius);
    let mut first = true;
    while room > 0 {
        let indistinct = thinning.radius() <= 1.0;
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
            chosen[new[(2 * j + 1) * new.len() / (2 * take)] as usize] = true;
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
            prop_assert_eq!(sample.chosen.iter().filter(|&&c| c).count(), capacity.min(points.len()));
        }
    }

    #[test]
    fn coincident_points_fill_the_room() {
        let points = vec![[9; 3]; 100];
        let bytes = rows_of(&points);
        let sample = choose(&tree_of(&points, &bytes, [1.0; 3]), 64);
        assert_eq!(sample.chosen.iter().filter(|&&c| c).count(), 64);
    }
}
