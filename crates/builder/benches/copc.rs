//! Measures when a COPC file is worth building: points a second, by wall and CPU time, of pages
//! that are made of its chunks when they are read, of reading all its points without pages, and of
//! a build; in turn. Prints one JSON object.
//!
//! `cargo bench -p esker-builder --bench copc -- FILE.copc.laz [ROUNDS]`

#![allow(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

use esker_builder::{NormalsMode, Options, build, copc};
use esker_format::Forest;
use esker_points::task::Silent;
use esker_points::{Batch, Lattice};
use esker_scan::OpenOptions;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// CPU seconds of this process, as Linux counts them; zero elsewhere.
fn cpu_seconds() -> f64 {
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS
}

/// Wall and CPU seconds of a call.
fn timed<T>(call: impl FnOnce() -> T) -> (T, [f64; 2]) {
    let (began, before) = (Instant::now(), cpu_seconds());
    let result = call();
    (result, [began.elapsed().as_secs_f64(), cpu_seconds() - before])
}

/// Makes the pages of all nodes; returns the number of points.
fn make_pages(path: &Path) -> u64 {
    let file = copc::open(path, &OpenOptions::default(), copc::CACHE_BYTES).unwrap();
    let forest = Forest::from(file).grown(true).unwrap();
    forest.table().nodes.iter().map(|node| node.points() as u64).sum()
}

/// Opens the file and makes the pages of the root and of its children.
fn make_first(path: &Path) -> u64 {
    let file = copc::open(path, &OpenOptions::default(), copc::CACHE_BYTES).unwrap();
    let root = &file.table().nodes[0];
    let top: Vec<u32> = std::iter::once(0).chain(root.children()).collect();
    file.complete(&top).unwrap();
    top.iter().map(|&node| file.table().nodes[node as usize].points() as u64).sum()
}

/// Decodes all points and drops them.
fn decode(path: &Path) -> u64 {
    let source = esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap();
    let grid = &source.info().grid;
    let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let mut sink = |_: Batch| Ok(());
    source.read(&lattice.placement(grid), &Silent, &mut sink).unwrap().points
}

fn build_all(path: &Path) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let options = Options { normals: NormalsMode::None, ..Options::default() };
    build(&[path.to_owned()], &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap().points()
}

type Call = fn(&Path) -> u64;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|w| !w.starts_with("--")).collect();
    let [file, rest @ ..] = &words[..] else { panic!("name a COPC file") };
    let (path, rounds) = (PathBuf::from(file), rest.first().map_or(3, |n| n.parse().unwrap()));
    let calls: [(&str, Call); 4] = [
        ("pages_of_the_top", make_first),
        ("pages_of_all", make_pages),
        ("decoding", decode),
        ("build", build_all),
    ];
    let mut rows: Vec<Vec<String>> = vec![Vec::new(); calls.len()];
    for _ in 0..rounds {
        for ((_, call), rows) in calls.iter().zip(&mut rows) {
            let (points, [wall, cpu]) = timed(|| call(&path));
            rows.push(format!(r#"{{"points":{points},"wall_s":{wall:.4},"cpu_s":{cpu:.4}}}"#));
        }
    }
    let of = calls.iter().zip(&rows);
    let of = of.map(|((name, _), rows)| format!(r#""{name}":[{}]"#, rows.join(",")));
    println!("{{{}}}", of.collect::<Vec<_>>().join(","));
}
