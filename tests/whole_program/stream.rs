//! `esker bench stream` as scripts use it: the fields of its report, budgets that are kept or
//! refused, several files, scans in place of files, and the resident set as the system counts it.

use crate::folder::Folder;
use crate::program::{ESKER, Outcome, build, esker, finish, sample, start};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// A short camera path: an overview, and a corner of the scan.
const PATH: &str = r#"{"coordinates": "bounds", "views": [
    {"name": "overview", "eye": [-0.2, -0.3, 3], "target": [0.5, 0.5, 0.5], "stay_s": 0.1},
    {"name": "close", "eye": [0.4, 0.2, 1.2], "target": [0.6, 0.6, 0.3], "travel_s": 0.3, "stay_s": 0.1}
]}"#;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("stream: the report has its fields and the budgets are kept", reports));
    trials.push(trial("stream: several inputs are the runs of one object", several));
    trials.push(trial(
        "stream: budgets that are too small are refused with the least budget",
        too_small,
    ));
    trials.push(trial("stream: the resident set stays within the budgets", resident_set));
    trials.push(trial("stream: people get a table, and a list of the benchmarks", for_people));
}

/// Builds the sample scan with small nodes; its path.
fn built(folder: &Folder) -> String {
    let out = folder.file("sample.esker");
    build(&[sample()], &out, &["--node-capacity", "4096"]);
    out.display().to_string()
}

fn bench(folder: &Folder, words: &[&str]) -> Outcome {
    let path = folder.write("path.json", PATH).display().to_string();
    let common = ["bench", "stream", "--path", &path, "--progress", "none", "--size", "160x120"];
    esker(common.iter().chain(words))
}

fn holds_fields(run: &Value) {
    for field in [
        "peak_rss_bytes",
        "budget_ram_bytes",
        "peak_gpu_bytes",
        "budget_gpu_bytes",
        "render_stalls",
        "frame_ms_p50",
        "frame_ms_p99",
        "frame_ms_max",
        "read_bytes_per_s",
        "sequential_bytes_per_s",
        "structure_bytes",
        "useful_bytes",
        "read_bytes",
    ] {
        assert!(run[field].is_number(), "`{field}` is no number: {run}");
    }
    assert_eq!(run["budget_exceeded"], false, "{run}");
    // The system may delay a thread now and then; waiting for the disk would delay every frame.
    let [stalls, frames] = ["render_stalls", "frames"].map(|f| run[f].as_u64().unwrap());
    assert!(stalls * 10 <= frames, "{run}");
    assert_eq!(run["fault"], Value::Null, "{run}");
    assert!(run["useful_bytes"].as_u64() <= run["read_bytes"].as_u64(), "{run}");
    let views = run["views"].as_array().unwrap();
    assert_eq!(views.len(), 2, "{run}");
    for view in views {
        assert!(view["name"].is_string(), "{view}");
        let flights = [view, &view["without_depth_test"]];
        for figures in &flights[..if run["depth_test"] == true { 2 } else { 1 }] {
            for field in ["nodes", "points", "lod_ms", "render_ms", "complete_ms"] {
                assert!(figures[field].is_number(), "`{field}` is no number: {view}");
            }
            assert_eq!(figures["complete"], true, "{view}");
            assert!(figures["points"].as_u64() > Some(1000), "{view}");
        }
    }
}

fn reports() {
    let folder = Folder::new();
    let file = built(&folder);
    let budgets = ["--budget-gpu", "16MiB", "--budget-ram", "48MiB", "--backend", "cpu"];
    let words = |more: &[&'static str]| [&[file.as_str(), "--json"], &budgets[..], more].concat();
    let outcome = bench(&folder, &words(&[]));
    assert_eq!(outcome.stdout.lines().count(), 1, "{}", outcome.stdout);
    let run = outcome.json();
    holds_fields(&run);
    assert_eq!(run["budget_gpu_bytes"], 16 << 20);
    assert!(run["peak_gpu_bytes"].as_u64().unwrap() <= 16 << 20, "{run}");
    assert_eq!(run["loading"]["from_cold"], false);
    let pictures = folder.file("").display().to_string();
    let cold = bench(
        &folder,
        &[file.as_str(), "--json", "--no-occlusion", "--cold", "--pictures", &pictures],
    );
    let cold = cold.json();
    holds_fields(&cold);
    assert!(cold["loading"]["ratio"].as_f64().unwrap() > 0.0, "{cold}");
    assert_eq!(cold["views"][0]["without_depth_test"], Value::Null);
    assert_eq!(folder.names(), ["close.png", "overview.png", "path.json", "sample.esker"]);
}

fn several() {
    let folder = Folder::new();
    let file = built(&folder);
    let generated = "synthetic:office:60000:1";
    let report = bench(&folder, &[file.as_str(), generated, "--json"]).json();
    let runs = report["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2);
    runs.iter().for_each(holds_fields);
    assert_eq!([&runs[0]["file"], &runs[1]["file"]], [&file.as_str(), &generated]);
    let sweep = ["--capacities", "2048,8192", "--paper", "--json"];
    let report = bench(&folder, &[&[generated], &sweep[..]].concat()).json();
    let runs = report["runs"].as_array().unwrap();
    runs.iter().for_each(holds_fields);
    let rows: Vec<_> = runs
        .iter()
        .map(|r| (r["node_capacity"].as_u64().unwrap(), r["settings"].as_str().unwrap()))
        .collect();
    assert_eq!(rows, [(2048, "own"), (2048, "paper"), (8192, "own"), (8192, "paper")]);
}

fn too_small() {
    let folder = Folder::new();
    let file = built(&folder);
    let outcome = bench(&folder, &[file.as_str(), "--budget-ram", "1MiB"]);
    assert!(outcome.error().contains("is the least"), "{}", outcome.stderr);
    let outcome = bench(&folder, &[file.as_str(), "--budget-gpu", "1KiB"]);
    assert!(outcome.error().contains("--budget-gpu"), "{}", outcome.stderr);
}

#[cfg(not(target_os = "linux"))]
fn resident_set() {}

/// Measures the resident set from outside the program.
#[cfg(target_os = "linux")]
fn resident_set() {
    let folder = Folder::new();
    let file = built(&folder);
    let path = folder.write("path.json", PATH);
    let [gpu, ram] = [4u64 << 20, 34 << 20];
    let mut command = Command::new(ESKER);
    // The memory of a graphics driver is in no budget, and looking for a GPU loads the driver.
    command.args(["bench", "stream", "--backend", "cpu", "--json", "--size", "256x256", "--path"]);
    command.arg(&path);
    command.arg(format!("--budget-gpu={gpu}")).arg(format!("--budget-ram={ram}")).arg(&file);
    let (mut child, outputs) = start(command);
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        peak = peak.max(peak_rss(Path::new(&status)).unwrap_or(0));
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let report = finish(child, outputs, "esker bench stream".into(), 60).json();
    let empty = report["empty_rss_bytes"].as_u64().unwrap();
    assert!(empty < 24 << 20, "the empty program takes {empty} bytes");
    assert!(peak > empty, "{peak} bytes were resident at most, {empty} at the start");
    let most = (gpu + ram + empty) as f64 * 1.05;
    assert!(peak as f64 <= most, "{peak} bytes were resident, {most} are granted: {report}");
    assert!(report["nodes_evicted"].as_u64().unwrap() > 0, "the budget is tight: {report}");
    holds_fields(&report);
}

/// `VmHWM` of a process's status.
#[cfg(target_os = "linux")]
fn peak_rss(status: &Path) -> Option<u64> {
    let text = std::fs::read_to_string(status).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().trim_end_matches(" kB").parse::<u64>().ok().map(|kib| kib * 1024)
}

fn for_people() {
    let folder = Folder::new();
    let file = built(&folder);
    let outcome = bench(&folder, &[file.as_str()]);
    let text = &outcome.worked().stdout;
    for word in ["overview", "close", "with z-test", "w/o z-test", "nodes", "sample.esker"] {
        assert!(text.contains(word), "no `{word}` in {text}");
    }
    let list = esker(["bench"]);
    assert!(list.worked().stdout.contains("esker bench stream"), "{}", list.stdout);
}
