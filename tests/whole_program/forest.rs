//! Every command sees appended scans and the older ones as one cloud; merging makes one tree of
//! them.

use crate::export::{export, las};
use crate::folder::Folder;
use crate::program::{build, esker, verify};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::path::Path;

/// A short camera path over the cloud.
const PATH: &str = r#"{"coordinates": "bounds", "views": [
    {"name": "overview", "eye": [-0.2, -0.3, 3], "target": [0.5, 0.5, 0.5], "stay_s": 0.1},
    {"name": "close", "eye": [0.4, 0.2, 1.2], "target": [0.6, 0.6, 0.3], "travel_s": 0.3, "stay_s": 0.1}
]}"#;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("forest: appended scans are one cloud to every command", one_cloud));
    trials.push(trial("forest: all trees are exported together", exported));
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

fn exported() {
    let folder = Folder::new();
    // Text with attributes that LAS records have not, so that each tree lacks attributes of the
    // other.
    let at = |i: u32| format!("{}.25 {}.5 {}", 691_000 + i % 40, 5_334_995 + i % 11, 521 + i % 7);
    let line = |i: u32| format!("{} {} {}\n", at(i), i, 255 - i % 200);
    let text: String =
        std::iter::once("x y z quality intensity\n".into()).chain((0..900).map(line)).collect();
    let first = Path::new("synthetic:office:30k:1");
    let (second, third) = (Path::new("synthetic:office:20k:2"), folder.write("c.txt", &text));
    let [a, b, c] = ["a.esker", "b.esker", "c.esker"].map(|name| folder.file(name));
    let reports = [
        build(&[first], &a, &["--node-capacity", "1024"]),
        append(&a, second, &b, &["--node-capacity", "1024"]).json(),
        append(&b, &third, &c, &[]).json(),
    ];
    // Appended trees have the node capacity of the old file by default.
    assert_eq!(json(&["info", c.to_str().unwrap()])["node_capacity"], 1024);
    let sum = reports.iter().fold(0u128, |sum, report| sum.wrapping_add(hash(report)));
    // Two scans of the same point format are exported as they were, in one file.
    let las = folder.file("b.las");
    let report = export(&b, &las, &[]).json();
    assert_eq!((report["trees"].as_u64(), report["points_out"].as_u64()), (Some(2), Some(50_000)));
    assert_eq!(report["hash_equal"], true, "{report}");
    assert_eq!(report["notes"].as_array().map(Vec::len), Some(0), "{report}");
    let of_both = hash(&reports[0]).wrapping_add(hash(&reports[1]));
    assert_eq!(hash(&build(&[&las], &folder.file("again.esker"), &[])), of_both);
    las::File::read(&las).hold_counts_and_bounds();
    for name in ["c.laz", "c.ply", "c.csv"] {
        let report = export(&c, &folder.file(name), &[]).json();
        assert_eq!(
            (report["trees"].as_u64(), report["points_out"].as_u64()),
            (Some(3), Some(50_900))
        );
        assert_eq!((hash(&report), &report["hash_equal"]), (sum, &true.into()), "{report}");
        let notes = report["notes"].to_string();
        assert!(notes.contains("zero where a point's source had none"), "{notes}");
    }
    let lines = std::fs::read_to_string(folder.file("c.csv")).unwrap();
    assert_eq!(lines.lines().count(), 50_901);
    // A box selects points of every tree.
    let part =
        export(&c, &folder.file("part.csv"), &["--box", "691000,5334990,691020,5335000"]).json();
    let inside = |line: &&str| {
        let mut numbers = line.split(',').map(|n| n.parse::<f64>().unwrap());
        let mut within = |low: f64, high: f64| (low..=high).contains(&numbers.next().unwrap());
        within(691_000.0, 691_020.0) && within(5_334_990.0, 5_335_000.0)
    };
    let expected = lines.lines().skip(1).filter(inside).count();
    assert_eq!(part["points_out"].as_u64(), Some(expected as u64));
    assert!(expected > 1000, "{expected}");
    // A damaged older file is an error that leaves no file behind.
    let mut bytes = std::fs::read(&a).unwrap();
    bytes[5000] ^= 1;
    std::fs::write(&a, bytes).unwrap();
    let outcome = export(&c, &folder.file("d.las"), &[]);
    assert!(outcome.error().contains("a.esker"), "{}", outcome.stderr);
    assert!(!folder.names().iter().any(|name| name.contains("d.las")));
}

fn misfits() {
    let folder = Folder::new();
    let old = folder.write("old.xyz", "0.01 0.02 0.03\n1.11 1.12 1.13\n");
    let new = folder.write("new.xyz", "0.501 0.5 0.5\n1e9 0 0\n0.25 0.25 0.25\n");
    let [a, b] = ["a.esker", "b.esker"].map(|name| folder.file(name));
    build(&[&old], &a, &[]);
    let report = append(&a, &new, &b, &["--drop-outside"]).json();
    assert_eq!((report["points_in"].as_u64(), report["points_out"].as_u64()), (Some(3), Some(2)));
    let reasons = report["refused_reasons"].as_object().unwrap();
    assert!(reasons.iter().all(|(why, n)| why.contains("lattice") && *n == 1), "{reasons:?}");
    assert!((report["rounding_error_max"].as_f64().unwrap() - 0.001).abs() < 1e-6, "{report}");
    // The scans of the last tree are accepted, or those of all trees in any order.
    let of_last = verify(&b, &[&new]).json();
    let of_all = verify(&b, &[&new, &old]).json();
    for (report, trees, points) in [(of_last, 1, 2), (of_all, 2, 4)] {
        assert_eq!(report["against_trees"], trees, "{report}");
        assert_eq!(report["against_points"], points, "{report}");
        assert_eq!(report["against_refused"], 1, "{report}");
    }
    for wrong in [&[&old][..], &[&old, &old], &[&new, &new], &[&new, &old, &old]] {
        let outcome = verify(&b, wrong);
        assert!(outcome.error().contains("b.esker"), "{}", outcome.stderr);
    }
    let shown = |scans: &[&Path]| {
        let words = ["verify".as_ref(), b.as_os_str(), "--against".as_ref()];
        let outcome = esker(words.into_iter().chain(scans.iter().map(|scan| scan.as_os_str())));
        outcome.worked().stdout.clone()
    };
    assert!(shown(&[&new]).contains("those of the last tree"), "{}", shown(&[&new]));
    assert!(shown(&[&old, &new]).contains("in 2 trees, the points of the scans"));
    std::fs::rename(&a, folder.file("moved.esker")).unwrap();
    let outcome = verify::<&str>(&b, &[]);
    assert!(outcome.error().contains("a.esker"), "{}", outcome.stderr);
    let render = ["render", b.to_str().unwrap(), "-o", "p.png"];
    assert!(esker(render).error().contains("a.esker"));
}
