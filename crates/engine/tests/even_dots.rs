//! Dots of method *points* are as dense as the target spacing asks, and evenly so across the
//! borders of nodes and levels: the density of a generated surface of even density, seen from above
//! and obliquely, has no steps.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_builder::{NormalsMode, Options, build_sources};
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Forest, Method};
use esker_points::task::Silent;
use given::given;

/// Points along a side of the surface; they are a unit apart.
const SIDE: usize = 800;
/// Length of a step, units.
const STEP: f64 = 1e-3;
/// Width and height of the pictures, pixels.
const SIZE: u32 = 900;
/// Field of view, degrees.
const FOVY: f64 = 60.0;
/// Cells of the surface along a side, in which dots are counted.
const CELLS: usize = 16;
/// Greatest ratio of the densities of adjacent cells; prefixes of nodes alone have 1.81.
const STEP_MAX: f64 = 1.3;
/// Dots in the square of their spacing: even samples have 0.55 to 0.7.
const DOTS: f64 = 0.55;

/// A fraction from 0 to 1, at random.
fn dice(i: usize) -> f64 {
    let mixed = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ mixed >> 31).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 11) as f64 / (1u64 << 53) as f64
}

/// A plane with a point at random in each unit square, in nodes of 4,096 points.
fn plane(folder: &std::path::Path) -> Forest {
    let step = |c: f64| (c / STEP) as i32;
    let place = |i: usize| {
        let (x, y) = ((i % SIDE) as f64, (i / SIDE) as f64);
        [step(x + dice(2 * i)), step(y + dice(2 * i + 1)), 0]
    };
    let positions = (0..SIDE * SIDE).map(place).collect();
    let out = folder.join("plane.esker");
    let source = given("plane", [STEP; 3], positions);
    let options = Options { node_capacity: 4096, normals: NormalsMode::None, ..Options::default() };
    build_sources(vec![source.boxed()], &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

/// Number of dots a square of the target spacing, by cells of the plane that are wholly in the
/// picture and have at least 150 dots; none for others.
fn densities(file: &Forest, eye: [f64; 3], target: [f64; 3], spacing_px: f64) -> Vec<Option<f64>> {
    let camera = format!(
        "eye={},{},{};target={},{},{};up=0,1,0;fovy={FOVY}",
        eye[0], eye[1], eye[2], target[0], target[1], target[2]
    );
    let request = PictureRequest {
        size: [SIZE; 2],
        method: Method::Points,
        target_spacing_px: spacing_px,
        camera: Camera::parse(&camera).unwrap(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    };
    let picture = draw(file, &request, &Silent).unwrap().0;
    let (eye, target) = (glam::DVec3::from_array(eye), glam::DVec3::from_array(target));
    let forward = (target - eye).normalize_or_zero();
    let right = forward.cross(glam::DVec3::Y).normalize_or_zero();
    let up = right.cross(forward);
    let focal = f64::from(SIZE) / 2.0 / (FOVY / 2.0).to_radians().tan();
    let middle = f64::from(SIZE) / 2.0;
    let edge = SIDE as f64 / CELLS as f64;
    let mut dots = vec![0.0; CELLS * CELLS];
    for (i, &depth) in picture.depth.iter().enumerate().filter(|(_, d)| d.is_finite()) {
        let (x, y) = ((i % SIZE as usize) as f64 + 0.5, (i / SIZE as usize) as f64 + 0.5);
        let (x, y) = ((x - middle) / focal, (middle - y) / focal);
        let at = eye + (forward + right * x + up * y) * f64::from(depth);
        let [u, v] = [at.x / edge, at.y / edge].map(|c| (c.max(0.0) as usize).min(CELLS - 1));
        dots[v * CELLS + u] += 1.0;
    }
    let density = |cell: usize| {
        let corner = [cell % CELLS, cell / CELLS].map(|c| c as f64 * edge);
        // Mean square of the distance that a target spacing on the picture is long.
        let mut sum = 0.0;
        for k in 0..64 {
            let [x, y] = [k % 8, k / 8].map(|k| (f64::from(k) + 0.5) / 8.0 * edge);
            let at = glam::DVec3::new(corner[0] + x, corner[1] + y, 0.0) - eye;
            let depth = at.dot(forward);
            let place = [at.dot(right) / depth, at.dot(up) / depth].map(|p| p * focal);
            if depth <= 0.0 || place.iter().any(|p| p.abs() > middle - 2.0) {
                return None;
            }
            sum += (focal / (spacing_px * depth)).powi(2);
        }
        let wanted = sum / 64.0 * edge * edge;
        // Cells at the rim of the plane, and with so few dots that chance decides, do not count.
        let is_rim = [cell % CELLS, cell / CELLS].iter().any(|&c| c == 0 || c == CELLS - 1);
        (!is_rim && wanted * DOTS >= 150.0).then(|| dots[cell] / wanted)
    };
    (0..CELLS * CELLS).map(density).collect()
}

#[test]
fn dots_are_as_dense_as_asked_without_steps_between_nodes() {
    let folder = tempfile::tempdir().unwrap();
    let file = plane(folder.path());
    let middle = [SIDE as f64 / 2.0, SIDE as f64 / 2.0, 0.0];
    let views = [
        ("above", [middle[0], middle[1], 650.0], middle, [2.0, 3.0]),
        ("near", [250.0, 300.0, 260.0], [250.0, 300.0, 0.0], [3.0, 5.0]),
        ("oblique", [400.0, -150.0, 260.0], [400.0, 330.0, 0.0], [2.0, 3.0]),
    ];
    for (name, eye, target, spacings) in views {
        for spacing_px in spacings {
            let densities = densities(&file, eye, target, spacing_px);
            let all: Vec<f64> = densities.iter().flatten().copied().collect();
            let (least, most) =
                all.iter().fold((f64::MAX, 0.0f64), |(l, m), &d| (l.min(d), m.max(d)));
            let step = |i: usize, j: usize| {
                let [a, b] = [densities[i]?, (*densities.get(j)?)?];
                Some(a.max(b) / a.min(b))
            };
            let pairs = (0..CELLS * CELLS).flat_map(|i| [step(i, i + 1), step(i, i + CELLS)]);
            let step = pairs.flatten().fold(1.0, f64::max);
            println!(
                "{name}, {spacing_px} px: {least:.2} to {most:.2} in {} cells, steps of {step:.2}",
                all.len()
            );
            assert!(all.len() > 20, "{name}: only {} cells", all.len());
            // Where the surface is seen aslant, dots hide each other.
            assert!(least >= 0.4, "{name}, {spacing_px} px: only {least:.2}");
            assert!(most <= 0.75, "{name}, {spacing_px} px: up to {most:.2}");
            assert!(step <= STEP_MAX, "{name}, {spacing_px} px: a step of {step:.2}");
        }
    }
}
