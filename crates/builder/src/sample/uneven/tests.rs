//! Arrangements of generated clouds: trees of cells, radii of sparse and dense parts.

use super::*;
use crate::sample::candidates::tests::candidates_of;
use crate::sample::choose::assign_turns;
use crate::sample::effort::CLOUDS;
use crate::sample::spacing::radii;
use esker_points::morton;

const STEP: f64 = 0.01;

/// Arranges points; also returns them along the curve.
fn arranged(mut points: Vec<[u32; 3]>) -> (Vec<[u32; 3]>, Option<Arrangement>) {
    points.sort_unstable_by_key(|&p| morton::encode3(p));
    let candidates = candidates_of(&points, [STEP; 3]);
    let turns = assign_turns(&candidates, &[], None, f64::from(u32::MAX) * STEP, 2);
    let steps = radii(&candidates.shared_log2, 2);
    let radii: Vec<f32> = steps.iter().map(|steps| steps * candidates.step as f32).collect();
    let positions = points.clone();
    let (turns, radii) = (&turns[..], &radii[..]);
    let (taken, above) = (&[][..], f64::INFINITY);
    let leaf = Leaf {
        positions,
        turns,
        radii,
        scale: [STEP; 3],
        capacity: 4096,
        is_part: false,
        taken,
        above,
    };
    let arrangement = leaf.arrange();
    assert_eq!(arrangement.is_some(), leaf.is_uneven());
    (points, arrangement)
}

/// Points of a square, evenly spread.
fn square(count: usize, edge: u32, from: u32) -> impl Iterator<Item = [u32; 3]> {
    let at = move |i: usize, k: f64| ((i as f64 * k).fract() * f64::from(edge)) as u32 + from;
    (1..=count).map(move |i| [at(i, 0.754_877_666_2), at(i, 0.569_840_291), 7])
}

#[test]
fn even_points_are_not_arranged() {
    assert!(arranged(square(5000, 100_000, 0).collect()).1.is_none());
    // A lone outlier is a stray.
    let outlier = std::iter::once([1 << 30; 3]);
    assert!(arranged(square(5000, 100_000, 0).chain(outlier).collect()).1.is_none());
}

#[test]
fn each_point_is_in_one_node_of_a_tree_of_cells() {
    let mut uneven = 0;
    for (name, cloud) in CLOUDS {
        let (points, Some(Arrangement { nodes, radii, .. })) = arranged(cloud(9000)) else {
            continue;
        };
        uneven += 1;
        let mut homes = vec![0; points.len()];
        for node in &nodes {
            assert!(!node.points.is_empty(), "{name}: a node without points links nothing");
            assert!(node.points.is_sorted() && node.spacing > 0.0);
            for &i in &node.points {
                homes[i as usize] += 1;
                assert!(node.cell.contains(points[i as usize]), "{name}");
                let radius = f64::from(radii[i as usize]);
                assert!(radius.is_finite() && radius >= 0.0, "{name}: {radius}");
            }
            let Some(parent) = node.parent.map(|parent| &nodes[parent]) else { continue };
            assert!(parent.spacing >= node.spacing);
            assert!(parent.cell.contains_cell(&node.cell) && parent.cell.log2 > node.cell.log2);
            let octant = |&child: &usize| parent.cell.octant(nodes[child].cell.corner);
            assert!(parent.children.iter().map(octant).is_sorted_by(|a, b| a < b));
        }
        assert!(homes.iter().all(|&homes| homes == 1), "{name}");
    }
    assert!(uneven >= 3, "{uneven} clouds are uneven");
}

#[test]
fn random_points_of_a_dense_part_get_no_wide_radii() {
    let (_, cloud) = CLOUDS[3];
    let (points, arrangement) = arranged(cloud(20_000));
    let Arrangement { nodes, radii, .. } = arrangement.unwrap();
    let (corner, edge) = (1 << 29, 1u32 << 20);
    let apart = f64::from(edge) / 100.0;
    for (node, i) in nodes.iter().flat_map(|n| n.points.iter().map(move |&i| (n, i as usize))) {
        let p = points[i];
        let is_dense = p[..2].iter().all(|c| (corner..corner + edge).contains(c));
        if is_dense && !node.children.iter().any(|&c| nodes[c].cell.contains(p)) {
            let radius = f64::from(radii[i]) / STEP;
            assert!(radius < 5.0 * apart, "{p:?}: {radius}, {apart}");
        }
    }
}

#[test]
fn radii_are_those_of_each_part_alone() {
    let dense = square(20_000, 20_000, 1_000_000).map(|p| (p, 141.0));
    let is_outside = |p: &[u32; 3]| p[..2].iter().any(|c| c.abs_diff(1_010_000) > 10_000);
    let sparse = square(2000, 2_000_000, 0).filter(is_outside).map(|p| (p, 44_700.0));
    let apart: std::collections::HashMap<_, f64> = dense.chain(sparse).collect();
    let (points, arrangement) = arranged(apart.keys().copied().collect());
    let Arrangement { nodes, radii, .. } = arrangement.unwrap();
    for node in &nodes {
        for &i in &node.points {
            let p = points[i as usize];
            let is_refined = node.children.iter().any(|&c| nodes[c].cell.contains(p));
            let radius = f64::from(radii[i as usize]) / STEP;
            let (want, most) = (apart[&p], RELATIVE_MAX * node.spacing / STEP);
            let is_own = radius < 3.0 * want && radius > 0.4 * want;
            assert!(is_own || is_refined && radius <= most, "{p:?}: {radius}, {want}");
        }
    }
}
