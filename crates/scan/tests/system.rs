//! Coordinate reference systems and units of inputs that do not state them: from a `.prj` file, or
//! from the user; and notes on coordinates in degrees.

#![allow(clippy::unwrap_used, reason = "what a test cannot do without ends it")]

use esker_points::task::Silent;
use esker_scan::{Crs, OpenOptions, SourceInfo};
use std::path::Path;

const WKT: &str = r#"PROJCS["P",UNIT["US survey foot",0.3048006096012192]]"#;

fn info(path: &Path, options: &OpenOptions) -> SourceInfo {
    esker_scan::open(path, options, &Silent).unwrap().info().clone()
}

#[test]
fn systems_and_units_come_from_the_file_beside_or_from_the_user() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    std::fs::write(&path, "1 2 3\n").unwrap();
    let none = OpenOptions::default();
    assert_eq!(info(&path, &none).crs, None);
    let crs: Crs = "EPSG:2154".parse().unwrap();
    let unit = Some("metre".to_owned());
    let both = OpenOptions { crs: Some(crs.clone()), unit: unit.clone(), ..none.clone() };
    assert_eq!(info(&path, &both).crs, Some(Crs { unit: unit.clone(), ..crs }));
    let alone = OpenOptions { unit: unit.clone(), ..none.clone() };
    assert_eq!(info(&path, &alone).crs, Some(Crs { text: String::new(), unit }));
    // What lies beside the file goes before what the user says of all files.
    std::fs::write(folder.path().join("a.prj"), WKT).unwrap();
    let beside = info(&path, &both);
    let foot = Some("US survey foot".to_owned());
    assert_eq!(beside.crs, Some(Crs { text: WKT.into(), unit: foot }));
    let has = |notes: &[String], words: &str| notes.iter().any(|note| note.contains(words));
    assert!(has(&beside.notes, "its coordinate reference system is that of a.prj beside it"));
    assert!(has(&beside.notes, "its unit is US survey foot, as it states"));
    std::fs::write(folder.path().join("a.prj"), "Projection UTM").unwrap();
    let malformed = info(&path, &none);
    assert_eq!(malformed.crs, None);
    assert!(has(&malformed.notes, "a.prj beside it holds no system"));
}

#[test]
fn degrees_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    std::fs::write(&path, "7.25 47.5 300\n").unwrap();
    let options = OpenOptions { crs: Some("EPSG:4326".parse().unwrap()), ..OpenOptions::default() };
    let notes = info(&path, &options).notes;
    assert!(notes.iter().any(|note| note.contains("x and y are degrees")), "{notes:?}");
}

#[test]
fn files_with_a_system_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("system.wkt");
    for (text, want) in
        [(WKT, WKT), ("\u{feff}EPSG:2154\r\n", "GeoTIFF: GTModelType=1 ProjectedCSType=2154")]
    {
        std::fs::write(&path, text).unwrap();
        assert_eq!(esker_scan::system::read_crs(&path).unwrap().text, want);
    }
    std::fs::write(&path, "{\"type\": \"ProjectedCRS\"}").unwrap();
    let error = esker_scan::system::read_crs(&path).unwrap_err().to_string();
    assert!(error.contains("system.wkt: is JSON, which is not read"), "{error}");
}
