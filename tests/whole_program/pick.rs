//! `esker pick` prints points of the file: what it prints is what an export of the box around the
//! point writes, for every format and kind of coordinates.

use crate::export::export;
use crate::folder::Folder;
use crate::program::{build, esker, sample};
use crate::{data, degrees, las, missing, trial};
use libtest_mimic::Trial;
use serde_json::Value;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Scans of the data folder with attributes that the generated ones lack.
const REAL: [&str; 8] = [
    "las/extrabytes.las",
    "las/1.2-with-color.las",
    "las/epsg_4326.las",
    "las/sample_c.las",
    "e57/bunny-10scans.e57",
    "e57/tinyCartesianFloatRgb.e57",
    "e57/scaled_integer_intensity.e57",
    "ply/room-fragment-002-open3d.ply",
];
const SIZE: [u32; 2] = [160, 120];

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("pick: LAS has all attributes of the export", of_las));
    trials.push(trial("pick: text with odd steps, and PLY of it", of_text_and_ply));
    trials.push(trial("pick: coordinates in degrees", of_degrees));
    trials.push(trial("pick: several scans in one file and in a forest", of_several));
    trials.push(trial(
        "pick: pixels without a point are reported, and faults are errors",
        without_a_point,
    ));
    let Some(root) = data::root() else {
        trials.push(missing("pick: real scans"));
        return;
    };
    for name in REAL {
        let scan = root.join(name);
        trials.push(trial(&format!("pick: {name}"), move || {
            let folder = Folder::new();
            let file = folder.file("real.esker");
            build(&[&scan], &file, &[]);
            agrees_with_export(&folder, &file, "");
        }));
    }
}

fn pick(file: &Path, at: [u32; 2], more: &[&str]) -> Value {
    let at = format!("{},{}", at[0], at[1]);
    let size = format!("{}x{}", SIZE[0], SIZE[1]);
    let words = ["--at", &at, "--size", &size, "--json", "--progress", "none"];
    let words = words.iter().chain(more).map(std::ffi::OsStr::new);
    esker(["pick".as_ref(), file.as_os_str()].into_iter().chain(words)).json()
}

/// Header and rows of a table of text.
fn table(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mark = if text.lines().next().unwrap().contains('\t') { '\t' } else { ' ' };
    text.lines().map(|line| line.split(mark).map(str::to_owned).collect()).collect()
}

/// Asserts that the points at some pixels have the coordinates, names and values of a row that an
/// export of the box around each writes; returns the points.
fn agrees_with_export(folder: &Folder, file: &Path, camera: &str) -> Vec<Value> {
    let mut points = Vec::new();
    for i in 1..=12u32 {
        let at = [i * 57 % SIZE[0] / 2 + SIZE[0] / 4, i * 31 % SIZE[1] / 2 + SIZE[1] / 4];
        let report = pick(file, at, &["--camera", camera]);
        let point = &report["point"];
        if point.is_null() {
            continue;
        }
        let texts = |value: &Value, key: Option<&str>| -> Vec<String> {
            let all = value.as_array().unwrap().iter();
            let text = |v: &Value| key.map_or(v, |key| &v[key]).as_str().unwrap().to_owned();
            all.map(text).collect()
        };
        let place = texts(&point["coordinates"], None);
        let bounds = [place.clone(), place.clone()].concat().join(",");
        let out = folder.file("one.txt");
        export(file, &out, &["--box", &bounds]).json();
        let written = table(&out);
        let names =
            [vec!["x".into(), "y".into(), "z".into()], texts(&point["attributes"], Some("name"))];
        assert_eq!(written[0], names.concat());
        let row = [place, texts(&point["attributes"], Some("value"))].concat();
        assert!(written[1..].contains(&row), "{row:?} is not in {written:?}");
        for axis in 0..3 {
            let [steps, scale, offset] =
                ["steps", "scale", "offset"].map(|name| point[name][axis].as_f64().unwrap());
            let off = row[axis].parse::<f64>().unwrap() - (steps * scale + offset);
            assert!(off.abs() < scale * 1e-3, "{point}");
        }
        points.push(point.clone());
    }
    assert!(!points.is_empty(), "{} has no point in the middle", file.display());
    points
}

fn of_las() {
    let folder = Folder::new();
    let file = folder.file("sample.esker");
    build(&[sample()], &file, &[]);
    let points = agrees_with_export(&folder, &file, "");
    assert!(points[0]["scans"][0].as_str().unwrap().ends_with("creek.laz"));
    let scan = folder.file("hills.las");
    las::write(&scan, "", false, 20_000, |i| {
        let (x, y) = ((i * 7919 % 20_011) as i32, (i * 104_729 % 20_021) as i32);
        [x, y, x / 8 + y / 16]
    });
    let file = folder.file("hills.esker");
    build(&[&scan], &file, &[]);
    for point in agrees_with_export(&folder, &file, "") {
        // The point is a record of the scan, whose integers are its steps.
        let [x, y, z] = [0, 1, 2].map(|axis| point["steps"][axis].as_i64().unwrap());
        assert_eq!(z, x / 8 + y / 16, "{point}");
        let names = point["attributes"].as_array().unwrap().iter().map(|a| &a["name"]);
        assert!(names.clone().any(|name| name == "gps_time"), "{point}");
    }
    // A scan is built first.
    let direct = pick(&scan, [80, 60], &[]);
    let built = pick(&file, [80, 60], &[]);
    assert_eq!(direct["point"]["coordinates"], built["point"]["coordinates"]);
}

/// Text whose axes have steps of their own, with whole numbers, decimals and words of values.
fn odd_text(folder: &Folder) -> PathBuf {
    let mut text = String::from("x y z intensity amplitude\n");
    for i in 0..6000u64 {
        let (x, y) = (i * 7919 % 6007, i * 104_729 % 6011);
        let z = (x * y) % 97;
        let (x, y) = (x as f64 * 0.0025 - 4.0, y as f64 * 0.02 + 123_456.5);
        writeln!(text, "{x:.4} {y:.2} {}.{:05} {} {}.5", z / 40, z * 25, i % 300, i % 7).unwrap();
    }
    folder.write("odd.xyz", &text)
}

fn of_text_and_ply() {
    let folder = Folder::new();
    let (text, file) = (odd_text(&folder), folder.file("odd.esker"));
    build(&[&text], &file, &[]);
    let rows = table(&text);
    for point in agrees_with_export(&folder, &file, "") {
        // It is a row of the input too, number by number.
        let numbers =
            |row: &[String]| -> Vec<f64> { row.iter().map(|n| n.parse().unwrap()).collect() };
        let attributes = point["attributes"].as_array().unwrap();
        let value =
            |name: &str| attributes.iter().find(|a| a["name"] == name).unwrap()["value"].clone();
        let place = point["coordinates"].as_array().unwrap().iter().cloned();
        let own = place.chain([value("intensity"), value("amplitude")]);
        let own: Vec<String> = own.map(|v| v.as_str().unwrap().to_owned()).collect();
        assert!(rows[1..].iter().any(|row| numbers(row) == numbers(&own)), "{own:?}");
    }
    let ply = folder.file("odd.ply");
    export(&file, &ply, &[]).json();
    let again = folder.file("again.esker");
    build(&[&ply], &again, &[]);
    agrees_with_export(&folder, &again, "");
}

fn of_degrees() {
    let folder = Folder::new();
    let (scan, file) = (degrees::table(&folder), folder.file("hills.esker"));
    build(&[&scan], &file, &[]);
    for point in agrees_with_export(&folder, &file, "") {
        let longitude = point["coordinates"][0].as_str().unwrap();
        assert!(longitude.starts_with("8.5") && longitude.len() == 9, "{point}");
        let metres = point["position"][0].as_f64().unwrap();
        assert!(metres / longitude.parse::<f64>().unwrap() > 70_000.0, "{point}");
    }
}

/// Colours of 8 and of 16 bits, and a scan without: the export brings them to one scale.
fn of_several() {
    let folder = Folder::new();
    let mut colours = String::from("x y z red green blue\n");
    let mut plain = String::new();
    for i in 0..4000u64 {
        let (x, y) = (i * 7919 % 4001, i * 104_729 % 4003);
        let (x, y) = (x as f64 * 0.1 + 5_679_000.0, y as f64 * 0.1 + 3_770_500.0);
        writeln!(colours, "{x:.2} {y:.2} 1300.00 {} {} {}", i % 256, i % 200, i % 90).unwrap();
        writeln!(plain, "{:.2} {y:.2} 1300.00", x + 500.0).unwrap();
    }
    let scans =
        [sample(), folder.write("colours.xyz", &colours), folder.write("plain.xyz", &plain)];
    let file = folder.file("all.esker");
    build(&scans, &file, &["--ignore-crs"]);
    let mut seen: Vec<String> = Vec::new();
    let mut see = |points: Vec<Value>| {
        for point in points {
            let scans = point["scans"].as_array().unwrap();
            seen.extend(scans.iter().map(|scan| scan.as_str().unwrap().to_owned()));
            let is_plain = scans[0].as_str().unwrap().ends_with("plain.xyz");
            let attributes = point["attributes"].as_array().unwrap();
            let red = attributes.iter().find(|a| a["name"] == "red").unwrap();
            assert_eq!(red["is_present"], !is_plain, "{point}");
        }
    };
    // Seen from above: the middle of the sample, and of each of the others, which lie over it.
    let above = |x: u32| format!("eye={x},3770700,3000;target={x},3770700,0;up=0,1,0;fovy=8");
    let cameras = [String::new(), above(5_679_200), above(5_679_700)];
    cameras.iter().for_each(|camera| see(agrees_with_export(&folder, &file, camera)));
    // A forest: the same scans in three files.
    let names = ["first.esker", "second.esker", "third.esker"].map(|name| folder.file(name));
    build(&scans[..1], &names[0], &[]);
    for i in 1..3 {
        let words = ["append".as_ref(), names[i - 1].as_os_str(), scans[i].as_os_str()];
        let out = ["-o".as_ref(), names[i].as_os_str(), "--ignore-crs".as_ref()];
        esker(words.into_iter().chain(out)).worked();
    }
    cameras.iter().for_each(|camera| see(agrees_with_export(&folder, &names[2], camera)));
    let all = ["creek.laz", "colours.xyz", "plain.xyz"];
    assert!(all.iter().all(|name| seen.iter().any(|scan| scan.ends_with(name))), "{seen:?}");
}

fn without_a_point() {
    let folder = Folder::new();
    let file = folder.file("sample.esker");
    build(&[sample()], &file, &[]);
    let up = ["--camera", "direction=0,0.01,1;eye=5679000,3770600,2000"];
    let report = pick(&file, [80, 60], &up);
    assert!(report["point"].is_null() && report["depth"].is_null(), "{report}");
    let run = |at: &str, more: &[&str]| {
        let words = ["--at", at, "--size", "160x120"]
            .into_iter()
            .chain(more.iter().copied())
            .map(std::ffi::OsStr::new);
        esker(["pick".as_ref(), file.as_os_str()].into_iter().chain(words))
    };
    let text = run("80,60", &up);
    assert!(text.worked().stdout.contains("nothing is drawn"), "{}", text.stdout);
    let text = run("80,60", &[]);
    assert!(text.worked().stdout.starts_with("x  "), "{}", text.stdout);
    for at in ["160,0", "0,120", "80", "a,b", "-1,5", "80,60,1"] {
        run(at, &[]).error();
    }
    run("80,60", &["--classes", "building"]).error();
    // A filter chooses among the points.
    let point = &pick(&file, [80, 60], &["--without-flags", "withheld"])["point"];
    assert!(point["node"].is_u64() && point["offset_px"].is_number(), "{point}");
}
