//! Compares compute tiles with instanced quads for EWA splatting on a GPU, on the same splats of
//! nine pixels. Quads do the passes of `zwicker2004`, section 6, with fixed-function hardware: a
//! quad a splat, visibility by a depth test on the depth that fragments write, attributes summed by
//! blending into targets of 16 bits a component and, if the device supports it, of 32.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measurement")]

#[path = "../tests/gpu/mod.rs"]
mod gpu;
#[path = "../tests/scene/mod.rs"]
#[allow(dead_code, reason = "shared with tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::ewa::splat::{Disc, Lens, Placement};
use esker_render::gpu::wgpu::{self, BufferUsages, Features, TextureFormat, util::DeviceExt};
use esker_render::gpu::{GpuRenderer, GpuRequest};
use esker_render::inputs::camera::Camera;
use esker_render::{Frame, Method, Pass};
use glam::{DVec3, Vec2, Vec3};
use scene::{Dice, Scene, sheet};
use std::time::Instant;

const SIZE: u32 = 512;
const FRAMES: usize = 5;
const CUTOFF: f32 = 1.5;

const QUADS: &str = "
struct Settings { size: vec2<f32>, near: f32, half_cutoff: f32 }
@group(0) @binding(0) var<storage, read> splats: array<Splat>;
@group(0) @binding(1) var<storage, read> boxes: array<vec4<u32>>;
@group(0) @binding(2) var<uniform> settings: Settings;

struct Corner { @builtin(position) at: vec4<f32>, @location(0) @interpolate(flat) splat: u32 }

@vertex
fn quad(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    let b = vec4<f32>(boxes[i]);
    let at = vec2<f32>(select(b.x, b.y, (v & 1u) == 1u), select(b.z, b.w, v >= 2u)) / settings.size;
    return Corner(vec4<f32>(at.x * 2.0 - 1.0, 1.0 - at.y * 2.0, 0.5, 1.0), i);
}

@fragment
fn visibility(in: Corner) -> @builtin(frag_depth) f32 {
    let splat = splats[in.splat];
    let seen = seen_at(splat, in.at.xy, settings.near);
    if seen.x > 1.0 { discard; }
    return (min(seen.y, splat.b.w) - splat.c.w) * settings.near;
}

struct Sums { @location(0) tint: vec4<f32>, @location(1) shape: vec4<f32>, @builtin(frag_depth) depth: f32 }

@fragment
fn attributes(in: Corner) -> Sums {
    let splat = splats[in.splat];
    let seen = seen_at(splat, in.at.xy, settings.near);
    if seen.x > 1.0 { discard; }
    let weight = exp(-seen.x * settings.half_cutoff) * abs(splat.b.y);
    let tint = vec4<f32>(bitcast<vec3<f32>>(splat.d.xyz), 1.0) * weight;
    return Sums(tint, vec4<f32>(unpacked_normal(splat.d.w), seen.y) * weight, seen.y * settings.near);
}
";

fn main() {
    let request = GpuRequest { allow_software: true, ..GpuRequest::default() };
    for side in [316, 806] {
        let view = View::look_at(DVec3::NEG_Y * 4.0, DVec3::ZERO, DVec3::Z, 0.6, SIZE, SIZE);
        let half = 4.0 * 0.3f64.tan() * 0.98;
        let (u, v) = (DVec3::X * half * 2.0, DVec3::Z * half * 2.0);
        // Nine pixels with the low-pass.
        let radius_px = (9.0 / std::f64::consts::PI - f64::from(CUTOFF * CUTOFF)).sqrt();
        let radius = radius_px * 4.0 / view.focal_px();
        let points = sheet(&mut Dice(7), (u + v) * -0.5, u, v, side, [200, 120, 60]);
        let scene = Scene::new(&points, 1e-6, radius / 1.2, radius / 1.2, 1 << 16);
        let draws = scene.draws(true, true, true);
        let frame = Frame { method: Method::Ewa, ..scene.frame(&view, &draws) };

        let gpu = esker_render::gpu::Gpu::open(&request).unwrap();
        let uploaded = gpu::upload(&gpu, &draws, gpu.tier.page_bytes_max);
        let mut renderer = GpuRenderer::new(&gpu).unwrap();
        let mut best = [f64::INFINITY; 2];
        for _ in 0..FRAMES {
            renderer.render(&gpu::uploaded_frame(&frame, &uploaded.draws), &uploaded.pool).unwrap();
            renderer.read().unwrap();
            let stages = renderer.stats().unwrap().stages;
            best = [best[0].min(stages.ms(Pass::Place)), best[1].min(stages.ms(Pass::Blend))];
        }
        println!("{}: {} splats, {SIZE} x {SIZE}", gpu.name, points.len());
        println!(
            "  compute tiles: splats and their sorting {:.1} ms, blending {:.1}",
            best[0], best[1]
        );
        for format in [TextureFormat::Rgba16Float, TextureFormat::Rgba32Float] {
            match quads(&frame, &points, radius as f32, format) {
                Some([visibility, attributes]) => println!(
                    "  quads, {format:?}: visibility {visibility:.1} ms, attributes {attributes:.1}"
                ),
                None => println!("  quads, {format:?}: this device cannot blend them"),
            }
        }
    }
}

/// Milliseconds of both passes, for splats that are already projected; `None` if the device cannot
/// blend `format`.
fn quads(
    frame: &Frame<'_>,
    points: &[scene::ScenePoint],
    radius: f32,
    format: TextureFormat,
) -> Option<[f64; 2]> {
    let camera = Camera::new(frame.view, frame.lattice).unwrap();
    let lens = Lens {
        focal_px: camera.focal_px,
        centre_px: Vec2::from_array(camera.centre_px),
        origin_px: Vec2::ZERO,
        size: Vec2::splat(SIZE as f32),
        near: camera.near,
        lowpass: CUTOFF * CUTOFF,
    };
    let (mut splats, mut boxes) = (Vec::<u8>::new(), Vec::<u8>::new());
    for p in points {
        let at = Vec3::new(p.at.x as f32, -p.at.z as f32, (p.at.y + 4.0) as f32);
        let Placement::Drawn(s, b) = Disc::round(at, Vec3::NEG_Z, radius).place(&lens) else {
            continue;
        };
        let (form, z) = (s.form, s.inverse_depth);
        let words =
            [s.origin[0], s.origin[1], form[0], form[1], form[2], form[3], form[4], form[5]];
        let words = words.into_iter().chain([z[0], z[1], z[2], s.back, 0.5, 0.2, 0.1, 0.0]);
        splats.extend(words.flat_map(f32::to_le_bytes));
        boxes.extend(b.into_iter().flat_map(u32::to_le_bytes));
    }
    let count = (boxes.len() / 16) as u32;

    let instance = wgpu::Instance::default();
    let options = wgpu::RequestAdapterOptions::default();
    let adapter = pollster::block_on(instance.request_adapter(&options)).ok()?;
    let mut features = adapter.features() & Features::FLOAT32_BLENDABLE;
    if format == TextureFormat::Rgba16Float {
        features = Features::empty();
    } else if features.is_empty() {
        return None;
    }
    let descriptor = wgpu::DeviceDescriptor { required_features: features, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).ok()?;

    let source = [
        include_str!("../../../shaders/common/infinite.wgsl"),
        include_str!("../../../shaders/common/splats.wgsl"),
        QUADS,
    ]
    .concat();
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let settings = [SIZE as f32, SIZE as f32, camera.near, 0.5 * CUTOFF * CUTOFF];
    let settings: Vec<u8> = settings.into_iter().flat_map(f32::to_le_bytes).collect();
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents,
            usage,
        })
    };
    let buffers = [
        buffer(&splats, BufferUsages::STORAGE),
        buffer(&boxes, BufferUsages::STORAGE),
        buffer(&settings, BufferUsages::UNIFORM),
    ];
    let texture = |format| {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: SIZE, height: SIZE, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&wgpu::TextureViewDescriptor::default())
    };
    let (depth, sums) = (texture(TextureFormat::Depth32Float), [texture(format), texture(format)]);
    let added = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    let target = wgpu::ColorTargetState {
        format,
        blend: Some(wgpu::BlendState { color: added, alpha: added }),
        write_mask: wgpu::ColorWrites::ALL,
    };
    let layout = {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let read = wgpu::BufferBindingType::Storage { read_only: true };
        let entries = [entry(0, read), entry(1, read), entry(2, wgpu::BufferBindingType::Uniform)];
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
        device.create_bind_group_layout(&descriptor)
    };
    let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(&layout)],
        ..Default::default()
    });
    let pipeline = |entry, targets: &[Option<wgpu::ColorTargetState>], writes, compare| {
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: None,
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("quad"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..Default::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: TextureFormat::Depth32Float,
                depth_write_enabled: Some(writes),
                depth_compare: Some(compare),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    };
    let targets = [Some(target.clone()), Some(target)];
    let passes = [
        pipeline("visibility", &[], true, wgpu::CompareFunction::Greater),
        pipeline("attributes", &targets, false, wgpu::CompareFunction::GreaterEqual),
    ];
    let entries = [0, 1, 2].map(|i| wgpu::BindGroupEntry {
        binding: i as u32,
        resource: buffers[i].as_entire_binding(),
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &layout,
        entries: &entries,
    });
    let mut best = [f64::INFINITY; 2];
    for _ in 0..FRAMES {
        for (number, pipeline) in passes.iter().enumerate() {
            let start = Instant::now();
            let mut encoder =
                device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let cleared = |view| {
                let load = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
                let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops,
                })
            };
            let colours: Vec<_> =
                if number == 1 { sums.iter().map(cleared).collect() } else { vec![] };
            let load = if number == 0 { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: None,
                color_attachments: &colours,
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth,
                    depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..4, 0..count);
            drop(pass);
            queue.submit([encoder.finish()]);
            device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
            best[number] = best[number].min(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    Some(best)
}
