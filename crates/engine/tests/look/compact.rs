//! Compact planes from a build to a picture: two thirds of the bytes, nearly the same picture, from
//! files, sessions and forests; and full planes where a picture needs more than the compact ones
//! have.

use super::look::{off, request, session};
use esker_engine::calls::render::draw;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_engine::draw::session::Settings;
use esker_engine::{Filter, Method};
use esker_format::{Forest, PlaneKind};
use esker_points::task::Silent;
use esker_truth::flip::mean_flip;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// The project's sample scan, which has colours, with a compact plane; built once for all tests.
fn creek() -> &'static Path {
    static CREEK: OnceLock<PathBuf> = OnceLock::new();
    CREEK.get_or_init(|| {
        let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
        let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("compact-creek.esker");
        let options =
            esker_builder::Options { node_capacity: 4096, compact: true, ..Default::default() };
        esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
        out
    })
}

/// Bytes of planes, without residuals.
fn bytes_of(scene: &PictureScene) -> usize {
    let kinds = scene.planes.iter().flat_map(|planes| {
        [PlaneKind::Position, PlaneKind::Colour, PlaneKind::Compact].map(|kind| planes.get(kind))
    });
    kinds.flatten().map(<[u8]>::len).sum()
}

#[test]
fn a_compact_picture_is_near_the_full_one_and_takes_two_thirds_of_the_bytes() {
    let file = Forest::open(creek()).unwrap();
    for method in [Method::Points, Method::PullPush, Method::Ewa] {
        let [full, compact] =
            [true, false].map(|full| PictureRequest { method, full, ..request() });
        let scenes = [&full, &compact]
            .map(|picture_request| PictureScene::read(&file, picture_request, &Silent).unwrap());
        let [all, some] = [&scenes[0], &scenes[1]].map(bytes_of);
        assert_eq!(all * 2, some * 3);
        let [full, compact] = [full, compact]
            .map(|picture_request| draw(&file, &picture_request, &Silent).unwrap().0);
        assert_eq!(full.depth, compact.depth, "points stay where they are");
        assert_ne!(full.rgba, compact.rgba, "colours do not");
        let off = off(&full, &compact);
        let flip = mean_flip(&full.rgba, &compact.rgba, full.width as usize);
        // Over covered pixels: how many there are does not depend on codes.
        let covered = full.depth.iter().filter(|d| d.is_finite()).count() as f64;
        let flip = flip * full.depth.len() as f64 / covered;
        println!("{method:?}: {off} of the pixels off, FLIP {flip}");
        assert!(off <= 0.005 && flip <= 0.045, "{method:?}: {off} of the pixels off, FLIP {flip}");
    }
}

#[test]
fn a_session_streams_two_thirds_of_the_bytes_and_draws_the_same_picture() {
    let file = Arc::new(Forest::open(creek()).unwrap());
    let view = PictureScene::choose(&file, &request()).unwrap().view;
    let bytes = [true, false].map(|full| {
        let (expected, _) = draw(&file, &PictureRequest { full, ..request() }, &Silent).unwrap();
        let mut session = session(&file, Settings { full, ..Settings::default() });
        let cut = session.settle(&view, Duration::from_secs(60)).unwrap();
        assert!(session.frame(&view).unwrap().cut.complete);
        assert!(off(&session.picture().unwrap(), &expected) <= 0.001);
        let of = |kind| {
            let slots = cut.nodes.iter().filter_map(|n| n.slot(kind));
            slots.map(|slot| slot.bytes).sum::<u64>()
        };
        [PlaneKind::Position, PlaneKind::Colour, PlaneKind::Compact].map(of)
    });
    let [[position, colour, none], [no_position, no_colour, compact]] = bytes;
    assert_eq!((none, no_position, no_colour), (0, 0, 0));
    assert_eq!((position, position), (colour * 2, compact));
}

#[test]
fn other_colours_filters_and_exposure_compensation_use_full_planes() {
    let file = Forest::open(creek()).unwrap();
    let kinds = |picture_request: PictureRequest| {
        let scene = PictureScene::read(&file, &picture_request, &Silent).unwrap();
        let has = |kind| scene.planes.iter().any(|planes| planes.get(kind).is_some());
        [PlaneKind::Position, PlaneKind::Colour, PlaneKind::Compact].map(has)
    };
    let by = |name: &str| PictureRequest { colour_by: Some(name.into()), ..request() };
    assert_eq!(kinds(request()), [false, false, true]);
    assert_eq!(kinds(by("rgb")), [false, false, true]);
    assert_eq!(kinds(by("intensity")), [true, false, false]);
    assert_eq!(kinds(by("elevation")), [true, false, false]);
    assert_eq!(kinds(PictureRequest { evens_exposure: true, ..request() }), [true, true, false]);
    // A filter marks points in the byte that palette indices take.
    let [low, high] = esker_engine::calls::info::bounds(&file);
    let middle = |axis: usize| (low[axis] + high[axis]) / 2.0;
    let bounds = format!("{},{},{},{}", low[0], low[1], middle(0), middle(1));
    let filter = Filter { bounds: Some(bounds.parse().unwrap()), ..Filter::default() };
    assert_eq!(kinds(PictureRequest { filter, ..request() }), [true, true, false]);
}

#[test]
fn a_forest_of_one_palette_is_drawn_from_compact_planes() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.esker", "b.esker"].map(|name| folder.path().join(name));
    let options =
        esker_builder::Options { node_capacity: 1024, compact: true, ..Default::default() };
    let scans = ["synthetic:office:20k:1", "synthetic:office:20k:2"].map(PathBuf::from);
    esker_builder::build(&scans[..1], &a, &options, &Silent).unwrap();
    esker_builder::append(&a, &scans[1..], &b, &options, &Silent).unwrap();
    let file = Forest::open(&b).unwrap();
    let picture_request = PictureRequest { target_spacing_px: 0.0, ..request() };
    let scene = PictureScene::read(&file, &picture_request, &Silent).unwrap();
    assert!(scene.planes.len() > 1);
    assert!(scene.planes.iter().all(|planes| planes.get(PlaneKind::Compact).is_some()));
    let [full, compact] = [true, false].map(|full| {
        draw(&file, &PictureRequest { full, ..picture_request.clone() }, &Silent).unwrap().0
    });
    assert_eq!(full.depth, compact.depth);
    let off = off(&full, &compact);
    assert!(off <= 0.01, "{off} of the pixels are off");
}
