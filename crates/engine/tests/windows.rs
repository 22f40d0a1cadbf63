//! A picture drawn in parts has the pixels of the whole: nodes and radii are those of the whole
//! picture, places are rounded alike, and passes see what lies around a part.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "../../builder/tests/given/mod.rs"]
mod given;

use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith, GpuRequest};
use esker_engine::{Dots, Forest, Method, NormalsMode, Picture, PointSize, Window};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth};
use esker_render::gpu::Gpu;
use given::given;
use std::path::Path;

/// No multiple of the steps that windows are aligned to.
const SIZE: [u32; 2] = [900, 330];
const POINTS: u64 = 200_000;
/// Step of the scan, metres.
const STEP: f64 = 0.001;

/// Places and colours of points: a hilly ground with chequers, and a ball and a wall in front of
/// it.
fn point(i: u64) -> ([f64; 3], [u64; 3]) {
    let share = |k: f64| (i as f64 * k).fract();
    let (u, v) = (share(0.754_877_666), share(0.569_840_291));
    match i % 8 {
        0 => {
            let (z, turn) = (2.0 * u - 1.0, v * std::f64::consts::TAU);
            let side = (1.0 - z * z).sqrt();
            ([2.1 + side * turn.cos(), -2.2 + side * turn.sin(), 1.4 + z], [200, 60, 40])
        }
        1 => ([-2.5 + 2.0 * u, -1.7, 2.2 * v - 0.5], [60, 110, 180]),
        _ => {
            let (x, y) = (16.0 * u - 8.0, 12.0 * v - 6.0);
            let is_dark = ((x * 1.3).floor() + (y * 1.3).floor()).rem_euclid(2.0) < 1.0;
            let z = 0.5 * (x * 0.7).sin() + 0.3 * (y * 0.9).cos() - 1.0;
            ([x, y, z], if is_dark { [70, 100, 60] } else { [180, 190, 120] })
        }
    }
}

fn built(folder: &Path, normals: NormalsMode) -> Forest {
    let steps = |i| point(i).0.map(|c| (c / STEP).round() as i32);
    let mut scan = given("scan", [STEP; 3], (0..POINTS).map(steps).collect());
    for (name, channel) in [("red", 0), ("green", 1), ("blue", 2)] {
        scan = scan.with(name, AttrType::U16, |i| point(i).1[channel]);
    }
    let out = folder.join("scan.esker");
    let options = esker_builder::Options { node_capacity: 4096, normals, ..Default::default() };
    let scan = scan.coloured(ColourDepth::Eight);
    esker_builder::build_sources(vec![scan.boxed()], &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

fn gpu() -> GpuRequest {
    GpuRequest { allow_software: true, ..GpuRequest::default() }
}

/// The CPU, and a GPU if the machine has an adapter.
fn backends() -> Vec<Backend> {
    let has_gpu = Gpu::open(&gpu()).is_ok();
    if !has_gpu {
        println!("skipped: no adapter; the CPU alone draws");
    }
    [Some(Backend::Cpu), has_gpu.then_some(Backend::Gpu)].into_iter().flatten().collect()
}

fn request(camera: &str, method: Method, dots: Dots, backend: Backend) -> PictureRequest {
    PictureRequest {
        size: SIZE,
        method,
        dots,
        camera: Camera::parse(camera).unwrap(),
        with: DrawWith { backend, gpu: gpu() },
        ..PictureRequest::default()
    }
}

/// The ground fills the picture and goes on beyond it.
const CAMERA: &str = "eye=0.25,-8.5,3.5;target=0.25,-1,0;fovy=50";
const PLAN: &str = "direction=0,0.3,-1;ortho=9";

/// Parts of the picture, which cover all of it: halves, and tiles of uneven sizes.
fn partitions() -> [Vec<Window>; 2] {
    let [width, height] = SIZE;
    let window = |x, y, width, height| Window { x, y, width, height };
    let halves = vec![window(0, 0, 433, height), window(433, 0, width - 433, height)];
    let columns = [0, 101, 350, 640, width];
    let rows = [0, 77, 211, height];
    let tiles = columns
        .windows(2)
        .flat_map(|c| rows.windows(2).map(move |r| window(c[0], r[0], c[1] - c[0], r[1] - r[0])));
    [halves, tiles.collect()]
}

/// How parts of a picture differ from the whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Different {
    /// Greatest difference of depth, over the depth; infinite if either shows nothing.
    depth: f32,
    /// Pixels that differ in colour.
    colours: usize,
    /// Greatest difference of a component of a colour, of 255.
    most: u8,
}

impl Different {
    /// Whether parts have the pixels of the whole. Depths are moved along planes from places that
    /// are rounded on the part, by which few colours change by the least step there is.
    fn is_none_on(&self, backend: Backend) -> bool {
        let (depth, part) = if backend == Backend::Cpu { (1e-6, 1e-5) } else { (1e-5, 1e-3) };
        let few = (part * f64::from(SIZE[0] * SIZE[1])) as usize;
        self.depth < depth && self.most <= 1 && self.colours <= few
    }

    fn and(self, other: Self) -> Self {
        let Self { depth, colours, most } = other;
        Self {
            depth: self.depth.max(depth),
            colours: self.colours + colours,
            most: self.most.max(most),
        }
    }
}

/// How a part differs from the same pixels of the whole.
fn different(part: &Picture, whole: &Picture, window: Window) -> Different {
    assert_eq!([part.width, part.height], [window.width, window.height]);
    let pixels = |p: &Picture| -> Vec<[u8; 4]> { p.rgba.as_chunks::<4>().0.to_vec() };
    let (own, all) = (pixels(part), pixels(whole));
    let mut off = Different::default();
    for y in 0..window.height {
        for x in 0..window.width {
            let here = (y * window.width + x) as usize;
            let there = ((window.y + y) * whole.width + window.x + x) as usize;
            let depths = [part.depth[here], whole.depth[there]];
            let is_same = depths[0] == depths[1];
            let change = if is_same { 0.0 } else { (depths[0] / depths[1] - 1.0).abs() };
            off.depth = off.depth.max(change);
            off.colours += usize::from(own[here] != all[there]);
            let components = own[here].iter().zip(all[there]);
            let most = components.map(|(a, b)| a.abs_diff(b)).max().unwrap_or(0);
            off.most = off.most.max(most);
        }
    }
    off
}

/// How the parts of a picture differ from the whole, for each way to part it.
fn differences(file: &Forest, request: &PictureRequest) -> [Different; 2] {
    let whole = draw(file, request, &Silent).unwrap();
    assert!(whole.1.pixels_covered > u64::from(SIZE[0] * SIZE[1]) / 4);
    partitions().map(|parts| {
        let mut covered = 0;
        let found = parts.into_iter().map(|window| {
            let part = PictureRequest { window: Some(window), ..request.clone() };
            let (picture, report) = draw(file, &part, &Silent).unwrap();
            assert_eq!(report.points_drawn, whole.1.points_drawn);
            covered += report.pixels_covered;
            different(&picture, &whole.0, window)
        });
        let all = found.fold(Different::default(), Different::and);
        assert_eq!(covered, whole.1.pixels_covered);
        all
    })
}

#[test]
fn points_drawn_in_parts_have_the_pixels_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path(), NormalsMode::None);
    let adaptive = Dots { size: PointSize::Adaptive, eye_dome: 1.0 };
    for backend in backends() {
        for camera in [CAMERA, PLAN] {
            for dots in [Dots::default(), adaptive] {
                let found = differences(&file, &request(camera, Method::Points, dots, backend));
                assert_eq!(found, [Different::default(); 2], "{backend:?}, {camera}, {dots:?}");
            }
        }
    }
}

#[test]
fn surfaces_drawn_in_parts_have_the_pixels_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::Fast, NormalsMode::None] {
        let file = built(folder.path(), normals);
        for backend in backends() {
            // Software drivers take minutes for all.
            let cameras = if backend == Backend::Cpu { &[CAMERA, PLAN][..] } else { &[CAMERA] };
            for &camera in cameras {
                for method in [Method::PullPush, Method::Auto, Method::Ewa] {
                    let request = request(camera, method, Dots::default(), backend);
                    let found = differences(&file, &request);
                    println!("{normals:?}, {backend:?}, {camera}, {method:?}: {found:?}");
                    assert!(found.iter().all(|found| found.is_none_on(backend)), "{found:?}");
                }
            }
        }
    }
}

/// Discs of the coarsest points reach from beyond the margin of a window into it, and near ones
/// through the near plane. Without normals discs take planes that are fitted within the margin.
#[test]
fn wide_splats_drawn_in_parts_have_the_pixels_of_the_whole() {
    const NEAR: &str = "eye=0.25,-4,-0.4;target=0.25,0,-0.8;fovy=80";
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::Fast, NormalsMode::None] {
        let file = built(folder.path(), normals);
        for backend in backends() {
            let is_bare = normals == NormalsMode::None;
            for (camera, spacing_px) in [(CAMERA, 60.0), (NEAR, 20.0)] {
                let target_spacing_px = if is_bare { 4.0 } else { spacing_px };
                let plain = request(camera, Method::Ewa, Dots::default(), backend);
                let request = PictureRequest { target_spacing_px, ..plain };
                let found = differences(&file, &request);
                println!("{normals:?}, {backend:?}, {camera}: {found:?}");
                assert!(found.iter().all(|found| found.is_none_on(backend)), "{found:?}");
            }
        }
    }
}

/// Gaps between points are wider than the margin of windows of dense views.
#[test]
fn wide_gaps_filled_in_parts_have_the_pixels_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    for normals in [NormalsMode::Fast, NormalsMode::None] {
        let file = built(folder.path(), normals);
        for backend in backends() {
            let methods = [Method::PullPush, Method::Auto, Method::Ewa];
            let methods = if backend == Backend::Cpu { &methods[..] } else { &methods[..1] };
            for &method in methods {
                for target_spacing_px in [10.0, 40.0] {
                    // Points that far apart are dots, which cover little.
                    if method == Method::Auto && target_spacing_px > 10.0 {
                        continue;
                    }
                    let plain = request(CAMERA, method, Dots::default(), backend);
                    let request = PictureRequest { target_spacing_px, ..plain };
                    let found = differences(&file, &request);
                    println!(
                        "{normals:?}, {backend:?}, {method:?}, {target_spacing_px}: {found:?}"
                    );
                    assert!(found.iter().all(|found| found.is_none_on(backend)), "{found:?}");
                }
            }
        }
    }
}

/// Their noise, filter and exposure are those of the whole.
#[cfg(feature = "light")]
#[test]
fn parts_of_lit_pictures_have_the_pixels_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(folder.path(), NormalsMode::Fast);
    let lit = request(CAMERA, Method::Lit, Dots::default(), Backend::Cpu);
    let mut lit = PictureRequest { size: [300, 110], ..lit };
    let whole = draw(&file, &lit, &Silent).unwrap().0;
    let window = Window { x: 17, y: 40, width: 120, height: 70 };
    lit.window = Some(window);
    let (part, report) = draw(&file, &lit, &Silent).unwrap();
    assert_eq!(different(&part, &whole, window), Different::default());
    assert_eq!([report.width, report.height], [120, 70]);
    let shown = part.depth.iter().filter(|depth| depth.is_finite()).count();
    assert_eq!(report.pixels_covered, shown as u64);
    lit.window = Some(Window { x: 200, ..window });
    assert!(draw(&file, &lit, &Silent).unwrap_err().to_string().contains("not within"));
}
