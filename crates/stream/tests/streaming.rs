//! What streaming promises: a view converges to the pure choice, in the order that priorities say,
//! whatever the disk and the landing do; and the streamer stops from any state.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod rig;

use esker_format::PlaneKind;
use esker_lod::{AllResident, select};
use esker_stream::{Cut, Needs, Options};
use rig::{Habits, Rig};

fn needs() -> Needs {
    Needs { colour: Some(PlaneKind::Colour), normals: true }
}

fn roomy() -> Options {
    Options { drawing_bytes: 64 << 20, page_bytes: 8 << 20, occlusion: false, ..Options::default() }
}

/// What the pure choice draws with everything at hand.
fn pure(rig: &Rig, cut: &Cut, options: &Options) -> Vec<(u32, usize)> {
    let file = &rig.file;
    let options = esker_lod::Options {
        points_budget: options.points_budget,
        bytes_budget: u64::MAX,
        target_spacing_px: options.target_spacing_px,
    };
    let lattice = &file.metadata().lattice;
    let chosen = select(file.table(), lattice, &cut.view, &options, &AllResident, None);
    chosen.drawn.iter().map(|d| (d.node, d.prefix)).collect()
}

#[test]
fn a_view_converges_to_the_pure_choice() {
    let mut rig = Rig::new(Habits::default(), roomy(), needs());
    for (x, y, height) in [(0.5, -0.5, 0.8), (0.3, 0.2, 0.12), (0.6, 0.5, 0.08), (0.5, 0.4, 2.0)] {
        let cut = rig.settle(rig.view(x, y, height));
        assert!(cut.complete);
        assert!(cut.nodes.len() > 3, "{} nodes", cut.nodes.len());
        let drawn: Vec<_> = cut.nodes.iter().map(|n| (n.node, n.prefix)).collect();
        assert_eq!(drawn, pure(&rig, &cut, &roomy()));
        assert_eq!(cut.octree.len(), cut.nodes.len());
        for node in &cut.nodes {
            let lattice = &rig.file.metadata().lattice;
            let record = &rig.file.table().nodes[node.node as usize];
            let residual = node.slot(PlaneKind::Residual).is_some();
            assert_eq!(residual, esker_lod::needs_residual(record, lattice, &cut.view));
            assert!(node.slot(PlaneKind::Normal).is_some());
        }
    }
    let status = rig.streamer.status();
    println!("{status:?}");
}
