//! Profiles a build: builds a generated cloud (hilly ground with walls and trees, or another
//! shape), and prints the seconds of each phase and the fill of the nodes.
//!
//! `cargo run --release -p esker-builder --example profile -- [points] [plane|volume|ground|stack]
//! [capacity] [memory MiB] [file to keep]`
#![allow(clippy::unwrap_used, reason = "a tool for developers")]

#[path = "../tests/cloud/mod.rs"]
mod cloud;

use cloud::{below, cloud, random};
use esker_builder::{Options, build_sources};
use esker_format::EskerFile;
use esker_points::Task;
use esker_points::task::Silent;
use std::sync::Mutex;
use std::time::Instant;

/// Prints how long each phase took.
struct Clock(Mutex<(String, Instant)>);

impl Clock {
    fn next(&self, name: &str) {
        let mut last = self.0.lock().unwrap();
        println!("{:>8.2} s  {}", last.1.elapsed().as_secs_f64(), last.0);
        *last = (name.into(), Instant::now());
    }
}

impl Task for Clock {
    fn phase(&self, name: &str, _total: Option<u64>, _unit: &'static str) {
        self.next(name);
    }
}

fn ground(i: u64) -> [i32; 3] {
    let (x, y) = (below(3 * i, 1_000_000), below(3 * i + 1, 1_000_000));
    let (u, v) = (f64::from(x) / 9e4, f64::from(y) / 1.1e5);
    let z = (30_000.0 * (u.sin() + v.cos() * u.cos())) as i32;
    match random(i) % 10 {
        0 => [x / 50_000 * 50_000, y, z + below(3 * i + 2, 12_000)],
        1 | 2 => [x / 40 + x / 20_000 * 20_000, y / 40 + y / 20_000 * 20_000, z + below(i, 9000)],
        _ => [x, y, z],
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments.get(i).and_then(|a| a.parse::<u64>().ok());
    let n = number(0).unwrap_or(5_000_000);
    let kind = arguments.get(1).map_or("ground", String::as_str);
    let position: fn(u64) -> [i32; 3] = match kind {
        "plane" => |i| {
            let (u, v) = (below(2 * i, 900_000), below(2 * i + 1, 700_000));
            [u, v, u / 3 + v / 5]
        },
        "volume" => |i| [0, 1, 2].map(|a| below(3 * i + a, 900_000)),
        "stack" => |_| [5; 3],
        _ => ground,
    };
    let options = Options {
        node_capacity: number(2).map_or(1 << 16, |c| c as u32),
        memory_bytes: number(3).map_or(Options::default().memory_bytes, |m| m << 20),
        ..Default::default()
    };
    let folder = tempfile::tempdir().unwrap();
    let out = arguments.get(4).map_or_else(|| folder.path().join("out.esker"), Into::into);
    let source = cloud("generated", 0.001, n, position);
    let clock = Clock(Mutex::new(("before".into(), Instant::now())));
    let report = build_sources(vec![source], &out, &options, &clock).unwrap();
    clock.next("verify");
    let file = EskerFile::open(&out).unwrap();
    esker_format::verify(&file, &Silent).unwrap();
    clock.next("");
    let fill = n as f64 / report.nodes as f64 / f64::from(options.node_capacity);
    let small = |p: usize| p * 16 < options.node_capacity as usize;
    let few = file.table().nodes.iter().filter(|t| small(t.points())).count();
    println!(
        "{n} points ({kind}), {} nodes, depth {}, mean fill {fill:.3}, {:.1} % under a sixteenth, {:.1} bytes a point, scratch {} MB, peak {} MiB anonymous",
        report.nodes,
        report.depth,
        100.0 * few as f64 / report.nodes.max(1) as f64,
        report.bytes_out as f64 / n as f64,
        report.scratch_bytes / 1_000_000,
        report.peak_anon_bytes >> 20,
    );
}
