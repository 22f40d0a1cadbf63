//! Scans that were appended are one cloud with the old ones to every command, and one tree again once merged.

use crate::folder::Folder;
use crate::program::{build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::path::Path;

/// A short way over the cloud.
const PATH: &str = r#"{"coordinates": "bounds", "views": [
    {"name": "overview", "eye": [-0.2, -0.3, 3], "target": [0.5, 0.5, 0.5], "stay_s": 0.1},
    {"name": "close", "eye": [0.4, 0.2, 1.2], "target": [0.6, 0.6, 0.3], "travel_s": 0.3, "stay_s": 0.1}
]}"#;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("forest: appended scans are one cloud to every command", one_cloud));
    trials.push(trial(
        "forest: what does not fit is counted, what does not belong is named",
        misfits,
    ));
}

fn append(old: &Path, scan: &Path, out: &Path, more: &[&str]) -> crate::program::Outcome {
    let words =
        ["append", old.to_str().unwrap(), scan.to_str().unwrap(), "-o", out.to_str().unwrap()];
    esker(words.into_iter().chain(["--json", "--progress", "none"]).chain(more.iter().copied()))
}

fn json(words: &[&str]) -> Value {
    esker(words.iter().copied().chain(["--json"])).json()
}

fn hash(report: &Value) -> u128 {
    u128::from_str_radix(report["multiset_hash"].as_str().unwrap(), 16).unwrap()
}

fn one_cloud() {
    let folder = Folder::new();
    let [first, second] = ["synthetic:office:60k:1", "synthetic:office:40k:2"].map(Path::new);
    let [a, b, c] = ["a.esker", "b.esker", "c.esker"].map(|name| folder.file(name));
    let [b_word, c_word] = [&b, &c].map(|path| path.to_str().unwrap());
    let nodes = ["--node-capacity", "4096"];
    let of_a = build(&[first], &a, &nodes);
    let before = std::fs::read(&a).unwrap();
    let of_b = append(&a, second, &b, &nodes).json();
    assert_eq!(before, std::fs::read(&a).unwrap());
    assert_eq!((&of_b["points_in"], &of_b["points_out"]), (&40_000.into(), &40_000.into()));
    let sum = hash(&of_a).wrapping_add(hash(&of_b));

    let verified = verify(&b, &[second]).json();
    assert_eq!((verified["points"].as_u64(), verified["trees"].as_u64()), (Some(100_000), Some(2)));
    assert_eq!(hash(&verified), sum);
    let info = json(&["info", b_word]);
    assert_eq!(info["trees"].as_array().unwrap().len(), 2);
    assert_eq!(info["sources"].as_array().unwrap().len(), 2);
    assert_eq!((info["points"].as_u64(), hash(&info)), (Some(100_000), sum));

    let merged = json(&["build", "--merge", b_word, "-o", c_word, "--node-capacity", "4096"]);
    assert_eq!((merged["points_out"].as_u64(), hash(&merged)), (Some(100_000), sum));
    verify(&c, &[first, second]).json();
    let picture = folder.file("p.png");
    let covered = [b_word, c_word].map(|file| {
        let report = json(&["render", file, "-o", picture.to_str().unwrap(), "--size", "320x240"]);
        report["pixels_covered"].as_u64().unwrap() as f64
    });
    assert!((covered[0] / covered[1] - 1.0).abs() < 0.01, "{covered:?}");
    let path = folder.write("path.json", PATH).display().to_string();
    let run = json(&["bench", "stream", b_word, "--path", &path, "--size", "160x120"]);
    assert_eq!(
        (run["trees"].as_u64(), run["budget_exceeded"].as_bool()),
        (Some(2), Some(false)),
        "{run}"
    );
}

fn misfits() {
    let folder = Folder::new();
    let old = folder.write("old.xyz", "0.01 0.02 0.03\n1.11 1.12 1.13\n");
    let new = folder.write("new.xyz", "0.501 0.5 0.5\n1e9 0 0\n0.25 0.25 0.25\n");
    let [a, b] = ["a.esker", "b.esker"].map(|name| folder.file(name));
    build(&[&old], &a, &[]);
    let report = append(&a, &new, &b, &[]).json();
    assert_eq!((report["points_in"].as_u64(), report["points_out"].as_u64()), (Some(3), Some(2)));
    let reasons = report["refused_reasons"].as_object().unwrap();
    assert!(reasons.iter().all(|(why, n)| why.contains("lattice") && *n == 1), "{reasons:?}");
    assert!((report["rounding_error_max"].as_f64().unwrap() - 0.001).abs() < 1e-6, "{report}");
    verify(&b, &[&new]).json();
    std::fs::rename(&a, folder.file("moved.esker")).unwrap();
    let outcome = verify::<&str>(&b, &[]);
    assert!(outcome.error().contains("a.esker"), "{}", outcome.stderr);
    let render = ["render", b.to_str().unwrap(), "-o", "p.png"];
    assert!(esker(render).error().contains("a.esker"));
}
