//! The project pass on the GPU: by either path and on every adapter, the same points win the same
//! pixels as on the CPU.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
mod scene;

use esker_lod::View;
use esker_points::{Lattice, Node};
use esker_render::gpu::device::readback::read;
use esker_render::gpu::{Gpu, GpuError, GpuRenderer, PlaneAt};
use esker_render::inputs::camera::Camera;
use esker_render::inputs::lookup::DrawList;
use esker_render::passes::project::{EMPTY, project, unpack};
use esker_render::{ColourBy, ColourPlane, DrawNode, Frame, Method};
use glam::DVec3;
use gpu::{gpus, name, upload, uploaded_frame};
use scene::{Dice, Scene, sheet, sphere};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Bytes of a page, so few that the planes of a node of 3,000 points lie in several.
const PAGE_BYTES: u64 = 64 << 10;

/// Depth and number of the point that won each pixel.
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

fn winners(gpu: &Gpu, frame: &Frame<'_>, renderer: &GpuRenderer) -> Winners {
    let (hits, _) = renderer.hits();
    let buffer = hits.buffer().unwrap();
    let bytes = read(gpu, &[(buffer, buffer.size())]).unwrap().remove(0);
    let pixels = frame.view.width as usize * frame.view.height as usize;
    bytes
        .as_chunks::<8>()
        .0
        .iter()
        .take(pixels)
        .map(|raw| {
            let [point, depth] = bytemuck::cast::<[u8; 8], [u32; 2]>(*raw);
            (depth != u32::MAX).then(|| (f32::from_bits(depth), point))
        })
        .collect()
}

/// The frame with planes in drawing memory, drawn as points without the passes of surfaces.
fn points_frame<'a>(frame: &Frame<'a>, draws: &'a [DrawNode<'a, PlaneAt>]) -> Frame<'a, PlaneAt> {
    Frame { method: Method::Points, ..uploaded_frame(frame, draws) }
}

/// Counts the pixels that different points won.
fn differing(a: &Winners, b: &Winners) -> usize {
    a.iter().zip(b).filter(|(a, b)| a.map(|a| a.1) != b.map(|b| b.1)).count()
}

/// Draws all frames on the CPU and, with one renderer a device, on each device. Every frame must
/// show points.
fn assert_same_points_win(frames: &[(&str, Frame<'_>)]) {
    let cpu: Vec<_> = frames.iter().map(|(_, frame)| on_cpu(frame)).collect();
    for gpu in gpus() {
        let (before, on) = (gpu.bytes(), name(&gpu));
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        for ((what, frame), cpu) in frames.iter().zip(&cpu) {
            let uploaded = upload(&gpu, frame.draws, PAGE_BYTES);
            renderer.render(&points_frame(frame, &uploaded.draws), &uploaded.pool).unwrap();
            assert!(renderer.hits().1.work.len() > 1, "{what}: all planes are in one page");
            assert_same_winners(&format!("{what}, {on}"), cpu, &winners(&gpu, frame, &renderer));
        }
        drop(renderer);
        assert_eq!(gpu.fault(), None, "{on}");
        assert_eq!(gpu.bytes(), before, "buffers are left on {on}");
    }
}

fn assert_same_winners(what: &str, cpu: &Winners, gpu: &Winners) {
    let covered = cpu.iter().flatten().count();
    assert!(covered * 50 > cpu.len(), "{what}: only {covered} pixels are covered");
    assert_eq!(cpu.len(), gpu.len());
    for (&a, &b) in cpu.iter().zip(gpu) {
        if let (Some((depth, a)), Some((other, b))) = (a, b)
            && a == b
        {
            assert!((depth - other).abs() <= 1e-4 * depth, "{what}: {depth} and {other}");
        }
    }
    let differing = differing(cpu, gpu);
    eprintln!("{what}: {differing} of {} pixels", cpu.len());
    assert!(differing * 1000 <= cpu.len(), "{what}: {differing} pixels have different points");
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
fn the_same_points_win_with_and_without_back_face_culling() {
    let scene = ball_and_floor(1e-3, 1.0, 3000);
    let (view, draws) = (view(1.0, 203, 151), scene.draws(true, true, true));
    let with = Frame { cull_back_faces: true, ..scene.frame(&view, &draws) };
    let without = Frame { cull_back_faces: false, ..with };
    assert_same_points_win(&[("culling", with), ("not culling", without)]);
}

#[test]
fn the_same_points_win_with_residuals_of_zero_four_and_six_bytes() {
    let scenes = [(1e-3, 0..=0), (1e-6, 1..=10), (1e-9, 11..=16)].map(|(step, shifts)| {
        let scene = ball_and_floor(step, 1.0, 5001);
        assert!(scene.nodes.iter().any(|n| shifts.contains(&n.node.hot_shift)), "{step}");
        scene
    });
    let view = view(1.0, 200, 150);
    let draws = scenes.each_ref().map(|s| [true, false].map(|r| s.draws(r, false, false)));
    let frame = |scene: usize, bare: usize| scenes[scene].frame(&view, &draws[scene][bare]);
    assert_same_points_win(&[
        ("none", frame(0, 0)),
        ("none, no plane", frame(0, 1)),
        ("four bytes", frame(1, 0)),
        ("four bytes, no plane", frame(1, 1)),
        ("six bytes", frame(2, 0)),
        ("six bytes, no plane", frame(2, 1)),
    ]);
}

#[test]
fn the_same_points_win_far_from_the_origin_and_around_the_eye() {
    let mut scene = ball_and_floor(1e-3, 1.0, 3000);
    let far = DVec3::new(1e7, -2e7, 3e6);
    scene.lattice.offset = far.to_array();
    let draws = scene.draws(true, false, true);
    let outside = view(1.0, 200, 150);
    let look = |eye: DVec3, target| View::look_at(eye + far, target + far, DVec3::Z, 1.4, 200, 150);
    let inside = look(DVec3::new(0.2, 0.1, 0.4), DVec3::new(1.0, 0.3, 0.1));
    let moved = View { eye: outside.eye + far, ..outside };
    let inside = Frame { cull_back_faces: false, ..scene.frame(&inside, &draws) };
    assert_same_points_win(&[("far", scene.frame(&moved, &draws)), ("inside", inside)]);
}

#[test]
fn the_same_points_are_left_out_where_they_are_closer_together_than_asked() {
    let mut scene = ball_and_floor(1e-3, 1.0, 3000);
    for (i, node) in scene.nodes.iter_mut().enumerate() {
        let count = node.node.points();
        node.node.set_levels(&[count / 50, count / 9, count - count / 50 - count / 9]);
        node.node.shape = 1 + (i % 3) as u8;
    }
    let view = view(1.0, 200, 150);
    let mut draws = scene.draws(true, false, true);
    draws.iter_mut().enumerate().for_each(|(i, d)| d.above = 0.25 * (i % 4) as f32);
    let all = Frame { method: Method::Points, ..scene.frame(&view, &draws) };
    let thinned = Frame { target_spacing_px: 1.0, ..all };
    let [before, after] = [all, thinned].map(|frame| on_cpu(&frame).iter().flatten().count());
    assert!(after * 4 > before && after * 4 < before * 3, "{after} of {before} pixels");
    let parallel = view.parallel(4.0, DVec3::splat(-2.0), DVec3::splat(2.0));
    assert_same_points_win(&[
        ("thinned", thinned),
        ("all", all),
        ("thinned, parallel", Frame { view: &parallel, ..thinned }),
    ]);
}

#[test]
fn planes_shorter_than_the_prefix_are_drawn_up_to_their_end() {
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
    assert_same_points_win(&[("short planes", scene.frame(&view, &draws))]);
}

#[test]
fn many_nodes_of_few_points_are_drawn_by_a_renderer_that_drew_few() {
    let scene = ball_and_floor(1e-4, 1.0, 24);
    let (small, large) = (view(1.0, 64, 48), view(1.0, 200, 150));
    let draws = scene.draws(true, false, true);
    assert!(draws.len() > 1000);
    let few = scene.frame(&small, &draws[..draws.len() / 4]);
    let many = scene.frame(&large, &draws);
    let cpu = [few, many, few].map(|f| on_cpu(&f));
    for gpu in gpus() {
        let uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        for (frame, cpu) in [few, many, few].iter().zip(&cpu) {
            let draws = &uploaded.draws[..frame.draws.len()];
            renderer.render(&points_frame(frame, draws), &uploaded.pool).unwrap();
            assert_same_winners(&name(&gpu), cpu, &winners(&gpu, frame, &renderer));
        }
    }
}

#[test]
fn invalid_views_are_refused_and_the_next_frame_is_drawn() {
    let scene = ball_and_floor(1e-3, 1.0, 3000);
    let draws = scene.draws(false, false, false);
    let good = view(1.0, 40, 30);
    let cpu = on_cpu(&scene.frame(&good, &draws));
    for gpu in gpus() {
        let uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let bad = [View { eye: DVec3::NAN, ..good }, View { width: side_max + 1, ..good }];
        for bad in &bad {
            let frame = scene.frame(bad, &draws);
            let refused = renderer.render(&points_frame(&frame, &uploaded.draws), &uploaded.pool);
            assert!(matches!(refused, Err(GpuError::View(_) | GpuError::Size { .. })));
            let frame = scene.frame(&good, &draws);
            renderer.render(&points_frame(&frame, &uploaded.draws), &uploaded.pool).unwrap();
            assert_same_winners(&name(&gpu), &cpu, &winners(&gpu, &frame, &renderer));
        }
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
    }
}

#[test]
fn random_bits_give_a_valid_picture() {
    let mut dice = Dice(99);
    let mut bytes = |count: usize| (0..count).map(|_| dice.bits() as u8).collect::<Vec<u8>>();
    let gpus = gpus();
    let mut renderers: Vec<_> = gpus.iter().map(|g| GpuRenderer::new(g).unwrap()).collect();
    for (round, scale) in [1e-3, 1e-300, 1e300, 1e-9].into_iter().cycle().take(8).enumerate() {
        let planes: Vec<_> = [800, 600, 400, 300].map(&mut bytes).to_vec();
        let mut nodes: Vec<Node> =
            (0..5).map(|_| bytemuck::pod_read_unaligned(&bytes(size_of::<Node>()))).collect();
        // At the target of the camera, so that points reach the picture.
        (nodes[0].box_min, nodes[0].hot_shift) = ([1 << 31; 3], 0);
        let draws: Vec<_> = nodes
            .iter()
            .map(|node| DrawNode {
                node,
                entry: round * 1_000_000,
                prefix: usize::MAX >> (round * 5),
                above: 0.0,
                position: &planes[0][..],
                residual: (round % 2 == 0).then_some(&planes[1][..]),
                colour: ColourPlane::Rgba(&planes[2][..]),
                normal: (round % 3 > 0).then_some(&planes[3][..]),
                clip: None,
                tangents: None,
            })
            .collect();
        let lattice =
            Lattice { scale: [scale; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let target = DVec3::splat(32_768.0) * scale.clamp(1e-200, 1e200);
        let view = View::look_at(target * 3.0, target, DVec3::Z, 1.0, 40, 30);
        let frame = Frame {
            method: Method::Points,
            colour: ColourBy::Rgb,
            cull_back_faces: true,
            ..Frame::new(&view, &lattice, &draws)
        };
        for (gpu, renderer) in gpus.iter().zip(&mut renderers) {
            let uploaded = upload(gpu, &draws, PAGE_BYTES);
            renderer.render(&points_frame(&frame, &uploaded.draws), &uploaded.pool).unwrap();
            for (depth, _) in winners(gpu, &frame, renderer).into_iter().flatten() {
                assert!(depth > 0.0 && depth < f32::INFINITY, "{depth} on {}", name(gpu));
            }
            assert_eq!(gpu.fault(), None, "{}", name(gpu));
        }
    }
}
