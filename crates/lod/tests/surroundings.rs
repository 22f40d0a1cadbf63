//! Properties of the surroundings of a picture, for any tree, view and options: they leave the
//! picture as it is, are closed under parent and within their budgets, and close every gap that the
//! picture leaves around it.

mod tree;

use esker_lod::{
    AllResident, Occlusion, Options, OrientedBox, Residency, Selection, Surroundings, View,
    light_octree, select, surround,
};
use esker_points::NodeTable;
use glam::DVec3;
use proptest::prelude::*;
use std::collections::{HashMap, HashSet};
use tree::{Random, Recipe, Tree, grow, recipes};

/// A view from a position in or around the tree to a position in it.
fn view(tree: &Tree, seed: u64) -> View {
    let mut random = Random(seed);
    let (min, max) = tree.bounds();
    let mut pick = |reach: f64| {
        let t = DVec3::new(random.unit(), random.unit(), random.unit());
        min + (max - min) * ((t - DVec3::splat(0.5)) * reach + DVec3::splat(0.5))
    };
    let (eye, target) = (pick(2.5), pick(1.0));
    View::look_at(eye, target, DVec3::Z, 0.2 + random.unit(), 320, 200)
}

/// A cache with some of the nodes, of several sizes; or with all of them.
#[derive(Clone, Copy)]
struct Cache<'a> {
    seed: Option<u64>,
    tree: &'a Tree,
}

impl Residency for Cache<'_> {
    fn is_resident(&self, node: u32) -> bool {
        let is_there = |seed| Random(seed ^ u64::from(node)).below(3) > 0;
        self.tree.is_root(node) || self.seed.is_none_or(is_there)
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

impl Occlusion for Fog {
    fn hides(&self, b: &OrientedBox) -> bool {
        b.distance(self.eye) > self.distance
    }
}

/// What a picture and its surroundings are chosen from.
struct Case {
    tree: Tree,
    view: View,
    fog: Fog,
    options: Options,
    around: Surroundings,
}

impl Case {
    fn new(recipe: &Recipe, seed: u64, options: Options, around: Surroundings) -> Self {
        let tree = grow(recipe);
        let view = view(&tree, seed);
        let (min, max) = tree.bounds();
        let distance = (max - min).length() * Random(seed).unit();
        let fog = Fog { eye: view.eye, distance };
        Self { tree, view, fog, options, around }
    }

    fn picture(&self, residency: &impl Residency) -> Selection {
        let Self { tree, view, fog, options, .. } = self;
        select(&tree.table, &tree.lattice, view, options, residency, Some(fog))
    }

    fn whole(&self, residency: &impl Residency) -> Selection {
        let Self { tree, view, options, around, .. } = self;
        let mut whole = self.picture(residency);
        surround(&tree.table, &tree.lattice, view, options, around, residency, &mut whole);
        whole
    }

    fn node(&self, node: u32) -> &esker_points::Node {
        &self.tree.table.nodes[node as usize]
    }

    fn parent(&self, node: u32) -> Option<u32> {
        (!self.tree.is_root(node)).then(|| self.node(node).parent)
    }

    /// Distance of the eye to the nearest point of a node and of all below it.
    fn distance(&self, node: u32) -> f64 {
        let own = self.tree.points[node as usize].iter();
        let own = own.map(|&p| self.tree.world(p).distance(self.view.eye));
        let below = (node + 1..self.tree.table.nodes.len() as u32)
            .filter(|&child| self.parent(child) == Some(node))
            .map(|child| self.distance(child));
        own.chain(below).fold(f64::INFINITY, f64::min)
    }

    /// Median distance of the wanted points of the picture, by listing all of them.
    fn median_distance(&self, s: &Selection) -> f64 {
        let wanted = s.wanted[..s.wanted_in_picture].iter().zip(&s.prefixes);
        let mut distances: Vec<f64> = wanted
            .flat_map(|(&node, &prefix)| {
                let contour = OrientedBox::of_contour(self.node(node), &self.tree.lattice);
                std::iter::repeat_n(contour.distance(self.view.eye), prefix)
            })
            .collect();
        distances.sort_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied().unwrap_or(0.0).max(self.view.near)
    }
}

fn budgets() -> impl Strategy<Value = u64> {
    prop_oneof![0u64..2000, Just(u64::MAX)]
}

fn options(points_budget: u64, bytes_budget: u64, target_spacing_px: f64) -> Options {
    Options { points_budget, bytes_budget, target_spacing_px }
}

fn around(coarseness: f64, points_budget: u64, bytes_budget: u64) -> Surroundings {
    Surroundings { coarseness, points_budget, bytes_budget }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn surroundings_leave_the_picture_as_it_is(
        recipe in recipes(true), seed: u64, cache: Option<u64>, points in budgets(), bytes in budgets(),
        target in prop_oneof![Just(0.0), 0.1f64..20.0], more in budgets(), coarseness in 0.01f64..20.0,
    ) {
        let case = Case::new(&recipe, seed, options(points, bytes, target), around(coarseness, more, u64::MAX));
        let residency = Cache { seed: cache, tree: &case.tree };
        let (alone, both) = (case.picture(&residency), case.whole(&residency));
        prop_assert_eq!(alone.wanted_in_picture, alone.wanted.len());
        prop_assert_eq!(both.wanted_in_picture, alone.wanted.len());
        prop_assert!(both.wanted.starts_with(&alone.wanted));
        prop_assert!(both.prefixes.starts_with(&alone.prefixes));
        prop_assert!(both.missing.starts_with(&alone.missing));
        prop_assert_eq!(&both.drawn, &alone.drawn);
        prop_assert_eq!(&both.hidden, &alone.hidden);
        let of_picture = |s: &Selection| esker_lod::Counters {
            bytes_wanted: 0, surroundings: 0, surroundings_points: 0, surroundings_withheld: 0, ..s.counters
        };
        prop_assert_eq!(of_picture(&both), of_picture(&alone));
        prop_assert_eq!(&both, &case.whole(&residency), "the same again");
    }

    #[test]
    fn they_are_whole_nodes_closed_under_parent_and_within_budgets(
        recipe in recipes(true), seed: u64, cache: Option<u64>, points in budgets(),
        bytes in prop_oneof![0u64..200, Just(u64::MAX)], own_bytes in prop_oneof![0u64..200, Just(u64::MAX)],
        more in budgets(), coarseness in 0.01f64..20.0,
    ) {
        let case = Case::new(&recipe, seed, options(points, bytes, 0.5), around(coarseness, more, own_bytes));
        let residency = Cache { seed: cache, tree: &case.tree };
        let s = case.whole(&residency);
        prop_assert_eq!(s.wanted.len(), s.prefixes.len());
        let (mut wanted, mut missing) = (HashSet::new(), Vec::new());
        for &node in &s.wanted {
            prop_assert!(case.parent(node).is_none_or(|parent| wanted.contains(&parent)));
            prop_assert!(wanted.insert(node), "{} is wanted twice", node);
            missing.extend(Some(node).filter(|&n| !residency.is_resident(n)));
        }
        prop_assert_eq!(s.missing.iter().map(|m| m.node).collect::<Vec<_>>(), missing);
        let in_picture: HashMap<u32, usize> = s.drawn.iter().map(|d| (d.node, d.prefix)).collect();
        let mut taken = HashSet::new();
        for d in &s.surroundings {
            prop_assert!(!in_picture.contains_key(&d.node) && taken.insert(d.node), "drawn once");
            prop_assert_eq!(d.prefix, case.node(d.node).points());
            let mut next = Some(d.node);
            while let Some(node) = next {
                prop_assert!(wanted.contains(&node) && residency.is_resident(node));
                next = case.parent(node);
            }
            if let Some(parent) = case.parent(d.node) {
                let is_whole = in_picture.get(&parent) == Some(&case.node(parent).points());
                prop_assert!(is_whole || taken.contains(&parent), "{} is below nothing", d.node);
            }
        }
        let own = s.wanted_in_picture..;
        let bytes_of = |nodes: &[u32]| nodes.iter().map(|&n| residency.slot_bytes(n)).sum::<u64>();
        prop_assert!(bytes_of(&s.wanted[own.clone()]) <= own_bytes);
        prop_assert!(s.counters.bytes_wanted <= bytes && s.counters.bytes_wanted == bytes_of(&s.wanted));
        prop_assert!(s.prefixes[own].iter().sum::<usize>() as u64 <= more);
        let drawn_points = s.surroundings.iter().map(|d| d.prefix as u64).sum::<u64>();
        prop_assert!(drawn_points <= more);
        prop_assert_eq!(s.counters.surroundings_points, drawn_points);
        prop_assert_eq!(s.counters.surroundings, s.surroundings.len() as u64);
        if more == 0 {
            prop_assert!(s.surroundings.is_empty());
        }
    }

    #[test]
    fn what_they_want_does_not_depend_on_what_is_resident(
        recipe in recipes(true), seed: u64, cache: u64, points in budgets(), more in budgets(),
        coarseness in 0.01f64..20.0,
    ) {
        let case = Case::new(&recipe, seed, options(points, u64::MAX, 0.5), around(coarseness, more, u64::MAX));
        let some = case.whole(&Cache { seed: Some(cache), tree: &case.tree });
        let all = case.whole(&Cache { seed: None, tree: &case.tree });
        prop_assert_eq!(&some.wanted, &all.wanted);
        prop_assert_eq!(&some.prefixes, &all.prefixes);
        prop_assert!(some.surroundings.iter().all(|d| all.surroundings.contains(d)));
    }

    #[test]
    fn nothing_is_left_out_but_what_is_fine_enough(
        recipe in recipes(true), seed: u64, target in 0.1f64..20.0, coarseness in 0.01f64..20.0,
    ) {
        let case = Case::new(&recipe, seed, options(u64::MAX, u64::MAX, target), around(coarseness, u64::MAX, u64::MAX));
        let s = case.whole(&AllResident);
        let nearest = case.median_distance(&s);
        let taken: HashMap<u32, usize> =
            s.drawn.iter().chain(&s.surroundings).map(|d| (d.node, d.prefix)).collect();
        for node in 0..case.tree.table.nodes.len() as u32 {
            let record = case.node(node);
            let repeats = record.is_continuation() && record.cell_log2 == 0;
            let Some(parent) = case.parent(node).filter(|_| !repeats) else {
                prop_assert!(repeats || taken.contains_key(&node), "a root is left out");
                continue;
            };
            let is_whole = taken.get(&parent) == Some(&case.node(parent).points());
            let cell = OrientedBox::of_cell(&record.cell(), &case.tree.lattice);
            // The cell holds all points of the node and below it, but may be far larger.
            let [near, far] = [cell.distance(case.view.eye), case.distance(node)];
            let mut above = f64::INFINITY;
            let mut next = Some(parent);
            while let Some(ancestor) = next {
                above = above.min(f64::from(case.node(ancestor).spacing));
                next = case.parent(ancestor);
            }
            let [most_px, px] = [near, far].map(|d| above * case.view.focal_px() / d.max(nearest));
            let is_fine = px <= target * coarseness * (1.0 + 1e-9);
            let is_taken = taken.contains_key(&node);
            prop_assert!(is_taken || !is_whole || is_fine, "{} px at {}", px, node);
            let is_around = s.surroundings.iter().any(|d| d.node == node);
            prop_assert!(!is_around || most_px > target * coarseness * (1.0 - 1e-9));
        }
    }

    #[test]
    fn a_smaller_target_or_a_larger_budget_never_takes_less(
        recipe in recipes(true), seed: u64, coarseness in 0.01f64..20.0, finer in 0.1f64..1.0, points in 0u64..2000,
    ) {
        let points_of = |coarseness, points| {
            let case = Case::new(&recipe, seed, options(u64::MAX, u64::MAX, 0.5), around(coarseness, points, u64::MAX));
            case.whole(&AllResident).counters.surroundings_points
        };
        let all = points_of(coarseness, u64::MAX);
        prop_assert!(points_of(coarseness * finer, u64::MAX) >= all);
        prop_assert!(points_of(coarseness, points) <= all);
        prop_assert_eq!(points_of(coarseness, all), all);
    }

    #[test]
    fn radii_for_light_are_between_those_of_the_finest_and_of_the_own_node(
        recipe in recipes(true), seed: u64, coarseness in 0.01f64..20.0,
    ) {
        let recipe = Recipe { trees: 1, ..recipe };
        let case = Case::new(&recipe, seed, options(u64::MAX, u64::MAX, 2.0), around(coarseness, u64::MAX, u64::MAX));
        let s = case.whole(&AllResident);
        let octree = light_octree(&case.tree.table, &s);
        let taken: Vec<_> = s.drawn.iter().chain(&s.surroundings).collect();
        prop_assert!(octree.len() >= taken.len());
        for (entry, d) in taken.iter().enumerate() {
            let own = case.node(d.node).spacing * (case.node(d.node).points() as f32 / d.prefix as f32);
            for &p in case.tree.points[d.node as usize].iter().step_by(7) {
                let holds = taken.iter().filter(|d| case.node(d.node).cell().contains(p));
                let finest = holds.map(|d| d.effective_spacing).fold(f32::INFINITY, f32::min);
                let at = octree.spacing_from(entry, p);
                prop_assert!(at >= finest * 0.9999 && at <= own * 1.0001, "{} in {} to {}", at, finest, own);
            }
        }
    }
}

#[test]
fn the_ground_behind_the_eye_lights_the_scene() {
    let recipe = Recipe { seed: 4, points: 1400, capacity: 30, tight: true, trees: 2 };
    let tree = grow(&recipe);
    let (min, max) = tree.bounds();
    let eye = max + (max - min) * 0.2;
    let away = View::look_at(eye, eye + (max - min), DVec3::Z, 0.6, 320, 200);
    let (table, options) = (&tree.table, Options::default());
    let alone = select(table, &tree.lattice, &away, &options, &AllResident, None);
    assert!(alone.drawn.is_empty());
    // Everything but the points that coincide with others.
    let all = (0..table.nodes.len() as u32).filter(|&n| {
        let node = &table.nodes[n as usize];
        !(node.is_continuation() && node.cell_log2 == 0)
    });
    let finest = around(1e-9, u64::MAX, u64::MAX);
    let mut both = alone;
    surround(table, &tree.lattice, &away, &options, &finest, &AllResident, &mut both);
    assert!(both.drawn.is_empty());
    let taken: HashSet<u32> = both.surroundings.iter().map(|d| d.node).collect();
    assert_eq!(taken, all.collect());
}

#[test]
fn what_is_hidden_lights_the_scene() {
    let recipe = Recipe { seed: 9, points: 1400, capacity: 30, tight: true, trees: 1 };
    let none = around(1e-9, u64::MAX, u64::MAX);
    let mut case = Case::new(&recipe, 5, options(u64::MAX, u64::MAX, 1.0), none);
    case.fog.distance = 0.0;
    let s = case.whole(&AllResident);
    let seen: usize = s.drawn.iter().map(|d| d.prefix).sum();
    let hidden: usize = s.surroundings.iter().map(|d| d.prefix).sum();
    assert!(hidden > seen, "{hidden} hidden points light {seen}");
}

#[test]
fn light_sees_how_sparse_a_floor_is_that_the_eye_sees_edge_on() {
    let recipe = Recipe { seed: 5, points: 1000, capacity: 1000, tight: false, trees: 1 };
    let mut tree = grow(&recipe);
    let node = &mut tree.table.nodes[0];
    node.shape = 2;
    node.contour_half[2] = 0.001;
    let (half, spacing) = (f64::from(node.contour_half[0]), node.spacing);
    let centre = OrientedBox::of_contour(node, &tree.lattice).centre;
    let view = View::look_at(centre - DVec3::X * half * 12.0, centre, DVec3::Z, 0.5, 512, 512);
    let spacing_px = view.focal_px() * f64::from(spacing) / (half * 12.0);
    let options = options(u64::MAX, u64::MAX, spacing_px * 2f64.sqrt());
    let s = select(&tree.table, &tree.lattice, &view, &options, &AllResident, None);
    let light = light_octree(&tree.table, &s).leaf_spacing(0).expect("it is a leaf");
    let left = (1000.0 / s.drawn[0].prefix as f32).sqrt();
    assert!(left > 1.5, "the picture leaves points out");
    assert!(s.drawn[0].effective_spacing < spacing * left * 0.9);
    assert!((light / (spacing * left) - 1.0).abs() < 1e-5);
}

#[test]
fn nothing_surrounds_an_empty_table() {
    let tree = grow(&Recipe { seed: 1, points: 1, capacity: 1, tight: true, trees: 1 });
    let view = View::look_at(DVec3::ZERO, DVec3::X, DVec3::Z, 1.0, 8, 8);
    let (nothing, options) = (NodeTable::default(), Options::default());
    let mut s = Selection::default();
    let around = Surroundings::default();
    surround(&nothing, &tree.lattice, &view, &options, &around, &AllResident, &mut s);
    assert_eq!(s, Selection::default());
    assert!(light_octree(&nothing, &s).is_empty());
}
