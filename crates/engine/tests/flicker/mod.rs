//! Flicker of a scan: how much more its picture changes from frame to frame of a slow camera than
//! an averaged picture of four times the width and height.

use esker_engine::cameras::camera::Camera;
use esker_engine::draw::scene::{PictureRequest, PictureScene};
use esker_format::Forest;
use esker_lod::CompactOctree;
use esker_points::task::Silent;
use esker_render::inputs::colour::linear;
use esker_render::{Frame, Renderer};
use glam::{DMat3, DVec3, Vec3};
use std::path::Path;

/// Width and height of the pictures; below, the ratio of the references to them.
const SIZE: [u32; 2] = [128, 96];
const FINER: u32 = 4;
const FRAMES: usize = 4;
/// Motion of the middle of the picture from frame to frame, pixels.
const STEP_PX: f64 = 0.3;

/// Camera that sees the scan obliquely from above, and moves a little around it in each frame.
fn camera(file: &Forest, frame: usize) -> Camera {
    let [low, high] = esker_engine::calls::info::bounds(file).map(DVec3::from_array);
    let (middle, half) = (low.midpoint(high), (high - low) / 2.0);
    let away = DVec3::new(-0.5, -0.9, 0.8) * half.truncate().length();
    // About the width of a pixel from there.
    let angle = STEP_PX / f64::from(SIZE[1]) * frame as f64;
    let eye = middle + DMat3::from_rotation_z(angle) * away;
    Camera { eye: Some(eye), target: Some(middle), ..Camera::default() }
}

/// A picture in linear light, pixel by pixel.
fn draw(file: &Forest, frame: usize, size: [u32; 2], spacing_px: f64, averages: bool) -> Vec<Vec3> {
    let picture_request = PictureRequest {
        size,
        camera: camera(file, frame),
        target_spacing_px: spacing_px,
        ..PictureRequest::default()
    };
    let scene = PictureScene::read(file, &picture_request, &Silent).unwrap();
    let octree = CompactOctree::new(file.table(), &scene.selection.drawn);
    let draws = scene.draws(file);
    let drawn = scene.appearance.frame(file, &scene.view, &draws, &octree);
    let picture =
        Renderer::default().render(&Frame { averages, smooths: averages, ..drawn }).unwrap();
    picture.rgba.as_chunks::<4>().0.iter().map(|&[r, g, b, _]| linear([r, g, b])).collect()
}

/// Means of blocks of pixels.
fn shrunk(fine: &[Vec3]) -> Vec<Vec3> {
    let width = (SIZE[0] * FINER) as usize;
    let block = |pixel: u32| {
        let (x, y) = ((pixel % SIZE[0] * FINER) as usize, (pixel / SIZE[0] * FINER) as usize);
        let side = 0..FINER as usize;
        let rows = side.clone().flat_map(|v| side.clone().map(move |u| (y + v) * width + x + u));
        rows.map(|p| fine[p]).sum::<Vec3>() / (FINER * FINER) as f32
    };
    (0..SIZE[0] * SIZE[1]).map(block).collect()
}

fn srgb(c: Vec3) -> Vec3 {
    let one = |v: f32| if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    Vec3::new(one(c.x), one(c.y), one(c.z)) * 255.0
}

/// Root mean square difference of the changes of pixels from those of the reference, of 255.
fn flicker(frames: &[Vec<Vec3>], references: &[Vec<Vec3>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (now, wanted) in frames.windows(2).zip(references.windows(2)) {
        for p in 0..now[0].len() {
            let change = |of: &[Vec<Vec3>]| srgb(of[1][p]) - srgb(of[0][p]);
            sum += f64::from((change(now) - change(wanted)).length_squared()) / 3.0;
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).sqrt()
}

/// The sample scan without normals.
fn bare(folder: &Path) -> Forest {
    let scan = std::path::absolute("../../tests/sample/creek.laz").unwrap();
    let (out, normals) = (folder.join("bare.esker"), esker_engine::NormalsMode::None);
    let options = esker_builder::Options { node_capacity: 2048, normals, ..Default::default() };
    esker_builder::build(&[scan], &out, &options, &Silent).unwrap();
    Forest::open(&out).unwrap()
}

#[test]
fn a_slow_camera_does_not_make_a_scan_flicker() {
    let folder = tempfile::tempdir().unwrap();
    let file = bare(folder.path());
    let fine = SIZE.map(|side| side * FINER);
    let frames = || 0..FRAMES;
    let references: Vec<_> = frames().map(|f| shrunk(&draw(&file, f, fine, 1.0, true))).collect();
    // Points that are apart; and points that share pixels, as a fraction of the flicker with one
    // point a pixel.
    for (spacing_px, bound, share) in [(1.0, 10.0, 1.0), (0.5, 8.5, 0.9)] {
        let [mean, one] = [true, false].map(|averages| {
            let drawn: Vec<_> =
                frames().map(|f| draw(&file, f, SIZE, spacing_px, averages)).collect();
            flicker(&drawn, &references)
        });
        eprintln!("points {spacing_px} pixels apart: flicker {mean:.2}, one wins: {one:.2}");
        assert!(mean <= bound && mean <= share * one, "{mean}, {one} at {spacing_px} px");
    }
}
