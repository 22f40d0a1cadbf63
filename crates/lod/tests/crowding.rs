//! Crowding of views: in its range for any tree and view, whole from afar, none at the usual
//! target, and continuous.

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod tree;

use esker_lod::{View, crowding};
use glam::DVec3;
use proptest::prelude::*;
use tree::{Recipe, Tree, grow, recipes};

/// A view of the whole tree, from `reach` times its size.
fn view(tree: &Tree, reach: f64) -> View {
    let (min, max) = tree.bounds();
    let middle = (min + max) * 0.5;
    let size = (max - min).length();
    View::look_at(
        middle + DVec3::new(0.6, -0.7, 0.4) * (size * reach),
        middle,
        DVec3::Z,
        0.8,
        320,
        200,
    )
}

fn of(tree: &Tree, reach: f64, target_px: f64) -> f32 {
    crowding(
        &tree.table,
        tree.table.roots(),
        &tree.lattice,
        &view(tree, reach),
        target_px,
        &mut Vec::new(),
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn points_crowd_from_afar_if_the_target_lets_them(recipe in recipes(true)) {
        let tree = grow(&recipe);
        let (min, max) = tree.bounds();
        prop_assume!((max - min).length() > 0.0);
        // Farther away, the distance of all points on the picture vanishes.
        prop_assert_eq!(of(&tree, 1e7, 0.0), 1.0);
        prop_assert_eq!(of(&tree, 1e7, 0.5), 1.0);
        for reach in [0.1, 1.0, 30.0, 1e7] {
            // At the usual target none of the drawn points share pixels.
            prop_assert_eq!(of(&tree, reach, 1.0), 0.0);
            prop_assert!((0.0..=1.0).contains(&of(&tree, reach, 0.3)));
        }
    }
}

#[test]
fn crowding_changes_gradually_with_distance() {
    let recipe = Recipe { seed: 5, points: 1400, capacity: 20, tight: true, trees: 1 };
    let mut tree = grow(&recipe);
    tree.table.nodes.iter_mut().for_each(|node| node.spacing *= 100.0);
    let (mut last, mut greatest) = (of(&tree, 1.0, 0.0), 0.0f32);
    let (mut low, mut high) = (last, last);
    for step in 0..4000 {
        let now = of(&tree, 1.0 + 1.003f64.powi(step), 0.0);
        greatest = greatest.max((now - last).abs());
        (low, high, last) = (low.min(now), high.max(now), now);
    }
    assert!(low < 0.01 && high > 0.99, "{low} to {high}");
    assert!(greatest < 0.06, "a jump of {greatest} in a step of 0.3 % of the distance");
}
