//! `esker bench draw` as scripts use it: a row for every path, order, number of points and size,
//! with and without a GPU (a software driver counts as one here), over generated points and over a
//! file.

use crate::folder::Folder;
use crate::program::{build, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("draw: a row has its fields, on the CPU alone", on_the_cpu));
    trials.push(trial("draw: every path of a GPU draws what the CPU draws", on_a_gpu));
    trials.push(trial("draw: a file is drawn in its own order", of_a_file));
    trials.push(trial("draw: points that do not fit are refused with the remedy", too_small));
    trials.push(trial("draw: people get a table", for_people));
}

/// Few points, two sizes.
const SMALL: [&str; 8] =
    ["bench", "draw", "--points", "100k,3000", "--size", "64x64,96x54", "--progress", "none"];

fn rows(report: &Value) -> &[Value] {
    let rows = report["rows"].as_array().unwrap();
    for row in rows {
        for field in [
            "points",
            "nodes",
            "ms",
            "ms_p10",
            "ms_p90",
            "wall_ms",
            "mpoints_per_s",
            "bytes_per_s",
            "copy_bytes_per_s",
            "share_of_bandwidth",
            "frames",
        ] {
            assert!(row[field].as_f64().is_some_and(|n| n > 0.0), "`{field}` of {row}");
        }
        let number = |field: &str| row[field].as_f64().unwrap();
        assert!(number("ms_p10") <= number("ms") && number("ms") <= number("ms_p90"), "{row}");
        let clock = if row["gpu_ms"].is_number() && row["is_software"] == false {
            "timestamps"
        } else {
            "wall"
        };
        assert_eq!(row["clock"], clock, "{row}");
        assert!(row["device"].is_string() && row["is_software"].is_boolean(), "{row}");
        assert!(row["size"].as_array().is_some_and(|size| size.len() == 2), "{row}");
        let has_no_pixels = row["path"] == "atomics-no-pixels";
        assert_eq!(row["pixels_covered"].is_null(), has_no_pixels, "{row}");
        assert_eq!(row["rate_to_no_pixels"].is_number(), row["path"] == "atomics", "{row}");
    }
    rows
}

fn on_the_cpu() {
    let report = esker(SMALL.iter().chain(&["--json", "--backend", "cpu"])).json();
    assert!(report["adapter"].is_null() && report["notes"] == serde_json::json!([]), "{report}");
    let rows = rows(&report);
    assert_eq!(rows.len(), 8, "two numbers of points, two orders, two sizes: {report}");
    assert!(rows.iter().all(|row| row["path"] == "cpu" && row["is_software"] == false));
    let orders: Vec<_> = rows.iter().step_by(2).map(|row| row["order"].as_str().unwrap()).collect();
    assert_eq!(orders, ["random", "morton", "random", "morton"]);
    // Both orders hold the same points; hot positions of larger nodes round them differently.
    let covered = |row: &Value| row["pixels_covered"].as_f64().unwrap();
    assert!((covered(&rows[0]) / covered(&rows[2]) - 1.0).abs() < 0.01, "{report}");
    assert!(covered(&rows[0]) > 64.0 * 64.0 * 0.7, "the picture is filled: {report}");
}

fn on_a_gpu() {
    let report = esker(SMALL.iter().chain(&["--json", "--gpu-software"])).json();
    let rows = rows(&report);
    if report["adapter"].is_null() {
        eprintln!("no adapter");
        assert!(report["notes"][0].as_str().unwrap().contains("the CPU alone"), "{report}");
        return;
    }
    assert!(rows.iter().any(|row| row["path"] == "primitives"), "{report}");
    for same in rows.chunk_by(|a, b| {
        ["points", "order", "size"].map(|f| &a[f]) == ["points", "order", "size"].map(|f| &b[f])
    }) {
        assert_eq!(same[0]["path"], "cpu", "{report}");
        let pixels = same[0]["pixels_covered"].as_f64().unwrap();
        for row in same.iter().filter(|row| row["pixels_covered"].is_number()) {
            let share = row["pixels_covered"].as_f64().unwrap() / pixels;
            assert!((share - 1.0).abs() < 0.005, "{row} beside {}", same[0]);
        }
    }
}

fn of_a_file() {
    let folder = Folder::new();
    let file = folder.file("sample.esker");
    let built = build(&[sample()], &file, &[]);
    let file = file.display().to_string();
    let words = ["bench", "draw", &file, "--size", "64x64", "--json", "--backend", "cpu"];
    let report = esker(words).json();
    let rows = rows(&report);
    assert_eq!((rows.len(), &rows[0]["order"]), (1, &"file".into()), "{report}");
    assert_eq!((&rows[0]["points"], &rows[0]["nodes"]), (&built["points_out"], &built["nodes"]));
    assert_eq!(report["file"], file.as_str());
}

fn too_small() {
    let outcome = esker(SMALL.iter().chain(&["--backend", "cpu", "--budget-ram", "1KiB"]));
    assert!(outcome.error().contains("--budget-ram"), "{}", outcome.stderr);
    for wrong in ["0", "5G", "many"] {
        let outcome = esker(["bench", "draw", "--points", wrong]);
        assert!(outcome.error().contains("such as 20M"), "{}", outcome.stderr);
    }
}

fn for_people() {
    let outcome = esker(SMALL.iter().chain(&["--backend", "cpu"]));
    let text = &outcome.worked().stdout;
    for word in ["Mpoints/s", "100,000", "morton", "random", "96x54", "a copy"] {
        assert!(text.contains(word), "no `{word}` in {text}");
    }
    assert!(esker(["bench"]).worked().stdout.contains("esker bench draw"));
}
