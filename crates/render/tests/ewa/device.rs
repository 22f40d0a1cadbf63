//! EWA on every adapter draws the picture of the CPU (mean FLIP at most 0.01, at most 0.1 % of the
//! pixels off by more than 8 of 255): many batches, too little memory for entries, thousands of
//! splats or almost none on a pixel, extreme views.

use crate::gpu::{few_gpus, name, upload, uploaded_frame};
use crate::scene::{Dice, Scene, ScenePoint, sheet, sphere};
use esker_lod::View;
use esker_render::gpu::GpuRenderer;
use esker_render::gpu::passes::ewa::{BatchCapacity, GpuEwa};
use esker_render::{Frame, Method, render};
use esker_truth::flip::mean_flip;
use glam::DVec3;

fn pixels_off(a: &[u8], b: &[u8]) -> usize {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 8);
    a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0).filter(|p| differs(*p)).count()
}

fn splats(frame: Frame<'_>) -> Frame<'_> {
    Frame { method: Method::Ewa, cull_back_faces: false, ..frame }
}

/// Batches of one chunk each, with memory for the entries of few splats.
const SMALL: BatchCapacity = BatchCapacity { chunks: 1, entries: 4000 };
const USUAL: BatchCapacity = BatchCapacity { chunks: 2, entries: 1 << 18 };
/// More than some frames need: buffers grow, and leftover contents must not be read.
const LARGE: BatchCapacity = BatchCapacity { chunks: 8, entries: 1 << 18 };

#[test]
fn every_capacity_and_view_gives_the_picture_of_the_cpu() {
    let mut dice = Dice(21);
    let mut points = sphere(&mut dice, DVec3::Z, 1.0, 9000, [220, 90, 50]);
    let (u, v) = (DVec3::X * 4.0, DVec3::Y * 4.0);
    points.extend(sheet(&mut dice, -(u + v) / 2.0, u, v, 90, [60, 150, 90]));
    let scene = Scene::new(&points, 1e-5, 0.045, 0.045, 3000);
    let crowd: Vec<_> = (0..5000)
        .map(|i| {
            let colour = if i < 2500 { [255, 0, 0] } else { [0, 0, 255] };
            let turned = DVec3::new(1.0, -1e-3 - 0.5 * f64::from(i % 2), 0.0).normalize_or_zero();
            ScenePoint { at: DVec3::ZERO, normal: turned, colour }
        })
        .collect();
    let crowd = Scene::new(&crowd, 1e-5, 0.5, 0.5, 1 << 12);
    let from = |eye: DVec3, target: DVec3, fovy: f64| {
        let mut view = View::look_at(eye, target, DVec3::Z, fovy, 97, 80);
        view.near = 1e-3;
        view
    };
    let views = [
        from(DVec3::new(2.6, -3.1, 2.4), DVec3::Z * 0.5, 0.9),
        // Just above the floor, whose splats cross the plane of the camera.
        from(DVec3::new(0.5, -1.8, 0.01), DVec3::new(0.4, 0.0, 0.3), 1.8),
        from(DVec3::new(0.0, -1.04, 1.0), DVec3::new(3.0, 0.0, 1.2), 2.4),
    ];
    let ahead = from(DVec3::NEG_Y * 4.0, DVec3::ZERO, 0.6);
    let (draws, crowd_draws) = (scene.draws(true, true, true), crowd.draws(true, true, true));
    // Clipped splats; the second view is close to some of them.
    let (cube, l_shaped) = (crate::clip::cube(14), crate::clip::l_shaped());
    let clipped = [
        (cube.draws(true, true, true), from(DVec3::new(1.1, -1.4, 0.9), DVec3::ZERO, 0.8)),
        (cube.draws(false, true, true), from(DVec3::new(0.7, -0.5, 0.3), DVec3::X * 0.3, 1.6)),
        (l_shaped.draws(true, true, true), ahead),
    ];
    // Splats with random bytes as shapes, some of them clipped, too.
    let [mut shaped, mut shaped_cube] =
        [Scene::new(&points, 1e-5, 0.045, 0.045, 3000), crate::clip::cube(14)];
    for node in shaped.nodes.iter_mut().chain(&mut shaped_cube.nodes) {
        let words = (0..node.position.len() / 8).map(|_| dice.bits() as u32);
        node.tangents = words.flat_map(u32::to_le_bytes).collect();
    }
    let with_shapes = [
        (shaped.draws(true, true, true), views[0]),
        (shaped_cube.draws(true, true, true), clipped[0].1),
    ];
    let frames = views.iter().map(|view| splats(scene.frame(view, &draws)));
    let mut frames: Vec<_> = frames.flat_map(|f| [(f, USUAL), (f, SMALL)]).take(5).collect();
    frames.push((splats(crowd.frame(&ahead, &crowd_draws)), USUAL));
    let scenes = [&cube, &cube, &l_shaped].into_iter().zip(&clipped);
    frames.extend(scenes.map(|(s, (draws, view))| (splats(s.frame(view, draws)), USUAL)));
    frames.push((frames[6].0, SMALL));
    let scenes = [&shaped, &shaped_cube].into_iter().zip(&with_shapes);
    frames.extend(scenes.map(|(s, (draws, view))| (splats(s.frame(view, draws)), USUAL)));
    // Without normals, tilted as the planes that are fitted to depths.
    let bare = scene.draws(true, true, false);
    let bare = [0, 2].map(|i| splats(scene.frame(&views[i], &bare)));
    frames.extend([(bare[0], USUAL), (bare[0], SMALL), (bare[1], USUAL)]);
    frames.extend([6, 0, 6].map(|i| (frames[i].0, LARGE)));
    frames.sort_by_key(|(_, capacity)| capacity.chunks);
    let pictures: Vec<_> = frames.iter().map(|(f, _)| render(f).unwrap()).collect();
    let drawn = pictures.iter().filter(|p| p.stats.splats_drawn > 1000).count();
    assert!(drawn >= 5, "{drawn}");
    for gpu in few_gpus() {
        let before = gpu.bytes();
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        for (i, ((frame, capacity), cpu)) in frames.iter().zip(&pictures).enumerate() {
            // Software drivers take seconds to compile kernels: reuse them for the same capacity.
            if i == 0 || frames[i - 1].1 != *capacity {
                renderer.set_ewa(GpuEwa::new(&gpu, *capacity).unwrap());
            }
            let uploaded = upload(&gpu, frame.draws, 64 << 10);
            renderer.render(&uploaded_frame(frame, &uploaded.draws), &uploaded.pool).unwrap();
            let other = renderer.read().unwrap();
            let (own, theirs) = (cpu.stats, renderer.stats().unwrap());
            let differ = own.splats_drawn.abs_diff(theirs.splats_drawn);
            assert!(differ * 1000 <= own.splats_drawn, "view {i}: {own:?} {theirs:?}");
            assert_eq!(own.splats_dropped, theirs.splats_dropped, "view {i}");
            let flip = mean_flip(&cpu.rgba, &other.rgba, 97);
            let off = pixels_off(&cpu.rgba, &other.rgba);
            let on = name(&gpu);
            eprintln!("view {i}: FLIP {flip:.5}, {off} of {} pixels off, {on}", 97 * 80);
            assert!(flip <= 0.01 && off * 1000 <= 97 * 80, "view {i} on {on}: {flip}, {off}");
        }
        drop(renderer);
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
        assert_eq!(gpu.bytes(), before, "buffers are left on {}", name(&gpu));
    }
}
