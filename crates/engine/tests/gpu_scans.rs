//! Whole pictures of three models and three scans, by each way in which a GPU of this machine can
//! draw, software drivers included, are those of the CPU: mean FLIP at most 0.01, and at most 0.1 %
//! of the pixels differ by more than 8 of 255.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::Method;
use esker_engine::calls::render::draw;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith, GpuRequest, ProjectPath};
use esker_format::Forest;
use esker_points::task::Silent;
use esker_render::Picture;
use esker_render::gpu::Gpu;
use esker_render::gpu::device::all_interfaces;
use std::path::{Path, PathBuf};

const SIZE: [u32; 2] = [256, 192];

/// Models with and without normals, airborne scans, a scan of rooms.
const OF_DATA: [&str; 5] = [
    "models/bunny-36k.ply",
    "models/armadillo-38k-ascii.ply",
    "models/bunny-zipper-ascii.ply",
    "laz/indoor.laz",
    "laz/ahn3-small.laz",
];

/// The project's sample scan, and scans of the data folder.
fn inputs() -> Vec<PathBuf> {
    let sample = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    let mut inputs = vec![sample];
    match std::env::var_os("ESKER_DATA") {
        Some(data) => inputs.extend(OF_DATA.map(|file| Path::new(&data).join(file))),
        None => println!("skipped: ESKER_DATA is not set; the sample scan alone is drawn"),
    }
    inputs
}

/// Each graphics interface, with each way to draw points that it has.
fn ways() -> Vec<GpuRequest> {
    let paths = [ProjectPath::Atomics, ProjectPath::Primitives];
    let ways = all_interfaces().iter().flat_map(|&backends| {
        paths.map(|path| GpuRequest {
            backends,
            path: Some(path),
            allow_software: true,
            ..GpuRequest::default()
        })
    });
    let ways: Vec<_> = ways.filter(|way| Gpu::open(way).is_ok()).collect();
    if ways.is_empty() {
        eprintln!("no adapter");
    }
    ways
}

/// Fraction of the pixels that differ by more than 8 of 255 in any channel.
fn off(a: &Picture, b: &Picture) -> f64 {
    assert_eq!([a.width, a.height], [b.width, b.height]);
    let (a, b) = (a.rgba.as_chunks::<4>().0, b.rgba.as_chunks::<4>().0);
    let differs = |(a, b): &(&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > 8);
    a.iter().zip(b).filter(differs).count() as f64 / a.len() as f64
}

fn gpu_equals_cpu(method: Method) {
    let ways = ways();
    let folder = tempfile::tempdir().unwrap();
    for input in inputs() {
        let built = folder.path().join("scan.esker");
        let options = esker_builder::Options { node_capacity: 8192, ..Default::default() };
        esker_builder::build(std::slice::from_ref(&input), &built, &options, &Silent).unwrap();
        let file = Forest::open(&built).unwrap();
        let by = |with| {
            let request = PictureRequest { size: SIZE, method, with, ..PictureRequest::default() };
            draw(&file, &request, &Silent).unwrap().0
        };
        let expected = by(DrawWith { backend: Backend::Cpu, ..DrawWith::default() });
        for way in &ways {
            let picture = by(DrawWith { backend: Backend::Gpu, gpu: *way });
            let off = off(&picture, &expected);
            let flip =
                esker_truth::flip::mean_flip(&picture.rgba, &expected.rgba, SIZE[0] as usize);
            let name = input.file_name().unwrap().display();
            let way = format!("{:?} {:?}", way.backends, way.path);
            println!("{name}, {method:?}, {way}: {:.4} % off, FLIP {flip:.5}", off * 100.0);
            assert!(off <= 0.001 && flip <= 0.01, "{name} by {way}: {off} off, FLIP {flip}");
        }
    }
}

#[test]
fn points_of_models_and_scans_equal_the_cpu() {
    gpu_equals_cpu(Method::Points);
}

#[test]
fn surfaces_of_models_and_scans_equal_the_cpu() {
    gpu_equals_cpu(Method::PullPush);
}

#[test]
fn surfaces_and_dots_of_models_and_scans_equal_the_cpu() {
    gpu_equals_cpu(Method::Auto);
}
