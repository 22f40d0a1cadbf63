//! Devices that draw: the report on the machine, each path forced by its flag, and a clear error
//! without a GPU. On a machine without an adapter only what needs none is tested.

use crate::folder::Folder;
use crate::program::{ESKER, Outcome, build, esker, run, sample};
use crate::trial;
use libtest_mimic::Trial;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

pub fn trials(trials: &mut Vec<Trial>) {
    trials.push(trial("devices: the system is described", system));
    trials.push(trial("devices: without a driver everything but a GPU works", no_driver));
    trials.push(trial("devices: every path gives the CPU's picture", every_path));
    trials.push(trial("devices: a benchmark names the device and its passes", benchmark));
}

/// Interfaces that have an adapter, and whether it has 64-bit atomics.
fn adapters() -> Vec<(String, bool)> {
    let system = esker(["info", "--system", "--json"]).json();
    let adapters = system["adapters"].as_array().unwrap().iter();
    let found = adapters
        .map(|a| (a["interface"].as_str().unwrap().to_owned(), a["atomics_64"] == true))
        .collect::<Vec<_>>();
    if found.is_empty() {
        eprintln!("no adapter");
    }
    found
}

fn system() {
    let text = esker(["info", "--system"]);
    text.worked();
    assert!(text.stdout.contains("draws with"), "{}", text.stdout);
    let system = esker(["info", "--system", "--json"]).json();
    let chosen = &system["chosen"];
    for adapter in system["adapters"].as_array().unwrap() {
        for field in ["software", "atomics_64", "timestamps", "mappable_buffers"] {
            assert!(adapter[field].is_boolean(), "{adapter}");
        }
        assert!(adapter["buffer_bytes_max"].as_u64() >= Some(128 << 20), "{adapter}");
    }
    let adapters = system["adapters"].as_array().unwrap();
    let has_gpu = adapters.iter().any(|a| a["software"] == false);
    assert!(has_gpu || chosen["backend"] == "cpu", "a software driver is no GPU: {system}");
    assert!(!chosen["why"].as_str().unwrap().is_empty(), "{system}");
    assert!(esker(["info"]).error().contains("required"));
    assert!(esker(["info", "--system", "file"]).error().contains("--system"));
}

/// Runs the program where the Vulkan loader finds no driver and there is no display.
fn without_driver(words: &[&str]) -> Outcome {
    let mut command = Command::new(ESKER);
    command.args(words).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        command.env(name, "/nonexistent/driver.json");
    }
    run(command, 400)
}

fn no_driver() {
    let folder = Folder::new();
    let (file, out) = (folder.file("a.esker"), folder.file("a.png"));
    build(&[sample()], &file, &[]);
    let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
    without_driver(&["info", "--system"]).worked();
    let draw = ["render", file, "-o", out, "--size", "200x100", "--json", "--progress", "none"];
    let outcome = without_driver(&draw);
    let report = outcome.json();
    assert_eq!(outcome.stderr, "");
    if cfg!(target_os = "linux") {
        assert_eq!(report["drawn_by"]["backend"], "cpu", "{report}");
        let note = report["drawn_by"]["note"].as_str().unwrap();
        assert!(note.contains("no driver"), "{note}");
        let insists = [&draw[..], &["--backend", "gpu"]].concat();
        let outcome = without_driver(&insists);
        assert!(outcome.error().contains("--backend cpu"), "{}", outcome.stderr);
    }
}

/// Pixels and report of a picture drawn with the options `with`.
fn picture(folder: &Folder, file: &Path, with: &[&str]) -> (Vec<u8>, Value) {
    let out = folder.file("p.png");
    let words = ["render", file.to_str().unwrap(), "-o", out.to_str().unwrap(), "--json"];
    let small = ["--progress", "none", "--size", "240x180", "--method", "points"];
    let report = esker(words.iter().chain(&small).chain(with)).json();
    let png = std::io::BufReader::new(std::fs::File::open(&out).unwrap());
    let mut reader = png::Decoder::new(png).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    (pixels, report)
}

fn every_path() {
    let folder = Folder::new();
    let file = folder.file("a.esker");
    build(&[sample()], &file, &["--node-capacity", "4096"]);
    let (expected, report) = picture(&folder, &file, &["--backend", "cpu"]);
    assert_eq!(report["drawn_by"]["path"], "cpu", "{report}");
    for (api, has_atomics) in adapters() {
        for path in ["atomics", "primitives"] {
            let with =
                ["--backend", "gpu", "--gpu-software", "--gpu-api", &api, "--gpu-path", path];
            if path == "atomics" && !has_atomics {
                let out = folder.file("no.png");
                let words = ["render", file.to_str().unwrap(), "-o", out.to_str().unwrap()];
                let outcome = esker(words.iter().chain(&with));
                assert!(outcome.error().contains("point primitives"), "{}", outcome.stderr);
                continue;
            }
            let (pixels, report) = picture(&folder, &file, &with);
            let by = &report["drawn_by"];
            assert_eq!([&by["backend"], &by["path"]], ["gpu", path], "{report}");
            assert!(by["adapter"].as_str().unwrap().to_lowercase().contains(&api), "{report}");
            let pairs = || pixels.chunks_exact(4).zip(expected.chunks_exact(4));
            let differs =
                |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 8);
            let off = pairs().filter(differs).count();
            assert!(off * 1000 <= pairs().count(), "{api}, {path}: {off} pixels are off");
        }
    }
}

fn benchmark() {
    let folder = Folder::new();
    let file = folder.file("a.esker");
    build(&[sample()], &file, &["--node-capacity", "4096"]);
    let path = r#"{"coordinates": "bounds", "views": [
        {"name": "only", "eye": [-0.2, -0.3, 3], "target": [0.5, 0.5, 0.5], "stay_s": 0.1}]}"#;
    let path = folder.write("path.json", path);
    let words = ["bench", "stream", file.to_str().unwrap(), "--path", path.to_str().unwrap()];
    let small = ["--progress", "none", "--size", "160x120", "--json", "--no-occlusion"];
    let budget = ["--budget-gpu", "32MiB"];
    let all = || words.iter().chain(&small).chain(&budget);
    let run = esker(all().chain(&["--backend", "cpu"])).json();
    assert_eq!([&run["backend"], &run["gpu_path"]], ["cpu", "cpu"], "{run}");
    let Some((api, _)) = adapters().into_iter().next() else { return };
    let run = esker(all().chain(&["--backend", "gpu", "--gpu-software", "--gpu-api", &api])).json();
    assert_eq!(run["backend"], "gpu", "{run}");
    assert!(run["adapter"].as_str().unwrap().to_lowercase().contains(&api), "{run}");
    assert!(run["peak_gpu_bytes"].as_u64().unwrap() <= 32 << 20, "{run}");
    assert!(run["fixed_gpu_bytes"].as_u64() < run["peak_gpu_bytes"].as_u64(), "{run}");
    assert_eq!(run["budget_exceeded"], false, "{run}");
    for pass in ["project", "gather", "all"] {
        assert!(run["views"][0]["passes_ms"][pass].is_number(), "{run}");
    }
}
