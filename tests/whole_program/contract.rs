//! The interface that scripts rely on: the fields of each `--json` object, which is the last line
//! of standard output; exit codes; progress as JSON lines; and the demonstration.

use crate::folder::Folder;
use crate::program::{ESKER, build, esker, run, sample, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::ffi::OsStr;
use std::process::Command;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("contract: build reports its fields", build_reports));
    trials.push(trial("contract: info reports its fields", info_reports));
    trials.push(trial("contract: conditions of a file are measured", info_conditions));
    trials.push(trial("contract: verify reports its fields, also of a failure", verify_reports));
    trials.push(trial("contract: render reports its fields", render_reports));
    trials.push(trial("contract: progress is JSON lines on standard error", progress_is_json));
    trials
        .push(trial("contract: the demonstration works, and is what runs without a command", demo));
}

fn has_numbers(report: &Value, names: &[&str]) {
    for name in names {
        assert!(report[name].is_number(), "`{name}` is no number: {report}");
    }
}

fn build_reports() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let report = build(&[sample()], &out, &[]);
    has_numbers(
        &report,
        &[
            "points_in",
            "points_out",
            "points_refused",
            "seconds",
            "peak_anon_bytes",
            "peak_rss_bytes",
            "bytes_out",
            "nodes",
            "depth",
            "rounding_error_max",
        ],
    );
    assert!(report["refused_reasons"].is_object(), "{report}");
    assert_eq!(report["multiset_hash"].as_str().unwrap().len(), 32);
    assert_eq!(report["bytes_out"], std::fs::metadata(&out).unwrap().len());
    assert_eq!(report["points_refused"], 0);
    assert_eq!(report["points_in"], report["points_out"]);
}

/// Conditions have numbers and rated values, and belong to `.esker` files.
fn info_conditions() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    build(&[sample()], &out, &[]);
    let report =
        esker([OsStr::new("info"), out.as_os_str(), "--conditions".as_ref(), "--json".as_ref()]);
    assert_eq!(report.stdout.lines().count(), 1);
    let report = report.json();
    has_numbers(&report, &["points", "cells", "cells_read", "points_read"]);
    let rows = report["conditions"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    for row in rows {
        has_numbers(row, &["typical", "hardest"]);
        for rated in row["rated"].as_array().unwrap() {
            has_numbers(rated, &["bound", "rated_to"]);
            assert!(rated["is_within"].is_boolean(), "{rated}");
        }
    }
    let refused = esker([OsStr::new("info"), sample().as_os_str(), "--conditions".as_ref()]);
    assert!(refused.error().contains("build one with `esker build`"), "{}", refused.stderr);
}

fn info_reports() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let built = build(&[sample()], &out, &[]);
    let info = esker([OsStr::new("info"), out.as_os_str(), OsStr::new("--json")]);
    assert_eq!(info.stdout.lines().count(), 1);
    let info = info.json();
    has_numbers(&info, &["points", "nodes", "small_nodes_share", "table_bytes_a_node"]);
    has_numbers(&info["bytes_a_point"], &["hot", "residual", "cold"]);
    for (field, parts) in [("bounds", 2), ("scale", 3), ("offset", 3)] {
        assert_eq!(info[field].as_array().map(Vec::len), Some(parts), "{field}: {info}");
    }
    assert!(info.get("crs").is_some() && info["attributes"].is_array(), "{info}");
    for same in ["nodes", "multiset_hash", "rounding_error_max"] {
        assert_eq!(info[same], built[same], "{same}");
    }
    assert!(info["table_bytes_a_node"].as_u64().unwrap() <= 184, "the paper's figure");
    let depths = info["depths"].as_array().unwrap();
    let sum = |what: &str| depths.iter().map(|d| d[what].as_u64().unwrap()).sum::<u64>();
    assert_eq!(
        (sum("points"), sum("nodes")),
        (info["points"].as_u64().unwrap(), info["nodes"].as_u64().unwrap())
    );
    // Fields of the header of a scan that is not built.
    let scan = esker([OsStr::new("info"), sample().as_os_str(), OsStr::new("--json")]).json();
    for same in ["points", "scale", "offset"] {
        assert_eq!(scan[same], info[same], "{same}");
    }
    assert_eq!(
        scan["attributes"].as_array().map(Vec::len),
        info["attributes"].as_array().map(Vec::len)
    );
    // The text for people.
    let text = esker([OsStr::new("info"), out.as_os_str()]);
    assert!(text.worked().stdout.lines().count() > 5);
}

fn verify_reports() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let built = build(&[sample()], &out, &[]);
    for against in [vec![], vec![sample()]] {
        let outcome = verify(&out, &against);
        let report = outcome.json();
        assert_eq!((&report["ok"], &report["points"]), (&true.into(), &built["points_out"]));
    }
    let other = folder.write("other.xyz", "0 0 0\n1 2 3\n");
    let outcome = verify(&out, &[other]);
    outcome.error();
    let report: Value = serde_json::from_str(outcome.stdout.lines().last().unwrap()).unwrap();
    assert_eq!((&report["ok"], &report["points"]), (&false.into(), &built["points_out"]));
}

fn render_reports() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    build(&[sample()], &out, &[]);
    let picture = folder.file("p.png");
    let outcome = esker([
        OsStr::new("render"),
        out.as_os_str(),
        OsStr::new("-o"),
        picture.as_os_str(),
        OsStr::new("--json"),
        OsStr::new("--budget-points"),
        OsStr::new("5000"),
    ]);
    assert_eq!(outcome.stdout.lines().count(), 1);
    let report = outcome.json();
    has_numbers(&report, &["points_drawn", "nodes_drawn", "pixels_covered"]);
    let stages = [
        "select",
        "read",
        "project",
        "gather",
        "pull",
        "push",
        "fill_holes",
        "shade",
        "antialias",
        "draw",
    ];
    has_numbers(&report["stages_ms"], &stages);
    assert!((1..=5000).contains(&report["points_drawn"].as_u64().unwrap()), "{report}");
    assert_eq!(folder.names(), ["out.esker", "p.png"]);
}

fn progress_is_json() {
    let folder = Folder::new();
    let out = folder.file("out.esker");
    let scan = sample();
    let words = [scan.as_os_str(), OsStr::new("-o"), out.as_os_str()];
    let rest = ["--progress", "json", "--json"].map(OsStr::new);
    let outcome = esker([OsStr::new("build")].into_iter().chain(words).chain(rest));
    outcome.json();
    let mut phases = Vec::new();
    for line in outcome.stderr.lines() {
        let line: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        if line.get("note").is_none() {
            assert!(line["done"].is_number(), "{line}");
            phases.push(line["phase"].as_str().unwrap().to_owned());
        }
    }
    assert!(!phases.is_empty(), "progress was shown");
    let silent = build_words(&scan, &out, "none");
    assert_eq!(silent.worked().stderr, "");
}

fn build_words(
    scan: &std::path::Path,
    out: &std::path::Path,
    progress: &str,
) -> crate::program::Outcome {
    let words = [scan.as_os_str(), OsStr::new("-o"), out.as_os_str(), OsStr::new("--progress")];
    esker([OsStr::new("build")].into_iter().chain(words).chain([OsStr::new(progress)]))
}

fn demo() {
    let folder = Folder::new();
    let out = folder.file("made");
    let demo = esker([OsStr::new("demo"), OsStr::new("--out"), out.as_os_str()]);
    assert!(demo.worked().stdout.contains("verified"), "{}", demo.stdout);
    let picture = std::fs::read(out.join("sample.png")).unwrap();
    assert_eq!(&picture[..8], b"\x89PNG\r\n\x1a\n");
    verify(&out.join("sample.esker"), &[sample()]).json();
    let mut bare = Command::new(ESKER);
    bare.current_dir(folder.file(""));
    run(bare, 120).worked();
    let again = std::fs::read(folder.file("out/sample.png")).unwrap();
    assert!(again == picture, "the same picture wherever it is written");
}
