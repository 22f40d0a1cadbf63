//! Streaming without faults: a view converges to the pure choice, in the order of the priority; a
//! new view replaces the queue; needs change without an empty picture.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod harness;

use esker_format::PlaneKind;
use esker_lod::{
    AllResident, DepthFeedback, Frustum, OrientedBox, Selection, View, needs_residual, select,
    tiles_of,
};
use esker_stream::{Cut, Needs, Options, Priority};
use glam::DVec3;
use harness::{GpuOptions, Harness, Random};
use std::collections::{HashMap, HashSet};
use std::sync::atomic::Ordering::SeqCst;

fn needs() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() }
}

fn roomy() -> Options {
    Options { drawing_bytes: 64 << 20, page_bytes: 8 << 20, occlusion: false, ..Options::default() }
}

/// Nodes and prefixes that the pure choice draws if everything is resident.
fn pure(harness: &Harness, view: &View, options: &Options) -> Vec<(u32, usize)> {
    chosen(harness, view, options).drawn.iter().map(|d| (d.node, d.prefix)).collect()
}

fn chosen(harness: &Harness, view: &View, options: &Options) -> Selection {
    let forest = &harness.forest;
    let options = esker_lod::Options {
        points_budget: options.points_budget,
        bytes_budget: u64::MAX,
        target_spacing_px: options.target_spacing_px,
    };
    let (table, lattice) = (forest.table(), forest.lattice());
    select(table, lattice, view, &options, &AllResident, None)
}

fn drawn(cut: &Cut) -> Vec<(u32, usize)> {
    cut.nodes.iter().map(|n| (n.node, n.prefix)).collect()
}

#[test]
fn a_view_converges_to_the_pure_choice() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.5, 0.4, 2.0)] {
        let cut = harness.settle(harness.view(x, y, height));
        assert!(cut.complete);
        assert!(cut.nodes.len() > 3, "{} nodes", cut.nodes.len());
        assert_eq!(drawn(&cut), pure(&harness, &cut.view, &roomy()));
        let hidden = chosen(&harness, &cut.view, &roomy()).hidden.len();
        assert_eq!(cut.octree.len(), cut.nodes.len() + hidden);
        for node in &cut.nodes {
            let lattice = harness.forest.lattice();
            let record = &harness.forest.table().nodes[node.node as usize];
            let residual = node.slot(PlaneKind::Residual).is_some();
            assert_eq!(residual, needs_residual(record, lattice, &cut.view));
            assert!(node.slot(PlaneKind::Normal).is_some());
        }
    }
    let status = harness.streamer.status();
    assert_eq!((status.requests_in_flight, status.requests_waiting), (0, 0));
    assert_eq!((status.fault, status.nodes_evicted), (None, 0));
    assert!(status.useful_bytes <= status.read_bytes);
}

/// A node may be wanted only for its children, which reach into the view while its own points do
/// not. No loader would read its residual, since its points are not seen; so the residual must not
/// be requested for ever.
#[test]
fn a_view_settles_if_a_node_is_wanted_only_for_its_children() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    let forest = std::sync::Arc::clone(&harness.forest);
    let (table, lattice) = (forest.table(), forest.lattice());
    let options = esker_lod::Options {
        points_budget: u64::MAX,
        bytes_budget: u64::MAX,
        target_spacing_px: 1.0,
    };
    let [corner, end] = [table.nodes[0].cell().corner, table.nodes[0].cell().last()]
        .map(|p| DVec3::from_array(lattice.world(p)));
    let mut random = Random(3);
    let mut view = || {
        let mut place = |x: f64, z: f64| {
            let at = [random.unit() * x - (x - 1.0) / 2.0, random.unit() * x - (x - 1.0) / 2.0];
            corner + (end - corner) * DVec3::new(at[0], at[1], random.unit() * z)
        };
        let (eye, target) = (place(1.0, 0.2), place(1.4, 0.1));
        View::look_at(eye, target, DVec3::Z, 0.6, 400, 300)
    };
    let has_only_children_in_view = |view: &View| {
        let frustum = Frustum::of(view);
        let wanted = select(table, lattice, view, &options, &AllResident, None).wanted;
        wanted.into_iter().skip(1).any(|node| {
            let record = &table.nodes[node as usize];
            !frustum.touches(&OrientedBox::of_contour(record, lattice))
                && needs_residual(record, lattice, view)
                && forest.has_plane(node, PlaneKind::Residual)
        })
    };
    let view = (0..100_000).map(|_| view()).find(has_only_children_in_view).unwrap();
    let cut = harness.settle(view);
    assert_eq!(drawn(&cut), pure(&harness, &view, &roomy()));
}

#[test]
fn occlusion_leaves_out_what_is_hidden_and_settles() {
    let options = Options { occlusion: true, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options.clone(), needs());
    let cut = harness.settle(harness.view(0.5, 0.1, 0.1));
    let all: HashSet<u32> = pure(&harness, &cut.view, &options).into_iter().map(|d| d.0).collect();
    assert!(cut.complete && cut.nodes.iter().all(|n| all.contains(&n.node)));
}

#[test]
fn the_root_is_drawn_before_there_is_a_view() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    harness.until("draws", |cut, _| !cut.nodes.is_empty());
    let cut = harness.streamer.cut();
    assert_eq!(drawn(&cut), [(0, harness.forest.table().nodes[0].points())]);
    assert!(!cut.complete && !cut.settled);
}

#[test]
fn nothing_happens_once_a_view_has_settled() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    let view = harness.view(0.5, -0.5, 0.8);
    let cut = harness.settle(view);
    let before = harness.streamer.status();
    for _ in 0..50 {
        harness.streamer.look(view);
        harness.frame();
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert_eq!(harness.streamer.status().passes, before.passes);
    assert_eq!(harness.streamer.cut().epoch, cut.epoch);
}

#[test]
fn feedback_of_each_frame_causes_no_further_passes() {
    let options = Options { occlusion: true, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options, needs());
    let view = harness.view(0.5, 0.1, 0.1);
    let cut = harness.settle(view);
    let before = harness.streamer.status().passes;
    for _ in 0..60 {
        let tiles = tiles_of(&[f32::INFINITY; 400 * 300], 400, 300);
        harness.streamer.feedback(DepthFeedback::new(&view, &tiles).unwrap());
        harness.frame();
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    // Feedback is used once, since the drawn nodes stay the same.
    assert!(harness.streamer.status().passes <= before + 2);
    assert_eq!(drawn(&harness.streamer.cut()), drawn(&cut), "nothing is hidden by nothing");
}

#[test]
fn a_budget_too_small_for_the_view_is_filled_and_kept() {
    let options = Options { drawing_bytes: 500 << 10, page_bytes: 128 << 10, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options.clone(), needs());
    for (x, y, height) in [(0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.1, 0.6, 0.1), (0.3, 0.2, 0.12)] {
        let cut = harness.settle(harness.view(x, y, height));
        let all = pure(&harness, &cut.view, &options);
        assert!(cut.complete, "what the budget allows finds its place: {:?}", cut.counters);
        assert!(cut.nodes.len() < all.len() && cut.counters.withheld > 0);
    }
    let status = harness.streamer.status();
    assert!(status.drawing_bytes_peak > (400 << 10), "{}", status.drawing_bytes_peak);
    assert!(status.nodes_evicted > 0);
}

#[test]
fn no_more_nodes_are_resident_than_allowed() {
    let options = Options { nodes_max: 20, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options, needs());
    for (x, y, height) in [(0.3, 0.2, 0.12), (0.6, 0.5, 0.08)] {
        let cut = harness.settle(harness.view(x, y, height));
        assert!(cut.complete && cut.nodes.len() > 10, "{}", cut.nodes.len());
        assert!(harness.streamer.status().nodes_resident <= 20);
    }
}

/// Nodes in the order of arrival, after a landing that was blocked until all requests were made.
fn order(priority: Priority) -> (Harness, View, Vec<u32>) {
    let options = Options { priority, loaders: 1, ..roomy() };
    // Short runs, so that neighbours are not read along.
    let gpu_options = GpuOptions { run_bytes: 8192, ..GpuOptions::default() };
    let mut harness = Harness::new(gpu_options, options, needs());
    let first = harness.settle(harness.view(0.5, 0.5, 20.0));
    assert!(first.complete);
    harness.gpu.landing.blocked.store(true, SeqCst);
    let (view, before) = (harness.view(0.4, 0.0, 0.2), harness.gpu.arrived.len());
    harness.streamer.look(view);
    harness.until("makes requests", |cut, harness| {
        cut.view == view && harness.streamer.status().requests_waiting > 40
    });
    harness.gpu.landing.blocked.store(false, SeqCst);
    harness.until("settles", |cut, _| cut.view == view && cut.settled);
    let came = harness.gpu.arrived[before..].iter().filter(|a| a.1 != PlaneKind::Residual);
    let came = came.map(|a| a.0).collect();
    (harness, view, came)
}

#[test]
fn parents_come_before_their_children() {
    for priority in [Priority::Distance, Priority::ErrorPerByte] {
        let (harness, _, came) = order(priority);
        let turn: HashMap<u32, usize> = came.iter().enumerate().map(|(i, &n)| (n, i)).collect();
        for (i, &node) in came.iter().enumerate() {
            let parent = harness.forest.table().nodes[node as usize].parent;
            assert!(turn.get(&parent).is_none_or(|&p| p < i), "{priority:?}: {node} at {i}");
        }
        assert!(came.len() > 40, "{}", came.len());
    }
}

#[test]
fn the_nearest_come_first_by_distance() {
    let mean = |priority| {
        let (harness, view, came) = order(priority);
        let distance = |&node: &u32| {
            let record = &harness.forest.table().nodes[node as usize];
            OrientedBox::of_contour(record, harness.forest.lattice()).distance(view.eye)
        };
        let distances: Vec<f64> = came.iter().map(distance).collect();
        let early = &distances[..distances.len() / 3];
        let late = &distances[distances.len() * 2 / 3..];
        early.iter().sum::<f64>() / late.iter().sum::<f64>()
    };
    assert!(mean(Priority::Distance) < 0.5, "{}", mean(Priority::Distance));
}

#[test]
fn a_new_view_replaces_the_queue() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    harness.settle(harness.view(0.5, 0.5, 20.0));
    harness.gpu.landing.blocked.store(true, SeqCst);
    let [left, right] = [0.05, 0.85].map(|x| harness.view(x, 0.1, 0.05));
    harness.streamer.look(left);
    harness.until("makes requests", |cut, harness| {
        cut.view == left && harness.streamer.status().requests_waiting > 5
    });
    harness.streamer.look(right);
    harness.until("replaces its requests", |cut, _| cut.view == right);
    let before = harness.gpu.arrived.len();
    harness.gpu.landing.blocked.store(false, SeqCst);
    harness.until("settles", |cut, _| cut.view == right && cut.settled);
    let wanted = |view: &View| -> HashSet<u32> {
        pure(&harness, view, &roomy()).into_iter().map(|d| d.0).collect()
    };
    let only_left: HashSet<u32> = wanted(&left).difference(&wanted(&right)).copied().collect();
    assert!(only_left.len() > 20);
    let came = harness.gpu.arrived[before..].iter().filter(|a| only_left.contains(&a.0)).count();
    let status = harness.streamer.status();
    // Only requests that loaders had taken before, and these were out of view.
    assert_eq!(came, 0, "of {} in the old view alone; {status:?}", only_left.len());
    assert!(status.requests_dropped > 0);
}

#[test]
fn needs_change_without_an_empty_picture() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    let view = harness.view(0.3, 0.2, 0.12);
    harness.settle(view);
    let schema = harness.forest.schema();
    let time = schema.attributes.iter().position(|a| a.name == "gps_time").unwrap() as u16;
    let changes = [
        Needs { colour: Some(PlaneKind::Intensity), normals: false, ..Needs::default() },
        Needs { colour: Some(PlaneKind::Attribute(time)), normals: true, ..Needs::default() },
        Needs { colour: None, normals: false, ..Needs::default() },
        // Of a plane that is needed twice there is one.
        Needs {
            colour: Some(PlaneKind::Intensity),
            classes: Some(PlaneKind::Intensity),
            ..Needs::default()
        },
        Needs { classes: Some(PlaneKind::Attribute(time)), ..Needs::default() },
        // A plane that the file lacks is left out.
        Needs { colour: Some(PlaneKind::Class), normals: true, ..Needs::default() },
        needs(),
    ];
    for needs in changes {
        harness.streamer.show(needs.clone());
        harness.until("shows", |cut, _| cut.shown.needs == needs && cut.settled);
        let cut = harness.streamer.cut();
        assert!(cut.complete);
        assert_eq!(drawn(&cut), pure(&harness, &view, &roomy()));
        for node in &cut.nodes {
            let colour = needs.colour.filter(|&c| c != PlaneKind::Class);
            assert!(colour.is_none_or(|c| node.slot(c).is_some()));
            assert!(needs.classes.is_none_or(|c| node.slot(c).is_some()));
            assert_eq!(node.slot(PlaneKind::Normal).is_some(), needs.normals);
        }
    }
    assert_eq!(harness.streamer.status().fault, None);
}

/// Right after the needs change, the old cut is still marked as settled; the caller must be able to
/// see that it does not reflect the new needs.
#[test]
fn no_cut_is_final_before_needs_and_feedback_are_taken_in() {
    let mut harness = Harness::new(GpuOptions::default(), roomy(), needs());
    let view = harness.view(0.5, -0.5, 0.8);
    for i in 0..50 {
        let needs = Needs { normals: i % 2 == 0, ..needs() };
        harness.streamer.show(needs.clone());
        harness.streamer.look(view);
        harness.until("is settled", |cut, harness| {
            harness.streamer.has_taken_in() && harness.streamer.cut().settled && cut.view == view
        });
        assert_eq!(harness.streamer.cut().shown.needs, needs);
    }
}

#[test]
fn needs_change_where_the_budget_is_full() {
    let options = Options { drawing_bytes: 700 << 10, page_bytes: 128 << 10, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options, Needs::default());
    harness.settle(harness.view(0.3, 0.2, 0.12));
    for needs in [needs(), Needs::default(), needs()] {
        harness.streamer.show(needs.clone());
        harness.until("shows", |cut, _| cut.shown.needs == needs && cut.settled);
    }
}

#[test]
fn a_root_that_does_not_fit_is_refused_with_a_remedy() {
    let file = std::sync::Arc::clone(&Harness::new(GpuOptions::default(), roomy(), needs()).forest);
    let gpu = harness::Gpu::new(GpuOptions::default(), 4096, std::sync::Arc::clone(&file));
    let options = Options { drawing_bytes: 4096, ..roomy() };
    let refused = esker_stream::Streamer::start(file, gpu.landing, options, needs());
    assert!(refused.unwrap_err().to_string().contains("raise the budget"));
}

#[test]
fn needs_whose_root_does_not_fit_are_refused_in_the_status() {
    let options = Options { drawing_bytes: 12 << 10, ..roomy() };
    let mut harness = Harness::new(GpuOptions::default(), options, Needs::default());
    harness.settle(harness.view(0.5, 0.5, 20.0));
    harness.streamer.show(needs());
    harness.until("refuses", |_, harness| harness.streamer.status().fault.is_some());
    assert!(harness.streamer.status().fault.unwrap().contains("raise the budget"));
    assert_eq!(harness.streamer.cut().nodes.len(), 1);
    // Nothing waits for planes that do not come.
    harness.until("is settled", |cut, harness| harness.streamer.has_taken_in() && cut.settled);
}
