//! A kernel: one entry point of a shader with values for its `override`s, as a compute pipeline. In
//! a debug run a kernel is rebuilt when its shader has changed on disk; if the new one does not
//! build, the error is reported and the old one stays.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{Source, folder};
use crate::gpu::device::{DispatchCount, Gpu};
use std::thread::{self, Scope, ScopedJoinHandle};
use std::time::SystemTime;

/// A compute pipeline, and the parameters that it was built from.
pub struct Kernel {
    source: Source,
    entry: &'static str,
    constants: Vec<(&'static str, f64)>,
    is_zeroed: bool,
    pipeline: wgpu::ComputePipeline,
    changed: Option<SystemTime>,
    count: DispatchCount,
}

impl Kernel {
    /// Builds an entry point of a shader; `constants` are values of its `override`s.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
    ) -> Result<Self, GpuError> {
        Self::build(gpu, source, entry, constants, true)
    }

    /// Builds a kernel like [`Kernel::new`] whose workgroup memory is not zeroed first: the shader
    /// reads only what it has written. It saves time if that memory is large.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn unzeroed(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
    ) -> Result<Self, GpuError> {
        Self::build(gpu, source, entry, constants, false)
    }

    fn build(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
        is_zeroed: bool,
    ) -> Result<Self, GpuError> {
        let pipeline = pipeline(gpu, source.file, source.wgsl, entry, constants, is_zeroed)?;
        gpu.built(source.file);
        let changed = folder().and_then(|f| source.read(&f).ok()).and_then(|(_, time)| time);
        let (constants, count) = (constants.to_vec(), gpu.dispatch_count().clone());
        Ok(Self { source, entry, constants, is_zeroed, pipeline, changed, count })
    }

    /// Rebuilds the kernel if its shader has changed in [`crate::gpu::device::shader::folder`].
    /// Whether it has.
    ///
    /// # Errors
    /// If the changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let Some(folder) = folder() else { return Ok(false) };
        let (text, changed) = self.source.read(&folder)?;
        if changed <= self.changed {
            return Ok(false);
        }
        self.changed = changed;
        let Self { source, entry, constants, is_zeroed, .. } = self;
        self.pipeline = pipeline(gpu, source.file, &text, entry, constants, *is_zeroed)?;
        Ok(true)
    }

    /// The pipeline.
    pub fn pipeline(&self) -> &wgpu::ComputePipeline {
        &self.pipeline
    }

    /// The counter of its dispatches.
    pub fn dispatch_count(&self) -> &DispatchCount {
        &self.count
    }

    /// Creates a bind group of whole buffers for group 0.
    pub fn bind(&self, gpu: &Gpu, buffers: &[(u32, &wgpu::Buffer)]) -> wgpu::BindGroup {
        let entries: Vec<_> = buffers
            .iter()
            .map(|&(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.entry),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        })
    }

    /// Encodes a dispatch of `groups` workgroups.
    pub fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        bind: &wgpu::BindGroup,
        groups: [u32; 3],
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
        self.count.add_one();
    }
}

/// Kernels that are built on a thread of their own: a driver compiles on the thread that calls it.
pub struct Compilation<'s, T>(ScopedJoinHandle<'s, Result<T, GpuError>>);

impl<'s, T: Send + 's> Compilation<'s, T> {
    /// Starts a thread that calls `build`.
    ///
    /// # Errors
    /// If the system refuses a thread.
    pub fn start(
        scope: &'s Scope<'s, '_>,
        build: impl FnOnce() -> Result<T, GpuError> + Send + 's,
    ) -> Result<Self, GpuError> {
        let started =
            thread::Builder::new().name("esker-compile".into()).spawn_scoped(scope, build);
        started.map(Self).map_err(|e| GpuError::Shader(format!("compilation got no thread: {e}")))
    }

    /// Waits for the thread and gives its result.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn finish(self) -> Result<T, GpuError> {
        self.0.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Workgroups of 256 items each, in rows as long as WebGPU's limits allow; a shader's item is
/// `id.x + id.y * groups.x * 256`.
pub fn groups_of(items: u64) -> [u32; 3] {
    const ROW_MAX: u64 = 65_535;
    let groups = items.div_ceil(256);
    let rows = groups.div_ceil(ROW_MAX).max(1);
    [groups.div_ceil(rows) as u32, rows as u32, 1]
}

fn pipeline(
    gpu: &Gpu,
    file: &str,
    wgsl: &str,
    entry: &str,
    constants: &[(&str, f64)],
    is_zeroed: bool,
) -> Result<wgpu::ComputePipeline, GpuError> {
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(file),
        source: wgpu::ShaderSource::Wgsl(wgsl.into()),
    });
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(file),
        layout: None,
        module: &module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants,
            zero_initialize_workgroup_memory: is_zeroed,
        },
        cache: None,
    });
    match pollster::block_on(scope.pop()) {
        Some(e) => Err(GpuError::Shader(format!("{file}: {e}"))),
        None => Ok(pipeline),
    }
}
