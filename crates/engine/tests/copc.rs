//! COPC files drawn as they are, without building: stills and sessions agree to the bit, pictures
//! are those of the built file but for the choice of samples, picks and exports have the file's
//! integers.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod creek;

use creek::{SIZE, Wanderer, overview, sample};
use esker_builder::ExportOptions;
use esker_engine::calls::pick::pick;
use esker_engine::calls::render::draw;
use esker_engine::calls::{export, info};
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::classes::{ClassCount, occurring};
use esker_engine::cameras::histogram::value_histogram;
use esker_engine::draw::scene::{PictureRequest, PictureScene, completed, open};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::io::file::open_copc;
use esker_engine::machine::backend::{Backend, DrawWith, GpuRequest};
use esker_engine::{
    Bounds, BuildOptions, Classes, Filter, Forest, Method, NormalsMode, Picture, ValueRange,
};
use esker_points::task::Silent;
use esker_render::gpu::Gpu;
use esker_render::gpu::device::all_interfaces;
use esker_scan::OpenOptions;
use esker_truth::flip::mean_flip;
use glam::DVec2;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

const WKT: &str = r#"LOCAL_CS["site",UNIT["metre",1]]"#;

/// The sample scan as COPC, in many small chunks; exported once for all tests.
fn copc() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let name = format!("{}.copc.laz", env!("CARGO_CRATE_NAME"));
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let options = ExportOptions { crs: Some(WKT.into()), ..Default::default() };
        export::export(sample(), &out, &Filter::default(), options, 0, &Silent).unwrap();
        out
    })
}

fn opened() -> Forest {
    open_copc(copc(), &BuildOptions::default()).unwrap().unwrap()
}

fn request(camera: &str, method: Method, filter: &Filter) -> PictureRequest {
    PictureRequest {
        size: SIZE,
        method,
        camera: Camera::parse(camera).unwrap(),
        filter: filter.clone(),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::default()
    }
}

fn still(file: &Forest, request: &PictureRequest) -> Picture {
    draw(file, request, &Silent).unwrap().0
}

/// None, and filters by a box in the middle of the scan, by classes and by values.
fn filters() -> [Filter; 4] {
    let [low, high] = info::bounds(&opened());
    let part = |axis: usize, share: f64| low[axis] + (high[axis] - low[axis]) * share;
    let bounds = |z: [f64; 2]| Bounds {
        min: [part(0, 0.2), part(1, 0.3), z[0]],
        max: [part(0, 0.7), part(1, 0.8), z[1]],
    };
    let whole = bounds([low[2] - 1.0, high[2] + 1.0]);
    let classes = "0".parse::<Classes>().unwrap();
    let bright = "red:20000..".parse::<ValueRange>().unwrap();
    [
        Filter::default(),
        Filter { bounds: Some(whole), ..Filter::default() },
        Filter { classes: Some(classes), ..Filter::default() },
        Filter { values: vec![bright], ..Filter::default() },
    ]
}

#[test]
fn it_is_drawn_as_the_built_file_is() {
    // Neither has normals.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("built.esker");
    let options = BuildOptions { normals: NormalsMode::None, ..BuildOptions::default() };
    esker_builder::build(&[copc().into()], &path, &options, &Silent).unwrap();
    let built = Forest::open(&path).unwrap();
    for camera in ["", "direction=1,0.3,-0.5"] {
        for method in [Method::Auto, Method::Points] {
            let request = PictureRequest {
                colour_by: Some("rgb".into()),
                ..request(camera, method, &Filter::default())
            };
            let (own, other) = (still(&opened(), &request), still(&built, &request));
            let flip = mean_flip(&own.rgba, &other.rgba, SIZE[0] as usize);
            println!("{camera} {method:?}: FLIP {flip:.4}");
            assert!(flip < 0.06, "{camera} {method:?}: FLIP {flip}");
        }
    }
}

#[test]
fn sessions_settle_to_the_still_picture() {
    for (i, filter) in filters().iter().enumerate() {
        let settings = Settings { filter: filter.clone(), ..Settings::default() };
        let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
        let mut session = Session::open(Arc::new(opened()), options).unwrap();
        let views = ["", "direction=-1,0.2,-0.4"];
        for camera in views {
            let request = request(camera, Method::Auto, filter);
            let grown = completed(&opened(), &request, &Silent).unwrap();
            let file = grown.unwrap_or_else(opened);
            let view = PictureScene::choose(&file, &request).unwrap().view;
            let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
            assert!(cut.complete && !cut.nodes.is_empty(), "{camera}, filter {i}");
            let mut frames = 0;
            let shown = loop {
                let frame = session.frame(&view).unwrap();
                frames += 1;
                if frame.is_final || frames == 50 {
                    break frame.image.in_memory().unwrap().rgba.clone();
                }
            };
            let want = still(&file, &request).rgba;
            let off = shown.iter().zip(&want).filter(|(a, b)| a.abs_diff(**b) > 1).count();
            assert_eq!((shown.len(), off), (want.len(), 0), "{camera}, filter {i}");
        }
    }
}

#[test]
fn a_flight_within_small_budgets_keeps_its_cut() {
    for budget_gpu_bytes in [1 << 20, 4 << 20] {
        let settings =
            Settings { budget_gpu_bytes, budget_ram_bytes: 256 << 20, ..Settings::default() };
        let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
        let mut session = Session::open(Arc::new(opened()), options).unwrap();
        let first = overview(&session);
        session.settle(&first, Duration::from_secs(60)).unwrap();
        let mut wanderer = Wanderer::new(&session, 7);
        for _ in 0..60 {
            let view = wanderer.next();
            let frame = session.frame(&view).unwrap();
            assert!(frame.status.drawing_bytes <= budget_gpu_bytes);
            assert_eq!(frame.status.nodes_failed, 0, "{:?}", frame.status);
        }
        let view = wanderer.next();
        session.settle(&view, Duration::from_secs(60)).unwrap();
    }
}

#[test]
fn a_gpu_streams_it_as_the_cpu_does() {
    let backends = all_interfaces().iter().copied();
    let request = |backends| GpuRequest { backends, allow_software: true, ..GpuRequest::default() };
    let Some(gpu) = backends.map(request).find_map(|request| Gpu::open(&request).ok()) else {
        eprintln!("no adapter");
        return;
    };
    let settled = |backend, device| {
        let settings = Settings { occlusion: false, ..Settings::default() };
        let options = Options { settings, backend, device, size: SIZE, ..Options::default() };
        let mut session = Session::open(Arc::new(opened()), options).unwrap();
        let view = overview(&session);
        session.settle(&view, Duration::from_secs(60)).unwrap();
        assert!(session.frame(&view).unwrap().cut.complete);
        session.picture().unwrap()
    };
    let on_cpu = settled(Backend::Cpu, None);
    let on_gpu = settled(Backend::Gpu, Some(gpu.clone()));
    let flip = mean_flip(&on_gpu.rgba, &on_cpu.rgba, SIZE[0] as usize);
    assert!(flip <= 0.01, "FLIP {flip}");
    assert_eq!(gpu.fault(), None);
}

#[test]
fn a_pick_is_a_point_of_the_file() {
    let source = esker_scan::open(copc(), &OpenOptions::default(), &Silent).unwrap();
    let grid = source.info().grid.clone();
    let lattice = esker_points::Lattice::choose(std::slice::from_ref(&grid)).unwrap();
    let mut all = BTreeSet::new();
    let mut take = |batch: esker_points::Batch| {
        all.extend(batch.positions.iter().map(|p| p.map(|c| i64::from(c) - (1 << 31))));
        Ok(())
    };
    source.read(&lattice.placement(&grid), &Silent, &mut take).unwrap();
    let file = opened();
    let request = request("", Method::Auto, &Filter::default());
    let picture = still(&file, &request);
    let scene = PictureScene::choose(&file, &request).unwrap();
    let view = scene.view.with_margin(0);
    let mut picks = 0;
    for i in 0..200 {
        let share = |k: f64| (f64::from(i) * k).fract();
        let at = DVec2::new(share(0.618) * f64::from(SIZE[0]), share(0.414) * f64::from(SIZE[1]));
        let depth = picture.depth[at.y as usize * SIZE[0] as usize + at.x as usize];
        if !depth.is_finite() {
            continue;
        }
        let shown = &scene.appearance.shown;
        let Some(picked) = pick(&file, &view, at, depth.into(), shown).unwrap() else { continue };
        picks += 1;
        assert!(all.contains(&picked.steps), "{picked:?}");
        assert_eq!((picked.scale, picked.offset), (grid.grid.scale, grid.grid.offset));
        for axis in 0..3 {
            let written: f64 = picked.coordinates[axis].parse().unwrap();
            let exact = picked.steps[axis] as f64 * picked.scale[axis] + picked.offset[axis];
            assert!((written - exact).abs() < 1e-9, "{picked:?}");
            assert!((picked.position[axis] - exact).abs() < picked.scale[axis], "{picked:?}");
        }
    }
    assert!(picks > 50, "{picks}");
}

#[test]
fn exports_have_the_points_of_an_export_of_the_built_file() {
    let folder = tempfile::tempdir().unwrap();
    // Built of the COPC file, so that the attributes are its own.
    let built = folder.path().join("built.esker");
    esker_builder::build(&[copc().into()], &built, &BuildOptions::default(), &Silent).unwrap();
    for (i, filter) in filters().iter().enumerate() {
        let export = |file: &Path, name: &str| {
            let out = folder.path().join(format!("{i}-{name}.laz"));
            let report =
                export::export(file, &out, filter, ExportOptions::default(), 0, &Silent).unwrap();
            (out, report)
        };
        let (own, report) = export(copc(), "copc");
        let (_, other) = export(&built, "built");
        assert!(report.points_out > 0 && report.points_out == other.points_out, "filter {i}");
        assert_eq!(report.multiset_hash, other.multiset_hash, "filter {i}");
        assert_eq!(report.hash_equal, None);
        // What was written is what is read back.
        let again = folder.path().join(format!("{i}.esker"));
        esker_builder::build(&[own], &again, &BuildOptions::default(), &Silent).unwrap();
        let again = Forest::open(&again).unwrap();
        assert_eq!(again.points(), report.points_out);
    }
    let refused = folder.path().join("again.copc.laz");
    let options = ExportOptions::default();
    let error = export::export(copc(), &refused, &Filter::default(), options, 0, &Silent);
    assert!(format!("{:#}", error.unwrap_err()).contains("COPC already"));
}

#[test]
fn what_comes_from_the_first_points_says_so() {
    let (file, built) = (opened(), Forest::open(sample()).unwrap());
    let sampled = file.table().nodes[0].points() as u64;
    assert!(sampled < file.points() / 4);
    let counted = value_histogram(&file, "red").unwrap().unwrap();
    // Strays are not in the bins.
    let in_bins = counted.counts.iter().sum::<f64>().round() as u64;
    assert_eq!(counted.sample, Some(in_bins));
    assert!(in_bins <= sampled && in_bins * 100 >= sampled * 99, "{in_bins} of {sampled}");
    assert_eq!(value_histogram(&built, "red").unwrap().unwrap().sample, None);
    let (classes, exact) = (occurring(&file).unwrap(), occurring(&built).unwrap());
    assert!(classes.iter().all(|class| class.is_estimate));
    assert!(exact.iter().all(|class| !class.is_estimate));
    let points = |all: &[ClassCount]| all.iter().map(|class| class.points).sum::<u64>();
    assert!(points(&classes).abs_diff(points(&exact)) <= classes.len() as u64);
}

#[test]
fn what_only_a_build_gives_is_built() {
    let options = BuildOptions { node_capacity: 4096, ..BuildOptions::default() };
    assert!(open_copc(copc(), &options).unwrap().is_none());
    assert!(open_copc(sample(), &BuildOptions::default()).unwrap().is_none());
    let request = PictureRequest { build: options, ..PictureRequest::default() };
    let (file, folder) = open(&[copc().into()], &request, &Silent).unwrap();
    assert!(folder.is_some() && !file.is_growing());
}
