//! Files of version 2: coordinates in degrees stay exact, contours are in metres, and the factors
//! are checked. Version 1 has none.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tree;

use esker_format::footer::FOOTER_BYTES;
use esker_format::{EskerFile, Footer, Forest, FormatError, Metadata, verify};
use esker_points::Lattice;
use esker_points::task::Silent;
use std::path::Path;

/// Bytes of a file in degrees, or in lengths.
fn file(is_in_degrees: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.esker");
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 300, 20, 7);
    let plain = tree::metadata(schema, classes);
    let metadata = if is_in_degrees { tree::in_degrees(plain) } else { plain };
    tree::write(&path, &metadata, &points, 60);
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::fs::File::open(&path).unwrap(), &mut bytes).unwrap();
    bytes
}

fn open(bytes: &[u8]) -> Result<EskerFile, FormatError> {
    EskerFile::from_source(Path::new("a.esker"), Box::new(bytes.to_vec()))
}

fn footer_of(bytes: &[u8]) -> Footer {
    Footer::decode(bytes[bytes.len() - FOOTER_BYTES..].try_into().unwrap()).unwrap()
}

/// The file with `to` in place of the first `from` in its metadata, and checksums that fit.
fn with_metadata(good: &[u8], from: &str, to: &str) -> Vec<u8> {
    let mut footer = footer_of(good);
    let start = footer.metadata.offset as usize;
    let end = start + footer.metadata.bytes as usize;
    let json = String::from_utf8(good[start..end].to_vec()).unwrap();
    assert!(json.contains(from), "{json}");
    let json = json.replacen(from, to, 1);
    let rest = &good[end..good.len() - FOOTER_BYTES];
    let mut bytes = [&good[..start], json.as_bytes(), rest].concat();
    footer.metadata.bytes = json.len() as u64;
    footer.metadata.crc = crc32fast::hash(json.as_bytes());
    footer.verbatim.offset = (start + json.len()) as u64;
    footer.file_bytes = (bytes.len() + FOOTER_BYTES) as u64;
    bytes.extend_from_slice(&footer.encode());
    bytes
}

#[test]
fn only_files_in_degrees_are_of_version_2() {
    let (plain, degrees) = (file(false), file(true));
    for (bytes, version) in [(&plain, 1), (&degrees, 2)] {
        let opened = open(bytes).unwrap();
        assert_eq!((bytes[8], footer_of(bytes).version), (version as u8, version));
        assert_eq!(opened.metadata().version(), version);
        verify(&opened, &Silent).unwrap();
    }
    let text = String::from_utf8_lossy(&plain);
    assert!(!text.contains("factor"));
}

#[test]
fn factors_come_back_to_the_bit_and_give_the_metric_lattice() {
    let opened = open(&file(true)).unwrap();
    let (schema, classes) = tree::mixed_schema();
    let wanted = tree::in_degrees(tree::metadata(schema, classes)).lattice;
    assert_eq!(opened.metadata().lattice, wanted);
    let forest = Forest::from(opened);
    assert_eq!((*forest.lattice(), *forest.metric()), (wanted, wanted.metric()));
    let forest = Forest::from(open(&file(false)).unwrap());
    assert_eq!(forest.lattice(), forest.metric());
}

#[test]
fn every_changed_byte_is_found() {
    let good = file(true);
    for at in (0..64).chain((64..good.len()).step_by(7)) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        let verdict = open(&bad).and_then(|file| verify(&file, &Silent));
        assert!(verdict.is_err(), "byte {at} of {} was missed", good.len());
    }
}

#[test]
fn contours_are_in_metres() {
    // The same contours with other factors are not those of the points.
    let good = file(true);
    let bad = with_metadata(&good, "75840.123456789", "85840.123456789");
    let fault = verify(&open(&bad).unwrap(), &Silent).unwrap_err().to_string();
    assert!(fault.contains("contour"), "{fault}");
}

#[test]
fn unusable_factors_are_refused() {
    let good = file(true);
    let member = "\"factor\":[75840.123456789,111176.3,1.0]";
    for bad in [
        "\"factor\":[0,111176.3,1.0]",
        "\"factor\":[-75840.1,111176.3,1.0]",
        "\"factor\":[75840.1,1e10,1.0]",
        "\"factor\":[75840.1,1e-10,1.0]",
        "\"factor\":[75840.1,111176.3]",
        "\"factor\":[75840.1,111176.3,1,1]",
        "\"factor\":[75840.1,111176.3,\"1\"]",
        "\"factor\":[75840.1,111176.3,null]",
        "\"factor\":[1,1.0,1]",
        "\"factor\":null",
        "\"factors\":[75840.1,111176.3,1.0]",
    ] {
        let error = open(&with_metadata(&good, member, bad)).unwrap_err();
        assert!(matches!(error, FormatError::Damaged { .. }), "{bad}: {error}");
    }
}

#[test]
fn version_1_ignores_a_member_of_that_name() {
    let good = file(false);
    let wanted = open(&good).unwrap().metadata().lattice;
    for member in ["[2,2,2]", "\"x\"", "null", "1e400", "{\"factor\":[]}"] {
        let to = format!("\"lattice\":{{\"factor\":{member},");
        let opened = open(&with_metadata(&good, "\"lattice\":{", &to)).unwrap();
        assert_eq!(opened.metadata().lattice, wanted, "{member}");
        verify(&opened, &Silent).unwrap();
    }
}

#[test]
fn a_header_of_another_version_than_the_footer_is_refused() {
    for (is_in_degrees, other) in [(false, file(true)), (true, file(false))] {
        let mut bytes = file(is_in_degrees);
        bytes[..64].copy_from_slice(&other[..64]);
        let error = open(&bytes).unwrap_err().to_string();
        assert!(error.contains("header"), "{error}");
    }
}

#[test]
fn trees_with_other_factors_do_not_join() {
    let good = file(true);
    let other = with_metadata(&good, "75840.123456789", "75840.123456788");
    let error = Forest::of(open(&good).unwrap(), vec![open(&other).unwrap()]).unwrap_err();
    assert!(error.to_string().contains("lies on another lattice"), "{error}");
    Forest::of(open(&good).unwrap(), vec![open(&good).unwrap()]).unwrap();
}

#[test]
fn products_that_are_no_numbers_are_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let (schema, classes) = tree::mixed_schema();
    let points = tree::points_of(&schema, &classes, 0, 20, 7);
    let metadata = tree::metadata(schema, classes);
    for lattice in [
        Lattice { scale: [1e-305, 1.0, 1.0], factor: [1e-9, 1.0, 1.0], ..metadata.lattice },
        Lattice { offset: [1e305, 0.0, 0.0], factor: [1e9, 1.0, 1.0], ..metadata.lattice },
    ] {
        let metadata = Metadata { lattice, ..metadata.clone() };
        let path = folder.path().join("a.esker");
        let written = std::panic::catch_unwind(|| tree::write(&path, &metadata, &points, 60));
        assert!(written.is_err() && !path.exists());
    }
}
