//! Clips in pictures and exports: an upright clip is the box of the filter, clips move with the
//! unit and the place of the scene, and a clip and its complement share the points of a file.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, open_together};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Bounds, Clip, ClipShape, Filter, Forest, Method, NormalsMode, Picture};
use esker_points::MultisetHash;
use esker_points::task::Silent;
use given::{Given, given};
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [200, 140];
/// Number of points.
const POINTS: u64 = 30_000;
/// Step of the scan, of few bits, so that moving and scaling it is exact.
const STEP: f64 = 1.0 / 1024.0;
const METHODS: [Method; 4] = [Method::PullPush, Method::Ewa, Method::Points, Method::Lit];

/// A wavy ground with a tower, in steps.
fn place(i: u64) -> [i32; 3] {
    let share = |k: f64| (i as f64 * k).fract();
    let (u, v) = (share(0.754_877_666), share(0.569_840_291));
    let at = match i % 5 {
        0 => [1.0 + (u * std::f64::consts::TAU).cos(), (u * std::f64::consts::TAU).sin(), 4.0 * v],
        _ => {
            let (x, y) = (16.0 * u - 8.0, 12.0 * v - 6.0);
            [x, y, 0.6 * (x * 0.7).sin() + 0.4 * (y * 0.9).cos() - 1.0]
        }
    };
    at.map(|c| (c / STEP).round() as i32)
}

fn scan(step: f64, offset: [f64; 3]) -> Given {
    given("scan", [step; 3], (0..POINTS).map(place).collect()).at(offset)
}

fn built(scan: &Given, folder: &Path, name: &str) -> (PathBuf, Forest) {
    let out = folder.join(name);
    let options = esker_builder::Options {
        node_capacity: 512,
        normals: NormalsMode::None,
        ..Default::default()
    };
    esker_builder::build_sources(vec![scan.boxed()], &out, &options, &Silent).unwrap();
    let forest = Forest::open(&out).unwrap();
    (out, forest)
}

fn camera(unit: f64, offset: [f64; 3]) -> String {
    let at = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] * unit + offset[i]);
    let text = |[x, y, z]: [f64; 3]| format!("{x:?},{y:?},{z:?}");
    format!("eye={};target={};fovy=50", text(at([-9.5, -11.25, 6.5])), text(at([0.5, -0.25, 0.5])))
}

fn picture(file: &Forest, camera: &str, method: Method, filter: Filter) -> Picture {
    let request = PictureRequest {
        size: SIZE,
        method,
        camera: Camera::parse(camera).unwrap(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        filter,
        ..PictureRequest::default()
    };
    draw(file, &request, &Silent).unwrap().0
}

fn clipped<const N: usize>(clips: [Clip; N]) -> Filter {
    Filter { clips: clips.into(), ..Filter::default() }
}

fn oriented(centre: [f64; 3], size: [f64; 3], rotation: [f64; 3]) -> Clip {
    Clip::from(ClipShape::Oriented { centre, size, rotation })
}

fn covered(picture: &Picture) -> usize {
    picture.depth.iter().filter(|d| d.is_finite()).count()
}

#[test]
fn an_upright_clip_draws_the_picture_of_the_box() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = built(&scan(STEP, [0.0; 3]), folder.path(), "scan.esker");
    let bounds = Bounds { min: [-3.0, -4.5, -2.0], max: [5.0, 1.5, 3.0] };
    let by_box = Filter { bounds: Some(bounds), ..Filter::default() };
    let (centre, [x, y, z]) = ([1.0, -1.5, 0.5], [8.0, 6.0, 5.0]);
    for method in METHODS {
        let camera = camera(1.0, [0.0; 3]);
        let want = picture(&file, &camera, method, by_box.clone());
        let whole = picture(&file, &camera, method, Filter::default());
        assert!(covered(&want) > 2000 && want.rgba != whole.rgba, "{method:?}");
        for clip in [
            Clip::from(ClipShape::Box(bounds)),
            oriented(centre, [x, y, z], [0.0; 3]),
            oriented(centre, [y, x, z], [90.0, 0.0, 0.0]),
            oriented(centre, [z, y, x], [-180.0, 270.0, 0.0]),
        ] {
            let same = picture(&file, &camera, method, clipped([clip.clone()]));
            assert!(same.rgba == want.rgba && same.depth == want.depth, "{method:?}, {clip}");
        }
        // The view is fitted to what is left.
        let clip = clipped([Clip::from(ClipShape::Box(bounds))]);
        let fitted = [by_box.clone(), clip, Filter::default()]
            .map(|filter| picture(&file, "", method, filter).rgba);
        assert!(fitted[0] == fitted[1] && fitted[0] != fitted[2], "{method:?}");
    }
}

/// A turned box and a plane, scaled and moved.
fn clips(unit: f64, offset: [f64; 3]) -> [Clip; 2] {
    let at = |p: [f64; 3]| [0, 1, 2].map(|i| p[i] * unit + offset[i]);
    let size = [9.0, 5.5, 8.0].map(|length| length * unit);
    let plane = ClipShape::Plane { point: at([2.0, 0.5, 0.25]), normal: [0.4, -0.3, 1.0] };
    [oriented(at([0.5, -1.0, 0.0]), size, [30.0, 10.0, -5.0]), Clip::from(plane).inverted()]
}

#[test]
fn clips_move_with_the_unit_and_the_offset_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (_, file) = built(&scan(STEP, [0.0; 3]), folder.path(), "scan.esker");
    let want = METHODS.map(|method| {
        [0, 1].map(|i| {
            let clip = clips(1.0, [0.0; 3])[i].clone();
            picture(&file, &camera(1.0, [0.0; 3]), method, clipped([clip]))
        })
    });
    let all = [
        (1.0, [500_000.0, 5_400_000.0, 250.0]),
        (1.0, [-1e9, 3e9, 64.0]),
        (2f64.powi(-20), [0.0; 3]),
        (2f64.powi(20), [0.0; 3]),
    ];
    for (unit, offset) in all {
        let (_, file) = built(&scan(STEP * unit, offset), folder.path(), "moved.esker");
        for (method, want) in METHODS.into_iter().zip(&want) {
            for (clip, want) in clips(unit, offset).into_iter().zip(want) {
                let moved = picture(&file, &camera(unit, offset), method, clipped([clip]));
                assert!(covered(want) > 1000);
                assert!(moved.rgba == want.rgba, "{method:?}, unit {unit}, offset {offset:?}");
            }
        }
    }
    // A cloud with an offset: clips are in the coordinates of the scene.
    let (path, _) = built(&scan(STEP, [0.0; 3]), folder.path(), "cloud.esker");
    let offset = [100.0, -20.5, 3.0];
    let cloud = open_together(&[path], &[offset]).unwrap().unwrap();
    for (method, want) in METHODS.into_iter().zip(&want) {
        for (clip, want) in clips(1.0, offset).into_iter().zip(want) {
            let moved = picture(&cloud, &camera(1.0, offset), method, clipped([clip]));
            assert!(moved.rgba == want.rgba, "{method:?} of a cloud with an offset");
        }
    }
}

/// Number and hash of the points that are exported.
fn exported(file: &Forest, folder: &Path, clip: Clip) -> (u64, MultisetHash, u64) {
    let out = folder.join("out.las");
    match esker_builder::export(file, &out, &clipped([clip]), &Silent) {
        Ok(report) => (report.points_out, report.hash, report.nodes_read),
        Err(error) => {
            assert!(error.to_string().contains("is wanted"), "{error}");
            (0, MultisetHash::default(), 0)
        }
    }
}

#[test]
fn the_exports_of_a_clip_and_of_its_complement_are_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let offset = [1e6, 2e6, -3.0];
    let (_, file) = built(&scan(0.01, offset), folder.path(), "scan.esker");
    let footer = file.files().next().unwrap().footer();
    let wave = |i: u32, k: f64| (f64::from(i) * k).sin();
    for i in 0..24 {
        // Around a point, so that none is empty.
        let at = place(u64::from(i) * 1237);
        let centre = [0, 1, 2].map(|axis| f64::from(at[axis]) * 0.01 + offset[axis]);
        let angles = [1.1, 2.3, 0.4].map(|k| (wave(i, k) * 36.0).round() * 10.0);
        let clip = match i % 3 {
            0 => Clip::from(ClipShape::Plane {
                point: centre,
                normal: [wave(i + 1, 0.9), wave(i + 1, 1.7), wave(i + 1, 0.3)],
            }),
            _ => {
                oriented(centre, [70.0, 50.0, 40.0].map(|c| c * f64::from(i % 7 + 1) / 4.0), angles)
            }
        };
        let (inside, hash, read) = exported(&file, folder.path(), clip.clone());
        let (outside, mut rest, _) = exported(&file, folder.path(), clip.clone().inverted());
        rest += hash;
        assert_eq!((inside + outside, rest), (footer.points, footer.hash), "{clip}");
        assert!(inside > 0 && outside > 0, "{clip}: {inside} inside");
        // Nodes that are cut away are not read.
        if inside * 20 < footer.points {
            assert!(
                read * 3 < footer.nodes,
                "{clip}: {read} of {} nodes for {inside}",
                footer.nodes
            );
        }
    }
}
