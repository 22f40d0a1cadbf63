//! Properties of every cut, for any tree, view and options.

mod tree;

use esker_lod::{
    AllResident, CompactOctree, Drawn, Occlusion, Options, OrientedBox, Projection, Residency,
    Selection, View, select,
};
use esker_points::strata::prefix_at_least;
use glam::DVec3;
use proptest::prelude::*;
use tree::{Random, Recipe, Tree, grow, recipes};

/// A view from a position in or around the tree to a position in it.
fn view(tree: &Tree, seed: u64) -> View {
    let mut random = Random(seed);
    let (min, max) = tree.bounds();
    let mut pick = |reach: f64| {
        let t = DVec3::new(random.unit(), random.unit(), random.unit());
        min + (max - min) * ((t - DVec3::splat(0.5)) * reach + DVec3::splat(0.5))
    };
    let (eye, target) = (pick(4.0), pick(1.0));
    View::look_at(eye, target, DVec3::Z, 0.3 + 1.5 * random.unit(), 320, 200)
}

fn options(points_budget: u64, target_spacing_px: f64) -> Options {
    Options { points_budget, target_spacing_px, ..Options::default() }
}

fn is_seen(tree: &Tree, view: &View, p: [u32; 3]) -> bool {
    view.project(tree.world(p)).is_some_and(|on| view.is_on_picture(on))
}

fn has_seen_point(tree: &Tree, view: &View, node: u32) -> bool {
    tree.points[node as usize].iter().any(|&p| is_seen(tree, view, p))
}

fn focal_over_distance(tree: &Tree, view: &View, p: [u32; 3]) -> f64 {
    view.focal_px() / tree.world(p).distance(view.eye).max(view.near)
}

/// A cache with some of the nodes, of several sizes.
#[derive(Clone, Copy)]
struct Cache<'a> {
    seed: u64,
    tree: &'a Tree,
}

impl Residency for Cache<'_> {
    fn is_resident(&self, node: u32) -> bool {
        self.tree.is_root(node) || Random(self.seed ^ u64::from(node)).below(3) > 0
    }
    fn slot_bytes(&self, node: u32) -> u64 {
        1 + u64::from(node % 7)
    }
}

/// Hides everything farther from the eye than a distance.
struct Fog {
    eye: DVec3,
    distance: f64,
}

impl Fog {
    fn shows(&self, p: DVec3) -> bool {
        p.distance(self.eye) < self.distance
    }
}

impl Occlusion for Fog {
    fn hides(&self, b: &OrientedBox) -> bool {
        b.distance(self.eye) > self.distance
    }
}

/// The sizes of a cache, with all nodes resident.
struct Loaded<'a>(Cache<'a>);

impl Residency for Loaded<'_> {
    fn is_resident(&self, _: u32) -> bool {
        true
    }
    fn slot_bytes(&self, node: u32) -> u64 {
        self.0.slot_bytes(node)
    }
}

const NO_FOG: Fog = Fog { eye: DVec3::ZERO, distance: f64::INFINITY };

/// Asserts the invariants of a cut.
fn assert_is_a_cut(
    tree: &Tree,
    view: &View,
    fog: &Fog,
    options: &Options,
    residency: &impl Residency,
    s: &Selection,
) {
    let nodes = &tree.table.nodes;
    let c = s.counters;
    assert_eq!(c.drawn, s.drawn.len() as u64);
    assert_eq!(c.points, s.drawn.iter().map(|d| d.prefix as u64).sum::<u64>());
    assert_eq!(c.bytes_wanted, s.wanted.iter().map(|&n| residency.slot_bytes(n)).sum::<u64>());
    assert_eq!(
        c.visited,
        c.culled
            + c.occluded
            + c.contour_culled
            + c.contour_occluded
            + c.continuations
            + c.withheld
            + c.missing
            + c.drawn
    );
    assert!(c.points <= c.points_wanted && c.points_wanted <= options.points_budget);
    assert!(c.bytes_wanted <= options.bytes_budget);
    assert_wanted_is_closed(tree, residency, s);
    assert!(s.hidden.len() as u64 <= c.contour_occluded + c.contour_culled);
    assert!(s.hidden.iter().all(|h| h.prefix == 0));
    let mut drawn = vec![None; nodes.len()];
    for d in &s.drawn {
        let node = &nodes[d.node as usize];
        assert!(d.prefix > 0);
        assert_eq!(prefix_at_least(node.levels(), d.prefix), d.prefix, "whole strata");
        let mut above = node.parent;
        while let Some(parent) = nodes.get(above as usize) {
            match drawn[above as usize] {
                Some((prefix, spacing)) => {
                    assert_eq!(prefix, parent.points(), "the parent is drawn whole");
                    assert!(d.effective_spacing <= spacing);
                    break;
                }
                None => {
                    let seen = tree.points[above as usize]
                        .iter()
                        .any(|&p| is_seen(tree, view, p) && fog.shows(tree.world(p)));
                    assert!(!seen, "the parent is in view");
                }
            }
            above = parent.parent;
        }
        let twice = drawn[d.node as usize].replace((d.prefix, d.effective_spacing));
        assert_eq!(twice, None, "a node is drawn once");
    }
}

/// Asserts that parents are wanted before their children, and that wanted nodes are drawn, missing,
/// or ancestors of those.
fn assert_wanted_is_closed(tree: &Tree, residency: &impl Residency, s: &Selection) {
    let mut wanted = vec![false; tree.table.nodes.len()];
    for &n in &s.wanted {
        let parent = tree.table.nodes[n as usize].parent as usize;
        assert!(tree.is_root(n) || wanted[parent], "the parent of {n} is wanted before it");
        assert!(!std::mem::replace(&mut wanted[n as usize], true), "a node is wanted once");
    }
    let missing: Vec<_> = s.missing.iter().map(|m| m.node).collect();
    let absent: Vec<_> = s.wanted.iter().copied().filter(|&n| !residency.is_resident(n)).collect();
    assert_eq!(missing, absent);
    for d in &s.drawn {
        let mut n = d.node;
        while let Some(node) = tree.table.nodes.get(n as usize) {
            assert!(wanted[n as usize] && residency.is_resident(n), "drawn under {n}");
            n = node.parent;
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_cut_is_closed_within_budget_in_whole_strata_and_its_counters_add_up(
        recipe in recipes(true), seed: u64, budget in prop_oneof![0u64..2000, Just(u64::MAX)],
        target in prop_oneof![Just(0.0), 0.1f64..20.0],
    ) {
        let tree = grow(&recipe);
        let (view, options) = (view(&tree, seed), options(budget, target));
        let s = select(&tree.table, &tree.lattice, &view, &options, &AllResident, None);
        assert_is_a_cut(&tree, &view, &NO_FOG, &options, &AllResident, &s);
        prop_assert_eq!(s.counters.missing, 0);
        prop_assert!(s.missing.is_empty());
        let again = select(&tree.table, &tree.lattice, &view, &options, &AllResident, None);
        prop_assert_eq!(s, again);
    }

    #[test]
    fn what_is_wanted_does_not_depend_on_what_is_resident(
        recipe in recipes(true), seed: u64, cache: u64, points in prop_oneof![0u64..2000, Just(u64::MAX)],
        bytes in prop_oneof![0u64..100, Just(u64::MAX)],
    ) {
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let options = Options { bytes_budget: bytes, ..options(points, 0.5) };
        let cache = Cache { seed: cache, tree: &tree };
        let s = select(&tree.table, &tree.lattice, &view, &options, &cache, None);
        assert_is_a_cut(&tree, &view, &NO_FOG, &options, &cache, &s);
        let roots = tree.table.roots().count();
        prop_assert_eq!(s.wanted.is_empty(), bytes == 0);
        prop_assert!(s.wanted.iter().take(roots).all(|&n| bytes < 100 || tree.is_root(n)), "roots are first");
        let full = select(&tree.table, &tree.lattice, &view, &options, &Loaded(cache), None);
        assert_is_a_cut(&tree, &view, &NO_FOG, &options, &Loaded(cache), &full);
        prop_assert_eq!(&s.wanted, &full.wanted);
        prop_assert!(s.drawn.iter().all(|d| full.drawn.contains(d)));
        prop_assert_eq!(s.counters.points_wanted, full.counters.points);
    }

    #[test]
    fn hidden_points_are_left_out_and_no_others(recipe in recipes(true), seed: u64, share in 0.0f64..1.0) {
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let (min, max) = tree.bounds();
        let distance = view.eye.distance(min.midpoint(max)) + (share - 0.5) * (max - min).length();
        let fog = Fog { eye: view.eye, distance };
        let (cache, options) = (Cache { seed, tree: &tree }, options(u64::MAX, 0.0));
        for resident in [true, false] {
            let s = if resident {
                select(&tree.table, &tree.lattice, &view, &options, &AllResident, Some(&fog))
            } else {
                select(&tree.table, &tree.lattice, &view, &options, &cache, Some(&fog))
            };
            if resident {
                assert_is_a_cut(&tree, &view, &fog, &options, &AllResident, &s);
            } else {
                assert_is_a_cut(&tree, &view, &fog, &options, &cache, &s);
            }
            for (node, points) in tree.points.iter().enumerate() {
                let is_wanted = s.wanted.contains(&(node as u32));
                for &p in points {
                    prop_assert!(is_wanted || !(is_seen(&tree, &view, p) && fog.shows(tree.world(p))));
                }
            }
        }
    }

    #[test]
    fn the_cut_covers_what_is_in_view_with_resident_nodes(recipe in recipes(true), seed: u64, cache: u64) {
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let s = select(&tree.table, &tree.lattice, &view, &options(u64::MAX, 0.5), &Cache { seed: cache, tree: &tree }, None);
        let full = select(&tree.table, &tree.lattice, &view, &options(u64::MAX, 0.5), &AllResident, None);
        // For each node that should be drawn, the nearest resident ancestor is drawn whole.
        for d in &full.drawn {
            let mut n = d.node;
            let serves = loop {
                if s.drawn.iter().any(|d| d.node == n) || !has_seen_point(&tree, &view, n) && tree.is_root(n) {
                    break true;
                }
                let parent = tree.table.nodes[n as usize].parent;
                if parent == u32::MAX {
                    break false;
                }
                n = parent;
            };
            prop_assert!(serves, "nothing is drawn for {}", d.node);
        }
    }

    #[test]
    fn a_target_of_zero_draws_every_point_in_view(recipe in recipes(true), seed: u64) {
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let s = select(&tree.table, &tree.lattice, &view, &options(u64::MAX, 0.0), &AllResident, None);
        let mut whole = vec![false; tree.points.len()];
        for d in &s.drawn {
            whole[d.node as usize] = d.prefix == tree.points[d.node as usize].len();
        }
        for (node, points) in tree.points.iter().enumerate() {
            for &p in points {
                prop_assert!(whole[node] || !is_seen(&tree, &view, p), "point {p:?} of node {node}");
            }
        }
    }

    #[test]
    fn every_place_in_view_is_drawn_as_densely_as_the_target(
        recipe in recipes(false), seed: u64, target in 0.1f64..20.0,
    ) {
        // Contours are cubes, which cover as much of the picture from every side.
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let s = select(&tree.table, &tree.lattice, &view, &options(u64::MAX, target), &AllResident, None);
        let octree = CompactOctree::new(&tree.table, &s.drawn);
        let projection = Projection::of(&view);
        for (node, points) in tree.points.iter().enumerate() {
            let node = node as u32;
            let record = &tree.table.nodes[node as usize];
            let repeats = record.is_continuation() && record.cell_log2 == 0;
            if repeats || s.drawn.iter().any(|d| d.node == node) {
                continue;
            }
            // The node was left out: the points drawn in its place are fine enough already, or
            // there is one for each square of the target spacing on its silhouette.
            let mut above = tree.table.nodes[node as usize].parent;
            let mut is_filled = false;
            while let Some(record) = tree.table.nodes.get(above as usize) {
                if let Some(d) = s.drawn.iter().find(|d| d.node == above) {
                    let contour = OrientedBox::of_contour(record, &tree.lattice);
                    let area = projection.silhouette(&contour).map_or(f64::INFINITY, |s| s.area_px());
                    is_filled = d.prefix as f64 >= area / (target * target) - 1e-3;
                    break;
                }
                above = record.parent;
            }
            for &p in points.iter().filter(|&&p| is_seen(&tree, &view, p)) {
                let px = f64::from(octree.spacing_at(p)) * focal_over_distance(&tree, &view, p);
                prop_assert!(is_filled || px <= target * 1.000_01, "{px} at {p:?} of {node}");
            }
        }
    }

    #[test]
    fn going_nearer_never_draws_less(recipe in recipes(false), seed: u64, target in 0.1f64..20.0, step in 0.0f64..1.0) {
        let tree = grow(&recipe);
        let (min, max) = tree.bounds();
        let mut random = Random(seed);
        let direction = DVec3::new(random.unit(), random.unit(), random.unit()) - DVec3::splat(0.5);
        // From the nearest position that shows everything, so that nothing leaves the picture.
        let near = View::fit(min, max, direction, 1.0, 300, 300);
        let size = (max - min).length() + 1.0;
        let mut far = near;
        far.eye -= near.forward() * size * 3.0 * step;
        let [near, far] = [near, far].map(|view| {
            select(&tree.table, &tree.lattice, &view, &options(u64::MAX, target), &AllResident, None).counters
        });
        prop_assert!(near.points >= far.points, "{near:?} {far:?}");
    }

    #[test]
    fn more_budget_never_draws_less(recipe in recipes(true), seed: u64, budget in 0u64..1500) {
        let tree = grow(&recipe);
        let view = view(&tree, seed);
        let points = |budget| {
            select(&tree.table, &tree.lattice, &view, &options(budget, 0.5), &AllResident, None).counters.points
        };
        let all = points(u64::MAX);
        prop_assert!(points(budget) <= all);
        prop_assert_eq!(points(all), all);
    }

    #[test]
    fn the_compact_octree_finds_the_finest_drawn_cell_of_a_point_s_own_tree(
        recipe in recipes(true), seed: u64,
    ) {
        // Any set of nodes, with gaps between them as contours out of view cause them. The last
        // node of a cell is the finest, which holds for the points of all nodes of the cell.
        let tree = grow(&recipe);
        let nodes = &tree.table.nodes;
        let mut random = Random(seed);
        let drawn: Vec<_> = (0..nodes.len() as u32)
            .filter(|_| random.below(2) == 0)
            .map(|node| Drawn { node, prefix: 1, effective_spacing: 1.0 + (nodes.len() as u32 - node) as f32 })
            .collect();
        let octree = CompactOctree::new(&tree.table, &drawn);
        prop_assert!(octree.len() >= drawn.len());
        let roots: Vec<u32> = tree.table.roots().collect();
        let tree_of = |node: u32| roots.partition_point(|&root| root <= node);
        let finest = |tree: usize, p: [u32; 3]| {
            let at = drawn.iter().filter(|d| tree_of(d.node) == tree && nodes[d.node as usize].cell().contains(p));
            let finest = at.min_by_key(|d| (nodes[d.node as usize].cell_log2, std::cmp::Reverse(d.node)));
            finest.map(|d| d.effective_spacing)
        };
        for &p in tree.points.iter().flatten().step_by(5) {
            let drawn = (1..=roots.len()).filter_map(|tree| finest(tree, p)).reduce(f32::min);
            prop_assert_eq!(octree.spacing_at(p), drawn.unwrap_or(0.0));
        }
        for (i, d) in drawn.iter().enumerate() {
            for &p in &tree.points[d.node as usize] {
                prop_assert_eq!(Some(octree.spacing_from(i, p)), finest(tree_of(d.node), p));
            }
        }
    }

    #[test]
    fn every_tree_in_view_gets_its_share_of_a_small_budget(seed: u64, trees in 2u64..4, share in 60u64..2000) {
        let recipe = Recipe { seed, points: 1500, capacity: 60, tight: true, trees };
        let tree = grow(&recipe);
        let (min, max) = tree.bounds();
        let view = View::fit(min, max, DVec3::new(1.0, 2.0, -1.5), 1.0, 300, 300);
        let options = options(share * trees, 0.5);
        let s = select(&tree.table, &tree.lattice, &view, &options, &AllResident, None);
        for root in tree.table.roots() {
            prop_assert!(s.drawn.iter().any(|d| d.node == root), "{root} is not drawn");
        }
    }
}

#[test]
fn a_flat_node_seen_edge_on_gets_fewer_points_than_face_on() {
    let recipe = Recipe { seed: 5, points: 1000, capacity: 1000, tight: false, trees: 1 };
    let mut tree = grow(&recipe);
    assert_eq!(tree.table.nodes.len(), 1);
    let node = &mut tree.table.nodes[0];
    node.shape = 2;
    node.contour_half[2] = 0.001;
    let half = f64::from(node.contour_half[0]);
    let centre = OrientedBox::of_contour(node, &tree.lattice).centre;
    // Wide enough that the target asks for half of the points face-on.
    let points = |direction: DVec3| {
        let view = View::look_at(centre - direction * half * 12.0, centre, DVec3::Y, 0.5, 512, 512);
        let spacing_px = view.focal_px() * f64::from(tree.table.nodes[0].spacing) / (half * 12.0);
        let options = options(u64::MAX, spacing_px * 2f64.sqrt());
        select(&tree.table, &tree.lattice, &view, &options, &AllResident, None).counters.points
    };
    let (face_on, edge_on) = (points(DVec3::Z), points(DVec3::X));
    assert!((450..700).contains(&face_on), "{face_on}");
    assert!(edge_on * 2 < face_on, "{edge_on} against {face_on}");
}

#[test]
fn an_empty_table_draws_nothing() {
    let tree = grow(&Recipe { seed: 1, points: 1, capacity: 1, tight: true, trees: 1 });
    let view = View::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, 1.0, 8, 8);
    let nothing = esker_points::NodeTable::default();
    let s = select(&nothing, &tree.lattice, &view, &Options::default(), &AllResident, None);
    assert_eq!(s, Selection::default());
    assert_eq!(CompactOctree::new(&nothing, &s.drawn).spacing_at([0; 3]), 0.0);
}
