//! Pull on the GPU: a dispatch a level, the finest first. Paper: `marroquim2007`, section 3.2.
//! Twin: [`crate::passes::pull`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::memory::pyramid::{GpuLevel, GpuPyramid};
use crate::picture::pyramid::Planes;
use wgpu::BindingResource;

same_values!(pull_pull == crate::passes::pull { AGREE2 });

/// The pass.
pub struct Pull {
    kernel: Kernel,
}

impl Pull {
    /// Builds the kernels for pyramids whose pixels carry `planes`.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu, planes: Planes) -> Result<Self, GpuError> {
        let constants = [("PLANE", planes.values() as f64)];
        Ok(Self { kernel: Kernel::new(gpu, sources::PULL_PULL, "main", &constants)? })
    }

    /// Dispatches that fill all levels but level 0; `uniform` is the frame's.
    pub fn dispatches(
        &self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
    ) -> Vec<Dispatch> {
        let levels = pyramid.levels.windows(2).map(|l| {
            let resources = level_resources(uniform, &l[0], &l[1]);
            Dispatch::over(gpu, &self.kernel, [l[1].width, l[1].height], &resources)
        });
        levels.collect()
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        vec![&mut self.kernel]
    }
}

/// Bindings of two levels in pull and push: both shapes, all planes of the finer and of the coarser
/// level, and the frame.
pub(crate) fn level_resources<'a>(
    uniform: &'a wgpu::Buffer,
    fine: &'a GpuLevel,
    coarse: &'a GpuLevel,
) -> [(u32, BindingResource<'a>); 11] {
    let buffers: [&wgpu::Buffer; 11] = [
        &fine.shape,
        &coarse.shape,
        &fine.front,
        &fine.tint,
        &fine.depth,
        &fine.plane,
        &coarse.front,
        &coarse.tint,
        &coarse.depth,
        &coarse.plane,
        uniform,
    ];
    std::array::from_fn(|i| (i as u32, buffers[i].as_entire_binding()))
}
