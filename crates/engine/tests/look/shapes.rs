//! Shapes of splats from a build to a picture: a scan in lines, built with and without shapes,
//! drawn from a file and by a session.

use super::splats::request;
use esker_engine::calls::render::draw;
use esker_engine::draw::scene::PictureScene;
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::Backend;
use esker_engine::{Method, NormalsMode, Picture};
use esker_format::{EskerFile, Forest, PlaneKind, verify};
use esker_lod::View;
use esker_points::task::Silent;
use esker_render::inputs::colour::linear;
use esker_truth::flip::mean_flip;
use glam::{DVec2, DVec3};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

const SIZE: [u32; 2] = [240, 180];
/// Distance of lines, metres; below, its ratio to the distance of points along them.
const APART_M: f64 = 0.1;
const ALONG: f64 = 0.25;
/// Distance of stripes across the lines, metres.
const STRIPES_M: f64 = 0.2;

/// Whether the ground at a position is red.
fn is_red(at: DVec2) -> bool {
    (at.y / STRIPES_M).rem_euclid(1.0) < 0.5
}

/// Level ground of 6 m x 6 m, scanned in lines along y, with a little noise.
fn scan(folder: &Path) -> PathBuf {
    let mut state = 7u64;
    let mut dice = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut points = String::new();
    let step = APART_M * ALONG;
    let (lines, along) = ((6.0 / APART_M) as i32, (6.0 / step) as i32);
    for line in 0..lines {
        let moved = dice();
        for i in 0..along {
            let x = (f64::from(line) + 0.1 * dice()) * APART_M - 3.0;
            let y = (f64::from(i) + moved + 0.1 * dice()) * step - 3.0;
            let [r, b] = if is_red(DVec2::new(x, y)) { [255, 0] } else { [0, 255] };
            writeln!(points, "{x:.4} {y:.4} {:.4} {r} 0 {b}", dice() * 0.002).unwrap();
        }
    }
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        lines * along
    );
    let path = folder.join("lines.ply");
    std::fs::write(&path, head + &points).unwrap();
    path
}

fn built(scan: &Path, tangents: bool) -> Forest {
    let out = scan.with_file_name(format!("{tangents}.esker"));
    let normals = NormalsMode::Estimate;
    let options =
        esker_builder::Options { normals, tangents, node_capacity: 2048, ..Default::default() };
    esker_builder::build(&[scan.to_path_buf()], &out, &options, &Silent).unwrap();
    verify(&EskerFile::open(&out).unwrap(), &Silent).unwrap();
    Forest::open(&out).unwrap()
}

/// Root mean square error of the share of red in a pixel.
fn error(picture: &Picture, view: &View) -> f64 {
    let to_world = view.view_from_world().transpose();
    let ground = |x: f64, y: f64| {
        let from_middle = DVec2::new(x - f64::from(SIZE[0]) / 2.0, f64::from(SIZE[1]) / 2.0 - y);
        let ray = to_world * from_middle.extend(-view.focal_px());
        (view.eye - ray * (view.eye.z / ray.z)).truncate()
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for (i, pixel) in picture.rgba.as_chunks::<4>().0.iter().enumerate() {
        let (x, y) = (f64::from(i as u32 % SIZE[0]), f64::from(i as u32 / SIZE[0]));
        let inner = ground(x, y).abs().max_element() < 2.5;
        if !(inner && picture.depth[i].is_finite()) {
            continue;
        }
        let red = |k: u32| {
            let (u, v) = (f64::from(k % 4) + 0.5, f64::from(k / 4) + 0.5);
            f64::from(u8::from(is_red(ground(x + u / 4.0, y + v / 4.0)))) / 16.0
        };
        let c = linear([pixel[0], pixel[1], pixel[2]]);
        let found = f64::from(c.x / (c.x + c.z).max(1e-6));
        sum += (found - (0..16).map(red).sum::<f64>()).powi(2);
        count += 1.0;
    }
    assert!(count > 5000.0, "{count}");
    f64::sqrt(sum / count)
}

#[test]
fn shapes_of_splats_make_a_scan_in_lines_sharper_and_open_no_holes() {
    let folder = tempfile::tempdir().unwrap();
    let scan = scan(folder.path());
    let [discs, shapes] = [false, true].map(|tangents| {
        let file = built(&scan, tangents);
        assert_eq!(file.has(PlaneKind::Tangents), tangents);
        let mut picture_request = request("direction=0,1,-1.2;fovy=40", SIZE);
        (picture_request.camera.eye, picture_request.camera.target) =
            (Some(DVec3::new(0.3, -1.6, 1.8)), Some(DVec3::ZERO));
        let view = PictureScene::choose(&file, &picture_request).unwrap().view;
        let (picture, _) = draw(&file, &picture_request, &Silent).unwrap();
        let open = picture.depth.iter().filter(|d| !d.is_finite()).count();
        // The same from a session, which streams the plane.
        let file = Arc::new(file);
        let options = Options {
            settings: Settings {
                method: Method::Ewa,
                target_spacing_px: 0.0,
                occlusion: false,
                ..Settings::default()
            },
            backend: Backend::Cpu,
            size: SIZE,
            ..Options::default()
        };
        let mut session = Session::open(file, options).unwrap();
        session.settle(&view, Duration::from_secs(60)).unwrap();
        session.frame(&view).unwrap();
        let flip = mean_flip(&session.picture().unwrap().rgba, &picture.rgba, SIZE[0] as usize);
        assert!(flip < 0.002, "a session draws the same: {flip}");
        (error(&picture, &view), open)
    });
    println!("off by {:.3} with discs, {:.3} with shapes", discs.0, shapes.0);
    assert!(shapes.0 < 0.85 * discs.0, "{shapes:?} {discs:?}");
    assert!(shapes.1 <= discs.1 + 20, "{shapes:?} {discs:?}");
}
