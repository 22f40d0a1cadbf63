//! The order of a node's points: level by level, within a level in strata, within a stratum along the
//! Morton curve; and the covering radius of each. A level is what thinning picks in an octave of turns, while its
//! radius halves, so a prefix is an even sample; points of the cell that ancestors have taken count as there before.

use crate::ntree::NTree;
use crate::thin::{Part, Step, Thinning};
use crate::turn::{TURNS_PER_OCTAVE, turn_at};
use esker_points::node::LEVELS_MAX;
use esker_points::strata::{STRATA, residue, stratum_len};
use std::ops::Range;

/// The first levels, too small to be worth a prefix each, are one until they have so many points.
const FIRST_LEVEL_POINTS: usize = 32;
/// Points in a cell from which the local spacing is taken: enough that chance evens out.
const LOCAL_POINTS: usize = 8;

/// How far from the points that ancestors took thinning begins, in units of their spacing: beyond the
/// greatest gap of an even sample, also where what covers the rim of the cell lies beyond it.
const TAKEN_REACH: f64 = 1.5;

/// Few points with less than this share of the cell above are strays (a bird over a field): the density
/// around them is not theirs.
const STRAY_SHARE: usize = 16;

/// Entries of the n-tree in drawing order, and the points of each level.
pub struct Order {
    /// Indices into the n-tree's entries; taken points are not among them.
    pub entries: Vec<u32>,
    /// Points of each level, at most [`LEVELS_MAX`] levels.
    pub levels: Vec<usize>,
}

/// Orders all entries of `tree` but those `taken` by ancestors, whose sample has the spacing `above`.
pub fn order(tree: &NTree, taken: &[bool], above: Option<f64>) -> Order {
    let part = |i: usize| if taken[i] { Part::Picked } else { Part::Candidate };
    let mut thinning = Thinning::new(tree, part, first_turn(tree, taken, above));
    let mut steps: Vec<Step> = thinning.by_ref().collect();
    // What the n-tree cannot tell apart from what is picked.
    steps.push(Step { turn: thinning.turn(), entries: thinning.left() });
    arrange(tree, levels(steps))
}

/// The turn at which to begin: the points of the whole cell, or the gaps that the taken ones leave, are at most so
/// far apart.
fn first_turn(tree: &NTree, taken: &[bool], above: Option<f64>) -> u16 {
    let there = taken.iter().filter(|t| **t).count();
    if there == 0 {
        return turn_at(tree.cell_edge(0));
    }
    let share = taken.len() as f64 / there as f64;
    let own = tree.spacing(&tree.occupied(), taken.len());
    let spacing = own * share.powf(1.0 / f64::from(tree.dimension.max(1)));
    let reach = above.unwrap_or(0.0).max(spacing) * TAKEN_REACH;
    turn_at(reach.min(tree.cell_edge(0)))
}

/// Cuts steps into levels, one an octave; the first ones, and those beyond the last, are one.
fn levels(steps: Vec<Step>) -> Vec<Vec<u32>> {
    let mut levels: Vec<Vec<u32>> = Vec::new();
    let mut octave = None;
    for step in steps.into_iter().filter(|s| !s.entries.is_empty()) {
        let new = step.turn / TURNS_PER_OCTAVE;
        let same = octave == Some(new);
        octave = Some(new);
        let full = levels.len() == LEVELS_MAX;
        let small = levels.len() == 1 && levels[0].len() < FIRST_LEVEL_POINTS;
        match levels.last_mut() {
            Some(last) if same || full || small => last.extend(strided(step.entries)),
            _ => levels.push(strided(step.entries)),
        }
    }
    levels
}

/// Every 16th along the curve first, so that a part of a step is spread over all of it.
fn strided(step: Vec<u32>) -> Vec<u32> {
    (0..STRATA).flat_map(|s| step.iter().skip(residue(s)).step_by(STRATA)).copied().collect()
}

/// Cuts each level's sequence into strata, each along the Morton curve (rows are sorted that way).
fn arrange(tree: &NTree, levels: Vec<Vec<u32>>) -> Order {
    let mut out = Order { entries: Vec::new(), levels: levels.iter().map(Vec::len).collect() };
    for mut level in levels {
        let n = level.len();
        let mut rest = level.as_mut_slice();
        for s in 0..STRATA {
            let (stratum, after) = rest.split_at_mut(stratum_len(n, s));
            stratum.sort_unstable_by_key(|&i| tree.entries[i as usize].row);
            rest = after;
        }
        out.entries.extend(level);
    }
    out
}

/// The covering radius of each entry, in the file's unit: the local spacing, that is the edge of the square
/// that a point has for itself where the points around it stand evenly. "Around it" is the smallest cell with at
/// least [`LOCAL_POINTS`] points. The greatest gap of an even sample is 0.84 of it, so an even sample is
/// covered; the diagonal of the square made silhouettes swell without closing a hole that the renderer's own
/// margin does not close. Laser scans are surfaces also where their node is a volume, so the local dimension
/// is at most 2. Coincident points and strays get 0, which the node's spacing replaces.
pub fn radii(tree: &NTree) -> Vec<f32> {
    let mut out = vec![0.0; tree.entries.len()];
    if !out.is_empty() {
        let all = 0..out.len();
        spread(tree, all, 0, (0, 0.0), &mut out);
    }
    out
}

/// `above` is the cell above a run: its points and the radius that they would have.
fn spread(tree: &NTree, run: Range<usize>, level: u32, above: (usize, f32), out: &mut [f32]) {
    if run.len() < LOCAL_POINTS && level > 0 {
        let stray = run.len() * STRAY_SHARE < above.0;
        out[run].fill(if stray { 0.0 } else { above.1 });
        return;
    }
    let dimension = f64::from(tree.dimension.clamp(1, 2));
    let spacing = (tree.cell_edge(level) / (run.len() as f64).powf(1.0 / dimension)) as f32;
    if level == tree.depth() {
        out[run].fill(spacing);
        return;
    }
    let points = run.len();
    for part in tree.runs(run, level + 1) {
        spread(tree, part, level + 1, (points, spacing), out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ntree::tests::{rows_of, tree_of};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_free_point_comes_out_once_and_taken_ones_never(points in prop::collection::vec([0u32..3000, 0u32..3000, 0u32..3000], 1..500), taken_every in 2usize..9, flat: bool) {
            let points: Vec<_> = points.into_iter().map(|p| if flat { [p[0], p[1], 0] } else { p }).collect();
            let bytes = rows_of(&points);
            let tree = tree_of(&points, &bytes, [0.01; 3]);
            let taken: Vec<bool> = (0..points.len()).map(|i| i % taken_every == 0).collect();
            let order = order(&tree, &taken, Some(3.0));
            let mut seen = taken.clone();
            for &i in &order.entries {
                prop_assert!(!seen[i as usize]);
                seen[i as usize] = true;
            }
            prop_assert!(seen.iter().all(|&s| s));
            prop_assert!(order.levels.len() <= LEVELS_MAX);
            prop_assert_eq!(order.levels.iter().sum::<usize>(), order.entries.len());
            prop_assert!(order.levels.iter().all(|&l| l > 0));
        }
    }

    #[test]
    fn radii_of_an_even_plane_cover_it_without_swelling() {
        let points: Vec<_> = (0..64 * 64u32).map(|i| [i % 64 * 100, i / 64 * 100, 0]).collect();
        let bytes = rows_of(&points);
        let tree = tree_of(&points, &bytes, [0.01; 3]);
        for r in radii(&tree) {
            // Half the diagonal of a unit cell, 0.71, is needed to cover; cells at the rim are part empty.
            assert!((0.71..1.9).contains(&r), "{r}");
        }
    }

    #[test]
    fn coincident_points_have_one_level_and_no_radius() {
        let points = vec![[4; 3]; 50];
        let bytes = rows_of(&points);
        let tree = tree_of(&points, &bytes, [1.0; 3]);
        let order = order(&tree, &[false; 50], None);
        assert_eq!(order.entries.len(), 50);
        assert!(radii(&tree).iter().all(|&r| r == 0.0));
    }
}
