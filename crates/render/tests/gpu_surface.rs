//! The passes from level 0 of the pyramid to the picture on a GPU: on every adapter each gives the
//! result of its CPU twin, within 1e-4, except near-ties at no more than 0.1 % of the pixels.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod scene;

use esker_lod::View;
use esker_render::gpu::device::readback::read;
use esker_render::gpu::device::timing::Timing;
use esker_render::gpu::device::{Counted, all_interfaces};
use esker_render::gpu::memory::frame::FrameUniform;
use esker_render::gpu::memory::picture::GpuPicture;
use esker_render::gpu::memory::pyramid::GpuPyramid;
use esker_render::gpu::surface::{Choices, Surface};
use esker_render::gpu::wgpu::{self, BufferUsages};
use esker_render::gpu::{Gpu, GpuRequest};
use esker_render::inputs::camera::Camera;
use esker_render::passes::antialias;
use esker_render::passes::fill_holes;
use esker_render::passes::pull;
use esker_render::passes::push;
use esker_render::passes::shade;
use esker_render::passes::silhouette;
use esker_render::passes::smooth_depth::{SmoothDepthScratch, smooth_depth};
use esker_render::passes::tangent::Lens;
use esker_render::picture::edges;
use esker_render::picture::pyramid::{INVALID, Level, Planes, Pyramid};
use esker_render::{Background, Frame, FramePlan, Picture, Renderer};
use glam::{DVec3, Vec2, Vec4};
use scene::{Dice, Scene, sheet, sphere};

/// Slope from which a step in depth is an edge, as in the renderer.
const STEP_PX: f32 = 2.0;

/// Opens two devices for each adapter, one with all its features and one with the minimum that
/// WebGPU guarantees. Prints a note if there is no adapter.
fn gpus() -> Vec<Gpu> {
    let requests = all_interfaces().iter().flat_map(|&backends| {
        [false, true].map(|is_minimal| GpuRequest {
            backends,
            allow_software: true,
            is_minimal,
            path: None,
        })
    });
    let gpus: Vec<_> = requests.filter_map(|r| Gpu::open(&r).ok()).collect();
    if gpus.is_empty() {
        eprintln!("no adapter");
    }
    gpus
}

/// BaseImage of the passes: level 0 and the frame that it belongs to.
struct BaseImage<'a> {
    name: String,
    frame: Frame<'a>,
    /// Planes that the pixels carry.
    planes: Planes,
    base: Level,
    /// Whether there are ties that rounding decides. Software drivers round like the CPU, GPUs do
    /// not.
    has_ties: bool,
}

impl<'a> BaseImage<'a> {
    fn of(name: &str, frame: Frame<'a>) -> Self {
        let mut pyramid = Pyramid::default();
        Renderer::default().base_level(&frame, &mut pyramid).unwrap();
        let size = [frame.view.width, frame.view.height];
        let (planes, base) = (FramePlan::new(&frame).planes(), pyramid.levels.swap_remove(0));
        Self { name: format!("{name} {size:?}"), frame, planes, base, has_ties: false }
    }

    fn camera(&self) -> Camera {
        Camera::new(self.frame.view, self.frame.lattice).unwrap()
    }
}

/// Results of the CPU twins, pass by pass.
struct TwinResults {
    pulled: Pyramid,
    pushed: Pyramid,
    filled: Vec<f32>,
    picture: Picture,
}

fn run_twins(input: &BaseImage<'_>, smooths: bool) -> TwinResults {
    let (camera, base) = (input.camera(), &input.base);
    let mut pulled = Pyramid::default();
    pulled.fit(base.width, base.height, input.planes);
    pulled.lens = Lens::new(&camera);
    pulled.levels[0] = base.clone();
    pull::pull(&mut pulled);
    let mut pushed = pulled.clone();
    push::push_with(&mut pushed, f32::from(smooths), &mut []);
    let mut last = pushed.clone();
    let pixels = base.width * base.height;
    let mut picture = Picture {
        width: base.width as u32,
        height: base.height as u32,
        rgba: vec![0; pixels * 4],
        depth: vec![0.0; pixels],
        ..Picture::default()
    };
    let (level, depth) = (&mut last.levels[0], &mut picture.depth);
    level.depth_image(&pulled.lens, depth);
    let level = &mut last.levels[0];
    let found = edges::edges(depth, level.width, STEP_PX / camera.focal_px);
    fill_holes::fill_holes(level, depth, camera.focal_px);
    let filled = depth.clone();
    let trimmed = silhouette::trim(level, depth, &found, camera.focal_px);
    let found = found.or(&trimmed);
    let mut scratch = SmoothDepthScratch::default();
    if input.planes != Planes::Normals {
        smooth_depth(&camera, &last, &picture.depth, &mut scratch);
    }
    let background = input.frame.background;
    let shaded = shade::shade(&camera, &last, background, true, &scratch, &mut picture);
    let (depth, rgba) = (&picture.depth, &mut picture.rgba);
    antialias::antialias(depth, base.width, camera.focal_px, &found, &shaded.creases, rgba);
    TwinResults { pulled, pushed, filled, picture }
}

/// Passes on one device and the buffers of one image.
struct SurfacePasses<'a> {
    gpu: &'a Gpu,
    uniform: Counted,
    pyramid: GpuPyramid,
    picture: GpuPicture,
    choices: Choices,
}

impl<'a> SurfacePasses<'a> {
    fn new(gpu: &'a Gpu, input: &BaseImage<'_>, smooths: bool) -> Self {
        let base = &input.base;
        let bytes = [FrameUniform::new(&input.frame, &input.camera(), [0.0, 1.0])];
        let bytes: &[u8] = bytemuck::cast_slice(&bytes);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("frame", bytes.len() as u64, usage).unwrap();
        gpu.queue.write_buffer(&uniform, 0, bytes);
        let mut pyramid = GpuPyramid::default();
        let [width, height] = [base.width as u32, base.height as u32];
        pyramid.fit(gpu, width, height, input.planes).unwrap();
        let picture = GpuPicture::new(gpu, [width, height], 0).unwrap();
        let (planes, fills_holes) = (input.planes, true);
        let (shines, darkens_edges, is_splats) = (true, true, false);
        let choices = Choices { planes, shines, smooths, darkens_edges, fills_holes, is_splats };
        let passes = Self { gpu, uniform, pyramid, picture, choices };
        passes.write_levels(std::slice::from_ref(base));
        passes
    }

    /// Writes `levels` to the finest levels of the pyramid.
    fn write_levels(&self, levels: &[Level]) {
        let queue = &self.gpu.queue;
        for (to, level) in self.pyramid.levels.iter().zip(levels) {
            queue.write_buffer(&to.front, 0, bytemuck::cast_slice(&floats(&level.front)));
            queue.write_buffer(&to.tint, 0, bytemuck::cast_slice(&floats(&level.tint)));
            queue.write_buffer(&to.depth, 0, bytemuck::cast_slice(&level.depth));
            let tilts: Vec<_> = level.tilt.iter().map(|t| t.to_array()).collect();
            queue.write_buffer(&to.plane, 0, bytemuck::cast_slice(&floats(&level.normal)));
            queue.write_buffer(&to.plane, 0, bytemuck::cast_slice(&tilts));
        }
    }

    /// Runs the pass with index `stage` and returns its name, `None` after the last pass.
    fn run(&self, surface: &mut Surface, stage: usize) -> Option<&'static str> {
        let Self { gpu, uniform, pyramid, picture, choices } = self;
        let stages = surface.stages(gpu, uniform, pyramid, picture, *choices).unwrap();
        let stage = stages.get(stage)?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        stage.encode(&mut encoder, &mut Timing::default());
        gpu.queue.submit([encoder.finish()]);
        Some(stage.name)
    }

    fn floats(&self, buffer: &wgpu::Buffer, count: usize) -> Vec<f32> {
        let bytes = read(self.gpu, &[(buffer, count as u64 * 4)]).unwrap().remove(0);
        bytemuck::pod_collect_to_vec(&bytes)
    }

    fn vectors(&self, buffer: &wgpu::Buffer, count: usize) -> Vec<Vec4> {
        let floats = self.floats(buffer, count * 4);
        floats.as_chunks().0.iter().map(|&v| Vec4::from_array(v)).collect()
    }

    fn pairs(&self, buffer: &wgpu::Buffer, count: usize) -> Vec<Vec2> {
        let floats = self.floats(buffer, count * 2);
        floats.as_chunks().0.iter().map(|&v| Vec2::from_array(v)).collect()
    }

    /// Reads all levels.
    fn levels(&self) -> Vec<Level> {
        let planes = self.pyramid.planes;
        let level = |l: &esker_render::gpu::memory::pyramid::GpuLevel| {
            let count = (l.width * l.height) as usize;
            Level {
                width: l.width as usize,
                height: l.height as usize,
                edge_px: l.edge_px,
                front: self.vectors(&l.front, count),
                tint: self.vectors(&l.tint, count),
                depth: self.floats(&l.depth, count),
                normal: self.vectors(&l.plane, if planes == Planes::Normals { count } else { 0 }),
                tilt: if planes == Planes::Fitted { self.pairs(&l.plane, count) } else { vec![] },
            }
        };
        self.pyramid.levels.iter().map(level).collect()
    }
}

fn floats(vectors: &[Vec4]) -> Vec<[f32; 4]> {
    vectors.iter().map(|v| v.to_array()).collect()
}

/// Whether two values are equal up to rounding, for values of about `size`.
fn close(a: f32, b: f32, size: f32) -> bool {
    a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan() || (a - b).abs() <= 1e-4 * size
}

/// Whether each pixel of two levels differs by more than rounding. With `bare`, normals and slopes
/// are ignored.
fn differing(a: &Level, b: &Level, bare: bool) -> Vec<bool> {
    let close4 = |a: Vec4, b: Vec4, size: f32| (0..4).all(|i| close(a[i], b[i], size));
    let same = |i: usize| {
        if !a.is_valid(i) || !b.is_valid(i) {
            return a.is_valid(i) == b.is_valid(i);
        }
        let (f, g, radius) = (a.front[i], b.front[i], a.tint[i].w.max(a.edge_px));
        let displaced = Vec2::new(f.z, f.w).distance(Vec2::new(g.z, g.w));
        // Scale of the colours; `f32::max` ignores components that are not numbers.
        let light = a.tint[i].to_array()[..3].iter().fold(0.01f32, |most, c| most.max(c.abs()));
        close(f.x, g.x, f.x)
            && close(f.y, g.y, f.y)
            && displaced <= 1e-4 * radius
            && close4(a.tint[i].with_w(0.0), b.tint[i].with_w(0.0), light)
            && close(a.tint[i].w, b.tint[i].w, radius)
            && close(a.depth[i], b.depth[i], a.depth[i])
            && (bare || a.normal.is_empty() || close4(a.normal[i], b.normal[i], 1.0))
            && (bare || a.tilt.is_empty() || (a.tilt[i] - b.tilt[i]).length() <= 1e-4)
    };
    (0..a.front.len()).map(|i| !same(i)).collect()
}

/// Counts the pixels of pushed levels that differ. With `rounds`, pixels below a differing coarser
/// pixel are left out: a near-tie is counted where it is decided, not at all pixels below.
fn differing_pushed(a: &[Level], b: &[Level], rounds: bool) -> usize {
    // Normals of coarser levels are ignored: on the GPU, push lets pixels without a normal inherit
    // one from the next coarser level.
    let pairs = a.iter().zip(b).enumerate();
    let differ: Vec<_> = pairs.map(|(i, (a, b))| differing(a, b, i > 0)).collect();
    let is_inherited = |i: usize, pixel: usize| {
        let Some(above) = a.get(i + 1).filter(|_| rounds) else { return false };
        let [x, y] = [pixel % a[i].width / 2, pixel / a[i].width / 2];
        let [columns, rows] = [(x, above.width), (y, above.height)]
            .map(|(at, count)| at.saturating_sub(1)..count.min(at + 2));
        let mut around = rows.flat_map(|y| columns.clone().map(move |x| y * above.width + x));
        around.any(|over| differ[i + 1][over])
    };
    let levels = differ.iter().enumerate();
    levels.map(|(i, d)| (0..d.len()).filter(|&p| d[p] && !is_inherited(i, p)).count()).sum()
}

fn differing_depths(a: &[f32], b: &[f32]) -> usize {
    assert!(b.iter().all(|d| *d > 0.0), "a depth is not a number");
    a.iter().zip(b).filter(|&(&a, &b)| !close(a, b, a)).count()
}

/// Counts the pixels whose colour or alpha differs by more than 8 of 255. With `rounds`, pixels
/// close to one whose depth differs are left out: such a difference is counted in the silhouette
/// pass.
fn pixels_off(twins: &TwinResults, rgba: &[u8], depth: &[f32], rounds: bool) -> usize {
    /// Reach of the antialias pass, pixels.
    const REACH: usize = 2;
    let Picture { width, depth: expected, rgba: colours, .. } = &twins.picture;
    let width = *width as usize;
    assert_eq!(colours.len(), rgba.len());
    let differs = |(a, b): (&[u8; 4], &[u8; 4])| (0..4).any(|i| a[i].abs_diff(b[i]) > 8);
    let is_trimmed = |&i: &usize| rounds && !close(expected[i], depth[i], expected[i]);
    let trimmed: Vec<_> = (0..depth.len()).filter(is_trimmed).collect();
    let reaches = |from: usize, to: usize| {
        let apart = |of: fn(usize, usize) -> usize| of(from, width).abs_diff(of(to, width));
        apart(|pixel, width| pixel % width).max(apart(|pixel, width| pixel / width)) <= REACH
    };
    let pixels = colours.as_chunks::<4>().0.iter().zip(rgba.as_chunks::<4>().0).enumerate();
    let is_off = |&(i, pair): &(usize, (&[u8; 4], &[u8; 4]))| {
        differs(pair) && !trimmed.iter().any(|&from| reaches(from, i))
    };
    pixels.filter(is_off).count()
}

/// Runs the passes on every adapter and compares each with its CPU twin, with and without smoothing
/// of pixels that stay.
fn assert_same_as_twins(inputs: &[BaseImage<'_>]) {
    [false, true].into_iter().for_each(|smooths| assert_same_as_twins_with(inputs, smooths));
}

fn assert_same_as_twins_with(inputs: &[BaseImage<'_>], smooths: bool) {
    let expected: Vec<_> = inputs.iter().map(|input| run_twins(input, smooths)).collect();
    for gpu in gpus() {
        let mut surface = Surface::default();
        for (input, twins) in inputs.iter().zip(&expected) {
            compare(&gpu, &mut surface, input, twins, smooths);
        }
        assert_eq!(gpu.fault(), None, "{}", gpu.name);
    }
}

fn compare(
    gpu: &Gpu,
    surface: &mut Surface,
    input: &BaseImage<'_>,
    twins: &TwinResults,
    smooths: bool,
) {
    let passes = SurfacePasses::new(gpu, input, smooths);
    let pixels = input.base.front.len();
    let rounds = !gpu.tier.is_software;
    for stage in 0.. {
        let Some(name) = passes.run(surface, stage) else { break };
        let (count, of) = match name {
            "pull" | "push" => {
                let levels = passes.levels();
                let (cpu, count) = if name == "pull" {
                    let pairs = twins.pulled.levels.iter().zip(&levels);
                    let differ = pairs.flat_map(|(a, b)| differing(a, b, false));
                    (&twins.pulled, differ.filter(|&d| d).count())
                } else {
                    (&twins.pushed, differing_pushed(&twins.pushed.levels, &levels, rounds))
                };
                // The next pass starts from the same values as its twin.
                passes.write_levels(if name == "pull" { &cpu.levels } else { &cpu.levels[..1] });
                (count, levels.iter().map(|l| l.front.len()).sum())
            }
            "fill_holes" => {
                let depth = passes.floats(surface.filled().unwrap(), pixels);
                (differing_depths(&twins.filled, &depth), pixels)
            }
            "silhouette" => {
                let depth = passes.floats(&passes.picture.depth, pixels);
                (differing_depths(&twins.picture.depth, &depth), pixels)
            }
            "antialias" => {
                let bytes = pixels as u64 * 4;
                let rgba = read(gpu, &[(&passes.picture.rgba, bytes)]).unwrap().remove(0);
                assert_eq!(texture(&passes), rgba);
                let depth = passes.floats(&passes.picture.depth, pixels);
                (pixels_off(twins, &rgba, &depth, rounds), pixels)
            }
            _ => (0, pixels),
        };
        let is_same = count * 1000 <= of || input.has_ties && rounds;
        assert!(is_same, "{}: {}: {name}: {count} of {of}", gpu.name, input.name);
    }
    assert_eq!(gpu.fault(), None, "{}: {}", gpu.name, input.name);
}

/// Reads the texture of the picture.
fn texture(passes: &SurfacePasses<'_>) -> Vec<u8> {
    let (gpu, picture) = (passes.gpu, &passes.picture);
    let row = (picture.width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let usage = BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    let buffer = gpu.buffer("texture", u64::from(row * picture.height), usage).unwrap();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        picture.texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        picture.texture.size(),
    );
    gpu.queue.submit([encoder.finish()]);
    let bytes = read(gpu, &[(&buffer, u64::from(row * picture.height))]).unwrap().remove(0);
    let rows = bytes.chunks(row as usize);
    rows.flat_map(|r| r[..picture.width as usize * 4].to_vec()).collect()
}

/// Two spheres in front of a wall that sticks out on one side. With few points, outlines are
/// trimmed.
fn spheres(points: usize) -> Scene {
    let dice = &mut Dice(7);
    let mut all = sphere(dice, DVec3::new(-0.6, 0.0, 0.0), 1.0, points, [220, 120, 60]);
    all.extend(sphere(dice, DVec3::new(0.9, -0.5, 0.4), 0.6, points / 3, [60, 140, 220]));
    let side = (points as f64).sqrt() as usize;
    let (corner, u, v) = (DVec3::new(-2.5, 2.0, -1.0), DVec3::X * 3.0, DVec3::Z * 2.4);
    all.extend(sheet(dice, corner, u, v, side, [180, 200, 90]));
    let spacing = (4.0 * std::f64::consts::PI / points as f64).sqrt();
    Scene::new(&all, 1e-6, spacing, spacing, 4000)
}

fn view(width: u32, height: u32) -> View {
    View::look_at(DVec3::new(0.4, -5.0, 0.8), DVec3::ZERO, DVec3::Z, 0.8, width, height)
}

#[test]
fn each_pass_gives_the_result_of_its_cpu_twin() {
    // Dense points, and discs so wide that smoothing runs all its rounds.
    for points in [30_000, 600] {
        let (scene, view) = (spheres(points), view(203, 117));
        for has_normals in [false, true] {
            let draws = scene.draws(true, true, has_normals);
            let input = BaseImage::of(&format!("{points} points"), scene.frame(&view, &draws));
            assert_eq!(input.planes, if has_normals { Planes::Normals } else { Planes::Fitted });
            let twins = run_twins(&input, false);
            let differ = |a: &[f32], b: &[f32]| a.iter().zip(b).filter(|(a, b)| a != b).count();
            let mut pushed = twins.filled.clone();
            twins.pushed.levels[0].depth_image(&twins.pushed.lens, &mut pushed);
            let (closed, gone) =
                (differ(&pushed, &twins.filled), differ(&twins.filled, &twins.picture.depth));
            assert!(points > 1000 || (closed > 0 && gone > 100), "{closed} closed, {gone} gone");
            assert_same_as_twins(&[input]);
        }
    }
}

#[test]
fn nodes_with_and_without_normals_are_drawn_together() {
    let (scene, view) = (spheres(4_000), view(160, 131));
    let mut draws = scene.draws(true, true, true);
    draws.iter_mut().step_by(2).for_each(|d| d.normal = None);
    let mut frame = scene.frame(&view, &draws);
    frame.background = Background::Plain([0; 4]);
    assert_same_as_twins(&[BaseImage::of("mixed", frame)]);
}

#[test]
fn pictures_of_any_size_and_empty_ones_are_drawn() {
    let scene = spheres(2_000);
    let views =
        [(1, 1), (1, 9), (64, 1), (2, 2), (37, 3), (8, 8), (130, 66)].map(|(w, h)| view(w, h));
    let [with, without] = [true, false].map(|n| scene.draws(true, true, n));
    let mut inputs = Vec::new();
    for view in &views {
        inputs.push(BaseImage::of("normals", scene.frame(view, &with)));
        inputs.push(BaseImage::of("bare", scene.frame(view, &without)));
        inputs.push(BaseImage::of("empty", scene.frame(view, &[])));
    }
    assert_same_as_twins(&inputs);
}

/// Radii that reach exactly from the centre of one pixel to that of another.
const TIES: [f32; 6] = [0.5, 0.5, 2.0, 9.0, 60.0, 1e30];
/// Radii that do not.
const NO_TIES: [f32; 6] = [0.53, 0.53, 2.1, 9.3, 61.7, 1e30];

/// Fills level 0 with random pixels: few different depths, and radii up to 1e30.
fn extreme(base: &mut Level, seed: u64, radii: [f32; 6]) {
    let dice = &mut Dice(seed);
    let weird = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -4.0, 0.0];
    for i in 0..base.front.len() {
        let at = [0.5, 1.0, 1.0, 1.01, 4.0, 4.0, 1e4, 1e-3][dice.bits() as usize % 8];
        let radius = radii[(dice.unit().powi(3) * 6.0) as usize];
        let mut light = || match dice.bits() % 16 {
            0 => weird[(dice.bits() >> 8) as usize % weird.len()],
            _ => dice.unit() as f32,
        };
        base.tint[i] = Vec4::new(light(), light(), light(), radius);
        let is_valid = dice.unit() < 0.3;
        let reach = at * (1.0 + dice.unit() as f32);
        base.front[i] = if is_valid { Vec4::new(at, reach, 0.0, 0.0) } else { INVALID };
        base.depth[i] = at;
        if let Some(normal) = base.normal.get_mut(i) {
            let n = Vec4::from_array(std::array::from_fn(|_| dice.unit() as f32 * 2.0 - 1.0));
            *normal =
                [Vec4::splat(1e-30), Vec4::ZERO.with_w(1.0), n][(dice.bits() % 8).min(2) as usize];
        }
    }
}

#[test]
fn extreme_values_give_a_valid_picture_equal_to_the_cpu() {
    let (scene, view) = (spheres(100), view(97, 75));
    let mut inputs = Vec::new();
    let [with, without] = [true, false].map(|n| scene.draws(true, true, n));
    for (seed, draws) in [(1, &with), (2, &without), (3, &with), (4, &without)] {
        for radii in [TIES, NO_TIES] {
            let mut input = BaseImage::of(&format!("extreme {seed}"), scene.frame(&view, draws));
            input.has_ties = radii == TIES;
            extreme(&mut input.base, seed, radii);
            inputs.push(input);
        }
    }
    assert_same_as_twins(&inputs);
}

#[test]
fn the_next_picture_reuses_the_memory_of_the_last() {
    let scene = spheres(500);
    let draws = scene.draws(true, true, true);
    for gpu in gpus() {
        let mut surface = Surface::default();
        let mut bytes = Vec::new();
        for size in [64, 32, 64] {
            let view = view(size, size);
            let passes = SurfacePasses::new(
                &gpu,
                &BaseImage::of("memory", scene.frame(&view, &draws)),
                false,
            );
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let SurfacePasses { uniform, pyramid, picture, .. } = &passes;
            let timing = &mut Timing::default();
            // Switching smoothing off and on again allocates no more memory and moves no buffer.
            let mut allocated = Vec::new();
            for smooths in [true, false, true] {
                let plan = FramePlan::new(&Frame { smooths, ..scene.frame(&view, &draws) });
                assert_eq!(plan.smooths, smooths);
                surface
                    .encode(&gpu, &mut encoder, &plan, uniform, pyramid, picture, timing)
                    .unwrap();
                allocated.push((gpu.bytes(), surface.sources().cloned()));
            }
            assert!(allocated.iter().all(|other| *other == allocated[0]));
            gpu.queue.submit([encoder.finish()]);
            bytes.push(gpu.bytes());
        }
        assert!(bytes[1] < bytes[0] && bytes[2] == bytes[0], "{bytes:?}");
        surface.release();
        assert_eq!(gpu.fault(), None);
    }
}
