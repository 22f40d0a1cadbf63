//! What streaming promises while nothing goes wrong: a view converges to the pure choice, in the order
//! that priorities say; the queue is replaced; needs change without an empty picture.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod rig;

use esker_format::PlaneKind;
use esker_lod::{
    AllResident, DepthFeedback, Frustum, OrientedBox, View, needs_residual, select, tiles_of,
};
use esker_stream::{Cut, Needs, Options, Priority};
use glam::DVec3;
use rig::{Habits, Random, Rig};
use std::collections::{HashMap, HashSet};
use std::sync::atomic::Ordering::SeqCst;

fn needs() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() }
}

fn roomy() -> Options {
    Options { drawing_bytes: 64 << 20, page_bytes: 8 << 20, occlusion: false, ..Options::default() }
}

/// What the pure choice draws with everything at hand.
fn pure(rig: &Rig, view: &View, options: &Options) -> Vec<(u32, usize)> {
    let forest = &rig.forest;
    let options = esker_lod::Options {
        points_budget: options.points_budget,
        bytes_budget: u64::MAX,
        target_spacing_px: options.target_spacing_px,
    };
    let (table, lattice) = (forest.table(), forest.lattice());
    let chosen = select(table, lattice, view, &options, &AllResident, None);
    chosen.drawn.iter().map(|d| (d.node, d.prefix)).collect()
}

fn drawn(cut: &Cut) -> Vec<(u32, usize)> {
    cut.nodes.iter().map(|n| (n.node, n.prefix)).collect()
}

#[test]
fn a_view_converges_to_the_pure_choice() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.5, 0.4, 2.0)] {
        let cut = rig.settle(rig.view(x, y, height));
        assert!(cut.complete);
        assert!(cut.nodes.len() > 3, "{} nodes", cut.nodes.len());
        assert_eq!(drawn(&cut), pure(&rig, &cut.view, &roomy()));
        assert_eq!(cut.octree.len(), cut.nodes.len());
        for node in &cut.nodes {
            let lattice = rig.forest.lattice();
            let record = &rig.forest.table().nodes[node.node as usize];
            let residual = node.slot(PlaneKind::Residual).is_some();
            assert_eq!(residual, needs_residual(record, lattice, &cut.view));
            assert!(node.slot(PlaneKind::Normal).is_some());
        }
    }
    let status = rig.streamer.status();
    assert_eq!((status.requests_in_flight, status.requests_waiting), (0, 0));
    assert_eq!((status.fault, status.nodes_evicted), (None, 0));
    assert!(status.useful_bytes <= status.read_bytes);
}

/// A node may be wanted for its children's sake alone, which stick out of its points into the view. No loader would read its
/// residual, since nothing of it is seen: nor must it be asked for, again and again.
#[test]
fn a_view_settles_in_which_a_node_has_nothing_but_children() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    let forest = std::sync::Arc::clone(&rig.forest);
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
    let has_children_alone = |view: &View| {
        let frustum = Frustum::of(view);
        let wanted = select(table, lattice, view, &options, &AllResident, None).wanted;
        wanted.into_iter().skip(1).any(|node| {
            let record = &table.nodes[node as usize];
            !frustum.touches(&OrientedBox::of_contour(record, lattice))
                && needs_residual(record, lattice, view)
                && forest.has_plane(node, PlaneKind::Residual)
        })
    };
    let view = (0..100_000).map(|_| view()).find(has_children_alone).unwrap();
    let cut = rig.settle(view);
    assert_eq!(drawn(&cut), pure(&rig, &view, &roomy()));
}

#[test]
fn occlusion_leaves_out_what_is_hidden_and_settles() {
    let options = Options { occlusion: true, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options.clone(), needs());
    let cut = rig.settle(rig.view(0.5, 0.1, 0.1));
    let all: HashSet<u32> = pure(&rig, &cut.view, &options).into_iter().map(|d| d.0).collect();
    assert!(cut.complete && cut.nodes.iter().all(|n| all.contains(&n.node)));
}

#[test]
fn the_root_is_drawn_before_there_is_a_view() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    rig.until("draws", |cut, _| !cut.nodes.is_empty());
    let cut = rig.streamer.cut();
    assert_eq!(drawn(&cut), [(0, rig.forest.table().nodes[0].points())]);
    assert!(!cut.complete && !cut.settled);
}

#[test]
fn nothing_happens_once_a_view_has_settled() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    let view = rig.view(0.5, -0.5, 0.8);
    let cut = rig.settle(view);
    let before = rig.streamer.status();
    for _ in 0..50 {
        rig.streamer.look(view);
        rig.frame();
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    assert_eq!(rig.streamer.status().passes, before.passes);
    assert_eq!(rig.streamer.cut().epoch, cut.epoch);
}

#[test]
fn feedback_of_each_frame_keeps_nobody_busy() {
    let options = Options { occlusion: true, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options, needs());
    let view = rig.view(0.5, 0.1, 0.1);
    let cut = rig.settle(view);
    let before = rig.streamer.status().passes;
    for _ in 0..60 {
        let tiles = tiles_of(&[f32::INFINITY; 400 * 300], 400, 300);
        rig.streamer.feedback(DepthFeedback::new(&view, &tiles).unwrap());
        rig.frame();
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    // It is used once, since what is drawn stays the same.
    assert!(rig.streamer.status().passes <= before + 2);
    assert_eq!(drawn(&rig.streamer.cut()), drawn(&cut), "nothing is hidden by nothing");
}

#[test]
fn a_budget_too_small_for_the_view_is_filled_and_kept() {
    let options = Options { drawing_bytes: 500 << 10, page_bytes: 128 << 10, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options.clone(), needs());
    for (x, y, height) in [(0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.1, 0.6, 0.1), (0.3, 0.2, 0.12)] {
        let cut = rig.settle(rig.view(x, y, height));
        let all = pure(&rig, &cut.view, &options);
        assert!(cut.complete, "what the budget allows finds its place: {:?}", cut.counters);
        assert!(cut.nodes.len() < all.len() && cut.counters.withheld > 0);
    }
    let status = rig.streamer.status();
    assert!(status.drawing_bytes_peak > (400 << 10), "{}", status.drawing_bytes_peak);
    assert!(status.nodes_evicted > 0);
}

#[test]
fn no_more_nodes_are_resident_than_allowed() {
    let options = Options { nodes_max: 20, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options, needs());
    for (x, y, height) in [(0.3, 0.2, 0.12), (0.6, 0.5, 0.08)] {
        let cut = rig.settle(rig.view(x, y, height));
        assert!(cut.complete && cut.nodes.len() > 10, "{}", cut.nodes.len());
        assert!(rig.streamer.status().nodes_resident <= 20);
    }
}

/// Which nodes came, in order, when a landing that was stuck until all were asked for lends again.
fn order(priority: Priority) -> (Rig, View, Vec<u32>) {
    let options = Options { priority, loaders: 1, ..roomy() };
    // Runs of few bytes, so that neighbours do not come along.
    let habits = Habits { run_bytes: 8192, ..Habits::default() };
    let mut rig = Rig::new(habits, options, needs());
    let first = rig.settle(rig.view(0.5, 0.5, 20.0));
    assert!(first.complete);
    rig.gpu.landing.stuck.store(true, SeqCst);
    let (view, before) = (rig.view(0.4, 0.0, 0.2), rig.gpu.arrived.len());
    rig.streamer.look(view);
    rig.until("asks", |cut, rig| cut.view == view && rig.streamer.status().requests_waiting > 40);
    rig.gpu.landing.stuck.store(false, SeqCst);
    rig.until("settles", |cut, _| cut.view == view && cut.settled);
    let came = rig.gpu.arrived[before..].iter().filter(|a| a.1 != PlaneKind::Residual);
    let came = came.map(|a| a.0).collect();
    (rig, view, came)
}

#[test]
fn parents_come_before_their_children() {
    for priority in [Priority::Distance, Priority::ErrorPerByte] {
        let (rig, _, came) = order(priority);
        let turn: HashMap<u32, usize> = came.iter().enumerate().map(|(i, &n)| (n, i)).collect();
        for (i, &node) in came.iter().enumerate() {
            let parent = rig.forest.table().nodes[node as usize].parent;
            assert!(turn.get(&parent).is_none_or(|&p| p < i), "{priority:?}: {node} at {i}");
        }
        assert!(came.len() > 40, "{}", came.len());
    }
}

#[test]
fn the_nearest_come_first_by_distance() {
    let mean = |priority| {
        let (rig, view, came) = order(priority);
        let distance = |&node: &u32| {
            let record = &rig.forest.table().nodes[node as usize];
            OrientedBox::of_contour(record, rig.forest.lattice()).distance(view.eye)
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
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    rig.settle(rig.view(0.5, 0.5, 20.0));
    rig.gpu.landing.stuck.store(true, SeqCst);
    let [left, right] = [0.05, 0.85].map(|x| rig.view(x, 0.1, 0.05));
    rig.streamer.look(left);
    rig.until("asks", |cut, rig| cut.view == left && rig.streamer.status().requests_waiting > 5);
    rig.streamer.look(right);
    rig.until("asks anew", |cut, _| cut.view == right);
    let before = rig.gpu.arrived.len();
    rig.gpu.landing.stuck.store(false, SeqCst);
    rig.until("settles", |cut, _| cut.view == right && cut.settled);
    let wanted = |view: &View| -> HashSet<u32> {
        pure(&rig, view, &roomy()).into_iter().map(|d| d.0).collect()
    };
    let only_left: HashSet<u32> = wanted(&left).difference(&wanted(&right)).copied().collect();
    assert!(only_left.len() > 20);
    let came = rig.gpu.arrived[before..].iter().filter(|a| only_left.contains(&a.0)).count();
    let status = rig.streamer.status();
    // At most what loaders had taken already, and that was out of view.
    assert_eq!(came, 0, "of {} in the old view alone; {status:?}", only_left.len());
    assert!(status.requests_dropped > 0);
}

#[test]
fn needs_change_without_an_empty_picture() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    let view = rig.view(0.3, 0.2, 0.12);
    rig.settle(view);
    let schema = rig.forest.schema();
    let time = schema.attributes.iter().position(|a| a.name == "gps_time").unwrap() as u16;
    let changes = [
        Needs { colour: Some(PlaneKind::Intensity), normals: false, ..Needs::default() },
        Needs { colour: Some(PlaneKind::Attribute(time)), normals: true, ..Needs::default() },
        Needs { colour: None, normals: false, ..Needs::default() },
        // What the file does not have is left out.
        Needs { colour: Some(PlaneKind::Class), normals: true, ..Needs::default() },
        needs(),
    ];
    for needs in changes {
        rig.streamer.need(needs.clone());
        rig.until("shows", |cut, _| cut.needs == needs && cut.settled);
        let cut = rig.streamer.cut();
        assert!(cut.complete);
        assert_eq!(drawn(&cut), pure(&rig, &view, &roomy()));
        for node in &cut.nodes {
            let colour = needs.colour.filter(|&c| c != PlaneKind::Class);
            assert!(colour.is_none_or(|c| node.slot(c).is_some()));
            assert_eq!(node.slot(PlaneKind::Normal).is_some(), needs.normals);
        }
    }
    assert_eq!(rig.streamer.status().fault, None);
}

/// Right after needs were told, the cut of before is still called settled: that it does not know of them must be seen.
#[test]
fn no_cut_is_the_last_one_before_needs_and_feedback_are_taken_in() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    let view = rig.view(0.5, -0.5, 0.8);
    for i in 0..50 {
        let needs = Needs { normals: i % 2 == 0, ..needs() };
        rig.streamer.need(needs.clone());
        rig.streamer.look(view);
        rig.until("is settled", |cut, rig| {
            rig.streamer.has_taken_in() && rig.streamer.cut().settled && cut.view == view
        });
        assert_eq!(rig.streamer.cut().needs, needs);
    }
}

#[test]
fn needs_change_where_the_budget_is_full() {
    let options = Options { drawing_bytes: 700 << 10, page_bytes: 128 << 10, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options, Needs::default());
    rig.settle(rig.view(0.3, 0.2, 0.12));
    for needs in [needs(), Needs::default(), needs()] {
        rig.streamer.need(needs.clone());
        rig.until("shows", |cut, _| cut.needs == needs && cut.settled);
    }
}

#[test]
fn a_root_that_does_not_fit_is_refused_with_a_remedy() {
    let file = std::sync::Arc::clone(&Rig::new(Habits::default(), roomy(), needs()).forest);
    let gpu = rig::Gpu::new(Habits::default(), 4096, std::sync::Arc::clone(&file));
    let options = Options { drawing_bytes: 4096, ..roomy() };
    let refused = esker_stream::Streamer::start(file, gpu.landing, options, needs());
    assert!(refused.unwrap_err().to_string().contains("raise the budget"));
}

#[test]
fn needs_whose_root_does_not_fit_are_refused_in_the_status() {
    let options = Options { drawing_bytes: 12 << 10, ..roomy() };
    let mut rig = Rig::new(Habits::default(), options, Needs::default());
    rig.settle(rig.view(0.5, 0.5, 20.0));
    rig.streamer.need(needs());
    rig.until("refuses", |_, rig| rig.streamer.status().fault.is_some());
    assert!(rig.streamer.status().fault.unwrap().contains("raise the budget"));
    assert_eq!(rig.streamer.cut().nodes.len(), 1);
    // Nobody waits for what does not come.
    rig.until("is settled", |cut, rig| rig.streamer.has_taken_in() && cut.settled);
}
