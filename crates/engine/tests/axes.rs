//! Scans whose vertical is another axis than z: with the camera's `up` along it they have the
//! elevations, and so the pictures and the legends, of the scan with z up.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_engine::calls::render::{RenderReport, draw};
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Forest, Method, NormalsMode, Picture};
use esker_points::task::Silent;
use given::given;

const SIZE: [u32; 2] = [200, 140];
const POINTS: u64 = 20_000;
/// Step of the scan, its unit a metre.
const STEP: f64 = 0.001;

/// Moves a vector or point with z up to the axes of another scan; a turn, not a mirror.
type Turn = fn([f64; 3]) -> [f64; 3];

/// Scans with z, y, -y, x and -z up, and their `up`.
const TURNS: [(Turn, &str); 5] = [
    (|p| p, "elevation"),
    (|[x, y, z]| [y, z, x], "elevation along y"),
    (|[x, y, z]| [x, -z, y], "elevation along -y"),
    (|[x, y, z]| [z, x, y], "elevation along x"),
    (|[x, y, z]| [y, x, -z], "elevation along -z"),
];

/// A hill over 16 x 12 m, metres.
fn place(i: u64) -> [f64; 3] {
    let share = |k: f64| (i as f64 * k).fract();
    let (x, y) = (16.0 * share(0.754_877_666) - 8.0, 12.0 * share(0.569_840_291) - 6.0);
    [x, y, 2.0 + 1.5 * (x * 0.4).sin() + (y * 0.5).cos()]
}

fn built(turn: Turn) -> (Forest, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let steps = |i| turn(place(i)).map(|c| (c / STEP).round() as i32);
    let scan = given("scan", [STEP; 3], (0..POINTS).map(steps).collect());
    let out = folder.path().join("scan.esker");
    let options = esker_builder::Options { normals: NormalsMode::None, ..Default::default() };
    esker_builder::build_sources(vec![scan.boxed()], &out, &options, &Silent).unwrap();
    (Forest::open(&out).unwrap(), folder)
}

fn drawn(turn: Turn, file: &Forest, colour: &str) -> (Picture, RenderReport) {
    let text = |p: [f64; 3]| {
        let [x, y, z] = turn(p);
        format!("{x:?},{y:?},{z:?}")
    };
    let (eye, target, up) = ([-9.5, -11.25, 9.5], [0.5, -0.25, 1.5], [0.0, 0.25, 1.0]);
    let camera = format!("eye={};target={};up={}", text(eye), text(target), text(up));
    let request = PictureRequest {
        size: SIZE,
        method: Method::Points,
        camera: Camera::parse(&camera).unwrap(),
        target_spacing_px: 0.0,
        colour_by: Some(colour.to_owned()),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    };
    draw(file, &request, &Silent).unwrap()
}

/// Pixels that differ: rounding moves a point to the next pixel now and then.
fn different(a: &Picture, b: &Picture) -> usize {
    let pairs = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
    pairs.filter(|(a, b)| a != b).count()
}

#[test]
fn elevations_follow_the_up_of_the_camera() {
    let (upright, _folder) = built(TURNS[0].0);
    let want = drawn(TURNS[0].0, &upright, "elevation:0.5..4");
    assert!(want.1.pixels_covered > 5_000, "{}", want.1.pixels_covered);
    let fitted = drawn(TURNS[0].0, &upright, "elevation").1.colour.range.unwrap();
    for (turn, name) in TURNS {
        let (file, _folder) = built(turn);
        let (picture, report) = drawn(turn, &file, "elevation:0.5..4");
        assert_eq!((report.colour.name.as_str(), report.colour.range), (name, want.1.colour.range));
        let off = different(&picture, &want.0);
        assert!(off <= 10, "{name}: {off} pixels differ");
        // Ranges are estimated from the boxes of nodes, which are others.
        let range = drawn(turn, &file, "height").1.colour.range.unwrap();
        let off = [0, 1].map(|end| (range[end] - fitted[end]).abs());
        assert!(off.iter().all(|&off| off < 0.1), "{name}: {range:?} instead of {fitted:?}");
    }
}

#[test]
fn axes_are_named_whatever_is_up() {
    let (turn, _) = TURNS[2];
    let (file, _folder) = built(turn);
    let by = |colour: &str| drawn(turn, &file, colour);
    let elevation = by("elevation:1..3").0;
    // Elevation is -y, so y is the same range from the other end.
    let (picture, report) = by("y:-3..-1");
    assert_eq!((report.colour.name.as_str(), report.colour.range), ("y", Some([-3.0, -1.0])));
    assert!(different(&picture, &elevation) > 2_000);
    let ranges = ["x", "z"].map(|axis| by(axis).1.colour.range.unwrap());
    for (range, half) in ranges.into_iter().zip([8.0, 6.0]) {
        assert!((range[0] + half).abs() < 0.3 && (range[1] - half).abs() < 0.3, "{range:?}");
    }
}
