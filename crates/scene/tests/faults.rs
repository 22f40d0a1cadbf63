//! Every fault of a document is an error that names the field; and only documents are taken for
//! documents.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_scene::{BYTES_MAX, Found, SceneError, detect, parse, read};
use std::io::{Read, repeat};

/// Error of a document with these fields.
fn fault(fields: &str) -> String {
    parse(&format!(r#"{{"esker_scene": 1, {fields}}}"#)).unwrap_err().to_string()
}

#[test]
fn an_error_names_the_field() {
    for (fields, field, what) in [
        (r#""fog": 1"#, "fog", "unknown field `fog`"),
        (r#""clouds": 7"#, "`clouds`", "invalid type: integer `7`"),
        (r#""clouds": [{"visible": true}]"#, "`clouds[0]`", "missing field `file`"),
        (r#""clouds": [{"file": " "}]"#, "`clouds[0].file`", "is empty"),
        (r#""clouds": [{"file": "a", "colour": "rgb"}]"#, "clouds[0].colour", "unknown field"),
        (
            r#""clouds": [{"file": "a"}, {"file": "b", "visible": 1}]"#,
            "`clouds[1].visible`",
            "boolean",
        ),
        (r#""clouds": [{"file": "a", "offset": [1, 2]}]"#, "`clouds[0].offset", "length 2"),
        (r#""build": {"normals": 1}"#, "`build.normals`", "string"),
        (r#""build": {"memory": "4GiB"}"#, "build.memory", "unknown field `memory`"),
        (r#""build": {"compact": "yes"}"#, "`build.compact`", "boolean"),
        (r#""build": {"node_capacity": -1}"#, "`build.node_capacity`", "-1"),
        (r#""camera": [1, 2, 3]"#, "`camera`", "expected a camera"),
        (r#""camera": {"eye": [1, 2]}"#, "`camera.eye", "length 2"),
        (r#""camera": {"eye": [1, 2, "a"]}"#, "`camera.eye[2]`", "string"),
        (r#""camera": {"eye": [1, 2, 1e999]}"#, "`camera.eye[2]`", "out of range"),
        (r#""camera": {"lens": 50}"#, "camera.lens", "unknown field `lens`"),
        (r#""camera": {"ortho": [5]}"#, "`camera.ortho`", "expected a number"),
        (r#""size": "1024x1024""#, "`size`", "string"),
        (r#""size": [1024]"#, "`size", "length 1"),
        (r#""size": [1024, -1]"#, "`size[1]`", "-1"),
        (r#""window": [0, 0, 5]"#, "`window", "length 3"),
        (r#""method": 3"#, "`method`", "string"),
        (r#""budget_points": 1.5"#, "`budget_points`", "u64"),
        (r#""budget_ms": "fast""#, "`budget_ms`", "f64"),
        (r#""target_spacing": true"#, "`target_spacing`", "f64"),
        (r#""colour": {"by": "rgb"}"#, "`colour`", "string"),
        (r#""filter": {"box": "0,0,1,1"}"#, "`filter.box`", "sequence"),
        (r#""filter": {"polygon": [[1, 2]]}"#, "`filter.polygon`", "expected corners"),
        (r#""filter": {"classes": [2]}"#, "`filter.classes`", "string"),
        (r#""filter": {"class": "2"}"#, "filter.class", "unknown field `class`"),
        (r#""no_highlights": 1"#, "`no_highlights`", "boolean"),
        (r#""point_size": []"#, "`point_size`", "expected a number"),
        (r#""eye_dome": "strong""#, "`eye_dome`", "f64"),
        (r#""light": {"lights": [7]}"#, "`light.lights[0]`", "expected a light"),
        (r#""light": {"samples": 1.5}"#, "`light.samples`", "u32"),
        (r#""light": {"sun": "1,2"}"#, "light.sun", "unknown field `sun`"),
        (
            r#""measurements": [{"kind": "weight", "points": []}]"#,
            "`measurements[0].kind`",
            "`weight`",
        ),
        (
            r#""measurements": [{"kind": "distance", "points": [[0, 0, 0]]}]"#,
            "`measurements[0].points`",
            "has 1 points",
        ),
        (r#""measurements": [{"kind": "angle"}]"#, "`measurements[0]`", "missing field `points`"),
        (r#""annotations": [{"text": "", "at": [0, 0, 0]}]"#, "`annotations[0].text`", "empty"),
        (r#""annotations": [{"text": "a"}]"#, "`annotations[0]`", "missing field `at`"),
        (
            r#""bookmarks": [{"name": "a", "camera": {"fov": 1}}]"#,
            "bookmarks[0].camera.fov",
            "unknown field `fov`",
        ),
        (
            r#""bookmarks": [{"name": "a", "camera": ""}, {"name": "a", "camera": ""}]"#,
            "`bookmarks[1].name`",
            "names two",
        ),
        (r#""bookmarks": [{"name": "", "camera": ""}]"#, "`bookmarks[0].name`", "empty"),
        (
            r#""camera_path": [{"time_s": 0, "camera": ""}, {"time_s": 0, "camera": ""}]"#,
            "`camera_path[1].time_s`",
            "times rise",
        ),
        (
            r#""camera_path": [{"time_s": -1, "camera": ""}]"#,
            "`camera_path[0].time_s`",
            "times rise",
        ),
        (r#""camera_path": [{"time_s": 0}]"#, "`camera_path[0]`", "missing field `camera`"),
        (r#""full": true, "full": true"#, "full", "duplicate field"),
    ] {
        let error = fault(fields);
        assert!(error.contains(field) && error.contains(what), "{fields}: {error}");
    }
}

#[test]
fn faults_of_clips_name_the_field() {
    for (fields, field, what) in [
        (r#""clips": [{"box": [0, 0, 0, 1, 1]}]"#, "`clips[0].box", "length 5"),
        (r#""clips": [{"box": [0, 0, 2, 1, 1, 1]}]"#, "`clips[0].box`", "no inside"),
        (r#""clips": [{"keep": "left", "box": [0, 0, 0, 1, 1, 1]}]"#, "`clips[0].keep`", "`left`"),
        (r#""clips": [{}]"#, "`clips[0]`", "`oriented_box` and `plane`"),
        (
            r#""clips": [{"oriented_box": {"centre": [0, 0, 0], "size": [1, -1, 1]}}]"#,
            "`clips[0].oriented_box.size`",
            "below 0",
        ),
        (
            r#""clips": [{"box": [0, 0, 0, 1, 1, 1], "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}]"#,
            "`clips[0]`",
            "needs one of",
        ),
        (
            r#""clips": [{"plane": {"point": [0, 0, 0], "normal": [0, 0, 0]}}]"#,
            "`clips[0].plane.normal`",
            "direction",
        ),
    ] {
        let error = fault(fields);
        assert!(error.contains(field) && error.contains(what), "{fields}: {error}");
    }
}

#[test]
fn the_example_of_the_page_is_a_document() {
    let page = include_str!("../../../docs/scene.md");
    let (_, example) = page.split_once("```json\n").unwrap();
    let (example, _) = example.split_once("```").unwrap();
    let scene = parse(example).unwrap();
    assert_eq!(scene.clouds.len(), 2);
    assert_eq!(parse(&scene.to_json().unwrap()).unwrap(), scene);
    // The page describes every field of the document.
    let fields = serde_json::from_str::<serde_json::Value>(example).unwrap();
    for field in fields.as_object().unwrap().keys() {
        assert!(page.contains(&format!("`{field}")), "{field}");
    }
}

#[test]
fn the_version_is_read_before_all_other_fields() {
    for (text, found) in [
        (r#"{"esker_scene": 2, "fog": {"density": 0.1}}"#, "version 2,"),
        (r#"{"fog": [[1, {"a": 2}]], "esker_scene": 2}"#, "version 2,"),
        (r#"{"esker_scene": "1"}"#, "version \"1\","),
        (r#"{"esker_scene": 1.0}"#, "version 1.0,"),
        (r#"{"esker_scene": -1}"#, "version -1,"),
        (r#"{"esker_scene": [1, [2]]}"#, "version [...],"),
        (r#"{"esker_scene": {"a": 1}}"#, "version {...},"),
        (r#"{"esker_scene": null}"#, "version null,"),
        (r#"{"esker_scene": 1e400}"#, "version ?,"),
        (r#"{"esker_scene""#, "version ?,"),
    ] {
        let error = parse(text).unwrap_err();
        assert!(matches!(error, SceneError::Version { .. }), "{text}: {error}");
        assert!(error.to_string().contains(found), "{text}: {error}");
        assert!(error.to_string().contains("reads version 1"), "{error}");
    }
}

#[test]
fn a_document_is_told_by_its_content() {
    let found = |text: &str| detect(text.as_bytes()).unwrap();
    let scene = || Found::Scene("1".into());
    for text in [
        r#"{"esker_scene": 1}"#,
        "\u{feff} \r\n\t{ \"esker_scene\" : 1",
        r#"{"other": {"esker_scene": 7}, "esker_scene": 1, damaged"#,
    ] {
        assert_eq!(found(text), scene(), "{text}");
    }
    for text in [
        r#"{"type": "FeatureCollection", "features": [{"esker_scene": 1}]}"#,
        r#"{"esker scene": 1}"#,
        "{}",
        "{",
        "{0 0 0}\n{1 1 1}\n\"esker_scene\": 1",
        r#"{1: 2, "esker_scene": 1}"#,
    ] {
        assert_eq!(found(text), Found::OtherObject, "{text}");
        assert!(matches!(parse(text).unwrap_err(), SceneError::NoScene), "{text}");
    }
    for text in
        ["", " \n ", "0 0 0\n", "x y z {\"esker_scene\": 1}", r#"[{"esker_scene": 1}]"#, "LASF"]
    {
        assert_eq!(found(text), Found::Other, "{text}");
        assert!(matches!(parse(text).unwrap_err(), SceneError::NoScene), "{text}");
    }
}

/// Counts the bytes that are read of a text that never ends.
struct Counted<R>(R, u64);

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.0.read(buffer)?;
        self.1 += count as u64;
        Ok(count)
    }
}

#[test]
fn endless_texts_are_read_up_to_the_limit() {
    for (start, endless, most) in [
        ("", b' ', BYTES_MAX),
        ("{", b' ', BYTES_MAX),
        ("{\"", b'a', BYTES_MAX),
        // The first character that is no blank decides.
        ("1", b'1', 1 << 16),
        ("{1", b'1', 1 << 16),
    ] {
        let mut text = Counted(start.as_bytes().chain(repeat(endless)), 0);
        assert_ne!(detect(&mut text).unwrap(), Found::Scene("1".into()));
        assert!(text.1 <= most, "{start:?}: {} bytes were read", text.1);
    }
}

#[test]
fn deep_nesting_and_long_documents_are_refused() {
    let deep = format!(r#"{{"esker_scene": 1, "light": {{"lights": [{}"#, "[".repeat(1 << 20));
    assert!(parse(&deep).unwrap_err().to_string().contains("light.lights"));
    let before = format!("{{\"a\": {}", "[".repeat(1 << 20));
    assert!(matches!(parse(&before).unwrap_err(), SceneError::NoScene));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.json");
    let blanks = " ".repeat(BYTES_MAX as usize);
    std::fs::write(&path, format!("{{\"esker_scene\": 1}}{blanks}")).unwrap();
    assert!(matches!(read(&path).unwrap_err(), SceneError::TooLong));
    std::fs::write(&path, b"{\"esker_scene\": 1, \"method\": \"\xff\"}").unwrap();
    assert!(matches!(read(&path).unwrap_err(), SceneError::Read(_)));
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(read(&path).unwrap_err(), SceneError::Read(_)));
}
