//! A build keeps to its memory bound, on clouds many times as large. This file has one test, since
//! memory of other tests in the same process would be counted.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;

use cloud::{below, built, cloud, cloud_on};
use esker_builder::{Options, against_sources};
use esker_points::task::Silent;
use esker_scan::Source;

const MEMORY_BYTES: u64 = 256 << 20;

/// Builds with little memory, verifies and compares. Returns the number of nodes.
fn bounded(make: impl Fn() -> Box<dyn Source>, count: u64) -> u64 {
    let options = Options { memory_bytes: MEMORY_BYTES, ..Default::default() };
    let (report, file, _folder) = built(vec![make()], &options);
    assert_eq!(report.points_out, count);
    assert!(report.scratch_bytes > 0, "the rows fit into memory: nothing is tested");
    let peak = report.peak_anon_bytes;
    assert!(peak <= MEMORY_BYTES / 100 * 105, "{peak} of {MEMORY_BYTES} bytes used");
    let verified = esker_format::verify(&file, &Silent).unwrap();
    assert_eq!((verified.points, verified.hash), (count, report.hash));
    assert_eq!(against_sources(&file, vec![make()], &Silent).unwrap().points, count);
    report.nodes
}

#[test]
fn coincident_and_scattered_points_and_steps_of_other_lengths_keep_to_the_bound() {
    let n = 10_000_000;
    let nodes = bounded(|| cloud("stack", 0.001, n, |_| [123_456, -5, 99]), n);
    assert_eq!(nodes, n.div_ceil(1 << 16));
    let scattered =
        |i| [below(2 * i, u32::MAX >> 1), below(2 * i + 1, u32::MAX >> 1), below(i, 90)];
    // More threads than the memory has room for: fewer are used.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(16).build().unwrap();
    pool.install(|| bounded(|| cloud("scattered", 0.001, 4_500_000, scattered), 4_500_000));
    // Cells of the octree are slabs, each of which is near many others.
    let slabs = |i| [below(3 * i, 80_000), below(3 * i + 1, 80_000), below(3 * i + 2, 10_000_000)];
    bounded(|| cloud_on("slabs", [1e-2, 1e-2, 1e-7], 4_000_000, slabs), 4_000_000);
}
