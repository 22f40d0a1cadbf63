//! A kernel: one entry point of a shader with its constants, as a compute pipeline. In a debug run a kernel
//! whose shader has changed on the disk is made anew; where the new one does not build, the last good one
//! goes on running and the fault is told.

use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{Source, folder};
use crate::gpu::device::{DispatchCount, Gpu};
use std::thread::{self, Scope, ScopedJoinHandle};
use std::time::SystemTime;

/// A compute pipeline and how it is made.
pub struct Kernel {
    source: Source,
    entry: &'static str,
    constants: Vec<(&'static str, f64)>,
    is_zeroed: bool,
    pipeline: wgpu::ComputePipeline,
    changed: Option<SystemTime>,
    runs: DispatchCount,
}

impl Kernel {
    /// Builds the entry point of a shader; `constants` are its `override`s.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
    ) -> Result<Self, GpuError> {
        Self::made(gpu, source, entry, constants, true)
    }

    /// As [`Kernel::new`], but the memory that groups share is not zeroed first: the shader writes what it reads.
    /// Worth it where that memory is large.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn unzeroed(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
    ) -> Result<Self, GpuError> {
        Self::made(gpu, source, entry, constants, false)
    }

    fn made(
        gpu: &Gpu,
        source: Source,
        entry: &'static str,
        constants: &[(&'static str, f64)],
        is_zeroed: bool,
    ) -> Result<Self, GpuError> {
        let pipeline = pipeline(gpu, source.file, source.wgsl, entry, constants, is_zeroed)?;
        let changed = folder().and_then(|f| source.read(&f).ok()).and_then(|(_, time)| time);
        let (constants, runs) = (constants.to_vec(), gpu.runs().clone());
        Ok(Self { source, entry, constants, is_zeroed, pipeline, changed, runs })
    }

    /// Makes it anew where its shader has changed on the disk (where [`crate::gpu::device::shader::folder`] is). Whether it has.
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

    /// Its pipeline.
    pub fn pipeline(&self) -> &wgpu::ComputePipeline {
        &self.pipeline
    }

    /// What counts its runs.
    pub fn runs(&self) -> &DispatchCount {
        &self.runs
    }

    /// A bind group of whole buffers for group 0.
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

    /// DispatchCount it over so many groups.
    pub fn dispatch(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        bind: &wgpu::BindGroup,
        groups: [u32; 3],
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
        self.runs.count();
    }
}

/// What is made on a thread of its own: a driver compiles on the thread that asks it to.
pub struct Compilation<'s, T>(ScopedJoinHandle<'s, Result<T, GpuError>>);

impl<'s, T: Send + 's> Compilation<'s, T> {
    /// Begins to make it.
    ///
    /// # Errors
    /// Where the system has no thread to give.
    pub fn begin(
        scope: &'s Scope<'s, '_>,
        make: impl FnOnce() -> Result<T, GpuError> + Send + 's,
    ) -> Result<Self, GpuError> {
        let begun = thread::Builder::new().name("esker-compile".into()).spawn_scoped(scope, make);
        begun.map(Self).map_err(|e| GpuError::Shader(format!("compilation got no thread: {e}")))
    }

    /// What was made.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn get(self) -> Result<T, GpuError> {
        self.0.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Groups of 256 items each, in rows as long as WebGPU's limits allow; the shader counts
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
