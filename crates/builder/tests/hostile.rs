//! Hostile clouds are built without loss: verified, counted, and with the hash of their inputs.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod given;

use cloud::{below, random};
use esker_builder::{NormalsMode, Options, Shares, build, build_shared, build_sources};
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Schema};
use given::{Given, given, whole};
use proptest::prelude::*;
use std::sync::Arc;

const MM: [f64; 3] = [0.001; 3];

fn small(node_capacity: u32) -> Options {
    Options { node_capacity, ..Default::default() }
}

/// A cloud in millimetres whose points differ by a number.
fn numbered(positions: Vec<[i32; 3]>) -> Given {
    given("cloud", MM, positions).with("gps_time", AttrType::F64, |i| (i as f64).to_bits())
}

#[test]
fn no_point_one_point_and_two_points() {
    let (report, file) = whole(&[numbered(vec![])], &small(64));
    assert_eq!((report.nodes, report.depth), (0, 0));
    assert!(file.table().root().is_none());
    let (report, _) = whole(&[numbered(vec![[7, -7, 0]])], &small(64));
    assert_eq!((report.nodes, report.depth), (1, 0));
    let (report, _) = whole(&[numbered(vec![[i32::MIN; 3], [i32::MAX; 3]])], &small(64));
    assert_eq!(report.nodes, 1);
}

#[test]
fn a_chain_of_coincident_points_may_be_very_long() {
    // Recursion node by node would overflow the stack.
    let (report, _) = whole(&[numbered(vec![[5; 3]; 3_000_000])], &small(64));
    assert_eq!(report.nodes, 46_875);
    assert_eq!(report.depth, 46_874);
}

#[test]
fn lines_planes_and_a_full_lattice() {
    let line: Vec<_> = (0..100_000).map(|i| [i * 3, i * -2, i]).collect();
    whole(&[numbered(line)], &small(1024));
    let along_x: Vec<_> = (0..100_000).map(|i| [i, 0, 0]).collect();
    whole(&[numbered(along_x)], &small(64));
    let plane: Vec<_> = (0..90_000).map(|i| [i % 300 * 10, i / 300 * 10, 4]).collect();
    whole(&[numbered(plane)], &small(1024));
    let cube: Vec<_> = (0..64 * 64 * 64).map(|i| [i % 64, i / 64 % 64, i / 4096]).collect();
    whole(&[numbered(cube.clone())], &small(64));
    whole(&[numbered(cube)], &small(4096));
}

#[test]
fn one_far_outlier() {
    let mut points: Vec<_> = (0..100_000u64)
        .map(|i| [below(3 * i, 1000), below(3 * i + 1, 1000), below(3 * i + 2, 1000)])
        .collect();
    points.push([i32::MAX, 3, i32::MIN]);
    let (report, _) = whole(&[numbered(points)], &small(1024));
    assert!(report.depth < 12, "chains of single children are skipped: {}", report.depth);
}

#[test]
fn scratch_holds_no_more_than_was_estimated_however_often_rows_are_parted() {
    use NormalsMode::{Estimate, None};
    let near = |i: u64| [0, 1, 2].map(|a| below(3 * i + a, 1000));
    let cloud = (0..250_000).map(near);
    let far = [i32::MAX, 3, i32::MIN];
    // Seen from the first outlier everything is one cell, and again from the second.
    let clouds: [Vec<_>; 3] = [
        cloud.clone().collect(),
        cloud.clone().chain([far]).collect(),
        cloud.chain([far, [1_000_000; 3]]).collect(),
    ];
    for (outliers, positions) in clouds.iter().enumerate() {
        let rows_bytes = 12 * positions.len() as u64;
        // Chunks that are a fraction of the cell; and chunks of which one bucket may have all rows
        // but several may not.
        let (small_chunks, large_chunks) = (500_000, 60_000_000);
        for (buffer_bytes_max, normals, chunk_bytes_max) in [
            (0, None, small_chunks),
            (1 << 20, None, small_chunks),
            (rows_bytes, None, small_chunks),
            (0, Estimate, small_chunks),
            (100_000_000, Estimate, large_chunks),
        ] {
            let source = given("cloud", MM, positions.clone()).boxed();
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("out.esker");
            let shares = Shares { buffer_bytes_max, chunk_bytes_max };
            let options = Options { normals, ..small(256) };
            let report = build_shared(vec![source], &out, &options, shares, &Silent).unwrap();
            let of = format!("{outliers} outliers, {buffer_bytes_max} bytes in memory");
            let (peak, estimate) =
                (report.scratch_bytes_peak, report.scratch_bytes_estimated.unwrap());
            assert!(peak <= estimate, "{of}: {peak}, {estimate} estimated");
            if buffer_bytes_max < rows_bytes && normals == None {
                assert!(estimate < rows_bytes * 4 / 3, "{of}: {estimate} for {rows_bytes}");
                let passes = (report.scratch_bytes + rows_bytes / 2) / rows_bytes;
                assert_eq!(
                    passes,
                    1 + outliers as u64,
                    "{of}: rows went to scratch {passes} times"
                );
            }
        }
    }
}

#[test]
fn clusters_in_opposite_corners() {
    let near = |i: u64| [0, 1, 2].map(|a| below(3 * i + a, 4000));
    let mut points: Vec<_> = (0..50_000).map(|i| near(i).map(|c| i32::MIN + c)).collect();
    points.extend((50_000..100_000).map(|i| near(i).map(|c| i32::MAX - c)));
    whole(&[numbered(points)], &small(512));
}

#[test]
fn the_extremes_of_the_lattice() {
    let ends = [i32::MIN, -1, 0, i32::MAX];
    let corner = |i: usize| [ends[i % 4], ends[i / 4 % 4], ends[i / 16 % 4]];
    whole(&[numbered((0..64).map(corner).collect())], &small(64));
    whole(&[numbered((0..6400).map(corner).collect())], &small(64));
    let anywhere = (0..50_000u64).map(|i| [0, 1, 2].map(|a| random(3 * i + a) as i32));
    whole(&[numbered(anywhere.collect())], &small(256));
}

#[test]
fn a_spiral_that_shrinks_as_deep_as_the_lattice() {
    let point = |i: i32| {
        let (r, t) = (2f64.powf(31.0 - f64::from(i) / 700.0), f64::from(i) / 50.0);
        [r * t.cos(), r * t.sin(), r * 0.99].map(|c| c as i32)
    };
    let (report, _) = whole(&[numbered((0..22_000).map(point).collect())], &small(64));
    assert!(report.depth >= 6, "{}", report.depth);
}

#[test]
fn millimetres_at_ten_thousand_kilometres() {
    let point = |i: u64| [below(3 * i, 80_000), below(3 * i + 1, 80_000), below(3 * i + 2, 3000)];
    let far = numbered((0..60_000).map(point).collect()).at([1e7, -1e7, 1e7]);
    let (_, file) = whole(std::slice::from_ref(&far), &small(1024));
    assert_eq!(file.metadata().lattice.offset, [1e7, -1e7, 1e7]);
    // Without an offset the raw numbers themselves are large.
    let plain = |i: u64| [2_000_000_000 + below(2 * i, 80_000), -2_000_000_000, below(2 * i, 99)];
    whole(&[numbered((0..60_000).map(plain).collect())], &small(1024));
}

#[test]
fn degrees_beside_metres() {
    let point = |i: u64| [below(3 * i, 50_000), below(3 * i + 1, 50_000), below(3 * i + 2, 20_000)];
    let cloud = given("degrees", [1e-7, 1e-7, 1e-3], (0..60_000).map(point).collect());
    let cloud = cloud.at([13.4, 52.5, 0.0]).with("intensity", AttrType::U16, |i| i);
    whole(&[cloud], &small(1024));
}

#[test]
fn extreme_scales_are_built_or_refused() {
    let point = |i: u64| [below(3 * i, 5000), below(3 * i + 1, 5000), below(3 * i + 2, 200)];
    let cloud = |scale| given("cloud", [scale; 3], (0..3000).map(point).collect());
    for scale in [1e-300, 1e-170, 1e-40, 1e-12, 1e6, 1e25] {
        whole(&[cloud(scale)], &small(64));
    }
    let folder = tempfile::tempdir().unwrap();
    for scale in [1e27, 1e40, 1e300] {
        let out = folder.path().join("out.esker");
        let error = build_sources(vec![cloud(scale).boxed()], &out, &small(64), &Silent);
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with("cloud: coordinates in steps of 1e"), "{error}");
        assert!(given::names_in(folder.path()).is_empty());
    }
}

#[test]
fn wide_points_that_do_not_fit_the_memory_bound_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let options = Options { memory_bytes: 256 << 20, ..Default::default() };
    let built = |cube: &str| build(&[cube.into()], &out, &options, &Silent);
    let error = built("synthetic:cube:1M").unwrap_err().to_string();
    assert_eq!(
        error,
        "--memory must be at least 620 MiB for nodes of 65536 points of 124 bytes each"
    );
    assert!(given::names_in(folder.path()).is_empty());
    assert!(built("synthetic:cube:10k").is_ok());
}

#[test]
fn duplicates_in_pairs() {
    let point = |i: u64| [below(i / 2 * 3, 9000), below(i / 2 * 3 + 1, 9000), below(i / 2, 50)];
    whole(&[numbered((0..100_000).map(point).collect())], &small(512));
    // Pairs of equal records.
    whole(&[given("bare", MM, (0..100_000).map(point).collect())], &small(512));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Few positions, many points: stacks above and below a node's capacity next to lone points, so
    /// that nodes may lose all points that they offered.
    #[test]
    fn stacks_of_any_height_beside_lone_points(
        stacks in prop::collection::vec(([0i32..6, 0i32..6, 0i32..3], 1usize..300), 1..12),
        spread in 0u32..28,
        lone in prop::collection::vec([0i32..6, 0i32..6, 0i32..6], 0..200),
    ) {
        let far = |p: [i32; 3]| p.map(|c| c << spread);
        let mut points: Vec<_> = stacks.iter().flat_map(|&(p, n)| vec![far(p); n]).collect();
        points.extend(lone.into_iter().map(far));
        whole(&[numbered(points)], &small(64));
    }

    #[test]
    fn any_points_at_any_depth(
        points in prop::collection::vec((any::<[i32; 3]>(), 0u32..32), 0..2000),
    ) {
        let points = points.into_iter().map(|(p, shift)| p.map(|c| c >> shift)).collect();
        whole(&[numbered(points)], &small(64));
    }

    /// Volumes, sheets, lines and stacks of all sizes and densities beside and within each other.
    #[test]
    fn parts_of_any_density(
        parts in prop::collection::vec(
            (any::<[i16; 3]>(), prop::array::uniform3(2u32..24), 3u32..14, any::<u64>()),
            1..6,
        ),
        capacity in prop::sample::select(vec![64, 256]),
    ) {
        let mut points = Vec::new();
        for (middle, log2, count, seed) in parts {
            let mut random = seed | 1;
            points.extend((0..1u32 << count).map(|_| [0, 1, 2].map(|axis| {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                i32::from(middle[axis]) * 64 + (random >> (64 - log2[axis])) as i32
            })));
        }
        whole(&[numbered(points)], &small(capacity));
    }
}

/// Otherwise a file that nobody could open would be detected only at its end.
#[test]
fn nodes_too_wide_to_be_read_are_refused_before_the_inputs_are_read() {
    let mut wide = given("wide", MM, vec![[0; 3]; 10_000]);
    let attribute = |i| Attribute::new(format!("a{i}"), AttrType::F64);
    wide.info.schema = Arc::new(Schema::new((0..60_000).map(attribute).collect()));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    // Enough memory that its bound is not the reason of the refusal.
    let options = Options { memory_bytes: 1 << 40, ..Default::default() };
    let error = build_sources(vec![wide.boxed()], &out, &options, &Silent).unwrap_err();
    assert!(error.to_string().contains("--node-capacity"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
