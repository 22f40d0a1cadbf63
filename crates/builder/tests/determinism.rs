//! The result of a build depends on the points and the options alone: the same bytes for any number
//! of threads, any order of the inputs, and any memory bound.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;
mod given;

use cloud::{below, random};
use esker_builder::{NormalsMode, Options, Report, Shares, build_shared, build_sources};
use esker_format::{Codec, EskerFile};
use esker_points::AttrType;
use esker_points::task::Silent;
use given::{Given, boxed, given, whole_by};
use proptest::prelude::*;
use std::path::Path;

/// Hills, a wall, a stack of coincident points, pairs: two inputs of different attributes.
fn mixed(count: u64) -> Vec<Given> {
    let ground = move |i: u64| {
        let (x, y) = (below(3 * i, 200_000), below(3 * i + 1, 150_000));
        let hills = (f64::from(x) / 9e3).sin() + (f64::from(y) / 1.1e4).cos();
        match random(i) % 8 {
            0 => [77_000, y, below(3 * i + 2, 40_000)],
            1 => [5000, 6000, 7000],
            2 => [x / 2000 * 2000, y / 2000 * 2000, 0],
            _ => [x, y, (2500.0 * hills) as i32],
        }
    };
    let a = given("a.las", [0.001; 3], (0..count).map(ground).collect())
        .with("intensity", AttrType::U16, |i| i % 5)
        .with("gps_time", AttrType::F64, |i| (i as f64 / 7.0).to_bits());
    let b = given("b.las", [0.001; 3], (count..count * 3 / 2).map(ground).collect())
        .with("intensity", AttrType::U16, |i| i % 3)
        .with("classification", AttrType::U8, |i| i % 9);
    vec![a, b]
}

fn options() -> Options {
    Options { node_capacity: 1024, ..Default::default() }
}

/// Runs `work` in a pool of `threads` threads.
fn in_pool<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn bytes_of(sources: &[Given], shares: Shares) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    build_shared(boxed(sources), &out, &options(), shares, &Silent).unwrap();
    std::fs::read(out).unwrap()
}

/// Little memory: several chunks, and most rows in scratch.
fn little() -> Shares {
    Shares { buffer_bytes_max: 200_000, chunk_bytes_max: 500_000 }
}

#[test]
fn one_thread_or_many_write_the_same_bytes() {
    let sources = mixed(40_000);
    for shares in [Shares::of(1 << 30), little()] {
        let one = in_pool(1, || bytes_of(&sources, shares));
        for threads in [2, 5] {
            let many = in_pool(threads, || bytes_of(&sources, shares));
            assert!(one == many, "{threads} threads write other bytes with {shares:?}");
        }
    }
}

#[test]
fn the_order_in_which_inputs_are_named_does_not_matter() {
    let mut sources = mixed(50_000);
    let one = bytes_of(&sources, little());
    sources.reverse();
    assert!(one == bytes_of(&sources, little()));
}

fn built_with(sources: &[Given], shares: Shares, options: &Options) -> (Report, EskerFile) {
    whole_by(sources, |out: &Path| {
        build_shared(boxed(sources), out, options, shares, &Silent).unwrap()
    })
}

/// Compares all that a file consists of, node by node, so that a failure names the first one.
fn assert_same(a: &EskerFile, b: &EskerFile) {
    assert_eq!(a.footer().hash, b.footer().hash);
    assert!(a.table().nodes == b.table().nodes, "other nodes, or another order of pages");
    for i in 0..a.table().nodes.len() as u32 {
        for plane in a.layout().planes() {
            let [of_a, of_b] = [a, b].map(|file| file.read_planes(i, &[plane.kind]).unwrap());
            let is_same = of_a.get(plane.kind) == of_b.get(plane.kind);
            assert!(is_same, "another plane {:?} of node {i}", plane.kind);
        }
        let pages = [a, b].map(|f| f.read_page(i).unwrap().bytes().to_vec());
        assert!(pages[0] == pages[1], "another page {i}");
    }
    assert_eq!(a.statistics().unwrap(), b.statistics().unwrap());
    // The CRCs of the sections, and the length.
    assert_eq!(a.footer(), b.footer());
}

#[test]
fn the_same_bytes_under_another_memory_bound() {
    let sources = mixed(40_000);
    let (ample, a) = built_with(&sources, Shares::of(1 << 30), &options());
    assert_eq!(ample.scratch_bytes, 0);
    for chunk_bytes_max in [0, 2_000_000] {
        for buffer_bytes_max in [0, 200_000, 1 << 30] {
            let shares = Shares { buffer_bytes_max, chunk_bytes_max };
            let (report, b) = built_with(&sources, shares, &options());
            assert!(report.scratch_bytes > 0 || buffer_bytes_max == 1 << 30);
            assert_same(&a, &b);
        }
    }
}

#[test]
fn parts_of_other_densities_are_arranged_alike_for_all_threads_and_memory_bounds() {
    // As many points as are arranged at once.
    let place = |i: u64| {
        let edge = if i.is_multiple_of(4) { 2_000_000 } else { 3000 };
        [below(2 * i, edge), below(2 * i + 1, edge), below(i, 7)]
    };
    let sources = [given("uneven", [0.001; 3], (0..8192).map(place).collect())];
    let (_, a) = built_with(&sources, Shares::of(1 << 30), &options());
    let roots = a.table().nodes.iter().filter(|node| node.child_count > 0).count();
    assert!(roots > 0 && a.table().nodes[0].points() < 1024, "an even sample");
    for shares in [little(), Shares { buffer_bytes_max: 0, chunk_bytes_max: 0 }] {
        for threads in [1, 5] {
            let (_, b) = in_pool(threads, || built_with(&sources, shares, &options()));
            assert_same(&a, &b);
        }
    }
}

#[test]
fn a_stack_larger_than_memory_has_the_bytes_of_one_that_fits() {
    // Many equal records, and more at the same position: a stack that is cut into nodes by the
    // order of records.
    let positions = (0..40_000).map(|i| if i % 4 == 0 { [i % 900, 5, 5] } else { [9, 9, 9] });
    let sources =
        [given("stack", [0.01; 3], positions.collect())
            .with("intensity", AttrType::U16, |i| random(i) % 50)];
    let options = Options { node_capacity: 64, ..Default::default() };
    let (_, a) = built_with(&sources, Shares::of(1 << 30), &options);
    let (report, b) =
        built_with(&sources, Shares { buffer_bytes_max: 0, chunk_bytes_max: 0 }, &options);
    assert!(report.scratch_bytes > 0 && a.table().nodes.iter().any(|n| n.is_continuation()));
    assert_same(&a, &b);
}

#[test]
fn a_far_outlier_is_parted_in_few_passes() {
    let near = |i: u64| [below(3 * i, 900), below(3 * i + 1, 900), below(3 * i + 2, 900)];
    let mut positions: Vec<_> = (0..100_000).map(near).collect();
    positions.push([i32::MAX; 3]);
    let sources = [given("far", [0.001; 3], positions)];
    // Room for normals would make chunks of this size smaller.
    let normals = NormalsMode::None;
    let options = Options { node_capacity: 64, normals, ..Default::default() };
    let (_, a) = built_with(&sources, Shares::of(1 << 30), &options);
    let (report, b) =
        built_with(&sources, Shares { buffer_bytes_max: 0, chunk_bytes_max: 50_000 }, &options);
    let bytes = 12 * 100_001;
    assert!(report.scratch_bytes <= 4 * bytes, "{} written for {bytes}", report.scratch_bytes);
    assert!(report.scratch_bytes > bytes, "no cell was parted");
    assert_same(&a, &b);
}

#[test]
fn computed_attributes_do_not_depend_on_memory_either() {
    let coloured = |given: Given| {
        let colours = ["red", "green", "blue"].into_iter();
        colours.fold(given, |given, name| given.with(name, AttrType::U8, |i| random(i / 7) % 256))
    };
    let sources: Vec<Given> = mixed(30_000).into_iter().map(coloured).collect();
    let fast = Options { normals: NormalsMode::Fast, ..options() };
    let all = Options {
        normals: NormalsMode::Estimate,
        sharp_features: true,
        tangents: true,
        compact: true,
        compress: Codec::Fast,
        ..options()
    };
    // A stack of points, some of which have no normal.
    let with_normals = |given: Given| {
        let part = |i: u64, axis: u64| match random(i) % 5 {
            0 => 0.0f32,
            _ => f32::from(random(i / 9 + axis) as i8),
        };
        let axes = [("nx", 0), ("ny", 1), ("nz", 2)].into_iter();
        axes.fold(given, |given, (name, axis)| {
            given.with(name, AttrType::F32, |i| part(i, axis).to_bits().into())
        })
    };
    let given: Vec<Given> = mixed(30_000).into_iter().map(with_normals).collect();
    let kept = Options { normals: NormalsMode::Keep, ..all.clone() };
    for (sources, options) in [(&sources, fast), (&sources, all), (&given, kept)] {
        let (_, a) = built_with(sources, Shares::of(1 << 30), &options);
        for chunk_bytes_max in [0, 1_500_000] {
            let shares = Shares { buffer_bytes_max: 100_000, chunk_bytes_max };
            for threads in [1, 3] {
                let (_, b) = in_pool(threads, || built_with(sources, shares, &options));
                assert_same(&a, &b);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn any_cloud_has_the_same_bytes_under_any_bound(
        points in prop::collection::vec((any::<[i32; 3]>(), 0u32..32, 1usize..20), 1..500),
        stack in 0usize..1500,
        buffer_bytes_max in 0u64..50_000,
        chunk_bytes_max in 0u64..200_000,
    ) {
        let mut positions: Vec<_> = points
            .into_iter()
            .flat_map(|(p, shift, n)| vec![p.map(|c| c >> shift); n])
            .collect();
        positions.extend(vec![positions[0]; stack]);
        let sources = [given("any", [0.001; 3], positions)
            .with("user_data", AttrType::U8, |i| random(i) % 3)];
        let options = Options { node_capacity: 64, ..Default::default() };
        let (_, a) = built_with(&sources, Shares::of(1 << 30), &options);
        let shares = Shares { buffer_bytes_max, chunk_bytes_max };
        let (_, b) = built_with(&sources, shares, &options);
        assert_same(&a, &b);
    }
}

#[test]
fn options_out_of_range_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    let one = || boxed(&[given("one", [1.0; 3], vec![[0; 3]])]);
    let error = |sources, options: Options| {
        build_sources(sources, &out, &options, &Silent).unwrap_err().to_string()
    };
    for node_capacity in [0, 63, (1 << 17) + 1, u32::MAX] {
        let text = error(one(), Options { node_capacity, ..Default::default() });
        assert!(text.contains(&node_capacity.to_string()) && text.contains("64"), "{text}");
    }
    let text = error(one(), Options { memory_bytes: 1 << 20, ..Default::default() });
    assert!(text.contains("--memory") && text.contains("256 MiB"), "{text}");
    assert!(error(Vec::new(), options()).contains("no input"));
    assert!(given::names_in(folder.path()).is_empty());
}
