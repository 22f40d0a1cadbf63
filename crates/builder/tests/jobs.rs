//! A build that is divided among jobs gives the bytes of a build in one process, however many jobs
//! there are, in any order, twice at the same time, and again after they were killed.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

mod cloud;

use cloud::random;
use esker_builder::jobs::Resources;
use esker_builder::jobs::build::build_parts;
use esker_builder::jobs::cut::cut;
use esker_builder::jobs::join::join;
use esker_builder::jobs::place::{Folder, Place};
use esker_builder::jobs::plan::{PlanHow, plan};
use esker_builder::jobs::status::status;
use esker_builder::jobs::take::take;
use esker_builder::{NormalsMode, Options, build, export};
use esker_format::{Codec, Forest};
use esker_points::Filter;
use esker_points::task::Silent;
use std::path::{Path, PathBuf};

fn resources() -> Resources {
    Resources { memory_bytes: 256 << 20, scratch: None }
}

fn taken(place: &Folder, index: u32) {
    take(place, index, &resources(), &Silent).unwrap();
}

fn built(place: &Folder, index: u32) {
    build_parts(place, index, &resources(), &Silent).unwrap();
}

/// The numbers below `count` in an order that `seed` decides.
fn shuffled(count: u32, seed: u64) -> Vec<u32> {
    let mut all: Vec<u32> = (0..count).collect();
    all.sort_by_key(|&i| random(seed * 1000 + u64::from(i)));
    all
}

/// Builds by `jobs` jobs; every second one is run twice, at the same time as itself.
fn divided(inputs: &[PathBuf], options: &Options, jobs: u32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(&folder.path().join("place"));
    let how = PlanHow { jobs: Some(jobs), ..PlanHow::default() };
    let planned = plan(inputs, &place, options, &how, &Silent).unwrap();
    let twice = |index: u32, step: &(dyn Fn() + Sync)| {
        if index.is_multiple_of(2) { rayon::join(step, step) } else { (step(), ()) }
    };
    for index in shuffled(planned.takes, 1) {
        twice(index, &|| taken(&place, index));
    }
    let cut = cut(&place, &resources(), &Silent).unwrap();
    for index in shuffled(cut.builds, 2) {
        twice(index, &|| built(&place, index));
    }
    let out = folder.path().join("out.esker");
    let report = join(&place, &out, &resources(), &Silent).unwrap();
    assert_eq!(report.points_out, cut.points);
    let status = status(&place).unwrap();
    assert!(status.join.is_done() && status.leftovers.is_empty(), "{status:?}");
    std::fs::read(out).unwrap()
}

fn whole(inputs: &[PathBuf], options: &Options) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.esker");
    build(inputs, &out, options, &Silent).unwrap();
    std::fs::read(out).unwrap()
}

fn assert_same(inputs: &[PathBuf], options: &Options) {
    let one = whole(inputs, options);
    for jobs in [1, 3, 8] {
        let many = divided(inputs, options, jobs);
        assert!(one == many, "{inputs:?} by {jobs} jobs: other bytes");
    }
}

fn options() -> Options {
    Options { node_capacity: 1024, memory_bytes: 512 << 20, ..Options::default() }
}

fn inputs(specs: &[&str]) -> Vec<PathBuf> {
    specs.iter().map(PathBuf::from).collect()
}

#[test]
fn any_number_of_jobs_gives_the_bytes_of_one_process() {
    assert_same(&inputs(&["synthetic:terrain:200k:1"]), &options());
    let bare = Options { normals: NormalsMode::None, ..options() };
    assert_same(&inputs(&["synthetic:office:100k:2", "synthetic:terrain:60k:3"]), &bare);
}

#[test]
fn computed_attributes_are_those_of_one_process() {
    let all = Options {
        normals: NormalsMode::Estimate,
        sharp_features: true,
        tangents: true,
        compact: true,
        compress: Codec::Fast,
        ..options()
    };
    assert_same(&inputs(&["synthetic:bridge:60k:1"]), &all);
}

#[test]
fn files_are_read_in_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let built = folder.path().join("a.esker");
    build(&inputs(&["synthetic:terrain:120k:7"]), &built, &options(), &Silent).unwrap();
    let made = ["a.las", "b.laz"].map(|name| {
        let path: PathBuf = folder.path().join(name);
        export(&Forest::open(&built).unwrap(), &path, &Filter::default(), &Silent).unwrap();
        path
    });
    assert_same(&made, &options());
}

#[test]
fn small_and_empty_scans_are_built_by_many_jobs_too() {
    assert_same(&inputs(&["synthetic:terrain:5k:1"]), &options());
    assert_same(&inputs(&["synthetic:terrain:1:1"]), &options());
}

fn corrupted(path: &Path) {
    let mut bytes = std::fs::read(path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn missing_and_damaged_steps_are_named_and_nothing_is_published() {
    let folder = tempfile::tempdir().unwrap();
    let place = Folder::new(folder.path());
    let how = PlanHow { jobs: Some(3), ..PlanHow::default() };
    let planned = plan(&inputs(&["synthetic:terrain:50k:1"]), &place, &options(), &how, &Silent);
    (0..planned.unwrap().takes).for_each(|index| taken(&place, index));
    let parts = |i| build_parts(&place, i, &resources(), &Silent);
    let out = folder.path().join("out.esker");
    let joined = || join(&place, &out, &resources(), &Silent).map_err(|e| e.to_string());
    assert!(parts(0).unwrap_err().to_string().contains("esker job cut"));
    let count = cut(&place, &resources(), &Silent).unwrap().builds;
    assert!(count > 1);
    assert!(parts(count).unwrap_err().to_string().contains(&format!("no job {count}")));
    let text = joined().unwrap_err();
    assert!(text.contains("build/00000") && text.contains("missing"), "{text}");
    (0..count).for_each(|index| built(&place, index));
    let object = |prefix: &str| {
        let listed = place.list(prefix).unwrap();
        let large = listed.into_iter().find(|object| object.name.contains('-')).unwrap();
        folder.path().join(large.name)
    };
    // Rows that changed after the cut.
    let rows = object("take/00000");
    let sound = std::fs::read(&rows).unwrap();
    corrupted(&rows);
    let record = folder.path().join("build/00000");
    let kept = std::fs::read(&record).unwrap();
    std::fs::remove_file(&record).unwrap();
    let failed = (0..count).find_map(|i| parts(i).err()).unwrap().to_string();
    assert!(failed.contains("take/00000") && failed.contains("damaged"), "{failed}");
    std::fs::write(&rows, sound).unwrap();
    std::fs::write(&record, kept).unwrap();
    // Pages that changed, and pages that were cut.
    let pages = object("build/00001");
    let sound = std::fs::read(&pages).unwrap();
    corrupted(&pages);
    let text = joined().unwrap_err();
    assert!(text.contains("build/00001") && text.contains("esker job build"), "{text}");
    std::fs::write(&pages, &sound[..sound.len() - 1]).unwrap();
    let text = joined().unwrap_err();
    assert!(text.contains("build/00001") && text.contains("bytes"), "{text}");
    assert!(!out.exists());
    std::fs::write(&pages, sound).unwrap();
    joined().unwrap();
    assert!(out.exists());
}
