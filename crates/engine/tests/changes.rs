//! A running session changes its colours, filter, budgets and occlusion: its pictures are those of
//! a session that was opened with them, and what both need is not read again.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "other tests draw its scan")]
mod creek;

use creek::{SIZE, Wanderer, overview};
use esker_engine::Method;
use esker_engine::cameras::vertical::Vertical;
use esker_engine::draw::change::Budgets;
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::{Backend, GpuRequest};
use esker_format::{Forest, PlaneKind};
use esker_lod::View;
use esker_points::Filter;
use esker_points::filter::{Bounds, Classes, Clip, ClipShape, Polygon};
use esker_points::task::Silent;
use esker_render::Picture;
use esker_render::gpu::Gpu;
use esker_render::gpu::device::all_interfaces;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

const ROOMY: u64 = 48 << 20;

/// A generated scan with classes and times, in many small nodes; built once.
fn terrain() -> &'static Path {
    static FILE: OnceLock<PathBuf> = OnceLock::new();
    FILE.get_or_init(|| {
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("changes-terrain.esker");
        let options = esker_builder::Options { node_capacity: 2048, ..Default::default() };
        let scan = PathBuf::from("synthetic:terrain:300k:1");
        esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
        out
    })
}

fn settings() -> Settings {
    Settings { budget_gpu_bytes: ROOMY, occlusion: false, ..Settings::default() }
}

fn opened(settings: Settings) -> Session {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let backend = Backend::Cpu;
    let options = Options { settings, backend, size: SIZE, ..Options::default() };
    Session::open(file, options).unwrap()
}

/// Draws frames of a view until they are final.
fn finished(session: &mut Session, view: &View) -> Picture {
    let deadline = Instant::now() + Duration::from_secs(120);
    while !session.frame(view).unwrap().is_final {
        assert!(Instant::now() < deadline, "{:?}", session.status());
        assert_eq!(session.status().fault, None);
    }
    assert!(session.shows_newest());
    session.picture().unwrap()
}

fn assert_same(changed: &Picture, fresh: &Picture, what: &str) {
    assert!(fresh.stats.points_drawn > 0, "{what}: the picture is empty");
    assert_eq!(changed.stats.points_drawn, fresh.stats.points_drawn, "{what}");
    let off = changed.rgba.iter().zip(&fresh.rgba).filter(|(a, b)| a != b).count();
    assert_eq!((changed.rgba.len(), off), (fresh.rgba.len(), 0), "{what}");
    assert!(changed.depth == fresh.depth, "{what}: depths differ");
}

/// The middle of the scan from `low` to `high`, shares of its sides.
fn part(file: &Forest, low: f64, high: f64) -> Bounds {
    let [min, max] = esker_engine::calls::info::bounds(file);
    let at = |share: f64| [0, 1, 2].map(|i| min[i] + (max[i] - min[i]) * share);
    let ([x0, y0, _], [x1, y1, _]) = (at(low), at(high));
    Bounds { min: [x0, y0, f64::NEG_INFINITY], max: [x1, y1, f64::INFINITY] }
}

/// A filter of each kind.
fn filters(file: &Forest) -> Vec<(&'static str, Filter)> {
    let Bounds { min: [x0, y0, _], max: [x1, y1, _] } = part(file, 0.1, 0.8);
    let polygon = Polygon::new(vec![vec![[x0, y0], [x1, y0], [x1, y1]]]).unwrap();
    let classes: Classes = "ground".parse().unwrap();
    let turned = |degrees: f64| {
        let [low, high] = esker_engine::calls::info::bounds(file);
        let centre = [0, 1, 2].map(|i| f64::midpoint(low[i], high[i]));
        let size = [x1 - x0, (y1 - y0) / 2.0, 1e4];
        Clip::from(ClipShape::Oriented { centre, size, rotation: [degrees, 10.0, 0.0] })
    };
    let all = Filter::default;
    vec![
        ("box", Filter { bounds: Some(part(file, 0.2, 0.7)), ..all() }),
        ("classes", Filter { classes: Some(classes), ..all() }),
        ("polygon", Filter { polygon: Some(polygon), ..all() }),
        ("clip", Filter { clips: vec![turned(30.0)], ..all() }),
        ("clips", Filter { clips: vec![turned(30.0), turned(75.0).inverted()], ..all() }),
        ("spacing", Filter { max_spacing: Some((x1 - x0) / 100.0), ..all() }),
        ("all", all()),
    ]
}

/// Settings that each differ from the ones before.
fn changes(file: &Forest) -> Vec<(String, Settings)> {
    let colour = |name: &str| Settings { colour_by: Some(name.into()), ..settings() };
    let names = ["elevation", "intensity", "intensity:100..200", "classification", "gps_time"];
    let mut all: Vec<_> = names.map(|name| (name.to_owned(), colour(name))).into();
    let filtered = filters(file).into_iter();
    all.extend(filtered.map(|(name, filter)| (name.into(), Settings { filter, ..settings() })));
    // Most nodes cross the ends of a range of values.
    let values = vec!["intensity:5000..12000".parse().unwrap()];
    let filter = Filter { values, ..Filter::default() };
    all.push(("values".into(), Settings { filter, ..settings() }));
    let vertical = Vertical::nearest(DVec3::NEG_X);
    all.push(("vertical".into(), Settings { vertical, ..colour("elevation") }));
    all.push(("points".into(), Settings { points_budget: 20_000, ..settings() }));
    all.push(("spacing of the picture".into(), Settings { target_spacing_px: 3.0, ..settings() }));
    all.push(("less memory".into(), Settings { budget_gpu_bytes: 1 << 20, ..settings() }));
    all.push(("more memory".into(), Settings { budget_gpu_bytes: 2 * ROOMY, ..settings() }));
    all.push(("culling".into(), Settings { culls_back: true, ..settings() }));
    all.push(("occlusion".into(), Settings { occlusion: true, ..settings() }));
    all.push(("points alone".into(), Settings { method: Method::Points, ..settings() }));
    all.push(("as it was".into(), settings()));
    all
}

#[test]
fn a_changed_session_draws_what_one_draws_that_was_opened_so() {
    let mut session = opened(settings());
    let view = overview(&session);
    let first = finished(&mut session, &view);
    let mut last = first.rgba.clone();
    for (what, wanted) in changes(&Arc::clone(session.file())) {
        assert!(session.set(wanted.clone()).unwrap(), "{what}");
        assert_eq!(*session.settings(), wanted);
        let changed = finished(&mut session, &view);
        let fresh = finished(&mut opened(wanted), &view);
        assert_same(&changed, &fresh, &what);
        let is_seen = ["more memory", "culling", "occlusion"].contains(&what.as_str());
        assert!(is_seen || changed.rgba != last, "{what} changes the picture");
        last = changed.rgba;
    }
    assert_eq!(last, first.rgba);
}

#[test]
fn resident_nodes_stay_and_only_what_a_filter_changes_is_read() {
    let mut session = opened(settings());
    let view = overview(&session);
    finished(&mut session, &view);
    let whole = session.status();
    for (what, filter) in filters(&Arc::clone(session.file())) {
        let before = session.status();
        assert!(session.set_filter(filter).unwrap());
        session.frame(&view).unwrap();
        let at_once = session.status();
        assert!(at_once.nodes_resident >= whole.nodes_resident, "{what}: {at_once:?}");
        finished(&mut session, &view);
        let read = session.status().useful_bytes - before.useful_bytes;
        // Of nodes that cross a border, positions are read with the unwanted points marked.
        let (file, shown) = (session.file(), &session.appearance().shown);
        let crossing =
            (0u32..).zip(&file.table().nodes).filter(|(node, _)| shown.hides_points(*node));
        let of = |(node, record): (u32, &esker_points::Node)| {
            file.value_bytes(node, PlaneKind::Position) * record.points() as u64
        };
        let most: u64 = crossing.map(of).sum();
        assert!(read <= most, "{what}: {read} of at most {most} bytes");
        assert!(read * 2 < whole.useful_bytes, "{what}: {read} of {}", whole.useful_bytes);
    }
    assert_eq!(session.status().nodes_evicted, 0);
    // Colours that were drawn before are still there.
    for (colour, is_known) in [("intensity", false), ("rgb", true), ("intensity", true)] {
        let before = session.status();
        assert!(session.set_colours(Some(colour.into())).unwrap());
        session.frame(&view).unwrap();
        assert!(session.status().nodes_resident >= whole.nodes_resident);
        finished(&mut session, &view);
        let read = session.status().useful_bytes - before.useful_bytes;
        assert_eq!(read == 0, is_known, "{colour}: {read} bytes");
        assert!(read * 2 < whole.useful_bytes, "{colour}: {read} of {}", whole.useful_bytes);
    }
}

#[test]
fn a_picture_keeps_its_nodes_while_new_colours_are_read() {
    let mut session = opened(settings());
    let view = overview(&session);
    let nodes = |session: &mut Session| session.frame(&view).unwrap().cut.nodes.len();
    finished(&mut session, &view);
    let all = nodes(&mut session);
    for colour in ["classification", "gps_time", "intensity", "elevation"] {
        session.set_colours(Some(colour.into())).unwrap();
        let deadline = Instant::now() + Duration::from_secs(120);
        loop {
            assert_eq!(nodes(&mut session), all, "{colour}");
            if session.frame(&view).unwrap().is_final {
                break;
            }
            assert!(Instant::now() < deadline, "{:?}", session.status());
        }
        assert!(session.shows_newest());
    }
}

/// A pseudo-random whole number below `end`.
fn dice(state: &mut u64, end: u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) % end
}

/// Changes one setting at random.
fn vary(settings: &mut Settings, file: &Forest, state: &mut u64) {
    let pick = |state: &mut u64, of: &[u64]| of[dice(state, of.len() as u64) as usize];
    match dice(state, 8) {
        0 | 1 => {
            let sources = esker_engine::cameras::colour::choices(file);
            let at = dice(state, sources.len() as u64) as usize;
            settings.colour_by = Some(sources[at].clone());
        }
        2 | 3 => {
            let all = filters(file);
            settings.filter = all[dice(state, all.len() as u64) as usize].1.clone();
        }
        4 => settings.budget_gpu_bytes = pick(state, &[1 << 20, 2 << 20, 5 << 20, 16 << 20, ROOMY]),
        5 => {
            settings.points_budget = pick(state, &[5_000, 50_000, 1_000_000]);
            settings.target_spacing_px = pick(state, &[1, 2, 4]) as f64 * 0.5;
        }
        6 => settings.occlusion = !settings.occlusion,
        _ => {
            let methods = [Method::Points, Method::PullPush, Method::Auto, Method::Ewa];
            settings.method = methods[dice(state, methods.len() as u64) as usize];
            settings.culls_back = dice(state, 2) == 0;
        }
    }
}

#[test]
fn two_hundred_changes_in_a_row_keep_the_budgets_and_end_at_the_picture_of_a_new_session() {
    let mut session = opened(settings());
    let file = Arc::clone(session.file());
    let mut wanderer = Wanderer::new(&session, 11);
    let (mut state, mut wanted, mut most) = (3, settings(), ROOMY);
    for i in 0..200 {
        vary(&mut wanted, &file, &mut state);
        assert!(session.set(wanted.clone()).unwrap(), "change {i}");
        most = most.max(wanted.budget_gpu_bytes);
        let view = wanderer.next();
        for _ in 0..dice(&mut state, 4) {
            let frame = session.frame(&view).unwrap();
            assert_eq!(frame.status.fault, None, "change {i}");
            assert!(frame.status.drawing_bytes <= most, "change {i}: {:?}", frame.status);
        }
        if i % 20 == 19 {
            // A smaller budget holds as soon as the picture is final.
            finished(&mut session, &view);
            most = wanted.budget_gpu_bytes;
            let frame = session.frame(&view).unwrap();
            let counters = frame.cut.counters;
            assert!(frame.cut.nodes.len() < 2 || counters.points <= wanted.points_budget);
            let status = session.status();
            assert!(status.drawing_bytes <= most, "change {i}: {status:?}");
        }
    }
    let last = Settings { occlusion: false, ..settings() };
    let last = Settings { filter: filters(&file)[0].1.clone(), ..last };
    assert!(session.set(last.clone()).unwrap());
    let view = overview(&session);
    let changed = finished(&mut session, &view);
    assert_same(&changed, &finished(&mut opened(last), &view), "the last change");
}

#[test]
fn what_a_session_cannot_change_is_said_and_changes_nothing() {
    let mut session = opened(settings());
    let view = overview(&session);
    let before = finished(&mut session, &view);
    let error = session.set_colours(Some("moisture".into())).unwrap_err().to_string();
    assert!(error.contains("no attribute `moisture`"), "{error}");
    let budgets =
        Budgets { points: 1_000_000, target_spacing_px: 1.0, gpu_bytes: ROOMY, ram_bytes: 1 << 20 };
    let error = session.set_budgets(budgets).unwrap_err().to_string();
    assert!(error.contains("--budget-ram"), "{error}");
    // The roots do not fit.
    assert!(
        !session.set_budgets(Budgets { gpu_bytes: 4096, ram_bytes: 1 << 30, ..budgets }).unwrap()
    );
    assert!(!session.set(Settings { method: Method::Lit, ..settings() }).unwrap());
    assert_eq!(*session.settings(), settings());
    assert_same(&finished(&mut session, &view), &before, "nothing has changed");
    assert!(session.set_occlusion(true).unwrap() && session.set_culling(true).unwrap());
    assert!(session.set_vertical(Vertical::nearest(DVec3::Y)).unwrap());
    assert!(session.settings().occlusion && session.settings().culls_back);
}

#[test]
fn a_gpu_changes_as_the_cpu_does_and_frees_memory_within_what_it_was_opened_with() {
    let of = |backends| GpuRequest { backends, allow_software: true, ..GpuRequest::default() };
    for request in all_interfaces().iter().copied().map(of) {
        let Ok(gpu) = Gpu::open(&request) else { continue };
        let open = |settings: Settings| {
            let file = Arc::new(Forest::open(terrain()).unwrap());
            let backend = Backend::Gpu;
            let device = Some(gpu.clone());
            let options = Options { settings, backend, device, size: SIZE, ..Options::default() };
            Session::open(file, options).unwrap()
        };
        let mut session = open(settings());
        let file = Arc::clone(session.file());
        let view = overview(&session);
        finished(&mut session, &view);
        let colour = |name: &str| Settings { colour_by: Some(name.into()), ..settings() };
        let [(_, bounds), ..] = &filters(&file)[..] else { panic!("there are filters") };
        let wanted = [
            colour("intensity"),
            Settings { filter: bounds.clone(), ..settings() },
            Settings { points_budget: 20_000, ..settings() },
            settings(),
        ];
        for wanted in wanted {
            assert!(session.set(wanted.clone()).unwrap());
            let changed = finished(&mut session, &view);
            let fresh = finished(&mut open(wanted.clone()), &view);
            assert_eq!(changed.rgba, fresh.rgba, "{wanted:?}");
            assert_eq!(gpu.fault(), None);
        }
        let more = Settings { budget_gpu_bytes: 2 * ROOMY, ..settings() };
        assert!(!session.set(more).unwrap(), "more memory takes another session");
        let status = session.status();
        assert!(status.drawing_bytes_peak <= ROOMY, "{status:?}");
        assert!(session.gpu_bytes().unwrap().bytes <= ROOMY);
    }
}
