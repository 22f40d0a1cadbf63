//! Tests of scene documents in the window: what it shows of one is what the engine draws of it, and
//! what it saves is what it shows.

use super::*;
use crate::views::Side;
use esker_engine::calls::{info, render};
use esker_engine::document::Document;
use esker_engine::draw::scene;
use esker_engine::{Forest, Picture};

/// Most pixels, of 126,000, that rounding the camera may change: a point on the border of two
/// pixels may be in either.
const ROUNDED: usize = 126;
/// The same for parallel views along an axis.
const PARALLEL: usize = 2520;

/// A document of the sample scan, of the same scan beside it, and of a third one that is hidden.
fn document(folder: &Path, fields: &str) -> PathBuf {
    let file = sample().display();
    let path = folder.join("creek.json");
    let clouds = format!(
        r#"{{"file": "{file}"}}, {{"file": "{file}", "offset": [70, 10, 0]}},
        {{"file": "{file}", "offset": [0, 80, 5], "visible": false}}"#
    );
    std::fs::write(&path, format!(r#"{{"esker_scene": 1, "clouds": [{clouds}], {fields}}}"#))
        .unwrap();
    path
}

/// A window on a file, which shows the picture alone.
fn picture_window(file: &Path) -> Harness<'static, App> {
    let options = ["--no-panel", "--no-occlusion", "--frame-ms", "100000"];
    // The harness leaves a border of 8 points.
    let mut harness = window(file, vec2(436.0, 316.0), &options);
    settle(&mut harness);
    harness
}

/// What the window shows.
fn shown(harness: &mut Harness<'_, App>, folder: &Path) -> Picture {
    let path = folder.join("shown.png");
    let _ = std::fs::remove_file(&path);
    harness.state_mut().shots.request(Some(&path), "");
    for _ in 0..2000 {
        harness.step();
        if !harness.state().shots.is_busy() {
            break;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgba).unwrap();
    Picture { width: info.width, height: info.height, rgba, ..Picture::default() }
}

/// What `esker render` draws of a document.
fn rendered(document: &Path) -> Picture {
    let document = Document::read(document).unwrap();
    let silent = Progress::new(Style::Silent, Default::default());
    let request = document.request().unwrap();
    let (file, _folder) = scene::open(&document.inputs().unwrap(), &request, &silent).unwrap();
    render::draw(&file, &request, &silent).unwrap().0
}

/// Number of pixels that differ by more than `by` in a channel.
fn off(a: &Picture, b: &Picture, by: u8) -> usize {
    assert_eq!([a.width, a.height], [b.width, b.height]);
    let first = &a.rgba[..4];
    assert!(a.rgba.chunks_exact(4).any(|pixel| pixel != first), "there is a picture");
    let pairs = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    pairs.filter(|(p, q)| p.iter().zip(*q).any(|(x, y)| x.abs_diff(*y) > by)).count()
}

/// Gives a command, and waits until what it writes is written.
fn save(harness: &mut Harness<'_, App>, command: Command) {
    let ctx = harness.ctx.clone();
    harness.state_mut().perform(&ctx, vec![command]);
    for _ in 0..2000 {
        harness.step();
        if !harness.state().files.is_busy() {
            break;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    // What opens then is laid out before it is shown.
    harness.run_steps(3);
}

#[test]
fn a_scene_document_is_shown_as_it_is_rendered_and_saved_as_it_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let [low, high] = info::bounds(&Forest::open(sample()).unwrap());
    let [x, y, z] = [0, 1, 2].map(|i| low[i].midpoint(high[i]));
    let near = format!(
        r#""size": [420, 300], "method": "points", "colour": "intensity",
            "camera": {{"eye": [{}, {y}, {}], "target": [{x}, {y}, {z}], "fovy": 50}}"#,
        low[0],
        high[2] + 60.0
    );
    for fields in [
        near.as_str(),
        r#""size": [420, 300], "method": "pull-push", "colour": "elevation:900..1100:turbo",
            "filter": {"max_spacing": 3}, "target_spacing": 2, "no_highlights": true,
            "camera": {"direction": [0.3, 1, -0.4], "ortho": 900}"#,
        r#""size": [420, 300], "camera": "direction=0,0,-1;up=1,0,0;ortho=fit""#,
    ] {
        let path = document(folder.path(), fields);
        let mut harness = picture_window(&path);
        assert_eq!(harness.state().wanted.hidden_clouds, [2]);
        let picture = shown(&mut harness, folder.path());
        assert_eq!(off(&picture, &rendered(&path), 1), 0, "{fields}");
        // Another view, as the window saves it.
        for command in [Command::Look(Side::Right), Command::Look(Side::Top), Command::Parallel] {
            let ctx = harness.ctx.clone();
            harness.state_mut().perform(&ctx, vec![command]);
            harness.run_steps(120);
            settle(&mut harness);
            let wanted = shown(&mut harness, folder.path());
            save(&mut harness, Command::SaveScene);
            // It opens as it was left.
            let mut again = picture_window(&path);
            let settings = harness.state().wanted.clone();
            assert_eq!(again.state().wanted, settings);
            let (again, drawn) = (shown(&mut again, folder.path()), rendered(&path));
            let what = format!("{command:?} of {fields}");
            if viewer(&harness).camera().is_parallel() {
                // Depths of parallel views are large numbers, of which many are equal; such points
                // are drawn in any order.
                assert!(off(&again, &wanted, 1) <= ROUNDED, "{what}");
                assert!(off(&again, &drawn, 1) <= PARALLEL, "{what}");
            } else {
                assert!(off(&wanted, &drawn, 1) <= ROUNDED, "{what}");
                assert!(off(&again, &drawn, 1) <= ROUNDED, "{what}");
            }
        }
    }
}

#[test]
fn clips_are_shown_changed_undone_and_saved_in_one_session() {
    let folder = tempfile::tempdir().unwrap();
    let [low, high] = info::bounds(&Forest::open(sample()).unwrap());
    let [x, y, z] = [0, 1, 2].map(|i| low[i].midpoint(high[i]));
    let (width, height) = ((high[0] - low[0]) / 2.0, high[2] - low[2] + 20.0);
    // In the coordinates of the scene, so that the cloud with an offset is cut in the same place.
    let fields = format!(
        r#""size": [420, 300], "method": "points", "colour": "intensity",
            "clips": [
                {{"name": "part", "oriented_box": {{"centre": [{x}, {y}, {z}],
                    "size": [{width}, {width}, {height}], "rotation": [30, 0, 0]}}}},
                {{"plane": {{"point": [{x}, {y}, {z}], "normal": [1, 1, 0]}}, "enabled": false}}],
            "camera": {{"eye": [{}, {y}, {}], "target": [{x}, {y}, {z}], "fovy": 50}}"#,
        low[0],
        high[2] + 60.0
    );
    let path = document(folder.path(), &fields);
    let mut harness = picture_window(&path);
    let cut = shown(&mut harness, folder.path());
    assert_eq!(off(&cut, &rendered(&path), 1), 0);
    let rest = |harness: &mut Harness<'_, App>| {
        settle(harness);
        std::thread::sleep(Duration::from_millis(450));
        harness.run_steps(3);
    };
    rest(&mut harness);
    let first = harness.state().wanted.filter.clips.clone();
    let clips = &mut harness.state_mut().wanted.filter.clips;
    clips[0] = clips[0].clone().inverted();
    clips[1].is_on = true;
    rest(&mut harness);
    let second = harness.state().wanted.filter.clips.clone();
    let away = shown(&mut harness, folder.path());
    assert!(off(&away, &cut, 8) > 1000);
    save(&mut harness, Command::SaveScene);
    assert!(off(&away, &rendered(&path), 1) <= ROUNDED);
    let saved = Document::read(&path).unwrap();
    assert_eq!(saved.request().unwrap().filter.clips, second);
    assert_eq!(saved.scene.clips[0].name.as_deref(), Some("part"));
    press(&harness, Key::Z, Modifiers::COMMAND);
    harness.run_steps(3);
    assert_eq!(harness.state().wanted.filter.clips, first);
    settle(&mut harness);
    assert_eq!(off(&shown(&mut harness, folder.path()), &cut, 1), 0);
    assert_eq!(viewer(&harness).reopened_and_stalls().0, 0);
}

#[test]
fn a_scan_is_saved_beside_it_and_no_other_file_is_replaced_unasked() {
    let folder = tempfile::tempdir().unwrap();
    let built = folder.path().join("creek.esker");
    std::fs::copy(sample(), &built).unwrap();
    let mut harness = picture_window(&built);
    let place = folder.path().join("creek.scene.json");
    std::fs::write(&place, "{\"notes\": 1}").unwrap();
    let text = || std::fs::read_to_string(&place).unwrap();
    save(&mut harness, Command::SaveScene);
    assert_eq!(text(), "{\"notes\": 1}");
    harness.get_by_label("Replace it");
    // A file of another kind is not replaced at all.
    harness.get_by_label("Replace it").click();
    save(&mut harness, Command::Panel);
    assert_eq!(text(), "{\"notes\": 1}");
    assert!(harness.state().shots.failures().iter().any(|line| line.contains("no scene document")));
    std::fs::remove_file(&place).unwrap();
    save(&mut harness, Command::SaveScene);
    assert_eq!(Document::read(&place).unwrap().clouds()[0].path, folder.path().join("creek.esker"));
    // The window's own document is written again, until another program has changed it.
    harness.state_mut().wanted.colour_by = Some("intensity".into());
    save(&mut harness, Command::SaveScene);
    assert!(text().contains("intensity"));
    let other = text().replace("intensity", "classification");
    std::fs::write(&place, &other).unwrap();
    save(&mut harness, Command::SaveScene);
    assert_eq!(text(), other);
    harness.get_by_label("Replace it").click();
    save(&mut harness, Command::Panel);
    assert!(text().contains("intensity"));
}

#[test]
fn options_replace_the_fields_of_a_document_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let fields = r#""method": "points", "colour": "intensity", "target_spacing": 2, "point_size": 3,
        "filter": {"classes": "2", "max_spacing": 1}, "camera": "fovy=40""#;
    let path = document(folder.path(), fields);
    let options = ["--method", "pull-push", "--classes", "5", "--target-spacing", "1"];
    let mut harness = window(&path, vec2(420.0, 300.0), &options);
    settle(&mut harness);
    let wanted = &harness.state().wanted;
    assert_eq!((wanted.method, wanted.target_spacing_px), (Method::PullPush, 1.0));
    assert_eq!(wanted.colour_by.as_deref(), Some("intensity"));
    assert_eq!(wanted.filter.classes, Some("5".parse().unwrap()));
    assert_eq!(wanted.filter.max_spacing, Some(1.0));
    assert_eq!(wanted.dots.size, esker_engine::PointSize::Pixels(3.0));
    assert!((viewer(&harness).camera().fovy_rad().to_degrees() - 40.0).abs() < 1e-9);
    // They belong to the files that they were given with.
    let text = std::fs::read_to_string(&path).unwrap();
    let other = folder.path().join("other.json");
    std::fs::write(&other, text).unwrap();
    harness.state_mut().open_files(vec![other]);
    settle(&mut harness);
    assert_eq!(harness.state().wanted.method, Method::Points);
    // A fault of a document names the field.
    std::fs::write(&path, r#"{"esker_scene": 1, "clouds": [], "colours": "rgb"}"#).unwrap();
    harness.state_mut().open_files(vec![path]);
    for _ in 0..500 {
        harness.step();
        std::thread::sleep(Duration::from_millis(2));
        if let Stage::Failed(fault) = &harness.state().stage {
            assert!(fault.contains("colours"), "{fault}");
            return;
        }
    }
    panic!("the document is opened");
}

#[test]
fn clouds_are_shown_and_hidden_while_the_session_runs() {
    let folder = tempfile::tempdir().unwrap();
    let path = document(folder.path(), r#""method": "points""#);
    let mut harness = window(&path, vec2(900.0, 700.0), &["--no-occlusion"]);
    settle(&mut harness);
    let points = |harness: &Harness<'_, App>| harness.state().counters.points;
    let all = points(&harness);
    harness.get_by_label("Clouds").click();
    harness.run_steps(4);
    // The three clouds are of one file.
    harness.get_all_by_label("creek.esker").nth(1).unwrap().click();
    harness.run_steps(4);
    settle(&mut harness);
    assert_eq!(harness.state().wanted.hidden_clouds, [1, 2]);
    let one = points(&harness);
    assert!(0 < one && one < all, "{one} of {all}");
    save(&mut harness, Command::SaveScene);
    let visible = |path| Document::read(path).unwrap().clouds().into_iter().map(|c| c.is_visible);
    assert_eq!(visible(&path).collect::<Vec<_>>(), [true, false, false]);
    harness.get_all_by_label("creek.esker").nth(1).unwrap().click();
    harness.get_all_by_label("creek.esker").nth(2).unwrap().click();
    harness.run_steps(4);
    settle(&mut harness);
    assert!(harness.state().wanted.hidden_clouds.is_empty());
    assert!(points(&harness) > all);
    assert_eq!(viewer(&harness).reopened_and_stalls().0, 0);
}

#[test]
fn settings_and_measured_points_are_undone_and_redone() {
    let mut harness = window(sample(), vec2(900.0, 700.0), &[]);
    settle(&mut harness);
    let rest = |harness: &mut Harness<'_, App>| {
        settle(harness);
        std::thread::sleep(Duration::from_millis(450));
        harness.run_steps(3);
    };
    rest(&mut harness);
    let first = harness.state().wanted.clone();
    press(&harness, Key::M, Modifiers::NONE);
    rest(&mut harness);
    let second = harness.state().wanted.clone();
    assert_ne!(first.method, second.method);
    let rect = viewer(&harness).picture_rect().unwrap();
    click(&mut harness, rect.lerp_inside(vec2(0.5, 0.5)));
    rest(&mut harness);
    assert_eq!(viewer(&harness).measured().len(), 1);
    let filter = Filter { max_spacing: Some(2.0), ..Filter::default() };
    harness.state_mut().wanted.filter = filter.clone();
    rest(&mut harness);
    let state = |harness: &Harness<'_, App>| {
        (harness.state().wanted.clone(), viewer(harness).measured().len())
    };
    let third = Settings { filter, ..second.clone() };
    assert_eq!(state(&harness), (third.clone(), 1));
    let undo = |harness: &mut Harness<'_, App>, key, modifiers| {
        press(harness, key, modifiers);
        harness.run_steps(3);
    };
    for wanted in [(second.clone(), 1), (second.clone(), 0), (first.clone(), 0), (first, 0)] {
        undo(&mut harness, Key::Z, Modifiers::COMMAND);
        assert_eq!(state(&harness), wanted);
    }
    settle(&mut harness);
    undo(&mut harness, Key::Y, Modifiers::COMMAND);
    assert_eq!(state(&harness), (second.clone(), 0));
    undo(&mut harness, Key::Z, Modifiers::COMMAND | Modifiers::SHIFT);
    assert_eq!(state(&harness), (second, 1));
    undo(&mut harness, Key::Y, Modifiers::COMMAND);
    assert_eq!(state(&harness), (third, 1));
}

#[test]
fn what_was_built_is_kept_under_a_name_and_opened_by_its_path() {
    let folder = tempfile::tempdir().unwrap();
    let scan = Path::new("../../tests/sample/creek.laz");
    let mut harness = window(scan, vec2(900.0, 700.0), &[]);
    harness.state_mut().files.has_dialogs = false;
    settle(&mut harness);
    save(&mut harness, Command::Keep);
    let kept = folder.path().join("kept.esker");
    let enter = |harness: &mut Harness<'_, App>, path: &Path, button: &str| {
        harness.run_steps(3);
        press(harness, Key::A, Modifiers::COMMAND);
        harness.run_steps(2);
        harness.event(Event::Text(path.display().to_string()));
        harness.run_steps(2);
        harness.get_all_by_label(button).last().unwrap().click();
        save(harness, Command::Fit);
    };
    enter(&mut harness, &kept, "Keep");
    let points = viewer(&harness).file().points();
    assert_eq!(Forest::open(&kept).unwrap().points(), points);
    // Not over another file.
    std::fs::write(&kept, "a scan").unwrap();
    save(&mut harness, Command::Keep);
    enter(&mut harness, &kept, "Keep");
    assert_eq!(std::fs::read_to_string(&kept).unwrap(), "a scan");
    let faults = harness.state().shots.failures().join(" ");
    assert!(faults.contains("is there already"), "{faults}");
    save(&mut harness, Command::Open);
    enter(&mut harness, sample(), "Open");
    settle(&mut harness);
    assert_eq!(viewer(&harness).name(), "creek.esker");
    save(&mut harness, Command::Keep);
    let message = harness.state().shots.message();
    assert!(matches!(message, Some(Err(text)) if text.contains("nothing to keep")), "{message:?}");
}

#[test]
fn measurements_are_saved_with_the_document_and_shown_when_it_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let [low, high] = info::bounds(&Forest::open(sample()).unwrap());
    let [a, b] = [low, high].map(|p| format!("{:?}", p));
    // The second cloud is beside the first one, so that half of the picture is moved points.
    let fields = format!(
        r#""size": [420, 300], "camera": "direction=0.1,0.2,-1",
            "annotations": [{{"text": "corner", "at": {a}}}],
            "measurements": [{{"name": "across", "kind": "distance", "points": [{a}, {b}]}}]"#
    );
    let path = document(folder.path(), &fields);
    let mut harness = picture_window(&path);
    let across = |harness: &Harness<'_, App>| viewer(harness).measured()[0].clone();
    assert!(across(&harness).starts_with("across: "), "{}", across(&harness));
    assert_eq!(viewer(&harness).notes(), [""; 0], "nothing of it is left out");
    let rect = viewer(&harness).picture_rect().unwrap();
    for share in [vec2(0.35, 0.5), vec2(0.75, 0.45)] {
        click(&mut harness, rect.lerp_inside(share));
        settle(&mut harness);
        // The next click is no second one of a double click.
        harness.run_steps(60);
    }
    let lines = viewer(&harness).measured();
    assert_eq!(lines.len(), 4, "{lines:?}");
    save(&mut harness, Command::SaveScene);
    let saved = Document::read(&path).unwrap().scene;
    assert_eq!(saved.annotations.len(), 1, "what the window does not change is kept");
    assert_eq!(saved.measurements.len(), 2);
    for (point, line) in saved.measurements[1].points.iter().zip(&lines[1..]) {
        let words: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        assert_eq!(point[..], words[..], "every digit");
    }
    let mut again = picture_window(&path);
    let distance = lines[3].split(',').next().unwrap();
    assert_eq!(viewer(&again).measured(), [across(&harness), distance.to_owned()]);
    let off = off(&shown(&mut again, folder.path()), &rendered(&path), 1);
    assert!(off <= ROUNDED, "pictures have none: {off}");
    // Escape removes them, undo brings them back.
    press(&again, Key::Escape, Modifiers::NONE);
    again.run_steps(3);
    std::thread::sleep(Duration::from_millis(450));
    again.run_steps(3);
    assert_eq!(viewer(&again).measured(), [""; 0]);
    press(&again, Key::Z, Modifiers::COMMAND);
    again.run_steps(3);
    assert_eq!(viewer(&again).measured().len(), 2);
}

#[test]
fn only_the_tool_for_it_picks_points() {
    let mut harness = window(sample(), vec2(900.0, 700.0), &[]);
    settle(&mut harness);
    let at = viewer(&harness).picture_rect().unwrap().center();
    let picked = |harness: &mut Harness<'_, App>| {
        click(harness, at);
        settle(harness);
        harness.run_steps(60);
        viewer(harness).measured().len()
    };
    harness.get_by_label("Navigate").click();
    harness.run_steps(2);
    assert_eq!(picked(&mut harness), 0);
    press(&harness, Key::I, Modifiers::NONE);
    harness.run_steps(2);
    assert_eq!(picked(&mut harness), 1);
    // What a tool has made stays when another one is chosen.
    press(&harness, Key::N, Modifiers::NONE);
    harness.run_steps(2);
    assert_eq!(picked(&mut harness), 1);
}
