//! Sessions draw a picture at once and never an empty one, keep their budgets on a random flight,
//! report faults of the file while everything else goes on, and end within a second.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[path = "look/compact.rs"]
mod compact;
mod creek;
#[path = "look/exposure.rs"]
mod exposure;
#[path = "look/faces.rs"]
mod faces;
mod flicker;
#[cfg(feature = "light")]
#[path = "look/lit.rs"]
mod lit;
mod look;
#[path = "look/shapes.rs"]
mod shapes;
#[path = "look/splats.rs"]
mod splats;

use creek::{SIZE, Wanderer, overview, sample};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::Backend;
use esker_format::Forest;
use esker_lod::View;
use esker_render::Picture;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

fn open(path: &Path, budget_gpu_bytes: u64) -> Session {
    let file = Arc::new(Forest::open(path).unwrap());
    let options = Options {
        settings: Settings { budget_gpu_bytes, budget_ram_bytes: 64 << 20, ..Settings::default() },
        backend: Backend::Cpu,
        size: SIZE,
        ..Options::default()
    };
    Session::open(file, options).unwrap()
}

#[test]
fn the_first_frame_shows_the_scan_and_later_frames_show_all_of_it() {
    let mut session = open(sample(), 64 << 20);
    let view = overview(&session);
    // The first frame may come before the first choice for this view; the second one follows the
    // choice.
    session.settle(&view, Duration::ZERO).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let mut covered = Vec::new();
    loop {
        let frame = session.frame(&view).unwrap();
        let done = frame.cut.settled && frame.is_of_view;
        if frame.is_of_view {
            assert!(!frame.cut.nodes.is_empty(), "there is always a cut");
            covered.push(frame.stats.pixels_covered);
        }
        if done {
            assert!(frame.cut.complete, "{:?}", frame.status);
            break;
        }
        assert!(Instant::now() < deadline, "{:?}", frame.status);
    }
    assert!(covered.iter().all(|&c| c * 10 >= covered[covered.len() - 1] * 9), "{covered:?}");
}

#[test]
fn frames_of_a_still_view_converge_to_the_complete_picture() {
    let luminance = |picture: &Picture| -> Vec<f64> {
        let weigh = |p: &[u8]| {
            0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2])
        };
        picture.rgba.chunks_exact(4).map(weigh).collect()
    };
    let mut session = open(sample(), 64 << 20);
    let view = overview(&session);
    session.settle(&view, Duration::from_secs(60)).unwrap();
    let complete = luminance(session.frame(&view).unwrap().image.in_memory().unwrap());
    drop(session);
    // A small run at a time: few nodes arrive between two frames.
    let file = Arc::new(Forest::open(sample()).unwrap());
    let slow = Options {
        settings: Settings { budget_gpu_bytes: 64 << 20, ..Settings::default() },
        backend: Backend::Cpu,
        size: SIZE,
        runs: Some(1),
        loaders: 1,
        ..Options::default()
    };
    let mut session = Session::open(file, slow).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let mut errors = Vec::new();
    loop {
        let frame = session.frame(&view).unwrap();
        let done = frame.cut.settled && frame.is_of_view;
        if frame.is_of_view {
            let now = luminance(frame.image.in_memory().unwrap());
            let sum: f64 = now.iter().zip(&complete).map(|(a, b)| (a - b).abs()).sum();
            errors.push(sum / now.len() as f64);
        }
        if done {
            break;
        }
        assert!(Instant::now() < deadline, "{:?}", frame.status);
    }
    assert!(errors.len() > 3 && errors[0] > 1.0, "nothing arrived: {errors:?}");
    // Of 255; a difference below a tenth is invisible.
    let rises = errors.windows(2).filter(|e| e[1] > (e[0] * 1.02).max(0.1)).count();
    assert_eq!(rises, 0, "{errors:?}");
}

#[test]
fn a_random_flight_stays_within_its_budgets_and_always_has_a_cut() {
    for (seed, budget) in [(1, 1 << 20), (2, 3 << 20)] {
        let mut session = open(sample(), budget);
        let mut wanderer = Wanderer::new(&session, seed);
        let mut drawn = 0;
        // The first cut comes from another thread, and an empty frame takes no time. After the
        // first cut there is always one.
        let deadline = Instant::now() + Duration::from_secs(60);
        let view = wanderer.next();
        while session.frame(&view).unwrap().cut.epoch == 0 {
            assert!(Instant::now() < deadline, "no cut arrived");
        }
        for i in 0..200 {
            let view = wanderer.next();
            let frame = session.frame(&view).unwrap();
            assert!(frame.cut.epoch > 0, "frame {i} has no cut");
            // The root, or a node below it, is in every view of this flight.
            drawn += usize::from(!frame.cut.nodes.is_empty());
            let status = &frame.status;
            assert!(status.drawing_bytes_peak <= budget, "frame {i}: {status:?}");
            assert_eq!(status.fault, None);
        }
        assert!(drawn >= 190, "only {drawn} of 200 frames drew nodes");
        let status = session.status();
        assert!(status.nodes_loaded > 20, "{status:?}");
        assert!(budget > 1 << 20 || status.nodes_evicted > 0, "the budget is tight: {status:?}");
        // The system may suspend a thread now and then; waiting for the disk would stall every
        // frame.
        assert!(session.stalls() < 20, "the render thread waited {} times", session.stalls());
        let start = Instant::now();
        drop(session);
        assert!(start.elapsed() < Duration::from_secs(1), "ended after {:?}", start.elapsed());
    }
}

#[test]
fn a_file_truncated_in_flight_is_reported_and_the_session_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.esker");
    std::fs::copy(sample(), &path).unwrap();
    let mut session = open(&path, 8 << 20);
    let mut wanderer = Wanderer::new(&session, 7);
    for _ in 0..5 {
        let view = wanderer.next();
        session.frame(&view).unwrap();
    }
    let length = std::fs::metadata(&path).unwrap().len();
    std::fs::OpenOptions::new().write(true).open(&path).unwrap().set_len(length / 8).unwrap();
    let deadline = Instant::now() + Duration::from_secs(30);
    while session.status().fault.is_none() {
        let view = wanderer.next();
        let frame = session.frame(&view).unwrap();
        assert!(frame.cut.epoch > 0);
        assert!(Instant::now() < deadline, "no fault was reported: {:?}", session.status());
    }
    let fault = session.status().fault.unwrap();
    assert!(fault.contains("cut.esker"), "{fault}");
    for _ in 0..20 {
        let view = wanderer.next();
        session.frame(&view).unwrap();
    }
    let view = overview(&session);
    session.settle(&view, Duration::from_secs(1)).unwrap();
    let frame = session.frame(&view).unwrap();
    assert!(frame.stats.pixels_covered > 1000, "resident nodes are drawn");
    let start = Instant::now();
    drop(session);
    assert!(start.elapsed() < Duration::from_secs(1), "ended after {:?}", start.elapsed());
}

#[test]
fn too_small_budgets_are_refused_and_the_error_has_the_least_valid_one() {
    let file = Arc::new(Forest::open(sample()).unwrap());
    let within = |settings| Options { settings, size: SIZE, ..Options::default() };
    let refused = |settings: Settings| {
        let options = within(settings);
        let error = Session::open(file.clone(), options).err().unwrap();
        format!("{error:#}")
    };
    let small = Settings::default();
    let error = refused(Settings { budget_ram_bytes: 1 << 20, ..small.clone() });
    assert!(error.contains("session-sample.esker") && error.contains("--budget-ram"), "{error}");
    let least: u64 = error.split(": ").last().unwrap().split(' ').next().unwrap().parse().unwrap();
    let works = Settings { budget_ram_bytes: least << 20, ..small.clone() };
    drop(Session::open(file.clone(), within(works.clone())).unwrap());
    let error = refused(Settings { budget_ram_bytes: (least - 1) << 20, ..works });
    assert!(error.contains(&least.to_string()), "{error}");
    let error = refused(Settings { budget_gpu_bytes: 1000, ..small });
    assert!(error.contains("--budget-gpu"), "{error}");
}

#[test]
fn a_picture_larger_than_the_session_was_opened_for_is_refused() {
    let mut session = open(sample(), 8 << 20);
    let view = View { width: SIZE[0] * 2, ..overview(&session) };
    assert!(session.frame(&view).is_err());
}
