//! Which axis points upwards: guessed from files whose coordinates are those of a scanner or a
//! model, stated by the user, and z in all others.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use esker_engine::calls::build::build;
use esker_engine::calls::render::draw;
use esker_engine::cameras::camera::Camera;
use esker_engine::cameras::up::{GuessedUp, guessed};
use esker_engine::cameras::vertical::Vertical;
use esker_engine::draw::scene::PictureRequest;
use esker_engine::machine::backend::{Backend, DrawWith};
use esker_engine::{BuildOptions, Forest, Picture};
use esker_points::task::Silent;
use glam::DVec3;
use std::fmt::Write as _;
use std::path::Path;

/// A file built from text of a format.
fn built(folder: &Path, name: &str, text: &str) -> Forest {
    let (scan, out) = (folder.join(name), folder.join(format!("{name}.esker")));
    std::fs::write(&scan, text).unwrap();
    build(&[scan], &out, &BuildOptions::default(), 0, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

/// A ground with some posts on it: at `u` and `v` along the ground, `h` above it.
fn ground() -> Vec<DVec3> {
    let share = |i: u32, k: f64| (f64::from(i) * k).fract();
    let point = |i: u32| {
        let (u, v) = (share(i, 0.754_877_666) * 20.0, share(i, 0.569_840_291) * 15.0);
        let h = if i.is_multiple_of(4) { share(i, 0.381_966) * 2.5 } else { 0.1 * share(i, 0.61) };
        DVec3::new(u, v, h)
    };
    (0..20_000).map(point).collect()
}

fn ply(points: impl Iterator<Item = DVec3>) -> String {
    let mut lines = String::new();
    let count = points.map(|p| writeln!(lines, "{:.4} {:.4} {:.4}", p.x, p.y, p.z)).count();
    format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n{lines}"
    )
}

fn pictured(file: &Forest, camera: &str) -> (Picture, Vec<&'static str>) {
    let request = PictureRequest {
        size: [160, 120],
        camera: Camera::parse(camera).unwrap(),
        colour_by: Some("elevation".into()),
        with: DrawWith { backend: Backend::Cpu, ..DrawWith::default() },
        ..PictureRequest::of_options()
    };
    let (picture, report) = draw(file, &request, &Silent).unwrap();
    (picture, report.notes)
}

#[test]
fn a_scan_that_is_thin_along_an_axis_stands_on_its_ground() {
    let folder = tempfile::tempdir().unwrap();
    for (name, turned, up) in [
        ("y", (|p| DVec3::new(p.x, p.z, -p.y)) as fn(DVec3) -> DVec3, Some("y")),
        ("-y", |p| DVec3::new(p.x, -p.z, p.y), Some("-y")),
        ("z", |p| p, None),
        ("-z", |p| DVec3::new(p.x, -p.y, -p.z), None),
        ("x", |p| DVec3::new(p.z, p.x, p.y), None),
        ("cube", |p| DVec3::new(p.x, p.z * 2.0, p.y), None),
    ] {
        let text = ply(ground().into_iter().map(turned));
        let file = built(folder.path(), &format!("{name}.ply"), &text);
        let guess = guessed(&file);
        let found = guess.map(|guess| guess.vertical.to_string());
        assert_eq!(found.as_deref(), up, "{name}");
        let (own, notes) = pictured(&file, "");
        let is_noted = notes.iter().any(|note| note.contains("--up"));
        assert_eq!(is_noted, up.is_some(), "{name}: {notes:?}");
        // The picture is that of the stated axis, which has no note.
        let axis: Vertical = up.unwrap_or("z").parse().unwrap();
        let DVec3 { x, y, z } = axis.direction();
        let (stated, notes) = pictured(&file, &format!("up={x},{y},{z}"));
        assert!(own.rgba == stated.rgba, "{name}");
        assert!(notes.iter().all(|note| !note.contains("--up")), "{name}: {notes:?}");
        if up.is_some() {
            let (as_z, _) = pictured(&file, "up=0,0,1");
            assert!(own.rgba != as_z.rgba, "{name}");
        }
    }
}

#[test]
fn text_has_z_upwards_however_thin_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::new();
    for p in ground() {
        writeln!(text, "{:.4} {:.4} {:.4}", p.x, p.z, p.y).unwrap();
    }
    assert_eq!(guessed(&built(folder.path(), "facade.xyz", &text)), None);
}

#[test]
fn scans_on_a_turntable_turn_around_the_vertical() {
    let Some(folder) = std::env::var_os("ESKER_DATA") else {
        eprintln!("skipped: ESKER_DATA names no folder of scans");
        return;
    };
    let scan = Path::new(&folder).join("e57/bunny-10scans.e57");
    let out = tempfile::tempdir().unwrap();
    let out = out.path().join("bunny.esker");
    build(&[scan], &out, &BuildOptions::default(), 0, &Silent).unwrap();
    let guess = guessed(&Forest::open(&out).unwrap());
    let y = GuessedUp { vertical: Vertical::of(1, false), by_turns: true };
    assert_eq!(guess, Some(y));
}
