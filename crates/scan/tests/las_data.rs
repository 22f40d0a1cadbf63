//! The LAS and LAZ files of the data folder: all good ones are read with the count of the manifest,
//! LAS/LAZ pairs hold the same points, bad ones end in an error or a note.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use esker_points::hash::{MultisetHash, layout_seed};
use esker_points::lattice::Lattice;
use esker_points::task::Silent;
use esker_scan::{OpenOptions, ScanError};
use std::path::Path;

mod data;

use data::Entry;

/// Number of points, multiset hash and notes.
fn read(path: &Path) -> Result<(u64, MultisetHash, Vec<String>), ScanError> {
    let source = esker_scan::open(path, &OpenOptions::default(), &Silent)?;
    let grid = &source.info().grid;
    let placement = Lattice::choose(std::slice::from_ref(grid)).unwrap().placement(grid);
    let seed = layout_seed(source.info().schema.attributes.iter().map(|a| a.key()));
    let (mut hash, mut record) = (MultisetHash::default(), Vec::new());
    let report = source.read(&placement, &Silent, &mut |batch| {
        for i in 0..batch.len() {
            record.clear();
            batch.record_into(i, &mut record);
            hash.add(seed, &record);
        }
        Ok(())
    })?;
    assert_eq!(report.rounding_error_max, 0.0);
    Ok((report.points, hash, [source.info().notes.clone(), report.notes].concat()))
}

/// Written with a LASzip record that lacks the waveform fields: refused by name.
const REFUSED: [&str; 2] = ["las/pdrf/10pts-pdrf9.laz", "las/pdrf/10pts-pdrf10.laz"];

#[test]
fn good_files_have_the_manifests_count() {
    let Some(data) = data::folder() else { return };
    let mut files = 0;
    for Entry { name, points, .. } in data::manifest(&data) {
        let is_las = name.ends_with(".las") || name.ends_with(".laz");
        if !is_las || name.starts_with("bad/") || REFUSED.contains(&name.as_str()) {
            continue;
        }
        assert_eq!(Some(read(&data.join(&name)).unwrap().0), points, "{name}");
        files += 1;
    }
    assert!(files > 60, "{files}");
}

#[test]
fn files_that_lack_fields_are_refused_by_name() {
    let Some(data) = data::folder() else { return };
    for name in REFUSED {
        let error = read(&data.join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("fields are missing"), "{error}");
    }
}

#[test]
fn las_and_laz_of_the_same_scan_have_the_same_points() {
    let Some(data) = data::folder() else { return };
    let mut pairs = 0;
    for folder in ["laz/pairs", "las/pdrf"] {
        for entry in std::fs::read_dir(data.join(folder)).unwrap() {
            let laz = entry.unwrap().path();
            let las = laz.with_extension("las");
            if laz.extension().is_some_and(|e| e == "laz") && las.exists() && !is_refused(&laz) {
                assert_eq!(read(&laz).unwrap().1, read(&las).unwrap().1, "{}", laz.display());
                pairs += 1;
            }
        }
    }
    assert!(pairs >= 16, "{pairs}");
    let hash = |name: &str| read(&data.join(name)).unwrap().1;
    let old = hash("laz/simple-laszip-compressor-version-1.2r0.laz");
    assert_eq!(old, hash("laz/simple.laz"));
    assert_eq!(old, hash("laz/laszip-2-bytes-padding.laz"));
    assert_eq!(hash("laz/laspy-1_4-evlr.laz"), hash("las/laspy-1_4-evlr.las"));
}

fn is_refused(path: &Path) -> bool {
    REFUSED.iter().any(|name| path.ends_with(name))
}

#[test]
fn bad_files_end_in_one_line_or_say_what_was_left_out() {
    let Some(data) = data::folder() else { return };
    for (name, what) in [
        ("laszip-broken-coder.laz", "LASzip coder 15"),
        ("laszip-broken-compressor.laz", "LASzip compressor 16"),
        ("laszip-broken-size.laz", "version 6"),
        ("no-points-but-count-1065.las", "claims 1065 points"),
        ("trunc-half.laz", "cut short"),
        ("trunc-header.las", "200 bytes"),
        ("trunc-points.las", "claims 14408 points, but there are bytes for 14378"),
        ("bitflips.laz", "cut short or damaged"),
        ("offset-past-end.las", "byte 2147483647"),
        ("scale-nan.las", "the scale of axis x is NaN"),
        ("zero-length.las", "empty"),
    ] {
        let error = read(&data.join("bad").join(name)).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains(what), "{error}");
        assert!(!error.contains('\n'), "{error}");
    }
    for (name, points, note) in [
        ("bad_vlr_count.las", 10, "claims 3 VLRs"),
        ("bad-geotiff-keys.las", 10, "GeoTIFF keys"),
        ("malformed-extra-bytes.las", 10, "kept raw"),
        ("huge-count.las", 1, "4294967295"),
    ] {
        let (read_points, _, notes) = read(&data.join("bad").join(name)).unwrap();
        assert_eq!(read_points, points);
        assert!(notes.iter().any(|n| n.contains(note)), "{name}: {notes:?}");
    }
    for (name, points) in [("gps-time-nan.las", 1), ("laz-pdal-fail.laz", 89)] {
        assert_eq!(read(&data.join("bad").join(name)).unwrap().0, points);
    }
}
