//! Sessions on every GPU of the machine, software drivers included, draw the picture of the CPU,
//! keep their budgets on a random flight, free all buffers, and go on with the CPU if the GPU
//! fails. The flight takes a few frames on each device, or `ESKER_FLIGHT_SECONDS`; ten minutes on
//! each are `ESKER_FLIGHT_SECONDS=600 cargo test --release -p esker-engine --test gpu_session
//! flight`.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod creek;

use creek::{SIZE, Wanderer, overview, sample};
use esker_engine::Method;
use esker_engine::draw::session::{Image, Options, Session, Settings};
use esker_engine::machine::backend::{Backend, GpuRequest, ProjectPath};
use esker_format::Forest;
use esker_render::Picture;
use esker_render::gpu::Gpu;
use esker_render::gpu::device::all_interfaces;
use std::sync::Arc;
use std::time::{Duration, Instant};

const BUDGET: u64 = 24 << 20;

/// Requests for each kind of device of this machine: with all it has, with point primitives, and
/// with only what WebGPU guarantees.
fn requests() -> Vec<GpuRequest> {
    let of = |backends| {
        let request = GpuRequest { backends, allow_software: true, ..GpuRequest::default() };
        [
            request,
            GpuRequest { path: Some(ProjectPath::Primitives), ..request },
            GpuRequest { is_minimal: true, ..request },
        ]
    };
    let all = all_interfaces().iter().copied().flat_map(of).filter(|r| Gpu::open(r).is_ok());
    let all: Vec<_> = all.collect();
    if all.is_empty() {
        eprintln!("no adapter");
    }
    all
}

fn options(backend: Backend) -> Options {
    let settings = Settings { budget_gpu_bytes: BUDGET, ..Settings::default() };
    Options { settings, backend, size: SIZE, ..Options::default() }
}

fn open(options: Options) -> anyhow::Result<Session> {
    Session::open(Arc::new(Forest::open(sample()).unwrap()), options)
}

/// Options for a method, without the depth test.
fn with(method: Method, options: Options) -> Options {
    let settings = Settings { method, occlusion: false, ..options.settings };
    Options { settings, ..options }
}

/// A session on a device that the test keeps a handle to.
fn on(gpu: &Gpu, backend: Backend) -> Options {
    Options { device: Some(gpu.clone()), ..options(backend) }
}

/// Settled picture of the overview.
fn settled(session: &mut Session) -> Picture {
    let view = overview(session);
    session.settle(&view, Duration::from_secs(60)).unwrap();
    assert!(session.frame(&view).unwrap().cut.complete);
    session.picture().unwrap()
}

/// Fraction of the pixels that differ by more than 8 of 255 in any channel.
fn off(a: &Picture, b: &Picture) -> f64 {
    assert_eq!([a.width, a.height], [b.width, b.height]);
    let differs = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 8);
    let (a, b) = (a.rgba.chunks_exact(4), b.rgba.chunks_exact(4));
    let pixels = a.len().max(1) as f64;
    a.zip(b).filter(|&(a, b)| differs((a, b))).count() as f64 / pixels
}

#[test]
fn a_gpu_draws_the_picture_of_the_cpu() {
    for method in [Method::Points, Method::PullPush, Method::Auto] {
        let with = |o| with(method, o);
        let expected = settled(&mut open(with(options(Backend::Cpu))).unwrap());
        for request in requests() {
            let gpu = Gpu::open(&request).unwrap();
            let mut session = open(with(on(&gpu, Backend::Gpu))).unwrap();
            let picture = settled(&mut session);
            let off = off(&picture, &expected);
            let drawer = session.drawer().clone();
            assert!(off <= 0.001, "{method:?} by {drawer:?}: {off} of the pixels are off");
            let flip =
                esker_truth::flip::mean_flip(&picture.rgba, &expected.rgba, SIZE[0] as usize);
            assert!(flip <= 0.01, "{method:?} by {drawer:?}: FLIP {flip}");
            assert_eq!(drawer.backend(), "gpu");
            assert_eq!(gpu.fault(), None);
        }
    }
}

#[test]
fn a_gpu_draws_compact_planes_as_the_cpu_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("compact.esker");
    let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    let built = esker_builder::Options { node_capacity: 2048, compact: true, ..Default::default() };
    esker_builder::build(&[scan], &path, &built, &esker_points::task::Silent).unwrap();
    for method in [Method::Points, Method::PullPush, Method::Auto, Method::Ewa] {
        let open = |o: Options| {
            let file = Arc::new(Forest::open(&path).unwrap());
            Session::open(file, with(method, o)).unwrap()
        };
        let expected = settled(&mut open(options(Backend::Cpu)));
        for request in requests().iter().filter(|r| !r.is_minimal) {
            let gpu = Gpu::open(request).unwrap();
            let mut session = open(on(&gpu, Backend::Gpu));
            let picture = settled(&mut session);
            let off = off(&picture, &expected);
            assert!(off <= 0.001, "{method:?} by {:?}: {off} are off", session.drawer());
            assert_eq!(gpu.fault(), None);
        }
    }
}

/// Fewest frames of a flight: software drivers are slow.
const FRAMES: usize = 8;

fn seconds() -> f64 {
    let given = std::env::var("ESKER_FLIGHT_SECONDS").ok();
    given.map_or(0.0, |s| s.parse().expect("ESKER_FLIGHT_SECONDS is a number"))
}

#[test]
fn a_random_flight_stays_within_its_budget_and_leaves_no_buffer() {
    // A minimal device flies the same way.
    for (seed, request) in requests().iter().filter(|r| !r.is_minimal).enumerate() {
        let gpu = Gpu::open(request).unwrap();
        let before = gpu.bytes();
        let mut session = open(on(&gpu, Backend::Gpu)).unwrap();
        let mut wanderer = Wanderer::new(&session, seed as u64 + 1);
        let began = Instant::now();
        let mut frames = 0;
        while frames < FRAMES || began.elapsed().as_secs_f64() < seconds() {
            let view = wanderer.next();
            let frame = session.frame(&view).unwrap();
            assert!(frame.cut.epoch > 0 || frames < 3, "frame {frames} has no cut");
            assert!(matches!(frame.image, Image::Texture(_)));
            assert_eq!(frame.status.fault, None);
            let bytes = session.gpu_bytes().unwrap();
            assert!(bytes.peak_bytes as f64 <= BUDGET as f64 * 1.05, "frame {frames}: {bytes:?}");
            assert_eq!(gpu.fault(), None);
            frames += 1;
        }
        let status = session.status();
        assert!(status.nodes_loaded > 3, "{status:?}");
        let start = Instant::now();
        drop(session);
        assert!(start.elapsed() < Duration::from_secs(5), "ended after {:?}", start.elapsed());
        assert_eq!((gpu.bytes(), gpu.fault()), (before, None));
    }
}

#[test]
fn a_lost_gpu_is_reported_and_the_cpu_goes_on() {
    for request in requests().into_iter().filter(|r| r.path.is_none() && !r.is_minimal) {
        for backend in [Backend::Auto, Backend::Gpu] {
            let gpu = Gpu::open(&request).unwrap();
            let options = Options { gpu: request, ..on(&gpu, backend) };
            let mut session = open(options).unwrap();
            let mut wanderer = Wanderer::new(&session, 5);
            for _ in 0..3 {
                let view = wanderer.next();
                session.frame(&view).unwrap();
            }
            assert_eq!(session.drawer().backend(), "gpu");
            gpu.end("unplugged by a test");
            let view = wanderer.next();
            let result =
                session.frame(&view).map(|f| (f.cut.nodes.len(), f.image.in_memory().is_some()));
            if backend == Backend::Gpu {
                let error = result.unwrap_err().to_string();
                assert!(error.contains("unplugged") && error.contains("--backend cpu"), "{error}");
                continue;
            }
            assert!(result.unwrap().1, "drawn by the CPU");
            let drawer = session.drawer();
            assert_eq!((drawer.backend(), &drawer.adapter), ("cpu", &None));
            assert!(drawer.note.as_ref().unwrap().contains("unplugged"), "{drawer:?}");
            assert!(session.gpu_bytes().is_none());
            assert!(settled(&mut session).stats.pixels_covered > 1000);
        }
    }
}

#[test]
fn a_budget_too_small_for_pictures_is_refused_or_the_cpu_draws() {
    for request in requests().into_iter().take(1) {
        let within = |backend, budget_gpu_bytes| {
            let settings = Settings { budget_gpu_bytes, ..Settings::default() };
            Options { settings, gpu: request, ..options(backend) }
        };
        let small = |backend| within(backend, 4 << 20);
        let error = open(small(Backend::Gpu)).err().unwrap().to_string();
        assert!(error.contains("--budget-gpu") && error.contains("MiB is the least"), "{error}");
        let least = error.split(" is the least").next().unwrap().rsplit(' ').nth(1).unwrap();
        let least: u64 = least.parse().unwrap();
        let enough = within(Backend::Gpu, least << 20);
        let mut session = open(enough).unwrap();
        let view = overview(&session);
        session.frame(&view).unwrap();
        assert!(session.gpu_bytes().unwrap().peak_bytes <= least << 20);
        let session = open(small(Backend::Auto)).unwrap();
        let note = session.drawer().note.clone().unwrap();
        assert!(note.contains("--budget-gpu"), "{note}");
    }
}

#[test]
fn a_software_driver_counts_as_no_gpu_unless_it_is_requested() {
    let software = requests().into_iter().filter(|r| Gpu::open(r).unwrap().tier.is_software);
    for request in software {
        let refused = GpuRequest { allow_software: false, ..request };
        let auto = Options { gpu: refused, ..options(Backend::Auto) };
        let session = open(auto.clone()).unwrap();
        assert_eq!(session.drawer().backend(), "cpu");
        assert!(session.drawer().note.as_ref().unwrap().contains("software"));
        // The device of a window does not count either.
        let device = Some(Gpu::open(&request).unwrap());
        let session = open(Options { device, ..auto.clone() }).unwrap();
        assert_eq!(session.drawer().backend(), "cpu");
        let error = open(Options { backend: Backend::Gpu, ..auto }).err().unwrap().to_string();
        assert!(error.contains("software") && error.contains("--backend cpu"), "{error}");
    }
}
