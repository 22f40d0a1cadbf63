//! Written files hold the generated points with all fields, and LAS and LAZ readers accept them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_points::hash::layout_seed;
use esker_points::task::Silent;
use esker_points::{Lattice, MultisetHash};
use esker_scan::{OpenOptions, Source};
use std::path::{Path, PathBuf};

/// Counts and hashes all points on the lattice of the scan's own grid.
fn points_and_hash(source: &dyn Source) -> (u64, MultisetHash) {
    let grid = &source.info().grid;
    let placement = Lattice::choose(std::slice::from_ref(grid)).unwrap().placement(grid);
    let (mut hash, mut record) = (MultisetHash::default(), Vec::new());
    let report = source.read(&placement, &Silent, &mut |batch| {
        let seed = layout_seed(batch.schema.attributes.iter().map(|a| a.key()));
        for i in 0..batch.len() {
            record.clear();
            batch.record_into(i, &mut record);
            hash.add(seed, &record);
        }
        Ok(())
    });
    (report.unwrap().points, hash)
}

fn scan(path: &Path) -> Box<dyn Source> {
    esker_scan::open(path, &OpenOptions::default(), &Silent).unwrap()
}

/// Writes a scan to a file with this extension and reads it again. Returns the file's bytes.
fn comes_back(spec: &str, ending: &str) -> u64 {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join(format!("out.{ending}"));
    let source = scan(Path::new(spec));
    let bytes = esker_generate::write(source.as_ref(), &out, &Silent).unwrap();
    let back = scan(&out);
    assert_eq!(points_and_hash(back.as_ref()), points_and_hash(source.as_ref()), "{spec}");
    let (info, own) = (back.info(), source.info());
    assert_eq!(info.points_hint, own.points_hint);
    assert_eq!(info.format, format!("{} 1.4, point format 7", ending.to_uppercase()));
    assert_eq!((&info.crs, &info.grid.grid), (&own.crs, &own.grid.grid));
    assert_eq!(info.grid.bounds, source.survey(&Silent).unwrap().bounds());
    assert!(info.notes.is_empty(), "{:?}", info.notes);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
    bytes
}

#[test]
fn every_scene_comes_back_from_las_and_laz() {
    for scene in esker_scan::synthetic::SCENES {
        for ending in ["las", "laz"] {
            comes_back(&format!("synthetic:{}:120k:2", scene.name), ending);
        }
    }
}

#[test]
fn a_scan_of_no_points_comes_back() {
    for ending in ["las", "laz"] {
        comes_back("synthetic:office:0", ending);
    }
}

#[test]
fn the_terrain_takes_ten_to_eleven_bytes_a_point_as_laz() {
    let bytes = comes_back("synthetic:terrain:200k:1", "laz");
    let each = bytes as f64 / 200_000.0;
    assert!((10.0..=11.0).contains(&each), "{each} bytes a point");
}

#[test]
fn a_mesh_is_written_as_ply_only() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = esker_generate::mesh(Path::new("mesh:hall:20k")).unwrap().unwrap();
    let out = folder.path().join("hall.ply");
    let bytes = esker_generate::write_mesh(&mesh, &out).unwrap();
    assert_eq!(bytes, out.metadata().unwrap().len());
    let back = esker_scan::mesh::read(&out, &Silent).unwrap();
    assert_eq!(back.triangles, mesh.triangles);
    let error = esker_generate::write_mesh(&mesh, Path::new("hall.laz")).unwrap_err();
    assert!(error.to_string().contains("name the file .ply"), "{error}");
    assert!(esker_generate::mesh(Path::new("synthetic:office:10")).unwrap().is_none());
}

#[test]
fn what_is_no_generated_scan_or_no_file_name_is_refused() {
    let error = esker_generate::open(Path::new("scan.laz"), &Silent).err().unwrap().to_string();
    assert!(error.starts_with("scan.laz: is no generated scan"), "{error}");
    let source = scan(Path::new("synthetic:office:10"));
    let error = esker_generate::write(source.as_ref(), &PathBuf::from("out.txt"), &Silent);
    assert!(error.unwrap_err().to_string().contains("name the file .laz or .las"));
}
