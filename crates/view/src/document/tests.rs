//! Tests of saved scenes: every setting and every view comes back from its document, and the
//! picture of the document is that of the window.

use super::*;
use crate::args::Backend;
use crate::camera::Camera;
use crate::device::WindowPainter;
use crate::scene::{FrameOutcome, FrameViews, Scene};
use crate::views::{Side, Views};
use clap::Parser;
use esker_engine::calls::{build, render};
use esker_engine::draw::method::METHODS;
use esker_engine::io::progress::{Progress, Style};
use esker_engine::light::settings::{FILTERS, Gloss};
use esker_engine::{Method, NormalsMode, Picture, PointSize};
use glam::DVec3;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::sample::subsequence;
use std::sync::Arc;
use std::time::Duration;

/// An odd size, so that the middle of the picture is that of a pixel.
const SIZE: [u32; 2] = [321, 203];
const SIDES: [Side; 7] =
    [Side::Top, Side::Bottom, Side::Front, Side::Back, Side::Left, Side::Right, Side::Isometric];

fn silent() -> Progress {
    Progress::new(Style::Silent, Default::default())
}

fn scan() -> PathBuf {
    std::path::absolute("../../tests/sample/creek.laz").unwrap()
}

fn args() -> Args {
    Args::parse_from(["esker-view"])
}

/// The sample scan as an `.esker` file in `folder`, whose coordinates are in millions of metres.
fn creek(folder: &Path) -> PathBuf {
    let built = folder.join("creek.esker");
    let options = BuildOptions { normals: NormalsMode::Estimate, ..BuildOptions::default() };
    build::build(&[scan()], &built, &options, 0, &silent()).unwrap();
    built
}

fn filter() -> impl Strategy<Value = Filter> {
    let bounds = option::of(select(vec!["0,0,1,1", "-5,1e6,-0.25,7.125,2e6,3"]));
    let classes = option::of(select(vec!["2", "ground,3-5", "overlap", "1,3,5,255,overlap"]));
    let flags = || select(vec!["", "withheld", "overlap,key-point"]);
    let values = select(vec!["", "intensity:..4000", "gps_time:-1.5.."]);
    let polygon = option::of(select(vec!["0,0 9.5,0 9,7", "1e6,2e6 1000009,2e6 1e6,2000007"]));
    let clips = subsequence(
        vec![
            "centre=0.1,-2e6,3;size=1,0,7.25;rotation=30;keep=outside",
            "box=0,0,1,1e6,2e6,3",
            "point=0.1,0.2,0.3;normal=0,-1,1e-3",
        ],
        0..=3,
    );
    let places = (polygon, clips);
    (bounds, classes, (flags(), flags()), values, places, option::of(1e-9..1e9f64)).prop_map(
        |(bounds, classes, (flags, without_flags), values, (polygon, clips), max_spacing)| {
            let flags = [flags, without_flags].map(|words| match words {
                "" => esker_engine::Flags::default(),
                words => words.parse().unwrap(),
            });
            Filter {
                bounds: bounds.map(|text| text.parse().unwrap()),
                polygon: polygon.map(|text| esker_engine::io::polygon::read(text).unwrap()),
                classes: classes.map(|text| text.parse().unwrap()),
                flags: flags[0],
                without_flags: flags[1],
                clips: clips.iter().map(|text| text.parse().unwrap()).collect(),
                values: [values].iter().filter_map(|text| text.parse().ok()).collect(),
                max_spacing,
            }
        },
    )
}

fn light() -> impl Strategy<Value = LightSettings> {
    let gloss = option::of((0.0..=1.0f32, 0.05..=1.0f32));
    let counts = (1..65_537u32, 0..65u32, 1..1025u32, any::<u64>());
    (gloss, counts, option::of(1e-9..1e9f64), any::<bool>(), select(FILTERS.to_vec())).prop_map(
        |(gloss, (samples, bounces, shadow_samples, seed), exposure, filters_shadows, filter)| {
            let gloss = gloss.map(|(reflectance, roughness)| Gloss { reflectance, roughness });
            LightSettings {
                samples,
                bounces,
                shadow_samples,
                seed,
                exposure,
                filter: filter.0,
                filters_shadows: filters_shadows && gloss.is_none(),
                gloss,
                ..LightSettings::default()
            }
        },
    )
}

prop_compose! {
    fn any_settings()(
        method in select(METHODS.to_vec()),
        colour_by in option::of(select(vec!["rgb", "elevation:100..250.5:turbo", "z:..-7"])),
        filter in filter(),
        light in light(),
        flags in any::<[bool; 4]>(),
        (size_px, eye_dome) in (option::of(1.0..64.0f32), 0.0..10.0f32),
        points_budget in any::<u64>(),
        target_spacing_px in 0.0..1e6f64,
    ) -> Settings {
        Settings {
            method: method.0,
            colour_by: colour_by.map(str::to_owned),
            filter,
            light,
            shines: flags[0],
            evens_exposure: flags[1],
            culls_back: flags[2],
            full: flags[3],
            dots: Dots { size: size_px.map_or(PointSize::Adaptive, PointSize::Pixels), eye_dome },
            points_budget,
            target_spacing_px,
            ..Settings::default()
        }
    }
}

fn present(settings: &Settings, camera: CameraRequest, size: [u32; 2]) -> Present {
    Present { settings: settings.clone(), camera, size, measurements: Vec::new() }
}

proptest! {
    #[test]
    fn settings_come_back_from_their_document(settings in any_settings()) {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scene.json");
        let mut scene = SceneFile::of(&[scan()]).unwrap();
        // What is saved first has more samples of light.
        for settings in [&Settings::default(), &settings] {
            let state = present(settings, CameraRequest::default(), SIZE);
            scene = match scene.save(&out, true, &state).unwrap() {
                Saved::Written(scene) => *scene,
                Saved::Exists(_) => unreachable!("it may be replaced"),
            };
        }
        let read = SceneFile::of(&[out]).unwrap();
        prop_assert_eq!(read.settings(&args(), &Settings::default()), settings);
    }
}

/// Draws a view until nothing more comes. Returns the picture.
fn drawn_by_the_window(scene: &mut Scene, camera: &mut Camera, size: [u32; 2]) -> Picture {
    loop {
        if let Some(boxes) = scene.boxes() {
            camera.set_boxes(*boxes);
        }
        let view = camera.view(size);
        let views = FrameViews { chosen: view, seen: view };
        if scene.is_at_rest(&views) {
            return scene.picture().unwrap();
        }
        match scene.frame(&views) {
            FrameOutcome::Failed(fault) => panic!("{fault}"),
            FrameOutcome::New(_) => {}
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
    }
}

/// A file that is open as in the window.
struct Open {
    file: Arc<Forest>,
    saved: SceneFile,
    scene: Scene,
    views: Views,
    size: [u32; 2],
}

impl Open {
    fn of(inputs: &[PathBuf], settings: &Settings, up: &str, size: [u32; 2]) -> Self {
        let mut saved = SceneFile::of(inputs).unwrap();
        let file = Arc::new(saved.open().unwrap().unwrap());
        let camera = CameraRequest::parse(up).unwrap();
        let views = Views::new(&file, &camera, saved.hidden());
        let settings = Settings { vertical: views.vertical(), ..settings.clone() };
        let device = WindowPainter::default().device(Backend::Cpu);
        let scene = Scene::new(Arc::clone(&file), settings, device, size);
        Self { file, saved, scene, views, size }
    }

    /// Draws a view of the window, and its document as `esker render` does. Checks that the
    /// pictures are the same.
    fn check(&mut self, camera: &mut Camera, what: &str) {
        let window = drawn_by_the_window(&mut self.scene, camera, self.size);
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("scene.json");
        let state = present(self.scene.settings(), camera.request(), self.size);
        self.saved.clone().save(&out, false, &state).unwrap();
        let document = Document::read(&out).unwrap();
        let request = document.request().unwrap();
        let inputs = document.inputs().unwrap();
        let file = open_together(&inputs, &request.offsets).unwrap().unwrap();
        let (still, report) = render::draw(&file, &request, &silent()).unwrap();
        assert!(report.points_drawn > 0, "{what}: nothing is in the picture");
        assert_eq!([still.width, still.height], [window.width, window.height], "{what}");
        let pairs = still.rgba.iter().zip(&window.rgba);
        let off = pairs.filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert_eq!(off, 0, "{what}: values that differ by more than 1 of 255");
    }
}

#[test]
fn the_picture_of_a_document_is_that_of_the_window_from_every_side() {
    let folder = tempfile::tempdir().unwrap();
    let built = creek(folder.path());
    for up in ["", "up=0,1,0", "up=0,0,-1"] {
        let settings = Settings { colour_by: Some("elevation".into()), ..Settings::default() };
        let mut open = Open::of(std::slice::from_ref(&built), &settings, up, SIZE);
        for (side, is_parallel) in SIDES.into_iter().flat_map(|s| [(s, false), (s, true)]) {
            let what = format!("{up} {side:?}, parallel: {is_parallel}");
            let mut camera = open.views.seen_from(side, is_parallel, SIZE);
            open.check(&mut camera, &what);
        }
    }
}

#[test]
fn the_picture_of_a_document_is_that_of_the_window_with_any_settings() {
    let folder = tempfile::tempdir().unwrap();
    let built = creek(folder.path());
    let file = Forest::open(&built).unwrap();
    let [low, high] = esker_engine::calls::info::world_bounds(&file).unwrap();
    let middle = [0, 1].map(|i| low[i].midpoint(high[i]));
    let half = format!("{},{},{},{}", low[0], low[1], middle[0], high[1]);
    let by = |name: &str| Settings { colour_by: Some(name.into()), ..Settings::default() };
    let of = |filter: Filter| Settings { filter, ..by("rgb") };
    let dots = |size, eye_dome| Settings {
        method: Method::Points,
        dots: Dots { size, eye_dome },
        ..by("intensity")
    };
    let all = [
        by("rgb"),
        by("depth"),
        by("depth:100..900:turbo"),
        by("elevation:1000..1050"),
        by("intensity:..4000"),
        by("normal"),
        Settings { method: Method::Auto, ..by("rgb") },
        Settings { method: Method::Ewa, ..by("rgb") },
        dots(PointSize::Pixels(3.5), 0.0),
        dots(PointSize::Adaptive, 2.5),
        Settings { shines: false, ..by("rgb") },
        Settings { full: true, culls_back: true, ..by("rgb") },
        Settings { points_budget: 20_000, ..by("rgb") },
        Settings { target_spacing_px: 6.0, ..by("rgb") },
        of(Filter { bounds: Some(half.parse().unwrap()), ..Filter::default() }),
        of(Filter { values: vec!["intensity:..60".parse().unwrap()], ..Filter::default() }),
        of(Filter { max_spacing: Some(20.0), ..Filter::default() }),
    ];
    let mut open = Open::of(&[built], &all[0], "", SIZE);
    for settings in all {
        open.scene.set(Settings { vertical: open.views.vertical(), ..settings.clone() });
        for (side, is_parallel) in [(Side::Front, true), (Side::Top, true), (Side::Left, false)] {
            let what = format!("{settings:?} {side:?}");
            let mut camera = open.views.seen_from(side, is_parallel, SIZE);
            open.check(&mut camera, &what);
            camera.orbit(DVec3::from_array(low), 0.3, -0.2);
            open.check(&mut camera, &what);
        }
    }
}

#[test]
fn the_picture_of_a_document_is_that_of_the_window_with_clouds_hidden_and_moved() {
    let folder = tempfile::tempdir().unwrap();
    creek(folder.path());
    let document = folder.path().join("two.json");
    for (first, second) in [(true, true), (true, false), (false, true)] {
        let text = format!(
            r#"{{"esker_scene": 1, "size": [321, 203], "clouds": [{{"file": "creek.esker", "visible": {first}}},
                {{"file": "creek.esker", "visible": {second}, "offset": [700.5, -300.25, 40]}}]}}"#
        );
        std::fs::write(&document, text).unwrap();
        let read = SceneFile::of(std::slice::from_ref(&document)).unwrap();
        let settings = read.settings(&args(), &Settings::default());
        let mut open = Open::of(std::slice::from_ref(&document), &settings, "", SIZE);
        let hidden_clouds = open.saved.hidden().to_vec();
        open.scene.set(Settings { hidden_clouds, vertical: open.views.vertical(), ..settings });
        assert_eq!(open.file.clouds(), 2);
        for (side, is_parallel) in [(Side::Front, true), (Side::Top, true), (Side::Left, false)] {
            let what = format!("{first} {second} {side:?}");
            let mut camera = open.views.seen_from(side, is_parallel, SIZE);
            open.check(&mut camera, &what);
        }
    }
}

#[cfg(feature = "light")]
#[test]
fn the_lit_picture_of_a_document_is_that_of_the_window() {
    let folder = tempfile::tempdir().unwrap();
    let built = creek(folder.path());
    let size = [83, 61];
    let settings = Settings { method: Method::Lit, ..Settings::default() };
    let mut open = Open::of(&[built], &settings, "", size);
    for (side, is_parallel) in [(Side::Left, false), (Side::Top, true), (Side::Isometric, true)] {
        let mut camera = open.views.seen_from(side, is_parallel, size);
        open.check(&mut camera, &format!("{side:?}"));
    }
}
