//! Opens real windows and controls them by scripts. Without a display the tests skip themselves,
//! which they print; `cargo xtask view` runs them on a display in memory.

#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

use esker_engine::calls::info;
use esker_engine::calls::render;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::path;
use esker_engine::io::progress::{Progress, Style};
use esker_engine::{Forest, Picture};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

const SIZE: [u32; 2] = [640, 400];

/// One window at a time, because they share the processor with what draws them.
static ONE: Mutex<()> = Mutex::new(());

/// Size of a window that has the panel at first.
const WITH_PANEL: [u32; 2] = [960, 500];

/// A folder for the files of a test, and the right to open windows.
struct Fixture {
    folder: tempfile::TempDir,
    _one: MutexGuard<'static, ()>,
}

fn fixture() -> Option<Fixture> {
    let has_display = cfg!(not(target_os = "linux"))
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if !has_display {
        eprintln!("skipped: there is no display");
        return None;
    }
    let one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    Some(Fixture { folder: tempfile::tempdir().unwrap(), _one: one })
}

impl Fixture {
    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs the window with a script on a file. Returns its report.
    fn fly(&self, file: &Path, script: &str, options: &[&str]) -> Value {
        report_of(&self.run(file, script, options))
    }

    fn run(&self, file: &Path, script: &str, options: &[&str]) -> Output {
        self.run_at(SIZE, file, script, options)
    }

    fn run_at(&self, size: [u32; 2], file: &Path, script: &str, options: &[&str]) -> Output {
        let path = self.path("script.json");
        std::fs::write(&path, script).unwrap();
        let size = format!("{}x{}", size[0], size[1]);
        Command::new(env!("CARGO_BIN_EXE_esker-view"))
            .current_dir(self.folder.path())
            .args(["--size", &size, "--script"])
            .arg(path)
            .args(options)
            .arg(file)
            .output()
            .unwrap()
    }
}

/// Checks that the run succeeded. Returns its report.
fn report_of(output: &Output) -> Value {
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{}: {stderr}", output.status);
    assert!(!stderr.contains("panicked"), "{stderr}");
    let report = String::from_utf8_lossy(&output.stdout).into_owned();
    let report: Value = serde_json::from_str(report.lines().last().unwrap()).unwrap();
    assert_eq!(report["faults"].as_array().map(Vec::len), Some(0), "{report}");
    report
}

/// The sample scan as an `.esker` file, built once.
fn sample() -> &'static Path {
    static BUILT: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, built) = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let built = folder.path().join("creek.esker");
        let options = esker_engine::BuildOptions::default();
        esker_engine::calls::build::build(&[scan()], &built, &options, 0, &silent()).unwrap();
        (folder, built)
    });
    built
}

fn silent() -> Progress {
    Progress::new(Style::Silent, Default::default())
}

fn scan() -> PathBuf {
    std::path::absolute("../../tests/sample/creek.laz").unwrap()
}

fn read_png(path: &Path) -> Picture {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgba).unwrap();
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
    Picture { width: info.width, height: info.height, rgba, ..Picture::default() }
}

/// Share of the pixels of two pictures of the same size that differ by more than `by` in a channel.
fn share_off(a: &Picture, b: &Picture, by: u8) -> f64 {
    assert_eq!([a.width, a.height], [b.width, b.height]);
    let pairs = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let off = pairs.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > by)).count();
    off as f64 / (a.rgba.len() / 4) as f64
}

/// Picture that the engine draws for the window's first view, of `size` pixels.
fn drawn_by_the_engine(size: [u32; 2]) -> Picture {
    let file = Forest::open(sample()).unwrap();
    let view = Camera::default().view(info::bounds(&file), SIZE);
    let camera = Camera {
        eye: Some(view.eye),
        target: Some(view.eye + view.forward() * 1000.0),
        ..Camera::default()
    };
    let request = esker_engine::draw::scene::PictureRequest {
        size,
        camera,
        method: esker_engine::Method::default(),
        ..esker_engine::draw::scene::PictureRequest::default()
    };
    render::draw(&file, &request, &silent()).unwrap().0
}

#[test]
fn the_window_shows_what_the_engine_draws() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "scene.png"},
        {"do": "command", "id": "compass"}, {"do": "window", "path": "window.png"}]}"#;
    let report =
        fixture.fly(sample(), script, &["--no-occlusion", "--no-panel", "--backend", "cpu"]);
    let scene = read_png(&fixture.path("scene.png"));
    let engine = drawn_by_the_engine([scene.width, scene.height]);
    let off = share_off(&scene, &engine, 8);
    assert!(off <= 0.001, "{off} of the pixels are not what the engine draws");
    let window = read_png(&fixture.path("window.png"));
    let off = share_off(&scene, &window, 12);
    assert!(off <= 0.02, "{off} of the window's pixels are not the picture");
    println!(
        "window after {} ms, first frame after {} ms ({})",
        report["window_ms"], report["first_frame_ms"], report["drawn_by"]
    );
}

#[test]
fn a_script_flies_and_loading_is_compared_with_a_resident_scene_in_the_same_run() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"cold": true,
        "flight": [{"do": "hold", "keys": ["W"], "seconds": 0.4},
                   {"do": "drag", "from": [0.4, 0.5], "to": [0.6, 0.45], "seconds": 0.4},
                   {"do": "wheel", "at": [0.5, 0.6], "points": 150, "seconds": 0.3},
                   {"do": "drag", "button": "middle", "from": [0.5, 0.5], "to": [0.4, 0.5], "seconds": 0.2}],
        "after": [{"do": "picture", "path": "there.png"}, {"do": "double_click", "at": [0.5, 0.6]},
                  {"do": "wait", "seconds": 1.0}, {"do": "picture", "path": "nearer.png"},
                  {"do": "press", "key": "F"}, {"do": "wait", "seconds": 1.0},
                  {"do": "settle", "seconds": 10}, {"do": "picture", "path": "home.png"}]}"#;
    let report =
        fixture.fly(sample(), script, &["--no-panel", "--backend", "cpu", "--no-occlusion"]);
    let [there, nearer, home] =
        ["there.png", "nearer.png", "home.png"].map(|name| read_png(&fixture.path(name)));
    // More than half of each picture is sky, which is the same in all.
    assert!(share_off(&there, &nearer, 8) > 0.2, "a double click moves the camera nearer");
    assert!(share_off(&there, &home, 8) > 0.2, "the flight moves the camera");
    let engine = drawn_by_the_engine([home.width, home.height]);
    assert!(share_off(&home, &engine, 8) <= 0.001, "F returns to the first view");
    let flights = report["flights"].as_array().unwrap();
    assert!(flights.len() >= 2 && report["last_is_resident"] == true, "{report}");
    assert!(
        flights.iter().all(|f| f["frames_empty"] == 0),
        "no frame was without points: {report}"
    );
    let budget = report["budget_gpu_bytes"].as_u64().unwrap();
    assert!(report["drawing_bytes_peak"].as_u64().unwrap() <= budget);
    assert_eq!(report["stalls"], 0);
    println!(
        "p99 loading {} ms, resident {} ms, ratio {}",
        flights[0]["interval_ms"]["p99"],
        flights[flights.len() - 1]["interval_ms"]["p99"],
        report["p99_loading_over_resident"]
    );
}

#[test]
fn a_camera_path_is_followed_with_keys_and_mouse() {
    let Some(fixture) = fixture() else { return };
    let path = r#"{"coordinates": "bounds", "views": [
        {"name": "far", "eye": [0.5, -1.5, 3], "target": [0.5, 0.5, 0.5], "stay_s": 0.5},
        {"name": "near", "eye": [0.4, 0.0, 1.5], "target": [0.5, 0.5, 0.5], "travel_s": 1.5, "stay_s": 0.5}]}"#;
    std::fs::write(fixture.path("path.json"), path).unwrap();
    let script = r#"{"flights_max": 1, "flight": [{"do": "path", "file": "path.json"}],
                     "after": [{"do": "settle", "seconds": 10}, {"do": "picture", "path": "near.png"}]}"#;
    fixture.fly(sample(), script, &["--no-panel", "--backend", "cpu"]);
    let seen = read_png(&fixture.path("near.png"));
    // The flight ends near the path's last view, whose picture has about the same brightness.
    let file = Forest::open(sample()).unwrap();
    let size = [seen.width, seen.height];
    let stops = path::Path::parse(path, (info::bounds(&file), file.lattice()), size).unwrap().views;
    let (view, target) = (stops[1].view, stops[1].target);
    let camera = Camera { eye: Some(view.eye), target: Some(target), ..Camera::default() };
    let request = esker_engine::draw::scene::PictureRequest {
        size,
        camera,
        method: esker_engine::Method::default(),
        ..esker_engine::draw::scene::PictureRequest::default()
    };
    let (end, _) = render::draw(&file, &request, &silent()).unwrap();
    let mean = |picture: &Picture| {
        let sum: u64 = picture.rgba.iter().map(|&v| u64::from(v)).sum();
        sum as f64 / picture.rgba.len() as f64
    };
    let [seen, end] = [mean(&seen), mean(&end)];
    assert!((seen - end).abs() < 20.0, "mean brightness {seen}, at the path's end {end}");
}

#[test]
fn the_window_closes_cleanly_while_it_loads() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"cold": true, "flight": [{"do": "hold", "keys": ["W"], "seconds": 0.05}, {"do": "close"}]}"#;
    fixture.fly(sample(), script, &["--backend", "cpu"]);
    // Also while scans are being built.
    let script = r#"{"before": [{"do": "close"}]}"#;
    fixture.fly(&scan(), script, &["--backend", "cpu"]);
}

#[test]
fn a_scan_is_built_and_shown() {
    let Some(fixture) = fixture() else { return };
    let script =
        r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "scene.png"}]}"#;
    fixture.fly(&scan(), script, &["--no-occlusion", "--no-panel", "--backend", "cpu"]);
    let scene = read_png(&fixture.path("scene.png"));
    let engine = drawn_by_the_engine([scene.width, scene.height]);
    assert!(share_off(&scene, &engine, 8) <= 0.001);
}

#[test]
fn every_backend_of_the_window_shows_the_picture() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "command", "id": "compass"},
        {"do": "window", "path": "window.png"}]}"#;
    for window in ["auto", "driver", "gl", "cpu"] {
        let options = ["--window", window, "--no-occlusion", "--no-panel", "--backend", "cpu"];
        let output = fixture.run(sample(), script, &options);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        if ["driver", "gl"].contains(&window) && stderr.contains("no graphics driver") {
            eprintln!("skipped: no driver shows a window by `{window}`");
            continue;
        }
        let report = report_of(&output);
        let shown = read_png(&fixture.path("window.png"));
        let engine = drawn_by_the_engine([shown.width, shown.height]);
        let off = share_off(&shown, &engine, 12);
        assert!(off <= 0.02, "{window}: {off} of the window's pixels are not the picture");
        println!("{window}: first frame after {} ms", report["first_frame_ms"]);
    }
}

#[test]
fn settings_change_while_the_window_runs_and_the_view_stays() {
    let Some(fixture) = fixture() else { return };
    // Automatic, surfaces, splats, lit splats, points.
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "press", "key": "M"},
        {"do": "wait", "seconds": 0.2}, {"do": "settle", "seconds": 20}, {"do": "press", "key": "M"},
        {"do": "wait", "seconds": 0.2}, {"do": "settle", "seconds": 20}, {"do": "press", "key": "M"},
        {"do": "wait", "seconds": 0.5}, {"do": "press", "key": "M"},
        {"do": "wait", "seconds": 0.2}, {"do": "settle", "seconds": 20}, {"do": "picture", "path": "points.png"},
        {"do": "press", "key": "M"}, {"do": "press", "key": "O"},
        {"do": "wait", "seconds": 0.2}, {"do": "settle", "seconds": 20}, {"do": "picture", "path": "surface.png"},
        {"do": "press", "key": "Space"}, {"do": "hold", "keys": ["S"], "seconds": 0.5},
        {"do": "settle", "seconds": 5}, {"do": "picture", "path": "frozen.png"}]}"#;
    fixture.fly(sample(), script, &["--no-panel", "--backend", "cpu"]);
    let [points, surface, frozen] =
        ["points.png", "surface.png", "frozen.png"].map(|name| read_png(&fixture.path(name)));
    assert!(share_off(&points, &surface, 8) > 0.05, "points differ from surfaces");
    let engine = drawn_by_the_engine([surface.width, surface.height]);
    assert!(share_off(&surface, &engine, 8) <= 0.001, "the view is that of before the changes");
    assert!(share_off(&frozen, &surface, 8) > 0.05, "a frozen cut is seen from another pose");
}

/// Picture that the engine draws of all of the sample scan, of `size` pixels.
fn drawn_by_a_camera(camera: &str, size: [u32; 2]) -> Picture {
    let file = Forest::open(sample()).unwrap();
    let request = esker_engine::draw::scene::PictureRequest {
        size,
        camera: Camera::parse(camera).unwrap(),
        ..esker_engine::draw::scene::PictureRequest::of_options()
    };
    render::draw(&file, &request, &silent()).unwrap().0
}

/// Checks that a picture of the window is that of a camera of the engine.
fn assert_drawn(picture: &Path, camera: &str) {
    let shown = read_png(picture);
    let engine = drawn_by_a_camera(camera, [shown.width, shown.height]);
    let off = share_off(&shown, &engine, 8);
    assert!(off <= 0.001, "{}: {off} of the pixels are not those of {camera}", picture.display());
}

const QUIET: [&str; 6] = ["--window", "cpu", "--backend", "cpu", "--no-panel", "--no-occlusion"];

#[test]
fn keys_look_from_the_sides_in_perspective_and_in_parallel() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20},
        {"do": "press", "key": "1"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "front.png"},
        {"do": "press", "key": "5"}, {"do": "wait", "seconds": 0.3}, {"do": "settle", "seconds": 20},
        {"do": "press", "key": "7"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "plan.png"},
        {"do": "wheel", "at": [0.3, 0.6], "points": 300, "seconds": 0.3}, {"do": "settle", "seconds": 20},
        {"do": "press", "key": "F"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "fit.png"},
        {"do": "command", "id": "left"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "left.png"},
        {"do": "press", "key": "5"}, {"do": "wait", "seconds": 0.3},
        {"do": "press", "key": "F"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "home.png"}]}"#;
    fixture.fly(sample(), script, &QUIET);
    for (name, camera) in [
        ("front.png", "direction=0,1,0"),
        ("plan.png", "direction=0,0,-1;up=0,1,0;ortho=fit"),
        ("fit.png", "ortho=fit"),
        ("left.png", "direction=1,0,0;ortho=fit"),
        ("home.png", ""),
    ] {
        assert_drawn(&fixture.path(name), camera);
    }
}

#[test]
fn the_first_view_may_be_parallel_and_have_another_axis_upwards() {
    let Some(fixture) = fixture() else { return };
    let script =
        r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "first.png"}]}"#;
    for (options, camera) in [
        (
            ["--camera", "direction=0,0,-1;up=0,1,0;ortho=fit"],
            "direction=0,0,-1;up=0,1,0;ortho=fit",
        ),
        (["--up", "y"], "up=0,1,0"),
        (["--up", "-x"], "up=-1,0,0"),
    ] {
        fixture.fly(sample(), script, &[&QUIET[..], &options].concat());
        assert_drawn(&fixture.path("first.png"), camera);
    }
}

#[test]
fn a_click_on_the_compass_looks_from_the_end_of_the_axis() {
    let Some(fixture) = fixture() else { return };
    // In the view from the front, z ends above the middle of the compass.
    let script = r#"{"after": [{"do": "settle", "seconds": 20},
        {"do": "press", "key": "1"}, {"do": "wait", "seconds": 0.9}, {"do": "settle", "seconds": 20},
        {"do": "click", "at": [0.077, 0.795]}, {"do": "wait", "seconds": 1.2}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "top.png"}]}"#;
    let report = fixture.fly(sample(), script, &QUIET);
    assert_eq!(report["measured"].as_array().map(Vec::len), Some(0), "the compass is no point");
    assert_drawn(&fixture.path("top.png"), "direction=0,0,-1;up=0,1,0");
}

#[test]
fn a_moved_pointer_paints_only_the_coordinates() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "wait", "seconds": 0.3},
        {"do": "window", "path": "before.png"},
        {"do": "point", "from": [0.3, 0.4], "to": [0.6, 0.6], "seconds": 1},
        {"do": "window", "path": "after.png"}]}"#;
    let report = fixture.fly(sample(), script, &QUIET);
    let [passes, pixels] = ["/pointed/passes", "/pointed/pixels/p50"]
        .map(|name| report.pointer(name).and_then(Value::as_f64).unwrap());
    let all = f64::from(SIZE[0] * SIZE[1]);
    assert!(passes >= 10.0 && pixels > 0.0 && pixels < all * 0.02, "{report}");
    let [before, after] = ["before.png", "after.png"].map(|name| read_png(&fixture.path(name)));
    let off = share_off(&before, &after, 0);
    assert!(off > 0.0 && off < 0.05, "{off} of the window is another with the coordinates");
}

/// The sample scan with normals, built once.
#[cfg(feature = "light")]
fn sample_with_normals() -> &'static Path {
    static BUILT: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, built) = BUILT.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let built = folder.path().join("creek.esker");
        let normals = esker_engine::NormalsMode::Estimate;
        let options = esker_engine::BuildOptions { normals, ..Default::default() };
        esker_engine::calls::build::build(&[scan()], &built, &options, 0, &silent()).unwrap();
        (folder, built)
    });
    built
}

#[cfg(feature = "light")]
#[test]
fn the_window_lights_the_scan_follows_a_drag_of_the_sun_and_goes_back_to_points() {
    use esker_engine::draw::scene::PictureRequest;
    use esker_engine::light::settings::LightSettings;
    let Some(fixture) = fixture() else { return };
    let (file, size) = (sample_with_normals(), [240, 160]);
    // Splats, lit splats, points. The window itself is shown too, with the panel.
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "splats.png"},
        {"do": "press", "key": "M"}, {"do": "wait", "seconds": 1}, {"do": "settle", "seconds": 120},
        {"do": "picture", "path": "day.png"},
        {"do": "drag", "command": true, "from": [0.5, 0.4], "to": [0.9, 0.7], "seconds": 0.5},
        {"do": "wait", "seconds": 0.3}, {"do": "settle", "seconds": 120},
        {"do": "picture", "path": "evening.png"},
        {"do": "press", "key": "M"}, {"do": "wait", "seconds": 1}, {"do": "settle", "seconds": 20},
        {"do": "picture", "path": "points.png"}]}"#;
    let options = ["--no-panel", "--no-occlusion", "--backend", "cpu", "--method", "ewa"];
    report_of(&fixture.run_at(size, file, script, &options));
    let [splats, day, evening, points] = ["splats", "day", "evening", "points"]
        .map(|name| read_png(&fixture.path(&format!("{name}.png"))));
    let forest = Forest::open(file).unwrap();
    let view = Camera::default().view(info::bounds(&forest), size);
    let camera = Camera {
        eye: Some(view.eye),
        target: Some(view.eye + view.forward() * 1000.0),
        ..Camera::default()
    };
    let drawn = |method| {
        let light = LightSettings { samples: 64, ..LightSettings::default() };
        let size = [day.width, day.height];
        let request = PictureRequest { size, camera, method, light, ..Default::default() };
        render::draw(&forest, &request, &silent()).unwrap().0
    };
    let still = drawn(esker_engine::Method::Lit);
    let off = share_off(&day, &still, 24);
    assert!(off < 0.05, "{off} of the pixels are not those of a lit still");
    assert!(share_off(&day, &splats, 24) > 0.3, "lit splats look like unlit ones");
    assert!(share_off(&day, &evening, 24) > 0.2, "the sun has not moved, or the camera has");
    let off = share_off(&points, &drawn(esker_engine::Method::Points), 8);
    assert!(off <= 0.001, "{off} of the pixels are not points of the first view");
}

#[test]
fn errors_are_printed_in_one_line_and_set_the_exit_code() {
    let Some(fixture) = fixture() else { return };
    let nothing = fixture.path("nothing.esker");
    let output = fixture.run(&nothing, r#"{"after": []}"#, &[]);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && stderr.contains("nothing.esker"), "{stderr}");
    let output = fixture.run(
        sample(),
        r#"{"after": [{"do": "settle", "seconds": 9}]}"#,
        &["--budget-ram", "1MiB"],
    );
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && stderr.contains("--budget-ram"), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
}

#[test]
fn errors_other_than_a_missing_display_do_not_mention_the_display() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}]}"#;
    let unwritable = r#"{"after": [{"do": "picture", "path": "no/such/folder/scene.png"}]}"#;
    let nothing = fixture.path("nothing.esker");
    for (file, script, option, word) in [
        (nothing.as_path(), script, "--no-panel", "nothing.esker"),
        (sample(), script, "--colour=mood", "mood"),
        (sample(), script, "--budget-gpu=1KiB", "--budget-gpu"),
        (sample(), unwritable, "--no-panel", "scene.png"),
    ] {
        let output = fixture.run(file, script, &["--window", "cpu", "--backend", "cpu", option]);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && stderr.contains(word), "{option}: {stderr}");
        assert!(!stderr.contains("needs a display"), "{option}: {stderr}");
    }
}

#[test]
fn a_filter_that_leaves_nothing_shows_an_empty_picture() {
    let Some(fixture) = fixture() else { return };
    let script =
        r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "none.png"}]}"#;
    for option in ["--classes=99", "--box=0,0,1,1"] {
        fixture.fly(sample(), script, &["--window", "cpu", "--backend", "cpu", option]);
        let picture = read_png(&fixture.path("none.png"));
        // The background darkens upwards.
        for row in picture.rgba.chunks(picture.width as usize * 4) {
            assert!(row.chunks(4).all(|pixel| pixel[..3] == row[..3]), "{option}");
        }
    }
}

#[test]
fn home_returns_to_the_first_view_from_any_distance() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20},
        {"do": "wheel", "at": [0.4, 0.35], "points": -20000, "seconds": 0.2}, {"do": "settle", "seconds": 9},
        {"do": "press", "key": "Home"}, {"do": "settle", "seconds": 9}, {"do": "picture", "path": "back.png"},
        {"do": "wheel", "at": [0.4, 0.35], "points": 100000, "seconds": 0.2}, {"do": "settle", "seconds": 9},
        {"do": "press", "key": "Home"}, {"do": "settle", "seconds": 9}, {"do": "picture", "path": "again.png"}]}"#;
    fixture.fly(sample(), script, &["--no-panel", "--backend", "cpu", "--no-occlusion"]);
    for name in ["back.png", "again.png"] {
        let home = read_png(&fixture.path(name));
        let engine = drawn_by_the_engine([home.width, home.height]);
        let off = share_off(&home, &engine, 8);
        assert!(off <= 0.001, "{name}: {off} of the pixels are not those of the first view");
    }
}

#[test]
#[cfg(target_os = "linux")]
fn without_a_display_the_error_says_what_to_do() {
    let output = Command::new(env!("CARGO_BIN_EXE_esker-view"))
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("WAYLAND_SOCKET")
        .arg(sample())
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && stderr.contains("esker render"), "{stderr}");
    assert!(!stderr.contains("panicked") && !stderr.contains(".rs"), "{stderr}");
}

#[test]
fn keys_work_whether_the_panel_is_shown_or_not() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "picture", "path": "a.png"},
        {"do": "press", "key": "F9"}, {"do": "settle", "seconds": 20}, {"do": "picture", "path": "b.png"},
        {"do": "press", "key": "M"}, {"do": "wait", "seconds": 0.2}, {"do": "press", "key": "M"},
        {"do": "settle", "seconds": 20},
        {"do": "press", "key": "F9"}, {"do": "settle", "seconds": 20}, {"do": "picture", "path": "c.png"},
        {"do": "press", "key": "F9"}, {"do": "settle", "seconds": 20}, {"do": "picture", "path": "d.png"}]}"#;
    report_of(&fixture.run_at(WITH_PANEL, sample(), script, &["--backend", "cpu"]));
    let [a, b, c, d] = ["a.png", "b.png", "c.png", "d.png"].map(|p| read_png(&fixture.path(p)));
    assert!(a.width < b.width, "the panel is hidden");
    assert_eq!((c.width, d.width), (a.width, b.width), "the panel is shown and hidden again");
    assert!(share_off(&a, &c, 8) > 0.01, "the key M works while the panel is hidden");
}

#[test]
fn clicks_measure_coordinates_and_distances() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "click", "at": [0.45, 0.5]},
        {"do": "settle", "seconds": 20}, {"do": "wait", "seconds": 0.7}, {"do": "click", "at": [0.55, 0.52]},
        {"do": "settle", "seconds": 20}, {"do": "wait", "seconds": 0.3}]}"#;
    for options in [&["--backend", "cpu"][..], &["--backend", "auto", "--no-panel"]] {
        let report = fixture.fly(sample(), script, options);
        let lines: Vec<&str> =
            report["measured"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
        let [a, b, between] = lines[..] else { panic!("{report}") };
        let [low, high] = info::bounds(&Forest::open(sample()).unwrap());
        let place = |line: &str| -> Vec<f64> {
            line.split_whitespace().map(|word| word.parse().unwrap()).collect()
        };
        let (a, b) = (place(a), place(b));
        for (axis, &at) in a.iter().enumerate().chain(b.iter().enumerate()) {
            // A surface reaches half a disc beyond its points.
            let slack = (high[axis] - low[axis]) * 0.05;
            assert!((low[axis] - slack..=high[axis] + slack).contains(&at), "{at}");
        }
        let distance = (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt();
        let reported = between.split_whitespace().nth(1).unwrap().trim_end_matches(',');
        let reported: f64 = reported.parse().unwrap();
        assert!(distance > 1.0 && (reported - distance).abs() < distance * 0.01, "{between}");
    }
}

/// What is copied stays in the clipboard while the window is open, so that it is read meanwhile.
#[test]
#[cfg(target_os = "linux")]
fn measured_coordinates_are_copied_to_the_clipboard_of_the_system() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "click", "at": [0.45, 0.5]},
        {"do": "settle", "seconds": 20}, {"do": "wait", "seconds": 0.7},
        {"do": "command", "id": "copy"}, {"do": "wait", "seconds": 6}]}"#;
    std::fs::write(fixture.path("script.json"), script).unwrap();
    let mut clipboard = arboard::Clipboard::new().unwrap();
    clipboard.set_text("before").unwrap();
    let mut window = Command::new(env!("CARGO_BIN_EXE_esker-view"))
        .args(["--window", "cpu", "--backend", "cpu", "--size", "960x500", "--script"])
        .arg(fixture.path("script.json"))
        .arg(sample())
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut copied = String::new();
    while window.try_wait().unwrap().is_none() {
        if let Ok(text) = clipboard.get_text()
            && text != "before"
        {
            copied = text;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    let report = report_of(&window.wait_with_output().unwrap());
    assert_eq!(report["measured"].as_array().map(Vec::len), Some(1), "{report}");
    assert_eq!(report["measured"][0], copied.as_str());
}

#[test]
#[cfg(target_os = "linux")]
fn a_window_fits_its_monitor_at_a_large_scale_factor() {
    let Some(fixture) = fixture() else { return };
    let script =
        r#"{"after": [{"do": "settle", "seconds": 20}, {"do": "window", "path": "window.png"}]}"#;
    let shown = |factor: &str| {
        std::fs::write(fixture.path("script.json"), script).unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_esker-view"))
            .env("WINIT_X11_SCALE_FACTOR", factor)
            .current_dir(fixture.folder.path())
            .args(["--window", "cpu", "--backend", "cpu", "--size", "8000x8000"])
            .args(["--script", "script.json"])
            .arg(sample())
            .output()
            .unwrap();
        report_of(&output);
        let picture = read_png(&fixture.path("window.png"));
        [picture.width, picture.height]
    };
    // The monitor's own size is not known to the test, but it is the same in both runs.
    let [once, twice] = ["1", "2"].map(shown);
    assert!(once[0] < 8000 && once[1] < 8000, "{once:?}");
    for (a, b) in once.into_iter().zip(twice) {
        assert!(a.abs_diff(b) <= 2, "{once:?} {twice:?}");
    }
}

#[test]
fn the_first_picture_that_cannot_be_written_is_reported() {
    let Some(fixture) = fixture() else { return };
    let script = r#"{"after": [{"do": "picture", "path": "none/a.png"}, {"do": "picture", "path": "b.png"}]}"#;
    let output = fixture.run(sample(), script, &["--backend", "cpu"]);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr.contains("none/a.png") && !stderr.contains("b.png"), "{stderr}");
    assert!(fixture.path("b.png").exists());
}

/// The folder of the built file is removed, also when a signal ends the window.
#[cfg(unix)]
#[test]
fn a_window_that_a_signal_ends_removes_its_temporary_file() {
    let Some(fixture) = fixture() else { return };
    let scratch = fixture.path("scratch");
    std::fs::create_dir(&scratch).unwrap();
    let is_empty = || std::fs::read_dir(&scratch).unwrap().next().is_none();
    let mut window = Command::new(env!("CARGO_BIN_EXE_esker-view"))
        .args(["--window", "cpu", "--scratch"])
        .arg(&scratch)
        .arg(scan())
        .spawn()
        .unwrap();
    let is_built = || {
        let folders = std::fs::read_dir(&scratch).unwrap().flatten();
        folders.map(|f| f.path().join("scan.esker")).any(|file| file.exists())
    };
    while !is_built() {
        assert!(window.try_wait().unwrap().is_none());
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    let stopped = Command::new("kill").args(["-TERM", &window.id().to_string()]).status();
    assert!(stopped.unwrap().success());
    assert_eq!(window.wait().unwrap().code(), Some(130));
    assert!(is_empty());
}

/// Checks that the picture of a scene that a window saves is that of its document, on the CPU.
fn check_saved(fixture: &Fixture, file: &Path, commands: &[&str], options: &[&str]) {
    let [picture, document] = ["saved.png", "saved.scene.json"].map(|name| fixture.path(name));
    let copy = fixture.path("saved.esker");
    for old in [&picture, &document, &copy] {
        let _ = std::fs::remove_file(old);
    }
    std::fs::copy(file, &copy).unwrap();
    let settle = r#"{"do": "settle", "seconds": 30}"#;
    let given = commands.iter().map(|id| {
        format!(r#"{{"do": "command", "id": "{id}"}}, {{"do": "wait", "seconds": 0.8}}, {settle}"#)
    });
    let given: Vec<String> = given.collect();
    let script = format!(
        r#"{{"before": [{settle}, {}, {{"do": "picture", "path": "saved.png"}},
            {{"do": "command", "id": "save-scene"}}, {settle}]}}"#,
        given.join(", ")
    );
    fixture.fly(&copy, &script, &[&["--backend", "cpu", "--no-panel"], options].concat());
    let read = esker_engine::document::Document::read(&document).unwrap();
    let file = Forest::open(&copy).unwrap();
    let (still, _) = render::draw(&file, &read.request().unwrap(), &silent()).unwrap();
    let off = share_off(&read_png(&picture), &still, 1);
    assert_eq!(off, 0.0, "{commands:?} {options:?}: of the pixels differ by more than 1 of 255");
}

#[test]
fn the_picture_that_is_saved_is_that_of_the_document_also_where_nodes_are_hidden() {
    let Some(fixture) = fixture() else { return };
    let office = fixture.path("office.esker");
    let options = esker_engine::BuildOptions::default();
    let scan = [PathBuf::from("synthetic:office:500k:1")];
    esker_engine::calls::build::build(&scan, &office, &options, 0, &silent()).unwrap();
    for commands in [["orthographic", "top"], ["orthographic", "front"], ["back", "isometric"]] {
        for file in [office.as_path(), sample()] {
            check_saved(&fixture, file, &commands, &[]);
        }
    }
}
