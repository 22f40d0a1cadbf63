//! What pictures show: filters show what an export writes, and nothing else is read; attributes
//! that are not shown are neither read nor resident; sessions draw what pictures show; and each
//! colour map and method has its golden picture.

mod histograms;

use esker_engine::calls::info;
use esker_engine::calls::render::draw;
use esker_engine::cameras::colour::{choices, colouring};
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::io::picture;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{Filter, Method, NormalsMode, Picture};
use esker_format::{Forest, ForestFilter, PlaneKind};
use esker_lod::CompactOctree;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES};
use esker_points::task::Silent;
use esker_render::{Frame, Pass, Renderer};
use esker_truth::flip::mean_flip;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Width and height of the golden pictures.
const SIZE: [u32; 2] = [128, 96];

/// A generated scan with all attributes of LAS and normals, in small nodes; built once for all
/// tests.
pub fn terrain() -> &'static Path {
    static TERRAIN: OnceLock<PathBuf> = OnceLock::new();
    TERRAIN.get_or_init(|| build_terrain("terrain", NormalsMode::Estimate))
}

fn build_terrain(name: &str, normals: NormalsMode) -> PathBuf {
    let name = format!("{}-{name}.esker", env!("CARGO_CRATE_NAME"));
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    build(Path::new("synthetic:terrain:60000:5"), &out, normals);
    out
}

fn build(scan: &Path, out: &Path, normals: NormalsMode) {
    let options = esker_builder::Options { node_capacity: 1024, normals, ..Default::default() };
    esker_builder::build(&[scan.to_owned()], out, &options, &Silent).unwrap();
}

/// Two scans of a hill, each of two thirds of it, the second twice as bright.
fn two_exposures(folder: &Path) -> Forest {
    let mut rows = "x,y,z,point_source_id,red,green,blue\n".to_owned();
    for i in 0..20_000u32 {
        let scan = i % 2;
        let (u, v) = (f64::from(i) * 0.754_877_67 % 1.0, f64::from(i) * 0.569_840_29 % 1.0);
        let (x, y) = (12.0 * (u * 2.0 + f64::from(scan)) / 3.0, 9.0 * v);
        let z = (x * 0.7).sin() + (y * 0.5).cos();
        let light = (1.0 + f64::from(scan)) * (60.0 + 8.0 * (x + y).sin());
        let [red, green, blue] = [1.2, 1.0, 0.7].map(|c| (light * c) as u8);
        rows += &format!("{x:.4},{y:.4},{z:.4},{},{red},{green},{blue}\n", scan + 1);
    }
    let (scan, out) = (folder.join("two.csv"), folder.join("two.esker"));
    std::fs::write(&scan, rows).unwrap();
    build(&scan, &out, NormalsMode::Estimate);
    Forest::open(&out).unwrap()
}

pub fn request() -> PictureRequest {
    let with = DrawWith { backend: Backend::Cpu, ..DrawWith::default() };
    PictureRequest { size: SIZE, with, ..PictureRequest::default() }
}

/// Filters of every kind: a box over a quarter of the scan, classes, a spacing, and all at once.
fn filters(file: &Forest) -> Vec<Filter> {
    let [low, high] = info::bounds(file);
    let middle = |axis: usize| (low[axis] + high[axis]) / 2.0;
    let text = format!("{},{},{},{}", low[0], low[1], middle(0), middle(1));
    let bounds = Some(text.parse().unwrap());
    let classes = Some("2,5".parse().unwrap());
    let max_spacing = Some(f64::from(file.table().nodes[0].spacing) / 3.0);
    let none = Filter::default();
    vec![
        Filter { bounds, ..none.clone() },
        Filter { classes, ..none.clone() },
        Filter { max_spacing, ..none.clone() },
        Filter { bounds, classes, max_spacing, ..none },
    ]
}

/// Number of shown points: those of the prefixes that are not marked.
fn shown_points(file: &Forest, filter: &Filter) -> u64 {
    let shown =
        ForestFilter::of(file, Some(filter.on(file.lattice(), file.schema()).unwrap()), None)
            .unwrap();
    let nodes = 0..file.table().nodes.len() as u32;
    let count = |node: u32| {
        let planes = shown.read(file, node, &[PlaneKind::Position]).unwrap();
        let points = planes.get(PlaneKind::Position).unwrap().chunks(HOT_POSITION_BYTES);
        let prefix = points.take(shown.points_max(node));
        prefix.filter(|point| point[HIDDEN_AT] == 0).count() as u64
    };
    nodes.filter(|&node| !shown.rejects_subtree(node)).map(count).sum()
}

#[test]
fn a_filter_shows_what_export_writes() {
    let file = Forest::open(terrain()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (i, filter) in filters(&file).iter().enumerate() {
        let out = folder.path().join(format!("{i}.las"));
        let written = esker_builder::export(&file, &out, filter, &Silent).unwrap().points_out;
        assert!(written > 100 && written < file.points() * 3 / 4, "{filter:?}: {written}");
        assert_eq!(shown_points(&file, filter), written, "{filter:?}");
    }
}

#[test]
fn filtered_points_are_neither_read_nor_resident() {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let all = PictureRequest { target_spacing_px: 0.0, ..request() };
    let whole = PictureScene::read(&file, &all, &Silent).unwrap();
    let camera = camera_of(&whole);
    for filter in filters(&file) {
        let mut picture_request = PictureRequest { filter: filter.clone(), camera, ..all.clone() };
        let scene = PictureScene::read(&file, &picture_request, &Silent).unwrap();
        let shown = &scene.appearance.shown;
        let drawn = |node| scene.selection.drawn.iter().any(|d| d.node == node);
        assert!(scene.selection.counters.filtered > 0 || filter.max_spacing.is_some());
        assert!((0..file.table().nodes.len() as u32).all(|n| shown.points_max(n) > 0 || !drawn(n)));
        if filter.bounds.is_some() {
            let (few, many) = (scene.read_bytes, whole.read_bytes);
            assert!(few < many * 3 / 4, "{few} of {many} bytes are read of a quarter");
            let mut bytes = [filter.clone(), Filter::default()].map(|filter| {
                let mut session = session(&file, Settings { filter, ..Settings::default() });
                session.settle(&scene.view, Duration::from_secs(60)).unwrap();
                let status = session.status();
                (status.drawing_bytes, status.read_bytes)
            });
            bytes.sort_unstable();
            assert!(
                bytes[0].0 < bytes[1].0 * 3 / 4 && bytes[0].1 < bytes[1].1 * 3 / 4,
                "{bytes:?}"
            );
        }
        // No point has this class: no page is read.
        picture_request.filter.classes = Some("250".parse().unwrap());
        assert!(PictureScene::read(&file, &picture_request, &Silent).unwrap().planes.is_empty());
    }
}

/// Camera of a scene, which stays the same whatever a filter accepts.
pub fn camera_of(scene: &PictureScene) -> esker_engine::cameras::camera::Camera {
    let (eye, forward) = (scene.view.eye, scene.view.forward());
    let mut camera = esker_engine::cameras::camera::Camera::default();
    (camera.eye, camera.target) = (Some(eye), Some(eye + forward));
    camera
}

pub fn session(file: &Arc<Forest>, settings: Settings) -> Session {
    let settings = Settings { occlusion: false, ..settings };
    let options = Options { settings, backend: Backend::Cpu, size: SIZE, ..Options::default() };
    Session::open(file.clone(), options).unwrap()
}

/// Fraction of the pixels that differ by more than 8 of 255 in any channel.
pub fn off(a: &Picture, b: &Picture) -> f64 {
    let differs = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 8);
    let pairs = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    pairs.filter(|&pair| differs(pair)).count() as f64 / (a.rgba.len() / 4) as f64
}

#[test]
fn a_session_draws_the_picture_of_the_render_call() {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let none = Filter::default();
    let mut cases = vec![("gps_time", none.clone()), ("return_number", none)];
    cases.extend(filters(&file).into_iter().map(|filter| ("classification", filter)));
    for (colour, filter) in cases {
        let colour_by = Some(colour.to_owned());
        let picture_request =
            PictureRequest { colour_by: colour_by.clone(), filter: filter.clone(), ..request() };
        let view = PictureScene::choose(&file, &picture_request).unwrap().view;
        let (expected, _) = draw(&file, &picture_request, &Silent).unwrap();
        let mut session = session(&file, Settings { colour_by, filter, ..Settings::default() });
        session.settle(&view, Duration::from_secs(60)).unwrap();
        assert!(session.frame(&view).unwrap().cut.complete);
        let off = off(&session.picture().unwrap(), &expected);
        assert!(off <= 0.001, "{colour} {:?}: {off} of the pixels differ", picture_request.filter);
    }
}

#[test]
fn depths_have_the_colours_of_their_own_range() {
    let file = Forest::open(terrain()).unwrap();
    let colour = |name: &str| PictureRequest { colour_by: Some(name.into()), ..request() };
    let range = |name: &str| {
        let scene = PictureScene::choose(&file, &colour(name)).unwrap();
        scene.appearance.colouring.legend.range
    };
    let (picture, _) = draw(&file, &colour("depth"), &Silent).unwrap();
    let [low, high] = range("depth").unwrap();
    let depths = picture.depth.iter().copied().filter(|d| d.is_finite());
    let (nearest, farthest) = depths.fold((f32::MAX, 0f32), |(a, b), d| (a.min(d), b.max(d)));
    let [nearest, farthest] = [nearest, farthest].map(f64::from);
    assert!(0.99 * low < nearest && farthest < high * 1.01, "{low}..{high}: {nearest} {farthest}");
    assert!(farthest - nearest > 0.6 * (high - low), "{low}..{high}: {nearest} {farthest}");
    assert_eq!(range("depth:5..7"), Some([5.0, 7.0]));
}

#[test]
fn the_scan_angle_is_found_by_either_name() {
    let file = Forest::open(terrain()).unwrap();
    for name in ["scan_angle", "scan_angle_rank"] {
        let colouring = colouring(&file, Some(name), info::bounds(&file)).unwrap();
        assert_eq!(colouring.legend.name, "scan_angle");
    }
}

#[test]
fn only_shown_attributes_are_resident() {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let view = PictureScene::choose(&file, &request()).unwrap().view;
    let bytes = |colour: &str, method| {
        let colour_by = Some(colour.to_owned());
        let mut session = session(&file, Settings { colour_by, method, ..Settings::default() });
        let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
        let of = |kind| {
            let slots = cut.nodes.iter().filter_map(|n| n.slot(kind));
            slots.map(|slot| slot.bytes).sum::<u64>()
        };
        let time = file.schema().find("gps_time").unwrap() as u16;
        [PlaneKind::Position, PlaneKind::Normal, PlaneKind::Attribute(time)].map(of)
    };
    let [positions, normals, values] = bytes("gps_time", Method::PullPush);
    assert_eq!((normals, values), (positions / 2, positions / 8), "a byte for each of its eight");
    assert_eq!(bytes("plain", Method::PullPush), [positions, positions / 2, 0]);
    assert_eq!(bytes("plain", Method::Points), [positions, 0, 0]);
    assert_eq!(bytes("normal", Method::Points), [positions, positions / 2, 0]);
}

#[test]
fn normals_are_streamed_when_a_session_begins_to_draw_surfaces() {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let view = PictureScene::choose(&file, &request()).unwrap().view;
    let settings = || Settings { colour_by: Some("plain".into()), ..Settings::default() };
    let mut fresh = session(&file, settings());
    fresh.settle(&view, Duration::from_secs(60)).unwrap();
    fresh.frame(&view).unwrap();
    let expected = fresh.picture().unwrap();
    let mut session = session(&file, Settings { method: Method::Points, ..settings() });
    session.settle(&view, Duration::from_secs(60)).unwrap();
    session.frame(&view).unwrap();
    session.set_method(Method::PullPush);
    let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
    let came = cut.complete && cut.nodes.iter().all(|n| n.slot(PlaneKind::Normal).is_some());
    assert!(came, "{:?}", session.status());
    session.frame(&view).unwrap();
    assert!(off(&session.picture().unwrap(), &expected) <= 0.001);
}

#[test]
fn a_dense_view_needs_no_push() {
    let file = Forest::open(terrain()).unwrap();
    let picture_request = PictureRequest { target_spacing_px: 0.0, size: [32, 24], ..request() };
    let scene = PictureScene::read(&file, &picture_request, &Silent).unwrap();
    assert!(!scene.plan.passes.contains(&Pass::Push), "{:?}", scene.plan);
    let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
    let draws = scene.draws(&file);
    let frame = scene.appearance.frame(&file, &scene.view, &draws, &octree);
    let without = Renderer::default().render(&frame).unwrap();
    let with = Renderer::default().render(&Frame { skips_push: false, ..frame }).unwrap();
    assert_eq!(
        (without.stats.stages.ms(Pass::Push), without.stats.stages.ms(Pass::Pull)),
        (0.0, 0.0)
    );
    let flip = mean_flip(&without.rgba, &with.rgba, 32);
    assert!(flip <= 0.05, "FLIP {flip}");
    let near = PictureScene::choose(&file, &request()).unwrap();
    assert!(near.plan.passes.contains(&Pass::Push));
}

/// Compares with pictures in `tests/golden`: every colour map as points, and every method.
/// `ESKER_BLESS=1` writes them.
#[test]
fn every_map_and_method_has_its_golden_picture() {
    let file = Forest::open(terrain()).unwrap();
    let mut cases: Vec<_> = choices(&file).into_iter().map(|c| (Method::Points, c)).collect();
    cases.push((Method::Points, "elevation:530..540".into()));
    cases.extend(["rgb", "plain", "classification"].map(|c| (Method::PullPush, c.to_owned())));
    cases.push((Method::Ewa, "rgb".into()));
    for (method, colour) in cases {
        let name = match method {
            Method::Points => format!("points-{}.png", colour.replace([':', '.'], "-")),
            Method::Auto => format!("auto-{colour}.png"),
            Method::PullPush => format!("surface-{colour}.png"),
            Method::Ewa => format!("splats-{colour}.png"),
            Method::Lit => format!("lit-{colour}.png"),
        };
        let colour_by = Some(colour);
        is_golden(&file, &PictureRequest { method, colour_by, ..request() }, &name);
    }
}

/// Options of surfaces beside colours: no normals (they then come from depth, and clefts are
/// darkened), exposure compensation, no highlights, and a box, to which the view is fitted.
#[test]
fn every_option_of_surfaces_has_its_golden_picture() {
    let file = Forest::open(terrain()).unwrap();
    let rgb = PictureRequest { colour_by: Some("rgb".into()), ..request() };
    let plain = PictureRequest { colour_by: Some("plain".into()), ..request() };
    let filter = filters(&file).remove(0);
    is_golden(&file, &PictureRequest { filter, ..rgb.clone() }, "surface-rgb-box.png");
    let folder = tempfile::tempdir().unwrap();
    let hill = two_exposures(folder.path());
    let csg = folder.path().join("csg.esker");
    build(Path::new("synthetic:csg:20000"), &csg, NormalsMode::Estimate);
    let csg = Forest::open(&csg).unwrap();
    for (file, picture_request, other, name) in [
        (
            &hill,
            PictureRequest { evens_exposure: true, ..rgb.clone() },
            &rgb,
            "surface-rgb-even.png",
        ),
        (&csg, PictureRequest { shines: false, ..plain.clone() }, &plain, "surface-plain-matt.png"),
    ] {
        is_golden(file, &picture_request, name);
        let [with, without] = [&picture_request, other]
            .map(|picture_request| draw(file, picture_request, &Silent).unwrap().0);
        let flip = mean_flip(&with.rgba, &without.rgba, SIZE[0] as usize);
        assert!(flip > 0.02, "{name}: FLIP {flip} without the option");
    }
    let bare = build_terrain("bare", NormalsMode::None);
    let bare = Forest::open(&bare).unwrap();
    assert!(!bare.has(PlaneKind::Normal));
    is_golden(&bare, &rgb, "surface-rgb-bare.png");
    is_golden(&bare, &plain, "surface-plain-bare.png");
}

#[test]
fn estimated_normals_leave_the_default_colours_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("hill.csv");
    let row = |i: u32| format!("{},{},{}\n", i % 50, i / 50, f64::from(i % 50 * (i / 50)) * 0.01);
    std::fs::write(&scan, (0..2500).map(row).collect::<String>()).unwrap();
    let default = |file: &Forest| colouring(file, None, info::bounds(file)).unwrap().legend.name;
    for normals in [NormalsMode::Keep, NormalsMode::Estimate, NormalsMode::None] {
        let out = folder.path().join(format!("{normals:?}.esker"));
        build(&scan, &out, normals);
        let file = Forest::open(&out).unwrap();
        assert_eq!(file.has(PlaneKind::Normal), normals != NormalsMode::None);
        assert_eq!(default(&file), "elevation", "{normals:?}");
    }
    assert_eq!(default(&textured_sheet(folder.path())), "plain");
}

/// A sheet of 10 m x 10 m with points about 0.2 m apart, and texture coordinates s and t across it.
fn textured_sheet(folder: &Path) -> Forest {
    const SIDE: u32 = 50;
    let names = ["x", "y", "z", "nx", "ny", "nz", "s", "t"];
    let properties = names.map(|name| format!("property float {name}\n")).concat();
    let count = SIDE * SIDE;
    let mut rows =
        format!("ply\nformat ascii 1.0\nelement vertex {count}\n{properties}end_header\n");
    for i in 0..count {
        // Anywhere in its cell.
        let within = |step: f64| 0.1 + 0.8 * (f64::from(i) * step % 1.0);
        let s = (f64::from(i % SIDE) + within(0.754_877_67)) / f64::from(SIDE);
        let t = (f64::from(i / SIDE) + within(0.569_840_29)) / f64::from(SIDE);
        rows += &format!("{:.4} {:.4} 0 0 0 1 {s:.5} {t:.5}\n", s * 10.0, t * 10.0);
    }
    let (scan, out) = (folder.join("sheet.ply"), folder.join("sheet.esker"));
    std::fs::write(&scan, rows).unwrap();
    build(&scan, &out, NormalsMode::Keep);
    Forest::open(&out).unwrap()
}

#[test]
fn texture_coordinates_are_interpolated_between_points() {
    let folder = tempfile::tempdir().unwrap();
    let file = textured_sheet(folder.path());
    // Straight down on the middle 8 m: a pixel is 0.1 m, half the spacing of the points.
    const PIXELS: usize = 80;
    let camera = "eye=5,5,100;target=5,5,0;up=0,1,0;fovy=4.580";
    let camera = esker_engine::cameras::camera::Camera::parse(camera).unwrap();
    // Lightness of the colour maps at each pixel: it rises with the values.
    let lightness = |colour: &str| {
        let colour_by = Some(colour.to_owned());
        let size = [PIXELS as u32; 2];
        let picture_request =
            PictureRequest { size, camera, colour_by, shines: false, ..request() };
        let (drawn, _) = draw(&file, &picture_request, &Silent).unwrap();
        let pixels = drawn.rgba.chunks_exact(4);
        pixels.map(|p| p[..3].iter().map(|c| f64::from(*c)).sum()).collect::<Vec<f64>>()
    };
    let (s, t) = (lightness("s:0..1"), lightness("t:0..1"));
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / PIXELS as f64;
    let column = |x: usize| mean(&mut (0..PIXELS).map(|y| s[y * PIXELS + x]));
    let row = |y: usize| mean(&mut t[y * PIXELS..][..PIXELS].iter().copied());
    let columns: Vec<f64> = (0..PIXELS).map(column).collect();
    assert!(columns[PIXELS - 1] > columns[0] + 150.0, "{columns:?}");
    for k in 0..PIXELS {
        // The rows of the picture run down, t runs up; both cross the sheet in the same way.
        let (along_s, along_t) = (columns[k], row(PIXELS - 1 - k));
        assert!((along_s - along_t).abs() < 1.0, "{k}: {along_s} {along_t}");
        assert!(k == 0 || columns[k] > columns[k - 1] - 0.5, "{k}: {columns:?}");
        // Within a column little else changes.
        let most = (0..PIXELS).map(|y| (s[y * PIXELS + k] - along_s).abs()).fold(0.0, f64::max);
        assert!(most < 6.0, "{k}: {most}");
    }
}

/// Asserts that a picture is like the golden one.
pub fn is_golden(file: &Forest, picture_request: &PictureRequest, name: &str) {
    let (drawn, _) = draw(file, picture_request, &Silent).unwrap();
    let path = std::path::absolute("tests/golden").unwrap().join(name);
    if std::env::var_os("ESKER_BLESS").is_some() {
        picture::write_png(&drawn, &path).unwrap();
    }
    let flip = mean_flip(&drawn.rgba, &read_png(&path), SIZE[0] as usize);
    assert!(
        flip <= 0.01,
        "{name}: FLIP {flip}; if this is intended, run with ESKER_BLESS=1 and look at the picture"
    );
}

/// Pixels of a PNG, four bytes each.
pub fn read_png(path: &Path) -> Vec<u8> {
    let file = std::fs::File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    bytes.truncate(info.buffer_size());
    bytes
}
