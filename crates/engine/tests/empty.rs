//! Pictures of scans without points: empty ones with a note, whatever the format. A format that
//! keeps floating-point numbers has a lattice for them that no point has chosen.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_engine::calls::render;
use esker_engine::draw::scene::PictureRequest;
use esker_points::task::Silent;
use std::path::PathBuf;

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n\
                   property float z\nend_header\n";
const PCD: &str = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n\
                   WIDTH 0\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 0\nDATA ascii\n";

#[test]
fn a_scan_without_points_gives_an_empty_picture_whatever_its_format() {
    let folder = tempfile::tempdir().unwrap();
    let texts = [("a.ply", PLY), ("a.pcd", PCD), ("a.xyz", "x y z\n")];
    let mut scans: Vec<PathBuf> = texts
        .iter()
        .map(|(name, text)| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        })
        .collect();
    match std::env::var_os("ESKER_DATA").map(PathBuf::from) {
        Some(data) => scans.extend(
            ["e57/empty.e57", "e57/empty_pc.e57", "las/no-points.las"].map(|n| data.join(n)),
        ),
        None => eprintln!("E57 and LAS skipped: ESKER_DATA names no folder of scans"),
    }
    let out = folder.path().join("picture.png");
    for scan in scans {
        for camera in ["", "ortho=fit;direction=0,0,-1", "eye=1e6,2e6,30;direction=1,0,0"] {
            let camera = camera.parse().unwrap();
            let request = PictureRequest { size: [40, 30], camera, ..PictureRequest::of_options() };
            let report =
                render::render(std::slice::from_ref(&scan), &out, &request, &Silent).unwrap();
            assert_eq!(report.points_drawn, 0, "{}", scan.display());
            let text = render::text(&report);
            assert!(text.contains("there are no points"), "{}: {text}", scan.display());
        }
    }
}
