//! The independent Python reader, written from the specification alone, reads the same points from
//! the same file, and finds damage.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod mutate;
mod tree;

use esker_format::{EskerFile, PartSizes, verify};
use esker_points::task::Silent;
use mutate::Random;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn python() -> Option<String> {
    let python = std::env::var("ESKER_PYTHON").unwrap_or_else(|_| "python3".into());
    let numpy = Command::new(&python).args(["-c", "import numpy"]).output();
    if numpy.is_ok_and(|o| o.status.success()) {
        return Some(python);
    }
    println!("skipped: {python} with numpy is not there (ESKER_PYTHON names another)");
    None
}

fn contents(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(path).unwrap(), &mut bytes).unwrap();
    bytes
}

fn read(python: &str, file: &Path, more: &[&str]) -> Output {
    let reader = PathBuf::from("../../data-format/reader.py");
    let mut command = Command::new(python);
    command.arg("-B").arg(reader).arg(file).arg("--json").args(more).output().unwrap()
}

#[test]
fn both_readers_read_the_same_points() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (mixed, mixed_classes) = tree::mixed_schema();
    let single = mixed_classes[3..4].to_vec();
    let long = tree::long_schema();
    let cases = [
        (mixed.clone(), mixed_classes.clone(), 3_000, 20),
        (mixed.clone(), mixed_classes.clone(), 700, 32),
        (mixed.clone(), single, 500, 14),
        (mixed.clone(), mixed_classes[4..].to_vec(), 200, 0),
        (long.0, long.1, 300, 27),
        (mixed, mixed_classes, 0, 20),
    ];
    for (number, (schema, classes, count, spread)) in cases.into_iter().enumerate() {
        let path = folder.path().join(format!("{number}.esker"));
        let csv = folder.path().join("points.csv");
        let points = tree::points_of(&schema, &classes, count, spread, 99 + number as u64);
        let mut metadata = tree::metadata(schema, classes);
        if number % 2 == 1 {
            metadata = tree::in_degrees(metadata);
        }
        metadata.set_aside = tree::set_aside(&metadata);
        // Node tables that can be read in parts, of all sizes.
        let part_nodes = 1 + number as u32;
        let sizes = PartSizes { from_nodes: 1, part_nodes, top_nodes: 1 + 5 * number };
        tree::write_parts(&path, &metadata, (&points, 60), sizes);
        let output = read(&python, &path, &["--csv", csv.to_str().unwrap()]);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{number}: {}", String::from_utf8_lossy(&output.stderr));
        let reported: serde_json::Value =
            serde_json::from_str(text.lines().last().unwrap()).unwrap();
        let file = EskerFile::open(&path).unwrap();
        assert_eq!(reported["points"], count as u64);
        assert_eq!(reported["version"], 1 + number as u64 % 2);
        assert_eq!(reported["nodes"], file.footer().nodes);
        assert_eq!(reported["multiset_hash"], file.footer().hash.to_string());
        assert_eq!(reported["footer_hash"], format!("{:032x}", file.footer().name_hash()));
        let rows = std::fs::read_to_string(&csv).unwrap();
        assert_eq!(rows.lines().skip(1).collect::<Vec<_>>().len(), count);
        compare(&file, rows.lines().skip(1));
    }
}

/// Compares every coordinate, class and value, in the order of nodes.
fn compare<'a>(file: &EskerFile, mut rows: impl Iterator<Item = &'a str>) {
    let attributes = &file.layout().schema().attributes;
    for node in 0..file.table().nodes.len() as u32 {
        let points = file.read_page(node).unwrap().points().unwrap();
        for i in 0..points.len() {
            let mut fields = rows.next().unwrap().split(',');
            for c in points.positions[i] {
                assert_eq!(fields.next().unwrap(), c.to_string());
            }
            assert_eq!(fields.next().unwrap(), points.class(i).to_string());
            for (a, attribute) in attributes.iter().enumerate() {
                let size = attribute.ty.size();
                let value = attribute.ty.to_f64(&points.columns[a][i * size..]);
                let reported: f64 = fields.next().unwrap().parse().unwrap();
                assert!(
                    reported == value || reported.is_nan() && value.is_nan(),
                    "{reported} {value}"
                );
            }
        }
    }
}

#[test]
fn the_samples_are_read() {
    let Some(python) = python() else { return };
    let folder = PathBuf::from("../../data-format/samples");
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: serde_json::Value = serde_json::from_str(&text).unwrap();
    for (name, expected) in expected.as_object().unwrap() {
        let output = read(&python, &folder.join(name), &[]);
        if output.status.code() == Some(2) && name == "small.esker" {
            println!("skipped: this Python has no Zstandard");
            continue;
        }
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        let reported: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        for member in [
            "points",
            "multiset_hash",
            "footer_hash",
            "compress",
            "normals",
            "attributes",
            "classes",
        ] {
            assert_eq!(reported[member], expected[member], "{name}: {member}");
        }
    }
}

#[test]
fn the_python_reader_finds_damage() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 60, 20, 5);
    tree::write(&path, &tree::metadata(schema, classes), &points, 25);
    let good = contents(&path);
    for step in 0..12 {
        let mut bad = good.clone();
        bad[step * (good.len() - 1) / 11] ^= 4;
        std::fs::write(&path, bad).unwrap();
        let output = read(&python, &path, &[]);
        assert_eq!(output.status.code(), Some(1), "damage {step}");
        assert!(String::from_utf8_lossy(&output.stdout).contains("\"ok\": false"));
    }
    std::fs::write(&path, &good[..good.len() - 1]).unwrap();
    assert_eq!(read(&python, &path, &[]).status.code(), Some(1));
}

#[test]
fn its_hash_is_xxh3_at_every_length() {
    let Some(python) = python() else { return };
    let folder = PathBuf::from("../../data-format");
    let code = "import numpy as np, xxh3\n\
        for n in range(1, 1301):\n\
        \x20   rows = (np.arange(3 * n).reshape(3, n) * 167 % 251).astype(np.uint8)\n\
        \x20   print('%032x' % xxh3.hash128_sum(rows, 0x9e3779b97f4a7c15 * n % 2**64))";
    let command = Command::new(python).args(["-B", "-c", code]).current_dir(folder).output();
    let output = command.unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let reported: Vec<&str> = text.lines().collect();
    assert_eq!(reported.len(), 1300, "{}", String::from_utf8_lossy(&output.stderr));
    for (n, reported) in (1usize..).zip(reported) {
        let bytes: Vec<u8> = (0..3 * n).map(|i| (i * 167 % 251) as u8).collect();
        let seed = 0x9e37_79b9_7f4a_7c15u64.wrapping_mul(n as u64);
        let mut hash = esker_points::MultisetHash::default();
        bytes.chunks_exact(n).for_each(|row| hash.add(seed, row));
        assert_eq!(reported, hash.to_string(), "length {n}");
    }
}

/// Prints for each file whether the Python reader accepts it; anything but a fault that it knows
/// ends it with a traceback.
const VERDICTS: &str = "import sys, reader, codec\n\
    for path in sys.stdin.read().split():\n\
    \x20   try: reader.check(reader.Esker(path), False); print('ok')\n\
    \x20   except codec.NoLibrary: print('unknown')\n\
    \x20   except reader.FAULTS as fault: print('refused:', type(fault).__name__, str(fault)[:200])";

/// Mutations that are compared; `ESKER_VERDICTS` sets another number.
const MUTATIONS: usize = 600;

#[test]
fn both_readers_accept_and_refuse_the_same_files() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("good.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 40, 20, 3);
    let mut metadata = tree::metadata(schema, classes);
    metadata.set_aside = tree::set_aside(&metadata);
    tree::write(&path, &metadata, &points, 15);
    let samples = Path::new("../../data-format/samples");
    let degrees = folder.path().join("degrees.esker");
    tree::write(&degrees, &tree::in_degrees(metadata.clone()), &points, 15);
    let parts = folder.path().join("parts.esker");
    let sizes = PartSizes { from_nodes: 1, part_nodes: 4, top_nodes: 9 };
    tree::write_parts(&parts, &metadata, (&points, 4), sizes);
    let samples_of_1 = ["all-kinds.esker", "forest-second.esker"].map(|name| samples.join(name));
    let seeds = samples_of_1.into_iter().chain([path, degrees, parts]);
    let seeds: Vec<_> = seeds.map(|seed| contents(&seed)).collect();
    let wanted = std::env::var("ESKER_VERDICTS").ok().and_then(|n| n.parse().ok());
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let (mut paths, mut list) = (Vec::new(), String::new());
    for number in 0..wanted.unwrap_or(MUTATIONS) {
        let path = folder.path().join(format!("{number}.esker"));
        std::fs::write(&path, mutate::mutate(&seeds[number % seeds.len()], &mut random)).unwrap();
        writeln!(list, "{}", path.display()).unwrap();
        paths.push(path);
    }
    let listed = folder.path().join("list");
    std::fs::write(&listed, list).unwrap();
    let output = Command::new(&python)
        .args(["-B", "-W", "ignore", "-c", VERDICTS])
        .current_dir("../../data-format")
        .stdin(std::fs::File::open(&listed).unwrap())
        .output()
        .unwrap();
    let verdicts = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(verdicts.lines().count(), paths.len(), "{errors}");
    let (mut differences, mut accepted) = (String::new(), 0);
    for (path, theirs) in paths.iter().zip(verdicts.lines()) {
        let ours = EskerFile::open(path).and_then(|file| verify(&file, &Silent));
        let is_accepted = ours.is_ok();
        accepted += usize::from(is_accepted);
        if theirs != "unknown" && (theirs == "ok") != is_accepted {
            let ours = ours.map_or_else(|e| e.to_string(), |_| "ok".into());
            writeln!(differences, "{}: {ours}; Python: {theirs}", path.display()).unwrap();
        }
    }
    // Both verdicts occur: mutations are neither all fatal nor all harmless.
    assert!(accepted > 0 && accepted < paths.len(), "{accepted}");
    if !differences.is_empty() {
        let kept = folder.keep();
        panic!("the verdicts on files in {} differ:\n{differences}", kept.display());
    }
}
