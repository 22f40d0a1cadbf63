//! Splats from a build to a picture: generated models with given clip lines, and the same solids
//! with lines that the build finds; golden pictures of both.

use super::look::read_png;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::io::picture;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Method, NormalsMode, Picture};
use esker_format::{EskerFile, Forest, PlaneKind, verify};
use esker_lod::CompactOctree;
use esker_points::task::Silent;
use esker_render::FramePlan;
use esker_truth::flip::mean_flip;
use glam::{DVec2, DVec3};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Builds a model; with `found`, clip lines are found from positions only.
fn built(model: &str, found: bool, test: impl FnOnce(&Forest)) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("model.esker");
    let normals = if found { NormalsMode::Estimate } else { NormalsMode::Keep };
    let options = esker_builder::Options { normals, sharp_features: found, ..Default::default() };
    esker_builder::build(&[PathBuf::from(model)], &out, &options, &Silent).unwrap();
    verify(&EskerFile::open(&out).unwrap(), &Silent).unwrap();
    test(&Forest::open(&out).unwrap());
}

pub fn request(camera: &str, size: [u32; 2]) -> PictureRequest {
    let with = DrawWith { backend: Backend::Cpu, ..DrawWith::default() };
    let (camera, method) = (Camera::parse(camera).unwrap(), Method::Ewa);
    PictureRequest {
        size,
        with,
        camera,
        method,
        target_spacing_px: 0.0,
        ..PictureRequest::default()
    }
}

#[test]
fn the_plan_leaves_out_the_back_faces_that_the_frame_leaves_out() {
    // The normals of a model are oriented if they are given, and not if they are estimated.
    for (found, is_oriented) in [(false, true), (true, false)] {
        built("synthetic:csg:20k:1", found, |file| {
            for method in [Method::Points, Method::PullPush, Method::Ewa, Method::Lit] {
                let request =
                    PictureRequest { method, ..request("eye=4,3,2;target=0,0,0", [64, 48]) };
                let scene = PictureScene::read(file, &request, &Silent).unwrap();
                let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
                let draws = scene.draws(file);
                let frame = scene.appearance.frame(file, &scene.view, &draws, &octree);
                let culls = is_oriented && method != Method::Points;
                assert_eq!(frame.cull_back_faces, culls, "{method:?}");
                assert_eq!(scene.plan.culls_back_faces, culls, "{method:?}");
                if method != Method::Points {
                    assert_eq!(FramePlan::new(&frame).culls_back_faces, culls, "{method:?}");
                }
            }
        });
    }
}

/// A sheet of points whose normals look up, as a PLY file.
fn sheet() -> String {
    let place = |i: i32| DVec3::new(f64::from(i % 50) / 10.0, f64::from(i / 50) / 10.0, 0.0);
    ply((0..2500).map(|i| (place(i), DVec3::Z)))
}

/// A ball of radius 1 whose normals look outwards, times `side`, as a PLY file.
fn ball(side: f64) -> String {
    let place = |i: i32| {
        let (z, turn) = (f64::from(i) / 2000.0 - 0.999, f64::from(i) * 2.399_963);
        let radius = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(radius * turn.cos(), radius * turn.sin(), z)
    };
    ply((0..3996).map(|i| (place(i), place(i) * side)))
}

/// A PLY file of places and normals.
fn ply(points: impl Iterator<Item = (DVec3, DVec3)>) -> String {
    let line = |(p, n): (DVec3, DVec3)| {
        format!("{} {} {} {} {} {} 200 90 40", p.x, p.y, p.z, n.x, n.y, n.z)
    };
    let points: Vec<String> = points.map(line).collect();
    let properties = ["x", "y", "z", "nx", "ny", "nz"].map(|n| format!("property float {n}\n"));
    let colours = ["red", "green", "blue"].map(|n| format!("property uchar {n}\n"));
    format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n{}{}end_header\n{}\n",
        points.len(),
        properties.concat(),
        colours.concat(),
        points.join("\n")
    )
}

#[test]
fn one_sided_scans_are_drawn_from_both_sides() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("sheet.ply");
    std::fs::write(&scan, sheet()).unwrap();
    built(scan.to_str().unwrap(), false, |file| {
        for method in [Method::Points, Method::PullPush, Method::Ewa, Method::Lit] {
            let drawn = |eye_z: f64, culls_back: bool| {
                let camera = format!("eye=2.5,2.4,{eye_z};target=2.5,2.5,0;up=0,1,0;fovy=30");
                let request = request(&camera, [96, 72]);
                let request = PictureRequest { method, culls_back, ..request };
                let (picture, report) = draw(file, &request, &Silent).unwrap();
                let notes = report.notes.join("\n");
                (picture.depth.iter().filter(|d| d.is_finite()).count(), notes)
            };
            let (above, below) = (drawn(12.0, false), drawn(-12.0, false));
            assert!(above.0 > 1000, "{method:?}: {}", above.0);
            assert!(
                above.0.abs_diff(below.0) * 50 < above.0,
                "{method:?}: {} {}",
                above.0,
                below.0
            );
            let culled = drawn(-12.0, true);
            assert_eq!(culled.0 == 0, method != Method::Points, "{method:?}");
            assert_eq!(drawn(12.0, true).0, above.0, "{method:?}");
            let is_said = |(_, notes): &(usize, String)| notes.contains("face away");
            assert!(!is_said(&above), "{}", above.1);
            if method != Method::Points {
                assert!(is_said(&below) && is_said(&culled), "{method:?}: {}", below.1);
            }
        }
    });
}

/// Half of the points of a ball face away, but are hidden.
#[test]
fn a_note_tells_of_backs_only_where_they_are_seen() {
    let folder = tempfile::tempdir().unwrap();
    for (side, is_said) in [(1.0, false), (-1.0, true)] {
        let scan = folder.path().join("ball.ply");
        std::fs::write(&scan, ball(side)).unwrap();
        built(scan.to_str().unwrap(), false, |file| {
            for method in [Method::PullPush, Method::Ewa] {
                for distance in [2.5, 40.0] {
                    let fovy = 2.4 / distance * 57.0;
                    let camera = format!("eye=0,-{distance},0;target=0,0,0;fovy={fovy}");
                    let request = PictureRequest { method, ..request(&camera, [160, 120]) };
                    let (_, report) = draw(file, &request, &Silent).unwrap();
                    let notes = report.notes.join("; ");
                    let what = format!("{method:?}, normals times {side}, {distance}: {notes}");
                    assert_eq!(notes.contains("face away"), is_said, "{what}");
                }
            }
        });
    }
}

/// Corners of the generated cube.
fn corners() -> [DVec3; 8] {
    let turn = |turns: f64| (turns * std::f64::consts::TAU).sin_cos();
    let ((b, a), (d, c)) = (turn(0.07), turn(0.11));
    let axes = [[a, b, 0.0], [-b * c, a * c, d], [b * d, -a * d, c]].map(DVec3::from_array);
    std::array::from_fn(|i| {
        let side = |k: usize| if i >> k & 1 == 0 { -0.5 } else { 0.5 };
        axes[0] * side(0) + axes[1] * side(1) + axes[2] * side(2)
    })
}

/// Distance of a point of the picture from the outline of a convex hull, negative inside.
fn outside(place: DVec2, hull_of: &[DVec2]) -> f64 {
    let mut farthest = f64::NEG_INFINITY;
    for (i, &a) in hull_of.iter().enumerate() {
        for &b in &hull_of[i + 1..] {
            let across = (b - a).perp().normalize_or_zero();
            let sides = hull_of.iter().map(|p| across.dot(*p - a));
            let (low, high) = sides.fold((0f64, 0f64), |(l, h), s| (l.min(s), h.max(s)));
            let own = across.dot(place - a);
            if low > -1e-9 {
                farthest = farthest.max(-own);
            }
            if high < 1e-9 {
                farthest = farthest.max(own);
            }
        }
    }
    farthest
}

/// Fraction of the pixels that show something more than `pixels` outside the cube, or nothing more
/// than `pixels` inside.
fn wrong(file: &Forest, camera: &str, pixels: f64) -> f64 {
    let picture_request = request(camera, [320, 240]);
    let view = PictureScene::choose(file, &picture_request).unwrap().view;
    let hull = corners().map(|corner| {
        let p = view.view_from_world() * (corner - view.eye);
        let scale = view.focal_px() / -p.z;
        DVec2::new(160.0 + p.x * scale, 120.0 - p.y * scale)
    });
    let (drawn, _) = draw(file, &picture_request, &Silent).unwrap();
    let is_wrong = |(i, depth): (usize, &f32)| {
        let place = DVec2::new((i % 320) as f64 + 0.5, (i / 320) as f64 + 0.5);
        let out = outside(place, &hull);
        out > pixels && depth.is_finite() || out < -pixels && !depth.is_finite()
    };
    let wrong = drawn.depth.iter().enumerate().filter(|&p| is_wrong(p)).count();
    wrong as f64 / drawn.depth.len() as f64
}

/// Views in which no face is seen edge-on; and some in which one is, where the low-pass filter
/// reaches the edge from splats without lines.
const CAMERAS: [&str; 3] = [
    "direction=0.6,0.3,1;fovy=25",
    "direction=1,0.3,0.9;fovy=30",
    "direction=-0.6,-0.8,-0.9;fovy=25",
];
const FLAT: [&str; 3] = [
    "direction=-1,1.4,-0.9;fovy=40",
    "direction=0.4,-1,0.3;fovy=25",
    "direction=1,0.8,-0.1;fovy=70",
];

#[test]
fn a_cube_with_given_lines_has_its_outline_to_half_a_pixel() {
    built("synthetic:cube:3500", false, |file| {
        assert!(file.has(PlaneKind::ClipLines));
        for camera in CAMERAS {
            assert_eq!(wrong(file, camera, 0.5), 0.0, "{camera}");
        }
        for camera in FLAT {
            let share = wrong(file, camera, 0.5);
            assert!(share < 1e-3, "{camera}: {share}");
        }
    });
}

#[test]
fn edges_are_found_from_positions_alone() {
    built("synthetic:cube:3500", true, |file| {
        for camera in CAMERAS.into_iter().chain(FLAT) {
            let share = wrong(file, camera, 1.0);
            assert!(share < 1e-3, "{camera}: {share}");
        }
    });
}

#[test]
fn a_session_draws_clip_lines_as_a_picture_does() {
    built("synthetic:csg:6400", false, |file| {
        let picture_request = request("direction=-0.8,1.3,-0.9;fovy=30", [160, 120]);
        let view = PictureScene::choose(file, &picture_request).unwrap().view;
        let (expected, _) = draw(file, &picture_request, &Silent).unwrap();
        let clipped = |method| {
            let file = Arc::new(Forest::open(file.path()).unwrap());
            let backend = Backend::Cpu;
            let size = [160, 120];
            let settings = Settings {
                method,
                target_spacing_px: 0.0,
                occlusion: false,
                ..Settings::default()
            };
            let options = Options { settings, backend, size, ..Options::default() };
            let mut session = Session::open(file, options).unwrap();
            let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
            let slots = cut.nodes.iter().filter_map(|n| n.slot(PlaneKind::ClipLines)).count();
            session.frame(&view).unwrap();
            (slots, session.picture().unwrap())
        };
        let (slots, streamed) = clipped(Method::Ewa);
        assert!(slots > 0, "the plane is streamed");
        assert_eq!(clipped(Method::PullPush).0, 0, "pull-push does not stream the plane");
        let flip = mean_flip(&streamed.rgba, &expected.rgba, 160);
        assert!(flip < 0.002, "{flip}");
    });
}

#[test]
fn splats_have_their_golden_pictures() {
    let bless = std::env::var_os("ESKER_BLESS").is_some();
    let camera = "direction=-0.8,1.3,-0.9;fovy=30";
    for (found, name) in [(false, "splats-csg.png"), (true, "splats-csg-found.png")] {
        built("synthetic:csg:6400", found, |file| {
            let (drawn, _): (Picture, _) =
                draw(file, &request(camera, [160, 120]), &Silent).unwrap();
            let path = std::path::absolute("tests/golden").unwrap().join(name);
            if bless {
                picture::write_png(&drawn, &path).unwrap();
            }
            let flip = mean_flip(&drawn.rgba, &read_png(&path), 160);
            assert!(
                flip <= 0.01,
                "{name}: FLIP {flip}; if this is intended, run with ESKER_BLESS=1 and look at the picture"
            );
        });
    }
}
