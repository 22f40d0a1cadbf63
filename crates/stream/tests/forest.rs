//! Several trees stream as one cloud: three files in the same place, of which two have no colours
//! and an attribute that the first lacks. In each frame the stand-in for the GPU checks that every
//! tree in view is drawn, and that landed bytes are those of the node's own file.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod harness;

use esker_format::PlaneKind;
use esker_lod::{AllResident, select};
use esker_stream::{Needs, Options};
use harness::{GpuOptions, Harness, Random, forest_bytes};

fn colours() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() }
}

fn roomy() -> Options {
    Options { drawing_bytes: 64 << 20, page_bytes: 8 << 20, occlusion: false, ..Options::default() }
}

fn tree_of(harness: &Harness, node: u32) -> u16 {
    harness.forest.name_of(node).tree
}

#[test]
fn a_view_converges_to_the_pure_choice_over_all_trees() {
    let mut harness = Harness::of(forest_bytes(), GpuOptions::default(), roomy(), colours());
    assert_eq!(harness.forest.table().roots().count(), 3);
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.5, 0.4, 2.0)] {
        let cut = harness.settle(harness.view(x, y, height));
        assert!(cut.complete);
        let lod = esker_lod::Options {
            points_budget: roomy().points_budget,
            bytes_budget: u64::MAX,
            target_spacing_px: roomy().target_spacing_px,
        };
        let (table, lattice) = (harness.forest.table(), harness.forest.lattice());
        let pure = select(table, lattice, &cut.view, &lod, &AllResident, None);
        let pure: Vec<_> = pure.drawn.iter().map(|d| (d.node, d.prefix)).collect();
        assert_eq!(cut.nodes.iter().map(|n| (n.node, n.prefix)).collect::<Vec<_>>(), pure);
        for node in &cut.nodes {
            let has_colours = tree_of(&harness, node.node) == 0;
            assert_eq!(node.slot(PlaneKind::Colour).is_some(), has_colours);
            assert!(node.slot(PlaneKind::Normal).is_some());
        }
    }
    assert_eq!(harness.streamer.status().fault, None);
}

#[test]
fn an_attribute_is_matched_by_name_in_every_tree() {
    let mut harness = Harness::of(forest_bytes(), GpuOptions::default(), roomy(), colours());
    harness.settle(harness.view(0.3, 0.2, 0.12));
    for (name, of) in [("a_number", &[1u16, 2][..]), ("gps_time", &[0, 1, 2])] {
        let attribute = harness.forest.schema().find(name).unwrap() as u16;
        let plane = PlaneKind::Attribute(attribute);
        let needs = Needs { colour: Some(plane), normals: false, ..Needs::default() };
        harness.streamer.show(needs.clone());
        harness.until("shows", |cut, _| cut.shown.needs == needs && cut.settled);
        let cut = harness.streamer.cut();
        assert!(cut.complete && cut.nodes.iter().any(|n| tree_of(&harness, n.node) == 0));
        for node in &cut.nodes {
            assert_eq!(
                node.slot(plane).is_some(),
                of.contains(&tree_of(&harness, node.node)),
                "{name}"
            );
        }
    }
}

#[test]
fn a_flight_under_a_tight_budget_never_loses_a_tree() {
    let options = Options { drawing_bytes: 800 << 10, page_bytes: 128 << 10, ..Options::default() };
    let mut harness = Harness::of(forest_bytes(), GpuOptions::default(), options, colours());
    harness.until("draws all roots", |cut, _| cut.nodes.len() == 3);
    let mut random = Random(3);
    for _ in 0..12 {
        let view = harness.view(random.unit(), random.unit(), 0.06 + random.unit().powi(3));
        harness.streamer.look(view);
        for _ in 0..30 {
            harness.frame();
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    }
    let status = harness.streamer.status();
    assert!(status.fault.is_none() && status.nodes_evicted > 20, "{status:?}");
    let cut = harness.settle(harness.view(0.3, 0.2, 0.12));
    assert!(cut.complete, "{:?}", cut.counters);
}

#[test]
fn roots_that_do_not_fit_together_are_refused_with_a_remedy() {
    let forest = Harness::of(forest_bytes(), GpuOptions::default(), roomy(), colours()).forest;
    let options = Options { drawing_bytes: 24 << 10, ..roomy() };
    let gpu = harness::Gpu::new(GpuOptions::default(), options.drawing_bytes, forest.clone());
    let refused = esker_stream::Streamer::start(forest, gpu.landing, options, colours());
    let refused = refused.unwrap_err().to_string();
    assert!(refused.contains("3 trees") && refused.contains("--merge"), "{refused}");
}

#[test]
fn a_tree_that_is_cut_short_is_named_and_the_others_go_on() {
    let mut harness = Harness::of(forest_bytes(), GpuOptions::default(), roomy(), colours());
    harness.until("draws all roots", |cut, _| cut.nodes.len() == 3);
    // Of the three files on the disk, only the second is longer than this.
    let left = forest_bytes()[2].len() as u64;
    harness.faults.left.store(left, std::sync::atomic::Ordering::SeqCst);
    harness.streamer.look(harness.view(0.3, 0.2, 0.12));
    harness.until("reports the fault", |_, harness| harness.streamer.status().fault.is_some());
    let fault = harness.streamer.status().fault.unwrap();
    assert!(fault.contains("hills-0") && fault.contains("cut short"), "{fault}");
    let cut = harness.streamer.cut();
    assert!((0..3).all(|tree| cut.nodes.iter().any(|n| tree_of(&harness, n.node) == tree)));
}
