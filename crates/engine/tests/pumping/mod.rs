//! No pumping of splats: on a slow approach to a scan, prefixes and nodes change from frame to
//! frame, and with them the radii of splats. The change of a picture beyond that of a picture of
//! all points is small, and no frame has a much greater one.

use super::{Whole, uncovered};
use esker_engine::calls::info;
use esker_engine::{Method, NormalsMode};
use esker_lod::{AllResident, View};
use esker_render::{Picture, Renderer};
use glam::DVec3;
use std::path::Path;

/// Width and height of the pictures.
const SIZE: [u32; 2] = [192, 144];
/// Frames; below, the ratio of the distances of consecutive ones.
const FRAMES: usize = 30;
const NEARER: f64 = 0.985;
/// Width and height of the blocks of pixels whose mean colours are compared: what pumps is wider
/// than a pixel.
const BLOCK: usize = 8;

/// Changes from frame to frame, over all frames.
#[derive(Debug, Default)]
struct Pumping {
    /// Root mean square of the changes of blocks beyond those of the reference, of 255: of the
    /// median frame, and of the worst.
    median: f64,
    worst: f64,
    /// Greatest fraction of the picture by which the covered part grows or shrinks beyond the
    /// reference.
    swelling: f64,
    /// Frames in which another number of points is chosen.
    changes: usize,
}

/// Path of the camera: a slow approach, obliquely from above.
fn view(whole: &Whole, frame: usize) -> View {
    let [low, high] = info::bounds(&whole.file).map(DVec3::from_array);
    let (middle, half) = (low.midpoint(high), (high - low) / 2.0);
    let away = DVec3::new(-0.5, -0.9, 0.8) * half.truncate().length() * 1.5;
    let eye = middle + away * NEARER.powi(frame as i32);
    View::look_at(eye, middle, DVec3::Z, 0.8, SIZE[0], SIZE[1])
}

/// Mean colours of blocks.
fn blocks(picture: &Picture) -> Vec<[f64; 3]> {
    let width = SIZE[0] as usize;
    let columns = width / BLOCK;
    let mut sums: Vec<[f64; 3]> = vec![[0.0; 3]; columns * (SIZE[1] as usize / BLOCK)];
    for (i, pixel) in picture.rgba.chunks_exact(4).enumerate() {
        let sum = &mut sums[i / width / BLOCK * columns + i % width / BLOCK];
        (0..3).for_each(|k| sum[k] += f64::from(pixel[k]) / (BLOCK * BLOCK) as f64);
    }
    sums
}

/// Root mean square difference of the changes of two pairs of pictures.
fn beyond(own: [&[[f64; 3]]; 2], wanted: [&[[f64; 3]]; 2]) -> f64 {
    let change = |[from, to]: [&[[f64; 3]]; 2], b: usize, k: usize| to[b][k] - from[b][k];
    let blocks = own[0].len();
    let square = |b: usize| (0..3).map(move |k| (change(own, b, k) - change(wanted, b, k)).powi(2));
    ((0..blocks).flat_map(square).sum::<f64>() / (3 * blocks) as f64).sqrt()
}

/// Results of a frame.
struct Frame {
    points: usize,
    own: Vec<[f64; 3]>,
    wanted: Vec<[f64; 3]>,
    /// Fraction of the picture that is covered beyond the reference.
    swollen: f64,
}

fn frame(whole: &Whole, frame: usize, target_px: f64, renderer: &mut Renderer) -> Frame {
    let view = view(whole, frame);
    let mut draw = |target_px: f64| {
        let cut = whole.select(&view, &AllResident, target_px);
        let points = cut.drawn.iter().map(|d| d.prefix).sum();
        (whole.draw(&view, &cut, target_px, renderer), points)
    };
    let ((reference, _), (picture, points)) = (draw(0.0), draw(target_px));
    let [missing, more] = uncovered(&picture, &reference);
    Frame { points, own: blocks(&picture), wanted: blocks(&reference), swollen: more - missing }
}

fn measure(whole: &Whole, target_px: f64) -> Pumping {
    let mut renderer = Renderer::default();
    let mut found = Pumping::default();
    let mut excess = Vec::new();
    let mut before = frame(whole, 0, target_px, &mut renderer);
    for number in 1..FRAMES {
        let now = frame(whole, number, target_px, &mut renderer);
        excess.push(beyond([&before.own, &now.own], [&before.wanted, &now.wanted]));
        found.swelling = found.swelling.max((now.swollen - before.swollen).abs());
        found.changes += usize::from(before.points != now.points);
        before = now;
    }
    excess.sort_by(f64::total_cmp);
    (found.median, found.worst) = (excess[excess.len() / 2], excess[excess.len() - 1]);
    found
}

/// Asserts that splats pump no more than surfaces by pull-push.
fn assert_does_not_pump(scan: &Path, target_px: f64) {
    let folder = tempfile::tempdir().unwrap();
    let normals = NormalsMode::Estimate;
    let options = esker_builder::Options { node_capacity: 1024, normals, ..Default::default() };
    let [splats, closed] = [Method::Ewa, Method::PullPush].map(|method| {
        let whole = Whole::build_as(scan, &options, folder.path(), method);
        let found = measure(&whole, target_px);
        println!("{method:?}, points {target_px} pixels apart: {found:?}");
        found
    });
    assert!(splats.changes > FRAMES / 2, "the choice changes all the time: {splats:?}");
    assert!(
        splats.median <= closed.median && splats.worst <= closed.worst,
        "{splats:?}, {closed:?}"
    );
    assert!(splats.worst <= 2.0 * splats.median, "one frame changes much more: {splats:?}");
    assert!(splats.swelling <= 0.01, "{splats:?}");
}

#[test]
fn splats_of_an_airborne_scan_do_not_pump() {
    let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    for target_px in [1.0, 2.0] {
        assert_does_not_pump(&scan, target_px);
    }
}

#[test]
fn splats_of_rooms_do_not_pump() {
    let Some(data) = std::env::var_os("ESKER_DATA") else {
        println!("skipped: ESKER_DATA is not set");
        return;
    };
    assert_does_not_pump(&Path::new(&data).join("laz/indoor.laz"), 2.0);
}
