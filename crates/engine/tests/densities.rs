//! Parts of a scan that are far denser than others beside them, in one node and in many, are drawn
//! as if each were alone: surfaces are closed, and no disc of one part reaches beyond a few of its
//! own distances. Generated planes have a dense red square in a sparse blue one; a corridor is seen
//! from the place of its scanner.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_builder::{NormalsMode, Options, build_sources};
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Forest, Method, Picture};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth};
use given::given;
use std::path::Path;

/// Width and height of the pictures.
const SIDE: u32 = 512;
/// Points of the dense square, and of the sparse one.
const POINTS: [usize; 2] = [60_000, 4_000];
/// Distance of the points of the dense square, units.
const DENSE: f64 = 0.01;
/// Length of a step.
const STEP: f64 = 1e-4;
/// Ratios of densities.
const JUMPS: [f64; 4] = [1e2, 1e3, 1e4, 1e6];
/// Nodes' capacities: all points in one node, and in many.
const CAPACITIES: [u32; 2] = [1 << 16, 1 << 13];

/// Half the edge of a square of `points` points that are `apart` apart.
fn half(points: usize, apart: f64) -> f64 {
    (points as f64).sqrt() * apart / 2.0
}

/// Places of points that fill a square evenly (an additive recurrence with the plastic number).
fn square(points: usize, half: f64) -> impl Iterator<Item = [f64; 2]> {
    let at = move |i: usize, k: f64| ((i as f64 * k).fract() * 2.0 - 1.0) * half;
    (1..=points).map(move |i| [at(i, 0.754_877_666_246_693), at(i, 0.569_840_290_998_053)])
}

/// A plane whose middle is `jump` times denser than the rest.
struct Scene {
    file: Forest,
    /// Half the edges of the dense square and of the plane.
    halves: [f64; 2],
    /// Distance of the points around the dense square.
    sparse: f64,
}

fn scene(
    jump: f64,
    [dense, around]: [usize; 2],
    capacity: u32,
    normals: NormalsMode,
    folder: &Path,
) -> Scene {
    let sparse = DENSE * jump.sqrt();
    let inner = half(dense, DENSE);
    // The sparse points that the dense square replaces are left out.
    let covered = (4.0 * inner * inner / (sparse * sparse)) as usize;
    let outer = half(around + covered, sparse);
    let is_outside = |p: &[f64; 2]| p.iter().any(|c| c.abs() > inner);
    let dense = square(dense, inner).map(|p| (p, true));
    let around = square(around + covered, outer).filter(is_outside).map(|p| (p, false));
    let points: Vec<([f64; 2], bool)> = dense.chain(around).collect();
    let step = |c: f64| (c / STEP).round() as i32;
    let positions = points.iter().map(|(p, _)| [step(p[0]), step(p[1]), 0]).collect();
    let mut source = given("plane", [STEP; 3], positions);
    for (name, is_red) in [("red", true), ("green", false), ("blue", false)] {
        let value = |i: u64| {
            if name == "green" { 20 } else { 20 + 200 * u64::from(points[i as usize].1 == is_red) }
        };
        source = source.with(name, AttrType::U16, value);
    }
    let source = source.coloured(ColourDepth::Eight);
    let out = folder.join("plane.esker");
    let options = Options { node_capacity: capacity, normals, ..Options::default() };
    build_sources(vec![source.boxed()], &out, &options, &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    esker_format::verify(file.file_of(0), &Silent).unwrap();
    Scene { file, halves: [inner, outer], sparse }
}

/// What is wrong with a picture.
#[derive(Clone, Copy, Debug, Default)]
struct Faults {
    /// Width of the widest gap in the plane, pixels.
    gap_px: f64,
    /// The same in distances of the sparse part, beyond 3 pixels.
    gap: f64,
    /// How far the dense part reaches beyond its edge, in its own distances, of a pixel at least.
    halo: f64,
    /// Share of the pixels of the dense part, away from its edge, that show the sparse one.
    overdrawn: f64,
}

impl Scene {
    /// Picture from above the place `at`, at `px` pixels a unit.
    fn picture(&self, at: [f64; 2], px: f64, method: Method) -> Picture {
        self.aimed(at, px, method, 1.0)
    }

    /// The same with another target spacing.
    fn aimed(&self, at: [f64; 2], px: f64, method: Method, target_spacing_px: f64) -> Picture {
        let fovy = 40f64;
        let height = f64::from(SIDE) / 2.0 / (fovy / 2.0).to_radians().tan() / px;
        let [x, y] = at;
        let camera = format!("eye={x},{y},{height};target={x},{y},0;up=0,1,0;fovy={fovy}");
        let request = PictureRequest {
            size: [SIDE; 2],
            method,
            target_spacing_px,
            camera: Camera::parse(&camera).unwrap(),
            shines: false,
            with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
            ..PictureRequest::default()
        };
        draw(&self.file, &request, &Silent).unwrap().0
    }

    fn faults(&self, at: [f64; 2], px: f64, picture: &Picture) -> Faults {
        let side = SIDE as usize;
        let middle = f64::from(SIDE) / 2.0;
        let [inner, outer] = self.halves;
        let place = |pixel: usize| {
            let (x, y) = ((pixel % side) as f64 + 0.5, (pixel / side) as f64 + 0.5);
            [at[0] + (x - middle) / px, at[1] - (y - middle) / px]
        };
        let beyond = |pixel: usize| place(pixel).iter().fold(0.0f64, |a, c| a.max(c.abs()));
        // Discs end at the rim of the plane, and where they are wider than the margin also at that
        // of the picture.
        let is_in_plane = |pixel: usize| {
            let rim = [pixel % side, pixel / side].map(|c| c.min(side - 1 - c) as f64);
            beyond(pixel) < outer - 1.5 * self.sparse
                && rim[0].min(rim[1]) + 16.0 > 1.5 * self.sparse * px
        };
        let mut faults = Faults::default();
        let (mut inside, mut over) = (0.0, 0.0);
        for (pixel, rgba) in picture.rgba.chunks_exact(4).enumerate() {
            let (red, blue) = (i32::from(rgba[0]), i32::from(rgba[2]));
            let is_drawn = picture.depth[pixel].is_finite();
            let away = (beyond(pixel) - inner) * px;
            if is_drawn && red > blue + 20 && away > 0.0 {
                faults.halo = faults.halo.max((away - 0.5) / (DENSE * px).max(1.0));
            }
            if away < -3.0 * (DENSE * px).max(1.0) {
                inside += 1.0;
                over += f64::from(u8::from(is_drawn && blue > red + 20));
            }
        }
        faults.overdrawn = if inside > 100.0 { over / inside } else { 0.0 };
        let gaps = distances(picture);
        let gap = (0..gaps.len()).filter(|&i| is_in_plane(i)).map(|i| gaps[i]).max();
        faults.gap_px = f64::from(gap.unwrap_or(0)) * 2.0 - f64::from(u8::from(gap > Some(0)));
        faults
    }
}

/// Distance of each pixel to the nearest one that is drawn, along rows and columns.
fn distances(picture: &Picture) -> Vec<u32> {
    let side = SIDE as usize;
    let far = 2 * SIDE;
    let mut away: Vec<u32> =
        picture.depth.iter().map(|d| if d.is_finite() { 0 } else { far }).collect();
    for i in 0..away.len() {
        let before = [(i % side > 0).then(|| i - 1), i.checked_sub(side)];
        before.into_iter().flatten().for_each(|j| away[i] = away[i].min(away[j] + 1));
    }
    for i in (0..away.len()).rev() {
        let after = [(i % side + 1 < side).then(|| i + 1), Some(i + side)];
        let after = after.into_iter().flatten().filter(|&j| j < side * side);
        after.for_each(|j| away[i] = away[i].min(away[j] + 1));
    }
    away
}

/// Worst faults of the pictures of a scene: the whole plane, the edge of the dense square from
/// several distances, and a corner of it.
fn worst(scene: &Scene, method: Method, name: &str) -> Faults {
    let [inner, outer] = scene.halves;
    let mut worst = Faults::default();
    let fitted = f64::from(SIDE) / (2.2 * outer);
    let views = [
        ("far", [0.0, 0.0], fitted / 8.0),
        ("whole", [0.0, 0.0], fitted),
        ("near", [inner, 0.1 * inner], (fitted * 8.0).min(4.0 / DENSE)),
        ("square", [0.0, 0.0], f64::from(SIDE) / (4.0 * inner)),
        ("edge", [inner, 0.2 * inner], 1.5 / DENSE),
        ("corner", [inner, inner], 6.0 / DENSE),
    ];
    for (view, at, px) in views {
        let faults = scene.faults(at, px, &scene.picture(at, px, method));
        println!("{name} {method:?} {view}: {faults:.3?}, sparse {:.1} px", scene.sparse * px);
        worst.gap_px = worst.gap_px.max(faults.gap_px);
        worst.gap = worst.gap.max((faults.gap_px - 3.0) / (scene.sparse * px));
        worst.halo = worst.halo.max(faults.halo);
        worst.overdrawn = worst.overdrawn.max(faults.overdrawn);
    }
    worst
}

#[test]
fn dense_parts_beside_sparse_ones_leave_no_gap_and_have_no_halo() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::None, Options::default().normals] {
        for capacity in CAPACITIES {
            for jump in JUMPS {
                let scene = scene(jump, POINTS, capacity, normals, folder.path());
                let nodes = scene.file.table().nodes.len();
                for method in [Method::PullPush, Method::Ewa] {
                    let name = format!("1:{jump} {capacity} {nodes} {normals:?}");
                    let faults = worst(&scene, method, &name);
                    println!("worst of {name} {method:?}: {faults:.3?}");
                    // Pull averages pixels of both parts beside their border: it colours and
                    // narrows discs of the sparse one.
                    let (gap_px, halo) =
                        if method == Method::PullPush { (19.0, 17.0) } else { (3.0, 3.0) };
                    assert!(faults.gap_px <= gap_px, "{name} {method:?}: {faults:?}");
                    assert!(faults.halo <= halo, "{name} {method:?}: {faults:?}");
                    assert!(faults.overdrawn < 0.25, "{name} {method:?}: {faults:?}");
                }
            }
        }
    }
}

#[test]
fn dense_parts_of_large_trees_have_no_halo_and_gaps_only_at_their_border() {
    let folder = tempfile::tempdir().unwrap();
    for jump in JUMPS {
        // Too many nodes to be arranged at once.
        let scene = scene(jump, [400_000, 40_000], 1 << 13, NormalsMode::None, folder.path());
        assert!(scene.file.table().nodes.len() > 64);
        for method in [Method::PullPush, Method::Ewa] {
            let name = format!("1:{jump} large");
            let faults = worst(&scene, method, &name);
            println!("worst of {name} {method:?}: {faults:.3?}");
            // Distances of sparse points to which the first of them may be too narrow.
            let (gaps, halo) = if method == Method::PullPush { (2.0, 32.0) } else { (1.0, 3.0) };
            assert!(faults.gap <= gaps, "{name} {method:?}: {faults:?}");
            assert!(faults.halo <= halo, "{name} {method:?}: {faults:?}");
            assert!(faults.overdrawn < 0.25, "{name} {method:?}: {faults:?}");
        }
    }
}

#[test]
fn a_small_dense_part_is_not_clipped_from_nearby() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(1e6, [8_000, 60_000], 1 << 16, NormalsMode::None, folder.path());
    let [inner, _] = scene.halves;
    for method in [Method::PullPush, Method::Ewa] {
        let picture = scene.picture([0.0, 0.0], f64::from(SIDE) / inner, method);
        let open = picture.depth.iter().filter(|d| !d.is_finite()).count();
        assert_eq!(open, 0, "{method:?}");
    }
}

#[test]
fn a_prefix_of_a_node_holds_the_sparse_part_whole() {
    let folder = tempfile::tempdir().unwrap();
    for jump in JUMPS {
        let scene = scene(jump, [60_000, 996], 1 << 16, NormalsMode::None, folder.path());
        // Distances of the sparse points, pixels, and the share that is drawn. Nearer ones beside
        // the border may be in finer nodes than are drawn.
        for (apart_px, share) in [(2.0, 0.8), (4.0, 0.98)] {
            let blue = |target_spacing_px| {
                let (at, px) = ([0.0, 0.0], apart_px / scene.sparse);
                let picture = scene.aimed(at, px, Method::Points, target_spacing_px);
                let pixels = picture.rgba.as_chunks::<4>().0.iter().zip(&picture.depth);
                pixels.filter(|(rgba, depth)| depth.is_finite() && rgba[2] > rgba[0]).count()
            };
            let (drawn, all) = (blue(1.0), blue(0.0));
            println!("1:{jump}, {apart_px} px: {drawn} of {all} sparse points are drawn");
            assert!(drawn as f64 >= share * all as f64, "1:{jump}: {drawn} of {all} are drawn");
        }
    }
}

/// Points at equal angles around a scanner at the origin, in a corridor of 160 x 8 x 5 m.
fn corridor() -> Vec<[f64; 3]> {
    const COUNT: usize = 60_000;
    let (low, high) = ([-10.0, -4.0, -1.7], [150.0, 4.0, 3.3]);
    let point = |i: usize| {
        let turn = i as f64 * 2.399_963;
        let up: f64 = -0.9 + 1.8 * (i as f64 + 0.5) / COUNT as f64;
        let across = (1.0 - up * up).sqrt();
        let to = [across * turn.cos(), across * turn.sin(), up];
        let reach = |a: usize| if to[a] > 0.0 { high[a] / to[a] } else { low[a] / to[a] };
        let nearest = reach(0).min(reach(1)).min(reach(2));
        to.map(|c| c * nearest)
    };
    (0..COUNT).map(point).collect()
}

#[test]
fn far_walls_of_a_single_station_are_not_thinned_and_near_ones_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let points = corridor();
    let positions = points.iter().map(|p| p.map(|c| (c * 1e3).round() as i32)).collect();
    let (width, height) = (400u32, 280u32);
    let focal = f64::from(height) / 2.0 / 10f64.to_radians().tan();
    let pixel = |p: &[f64; 3]| {
        let [right, down] = [-p[1] / p[0] * focal, -p[2] / p[0] * focal];
        [right + f64::from(width) / 2.0, down + f64::from(height) / 2.0]
    };
    let is_seen = |p: &&[f64; 3]| {
        let [x, y] = pixel(p);
        p[0] > 0.0
            && (4.0..f64::from(width) - 4.0).contains(&x)
            && (4.0..f64::from(height) - 4.0).contains(&y)
    };
    let source = given("corridor", [1e-3; 3], positions);
    for normals in [NormalsMode::None, Options::default().normals] {
        let out = folder.path().join("corridor.esker");
        let options = Options { normals, ..Options::default() };
        build_sources(vec![source.boxed()], &out, &options, &Silent).unwrap();
        let file = Forest::open(&out).unwrap();
        for method in [Method::Auto, Method::PullPush, Method::Ewa] {
            let request = PictureRequest {
                size: [width, height],
                method,
                camera: Camera::parse("eye=0,0,0;target=150,0,0;up=0,0,1;fovy=20").unwrap(),
                with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
                ..PictureRequest::default()
            };
            let picture = draw(&file, &request, &Silent).unwrap().0;
            let is_drawn = |x: f64, y: f64| {
                picture.depth[y as usize * width as usize + x as usize].is_finite()
            };
            let seen = || points.iter().filter(is_seen);
            let drawn = seen().filter(|p| {
                let [x, y] = pixel(p);
                (-1..=1).any(|i| (-1..=1).any(|j| is_drawn(x + f64::from(i), y + f64::from(j))))
            });
            let (drawn, all) = (drawn.count(), seen().count());
            let open = picture.depth.iter().filter(|d| !d.is_finite()).count();
            let open = open as f64 / picture.depth.len() as f64;
            println!("{normals:?} {method:?}: {drawn} of {all} points, {open:.3} open");
            assert!(drawn as f64 >= 0.98 * all as f64, "{normals:?} {method:?}: {drawn} of {all}");
            assert!(open < 0.1, "{normals:?} {method:?}: {open}");
        }
    }
}
