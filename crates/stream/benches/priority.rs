//! Compares the orders of loading: the error of what is drawn, over the bytes that have been
//! loaded, until a view is complete, for each priority. The error of a cut is the distance of
//! points in the picture, pixels, beyond that of the complete cut, at each of its nodes, weighted
//! by area.
//!
//! `cargo bench -p esker-stream --bench priority -- FILE`

#![allow(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

mod ring;

use esker_format::{Forest, PlaneKind};
use esker_lod::{OrientedBox, Projection, View};
use esker_stream::{Cut, Needs, Options, Priority, Streamer};
use glam::{DVec2, DVec3};
use ring::Ring;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Loads of each view by each priority, in turn.
const ROUNDS: usize = 5;

/// Cuts up to the complete one, each with the bytes loaded by then.
fn cuts(file: &Arc<Forest>, view: View, priority: Priority) -> Vec<(u64, Arc<Cut>)> {
    let ring = Arc::new(Ring::new(2));
    let options = Options {
        drawing_bytes: 4 << 30,
        occlusion: false,
        loaders: 2,
        priority,
        ..Options::default()
    };
    let needs = Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() };
    let streamer = Streamer::start(Arc::clone(file), Arc::clone(&ring), options, needs).unwrap();
    streamer.look(view);
    let (mut cuts, mut bytes): (Vec<(u64, Arc<Cut>)>, u64) = (Vec::new(), 0);
    loop {
        // A frame: slow enough that each gets a new choice.
        std::thread::sleep(Duration::from_millis(8));
        while let Ok((run, transfers)) = ring.landed.1.try_recv() {
            for t in &transfers {
                bytes += t.bytes as u64;
                t.request.into_iter().for_each(|r| streamer.uploaded(r));
            }
            let _ = ring.free.0.try_send(run);
        }
        let cut = streamer.cut();
        if cut.view == view && !cut.nodes.is_empty() {
            cuts.push((bytes, Arc::clone(&cut)));
            if cut.settled {
                return cuts;
            }
        }
    }
}

/// Mean error of a cut at the nodes of the complete one, pixels.
fn error_px(file: &Forest, cut: &Cut, complete: &Cut) -> f64 {
    let (view, lattice) = (&cut.view, file.lattice());
    let projection = Projection::of(view);
    let (mut sum, mut area) = (0.0, 0.0);
    for node in &complete.nodes {
        let record = &file.table().nodes[node.node as usize];
        let contour = OrientedBox::of_contour(record, lattice);
        let Some(silhouette) = projection.silhouette(&contour) else { continue };
        let weight = silhouette.clipped(DVec2::ZERO, projection.size_px()).area_px();
        let middle = record.cell().corner.map(|c| c + ((record.cell().edge() - 1) / 2) as u32);
        let depth = contour.distance(view.eye).max(view.near);
        let px = |cut: &Cut| f64::from(cut.octree.spacing_at(middle)) * view.focal_px() / depth;
        sum += weight * (px(cut) - px(complete)).max(0.0);
        area += weight;
    }
    sum / f64::max(area, 1.0)
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let Some(path) = arguments.first().filter(|a| !a.starts_with('-')).map(PathBuf::from) else {
        println!("names no file: cargo bench -p esker-stream --bench priority -- FILE");
        return;
    };
    let file = Arc::new(Forest::open(&path).unwrap());
    let bounds = file.bounds().unwrap();
    let [low, high] = bounds.map(|c| DVec3::from_array(file.lattice().world(c)));
    let extent = high - low;
    let at = |x: f64, y: f64, z: f64| low + extent * DVec3::new(x, y, z);
    let look = |eye, target| View::look_at(eye, target, DVec3::Z, 1.0, 1280, 720);
    let views = [
        ("overview", View::fit(low, high, DVec3::new(0.3, 1.0, -0.7), 1.0, 1280, 720)),
        ("along", look(at(0.1, 0.1, 1.5), at(0.9, 0.9, 0.3))),
        ("close", look(at(0.45, 0.45, 1.2), at(0.5, 0.55, 0.4))),
    ];
    for (name, view) in views {
        let priorities = [Priority::Distance, Priority::ErrorPerByte];
        let mut results = priorities.map(|_| Vec::new());
        for _ in 0..ROUNDS {
            for (priority, results) in priorities.iter().zip(&mut results) {
                results.push(measure(&file, view, *priority));
            }
        }
        for (priority, results) in priorities.iter().zip(&results) {
            let median = |of: fn(&Measured) -> f64| {
                let mut values: Vec<f64> = results.iter().map(of).collect();
                values.sort_by(f64::total_cmp);
                values[values.len() / 2]
            };
            println!(
                "{name:9} {priority:?}: mean error {:.2} px over {:.0} MiB, {:.2} px at a quarter of \
                 them (medians of {ROUNDS})",
                median(|m| m.mean_px),
                median(|m| m.bytes) / f64::from(1 << 20),
                median(|m| m.quarter_px),
            );
        }
    }
}

/// Errors on the way to a complete view.
struct Measured {
    bytes: f64,
    /// Mean over the bytes: each cut lasts until the next one.
    mean_px: f64,
    /// Error when a quarter of the bytes is loaded.
    quarter_px: f64,
}

fn measure(file: &Arc<Forest>, view: View, priority: Priority) -> Measured {
    let cuts = cuts(file, view, priority);
    let (all, complete) = cuts.last().cloned().unwrap();
    let sum: f64 = cuts
        .windows(2)
        .map(|w| error_px(file, &w[0].1, &complete) * (w[1].0 - w[0].0) as f64)
        .sum();
    let quarter = cuts.iter().find(|c| c.0 * 4 >= all).unwrap();
    Measured {
        bytes: all as f64,
        mean_px: sum / all as f64,
        quarter_px: error_px(file, &quarter.1, &complete),
    }
}
