//! Which points represent a cell: as many as a node holds, evenly, from the points that its children
//! offer (kanzok2015, section 3.1, figure 1, bottom-up). The deepest level of the n-tree that has no more
//! cells than the node has room gives a point each; the room that is left goes to the next level's cells,
//! evenly along their order.

use crate::ntree::NTree;

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
    let occupied = tree.occupied();
    if n <= capacity {
        return Sample { chosen: vec![true; n], spacing: tree.spacing(&occupied, n) };
    }
    let level = occupied.iter().rposition(|&cells| cells <= capacity).unwrap_or(0) as u32;
    let mut chosen = vec![false; n];
    let mut count = 0;
    for run in tree.runs(0..n, level) {
        if let Some(i) = tree.representative(run, level, |_| true) {
            chosen[i] = true;
            count += 1;
        }
    }
    let room = capacity - count;
    let open: Vec<usize> = if level < tree.depth() {
        tree.runs(0..n, level + 1)
            .filter(|run| !chosen[run.clone()].contains(&true))
            .filter_map(|run| tree.representative(run, level + 1, |_| true))
            .collect()
    } else {
        // Positions that the n-tree cannot tell apart: any of them is as good.
        (0..n).filter(|&i| !chosen[i]).collect()
    };
    for j in 0..room.min(open.len()) {
        chosen[open[(2 * j + 1) * open.len() / (2 * room.min(open.len()))]] = true;
    }
    Sample { chosen, spacing: tree.spacing(&occupied, capacity) }
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
