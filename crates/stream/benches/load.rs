//! Measures how fast a view is loaded: useful bytes a second of a streamer, and of plain reads of
//! the same ranges with as many in progress. Both alternate in one run; the medians are printed.
//! With `--cold` both start from an empty page cache (Linux: `dd` drops the file from it).
//!
//! `cargo bench -p esker-stream --bench load -- FILE [--cold] [--rounds N]`

#![allow(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

mod ring;

use esker_format::{Forest, PlaneKind};
use esker_lod::View;
use esker_stream::{LodPassTimes, Needs, Options, Streamer};
use glam::DVec3;
use ring::{RUN_BYTES, Ring};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::time::{Duration, Instant};

const IN_FLIGHT: usize = 8;

/// Measurements of a loaded view.
struct Loaded {
    seconds: f64,
    useful_bytes: u64,
    read_bytes: u64,
    reads: u64,
    ranges: Vec<Range<u64>>,
    nodes: usize,
    lod_ms: LodPassTimes,
}

fn load(file: &Arc<Forest>, view: View, needs: Needs) -> Loaded {
    let runs = 2 * IN_FLIGHT;
    let ring = Arc::new(Ring::new(runs));
    let options = Options {
        drawing_bytes: 4 << 30,
        points_budget: u64::MAX,
        occlusion: false,
        loaders: IN_FLIGHT,
        ..Options::default()
    };
    let began = Instant::now();
    let streamer = Streamer::start(Arc::clone(file), Arc::clone(&ring), options, needs).unwrap();
    streamer.look(view);
    let mut places = Vec::new();
    loop {
        if let Ok((run, transfers)) = ring.landed.1.recv_timeout(Duration::from_millis(1)) {
            for t in &transfers {
                places.push((t.node, t.plane));
                t.request.into_iter().for_each(|r| streamer.uploaded(r));
            }
            let _ = ring.free.0.try_send(run);
        }
        let cut = streamer.cut();
        if cut.settled && cut.view == view {
            break;
        }
    }
    let seconds = began.elapsed().as_secs_f64();
    let status = streamer.status();
    places.sort_unstable();
    places.dedup();
    let ranges = places.iter().map(|&(node, kind)| range(file, node, kind)).collect();
    Loaded {
        seconds,
        useful_bytes: status.useful_bytes,
        read_bytes: status.read_bytes,
        reads: status.reads,
        ranges,
        nodes: streamer.cut().nodes.len(),
        lod_ms: status.lod_ms,
    }
}

fn range(file: &Forest, node: u32, kind: PlaneKind) -> Range<u64> {
    let record = &file.table().nodes[node as usize];
    let range = file.plane_range(node, kind).unwrap();
    record.page_offset + range.start..record.page_offset + range.end
}

/// Joins adjacent ranges, each at most a run long.
fn joined(mut ranges: Vec<Range<u64>>) -> Vec<Range<u64>> {
    ranges.sort_by_key(|r| r.start);
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last)
                if range.start - last.end < 64 && range.end - last.start <= RUN_BYTES as u64 =>
            {
                last.end = range.end;
            }
            _ => joined.push(range),
        }
    }
    joined
}

/// Seconds that plain reads of ranges take.
fn read(file: &Forest, ranges: &[Range<u64>]) -> f64 {
    let next = AtomicUsize::new(0);
    let began = Instant::now();
    std::thread::scope(|scope| {
        for i in 0..IN_FLIGHT {
            let read = || {
                let mut buffer = vec![0; RUN_BYTES];
                while let Some(range) = ranges.get(next.fetch_add(1, SeqCst)) {
                    let buffer = &mut buffer[..(range.end - range.start) as usize];
                    file.read_exact_at(buffer, range.start).unwrap();
                }
            };
            std::thread::Builder::new()
                .name(format!("read-{i}"))
                .spawn_scoped(scope, read)
                .unwrap();
        }
    });
    began.elapsed().as_secs_f64()
}

/// Drops a file from the page cache.
fn forget(path: &Path) {
    let of = format!("of={}", path.display());
    let arguments = [of.as_str(), "oflag=nocache", "conv=notrunc,fdatasync", "count=0"];
    let done = Command::new("dd").args(arguments).output().unwrap();
    assert!(done.status.success(), "dd cannot make the system forget {}", path.display());
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let Some(path) = arguments.first().filter(|a| !a.starts_with('-')).map(PathBuf::from) else {
        println!(
            "names no file: cargo bench -p esker-stream --bench load -- FILE [--cold] [--rounds N]"
        );
        return;
    };
    let is_cold = arguments.iter().any(|a| a == "--cold");
    let rounds = arguments.iter().position(|a| a == "--rounds").map(|i| &arguments[i + 1]);
    let rounds: usize = rounds.map_or(5, |n| n.parse().unwrap());
    let file = Arc::new(Forest::open(&path).unwrap());
    let bounds = file.bounds().unwrap();
    let [low, high] = bounds.map(|c| DVec3::from_array(file.lattice().world(c)));
    let view = View::fit(low, high, DVec3::new(0.3, 1.0, -0.7), 1.0, 3840, 2160);
    let needs = Needs { colour: Some(PlaneKind::Colour), normals: true, ..Needs::default() };
    let (mut streamed, mut plain, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    let mut last = load(&file, view, needs.clone());
    let ranges = joined(last.ranges.clone());
    for _ in 0..rounds {
        if is_cold {
            forget(&path);
        }
        let seconds = read(&file, &ranges);
        let bytes: u64 = ranges.iter().map(|r| r.end - r.start).sum();
        plain.push(bytes as f64 / seconds);
        if is_cold {
            forget(&path);
        }
        last = load(&file, view, needs.clone());
        streamed.push(last.useful_bytes as f64 / last.seconds);
        ratios.push(streamed[streamed.len() - 1] / plain[plain.len() - 1]);
    }
    let mib = |rate: Vec<f64>| median(rate) / f64::from(1 << 20);
    println!(
        "{}: {} MiB useful of {} read in {} reads ({} ranges); streamed {:.0} MiB/s, plain {:.0} MiB/s, \
         ratio {:.2} (medians of {rounds})",
        if is_cold { "cold" } else { "warm" },
        last.useful_bytes >> 20,
        last.read_bytes >> 20,
        last.reads,
        ranges.len(),
        mib(streamed),
        mib(plain),
        median(ratios)
    );
    let [half, most] = [0.5, 0.99].map(|share| last.lod_ms.quantile_ms(share));
    println!(
        "{} nodes in the cut; passes of the LOD thread, without occlusion: {half:.2} ms p50, \
         {most:.2} p99, {:.2} the last",
        last.nodes, last.lod_ms.last_ms
    );
}
