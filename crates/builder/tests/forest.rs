//! Appending leaves the old file unchanged and loses no point of the new inputs; merging makes a
//! forest into the tree that building everything at once makes.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod given;

use cloud::below;
use esker_builder::OFF_LATTICE;
use esker_builder::{
    BuildError, NormalsMode, Options, against_sources, append_sources, build_sources, export, merge,
};
use esker_format::{EskerFile, FileWriter, Forest, PagePoints};
use esker_points::task::Silent;
use esker_points::{AttrType, ColourDepth, Filter, MultisetHash, Task};
use esker_scan::source::Crs;
use given::{Given, boxed, given, hash_of};
use std::path::{Path, PathBuf};

fn options() -> Options {
    Options { node_capacity: 256, ..Default::default() }
}

/// Keeps the notes of a task.
#[derive(Default)]
struct Notes(std::sync::Mutex<Vec<String>>);

impl Task for Notes {
    fn note(&self, line: &str) {
        self.0.lock().unwrap().push(line.into());
    }
}

fn scan(name: &str, seed: u64, count: u64) -> Given {
    let at =
        |i: u64| [0, 1, 2].map(|axis| below(seed + 3 * i + axis, [9000, 9000, 400][axis as usize]));
    let mut scan = given(name, [0.01; 3], (0..count).map(at).collect())
        .with("intensity", AttrType::U16, |i| i)
        .with("gps_time", AttrType::F64, move |i| (seed + i) as f64 as u64);
    scan.info.verbatim = vec![("vlr".into(), name.as_bytes().to_vec())];
    scan
}

struct TestFolder(tempfile::TempDir);

impl TestFolder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
    fn build(&self, name: &str, sources: &[Given]) -> EskerFile {
        build_sources(boxed(sources), &self.at(name), &options(), &Silent).unwrap();
        EskerFile::open(&self.at(name)).unwrap()
    }
    fn append(&self, old: &str, sources: &[Given], name: &str) -> Forest {
        let old = Forest::open(&self.at(old)).unwrap();
        append_sources(&old, boxed(sources), &self.at(name), &options(), &Silent).unwrap();
        Forest::open(&self.at(name)).unwrap()
    }
    fn merge(&self, files: &[&str], name: &str) -> EskerFile {
        let files: Vec<_> = files.iter().map(|name| self.at(name)).collect();
        merge(&files, &self.at(name), &options(), &Silent).unwrap();
        let file = EskerFile::open(&self.at(name)).unwrap();
        esker_format::verify(&file, &Silent).unwrap();
        file
    }
    fn bytes(&self, name: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut file = std::fs::File::open(self.at(name)).unwrap();
        std::io::Read::read_to_end(&mut file, &mut bytes).unwrap();
        bytes
    }
}

#[test]
fn finer_scans_are_appended_without_measuring_them() {
    let folder = TestFolder::new();
    folder.build("a", &[scan("a.las", 1, 2000)]);
    let finer = given("b.las", [0.001; 3], (0..2000).map(|i| [i, 2 * i, 3]).collect());
    let (old, notes) = (Forest::open(&folder.at("a")).unwrap(), Notes::default());
    let report =
        append_sources(&old, boxed(&[finer]), &folder.at("b"), &options(), &notes).unwrap();
    assert_eq!((report.points_out, notes.0.into_inner().unwrap()), (2000, Vec::new()));
}

fn hash(forest: &Forest) -> MultisetHash {
    let mut sum = MultisetHash::default();
    forest.files().for_each(|file| sum += esker_format::verify(file, &Silent).unwrap().hash);
    sum
}

/// Records and points of all nodes, without the offsets of their pages.
fn nodes(file: &EskerFile) -> Vec<(esker_points::Node, PagePoints)> {
    let nodes = file.table().nodes.iter().zip(0..);
    let node = |(node, i): (&esker_points::Node, u32)| {
        let points = file.read_page(i).unwrap().points().unwrap();
        (esker_points::Node { page_offset: 0, ..*node }, points)
    };
    nodes.map(node).collect()
}

#[test]
fn appending_leaves_the_old_file_unchanged() {
    let folder = TestFolder::new();
    let (a, b, c) = (scan("a.las", 1, 3000), scan("b.las", 90_000, 2000), scan("c.las", 7, 500));
    folder.build("a.esker", std::slice::from_ref(&a));
    let before = folder.bytes("a.esker");
    let forest = folder.append("a.esker", std::slice::from_ref(&b), "ab.esker");
    assert_eq!(before, folder.bytes("a.esker"));
    let own = forest.files().next().unwrap();
    assert_eq!(own.footer().hash, hash_of(std::slice::from_ref(&b), own));
    assert_eq!((own.footer().points, forest.points()), (2000, 5000));
    against_sources(own, boxed(std::slice::from_ref(&b)), &Silent).unwrap();

    // Forests are appended to like files; the list of the new forest is complete.
    let forest = folder.append("ab.esker", std::slice::from_ref(&c), "abc.esker");
    let own = forest.files().next().unwrap();
    let named: Vec<_> = own.metadata().forest.iter().map(|tree| tree.path.as_str()).collect();
    assert_eq!(named, ["ab.esker", "a.esker"]);
    assert_eq!(forest.points(), 5500);
    let all = [a, b, c];
    assert_eq!(hash(&forest), hash_of(&all, own));
}

#[test]
fn points_off_the_old_lattice_are_rounded_and_those_outside_are_an_error_or_left_out() {
    let folder = TestFolder::new();
    folder.build("a.esker", &[scan("a.las", 1, 300)]);
    let mut fine = scan("fine.las", 5, 1000);
    fine.info.grid.grid.scale = [0.003; 3];
    // The lattice of hundredths reaches 21,474,836.47; half of this input, moved, lies outside.
    let mut far = scan("far.las", 9, 1000).at([21_474_790.0, 0.0, 0.0]);
    far.info.verbatim.clear();
    let outside = far.positions.iter().filter(|p| p[0] > 4647).count() as u64;
    assert!(outside > 100 && outside < 900);
    let old = Forest::open(&folder.at("a.esker")).unwrap();
    let sources = [fine, far];
    let out = folder.at("b.esker");
    let error = append_sources(&old, boxed(&sources), &out, &options(), &Silent).unwrap_err();
    let error = error.to_string();
    assert!(error.starts_with("far.las: ") && error.contains("--drop-outside"), "{error}");
    assert!(!out.exists() && !FileWriter::has_left(&out));
    let drops = Options { drop_outside: true, ..options() };
    let report = append_sources(&old, boxed(&sources), &out, &drops, &Silent).unwrap();
    assert_eq!(report.points_in, 2000);
    assert_eq!(report.points_out, 2000 - outside);
    assert_eq!(report.points_refused, [(OFF_LATTICE.to_string(), outside)].into());
    assert!(report.rounding_error_max > 0.001 && report.rounding_error_max <= 0.005);
    let file = EskerFile::open(&folder.at("b.esker")).unwrap();
    esker_format::verify(&file, &Silent).unwrap();
    let refused: Vec<u64> =
        file.metadata().sources.iter().map(|s| s.refused.values().sum()).collect();
    assert_eq!(refused, [outside, 0]);
    against_sources(&file, boxed(&sources), &Silent).unwrap();
    // Another point outside is detected.
    let mut changed = sources.clone();
    let inside = changed[1].positions.iter().position(|p| p[0] <= 4647).unwrap();
    changed[1].positions[inside][0] = 100_000;
    assert!(matches!(
        against_sources(&file, boxed(&changed), &Silent),
        Err(BuildError::Differs(_))
    ));
}

#[test]
fn another_reference_system_is_refused_with_both_names_unless_ignored() {
    let folder = TestFolder::new();
    let system = |mut scan: Given, name: &str| {
        scan.info.crs = Some(Crs { text: format!("PROJCS[\"{name}\"]"), unit: None });
        scan
    };
    folder.build("a.esker", &[system(scan("a.las", 1, 300), "Here")]);
    let old = Forest::open(&folder.at("a.esker")).unwrap();
    let append = |source: Given, options: &Options| {
        append_sources(&old, boxed(&[source]), &folder.at("b.esker"), options, &Silent)
    };
    let there = || system(scan("b.las", 2, 300), "There");
    let error = append(there(), &options()).unwrap_err().to_string();
    for word in ["a.esker", "b.las", "Here", "There", "--ignore-crs"] {
        assert!(error.contains(word), "{error}");
    }
    assert!(!folder.at("b.esker").exists());
    append(there(), &Options { ignore_crs: true, ..options() }).unwrap();
    append(system(scan("b.las", 2, 300), "Here"), &options()).unwrap();
    append(scan("b.las", 2, 300), &options()).unwrap();
}

/// A name has one scale; with another the same stored value would be a different one.
#[test]
fn attributes_of_different_scales_are_refused_with_both_names() {
    let of = |name: &str, scale: f64| {
        let mut scan = scan(name, 5, 100).with("height", AttrType::U16, |i| i);
        let schema = std::sync::Arc::make_mut(&mut scan.info.schema);
        let own = schema.find("height").unwrap();
        schema.attributes[own].scale = scale;
        scan
    };
    let folder = TestFolder::new();
    let (fine, coarse) = (of("fine.las", 0.01), of("coarse.las", 0.1));
    let assert_names_both = |error: BuildError| {
        let error = error.to_string();
        for word in ["`height`", "fine", "coarse.las", "0.01", "0.1"] {
            assert!(error.contains(word), "{word}: {error}");
        }
    };
    let both = [fine.clone(), coarse.clone()];
    let out = folder.at("both.esker");
    assert_names_both(build_sources(boxed(&both), &out, &options(), &Silent).unwrap_err());
    folder.build("fine.esker", std::slice::from_ref(&fine));
    let old = Forest::open(&folder.at("fine.esker")).unwrap();
    assert_names_both(
        append_sources(&old, boxed(&[coarse]), &out, &options(), &Silent).unwrap_err(),
    );
    assert!(!out.exists());
    // Differences by rounding of a decimal number are ignored.
    folder.append("fine.esker", &[of("again.las", 0.1 * 0.1)], "two.esker");
}

#[test]
fn a_file_that_is_read_is_not_overwritten() {
    let folder = TestFolder::new();
    folder.build("a.esker", &[scan("a.las", 1, 300)]);
    folder.append("a.esker", &[scan("b.las", 2, 300)], "ab.esker");
    let (before, old) = (folder.bytes("a.esker"), Forest::open(&folder.at("ab.esker")).unwrap());
    let over = append_sources(
        &old,
        boxed(&[scan("c.las", 3, 9)]),
        &folder.at("a.esker"),
        &options(),
        &Silent,
    );
    assert!(over.unwrap_err().to_string().contains("input and output at once"));
    let over = merge(&[folder.at("ab.esker")], &folder.at("a.esker"), &options(), &Silent);
    assert!(over.unwrap_err().to_string().contains("input and output at once"));
    assert_eq!(before, folder.bytes("a.esker"));
}

#[test]
fn a_merged_forest_is_the_tree_of_all_scans_built_at_once() {
    let folder = TestFolder::new();
    let all = [scan("a.las", 1, 3000), scan("b.las", 90_000, 2000), scan("c.las", 7, 500)];
    let whole = folder.build("whole.esker", &all);
    folder.build("a.esker", &all[..1]);
    folder.append("a.esker", &all[1..2], "ab.esker");
    folder.append("ab.esker", &all[2..], "abc.esker");
    let merged = folder.merge(&["abc.esker"], "merged.esker");
    assert_eq!(nodes(&merged), nodes(&whole));
    assert_eq!(merged.footer().hash, whole.footer().hash);
    assert!(merged.metadata().forest.is_empty());
    // Sources are recorded as before, including their verbatim blocks; and the inputs match the
    // points.
    let record = |s: &esker_format::SourceRecord| (s.path.clone(), s.points, s.format.clone());
    let mut known: Vec<_> = merged.metadata().sources.iter().map(record).collect();
    known.sort();
    assert_eq!(known, whole.metadata().sources.iter().map(record).collect::<Vec<_>>());
    for (i, source) in merged.metadata().sources.iter().enumerate() {
        let block = ("vlr".to_string(), source.path.clone().into_bytes());
        assert_eq!(merged.verbatim(i).unwrap(), [block]);
    }
    against_sources(&merged, boxed(&all), &Silent).unwrap();
    // Overlapping trees are thinned separately, which is noted.
    let filter = Filter { max_spacing: Some(2.0), ..Filter::default() };
    let thinned = |name: &str| {
        let forest = Forest::open(&folder.at(name)).unwrap();
        let exported = export(&forest, &folder.at("thinned.xyz"), &filter, &Silent).unwrap();
        exported.notes.iter().any(|note| note.contains("trees overlap"))
    };
    assert!(thinned("abc.esker") && !thinned("merged.esker"));
    // Named separately, the same files make the same tree; a file that is named twice is used once.
    let again = folder.merge(&["ab.esker", "abc.esker", "a.esker"], "again.esker");
    assert_eq!(nodes(&again), nodes(&whole));
}

#[test]
fn merging_notes_what_it_drops_and_the_options_that_restore_it() {
    let folder = TestFolder::new();
    let all = [scan("a.las", 1, 3000)];
    let made =
        Options { normals: NormalsMode::Estimate, tangents: true, compact: true, ..options() };
    build_sources(boxed(&all), &folder.at("a.esker"), &made, &Silent).unwrap();
    let notes = |options: &Options| {
        let report = merge(&[folder.at("a.esker")], &folder.at("merged.esker"), options, &Silent);
        report.unwrap().notes
    };
    let notes_without = notes(&options());
    let note = notes_without.iter().find(|note| note.contains("not taken over")).unwrap();
    assert!(note.contains("; --tangents makes"), "{note}");
    assert!(!notes(&made).iter().any(|note| note.contains("not taken over")));
}

#[test]
fn merging_keeps_which_attributes_each_point_has() {
    let folder = TestFolder::new();
    let bare = given("bare.xyz", [0.01; 3], scan("", 4, 900).positions);
    let coloured = |name: &str, depth: ColourDepth, step: u64| {
        scan(name, 11, 700)
            .with("red", AttrType::U16, move |i| i * step)
            .with("green", AttrType::U16, move |i| i % 7 * step)
            .with("blue", AttrType::U16, |_| 0)
            .coloured(depth)
    };
    let first = [bare, coloured("dark.las", ColourDepth::Eight, 0)];
    let second = [coloured("bright.las", ColourDepth::Sixteen, 80), scan("plain.las", 3, 400)];
    folder.build("a.esker", &first);
    folder.append("a.esker", &second, "b.esker");
    let merged = folder.merge(&["b.esker"], "merged.esker");
    let all: Vec<Given> = first.into_iter().chain(second).collect();
    assert_eq!(merged.footer().hash, hash_of(&all, &merged));
    against_sources(&merged, boxed(&all), &Silent).unwrap();
    let metadata = merged.metadata();
    assert_eq!(metadata.classes.len(), 4);
    for source in &metadata.sources {
        let given = all.iter().find(|g| g.info.path == Path::new(&source.path)).unwrap();
        let class = &metadata.classes[usize::from(source.class)];
        let present =
            class.present.iter().map(|&i| metadata.schema.attributes[usize::from(i)].key());
        assert!(
            present.eq(given.info.schema.attributes.iter().map(|a| a.key())),
            "{}",
            source.path
        );
        assert!(source.colour_depth.is_none_or(|depth| depth == class.colour_depth));
    }
}

#[test]
fn files_over_different_lattices_are_not_merged() {
    let folder = TestFolder::new();
    folder.build("a.esker", &[scan("a.las", 1, 300)]);
    folder.build("b.esker", &[scan("b.las", 2, 300).at([0.5; 3])]);
    let files = ["a.esker", "b.esker"].map(|name| folder.at(name));
    let error = merge(&files, &folder.at("c.esker"), &options(), &Silent).unwrap_err().to_string();
    assert!(
        error.contains("a.esker") && error.contains("b.esker") && error.contains("lattice"),
        "{error}"
    );
}

#[test]
fn damage_found_while_merging_leaves_no_file() {
    let folder = TestFolder::new();
    folder.build("a.esker", &[scan("a.las", 1, 3000)]);
    folder.append("a.esker", &[scan("b.las", 2, 300)], "b.esker");
    let mut bytes = folder.bytes("a.esker");
    // In the directory of the first page: bytes between planes are checked by verify alone.
    bytes[100] ^= 4;
    std::fs::write(folder.at("a.esker"), bytes).unwrap();
    let error =
        merge(&[folder.at("b.esker")], &folder.at("c.esker"), &options(), &Silent).unwrap_err();
    assert!(error.to_string().contains("a.esker"), "{error}");
    assert!(!folder.at("c.esker").exists());
}
