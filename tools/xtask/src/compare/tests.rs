//! Tests of comparisons, with small reports.

use super::*;
use serde_json::json;

/// A report of error against time with one row: CPU time with quartiles, and FLIP.
fn frames(cpu_ms: f64, quartiles: [f64; 2], flip: f64) -> Value {
    json!({"rows": [{
        "file": "creek", "backend": "cpu", "settings": {"method": "ewa", "spacing_px": 1.0},
        "cpu_ms": cpu_ms, "cpu_ms_quartiles": quartiles,
        "ms": 5.0 * cpu_ms, "ms_quartiles": [1.0, 1000.0], "flip": flip
    }]})
}

/// What became of the figures of two reports: how many are worse, and the text.
fn judged(old: &Value, new: &Value, is_other_machine: bool) -> (usize, String) {
    let all = compared("a", old, new);
    assert!(!all.is_empty());
    let summary = summary(&all, is_other_machine);
    (summary.worse, summary.text)
}

#[test]
fn cpu_time_counts_beyond_its_fences_and_wall_time_does_not() {
    let old = frames(10.0, [9.9, 10.1], 0.05);
    // The fences of quartiles that are 0.2 apart reach to 10.4; five hundredths are the least.
    assert_eq!(judged(&old, &frames(10.4, [10.3, 10.5], 0.05), false).0, 0);
    let (worse, text) = judged(&old, &frames(12.0, [11.9, 12.1], 0.05), false);
    assert_eq!(worse, 1, "{text}");
    assert!(text.starts_with("worse   cpu_ms 10.00 -> 12.00 (x 1.200)"), "{text}");
    assert!(text.contains("a: creek, cpu, method ewa spacing_px 1.0"), "{text}");
    // Quartiles of the new row that are as wide as the difference hide it.
    assert_eq!(judged(&old, &frames(12.0, [10.0, 14.0], 0.05), false).0, 0);
    let (worse, text) = judged(&old, &frames(8.0, [7.9, 8.1], 0.05), false);
    assert!(worse == 0 && text.starts_with("better  cpu_ms"), "{text}");
}

#[test]
fn errors_have_no_noise() {
    let (old, new) = (frames(10.0, [9.0, 11.0], 0.05), frames(10.0, [9.0, 11.0], 0.051));
    let (worse, text) = judged(&old, &new, false);
    assert!(worse == 1 && text.starts_with("worse   flip"), "{text}");
    assert_eq!(judged(&old, &frames(10.0, [9.0, 11.0], 0.0501), false).0, 0);
    assert_eq!(judged(&new, &old, false).0, 0);
}

#[test]
fn another_machine_is_not_slower_code() {
    let row = |name: &str, cpu_ms: f64| {
        let mut report = frames(cpu_ms, [cpu_ms, cpu_ms], 0.05);
        report["rows"][0]["file"] = json!(name);
        report["rows"][0].clone()
    };
    let report = |times: [f64; 3]| {
        let rows: Vec<Value> = ["a", "b", "c"].iter().zip(times).map(|(n, t)| row(n, t)).collect();
        json!({"rows": rows})
    };
    let (old, new) = (report([10.0, 20.0, 30.0]), report([15.0, 30.0, 90.0]));
    assert_eq!(judged(&old, &new, false).0, 3);
    let (worse, text) = judged(&old, &new, true);
    assert_eq!(worse, 1, "{text}");
    assert!(text.contains("a: c, cpu") && text.contains("new over old: 1.500"), "{text}");
}

#[test]
fn spreads_of_wall_times_are_those_of_cpu_times() {
    let build = |cpu: f64, each: [f64; 3]| {
        json!({"rows": [{"program": "esker", "input": "a.las", "points": 20, "seconds": each[1],
                         "seconds_each": each, "cpu_seconds": cpu, "bytes_out": 100}]})
    };
    let old = build(6.0, [3.0, 3.1, 3.2]);
    assert_eq!(judged(&old, &build(6.6, [3.0, 3.3, 3.8]), false).0, 0);
    assert_eq!(judged(&old, &build(9.0, [4.0, 4.1, 4.2]), false).0, 1);
}

#[test]
fn rows_of_other_settings_are_not_compared() {
    let old = frames(10.0, [10.0, 10.0], 0.05);
    let mut new = frames(90.0, [90.0, 90.0], 0.9);
    new["rows"][0]["settings"]["spacing_px"] = json!(2.0);
    assert!(compared("a", &old, &new).is_empty());
    // Settings that a model chose for a time are no measure of the code.
    let mut paced = frames(10.0, [10.0, 10.0], 0.05);
    paced["rows"][0]["settings"]["budget_ms"] = json!(16.0);
    assert!(compared("a", &paced, &paced).is_empty());
}

#[test]
fn folders_are_matched_by_names_without_the_commit() {
    assert_eq!(without_commit("error-time-creek-804cb73"), "error-time-creek");
    assert_eq!(without_commit("build-terrain-1G"), "build-terrain-1G");
    assert_eq!(without_commit("leave-out-terrestrial"), "leave-out-terrestrial");
    let folder = crate::shell::Scratch::new("compare").expect("a folder");
    let [old, new] = ["2026-01-02-2core", "2026-01-03-2core"].map(|name| folder.file(name));
    let write = |place: &Path, commit: &str, report: &Value| {
        std::fs::create_dir_all(place).expect("a folder");
        let file = place.join(format!("frames-{commit}.json"));
        std::fs::write(file, report.to_string()).expect("a report");
    };
    write(&old, "0a1b2c3", &frames(10.0, [10.0, 10.0], 0.05));
    write(&new, "4d5e6f7", &frames(10.0, [10.0, 10.0], 0.05));
    let words = [&old, &new].map(|path| path.display().to_string());
    run(&words).expect("the same");
    write(&new, "4d5e6f7", &frames(20.0, [20.0, 20.0], 0.05));
    let error = run(&words).expect_err("twice as long").to_string();
    assert_eq!(error, "1 figures became worse");
    assert!(run(&words[..1]).is_err());
    assert_eq!(machine(&words[0]), Some("2core".to_owned()));
    assert_eq!(
        machine("bench/results/2026-11-29-2core-epyc/a.json").as_deref(),
        Some("2core-epyc")
    );
}
