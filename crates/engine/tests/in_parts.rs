//! Files whose node table is read in parts: pictures, picks, sessions and legends are those of the
//! file that is read whole, to the bit, and only a part of the table is read for them.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod creek;
mod with_parts;

use creek::{SIZE, Wanderer, sample};
use esker_engine::calls::info;
use esker_engine::calls::pick::{Picked, pick};
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::histogram::value_histogram;
use esker_engine::draw::scene::{PictureRequest, PictureScene, completed};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{
    Bounds, BuildOptions, Classes, Filter, Forest, Method, NormalsMode, Picture, ValueRange,
};
use esker_format::{EskerFile, FileSource, PartSizes};
use esker_points::task::Silent;
use glam::DVec2;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use with_parts::with_parts;

/// Small parts of a small table: much of it stays unread.
const SIZES: PartSizes = PartSizes { from_nodes: 1, part_nodes: 8, top_nodes: 24 };

/// The sample scan in many small nodes, with a table of parts; written once for all tests.
fn file() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let name = format!("{}.esker", env!("CARGO_CRATE_NAME"));
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        let folder = tempfile::tempdir().unwrap();
        let built = folder.path().join("built.esker");
        let scan = PathBuf::from("../../tests/sample/creek.laz");
        let normals = NormalsMode::Estimate;
        let options = BuildOptions { node_capacity: 512, normals, ..BuildOptions::default() };
        esker_builder::build(&[scan], &built, &options, &Silent).unwrap();
        with_parts(&built, &out, SIZES);
        out
    })
}

fn whole() -> Forest {
    Forest::open(file()).unwrap()
}

fn in_parts() -> Forest {
    let source = Box::new(FileSource(File::open(file()).unwrap()));
    EskerFile::from_source_in_parts(file(), source).unwrap().into()
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

/// Filters by a box in the middle of the scan, by classes, by values and by spacing.
fn filters() -> Vec<Filter> {
    let [low, high] = info::bounds(&whole());
    let part = |axis: usize, share: f64| low[axis] + (high[axis] - low[axis]) * share;
    let min = [part(0, 0.2), part(1, 0.3), low[2] - 1.0];
    let max = [part(0, 0.7), part(1, 0.8), high[2] + 1.0];
    let classes = "0".parse::<Classes>().unwrap();
    let bright = "red:20000..".parse::<ValueRange>().unwrap();
    vec![
        Filter { bounds: Some(Bounds { min, max }), ..Filter::default() },
        Filter { classes: Some(classes), ..Filter::default() },
        Filter { values: vec![bright], ..Filter::default() },
        Filter { max_spacing: Some(1.5), ..Filter::default() },
    ]
}

/// Of the whole file, obliquely, and from nearby.
fn cameras() -> [String; 3] {
    let [low, high] = info::bounds(&whole());
    let at = |share: f64| [0, 1, 2].map(|i| low[i] + (high[i] - low[i]) * share);
    let text = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
    let near = format!("eye={};target={}", text(at(0.55)), text(at(0.45)));
    ["".into(), "direction=1,0.3,-0.5".into(), near]
}

/// Pictures with all that is chosen from the table or the statistics.
fn requests() -> Vec<PictureRequest> {
    let all = Filter::default();
    let mut requests = Vec::new();
    for camera in cameras() {
        for method in [Method::Auto, Method::PullPush, Method::Points, Method::Ewa] {
            requests.push(request(&camera, method, &all));
        }
    }
    for colour in
        ["elevation", "intensity", "classification", "level", "flags", "return_number", "depth"]
    {
        let plain = request(&cameras()[1], Method::Auto, &all);
        requests.push(PictureRequest { colour_by: Some(colour.into()), ..plain });
    }
    for filter in &filters() {
        for colour_by in [None, Some("intensity".into()), Some("level".into())] {
            requests.push(PictureRequest { colour_by, ..request("", Method::Auto, filter) });
        }
    }
    for (target_spacing_px, budget_points) in [(0.4, u64::MAX), (0.0, u64::MAX), (1.0, 4000)] {
        let plain = request("", Method::PullPush, &all);
        requests.push(PictureRequest { target_spacing_px, budget_points, ..plain });
    }
    if cfg!(feature = "light") {
        requests.push(request("", Method::Lit, &all));
    }
    requests
}

/// Bits of a picture.
fn bits(picture: &Picture) -> (Vec<u8>, Vec<u32>) {
    (picture.rgba.clone(), picture.depth.iter().map(|depth| depth.to_bits()).collect())
}

#[test]
fn pictures_are_those_of_the_table_that_is_read_whole() {
    let (all, mut known) = (whole(), Vec::new());
    let nodes = all.table().nodes.len();
    assert!(nodes > 300 && all.nodes() == nodes as u64);
    for request in requests() {
        let what = (&request.camera, request.method, &request.colour_by, &request.filter);
        let (want, report) = draw(&all, &request, &Silent).unwrap();
        let partial = in_parts();
        let (got, other) = draw(&partial, &request, &Silent).unwrap();
        assert!(bits(&got) == bits(&want), "{what:?}");
        assert_eq!(format!("{:?}", other.legend), format!("{:?}", report.legend), "{what:?}");
        let grown = completed(&in_parts(), &request, &Silent).unwrap().unwrap_or_else(in_parts);
        known.push(grown.table().nodes.len());
    }
    known.sort_unstable();
    println!("of {nodes} nodes are known: {known:?}");
    assert!(known[0] < nodes / 4 && known[known.len() / 2] < nodes, "{known:?} of {nodes}");
}

#[test]
fn picks_are_those_of_the_table_that_is_read_whole() {
    let all = whole();
    for filter in [Filter::default(), filters().remove(0)] {
        let request = request(&cameras()[1], Method::Auto, &filter);
        let (picture, _) = draw(&all, &request, &Silent).unwrap();
        let scene = PictureScene::choose(&all, &request).unwrap();
        let view = scene.view.with_margin(0);
        let shown = |file: &Forest| PictureScene::choose(file, &request).unwrap().appearance.shown;
        let (of_all, mut picks) = (shown(&all), 0);
        for i in 0..200 {
            let share = |k: f64| (f64::from(i) * k).fract();
            let size = SIZE.map(f64::from);
            let at = DVec2::new(share(0.618) * size[0], share(0.414) * size[1]);
            let depth = picture.depth[at.y as usize * SIZE[0] as usize + at.x as usize];
            if !depth.is_finite() {
                continue;
            }
            // Nothing is known but the top.
            let partial = in_parts();
            let own = pick(&partial, &view, at, depth.into(), &shown(&partial)).unwrap();
            let other = pick(&all, &view, at, depth.into(), &of_all).unwrap();
            let own = own.map(|picked| Picked { file: String::new(), ..picked });
            let other = other.map(|picked| Picked { file: String::new(), ..picked });
            assert_eq!(own, other);
            picks += usize::from(own.is_some());
        }
        assert!(picks > 40, "{picks}");
    }
}

#[test]
fn sessions_settle_to_the_picture_of_the_table_that_is_read_whole() {
    for filter in [Filter::default()].into_iter().chain(filters()) {
        let settings = Settings { filter: filter.clone(), occlusion: false, ..Settings::default() };
        let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
        let open = |file: Forest| Session::open(Arc::new(file), options.clone()).unwrap();
        let mut sessions = [open(whole()), open(in_parts())];
        for camera in cameras() {
            let request = request(&camera, Method::Auto, &filter);
            let view = PictureScene::choose(&whole(), &request).unwrap().view;
            let pictures = sessions.each_mut().map(|session| {
                let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
                assert!(cut.complete && !cut.nodes.is_empty(), "{camera}, {filter:?}");
                let mut frames = 0;
                loop {
                    let frame = session.frame(&view).unwrap();
                    frames += 1;
                    if frame.is_final || frames == 50 {
                        break frame.image.in_memory().unwrap().rgba.clone();
                    }
                }
            });
            let off = pictures[0].iter().zip(&pictures[1]).filter(|(a, b)| a.abs_diff(**b) > 1);
            assert_eq!(off.count(), 0, "{camera}, {filter:?}");
        }
        let known = sessions.map(|session| session.file().table().nodes.len());
        assert!(known[1] < known[0], "{known:?}, {filter:?}");
    }
}

#[test]
fn a_flight_over_a_table_in_parts_loses_no_node() {
    let settings = Settings { budget_gpu_bytes: 2 << 20, ..Settings::default() };
    let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
    let mut session = Session::open(Arc::new(in_parts()), options).unwrap();
    let mut wanderer = Wanderer::new(&session, 7);
    for _ in 0..60 {
        let frame = session.frame(&wanderer.next()).unwrap();
        assert_eq!(frame.status.nodes_failed, 0, "{:?}", frame.status);
    }
    let cut = session.settle(&wanderer.next(), Duration::from_secs(60)).unwrap();
    assert!(!cut.nodes.is_empty());
}

#[test]
fn histograms_and_classes_are_those_of_the_whole_file() {
    let (all, partial) = (whole(), in_parts());
    for name in ["red", "intensity", "classification", "returns"] {
        let own = format!("{:?}", value_histogram(&partial, name).unwrap());
        assert_eq!(own, format!("{:?}", value_histogram(&all, name).unwrap()), "{name}");
    }
    assert!(Forest::open(sample()).unwrap().files().all(|file| file.top().is_none()));
}
