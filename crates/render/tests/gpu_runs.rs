//! Runs of points are skipped by their boxes: no pixel changes, boxes are updated whenever bytes
//! are written, and a run whose box is not visible is not drawn.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
mod scene;

use esker_lod::View;
use esker_points::quant::HOT_POSITION_BYTES;
use esker_render::gpu::device::readback::read;
use esker_render::gpu::memory::runs::{BOX_BYTES, RUN_BYTES};
use esker_render::gpu::wgpu::{Buffer, BufferUsages};
use esker_render::gpu::{Gpu, GpuRenderer, NodePool, ProjectPath};
use esker_render::{DrawNode, Frame, Method};
use glam::DVec3;
use gpu::{gpus, name, upload, uploaded_frame};
use scene::{Dice, Scene, sheet, sphere};

/// Bytes of a page, not a multiple of the bytes of a run.
const PAGE_BYTES: u64 = (64 << 10) + 256;

/// The devices that skip runs.
fn skipping() -> Vec<Gpu> {
    gpus().into_iter().filter(|gpu| gpu.tier.path == ProjectPath::Atomics).collect()
}

fn bytes_of(gpu: &Gpu, buffer: &Buffer) -> Vec<u8> {
    read(gpu, &[(buffer, buffer.size())]).unwrap().remove(0)
}

fn hits_of(gpu: &Gpu, renderer: &GpuRenderer) -> Vec<u8> {
    bytes_of(gpu, renderer.hits().0.buffer().unwrap())
}

fn points_won(hits: &[u8]) -> usize {
    hits.as_chunks::<8>().0.iter().filter(|hit| **hit != [0xff; 8]).count()
}

/// A ball above a floor, in nodes of several runs.
fn ball_and_floor(step: f64) -> Scene {
    let mut dice = Dice(11);
    let mut points = sphere(&mut dice, DVec3::Z, 1.0, 15_000, [200, 60, 40]);
    let (u, v) = (DVec3::X * 4.0, DVec3::Y * 4.0);
    points.extend(sheet(&mut dice, -(u + v) / 2.0, u, v, 120, [60, 160, 90]));
    Scene::new(&points, step, 0.02, 0.02, 3333)
}

fn frame<'a>(scene: &'a Scene, view: &'a View, draws: &'a [DrawNode<'a>]) -> Frame<'a> {
    Frame { method: Method::Points, cull_back_faces: false, ..scene.frame(view, draws) }
}

/// Views from outside, close to a surface, inside the ball, along an axis with a narrow field of
/// view, with a wide one, along the floor, and away from the scene.
fn views(far: DVec3) -> Vec<View> {
    let look = |eye: [f64; 3], target: [f64; 3], fov, width, height| {
        let (eye, target) = (DVec3::from_array(eye) + far, DVec3::from_array(target) + far);
        View::look_at(eye, target, DVec3::Z, fov, width, height)
    };
    vec![
        look([2.6, -3.1, 2.4], [0.0, 0.0, 0.5], 0.9, 160, 120),
        look([0.7, -0.9, 1.3], [0.5, -0.6, 1.1], 0.9, 160, 90),
        look([0.2, 0.1, 0.9], [1.0, 0.3, 0.6], 1.4, 90, 160),
        look([1e-9, 0.0, 1.0], [1.0, 0.0, 1.0], 0.2, 160, 120),
        look([0.0, 0.0, 0.001], [1.0, 0.2, 0.0], 2.9, 160, 120),
        look([1.0, 1.0, 0.05], [-1.0, -1.2, 0.0], 1.0, 160, 120),
        look([30.0, 0.0, 3.0], [60.0, 0.0, 3.0], 1.0, 160, 120),
    ]
}

#[test]
fn skipped_runs_change_no_bit_of_the_frame_buffer() {
    for gpu in skipping() {
        let mut renderers = [true, false].map(|skips| {
            let mut renderer = GpuRenderer::new(&gpu).unwrap();
            renderer.skip_runs(skips).unwrap();
            renderer
        });
        // Hot positions drop no bits, up to ten, and more.
        for (step, far) in [(1e-3, 0.0), (1e-3, 1e7), (1e-6, 0.0), (1e-9, 0.0)] {
            let mut scene = ball_and_floor(step);
            let far = DVec3::new(1.0, -2.0, 0.3) * far;
            scene.lattice.offset = far.to_array();
            for has_residuals in [true, false] {
                let draws = scene.draws(has_residuals, false, true);
                let uploaded = upload(&gpu, &draws, PAGE_BYTES);
                for (i, view) in views(far).iter().enumerate() {
                    for cull_back_faces in [true, false] {
                        let frame = Frame { cull_back_faces, ..frame(&scene, view, &draws) };
                        let [with, without] = renderers.each_mut().map(|renderer| {
                            renderer
                                .render(&uploaded_frame(&frame, &uploaded.draws), &uploaded.pool)
                                .unwrap();
                            hits_of(&gpu, renderer)
                        });
                        // The last view looks away, and culling may remove all points of a view.
                        let shows = i != 6 && !cull_back_faces;
                        let won = points_won(&without);
                        assert!(!shows || won > 20, "view {i} shows {won} points");
                        assert!(
                            with == without,
                            "view {i}, step {step}, far {far}, {}",
                            name(&gpu)
                        );
                    }
                }
            }
        }
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
    }
}

/// Computes the boxes of the runs in a page.
fn boxes_of(page: &[u8]) -> Vec<[u16; 8]> {
    page.chunks(RUN_BYTES as usize)
        .map(|run| {
            let points = run.as_chunks::<HOT_POSITION_BYTES>().0.iter();
            let points = points.map(|p| bytemuck::cast::<[u8; 8], [u16; 4]>(*p));
            points.fold([u16::MAX, u16::MAX, u16::MAX, 0, 0, 0, 0, 0], |b, [x, y, z, _]| {
                let (low, high) = ([b[0].min(x), b[1].min(y), b[2].min(z)], [b[3], b[4], b[5]]);
                [low[0], low[1], low[2], high[0].max(x), high[1].max(y), high[2].max(z), 0, 0]
            })
        })
        .collect()
}

#[test]
fn boxes_match_the_bytes_after_any_number_of_writes() {
    let scene = ball_and_floor(1e-3);
    let view = &views(DVec3::ZERO)[0];
    let draws = scene.draws(true, true, true);
    for gpu in skipping() {
        let mut uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let frame = frame(&scene, view, &draws);
        let usage = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let source = gpu.buffer("source", 16 << 10, usage).unwrap();
        let mut dice = Dice(5);
        for round in 0..6 {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            for _ in 0..round {
                let bytes: Vec<u8> = (0..16 << 10).map(|_| (dice.bits() % 251) as u8).collect();
                gpu.queue.write_buffer(&source, 0, &bytes);
                let (page, size) = (dice.bits() % 3, dice.bits() % (16 << 10));
                let start = (dice.bits() % (PAGE_BYTES - size - 4)) & !3;
                let to = page * PAGE_BYTES + start;
                let pool = &mut uploaded.pool;
                if dice.bits().is_multiple_of(2) {
                    pool.copy_from(&gpu, &mut encoder, &source, 0, to, size).unwrap();
                } else {
                    pool.write(&gpu, to, &bytes[..size as usize]).unwrap();
                }
            }
            let frame = uploaded_frame(&frame, &uploaded.draws);
            renderer.render_after(encoder, &frame, &uploaded.pool).unwrap();
            for page in 0..uploaded.pool.pages() {
                let bytes = bytes_of(&gpu, uploaded.pool.page(page).unwrap());
                let boxes = bytes_of(&gpu, uploaded.pool.boxes(page).unwrap());
                let boxes: Vec<[u16; 8]> = bytemuck::pod_collect_to_vec(&boxes);
                assert!(boxes == boxes_of(&bytes), "page {page}, round {round}, {}", name(&gpu));
            }
        }
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
    }
}

#[test]
fn a_run_is_skipped_by_its_box_until_another_node_takes_its_place() {
    let scene = ball_and_floor(1e-3);
    let view = &views(DVec3::ZERO)[1];
    let draws = scene.draws(true, false, false);
    for gpu in skipping() {
        let mut uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let frame = frame(&scene, view, &draws);
        let mut draw = |pool: &NodePool| {
            renderer.render(&uploaded_frame(&frame, &uploaded.draws), pool).unwrap();
            hits_of(&gpu, &renderer)
        };
        let whole = draw(&uploaded.pool);
        assert!(points_won(&whole) > 1000);
        // A box at the farthest corner that a node can reach, which is behind the eye.
        for page in 0..uploaded.pool.pages() {
            let boxes = uploaded.pool.boxes(page).unwrap();
            for run in 0..boxes.size() / BOX_BYTES {
                let corner = [u32::MAX, u32::MAX, u32::MAX, 0];
                gpu.queue.write_buffer(boxes, run * BOX_BYTES, bytemuck::cast_slice(&corner));
            }
        }
        assert_eq!(points_won(&draw(&uploaded.pool)), 0, "{}", name(&gpu));
        let nodes = draws.len() - 1;
        for (shift, is_own) in [(1, false), (0, true), (nodes / 2, false), (0, true)] {
            for (i, at) in uploaded.draws.iter().take(nodes).enumerate() {
                let bytes = draws[(i + shift) % nodes].position;
                uploaded.pool.write(&gpu, at.position.offset, bytes).unwrap();
            }
            // The last node is shorter than the others.
            let last = &uploaded.draws[nodes];
            uploaded.pool.write(&gpu, last.position.offset, draws[nodes].position).unwrap();
            assert_eq!(draw(&uploaded.pool) == whole, is_own, "{}", name(&gpu));
        }
    }
}
