//! `esker bench build` as scripts use it: a row for each program and input, a rival beside Esker,
//! failures as rows and as the exit code, and no file left behind.

use crate::folder::Folder;
use crate::program::{Outcome, esker, sample};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("bench build: rows for decoding and for Esker", alone));
    trials.push(trial("bench build: a failure is a row and an exit code", failures));
    #[cfg(unix)]
    trials.push(trial("bench build: a rival is measured beside Esker", unix::beside_a_rival));
}

fn bench(folder: &Folder, words: &[&str]) -> Outcome {
    let place = folder.file("").display().to_string();
    esker(["bench", "build", "--progress", "none", "--scratch", &place].iter().chain(words))
}

fn rows(report: &Value) -> &[Value] {
    report["rows"].as_array().unwrap()
}

fn holds_fields(row: &Value, fields: &[&str]) {
    for field in fields {
        assert!(row[field].is_number(), "`{field}` is no number: {row}");
    }
}

fn alone() {
    let folder = Folder::new();
    let scan = sample().display().to_string();
    let words = ["--json", "--runs", "2", "--memory", "256MiB", &scan, "synthetic:terrain:20k:1"];
    let outcome = bench(&folder, &[&words[..], &["--", "--node-capacity", "4096"]].concat());
    assert_eq!(outcome.stdout.lines().count(), 1, "{}", outcome.stdout);
    let report = outcome.json();
    let names: Vec<_> = rows(&report).iter().map(|r| r["program"].as_str().unwrap()).collect();
    assert_eq!(names, ["decode", "esker", "decode", "esker"]);
    for row in rows(&report) {
        holds_fields(row, &["points", "seconds", "points_per_second", "scratch_bytes_peak"]);
        assert!(row["ratio"].is_null() && row["error"].is_null(), "{row}");
        #[cfg(unix)]
        {
            holds_fields(row, &["cpu_seconds", "peak_rss_bytes"]);
            assert!(row["cpu_seconds"].as_f64().unwrap() > 0.0, "{row}");
        }
    }
    let ours = &rows(&report)[1];
    assert_eq!(ours["input"], scan.as_str());
    assert_eq!(ours["points"], rows(&report)[0]["points"]);
    assert!(ours["bytes_out"].as_u64() > ours["points"].as_u64().map(|n| n * 8), "{ours}");
    assert_eq!(rows(&report)[3]["points"], 20_000);
    assert_eq!(folder.names(), [""; 0], "nothing is left");
    // The text for people.
    let text = bench(&folder, &["--runs", "1", &scan]).worked().stdout.clone();
    assert!(text.contains("decode") && text.contains("Mpts/s"), "{text}");
}

fn failures() {
    let folder = Folder::new();
    let scan = sample().display().to_string();
    let words = ["--json", "--runs", "1", "nothere.las", &scan, "--against", "nothere {in} {out}"];
    let outcome = bench(&folder, &words);
    let error = outcome.error();
    assert!(error.contains("4 of 6 programs failed: decode on nothere.las"), "{error}");
    let report: Value = serde_json::from_str(outcome.stdout.lines().last().unwrap()).unwrap();
    let failed: Vec<_> = rows(&report).iter().map(|r| r["error"].is_string()).collect();
    assert_eq!(failed, [true, true, true, false, false, true]);
    let said = |i: usize| rows(&report)[i]["error"].as_str().unwrap().to_owned();
    assert!(said(1).contains("nothere.las"), "{}", said(1));
    assert!(said(5).contains("nothere: cannot be run"), "{}", said(5));
    assert_eq!(folder.names(), [""; 0], "nothing is left");
}

#[cfg(unix)]
mod unix {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    /// A rival that takes time, uses scratch space and leaves a folder. It fails in a second run if
    /// the files of the first were not deleted.
    const RIVAL: &str = r#"#!/bin/sh
test "$2" = -o || exit 7
mkdir "$3" "$3/chunks" || exit 8
head -c 3000000 /dev/zero > "$TMPDIR/scratch"
head -c 2000000 /dev/zero > "$3/chunks/a"
head -c 1000 /dev/zero > "$3/octree.bin"
sleep 1
rm -r "$3/chunks"
test -s "$1" || { echo "no such scan" >&2; exit 9; }
"#;

    pub fn beside_a_rival() {
        let own = Folder::new();
        let rival = own.write("PotreeConverter", RIVAL);
        std::fs::set_permissions(&rival, std::fs::Permissions::from_mode(0o755)).unwrap();
        let rival = rival.display().to_string();
        let folder = Folder::new();
        let scan = sample().display().to_string();
        let report = bench(&folder, &["--json", "--runs", "2", "--against", &rival, &scan]).json();
        let [decode, ours, theirs] = rows(&report) else { panic!("{report}") };
        assert_eq!(theirs["program"], "PotreeConverter");
        assert_eq!((&theirs["ratio"], &theirs["points"]), (&1.0.into(), &ours["points"]));
        for row in [decode, ours] {
            holds_fields(row, &["ratio", "cpu_ratio"]);
            let [seconds, other] = [row, theirs].map(|r| r["seconds"].as_f64().unwrap());
            assert!(seconds > 0.0 && other > 1.0, "{report}");
        }
        assert_eq!(theirs["bytes_out"], 1000);
        assert_eq!(theirs["scratch_bytes_peak"], 5_000_000, "{theirs}");
        assert!(theirs["peak_rss_bytes"].as_u64().unwrap() < 200 << 20, "{theirs}");
        assert_eq!(folder.names(), [""; 0], "nothing is left");

        let outcome =
            bench(&folder, &["--runs", "2", "--against", &rival, "synthetic:terrain:9k:1"]);
        let error = outcome.error();
        assert!(error.contains("no such scan"), "{error}");
        let error = esker(["bench", "build", &scan, "--against", "rival"]);
        assert!(error.error().contains("{in} {out}"), "{}", error.stderr);
    }
}
