//! Whole pictures: on every adapter and by either path, the GPU draws the picture of the CPU (mean
//! FLIP at most 0.01, at most 0.1 % of the pixels off by more than 8 of 255), frees its memory, and
//! reports counts, times and depths of its frames without waiting.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpu;
mod scene;

use esker_lod::{Occlusion, OrientedBox, View};
use esker_points::quant::HIDDEN_AT;
use esker_render::gpu::device::readback::read;
use esker_render::gpu::{Gpu, GpuRenderer, wgpu};
use esker_render::{
    Background, ColourBy, ColourMap, Dots, Frame, FramePlan, Gradient, Method, PassChoice, PassSet,
    Picture, PointSize, render,
};
use esker_truth::flip::mean_flip;
use glam::{DMat3, DVec3};
use gpu::{few_gpus, gpus, name, upload, uploaded_frame};
use scene::{Dice, Scene, ScenePoint, bunny, sheet, speckled, sphere};

/// Bytes of a page, so few that the planes of a node lie in several.
const PAGE_BYTES: u64 = 64 << 10;
/// Frames after which readbacks must have arrived.
const FRAMES_MAX: usize = 200;

/// Counts the pixels that differ by more than 8 of 255 in any channel.
fn pixels_off(a: &[u8], b: &[u8]) -> usize {
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 8);
    a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0).filter(|p| differs(*p)).count()
}

fn is_the_picture(what: &str, gpu: &Gpu, cpu: &Picture, other: &Picture) {
    let (on, pixels) = (name(gpu), cpu.depth.len());
    assert_eq!((other.width, other.height), (cpu.width, cpu.height));
    let flip = mean_flip(&cpu.rgba, &other.rgba, cpu.width as usize);
    let off = pixels_off(&cpu.rgba, &other.rgba);
    let is_off = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-3 * a.abs() && a != b;
    let depths_off = cpu.depth.iter().zip(&other.depth).filter(|p| is_off(*p)).count();
    eprintln!("{what}: FLIP {flip:.5}, {off} and {depths_off} of {pixels} pixels off, {on}");
    assert!(flip <= 0.01, "{what}: FLIP {flip} on {on}");
    assert!(off * 1000 <= pixels, "{what}: {off} of {pixels} pixels off on {on}");
    assert!(depths_off * 1000 <= pixels, "{what}: {depths_off} of {pixels} depths off on {on}");
    let near = |a: u64, b: u64| a.abs_diff(b) * 1000 <= pixels as u64;
    let (ours, theirs) = (&cpu.stats, &other.stats);
    assert_eq!(ours.points_drawn, theirs.points_drawn, "{what} on {on}");
    assert_eq!(ours.nodes_drawn, theirs.nodes_drawn, "{what} on {on}");
    assert!(
        near(ours.pixels_projected, theirs.pixels_projected),
        "{what} on {on}: {ours:?} {theirs:?}"
    );
    assert!(
        near(ours.pixels_covered, theirs.pixels_covered),
        "{what} on {on}: {ours:?} {theirs:?}"
    );
}

/// Draws all frames on the CPU and, with one renderer a device, on each device.
fn pictures_are_the_same(frames: &[(&str, Frame<'_>)]) {
    let cpu: Vec<_> = frames.iter().map(|(_, f)| render(f).unwrap()).collect();
    for gpu in few_gpus() {
        let before = gpu.bytes();
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        for ((what, frame), cpu) in frames.iter().zip(&cpu) {
            let uploaded = upload(&gpu, frame.draws, PAGE_BYTES);
            renderer.render(&uploaded_frame(frame, &uploaded.draws), &uploaded.pool).unwrap();
            is_the_picture(what, &gpu, cpu, &renderer.read().unwrap());
        }
        drop(renderer);
        assert_eq!(gpu.fault(), None, "{}", name(&gpu));
        assert_eq!(gpu.bytes(), before, "buffers are left on {}", name(&gpu));
    }
}

fn ball_and_floor() -> Scene {
    let mut dice = Dice(11);
    let mut points = sphere(&mut dice, DVec3::Z, 1.0, 9000, [220, 90, 50]);
    let (u, v) = (DVec3::X * 4.0, DVec3::Y * 4.0);
    points.extend(sheet(&mut dice, -(u + v) / 2.0, u, v, 90, [60, 150, 90]));
    Scene::new(&points, 1e-5, 0.045, 0.045, 3000)
}

/// More points in one place than the sums of a pixel can hold, and one point of another colour in
/// front of them.
fn heap() -> Scene {
    let point = |nearer: f64, colour| ScenePoint {
        // Not in the middle of the picture, where four pixels meet.
        at: DVec3::new(0.08, 0.06, 0.6) + DVec3::new(2.6, -3.1, 1.9) * nearer,
        normal: DVec3::NEG_Y,
        colour,
    };
    let mut points = vec![point(0.0, [250, 0, 0]); 1 << 18];
    points.push(point(1e-3, [0, 250, 0]));
    Scene::new(&points, 1e-5, 0.1, 0.1, 8000)
}

fn view(width: u32, height: u32) -> View {
    let eye = DVec3::new(2.6, -3.1, 2.4);
    View::look_at(eye, DVec3::Z * 0.5, DVec3::Z, 0.9, width, height).with_margin(16)
}

#[test]
fn pictures_without_an_optional_pass_equal_those_of_the_cpu() {
    let (scene, view) = (ball_and_floor(), view(160, 128));
    let [with, without] = [true, false].map(|normals| scene.draws(true, true, normals));
    let [lit, bare] = [&with, &without].map(|draws| scene.frame(&view, draws));
    let mut frames = Vec::new();
    for (frame, method) in
        [lit, bare].into_iter().flat_map(|f| [(f, Method::PullPush), (f, Method::Ewa)])
    {
        let frame = Frame { method, crowding: Some(0.5), ..frame };
        let plan = FramePlan::new(&frame);
        for &pass in plan.passes.iter().filter(|pass| pass.is_optional()) {
            let passes = PassChoice { skipped: PassSet::of(&[pass]), ..PassChoice::default() };
            frames.push((pass.name(), Frame { passes, ..frame }));
        }
    }
    assert!(frames.len() > 14, "{}", frames.len());
    pictures_are_the_same(&frames);
}

#[test]
fn pictures_equal_those_of_the_cpu_by_every_path() {
    let scene = ball_and_floor();
    let (small, wide) = (view(160, 128), view(173, 97));
    let [with, without] = [true, false].map(|normals| scene.draws(true, true, normals));
    let surface = scene.frame(&small, &with);
    let points = Frame { method: Method::Points, ..surface };
    let dots = |size, eye_dome| Frame { dots: Dots { size, eye_dome }, ..points };
    let background = Background::Plain([9, 200, 30, 0]);
    let nothing = Frame { draws: &[], ..surface };
    let bunny = Bunny::new();
    let bunny_draws = bunny.as_ref().map(|b| b.scene.draws(true, true, true));
    let mut marked = ball_and_floor();
    for point in marked.nodes.iter_mut().flat_map(|n| n.position.chunks_mut(8)).step_by(3) {
        point[HIDDEN_AT] = 1;
    }
    let marked_draws = marked.draws(true, true, true);
    let filtered = Frame { hides_points: true, ..marked.frame(&small, &marked_draws) };
    let crowd = speckled();
    let [crowd_with, crowd_without] = [true, false].map(|normals| crowd.draws(true, true, normals));
    let crowded = crowd.frame(&small, &crowd_with);
    let mut crowd_mixed = crowd_with.clone();
    crowd_mixed.iter_mut().step_by(2).for_each(|draw| draw.normal = None);
    assert!(FramePlan::new(&crowded).averages() && !FramePlan::new(&surface).averages());
    // The floor continues beyond the picture.
    assert!(FramePlan::new(&surface).margin_px > 0);
    // So small that the bound of 0.1 % allows no pixel to differ.
    let (heap, tiny) = (heap(), view(16, 12));
    let heap_draws = heap.draws(true, true, true);
    let heaped = heap.frame(&tiny, &heap_draws);
    assert!(FramePlan::new(&heaped).averages());
    let mut scans = speckled();
    let mut dice = Dice(13);
    for colour in scans.nodes.iter_mut().flat_map(|n| n.colour.as_chunks_mut::<4>().0) {
        // Scans 21 and 22 are twice as bright as scan 20.
        colour[3] = 20 + (dice.bits() % 3) as u8;
        let share = 2 - u8::from(colour[3] == 20);
        (0..3).for_each(|i| colour[i] = (colour[i] / 4 + 150) / 2 * share);
    }
    let [scans_with, scans_without] = [true, false].map(|normals| scans.draws(true, true, normals));
    let evened =
        Frame { evens_exposure: true, averages: false, ..scans.frame(&small, &scans_with) };
    assert!(FramePlan::new(&evened).evens_exposure() && !FramePlan::new(&surface).evens_exposure());
    let heights = ColourMap { low: 0.0, high: 2.0, gradient: Gradient::Viridis };
    let thinned = |frame| Frame { target_spacing_px: 2.0, ..frame };
    let mut frames = vec![
        ("surface", surface),
        ("crowded", crowded),
        ("crowded, one point a pixel", Frame { averages: false, ..crowded }),
        ("crowded without normals", crowd.frame(&small, &crowd_without)),
        ("crowded from both sides", Frame { cull_back_faces: false, ..crowded }),
        (
            "crowded from both sides, with fronts",
            Frame { cull_back_faces: false, has_fronts: true, ..crowded },
        ),
        (
            "surface from both sides, with fronts",
            Frame { cull_back_faces: false, has_fronts: true, ..surface },
        ),
        (
            "splats from both sides, with fronts",
            Frame { method: Method::Ewa, cull_back_faces: false, has_fronts: true, ..surface },
        ),
        ("crowded, half without normals", crowd.frame(&small, &crowd_mixed)),
        ("crowded by heights", Frame { colour: ColourBy::Coordinate(2, heights), ..crowded }),
        ("crowded by places", Frame { colour: ColourBy::Coordinate(0, heights), ..crowded }),
        ("more points than sums hold", heaped),
        ("exposure compensated", evened),
        ("exposure of averages compensated", Frame { averages: true, ..evened }),
        (
            "exposure compensated without normals, another size",
            Frame { evens_exposure: true, ..scans.frame(&wide, &scans_without) },
        ),
        ("surface without highlights", Frame { shines: false, ..surface }),
        ("surface of a filtered cloud", filtered),
        ("points of a filtered cloud", Frame { method: Method::Points, ..filtered }),
        ("surface of another size", scene.frame(&wide, &with)),
        ("surface without normals", scene.frame(&small, &without)),
        ("splats", Frame { method: Method::Ewa, ..surface }),
        ("splats without normals", Frame { method: Method::Ewa, ..scene.frame(&wide, &without) }),
        ("points", points),
        ("points by normals", Frame { colour: ColourBy::Normal, background, ..points }),
        ("dots of 5 pixels", dots(PointSize::Pixels(5.0), 0.0)),
        ("dots of 2 pixels under an eye dome", dots(PointSize::Pixels(2.0), 1.0)),
        ("adaptive dots", dots(PointSize::Adaptive, 0.0)),
        ("adaptive dots under an eye dome", dots(PointSize::Adaptive, 0.6)),
        ("thinned adaptive dots", thinned(dots(PointSize::Adaptive, 0.0))),
        ("points under an eye dome", dots(PointSize::default(), 1.0)),
        ("points without culling", Frame { cull_back_faces: false, ..points }),
        ("nothing", nothing),
        ("no splats", Frame { method: Method::Ewa, ..nothing }),
        ("no points", Frame { method: Method::Points, ..nothing }),
    ];
    if let (Some(bunny), Some(draws)) = (&bunny, &bunny_draws) {
        let frame = bunny.scene.frame(&bunny.view, draws);
        frames.push(("bunny", frame));
        frames.push(("bunny of splats", Frame { method: Method::Ewa, ..frame }));
        frames.push(("bunny's points", Frame { method: Method::Points, ..frame }));
    }
    pictures_are_the_same(&frames);
}

#[test]
fn parallel_pictures_equal_those_of_the_cpu() {
    let scene = ball_and_floor();
    let flat = view(160, 128).parallel(2.5, DVec3::splat(-2.0), DVec3::splat(2.0));
    let [with, without] = [true, false].map(|normals| scene.draws(true, true, normals));
    let surface = scene.frame(&flat, &with);
    let crowd = speckled();
    let crowd_draws = crowd.draws(true, true, true);
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.6 };
    pictures_are_the_same(&[
        ("surface", surface),
        ("surface without normals", scene.frame(&flat, &without)),
        ("crowd", crowd.frame(&flat, &crowd_draws)),
        ("splats", Frame { method: Method::Ewa, ..surface }),
        ("splats without normals", Frame { method: Method::Ewa, ..scene.frame(&flat, &without) }),
        ("points", Frame { method: Method::Points, ..surface }),
        ("dots under an eye dome", Frame { method: Method::Points, dots, ..surface }),
    ]);
}

#[test]
fn pictures_through_a_narrow_pinhole_equal_those_of_the_cpu() {
    let scene = ball_and_floor();
    let towards = DVec3::new(2.6, -3.1, 1.9) * 1e3;
    let far = View::look_at(DVec3::Z * 0.5 + towards, DVec3::Z * 0.5, DVec3::Z, 9e-4, 160, 128);
    let far = far.with_margin(16);
    let [with, without] = [true, false].map(|normals| scene.draws(true, true, normals));
    let surface = scene.frame(&far, &with);
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.6 };
    pictures_are_the_same(&[
        ("surface", surface),
        ("surface without normals", scene.frame(&far, &without)),
        ("surface and dots", Frame { mixes_dots: true, dots, ..surface }),
        ("splats", Frame { method: Method::Ewa, ..surface }),
        ("dots", Frame { method: Method::Points, dots, ..surface }),
    ]);
}

#[test]
fn surfaces_and_dots_equal_those_of_the_cpu() {
    let (scene, view) = (ball_and_floor(), view(160, 128));
    // A wall in front of the ball with points 20 times as far apart.
    let mut dice = Dice(3);
    let (u, v) = (DVec3::new(1.6, 1.4, 0.0), DVec3::Z * 1.2);
    let corner = DVec3::new(0.6, -1.9, 0.4);
    let sparse = sheet(&mut dice, corner, u, v, 8, [40, 90, 220]);
    let sparse = Scene::new(&sparse, 1e-5, 0.25, 0.25, 3000);
    // Points of a crown, whose normals agree by chance.
    let leaves: Vec<_> = (0..60)
        .map(|_| {
            let mut way = || DVec3::from_array([0; 3].map(|_| dice.unit() - 0.5));
            let (at, normal) = (DVec3::new(0.5, -0.9, 1.0) + way(), way().normalize_or(DVec3::Z));
            ScenePoint { at, normal, colour: [60, 160, 50] }
        })
        .collect();
    let crown = Scene::new(&leaves, 1e-5, 0.2, 0.2, 3000);
    let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.5 };
    let mix = |frame| Frame { mixes_dots: true, dots, ..frame };
    let joined = |dense, sparse_normals| {
        let of = [
            scene.draws(true, true, dense),
            sparse.draws(true, true, sparse_normals),
            crown.draws(true, true, sparse_normals),
        ];
        of.concat()
    };
    let both = [joined(true, true), joined(true, false), joined(false, false)];
    let near = View::look_at(DVec3::new(0.9, -1.2, 1.6), DVec3::Z * 0.9, DVec3::Z, 0.9, 150, 90);
    let near = near.with_margin(16);
    let frames = both.iter().flat_map(|draws| {
        [&view, &near].map(|view| mix(Frame { octree: None, ..scene.frame(view, draws) }))
    });
    let frames: Vec<_> = frames.map(|frame| ("surfaces and dots", frame)).collect();
    let matt = Frame { shines: false, colour: ColourBy::Plain, ..frames[2].1 };
    let pictures: Vec<_> = frames.iter().map(|(_, frame)| render(frame).unwrap()).collect();
    let plain = frames.iter().map(|(_, f)| render(&Frame { mixes_dots: false, ..*f }).unwrap());
    let differ = plain.zip(&pictures).map(|(a, b)| pixels_off(&a.rgba, &b.rgba));
    assert!(differ.sum::<usize>() > 3_000, "hardly anything is drawn as dots");
    pictures_are_the_same(&[&frames[..], &[("matt", matt)]].concat());
}

/// The bunny of the data folder and a view of it.
struct Bunny {
    scene: Scene,
    view: View,
}

impl Bunny {
    fn new() -> Option<Self> {
        let scene = Scene::new(&bunny()?, 1e-6, 0.0012, 0.0012, 5000);
        let target = DVec3::new(-0.02, 0.11, 0.0);
        let eye = DVec3::new(0.05, 0.16, 0.3);
        Some(Self { scene, view: View::look_at(eye, target, DVec3::Y, 0.7, 200, 200) })
    }
}

#[test]
fn the_flip_metric_distinguishes_pictures() {
    let plain = |c: [u8; 4]| c.repeat(32 * 32);
    let flip = |a: [u8; 4], b: [u8; 4]| mean_flip(&plain(a), &plain(b), 32);
    let [black, white] = [[0, 0, 0, 255], [255; 4]];
    assert!(flip(white, white) < 1e-6);
    assert!(flip(black, white) > 0.9);
    assert!(flip([0, 255, 0, 255], [0, 0, 255, 255]) > 0.9);
    let near = flip([120, 120, 120, 255], [122, 120, 120, 255]);
    assert!(near > 0.001 && near < 0.1, "{near}");
    // A missing line counts more than its share of the pixels.
    let mut line = plain(white);
    line.chunks_exact_mut(32 * 4).for_each(|row| row[16 * 4..17 * 4].copy_from_slice(&black));
    assert!(mean_flip(&plain(white), &line, 32) > 1.0 / 32.0);
}

/// Reads a texture whose rows are multiples of 256 bytes, as copies require.
fn texture_bytes(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<u8> {
    let bytes = u64::from(texture.width()) * u64::from(texture.height()) * 4;
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("texture", bytes, usage).unwrap();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(texture.width() * 4),
        rows_per_image: None,
    };
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
        texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    read(gpu, &[(&buffer, bytes)]).unwrap().remove(0)
}

#[test]
fn a_window_shows_the_picture_that_is_read_and_points_free_the_memory_of_surfaces() {
    let (scene, view) = (ball_and_floor(), view(64, 48));
    let draws = scene.draws(false, true, true);
    let frame = scene.frame(&view, &draws);
    for gpu in few_gpus() {
        let uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        assert!(renderer.texture().is_none());
        let mut bytes = Vec::new();
        for method in [Method::Points, Method::PullPush, Method::Points] {
            let frame = Frame { method, ..uploaded_frame(&frame, &uploaded.draws) };
            renderer.render(&frame, &uploaded.pool).unwrap();
            let shown = texture_bytes(&gpu, renderer.texture().unwrap().texture());
            assert_eq!(shown, renderer.read().unwrap().rgba, "{method:?} on {}", name(&gpu));
            bytes.push(gpu.bytes());
        }
        assert!(bytes[1] > bytes[0] + 100_000, "surfaces take memory: {bytes:?}");
        // Tables of the kernels are kept.
        assert!(bytes[2] < bytes[0] + 20_000, "points free it: {bytes:?}");
    }
}

#[test]
fn counts_times_and_depths_arrive_without_waiting() {
    let (scene, view) = (ball_and_floor(), view(128, 96));
    let draws = scene.draws(false, true, true);
    let frame = scene.frame(&view, &draws);
    let cpu = render(&frame).unwrap();
    let block = |centre| OrientedBox { centre, half: DVec3::splat(0.05), axes: DMat3::IDENTITY };
    let [inside, before] = [DVec3::Z, DVec3::new(1.3, -1.5, 1.9)].map(block);
    for gpu in gpus() {
        let on = name(&gpu);
        let uploaded = upload(&gpu, &draws, PAGE_BYTES);
        let frame = uploaded_frame(&frame, &uploaded.draws);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let mut frames = 0;
        let (stats, depth) = loop {
            assert!(frames < FRAMES_MAX, "no statistics or depth arrived on {on}");
            renderer.render(&frame, &uploaded.pool).unwrap();
            frames += 1;
            if let (Some(stats), Some(depth)) = (renderer.stats(), renderer.feedback()) {
                break (stats, depth);
            }
        };
        assert_eq!(stats.points_drawn, cpu.stats.points_drawn, "{on}");
        assert!(stats.pixels_covered > 1000, "{on}: {stats:?}");
        assert!(depth.hides(&inside), "a box in the ball is not hidden on {on}");
        assert!(!depth.hides(&before), "a box in front of the ball is hidden on {on}");
        renderer.read().unwrap();
        let stats = renderer.stats().unwrap();
        assert_eq!(stats.stages.total_ms > 0.0, gpu.tier.has_timestamps, "{on}: {stats:?}");
    }
}
