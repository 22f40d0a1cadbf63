//! Project by point primitives (`shaders/primitives/`), for devices without 64-bit atomics: a draw
//! for each combination of pages, with an instance a chunk and vertices that read their points from
//! the pages; then a kernel copies the result to the frame buffer.
//!
//! The target of two integers and the depth buffer can be rendered to wherever WebGPU or OpenGL ES
//! 3 is available. The depth test compares keys in the order of the linear depths, bit for bit, so
//! that the same points win as by atomics. Twin: [`crate::passes::project`].

use crate::gpu::device::Gpu;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{Source, folder, sources};
use crate::gpu::device::timing::Timing;
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::hits::Hits;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::table::CHUNK_POINTS;
use crate::pass::Pass;
use crate::plan::FramePlan;
use std::time::SystemTime;
use wgpu::{TextureFormat, TextureUsages, TextureView};

/// Format of the number of a point and the bits of its depth.
const DRAWN: TextureFormat = TextureFormat::Rg32Uint;
/// Format of the key of the depth.
const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// Side of a workgroup of the packing kernel, pixels.
const PACK_SIDE: u32 = 16;

/// The pass.
pub struct Primitives {
    /// By whether points are culled by their normals, whether a filter hides points, and
    /// whether points are left out that are closer together than asked.
    pipelines: [[[wgpu::RenderPipeline; 2]; 2]; 2],
    changed: Option<SystemTime>,
    pack: Kernel,
    target: Option<Attachments>,
}

struct Attachments {
    size: [u32; 2],
    drawn: TextureView,
    depth: TextureView,
}

impl Primitives {
    /// Builds the pipelines, on any device.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let source = sources::PRIMITIVES_POINTS;
        let changed = folder().and_then(|f| source.read(&f).ok()).and_then(|(_, time)| time);
        Ok(Self {
            pipelines: pipelines(gpu, source, source.wgsl)?,
            changed,
            pack: Kernel::new(gpu, sources::PRIMITIVES_PACK, "main", &[])?,
            target: None,
        })
    }

    /// Allocates the textures for a picture of `size`, if they have another size so far.
    ///
    /// # Errors
    /// If it is larger than a texture of the device.
    pub fn fit(&mut self, gpu: &Gpu, size: [u32; 2]) -> Result<(), GpuError> {
        if self.target.as_ref().is_some_and(|t| t.size == size) {
            return Ok(());
        }
        self.target = None;
        let [width, height] = size;
        if width.max(height) > gpu.device.limits().max_texture_dimension_2d {
            return Err(GpuError::Size { width, height });
        }
        let view = |label, format, usage| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let usage = TextureUsages::RENDER_ATTACHMENT;
        self.target = Some(Attachments {
            size,
            drawn: view("drawn points", DRAWN, usage | TextureUsages::TEXTURE_BINDING),
            depth: view("depth of points", DEPTH, usage),
        });
        Ok(())
    }

    /// Encodes the drawing of the cut to `hits`.
    #[allow(clippy::too_many_arguments, reason = "each input of a pass has its own argument")]
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        uniform: &wgpu::Buffer,
        plan: &FramePlan,
        cut: &GpuCut,
        pool: &NodePool,
        hits: &Hits,
        timing: &mut Timing,
    ) {
        let (Some(to), Some(target)) = (hits.buffer(), &self.target) else { return };
        let [culls, hides, thins] = plan.project_constants().map(|(_, value)| value as usize);
        let pipeline = &self.pipelines[culls][hides][thins];
        let layout = pipeline.get_bind_group_layout(0);
        let mut pass = begin(encoder, target, timing);
        pass.set_pipeline(pipeline);
        for work in &cut.work {
            let Some(bind) = cut.bind(gpu, &layout, uniform, work, pool, &[]) else { continue };
            pass.set_bind_group(0, &bind, &[]);
            pass.draw(0..CHUNK_POINTS, 0..work.range.len() as u32);
            gpu.dispatch_count().add_one();
        }
        drop(pass);
        let bind = self.bind_pack(gpu, uniform, target, to);
        let mut pass = timing.compute(encoder, Pass::Project);
        let [x, y] = target.size.map(|side| side.div_ceil(PACK_SIDE));
        self.pack.dispatch(&mut pass, &bind, [x, y, 1]);
    }

    fn bind_pack(
        &self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        target: &Attachments,
        hits: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pack"),
            layout: &self.pack.pipeline().get_bind_group_layout(0),
            entries: &[
                entry(0, uniform.as_entire_binding()),
                entry(1, wgpu::BindingResource::TextureView(&target.drawn)),
                entry(2, hits.as_entire_binding()),
            ],
        })
    }

    /// Rebuilds the pipelines if a shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old pipelines stay.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let packs = self.pack.reload(gpu)?;
        let Some(folder) = folder() else { return Ok(packs) };
        let source = sources::PRIMITIVES_POINTS;
        let (text, changed) = source.read(&folder)?;
        if changed <= self.changed {
            return Ok(packs);
        }
        self.changed = changed;
        self.pipelines = pipelines(gpu, source, &text)?;
        Ok(true)
    }
}

fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    target: &Attachments,
    timing: &mut Timing,
) -> wgpu::RenderPass<'e> {
    /// All ones, as a float that is converted to the integers of the target.
    const NONE: f64 = u32::MAX as f64;
    let none = wgpu::Color { r: NONE, g: NONE, b: NONE, a: NONE };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("points"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: &target.drawn,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(none), store: wgpu::StoreOp::Store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &target.depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(1.0),
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }),
        timestamp_writes: timing.render(Pass::Project),
        ..Default::default()
    })
}

fn pipelines(
    gpu: &Gpu,
    source: Source,
    wgsl: &str,
) -> Result<[[[wgpu::RenderPipeline; 2]; 2]; 2], GpuError> {
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(source.file),
        source: wgpu::ShaderSource::Wgsl(wgsl.into()),
    });
    let made = [0.0, 1.0].map(|culls| {
        let with = |hides, thins| pipeline(gpu, &module, [culls, hides, thins]);
        [0.0, 1.0].map(|hides| [0.0, 1.0].map(|thins| with(hides, thins)))
    });
    match pollster::block_on(scope.pop()) {
        Some(e) => Err(GpuError::Shader(format!("{}: {e}", source.file))),
        None => Ok(made),
    }
}

fn pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    [culls, hides, thins]: [f64; 3],
) -> wgpu::RenderPipeline {
    let is_gl = gpu.device.adapter_info().backend == wgpu::Backend::Gl;
    let constants = [("CULLS_BACK_FACES", culls), ("HIDES_POINTS", hides), ("THINS_POINTS", thins)];
    let options = wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("points"),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("vertex"),
            compilation_options: options.clone(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState {
            topology: wgpu::PrimitiveTopology::PointList,
            ..Default::default()
        },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Less),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(if is_gl { "fragment_exact" } else { "fragment" }),
            compilation_options: options,
            targets: &[Some(DRAWN.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
