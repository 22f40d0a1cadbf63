//! What sources state beside their points is carried by text and PLY, or a note names it: epoch of
//! GPS times, no-data values, reference systems, names.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(clippy::disallowed_methods, reason = "reads back whole what the test itself wrote")]

#[allow(dead_code, reason = "each test file uses a part of it")]
mod las_writer;

use esker_points::lattice::Lattice;
use esker_points::task::Silent;
use esker_points::{AttrType, Attribute, Batch, Schema};
use esker_scan::las::{GpsTimes, NoData, gps_times};
use esker_scan::write::{self, Origin, Outline, Target};
use esker_scan::{Crs, OpenOptions, Source};
use las_writer::{File, Point, Variant};
use std::path::Path;
use std::sync::Arc;

fn open(path: &Path) -> Box<dyn Source> {
    esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap()
}

fn read(source: &dyn Source) -> (Lattice, Batch) {
    let grid = &source.info().grid;
    let lattice = Lattice::choose(std::slice::from_ref(grid)).unwrap();
    let mut batches = Vec::new();
    let mut sink = |batch| {
        batches.push(batch);
        Ok(())
    };
    source.read(&lattice.placement(grid), &Silent, &mut sink).unwrap();
    (lattice, batches.remove(0))
}

/// Writes a batch of these sources; returns the notes.
fn write(path: &Path, lattice: Lattice, origins: &[Origin], batch: &Batch) -> String {
    let outline = Outline {
        lattice,
        schema: batch.schema.clone(),
        points_max: batch.len() as u64,
        ranges: Vec::new(),
        classes: Vec::new(),
    };
    let target = Target::of(path).unwrap();
    let mut all = origins.iter().cloned().map(Ok);
    let mut export = write::create(path, target, &outline, &mut all).unwrap();
    export.output.put(export.encode.encode(batch)).unwrap();
    export.output.finish().unwrap();
    export.notes.join("\n")
}

/// A source again as a file of another format.
fn rewritten(source: &dyn Source, path: &Path) -> (Box<dyn Source>, String) {
    let (lattice, batch) = read(source);
    let notes = write(path, lattice, &[Origin::from(source.info())], &batch);
    (open(path), notes)
}

#[test]
fn the_epoch_of_gps_times_survives_ply_and_is_concluded_from_text() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (times, name, second) in
        [(GpsTimes::Week, "week", 1.5), (GpsTimes::Adjusted, "adjusted standard", 3.0e8)]
    {
        let mut point = Point { position: [1, 2, 3], fields: [0; 60], extra: vec![] };
        point.fields[11..19].copy_from_slice(&f64::to_le_bytes(second));
        let variant = Variant { format: 1, minor: 2, extra: 0 };
        let mut las = File { variant, points: vec![point], vlrs: vec![] }.las();
        las[6] = u8::from(times == GpsTimes::Adjusted);
        std::fs::write(at("in.las"), las).unwrap();
        let source = open(&at("in.las"));
        assert_eq!(gps_times(&source.info().verbatim), Some(times));
        let (ply, _) = rewritten(source.as_ref(), &at("out.ply"));
        let text = String::from_utf8_lossy(&std::fs::read(at("out.ply")).unwrap()).into_owned();
        assert!(text.contains(&format!("\ncomment gps_time {name}\n")), "{text}");
        assert_eq!(gps_times(&ply.info().verbatim), Some(times));
        let (csv, notes) = rewritten(source.as_ref(), &at("out.csv"));
        assert!(notes.contains("text does not state that GPS times are"), "{notes}");
        let concluded = (times == GpsTimes::Adjusted).then_some(times);
        assert_eq!(gps_times(&csv.info().verbatim), concluded);
        for source in [ply, csv] {
            let (las, notes) = rewritten(source.as_ref(), &at("back.las"));
            assert_eq!(gps_times(&las.info().verbatim), Some(times));
            let is_adjusted = times == GpsTimes::Adjusted;
            assert_eq!(notes.contains("the global encoding says"), is_adjusted, "{notes}");
        }
    }
}

/// A LAS file with heights in steps of 0.01, one of which is `none`, its no-data value.
fn heights(none: i16) -> Vec<u8> {
    let mut description = vec![0u8; 192];
    // Signed 16 bits; no data, scale.
    description[2..4].copy_from_slice(&[4, 0b1001]);
    description[4..7].copy_from_slice(b"hgt");
    description[40..48].copy_from_slice(&i64::from(none).to_le_bytes());
    description[112..120].copy_from_slice(&0.01f64.to_le_bytes());
    let point = |x, value: i16| {
        let extra = value.to_le_bytes().to_vec();
        Point { position: [x, 2, 3], fields: [0; 60], extra }
    };
    let variant = Variant { format: 0, minor: 4, extra: 2 };
    let vlrs = vec![("LASF_Spec".into(), 4, description)];
    File { variant, points: vec![point(1, 150), point(2, none)], vlrs }.las()
}

#[test]
fn no_data_is_an_empty_cell_in_text_and_noted_in_ply() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("in.las"), heights(-32768)).unwrap();
    let source = open(&at("in.las"));
    for (name, ending, how) in
        [("a.csv", ",", "written as empty cells"), ("a.xyz", " nan", "written as nan")]
    {
        let (back, notes) = rewritten(source.as_ref(), &at(name));
        assert!(notes.contains(&format!("no-data values are {how}: hgt (-327.68)")), "{notes}");
        let text = std::fs::read_to_string(at(name)).unwrap();
        let column = text.lines().next().unwrap().split([',', ' ']).position(|n| n == "hgt");
        let cell = text.lines().nth(2).unwrap().split([',', ' ']).nth(column.unwrap()).unwrap();
        assert_eq!(cell, ending.trim_start_matches([',', ' ']), "{text}");
        let (_, batch) = read(back.as_ref());
        let hgt = batch.schema.find("hgt").unwrap();
        let ty = batch.schema.attributes[hgt].ty;
        let values: Vec<f64> = batch.columns[hgt].chunks(ty.size()).map(|v| ty.to_f64(v)).collect();
        assert!(values[0] == 1.5 && values[1].is_nan(), "{values:?}");
    }
    let (_, notes) = rewritten(source.as_ref(), &at("a.ply"));
    assert!(notes.contains("no-data values are written as numbers: hgt (-327.68)"), "{notes}");
    // Sources that disagree are named, and their values stay numbers.
    std::fs::write(at("other.las"), heights(-1)).unwrap();
    let other = open(&at("other.las"));
    let origins = [source.info().into(), other.info().into()];
    let (lattice, batch) = read(source.as_ref());
    for name in ["b.csv", "b.ply", "b.las"] {
        let notes = write(&at(name), lattice, &origins, &batch);
        assert!(notes.contains("hgt (-32768, -1)"), "{name}: {notes}");
    }
    assert!(std::fs::read_to_string(at("b.csv")).unwrap().contains("-327.68"));
    let mut no_data = NoData::default();
    no_data.add(&source.info().verbatim);
    assert!(no_data.conflicts().is_empty());
    no_data.add(&[]);
    no_data.add(&other.info().verbatim);
    assert_eq!(no_data.conflicts(), ["hgt (-32768, -1)"]);
}

#[test]
fn changed_names_and_lost_reference_systems_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("in.csv"), "x,y,z,a\n1,2,3,4\n").unwrap();
    let source = open(&at("in.csv"));
    let (lattice, mut batch) = read(source.as_ref());
    let crs = |text: &str| Some(Crs { text: text.into(), unit: Some("metre".into()) });
    let named =
        |name: &str| Arc::new(Schema { attributes: vec![Attribute::new(name, AttrType::U8)] });
    let mut origin = Origin::from(source.info());
    origin.crs = crs("PROJCS[\"Lambert\",UNIT[\"metre\",1]]");
    let long = "a".repeat(40);
    for (name, path, want) in [
        ("Ring Number", "a.ply", "renamed: `Ring Number` to `Ring_Number`"),
        ("my, col", "a.csv", "renamed: `my, col` to `my_ col`"),
        ("my, col", "a.xyz", "text does not state the coordinate reference system, Lambert"),
        (long.as_str(), "a.las", "names of over 32 bytes are cut"),
    ] {
        batch.schema = named(name);
        let notes = write(&at(path), lattice, std::slice::from_ref(&origin), &batch);
        assert!(notes.contains(want), "{path}: {notes}");
        assert_eq!(notes.contains("reference system"), !path.ends_with("s") && path != "a.ply");
    }
    origin.crs = crs("");
    let notes = write(&at("a.ply"), lattice, std::slice::from_ref(&origin), &batch);
    assert!(notes.contains("does not state the unit of length, metre"), "{notes}");
    // A second source may be the one that states the system.
    let first = Origin { crs: None, ..origin.clone() };
    origin.crs = crs("EPSG:2154");
    write(&at("a.ply"), lattice, &[first, origin], &batch);
    assert_eq!(open(&at("a.ply")).info().crs.as_ref().unwrap().text, "EPSG:2154");
}

#[test]
fn a_reference_system_that_no_record_states_is_written_to_las() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let point = Point { position: [1, 2, 3], fields: [0; 60], extra: vec![] };
    let variant = Variant { format: 1, minor: 2, extra: 0 };
    std::fs::write(at("in.las"), File { variant, points: vec![point], vlrs: vec![] }.las())
        .unwrap();
    let source = open(&at("in.las"));
    let (lattice, batch) = read(source.as_ref());
    let mut origin = Origin::from(source.info());
    for (text, format) in [
        ("PROJCS[\"Lambert\"]", "LAS 1.4, point format 1"),
        ("GeoTIFF: GTModelType=1 ProjectedCSType=2154", "LAS 1.2, point format 1"),
    ] {
        origin.crs = Some(Crs { text: text.into(), unit: None });
        write(&at("out.las"), lattice, std::slice::from_ref(&origin), &batch);
        let back = open(&at("out.las"));
        assert_eq!(back.info().crs.as_ref().unwrap().text, text);
        assert_eq!(back.info().format, format);
        assert_eq!(read(back.as_ref()).1.columns, batch.columns);
    }
    origin.crs = Some(Crs { text: "my grid".into(), unit: None });
    let notes = write(&at("out.las"), lattice, &[origin], &batch);
    assert!(notes.contains("the coordinate reference system is left out"), "{notes}");
}
