//! The same scan in another unit, place, step or order, or seen along the same line, gives the same
//! picture by every method: twins of renderers share their mistakes, relations do not.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
#[cfg(feature = "light")]
use esker_engine::light::settings::LightSettings;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Dots, Filter, Forest, Method, NormalsMode, Picture, PointSize};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth};
use esker_render::inputs::colour::{Encoder, linear};
use esker_truth::flip::mean_flip;
use given::{Given, given};
use glam::{DVec3, Vec3};
use std::path::Path;

const SIZE: [u32; 2] = [240, 160];
/// Number of points.
const POINTS: u64 = 30_000;
/// Step of the scan, its unit a metre.
const STEP: f64 = 0.001;

/// Integer coordinates of a point, steps of a millimetre: a hill, a house and a ball in the air,
/// without a symmetry.
fn place(i: u64) -> [i32; 3] {
    let share = |k: f64| (i as f64 * k).fract();
    let (u, v) = (share(0.754_877_666), share(0.569_840_291));
    let at = match i % 6 {
        0 => {
            let (z, turn) = (2.0 * u - 1.0, v * std::f64::consts::TAU);
            let side = (1.0 - z * z).sqrt();
            [3.1 + side * turn.cos(), -2.2 + side * turn.sin(), 4.0 + z]
        }
        1 => [1.0 + 3.0 * u, 1.7, 2.5 * v],
        2 => [4.0, 1.7 + 2.0 * u, 2.5 * v],
        _ => {
            let (x, y) = (16.0 * u - 8.0, 12.0 * v - 6.0);
            [x, y, 0.6 * (x * 0.7).sin() + 0.4 * (y * 0.9).cos() - 1.0]
        }
    };
    at.map(|c| (c * 1000.0).round() as i32)
}

/// Colours of a point: broad stripes on the ground, other colours elsewhere.
fn colour(i: u64, channel: u64) -> u64 {
    let [x, y, _] = place(i);
    let stripe = u64::from((x.div_euclid(1500) + y.div_euclid(1500)) % 2 == 0);
    match i % 6 {
        0 => [200, 60, 40][channel as usize],
        1 | 2 => [120, 130, 160][channel as usize],
        _ => [70 + 90 * stripe, 120 + 60 * stripe, 60 + 20 * stripe][channel as usize],
    }
}

/// The scan with its points in the order that `order` gives, moved and scaled by `to`.
fn scan(step: f64, order: impl Fn(u64) -> u64, to: impl Fn([i32; 3]) -> [i32; 3]) -> Given {
    let positions = (0..POINTS).map(|i| to(place(order(i)))).collect();
    let mut scan = given("scan", [step; 3], positions);
    for (name, channel) in [("red", 0), ("green", 1), ("blue", 2)] {
        scan = scan.with(name, AttrType::U16, |i| colour(order(i), channel));
    }
    scan.coloured(ColourDepth::Eight)
}

fn plain() -> Given {
    scan(STEP, |i| i, |p| p)
}

fn built(scans: &[Given], folder: &Path) -> Forest {
    // Cells of other sides give other normals.
    built_with(scans, folder, NormalsMode::None)
}

fn built_with(scans: &[Given], folder: &Path, normals: NormalsMode) -> Forest {
    let out = folder.join("scan.esker");
    let options = esker_builder::Options { node_capacity: 4096, normals, ..Default::default() };
    let sources = scans.iter().map(Given::boxed).collect();
    esker_builder::build_sources(sources, &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

/// How the scan is drawn.
fn styles() -> [(Method, Dots); 6] {
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 1.0 };
    let none = Dots::default();
    [
        (Method::PullPush, none),
        (Method::Auto, none),
        (Method::Ewa, none),
        (Method::Points, none),
        (Method::Points, dots),
        (Method::Lit, none),
    ]
}

fn request(camera: &str, (method, dots): (Method, Dots)) -> PictureRequest {
    PictureRequest {
        size: SIZE,
        method,
        dots,
        camera: Camera::parse(camera).unwrap(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    }
}

/// A camera whose numbers have few bits, so that moving and scaling it is exact.
fn camera(unit: f64, offset: [f64; 3], reach: f64) -> String {
    let eye = [-9.5, -11.25, 6.5];
    let along = [10.0, 11.0, -6.0];
    let at = |share: f64| [0, 1, 2].map(|i| (eye[i] + along[i] * share) * unit + offset[i]);
    let text = |p: [f64; 3]| format!("{:?},{:?},{:?}", p[0], p[1], p[2]);
    format!("eye={};target={};fovy=50", text(at(0.0)), text(at(reach)))
}

fn pictures(file: &Forest, camera: &str) -> Vec<Picture> {
    styles().into_iter().map(|s| draw(file, &request(camera, s), &Silent).unwrap().0).collect()
}

fn covers_enough(pictures: &[Picture]) {
    for picture in pictures {
        let covered = picture.depth.iter().filter(|d| d.is_finite()).count();
        assert!(covered * 8 > picture.depth.len(), "{covered} pixels are covered");
    }
}

fn flips(a: &[Picture], b: &[Picture]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| mean_flip(&a.rgba, &b.rgba, SIZE[0] as usize)).collect()
}

#[test]
fn the_unit_does_not_change_a_bit() {
    let folder = tempfile::tempdir().unwrap();
    let want = pictures(&built(&[plain()], folder.path()), &camera(1.0, [0.0; 3], 1.0));
    covers_enough(&want);
    for log2 in [-20, 20, 40] {
        let unit = 2f64.powi(log2);
        let file = built(&[scan(STEP * unit, |i| i, |p| p)], folder.path());
        let other = pictures(&file, &camera(unit, [0.0; 3], 1.0));
        for ((a, b), style) in want.iter().zip(&other).zip(styles()) {
            assert!(a.rgba == b.rgba, "unit 2^{log2}, {style:?}");
        }
    }
}

#[test]
fn the_offset_does_not_change_a_bit() {
    let folder = tempfile::tempdir().unwrap();
    // With a step of a power of two, coordinates are exact at any offset.
    let step = 2f64.powi(-10);
    let build = |offset: [f64; 3]| built(&[scan(step, |i| i, |p| p).at(offset)], folder.path());
    let want = pictures(&build([0.0; 3]), &camera(1.0, [0.0; 3], 1.0));
    covers_enough(&want);
    for offset in [[500_000.0, 5_400_000.0, 250.0], [-1e9, 3e9, 64.0]] {
        let other = pictures(&build(offset), &camera(1.0, offset, 1.0));
        for ((a, b), style) in want.iter().zip(&other).zip(styles()) {
            assert!(a.rgba == b.rgba, "offset {offset:?}, {style:?}");
        }
    }
}

#[test]
fn the_order_of_points_and_files_does_not_change_a_bit() {
    let folder = tempfile::tempdir().unwrap();
    let view = camera(1.0, [0.0; 3], 1.0);
    let want = pictures(&built(&[plain()], folder.path()), &view);
    // A permutation: the factor has no divisor in common with the number of points.
    let shuffled = scan(STEP, |i| i * 7919 % POINTS, |p| p);
    let half = |keeps: fn(usize) -> bool, name: &str| {
        let all = plain();
        let kept = |k: &usize| keeps(*k);
        let mut part = given(
            name,
            [STEP; 3],
            (0..POINTS as usize).filter(kept).map(|k| all.positions[k]).collect(),
        );
        let numbers: Vec<u64> = (0..POINTS).filter(|&k| keeps(k as usize)).collect();
        for (name, channel) in [("red", 0), ("green", 1), ("blue", 2)] {
            part = part.with(name, AttrType::U16, |i| colour(numbers[i as usize], channel));
        }
        part.coloured(ColourDepth::Eight)
    };
    let halves = [half(|k| k % 3 == 0, "b"), half(|k| k % 3 != 0, "a")];
    for (what, scans) in [("shuffled", &[shuffled][..]), ("two files", &halves)] {
        let other = pictures(&built(scans, folder.path()), &view);
        for ((a, b), style) in want.iter().zip(&other).zip(styles()) {
            assert!(a.rgba == b.rgba, "{what}, {style:?}");
        }
    }
}

#[test]
fn a_finer_step_has_the_same_picture() {
    let folder = tempfile::tempdir().unwrap();
    let view = camera(1.0, [0.0; 3], 1.0);
    let own = built(&[plain()], folder.path());
    let want = pictures(&own, &view);
    let fine = built(&[scan(STEP / 10.0, |i| i, |p| p.map(|c| c * 10))], folder.path());
    let other = pictures(&fine, &view);
    same_plan(&own, &fine, &view);
    // What moving the scan by some steps changes.
    let by = |steps: i32| {
        let moved = built(&[scan(STEP, |i| i, |p| p.map(|c| c + steps))], folder.path());
        let offset = [f64::from(steps) * STEP; 3];
        flips(&want, &pictures(&moved, &camera(1.0, offset, 1.0)))
    };
    // Other points are in the sample, since cells begin elsewhere.
    let floor = by(777);
    for ((flip, floor), style) in flips(&want, &other).into_iter().zip(floor).zip(styles()) {
        assert!(flip <= 1.3 * floor + 0.01, "{style:?}: {flip}, another sample {floor}");
    }
}

#[test]
fn a_turn_of_scan_and_camera_does_not_change_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let unlit = |s: (Method, Dots)| PictureRequest { shines: false, ..request("", s) };
    let draw_all = |file: &Forest, camera: &str| -> Vec<Picture> {
        let request = |s| PictureRequest { camera: Camera::parse(camera).unwrap(), ..unlit(s) };
        styles().into_iter().map(|s| draw(file, &request(s), &Silent).unwrap().0).collect()
    };
    let file = built(&[plain()], folder.path());
    let want = draw_all(&file, "eye=-9.5,-11.25,6.5;target=0.5,-0.25,0.5;fovy=50");
    let file = built(&[scan(STEP, |i| i, |[x, y, z]| [-y, x, z])], folder.path());
    let turned = draw_all(&file, "eye=11.25,-9.5,6.5;target=0.25,0.5,0.5;fovy=50");
    // Other points are in the sample, since cells begin elsewhere.
    let moved = built(&[scan(STEP, |i| i, |p| p.map(|c| c + 777))], folder.path());
    let elsewhere = draw_all(&moved, "eye=-8.723,-10.473,7.277;target=1.277,0.527,1.277;fovy=50");
    let floor = flips(&want, &elsewhere);
    for ((flip, floor), style) in flips(&want, &turned).into_iter().zip(floor).zip(styles()) {
        if style.0 == Method::Lit {
            // The sun does not turn.
            continue;
        }
        assert!(flip <= 1.3 * floor + 0.01, "{style:?}: {flip}, another sample {floor}");
    }
}

#[test]
fn the_distance_of_the_target_does_not_change_a_bit() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[plain()], folder.path());
    let want = pictures(&file, &camera(1.0, [0.0; 3], 1.0));
    // Powers of two keep the direction exact.
    for reach in [2f64.powi(-8), 8.0, 2f64.powi(20)] {
        let other = pictures(&file, &camera(1.0, [0.0; 3], reach));
        for ((a, b), style) in want.iter().zip(&other).zip(styles()) {
            let off = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
            let off = off.filter(|(a, b)| a != b).count();
            assert!(off * 1000 <= a.depth.len(), "{off} pixels, reach {reach}, {style:?}");
        }
    }
}

/// Pixels that differ by more than 2 of 255 in a channel.
fn changed(a: &Picture, b: &Picture) -> usize {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 2);
    let pairs = a.rgba.as_chunks::<4>().0.iter().zip(b.rgba.as_chunks::<4>().0);
    pairs.filter(|&pair| differs(pair)).count()
}

/// A camera `times` as far from the scan as the usual one.
fn farther(times: f64) -> String {
    let eye = [0.5 - 10.0 * times, -0.25 - 11.0 * times, 0.5 + 6.0 * times];
    format!("eye={:?},{:?},{:?};target=0.5,-0.25,0.5;fovy=50", eye[0], eye[1], eye[2])
}

#[test]
fn passes_come_and_go_without_a_change_of_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::None, NormalsMode::Fast] {
        let file = built_with(&[plain()], folder.path(), normals);
        let (mut found, mut all) = (0, Vec::new());
        for target_spacing_px in [0.0, 0.7] {
            let request = |times: f64| PictureRequest {
                target_spacing_px,
                shines: false,
                ..request(&farther(times), (Method::PullPush, Dots::default()))
            };
            let passes = |t: f64| PictureScene::choose(&file, &request(t)).unwrap().plan.passes;
            let steps: Vec<f64> = (0..60).map(|i| 0.3 * 1.08f64.powi(i)).collect();
            for pair in steps.windows(2) {
                let [mut near, mut far] = [pair[0], pair[1]];
                let before = passes(near);
                if before == passes(far) {
                    continue;
                }
                while far - near > 1e-6 * near {
                    let middle = 0.5 * (near + far);
                    *(if passes(middle) == before { &mut near } else { &mut far }) = middle;
                }
                let [a, b] = [near, far].map(|t| draw(&file, &request(t), &Silent).unwrap().0);
                all.push((before, passes(far), changed(&a, &b)));
                found += 1;
            }
        }
        println!("{normals:?}: {all:#?}");
        assert!(found >= 2, "{normals:?}: only {found} changes of passes");
        for (before, after, pixels) in all {
            assert!(pixels * 100 <= 240 * 160, "{normals:?}: {pixels}, {before:?} to {after:?}");
        }
    }
}

#[test]
fn a_view_that_moves_by_a_millionth_keeps_its_picture() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::None, NormalsMode::Fast] {
        let file = built_with(&[plain()], folder.path(), normals);
        for times in [0.4, 0.9, 1.7, 5.0] {
            let [a, b] = [times, times * (1.0 + 1e-6)].map(|t| pictures(&file, &farther(t)));
            for ((a, b), style) in a.iter().zip(&b).zip(styles()) {
                let pixels = changed(a, b);
                assert!(pixels * 100 <= a.depth.len(), "{style:?}, {normals:?}, {times}: {pixels}");
            }
        }
    }
}

/// A wall with a chequered pattern, in its own plane z = 0.
fn chequers() -> Given {
    let place = |i: u64| {
        let share = |k: f64| (i as f64 * k).fract();
        let (u, v) = (share(0.754_877_666), share(0.569_840_291));
        [((u - 0.5) * 6000.0) as i32, ((v - 0.5) * 4000.0) as i32, 0]
    };
    let mut scan = given("scan", [STEP; 3], (0..POINTS).map(place).collect());
    let is_dark = |i: u64| {
        let [x, y, _] = place(i);
        (x.div_euclid(500) + y.div_euclid(500)) % 2 == 0
    };
    for (name, light, dark) in [("red", 210, 40), ("green", 190, 60), ("blue", 120, 150)] {
        scan = scan.with(name, AttrType::U16, |i| if is_dark(i) { dark } else { light });
    }
    scan.coloured(ColourDepth::Eight)
}

#[test]
fn a_wall_looks_the_same_from_farther_away_through_a_narrower_field_of_view() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::None, NormalsMode::Fast] {
        let file = built_with(&[chequers()], folder.path(), normals);
        let at = |distance: f64| {
            let fovy = 2.0 * (1.6 / distance).atan().to_degrees();
            let camera =
                format!("eye=0.1,0.2,{distance:?};target=0.1,0.2,0;up=0,1,0;fovy={fovy:?}");
            let wanted = |s| PictureRequest { shines: false, ..request(&camera, s) };
            let drawn = styles().map(|s| draw(&file, &wanted(s), &Silent).unwrap().0);
            covers_enough(&drawn);
            drawn
        };
        let near = at(4.0);
        for distance in [16.0, 400.0] {
            for (flip, style) in flips(&near, &at(distance)).iter().zip(styles()) {
                if style.0 == Method::Lit && normals == NormalsMode::None {
                    // Points without normals are lit as if they faced the ray.
                    continue;
                }
                println!("{normals:?}, {style:?}, {distance}: {flip}");
                assert!(*flip < 0.03, "{normals:?}, {style:?}, {distance}: {flip}");
            }
        }
    }
}

/// The plan of a frame does not depend on the step of coordinates, in crowded views either.
fn same_plan(file: &Forest, other: &Forest, camera: &str) {
    for target_spacing_px in [1.0, 0.9, 0.7, 0.3, 0.0] {
        let style = (Method::PullPush, Dots::default());
        let request = PictureRequest { target_spacing_px, ..request(camera, style) };
        let plans = [file, other].map(|f| PictureScene::choose(f, &request).unwrap().plan);
        assert_eq!(plans[0].passes, plans[1].passes, "{target_spacing_px}");
        let [a, b] = plans.map(|plan| plan.crowding());
        assert!((a - b).abs() < 0.05, "{target_spacing_px}: {a}, {b}");
    }
}

/// Pictures of all points, without highlights, which move with the eye.
fn all_points(file: &Forest, camera: &str) -> Vec<Picture> {
    let wanted = |s| PictureRequest { target_spacing_px: 0.0, shines: false, ..request(camera, s) };
    styles().into_iter().map(|s| draw(file, &wanted(s), &Silent).unwrap().0).collect()
}

/// A parallel camera that looks down at an angle; its picture is `along` pixels to the right.
fn parallel_camera(along: f64) -> String {
    // The picture is 10 units high, 16 pixels a unit; right is along (11, -10, 0).
    let by = along / 16.0 / 221f64.sqrt();
    let eye = [-9.5 + 11.0 * by, -11.25 - 10.0 * by, 6.5];
    format!("eye={:?},{:?},{:?};direction=10,11,-6;ortho=10", eye[0], eye[1], eye[2])
}

#[test]
fn a_parallel_view_shows_points_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[plain()], folder.path());
    let style = (Method::Points, Dots::default());
    let wanted = PictureRequest { target_spacing_px: 0.0, ..request(&parallel_camera(0.0), style) };
    let picture = draw(&file, &wanted, &Silent).unwrap().0;
    // Right, up and forward of the camera, from its direction.
    let right = [11.0, -10.0, 0.0].map(|c| c / 221f64.sqrt());
    let forward = [10.0, 11.0, -6.0].map(|c| c / 257f64.sqrt());
    let up = [
        right[1] * forward[2] - right[2] * forward[1],
        right[2] * forward[0] - right[0] * forward[2],
        right[0] * forward[1] - right[1] * forward[0],
    ];
    let [width, height] = SIZE.map(|side| side as usize);
    let mut nearest = vec![f64::INFINITY; width * height];
    let (mut seen, mut borders) = (0, 0);
    for i in 0..POINTS {
        let from_eye = [0, 1, 2].map(|k| f64::from(place(i)[k]) * STEP - [-9.5, -11.25, 6.5][k]);
        let along = |axis: [f64; 3]| (0..3).map(|k| axis[k] * from_eye[k]).sum::<f64>();
        let (x, y) = (120.0 + 16.0 * along(right), 80.0 - 16.0 * along(up));
        if x < 0.0 || y < 0.0 || x >= 240.0 || y >= 160.0 {
            continue;
        }
        // Positions are rounded to single precision.
        let is_border = [x, y].iter().any(|c| (c - c.round()).abs() < 1e-3);
        borders += usize::from(is_border);
        let pixel = y as usize * width + x as usize;
        nearest[pixel] = nearest[pixel].min(along(forward));
        seen += 1;
    }
    let differs = |(&a, &b): (&f64, &f32)| a.is_finite() != b.is_finite();
    let off = nearest.iter().zip(&picture.depth).filter(|&pair| differs(pair)).count();
    assert!(seen > POINTS as usize / 2 && borders * 50 < seen, "{seen}, {borders}");
    assert!(off <= 2 * borders, "{off} pixels of {seen} points, {borders} on a border");
}

#[test]
fn a_parallel_picture_moves_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[plain()], folder.path());
    let all = |camera: &str| all_points(&file, camera);
    let (width, by) = (SIZE[0] as usize, 24);
    // Columns that both pictures have, without the outermost ones: surfaces are open there.
    let part = |picture: &Picture, first: usize| -> Vec<u8> {
        let rows = picture.rgba.chunks_exact(4 * width);
        let columns = 4 * (first + 16)..4 * (first + width - by - 16);
        rows.flat_map(|row| row[columns.clone()].to_vec()).collect()
    };
    let (here, there) = (all(&parallel_camera(0.0)), all(&parallel_camera(by as f64)));
    covers_enough(&here);
    for ((a, b), style) in here.iter().zip(&there).zip(styles()) {
        let flip = mean_flip(&part(a, by), &part(b, 0), width - by - 32);
        // The noise of light is another in each pixel.
        let most = if style.0 == Method::Lit { 0.04 } else { 0.004 };
        assert!(flip < most, "{style:?}: {flip}");
    }
}

/// A pinhole so far away that its rays are parallel.
#[test]
fn a_distant_pinhole_sees_what_a_parallel_view_does() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&[plain()], folder.path());
    let all = |camera: &str| all_points(&file, camera);
    let parallel = all("direction=10,11,-6;target=0.5,-0.25,0.5;ortho=12");
    covers_enough(&parallel);
    // 12 units high at the target, from 5,000 units away.
    let far = 5_000.0 / 257f64.sqrt();
    let eye = [0.5 - 10.0 * far, -0.25 - 11.0 * far, 0.5 + 6.0 * far];
    let fovy = 2.0 * (6.0f64 / 5_000.0).atan().to_degrees();
    let pinhole = all(&format!(
        "eye={:?},{:?},{:?};target=0.5,-0.25,0.5;fovy={fovy:?}",
        eye[0], eye[1], eye[2]
    ));
    for ((flip, picture), style) in flips(&parallel, &pinhole).iter().zip(&parallel).zip(styles()) {
        println!("{style:?}: {flip}");
        assert!(*flip < 0.03, "{style:?}: {flip} of {}", picture.depth.len());
    }
}

/// A picture of half the width and height: means of 2 x 2 pixels in linear light.
fn halved(picture: &Picture) -> Vec<u8> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let at = |x: usize, y: usize| -> [u8; 3] {
        let i = 4 * (y * width + x);
        [picture.rgba[i], picture.rgba[i + 1], picture.rgba[i + 2]]
    };
    let mean = |x: usize, y: usize| {
        let parts = [(0, 0), (1, 0), (0, 1), (1, 1)];
        let sum: Vec3 = parts.iter().map(|(i, j)| linear(at(2 * x + i, 2 * y + j))).sum();
        let [r, g, b] = Encoder::get().bytes(sum * 0.25);
        [r, g, b, 255]
    };
    (0..height / 2).flat_map(|y| (0..width / 2).flat_map(move |x| mean(x, y))).collect()
}

/// The relations that need no other scan, on real scans at a larger size; and what a picture of
/// twice the size, reduced, differs by, method by method.
#[test]
#[ignore = "takes minutes: cargo xtask relations"]
fn real_scans_keep_the_relations() {
    let data = std::env::var_os("ESKER_DATA").expect("ESKER_DATA names a folder of scans");
    let size = [720, 480];
    for name in ["topography", "indoor", "example-outcrop", "mixed-conifer"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scan.esker");
        let scan = Path::new(&data).join(format!("laz/{name}.laz"));
        esker_builder::build(&[scan], &out, &Default::default(), &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        let [low, high] = esker_engine::calls::info::fitted_bounds(&file).map(DVec3::from_array);
        let (centre, reach) = (low.midpoint(high), (high - low).length());
        let forward = DVec3::new(10.0, 11.0, -6.0).normalize_or_zero();
        let text = |p: DVec3| format!("{:?},{:?},{:?}", p.x, p.y, p.z);
        let all = |camera: &str, size: [u32; 2]| -> Vec<Picture> {
            let wanted = |s| PictureRequest { size, shines: false, ..request(camera, s) };
            styles().into_iter().map(|s| draw(&file, &wanted(s), &Silent).unwrap().0).collect()
        };
        let eye = centre - forward * reach;
        let looks_at =
            |along: f64| format!("eye={};target={}", text(eye), text(eye + forward * along));
        let [near, far, large] = [(reach, size), (reach * 1e6, size), (reach, size.map(|s| 2 * s))]
            .map(|(along, size)| all(&looks_at(along), size));
        let parallel = all(
            &format!("target={};direction={};ortho={reach}", text(centre), text(forward)),
            size,
        );
        let fovy = 2.0 * (0.5f64 / 5e3).atan().to_degrees();
        let distant = centre - forward * reach * 5e3;
        let distant =
            all(&format!("eye={};target={};fovy={fovy:?}", text(distant), text(centre)), size);
        for (k, style) in styles().into_iter().enumerate() {
            let flip = |a: &[u8], b: &[u8]| mean_flip(a, b, size[0] as usize);
            let moved = flip(&near[k].rgba, &far[k].rgba);
            let flat = flip(&parallel[k].rgba, &distant[k].rgba);
            let reduced = flip(&near[k].rgba, &halved(&large[k]));
            println!(
                "{name}, {style:?}: target {moved:.4}, parallel {flat:.4}, reduced {reduced:.4}"
            );
            assert!(moved < 0.005 && flat < 0.05, "{name}, {style:?}: {moved}, {flat}");
        }
    }
}

/// The scan in degrees around a place, its steps about a tenth of a millimetre; and the text of a
/// place in metres in its coordinates.
fn in_degrees(latitude: f64) -> (Given, impl Fn([f64; 3]) -> String) {
    let steps = [1e-9, 1e-9, STEP];
    let factor = esker_scan::Geographic::of("", Some("degree")).unwrap().metres(latitude);
    let offset = [8.5, latitude, 0.0];
    let to = move |p: [i32; 3]| {
        [0, 1, 2].map(|i| (f64::from(p[i]) * STEP / factor[i] / steps[i]).round() as i32)
    };
    let mut degrees = scan(STEP, |i| i, to);
    degrees.info.grid.grid.scale = steps;
    degrees.info.crs = Some("EPSG:4326".parse().unwrap());
    let text = move |p: [f64; 3]| {
        let at = [0, 1, 2].map(|i| p[i] / factor[i] + offset[i]);
        format!("{:?},{:?},{:?}", at[0], at[1], at[2])
    };
    (degrees.at(offset), text)
}

#[test]
fn a_scan_in_degrees_has_the_picture_of_its_projected_copy() {
    let folder = tempfile::tempdir().unwrap();
    let want = pictures(&built(&[plain()], folder.path()), &camera(1.0, [0.0; 3], 1.0));
    covers_enough(&want);
    // Other points are in the sample, since cells have other sides.
    let moved = built(&[scan(STEP, |i| i, |p| p.map(|c| c + 777))], folder.path());
    let floor = flips(&want, &pictures(&moved, &camera(1.0, [777.0 * STEP; 3], 1.0)));
    for latitude in [0.0, 47.0, -80.0] {
        let (degrees, text) = in_degrees(latitude);
        let file = built(&[degrees], folder.path());
        assert!(file.lattice().is_scaled());
        let (eye, target) = (text([-9.5, -11.25, 6.5]), text([0.5, -0.25, 0.5]));
        let other = pictures(&file, &format!("eye={eye};target={target};fovy=50"));
        let each = flips(&want, &other).into_iter().zip(&floor).zip(styles());
        for ((flip, floor), style) in each {
            let message = format!("{latitude}, {style:?}: {flip}, another sample {floor}");
            assert!(flip <= 1.3 * floor + 0.01, "{message}");
        }
    }
}

#[test]
fn views_fitted_to_a_scan_in_degrees_are_those_of_its_projected_copy() {
    let folder = tempfile::tempdir().unwrap();
    let fitted = |file: &Forest| draw(file, &request("", styles()[0]), &Silent).unwrap();
    let (want, _) = fitted(&built(&[plain()], folder.path()));
    let (degrees, text) = in_degrees(47.0);
    let (other, report) = fitted(&built(&[degrees], folder.path()));
    let covered = |picture: &Picture| picture.depth.iter().filter(|d| d.is_finite()).count() as f64;
    assert!((covered(&other) / covered(&want) - 1.0).abs() < 0.05);
    // The eye is in the scan's coordinates, and no note says that the picture is distorted.
    let eye = report.camera.eye;
    assert!((eye[0] - 8.5).abs() < 0.001 && (eye[1] - 47.0).abs() < 0.001, "{eye:?}");
    assert!(report.notes.iter().all(|note| !note.contains("degrees")), "{:?}", report.notes);
    // Drawn from there, it is the same picture.
    let [eye, along] = [report.camera.eye, report.camera.forward]
        .map(|v| format!("{:?},{:?},{:?}", v[0], v[1], v[2]));
    let camera = format!("eye={eye};direction={along}");
    let (degrees, _) = in_degrees(47.0);
    let file = built(&[degrees], folder.path());
    let (again, _) = draw(&file, &request(&camera, styles()[0]), &Silent).unwrap();
    let flip = mean_flip(&other.rgba, &again.rgba, SIZE[0] as usize);
    assert!(flip < 0.005, "{flip}");
    // A box in the scan's coordinates chooses the points that it chooses of the copy.
    let corners = |low: String, high: String| format!("{low},{high}").parse().unwrap();
    let drawn = |file: &Forest, filter: Filter| {
        let request = PictureRequest { filter, ..request("", styles()[2]) };
        draw(file, &request, &Silent).unwrap().1.points_drawn as f64
    };
    let boxed = |bounds| Filter { bounds: Some(bounds), ..Filter::default() };
    let ours = drawn(&file, boxed(corners(text([-2.0, -3.0, -9.0]), text([4.5, 2.5, 9.0]))));
    let copies = tempfile::tempdir().unwrap();
    let copy = built(&[plain()], copies.path());
    let theirs = drawn(&copy, boxed(corners("-2,-3,-9".into(), "4.5,2.5,9".into())));
    assert!(ours > 1000.0 && (ours / theirs - 1.0).abs() < 0.01, "{ours} {theirs}");
    // Sizes and turns of clips are in metres.
    for shape in ["size=7,5,9;rotation=30,10,0", "size=7,5,9;rotation=30,10,0;keep=outside"] {
        let clipped = |centre: String| Filter {
            clips: vec![format!("centre={centre};{shape}").parse().unwrap()],
            ..Filter::default()
        };
        let ours = drawn(&file, clipped(text([1.0, -0.5, 0.0])));
        let theirs = drawn(&copy, clipped("1,-0.5,0".into()));
        assert!(ours > 1000.0 && (ours / theirs - 1.0).abs() < 0.01, "{shape}: {ours} {theirs}");
    }
}

#[cfg(feature = "light")]
#[test]
fn a_lamp_in_a_scan_in_degrees_lights_as_in_its_projected_copy() {
    let folder = tempfile::tempdir().unwrap();
    let lit = |file: &Forest, camera: &str, lamp: String| {
        let lights = Some(esker_engine::light::lights::parse(&format!("lamp:{lamp},30")).unwrap());
        let light = LightSettings { lights, exposure: Some(1.0), ..LightSettings::default() };
        let method = (Method::Lit, Dots::default());
        draw(file, &PictureRequest { light, ..request(camera, method) }, &Silent).unwrap().0
    };
    let place = [-1.5, -1.0, 2.5];
    let metres = |p: [f64; 3]| format!("{:?},{:?},{:?}", p[0], p[1], p[2]);
    let want = lit(&built(&[plain()], folder.path()), &camera(1.0, [0.0; 3], 1.0), metres(place));
    let by = 777.0 * STEP;
    let moved = built(&[scan(STEP, |i| i, |p| p.map(|c| c + 777))], folder.path());
    let moved = lit(&moved, &camera(1.0, [by; 3], 1.0), metres(place.map(|c| c + by)));
    let floor = mean_flip(&want.rgba, &moved.rgba, SIZE[0] as usize);
    let (degrees, text) = in_degrees(47.0);
    let (eye, target) = (text([-9.5, -11.25, 6.5]), text([0.5, -0.25, 0.5]));
    let view = format!("eye={eye};target={target};fovy=50");
    let other = lit(&built(&[degrees], folder.path()), &view, text(place));
    let flip = mean_flip(&want.rgba, &other.rgba, SIZE[0] as usize);
    assert!(flip <= 1.3 * floor + 0.01, "{flip}, another sample {floor}");
    // Another place is another picture.
    let file = built(&[in_degrees(47.0).0], folder.path());
    let elsewhere = lit(&file, &view, text([5.0, 4.0, 6.0]));
    let flip = mean_flip(&want.rgba, &elsewhere.rgba, SIZE[0] as usize);
    assert!(flip > 1.3 * floor + 0.02, "{flip}");
}
