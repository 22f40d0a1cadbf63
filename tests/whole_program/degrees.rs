//! Scans in degrees through the program: what it says of them, their exact coordinates on the way
//! out, and pictures with cameras in degrees.

use crate::folder::Folder;
use crate::program::{build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("degrees: lengths are in metres and coordinates exact", in_metres));
    trials.push(trial("degrees: the views of pictures are in degrees", pictures));
}

/// Rows of hills of about 600 x 450 m at 47 degrees north, steps of 1e-7 degrees.
fn rows() -> String {
    let mut rows = String::new();
    for i in 0..4000 {
        let share = |k: f64| (f64::from(i) * k).fract();
        let [x, y] = [80_000.0 * share(0.754_877_666), 40_000.0 * share(0.569_840_291)];
        let height = 400_000 + (x / 9000.0).sin().mul_add(15_000.0, y * 0.1) as i64;
        let (x, y) = (x as i64, y as i64);
        let [longitude, latitude] = [85_000_000 + x, 470_000_000 + y].map(|v| v as f64 * 1e-7);
        writeln!(rows, "{latitude:.7},{longitude:.7},{:.3}", height as f64 * 1e-3).unwrap();
    }
    rows
}

/// A table with latitudes first.
pub fn table(folder: &Folder) -> PathBuf {
    folder.write("hills.csv", &format!("lat,lon,height\n{}", rows()))
}

/// The table, and the file that is built of it.
fn built(folder: &Folder) -> [PathBuf; 2] {
    let scan = table(folder);
    let out = folder.file("hills.esker");
    build(&[&scan], &out, &[]);
    [scan, out]
}

fn info(file: &Path) -> Value {
    esker(["info".as_ref(), file.as_os_str(), "--json".as_ref()]).json()
}

fn in_metres() {
    let folder = Folder::new();
    let [scan, out] = built(&folder);
    assert_eq!(info(&scan)["unit"], "degree");
    let info = info(&out);
    assert_eq!((&info["unit"], &info["scale"][0]), (&"degree".into(), &1e-7.into()));
    let [low, high] = [&info["bounds"][0], &info["bounds"][1]];
    assert!(low[0] == 8.5 && low[1] == 47.0 && high[1].as_f64().unwrap() < 47.005, "{info}");
    // Lengths of a degree at 47 degrees north, from tables of WGS 84.
    for (axis, metres) in [(0, 76_056.0), (1, 111_170.0), (2, 1.0)] {
        let factor = info["factor"][axis].as_f64().unwrap();
        assert!((factor / metres - 1.0).abs() < 1e-3, "{info}");
    }
    let text = esker(["info".as_ref(), out.as_os_str()]);
    assert!(text.worked().stdout.contains("lengths      in metres: 760"), "{}", text.stdout);
    assert_eq!(verify(&out, &[&scan]).json()["against_points"], 4000);
    // All rows come out as they went in.
    let back = folder.file("back.csv");
    esker(["export".as_ref(), out.as_os_str(), "-o".as_ref(), back.as_os_str()]).worked();
    let numbers = |text: &str, order: [usize; 3]| -> BTreeSet<[String; 3]> {
        let row = |line: &str| {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            order.map(|axis| format!("{:.7}", cells[axis]))
        };
        text.lines().skip(1).map(row).collect()
    };
    let given = numbers(&std::fs::read_to_string(&scan).unwrap(), [1, 0, 2]);
    assert_eq!(numbers(&std::fs::read_to_string(&back).unwrap(), [0, 1, 2]), given);
    assert_eq!(given.len(), 4000);
    let words = ["export".as_ref(), out.as_os_str(), "-o".as_ref(), back.as_os_str()];
    let more = ["--overwrite", "--box", "8.5,47,8.504,47.01"].map(OsStr::new);
    esker(words.into_iter().chain(more)).worked();
    let west = given.iter().filter(|row| row[0].parse::<f64>().unwrap() <= 8.504).cloned();
    assert_eq!(numbers(&std::fs::read_to_string(&back).unwrap(), [0, 1, 2]), west.collect());
}

fn pictures() {
    let folder = Folder::new();
    let [_, out] = built(&folder);
    let picture = folder.file("out.png");
    let draw = |more: &[&str]| {
        let words = ["render".as_ref(), out.as_os_str(), "-o".as_ref(), picture.as_os_str()];
        let more = ["--size", "200x150", "--json"].iter().chain(more).map(OsStr::new);
        esker(words.into_iter().chain(more)).json()
    };
    let fitted = draw(&[]);
    let covered = |report: &Value| report["pixels_covered"].as_f64().unwrap();
    // The ground fills the picture; in degrees it would be a wall some pixels wide.
    assert!(covered(&fitted) > 0.2 * 200.0 * 150.0, "{fitted}");
    assert!(!fitted["notes"].to_string().contains("distorted"), "{fitted}");
    let numbers =
        |v: &Value| v.as_array().unwrap().iter().map(Value::to_string).collect::<Vec<_>>();
    let [eye, along] = ["eye", "forward"].map(|part| numbers(&fitted["camera"][part]).join(","));
    let again = draw(&["--camera", &format!("eye={eye};direction={along}")]);
    assert!((covered(&again) / covered(&fitted) - 1.0).abs() < 0.01, "{again}");
    // From 300 m above the middle of the ground.
    let camera = "eye=8.504,47.002,700;target=8.504,47.0021,400;fovy=60";
    let above = draw(&["--camera", camera]);
    assert!(covered(&above) > 0.9 * 200.0 * 150.0, "{above}");
    // A box of its western half leaves the picture half empty.
    let half = draw(&["--camera", camera, "--box", "8.5,47,8.504,47.01"]);
    assert!((covered(&half) / covered(&above) - 0.5).abs() < 0.05, "{half}");
}
