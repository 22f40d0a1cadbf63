//! Unrelated files are drawn beside each other, each moved by whole steps: with all points the
//! picture is that of the same points in one file, on the CPU and on GPUs. A cloud is hidden while
//! a session runs, and comes back without reading.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_engine::Method;
use esker_engine::calls::info;
use esker_engine::calls::pick::pick;
use esker_engine::draw::scene::{PictureRequest, PictureScene, open_together};
use esker_engine::draw::session::{Options, Session, Settings};
use esker_engine::machine::backend::{Backend, GpuRequest};
use esker_format::Forest;
use esker_lod::View;
use esker_points::task::Silent;
use esker_render::Picture;
use glam::DVec3;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

const SIZE: [u32; 2] = [160, 120];
/// By how much the second cloud is moved, metres: no multiple of any cell.
const MOVED: [f64; 3] = [-12.34, 3.21, 0.77];

/// Lines of a wavy ground from `from` to `to` metres along x, moved by `by`.
fn ground(from: u32, to: u32, by: [f64; 3]) -> String {
    let mut text = String::new();
    for i in from * 20..to * 20 {
        for j in 0..400 {
            let [x, y] = [i, j].map(|c| f64::from(c) * 0.05);
            let z = (x * 0.7).sin() * (y * 0.5).cos();
            let [x, y, z] = [x + by[0], y + by[1], z + by[2]];
            writeln!(text, "{x:.2} {y:.2} {z:.2}").unwrap();
        }
    }
    text
}

fn built(folder: &Path, name: &str, text: &str) -> PathBuf {
    let scan = folder.join(format!("{name}.xyz"));
    std::fs::write(&scan, text).unwrap();
    let out = folder.join(format!("{name}.esker"));
    let options = esker_builder::Options { node_capacity: 2048, ..Default::default() };
    esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
    out
}

fn session(file: &Arc<Forest>, method: Method, backend: Backend) -> anyhow::Result<Session> {
    // Colours by elevation have the same range in all of them.
    let colour_by = Some("elevation:-1..1".into());
    let (target_spacing_px, occlusion) = (0.0, false);
    let settings =
        Settings { method, colour_by, target_spacing_px, occlusion, ..Settings::default() };
    let gpu = GpuRequest { allow_software: true, ..GpuRequest::default() };
    let options = Options { settings, backend, gpu, size: SIZE, ..Options::default() };
    Session::open(Arc::clone(file), options)
}

fn finished(session: &mut Session, view: &View) -> Picture {
    let deadline = Instant::now() + Duration::from_secs(120);
    while !session.frame(view).unwrap().is_final {
        assert!(Instant::now() < deadline, "{:?}", session.status());
    }
    assert_eq!(session.status().fault, None);
    session.picture().unwrap()
}

/// Share of the pixels that differ by more than 8 of 255.
fn off(a: &Picture, b: &Picture) -> f64 {
    let pixels = a.rgba.chunks_exact(4).zip(b.rgba.chunks_exact(4));
    let differs = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 8);
    pixels.filter(differs).count() as f64 / f64::from(a.width * a.height)
}

#[test]
fn files_that_are_moved_beside_each_other_give_the_picture_of_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let back = MOVED.map(|c| -c);
    let west = built(folder.path(), "west", &ground(1, 12, [0.0; 3]));
    let east = built(folder.path(), "east", &ground(12, 20, back));
    let whole = built(folder.path(), "whole", &ground(1, 20, [0.0; 3]));
    let whole = Arc::new(Forest::open(&whole).unwrap());
    let inputs = [west.clone(), east.clone()];
    let both = Arc::new(open_together(&inputs, &[[0.0; 3], MOVED]).unwrap().unwrap());
    assert_eq!((both.clouds(), both.points()), (2, whole.points()));
    let [low, high] = info::bounds(&whole).map(DVec3::from_array);
    let moved = info::bounds(&both).map(DVec3::from_array);
    assert!((moved[0] - low).length() < 1e-6 && (moved[1] - high).length() < 1e-6, "{moved:?}");
    let view = View::fit(low, high, DVec3::new(0.6, 0.5, -0.6), 1.0, SIZE[0], SIZE[1]);
    for backend in [Backend::Cpu, Backend::Gpu] {
        for method in [Method::Points, Method::PullPush] {
            let Ok(mut one) = session(&whole, method, backend) else { continue };
            let one = finished(&mut one, &view);
            let two = finished(&mut session(&both, method, backend).unwrap(), &view);
            assert_eq!(one.stats.points_drawn, two.stats.points_drawn);
            // Surfaces depend on the nodes that points are in, and normals on their file's points.
            let most = if method == Method::Points { 0.001 } else { 0.03 };
            let off = off(&one, &two);
            assert!(off <= most, "{method:?} on {backend:?}: {off} of the pixels are off");
        }
    }
    // A cloud is hidden, and comes back.
    let mut session = session(&both, Method::Points, Backend::Cpu).unwrap();
    let first = finished(&mut session, &view);
    let read = session.status().read_bytes;
    assert!(session.set_visible(1, false).unwrap());
    let hidden = finished(&mut session, &view);
    assert_eq!(hidden.stats.points_drawn, Forest::open(&west).unwrap().points());
    assert!(session.set_visible(1, true).unwrap());
    let again = finished(&mut session, &view);
    assert!(again.rgba == first.rgba && hidden.rgba != first.rgba);
    assert_eq!(session.status().read_bytes, read, "nothing was read again");
}

#[test]
fn picks_of_moved_clouds_are_placed_in_the_scene_and_have_the_integers_of_their_file() {
    let folder = tempfile::tempdir().unwrap();
    let west = built(folder.path(), "west", &ground(1, 4, [0.0; 3]));
    let east = built(folder.path(), "east", &ground(4, 8, MOVED.map(|c| -c)));
    let whole = built(folder.path(), "whole", &ground(1, 8, [0.0; 3]));
    let whole = Forest::open(&whole).unwrap();
    let both = open_together(&[west, east], &[[0.0; 3], MOVED]).unwrap().unwrap();
    let request = PictureRequest { method: Method::Points, size: SIZE, ..Default::default() };
    let scenes = [&whole, &both].map(|file| PictureScene::choose(file, &request).unwrap());
    let shown = scenes.each_ref().map(|scene| scene.appearance.shown.clone());
    let [low, high] = info::bounds(&whole).map(DVec3::from_array);
    let view = View::fit(low, high, DVec3::new(0.6, 0.5, -0.6), 1.0, SIZE[0], SIZE[1]);
    let mut of_clouds = [0; 2];
    for (i, j) in (21..160).step_by(6).flat_map(|i| (0..400).step_by(16).map(move |j| (i, j))) {
        let [x, y] = [i, j].map(|c| f64::from(c) * 0.05);
        let z = ((x * 0.7).sin() * (y * 0.5).cos() * 100.0).round() / 100.0;
        let on = view.project(DVec3::new(x, y, z)).unwrap();
        let picks = [&whole, &both].into_iter().zip(&shown);
        let [a, b] = picks
            .map(|(file, shown)| {
                let picked = pick(file, &view, on.truncate(), on.z, shown).unwrap();
                picked.unwrap_or_else(|| panic!("{x} {y} {z} at {on} of {}", file.clouds()))
            })
            .collect::<Vec<_>>()
            .try_into()
            .unwrap();
        assert_eq!(b.coordinates, a.coordinates);
        assert_eq!(b.coordinates, [x, y, z].map(|c| format!("{:.2}", c + 0.0)));
        let is_east = b.file.ends_with("east.esker");
        of_clouds[usize::from(is_east)] += 1;
        let moved = if is_east { MOVED } else { [0.0; 3] };
        for (axis, moved) in moved.into_iter().enumerate() {
            let own = b.steps[axis] as f64 * b.scale[axis] + b.offset[axis];
            assert!((own + moved - a.position[axis]).abs() < 1e-6, "{own} of {b:?}");
            assert!((b.position[axis] - a.position[axis]).abs() < 1e-6);
        }
    }
    assert!(of_clouds.iter().all(|count| *count > 100), "{of_clouds:?}");
}

#[test]
fn clouds_that_fit_no_lattice_are_refused_with_what_differs_and_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let fine = built(folder.path(), "fine", &ground(1, 3, [0.0; 3]));
    let coarse = ground(1, 3, [0.0; 3]).replace(".50", ".5").replace('.', "");
    let coarse = built(folder.path(), "coarse", &coarse);
    let inputs = [fine.clone(), fine.clone()];
    let refused = |inputs: &[PathBuf], offset| {
        let error = open_together(inputs, &[[0.0; 3], offset]).unwrap_err();
        format!("{error:#}")
    };
    let error = refused(&inputs, [0.0, 0.004, 0.0]);
    assert!(error.contains("along y") && error.contains("change its offset"), "{error}");
    let error = refused(&inputs, [1e9, 0.0, 0.0]);
    assert!(error.contains("too far") && error.contains("build one file"), "{error}");
    let error = refused(&inputs, [f64::NAN, 0.0, 0.0]);
    assert!(error.contains("along x"), "{error}");
    let error = refused(&[fine.clone(), coarse], [0.0; 3]);
    assert!(error.contains("has steps of") && error.contains("fine.esker"), "{error}");
    let error = refused(&[fine, folder.path().join("fine.xyz")], [0.0; 3]);
    assert!(error.contains("fine.xyz") && error.contains("esker build"), "{error}");
}
