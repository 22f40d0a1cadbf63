//! Surroundings of the picture, for light: they are what the pure choice takes, come after the
//! picture, keep to their share of memory, and leave the picture as it is while they are switched
//! on and off. The stand-in for a GPU checks their slots in each frame.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod harness;

use esker_format::PlaneKind;
use esker_lod::{AllResident, Selection, Surroundings, View, select, surround};
use esker_points::node::NONE;
use esker_stream::{Cut, CutNode, Needs, Options};
use harness::{GpuOptions, Harness, Random, view};
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

fn needs() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() }
}

fn around() -> Surroundings {
    Surroundings { coarseness: 2.0, ..Surroundings::default() }
}

fn roomy() -> Options {
    Options { drawing_bytes: 64 << 20, page_bytes: 8 << 20, occlusion: false, ..Options::default() }
}

/// Memory for two thirds of the file: enough for pictures, and not for all that is around them.
fn tight() -> Options {
    Options { drawing_bytes: 2 << 20, page_bytes: 512 << 10, ..roomy() }
}

fn harness(options: Options) -> Harness {
    Harness::new(GpuOptions::default(), options, needs())
}

fn lit(options: Options) -> Harness {
    harness(Options { surroundings: Some(around()), ..options })
}

/// Draws frames until the cut has everything that was asked for.
fn settle(harness: &mut Harness, view: View) -> Arc<Cut> {
    harness.streamer.look(view);
    harness.until("settles", |cut, h| cut.view == view && cut.settled && h.streamer.has_taken_in());
    harness.streamer.cut()
}

/// What the pure choice draws if everything is resident.
fn pure(harness: &Harness, view: &View, options: &Options) -> Selection {
    let options = esker_lod::Options {
        points_budget: options.points_budget,
        bytes_budget: u64::MAX,
        target_spacing_px: options.target_spacing_px,
    };
    let (table, lattice) = (harness.forest.table(), harness.forest.lattice());
    let mut chosen = select(table, lattice, view, &options, &AllResident, None);
    surround(table, lattice, view, &options, &around(), &AllResident, &mut chosen);
    chosen
}

fn of_surroundings(cut: &Cut) -> &[CutNode] {
    &cut.surroundings.as_ref().unwrap().nodes
}

/// Bytes of the slots of the surroundings, roots apart.
fn bytes(harness: &Harness, cut: &Cut) -> u64 {
    let is_root = |n: &&CutNode| harness.forest.record(n.node).parent == NONE;
    let own = of_surroundings(cut).iter().filter(|n| !is_root(n));
    own.flat_map(|n| &n.planes).map(|(_, slot)| slot.bytes).sum()
}

#[test]
fn they_converge_to_the_pure_choice_around_an_unchanged_picture() {
    let (mut plain, mut lit) = (harness(roomy()), lit(roomy()));
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.5, 0.4, 2.0)] {
        let view = plain.view(x, y, height);
        let (alone, cut) = (plain.settle(view), settle(&mut lit, view));
        assert!(cut.complete && alone.surroundings.is_none());
        let of_picture = |n: &CutNode| (n.node, n.prefix, n.effective_spacing.to_bits());
        assert!(cut.nodes.iter().map(of_picture).eq(alone.nodes.iter().map(of_picture)));
        assert!(cut.octree.words().eq(alone.octree.words()), "the radii of the picture");
        let chosen = pure(&lit, &view, &roomy());
        let is: Vec<_> = of_surroundings(&cut).iter().map(|n| (n.node, n.prefix)).collect();
        let should: Vec<_> = chosen.surroundings.iter().map(|d| (d.node, d.prefix)).collect();
        assert_eq!(is, should);
        let light = &cut.surroundings.as_ref().unwrap().octree;
        assert!(light.len() >= cut.lit_nodes().count());
        for node in of_surroundings(&cut) {
            assert_eq!(node.prefix, lit.forest.record(node.node).points());
            assert!(
                node.slot(PlaneKind::Position).is_some() && node.slot(PlaneKind::Normal).is_some()
            );
            assert_eq!(node.slot(PlaneKind::Residual), None);
        }
    }
}

#[test]
fn ground_out_of_view_is_there_for_light() {
    let mut harness = lit(roomy());
    let sky = view(&harness.forest, [0.5, 0.5, 0.5], [0.5, 0.9, 4.0]);
    let cut = settle(&mut harness, sky);
    assert!(cut.nodes.is_empty() && cut.complete);
    let ground = of_surroundings(&cut);
    assert!(ground.len() > 3, "{} nodes", ground.len());
    assert_eq!(ground[0].node, 0);
    let points = ground.iter().map(|n| n.prefix as u64).sum::<u64>();
    assert_eq!(
        (points, ground.len() as u64),
        (cut.counters.surroundings_points, cut.counters.surroundings)
    );
}

#[test]
fn switching_them_on_and_off_loses_nothing_of_the_picture() {
    let mut harness = harness(roomy());
    let view = harness.view(0.3, 0.2, 0.12);
    let before = harness.settle(view);
    for _ in 0..2 {
        for wanted in [Some(around()), None] {
            harness.streamer.surround(wanted);
            harness.until("switches", |cut, h| {
                assert_eq!(cut.nodes, before.nodes, "the same nodes in the same slots");
                let is_on = cut.surroundings.is_some();
                h.streamer.has_taken_in() && cut.settled && is_on == wanted.is_some()
            });
        }
    }
    assert_eq!(harness.streamer.status().nodes_evicted, 0);
    let epoch = harness.streamer.cut().epoch;
    harness.streamer.surround(None);
    harness.until("takes it in", |_, h| h.streamer.has_taken_in());
    assert_eq!(harness.streamer.cut().epoch, epoch, "the same choice changes nothing");
}

#[test]
fn the_picture_is_read_first() {
    let options = Options { loaders: 1, surroundings: Some(around()), ..roomy() };
    let mut harness = harness(options);
    harness.until("draws", |cut, _| !cut.nodes.is_empty());
    harness.gpu.arrived.clear();
    let view = harness.view(0.3, 0.2, 0.12);
    let cut = settle(&mut harness, view);
    let picture: HashSet<u32> = cut.nodes.iter().map(|n| n.node).collect();
    let around: HashSet<u32> = of_surroundings(&cut).iter().map(|n| n.node).collect();
    let arrived = &harness.gpu.arrived;
    let last = arrived.iter().rposition(|(node, _)| picture.contains(node)).unwrap();
    let first = arrived.iter().position(|(node, _)| around.contains(node)).unwrap();
    assert!(last < first, "{first} comes before {last} of {}", arrived.len());
}

#[test]
fn they_keep_to_their_share_of_a_small_memory_and_the_picture_keeps_its_own() {
    let (mut plain, mut lit) = (harness(tight()), lit(tight()));
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.5, 0.4, 0.5)] {
        let view = plain.view(x, y, height);
        let (alone, cut) = (plain.settle(view), settle(&mut lit, view));
        let of_picture =
            |cut: &Cut| cut.nodes.iter().map(|n| (n.node, n.prefix)).collect::<Vec<_>>();
        assert_eq!(of_picture(&cut), of_picture(&alone));
        assert!(alone.complete && alone.counters.withheld == 0, "the picture fits");
        assert!(bytes(&lit, &cut) <= tight().drawing_bytes / 4);
        assert!(cut.counters.bytes_wanted <= tight().drawing_bytes);
    }
    let sky = view(&lit.forest, [0.5, 0.5, 0.5], [0.5, 0.9, 4.0]);
    let cut = settle(&mut lit, sky);
    assert!(bytes(&lit, &cut) > tight().drawing_bytes / 8, "the share is used");
    assert!(cut.counters.surroundings_withheld > 0, "and said to be too small");
}

/// A picture that fills drawing memory leaves nothing for its surroundings.
#[test]
fn a_picture_that_needs_all_memory_gets_it() {
    let options = Options { drawing_bytes: 500 << 10, page_bytes: 128 << 10, ..roomy() };
    let mut lit = lit(options);
    for (x, y, height) in [(0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.1, 0.6, 0.1), (0.3, 0.2, 0.12)] {
        let view = lit.view(x, y, height);
        let cut = settle(&mut lit, view);
        assert!(cut.counters.withheld > 0, "the picture wants more");
        let points = cut.nodes.iter().map(|n| n.prefix).sum::<usize>();
        let around = of_surroundings(&cut).iter().map(|n| n.prefix).sum::<usize>();
        assert!(around * 10 < points, "{around} points around {points}");
    }
}

#[test]
fn no_more_points_and_nodes_than_allowed() {
    let budget = 9_000;
    let few = Surroundings { points_budget: budget, ..around() };
    let mut harness = harness(Options { surroundings: Some(few), nodes_max: 20, ..roomy() });
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.5, 0.4, 2.0)] {
        let view = harness.view(x, y, height);
        let cut = settle(&mut harness, view);
        let points: usize = of_surroundings(&cut).iter().map(|n| n.prefix).sum();
        assert!(points as u64 <= budget && cut.lit_nodes().count() <= 20);
        assert!(harness.streamer.status().nodes_resident <= 20);
    }
}

#[test]
fn the_same_view_has_the_same_surroundings_whatever_was_seen_before() {
    let (mut one, mut other) = (lit(roomy()), lit(roomy()));
    settle(&mut other, one.view(0.8, 0.1, 0.1));
    settle(&mut other, one.view(0.1, 0.6, 0.4));
    let view = one.view(0.5, 0.3, 0.2);
    let nodes = |cut: Arc<Cut>| cut.lit_nodes().map(|n| (n.node, n.prefix)).collect::<Vec<_>>();
    assert_eq!(nodes(settle(&mut one, view)), nodes(settle(&mut other, view)));
}

/// A flight under a tight budget with occlusion, during which surroundings and planes are switched
/// at random: the stand-in checks in each frame that no slot of either part has other bytes.
#[test]
fn no_slot_is_stale_while_they_are_switched_in_flight() {
    let memory = Options { drawing_bytes: 900 << 10, page_bytes: 150 << 10, ..roomy() };
    let mut harness = lit(Options { occlusion: true, ..memory });
    harness.faults.delay_us.store(100, SeqCst);
    let (mut random, began) = (Random(11), Instant::now());
    let (mut lit_frames, mut frames) = (0, 0);
    while began.elapsed() < Duration::from_secs(3) {
        if random.below(30) == 0 {
            harness.streamer.surround((random.below(2) == 0).then(around));
        }
        if random.below(60) == 0 {
            let normals = random.below(2) == 0;
            harness.streamer.show(Needs { normals, ..needs() });
        }
        if random.below(20) == 0 {
            let at = [random.unit(), random.unit(), 0.06 + random.unit().powi(3)];
            let to = [random.unit(), random.unit(), random.unit()];
            harness.streamer.look(view(&harness.forest, at, to));
        }
        let cut = harness.frame();
        let picture: HashSet<u32> = cut.nodes.iter().map(|n| n.node).collect();
        if let Some(around) = &cut.surroundings {
            assert!(around.nodes.iter().all(|n| !picture.contains(&n.node)));
            lit_frames += usize::from(!around.nodes.is_empty());
        }
        frames += 1;
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(lit_frames * 5 > frames, "{lit_frames} of {frames} frames have surroundings");
    assert!(harness.streamer.status().nodes_evicted > 20);
    harness.streamer.surround(None);
    let view = harness.view(0.3, 0.2, 0.12);
    assert!(settle(&mut harness, view).surroundings.is_none());
}
