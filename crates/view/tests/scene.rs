//! Tests of the scene: a filter that leaves no points shows none, and another filter shows points
//! again.

#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

use esker_engine::calls::build;
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera;
use esker_engine::io::progress::{Progress, Style};
use esker_engine::{BuildOptions, Filter, Forest, NormalsMode, View};
use esker_view::args::Backend;
use esker_view::device::WindowPainter;
use esker_view::scene::{FrameOutcome, FrameViews, Scene};
use esker_view::settings::Settings;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const SIZE: [u32; 2] = [160, 100];

/// Number of points drawn for this view, or the fault.
fn drawn(scene: &mut Scene, view: View) -> Result<u64, String> {
    let views = FrameViews { chosen: view, seen: view };
    let mut points = 0;
    while !scene.is_at_rest(&views) {
        match scene.frame(&views) {
            FrameOutcome::New(frame) => points = frame.stats.points_drawn,
            FrameOutcome::Failed(fault) => return Err(fault),
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    Ok(points)
}

/// The sample scan.
fn creek(folder: &Path) -> Arc<Forest> {
    let built = folder.join("creek.esker");
    let scan = Path::new("../../tests/sample/creek.laz").to_owned();
    let silent = Progress::new(Style::Silent, Default::default());
    let normals = NormalsMode::Estimate;
    let options = BuildOptions { normals, ..BuildOptions::default() };
    build::build(&[scan], &built, &options, 0, &silent).unwrap();
    Arc::new(Forest::open(&built).unwrap())
}

#[test]
fn a_filter_that_leaves_no_points_shows_none_until_another_filter_leaves_some() {
    let folder = tempfile::tempdir().unwrap();
    let file = creek(folder.path());
    let bounds = info::bounds(&file);
    let view = Camera::default().view(bounds, SIZE);
    let by = |filter: Filter| Settings { filter, ..Settings::default() };
    let device = WindowPainter::default().device(Backend::Cpu);
    let mut scene = Scene::new(file, Settings::default(), device, SIZE);
    let all = drawn(&mut scene, view).unwrap();
    for filter in [
        Filter { classes: Some("99".parse().unwrap()), ..Filter::default() },
        Filter { bounds: Some("0,0,1,1".parse().unwrap()), ..Filter::default() },
    ] {
        scene.set(by(filter));
        assert_eq!(drawn(&mut scene, view).unwrap(), 0);
    }
    let [low, high] = bounds;
    let half = format!("{},{},{},{}", low[0], low[1], low[0].midpoint(high[0]), high[1]);
    scene.set(by(Filter { bounds: Some(half.parse().unwrap()), ..Filter::default() }));
    let some = drawn(&mut scene, view).unwrap();
    assert!(0 < some && some < all, "{some} of {all}");
    assert_eq!(scene.reopened(), 0);
}

#[test]
fn settings_change_the_running_session_and_its_nodes_stay() {
    let folder = tempfile::tempdir().unwrap();
    let file = creek(folder.path());
    let bounds = info::bounds(&file);
    let view = Camera::default().view(bounds, SIZE);
    let views = FrameViews { chosen: view, seen: view };
    let device = WindowPainter::default().device(Backend::Cpu);
    let first = Settings::default();
    let mut scene = Scene::new(file, first.clone(), device, SIZE);
    drawn(&mut scene, view).unwrap();
    let nodes = scene.status().nodes_resident;
    let some = Filter { classes: Some("ground".parse().unwrap()), ..Filter::default() };
    for changed in [
        Settings { colour_by: Some("intensity".into()), ..first.clone() },
        Settings { filter: some, ..first.clone() },
        Settings { points_budget: 50_000, ..first.clone() },
        Settings { budget_gpu_bytes: 64 << 20, occlusion: false, ..first.clone() },
    ] {
        scene.set(changed);
        // Pictures go on while the change is prepared.
        assert!(matches!(scene.frame(&views), FrameOutcome::New(_)));
        assert!(scene.status().nodes_resident >= nodes);
        drawn(&mut scene, view).unwrap();
        assert_eq!(scene.reopened(), 0);
    }
    // What cannot be drawn is said until it is set otherwise, and the session stays.
    scene.set(Settings { colour_by: Some("moisture".into()), ..first.clone() });
    assert!(drawn(&mut scene, view).unwrap_err().contains("moisture"));
    scene.set(first.clone());
    assert!(drawn(&mut scene, view).unwrap() > 0);
    assert_eq!(scene.reopened(), 0);
    // Budgets that are too small are refused in the same way.
    scene.set(Settings { budget_ram_bytes: 1 << 20, ..first });
    assert!(drawn(&mut scene, view).unwrap_err().contains("--budget-ram"));
    assert_eq!(scene.reopened(), 0);
}

/// Draws until the picture is at rest. Returns the number of pictures.
#[cfg(feature = "light")]
fn rest(scene: &mut Scene, view: View) -> u32 {
    let views = FrameViews { chosen: view, seen: view };
    let mut pictures = 0;
    while !scene.is_at_rest(&views) {
        match scene.frame(&views) {
            FrameOutcome::New(frame) => {
                assert_eq!(frame.light.is_some(), frame.stats.splats_drawn > 0);
                pictures += 1;
            }
            FrameOutcome::Failed(fault) => panic!("{fault}"),
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
    }
    pictures
}

#[cfg(feature = "light")]
#[test]
fn lit_pictures_are_refined_to_rest_and_only_the_method_opens_a_session() {
    use esker_engine::Method;
    use esker_engine::light::sun;
    let folder = tempfile::tempdir().unwrap();
    let file = creek(folder.path());
    let size = [80, 50];
    let view = Camera::default().view(info::bounds(&file), size);
    let device = WindowPainter::default().device(Backend::Cpu);
    let mut scene = Scene::new(file, Settings::default(), device, size);
    rest(&mut scene, view);
    let mut lit = Settings { method: Method::Lit, ..Settings::default() };
    scene.set(lit.clone());
    assert!(scene.is_lit());
    assert!(rest(&mut scene, view) > 1, "a coarse picture comes first");
    assert_eq!(scene.reopened(), 1);
    sun::set_place(&mut lit.light, [90.0, 20.0]);
    scene.set(lit);
    assert!(rest(&mut scene, view) > 1, "the sun was moved");
    assert_eq!(scene.reopened(), 1);
    scene.set(Settings::default());
    rest(&mut scene, view);
    assert_eq!(scene.reopened(), 2);
}
