//! Generated scans: the same points on every machine, as many as requested, however they are read.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_points::task::Silent;
use esker_points::{Batch, Lattice, MultisetHash, hash::layout_seed};
use esker_scan::source::BATCH_POINTS;
use esker_scan::{OpenOptions, ReadReport, Source};
use std::path::Path;

fn open(spec: &str) -> Box<dyn Source> {
    esker_scan::open(Path::new(spec), &OpenOptions::default(), &Silent).unwrap()
}

fn read(source: &dyn Source) -> (Vec<Batch>, ReadReport) {
    let grid = &source.info().grid;
    let placement = Lattice::choose(std::slice::from_ref(grid)).unwrap().placement(grid);
    assert!(placement.is_exact());
    let mut batches = Vec::new();
    let report = source.read(&placement, &Silent, &mut |batch| {
        assert!(batch.is_consistent() && !batch.is_empty() && batch.len() <= BATCH_POINTS);
        batches.push(batch);
        Ok(())
    });
    (batches, report.unwrap())
}

fn hash(batches: &[Batch]) -> MultisetHash {
    let mut hash = MultisetHash::default();
    let mut record = Vec::new();
    for batch in batches {
        let seed = layout_seed(batch.schema.attributes.iter().map(|a| a.key()));
        for i in 0..batch.len() {
            record.clear();
            batch.record_into(i, &mut record);
            hash.add(seed, &record);
        }
    }
    hash
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

/// Scenes with the hash of 100,001 points of seed 7. With another hash, files built from a scene no
/// longer verify against it: change it only on purpose.
const PINNED: [(&str, &str); 3] = [
    ("bridge", "5107fe3b442c8b861598d8ae4d242bfa"),
    ("office", "a76074484c69a49cea08007462eff964"),
    ("terrain", "deb28e4664a9a4f1f37f83d27a8a8b6f"),
];

#[test]
fn every_scene_has_the_same_points_on_every_machine() {
    let found = PINNED.map(|(scene, _)| {
        let (batches, _) = read(open(&format!("synthetic:{scene}:100001:7")).as_ref());
        (scene, hash(&batches).to_string())
    });
    assert_eq!(found, PINNED.map(|(scene, pinned)| (scene, pinned.to_owned())));
}

#[test]
fn the_number_of_points_is_as_requested_and_all_are_within_the_bounds() {
    for (scene, _) in PINNED {
        for points in [0u64, 1, 7, 1000, 16_384, 16_385, 60_000] {
            let source = open(&format!("synthetic:{scene}:{points}"));
            let (batches, report) = read(source.as_ref());
            let count: usize = batches.iter().map(Batch::len).sum();
            assert_eq!((count as u64, report.points), (points, points), "{scene}");
            assert_eq!((report.rounding_error_max, report.refused.len()), (0.0, 0));
            let true_bounds = source.survey(&Silent).unwrap().bounds();
            let claimed = source.info().grid.bounds;
            assert_eq!((true_bounds.is_some(), claimed.is_some()), (points > 0, points > 0));
            if let (Some(inner), Some(outer)) = (true_bounds, claimed) {
                let within =
                    (0..3).all(|i| outer[0][i] <= inner[0][i] && inner[1][i] <= outer[1][i]);
                assert!(within, "{scene}: {inner:?} in {outer:?}");
            }
        }
    }
}

#[test]
fn threads_change_neither_points_nor_their_order() {
    for (scene, _) in PINNED {
        let source = open(&format!("synthetic:{scene}:150k:3"));
        let [one, three] = [1, 3].map(|n| pool(n).install(|| read(source.as_ref()).0));
        let positions = |batches: &[Batch]| -> Vec<_> {
            batches.iter().flat_map(|b| b.positions.clone()).collect()
        };
        assert_eq!(positions(&one), positions(&three), "{scene}");
        assert_eq!(hash(&one), hash(&three), "{scene}");
    }
}

#[test]
fn seeds_give_other_points() {
    for (scene, _) in PINNED {
        let [a, b] =
            [1, 2].map(|seed| read(open(&format!("synthetic:{scene}:20k:{seed}")).as_ref()).0);
        assert_ne!(hash(&a), hash(&b), "{scene}");
    }
}

#[test]
fn scans_that_are_not_generated_are_refused_and_files_of_that_name_are_read() {
    let open = |path: &Path| esker_scan::open(path, &OpenOptions::default(), &Silent);
    let error = open(Path::new("synthetic:castle:1M")).err().unwrap().to_string();
    assert!(error.starts_with("synthetic:castle:1M: there is no scene `castle`"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(if cfg!(windows) { "synthetic" } else { "synthetic:office:1M" });
    std::fs::write(&file, "0 0 0\n1 2 3\n").unwrap();
    assert_eq!(open(&file).unwrap().info().points_hint, 2);
}
