//! Close views show no specks: in a cloud a kilometre wide with millimetre steps, every point in
//! the picture, also of inner nodes, is drawn within half a pixel of its exact coordinates, from
//! the planes that the engine chose to read. Where hot positions are exact enough, residuals are
//! not read.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::{Forest, PlaneKind};
use esker_points::quant;
use esker_points::task::Silent;
use esker_render::inputs::camera::{Camera as Projection, Positions};
use glam::DVec3;
use std::fmt::Write;

/// Corner of the cloud, metres: far from the origin.
const AT: [f64; 2] = [3_000_000.0, 5_000_000.0];
/// Middle of the dense spot, from the corner, metres.
const SPOT: [f64; 2] = [612.345, 377.001];

/// Points of a plane with relief, and of a dense spot of a metre in it, in millimetres from the
/// corner.
fn cloud() -> String {
    let mut text = String::new();
    let mut state = 0x0123_4567_89AB_CDEF_u64;
    let mut dice = |below: u64| {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % below
    };
    for i in 0..300_000 {
        let [x, y] = if i % 3 == 0 {
            SPOT.map(|c| (c * 1e3) as u64 - 500 + dice(1000))
        } else {
            [dice(1_000_000), dice(1_000_000)]
        };
        let z = (x / 997 + y / 1013) % 50 + dice(20);
        writeln!(
            text,
            "{:.3} {:.3} {:.3}",
            AT[0] + x as f64 / 1e3,
            AT[1] + y as f64 / 1e3,
            z as f64 / 1e3
        )
        .unwrap();
    }
    text
}

/// Results of a view.
struct Accuracy {
    points: usize,
    worst_px: f64,
    nodes_exact: usize,
    nodes_hot: usize,
}

/// Compares every drawn point with its exact position.
fn compare(file: &Forest, camera: &str, size: [u32; 2]) -> Accuracy {
    let request =
        PictureRequest { size, camera: Camera::parse(camera).unwrap(), ..Default::default() };
    let scene = PictureScene::read(file, &request, &Silent).unwrap();
    let lattice = file.lattice();
    let projection = Projection::new(&scene.view, lattice).unwrap();
    let mut accuracy = Accuracy { points: 0, worst_px: 0.0, nodes_exact: 0, nodes_hot: 0 };
    for (draw, drawn) in scene.draws(file).iter().zip(&scene.selection.drawn) {
        let exact = exact(file, drawn.node);
        let positions = Positions::of(draw);
        let place = projection.place(draw.node, positions.is_exact());
        let inexact = draw.node.hot_shift > 0;
        accuracy.nodes_exact += usize::from(inexact && draw.residual.is_some());
        accuracy.nodes_hot += usize::from(inexact && draw.residual.is_none());
        for (i, p) in exact.iter().enumerate().take(draw.prefix) {
            let world = DVec3::from_array(lattice.world(*p));
            let Some(there) = scene.view.project(world) else { continue };
            if !scene.view.is_on_picture(there) {
                continue;
            }
            let v = projection
                .to_view(place.steps_from_anchor(positions.offset(i).0) * projection.step);
            let scale = projection.focal_px / -v.z;
            let [cx, cy] = projection.centre_px;
            let off = (f64::from(cx + v.x * scale) - there.x)
                .hypot(f64::from(cy - v.y * scale) - there.y);
            accuracy.worst_px = accuracy.worst_px.max(off);
            accuracy.points += 1;
        }
    }
    accuracy
}

/// Lattice coordinates of the points of a node.
fn exact(file: &Forest, node: u32) -> Vec<[u32; 3]> {
    let record = &file.table().nodes[node as usize];
    let planes = file.read_planes(node, &[PlaneKind::Position, PlaneKind::Residual]).unwrap();
    let hot = planes.get(PlaneKind::Position).unwrap();
    let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
    let points = hot.chunks_exact(quant::HOT_POSITION_BYTES).enumerate();
    let exact = points.map(|(i, bytes)| {
        let low = quant::read_residual(residual, i, record.hot_shift);
        [0, 1, 2].map(|a| {
            let q = u16::from_le_bytes([bytes[2 * a], bytes[2 * a + 1]]);
            quant::exact(q, low[a], record.box_min[a], record.hot_shift)
        })
    });
    exact.collect()
}

#[test]
fn drawn_points_are_within_half_a_pixel_however_close_the_view() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("plane.xyz");
    std::fs::write(&scan, cloud()).unwrap();
    let out = folder.path().join("plane.esker");
    let options = esker_builder::Options { node_capacity: 1 << 13, ..Default::default() };
    esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    let table = file.table();
    let inner = table.nodes.iter().filter(|n| n.child_count > 0 && n.hot_shift > 0).count();
    assert!(inner > 0, "inner nodes have dropped bits");

    let (mut points, mut with_exact, mut with_hot) = (0, 0, 0);
    let at =
        |d: [f64; 3]| format!("{},{},{}", AT[0] + SPOT[0] + d[0], AT[1] + SPOT[1] + d[1], d[2]);
    for away in [0.05, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 2000.0] {
        for direction in [[0.0, 0.0, 1.0], [0.7, -0.6, 0.4], [-1.0, 0.1, 0.05]] {
            for (size, fovy) in [([1024, 1024], 60.0), ([1920, 600], 100.0), ([300, 900], 12.0)] {
                let eye = at(direction.map(|c: f64| c * away));
                let camera = format!("eye={eye};target={};up=0,1,0;fovy={fovy}", at([0.0; 3]));
                let accuracy = compare(&file, &camera, size);
                assert!(accuracy.worst_px < 0.5, "{} px: {camera} {size:?}", accuracy.worst_px);
                points += accuracy.points;
                with_exact += accuracy.nodes_exact;
                with_hot += accuracy.nodes_hot;
            }
        }
    }
    assert!(points > 1_000_000, "only {points} points are in a picture");
    assert!(with_exact > 0 && with_hot > 0, "{with_exact} nodes exact, {with_hot} hot alone");
}
