//! Claims about the project pass on a GPU: by either path, on every adapter there is, the same points win the
//! same pixels as on the CPU.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
mod scene;

use esker_lod::View;
use esker_render::camera::Camera;
use esker_render::gpu::readback::read;
use esker_render::gpu::{Gpu, GpuRenderer};
use esker_render::project::{DrawList, EMPTY, project, unpack};
use esker_render::{DrawNode, Frame};
use glam::DVec3;
use gpu::{gpus, laid_frame, lay, name};
use scene::{Dice, Scene, sheet, sphere};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes of a page: a node of 3,000 points has its planes in several.
const PAGE_BYTES: u64 = 64 << 10;

/// A picture's points: depth and number of the point in each pixel.
type Winners = Vec<Option<(f32, u32)>>;

fn on_cpu(frame: &Frame<'_>) -> Winners {
    let camera = Camera::new(frame.view, frame.lattice).unwrap();
    let list = DrawList::new(frame.draws);
    let pixels = camera.size[0] as usize * camera.size[1] as usize;
    let target: Vec<_> = (0..pixels).map(|_| AtomicU64::new(EMPTY)).collect();
    project(frame, &camera, &list, &target);
    let value = |v: &AtomicU64| v.load(Relaxed);
    target.iter().map(value).map(|v| (v != EMPTY).then(|| unpack(v))).collect()
}

fn on_gpu(gpu: &Gpu, frame: &Frame<'_>) -> Winners {
    let laid = lay(gpu, frame.draws, PAGE_BYTES);
    let frame = laid_frame(frame, &laid.draws);
    let mut renderer = GpuRenderer::new(gpu).unwrap();
    renderer.render(&frame, &laid.pool).unwrap();
    let (hits, cut) = renderer.hits();
    let buffer = hits.buffer().unwrap();
    let bytes = read(gpu, &[(buffer, buffer.size())]).unwrap().remove(0);
    // The CPU numbers points through all nodes.
    let starts: Vec<u32> = cut
        .rows
        .iter()
        .scan(0, |next, row| {
            *next += row.points;
            Some(*next - row.points)
        })
        .collect();
    let pixels = frame.view.width as usize * frame.view.height as usize;
    bytes
        .as_chunks::<8>()
        .0
        .iter()
        .take(pixels)
        .map(|raw| {
            let [point, depth] = bytemuck::cast::<[u8; 8], [u32; 2]>(*raw);
            (depth != u32::MAX).then(|| {
                let (row, index) = cut.find(point).unwrap();
                (f32::from_bits(depth), starts[row] + index)
            })
        })
        .collect()
}

/// Draws a frame on both; both must show something.
fn same_points_win(what: &str, frame: &Frame<'_>) {
    let cpu = on_cpu(frame);
    let covered = cpu.iter().flatten().count();
    assert!(covered * 50 > cpu.len(), "{what}: {covered} pixels are no picture");
    for gpu in gpus() {
        let before = gpu.bytes();
        let other = on_gpu(&gpu, frame);
        assert_eq!(other.len(), cpu.len());
        let mut differing = 0;
        for (&a, &b) in cpu.iter().zip(&other) {
            match (a, b) {
                (Some((depth, a)), Some((other, b))) if a == b => {
                    assert!((depth - other).abs() <= 1e-4 * depth, "{what}: {depth} and {other}");
                }
                (a, b) => differing += usize::from(a != b),
            }
        }
        let gpu_name = name(&gpu);
        eprintln!("{what}: {differing} of {} pixels by {gpu_name}", cpu.len());
        assert!(differing * 1000 <= cpu.len(), "{what}: {differing} pixels differ on {gpu_name}");
        assert_eq!(gpu.fault(), None, "{what}: {gpu_name}");
        assert_eq!(gpu.bytes(), before, "{what}: buffers are left on {gpu_name}");
    }
}

/// A ball above a floor of several nodes.
fn ball_and_floor(step: f64, extent: f64, capacity: usize) -> Scene {
    let mut dice = Dice(7);
    let mut points = sphere(&mut dice, DVec3::Z * extent, extent, 12_000, [200, 60, 40]);
    let (u, v) = (DVec3::X * extent * 4.0, DVec3::Y * extent * 4.0);
    points.extend(sheet(&mut dice, -(u + v) / 2.0, u, v, 120, [60, 160, 90]));
    Scene::new(&points, step, extent * 0.02, extent * 0.02, capacity)
}

fn view(extent: f64, width: u32, height: u32) -> View {
    let eye = DVec3::new(2.6, -3.1, 2.4) * extent;
    View::look_at(eye, DVec3::Z * extent * 0.5, DVec3::Z, 0.9, width, height)
}

#[test]
fn the_same_points_win_with_and_without_the_test_of_normals() {
    let scene = ball_and_floor(1e-3, 1.0, 3000);
    let (view, draws) = (view(1.0, 203, 151), scene.draws(true, true, true));
    for cull_back_faces in [true, false] {
        let frame = Frame { cull_back_faces, ..scene.frame(&view, &draws) };
        same_points_win(&format!("culling: {cull_back_faces}"), &frame);
    }
}

#[test]
fn residuals_of_no_four_and_six_bytes_are_read_alike() {
    for (step, shifts) in [(1e-3, 0..=0), (1e-6, 1..=10), (1e-9, 11..=16)] {
        let scene = ball_and_floor(step, 1.0, 5001);
        assert!(scene.nodes.iter().any(|n| shifts.contains(&n.node.hot_shift)), "{step}");
        let view = view(1.0, 200, 150);
        for residual in [true, false] {
            let draws = scene.draws(residual, false, false);
            let frame = scene.frame(&view, &draws);
            same_points_win(&format!("step {step}, residuals {residual}"), &frame);
        }
    }
}

#[test]
fn far_coordinates_and_points_behind_the_near_plane_are_no_other() {
    let mut scene = ball_and_floor(1e-3, 1.0, 3000);
    let far = DVec3::new(1e7, -2e7, 3e6);
    scene.lattice.offset = far.to_array();
    let draws = scene.draws(true, false, true);
    let outside = view(1.0, 200, 150);
    let look = |eye: DVec3, target| View::look_at(eye + far, target + far, DVec3::Z, 1.4, 200, 150);
    let inside = look(DVec3::new(0.2, 0.1, 0.4), DVec3::new(1.0, 0.3, 0.1));
    let moved = View { eye: outside.eye + far, ..outside };
    same_points_win("far", &scene.frame(&moved, &draws));
    same_points_win("inside", &Frame { cull_back_faces: false, ..scene.frame(&inside, &draws) });
}

#[test]
fn planes_shorter_than_the_prefix_end_it() {
    let scene = ball_and_floor(1e-6, 1.0, 3000);
    let view = view(1.0, 200, 150);
    let draws: Vec<_> = scene
        .draws(true, true, true)
        .into_iter()
        .enumerate()
        .map(|(i, d)| match i % 5 {
            0 => DrawNode { position: &d.position[..d.position.len() / 2 + 3], ..d },
            1 => DrawNode { residual: d.residual.map(|r| &r[..r.len() / 2]), ..d },
            2 => DrawNode { normal: d.normal.map(|n| &n[..n.len() / 3 + 1]), ..d },
            3 => DrawNode { position: &d.position[..0], ..d },
            _ => DrawNode { prefix: 1777, ..d },
        })
        .collect();
    same_points_win("short planes", &scene.frame(&view, &draws));
}
