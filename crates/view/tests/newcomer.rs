//! What a newcomer wants first, by clicks on widgets in a real window: open a scan, look from
//! above, tick a class, read a coordinate, take a picture; in a small, a usual and a finely scaled
//! window.
//! Skips itself without a display. With `ESKER_NEWCOMER` (a scan whose points have class 0) and
//! `ESKER_PICTURES` (a folder) it prints the times for that scan and keeps the pictures, for people
//! to look at.

#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Sizes in points, and pixels a point.
const WINDOWS: [(&str, &str); 3] = [("800x600", "1"), ("1280x800", "1"), ("640x400", "2")];
/// Width of windows that show the panel at first, points.
const WITH_PANEL: u32 = 900;

/// Width and height of a picture, and its pixels.
fn png(path: &Path) -> ((u32, u32), Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut rgba = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut rgba).unwrap();
    ((info.width, info.height), rgba)
}

fn png_size(path: &Path) -> (u32, u32) {
    png(path).0
}

/// Does what the script says, in a window on `scan`, with files in `folder`. Returns the report and
/// the seconds from the start to the end of the program.
fn run(scan: &Path, folder: &Path, size: &str, scale: &str) -> (Value, f64) {
    let mut script: Value = serde_json::from_str(include_str!("newcomer.json")).unwrap();
    let width: u32 = size.split('x').next().unwrap().parse().unwrap();
    if width < WITH_PANEL {
        let steps = script["before"].as_array_mut().unwrap();
        steps.insert(0, json!({"do": "widget", "name": "Panel"}));
    }
    std::fs::write(folder.join("script.json"), script.to_string()).unwrap();
    let start = Instant::now();
    let output = Command::new(env!("CARGO_BIN_EXE_esker-view"))
        .current_dir(folder)
        .env("WINIT_X11_SCALE_FACTOR", scale)
        .args(["--window", "cpu", "--cache", "0", "--size", size, "--script", "script.json"])
        .arg(scan)
        .output()
        .unwrap();
    let seconds = start.elapsed().as_secs_f64();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = String::from_utf8_lossy(&output.stdout).into_owned();
    (serde_json::from_str(report.lines().last().unwrap()).unwrap(), seconds)
}

#[test]
fn what_a_newcomer_wants_first_is_found_in_windows_of_all_sizes() {
    let has_display = cfg!(not(target_os = "linux"))
        || ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    if !has_display {
        eprintln!("skipped: there is no display");
        return;
    }
    let given = std::env::var_os("ESKER_NEWCOMER").map(PathBuf::from);
    let sample = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    let scan = given.unwrap_or(sample);
    for (size, scale) in WINDOWS {
        let folder = tempfile::tempdir().unwrap();
        let (report, seconds) = run(&scan, folder.path(), size, scale);
        println!("{size} at scale {scale}: {seconds:.1} s");
        assert_eq!(report["faults"], json!([]), "{size}");
        let measured = report["measured"].as_array().unwrap();
        assert_eq!(measured.len(), 1, "{size}: {measured:?}");
        let at = measured[0].as_str().unwrap().split_whitespace();
        assert_eq!(at.filter_map(|number| number.parse::<f64>().ok()).count(), 3, "{measured:?}");
        let names = ["1-top.png", "2-class.png", "3-coordinate.png", "4-picture.png"];
        let sizes = names.map(|name| png_size(&folder.path().join(name)));
        assert!(sizes.iter().all(|s| *s == sizes[0]), "{sizes:?}");
        // The steps behind a changed setting wait for its picture: rows of background alone.
        let ((width, _), empty) = png(&folder.path().join("empty.png"));
        let is_even = |row: &[u8]| row.chunks_exact(4).all(|pixel| *pixel == row[..4]);
        assert!(empty.chunks_exact(width as usize * 4).all(is_even), "{size}");
        let stem = scan.file_stem().unwrap().to_string_lossy();
        let picture = png_size(&folder.path().join(format!("{stem}-0001.png")));
        assert!(
            picture.0 < sizes[0].0 && picture.1 <= sizes[0].1,
            "without the panel: {picture:?}"
        );
        if let Some(out) = std::env::var_os("ESKER_PICTURES").map(PathBuf::from) {
            for name in names {
                let to = out.join(format!("{size}-{scale}-{name}"));
                std::fs::copy(folder.path().join(name), to).unwrap();
            }
        }
    }
}
