//! Exposure compensation: the plane that it needs beside colours is read only if it is requested.

use super::look::{camera_of, off, request, session, terrain};
use esker_engine::calls::render::draw;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::session::Settings;
use esker_format::{Forest, PlaneKind};
use esker_points::task::Silent;
use std::sync::Arc;
use std::time::Duration;

fn rgb_request(evens_exposure: bool) -> PictureRequest {
    PictureRequest { colour_by: Some("rgb".into()), evens_exposure, ..request() }
}

#[test]
fn exposure_compensation_reads_the_scan_numbers_of_points() {
    let file = Forest::open(terrain()).unwrap();
    let [plain, evened] = [false, true]
        .map(|evens_exposure| PictureScene::read(&file, &rgb_request(evens_exposure), &Silent));
    let (plain, evened) = (plain.unwrap(), evened.unwrap());
    assert!(evened.plan.evens_exposure() && !plain.plan.evens_exposure());
    assert!(evened.read_bytes > plain.read_bytes);
    let bytes = |scene: &PictureScene| scene.planes.iter().map(|p| p.bytes()).sum::<u64>();
    assert_eq!(bytes(&evened), bytes(&plain), "resident planes have the same size");
    let kind = PlaneKind::Attribute(file.schema().find("point_source_id").unwrap() as u16);
    let mut scans = [0; 256];
    for (i, drawn) in evened.selection.drawn.iter().enumerate() {
        let ids = file.read_planes(drawn.node, &[kind]).unwrap();
        let ids = ids.get(kind).unwrap().as_chunks::<2>().0;
        let [with, without] = [&evened, &plain]
            .map(|scene| scene.planes[i].get(PlaneKind::Colour).unwrap().as_chunks::<4>().0);
        for ((with, without), id) in with.iter().zip(without).zip(ids) {
            assert_eq!(with[..3], without[..3]);
            assert_eq!(u16::from(with[3]), u16::from_le_bytes(*id) % 251);
            scans[usize::from(with[3])] += 1;
        }
    }
    assert!(scans.into_iter().filter(|&points| points > 100).count() > 1, "{scans:?}");
    // Exposures are removed neither from points nor from other colours.
    let elevation = PictureRequest { colour_by: Some("elevation".into()), ..rgb_request(true) };
    let scene = PictureScene::choose(&file, &elevation).unwrap();
    assert!(!scene.plan.evens_exposure() && scene.appearance.evens_exposure);
}

#[test]
fn a_session_removes_differences_of_exposure_like_a_picture() {
    let file = Arc::new(Forest::open(terrain()).unwrap());
    let scene = PictureScene::choose(&file, &rgb_request(true)).unwrap();
    let camera = camera_of(&scene);
    let [plain, expected] = [false, true].map(|evens_exposure| {
        draw(&file, &PictureRequest { camera, ..rgb_request(evens_exposure) }, &Silent).unwrap().0
    });
    assert!(plain.rgba != expected.rgba);
    let settings =
        Settings { colour_by: Some("rgb".into()), evens_exposure: true, ..Settings::default() };
    let mut session = session(&file, settings);
    session.settle(&scene.view, Duration::from_secs(60)).unwrap();
    assert!(session.frame(&scene.view).unwrap().cut.complete);
    let off = off(&session.picture().unwrap(), &expected);
    assert!(off <= 0.001, "{off} of the pixels differ");
}

#[test]
fn exposure_compensation_of_a_file_without_scan_numbers_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, out) = (folder.path().join("a.ply"), folder.path().join("a.esker"));
    let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n";
    let colours = "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    std::fs::write(&scan, format!("{head}{colours}0 0 0 9 9 9\n1 1 1 9 9 9\n")).unwrap();
    esker_builder::build(&[scan], &out, &esker_builder::Options::default(), &Silent).unwrap();
    let file = Forest::open(&out).unwrap();
    let error = PictureScene::choose(&file, &rgb_request(true)).err().unwrap().to_string();
    assert!(error.contains("point_source_id or scan or scan_id"), "{error}");
    assert!(PictureScene::choose(&file, &rgb_request(false)).is_ok());
}
