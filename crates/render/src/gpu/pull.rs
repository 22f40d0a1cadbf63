//! Pull on the GPU ([`crate::pull`] is the twin): a dispatch a level, the finest first.

use super::device::Gpu;
use super::dispatch::Dispatch;
use super::error::GpuError;
use super::kernel::Kernel;
use super::pyramid::{GpuLevel, GpuPyramid};
use super::shader::sources;
use wgpu::BindingResource;

/// The pass.
pub struct Pull {
    kernel: Kernel,
}

impl Pull {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where the shader is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(has_normals))];
        Ok(Self { kernel: Kernel::new(gpu, sources::PULL_PULL, "main", &constants)? })
    }

    /// What fills all levels of a pyramid above the first.
    pub fn dispatches(&self, gpu: &Gpu, pyramid: &GpuPyramid) -> Vec<Dispatch> {
        let levels = pyramid.levels.windows(2);
        levels.map(|l| self.dispatch(gpu, &l[0], &l[1])).collect()
    }

    fn dispatch(&self, gpu: &Gpu, fine: &GpuLevel, coarse: &GpuLevel) -> Dispatch {
        let resources = level_resources(fine, coarse);
        Dispatch::over(gpu, &self.kernel, [coarse.width, coarse.height], &resources)
    }

    pub(super) fn kernels(&mut self) -> Vec<&mut Kernel> {
        vec![&mut self.kernel]
    }
}

/// Two levels as pull and push bind them: both shapes, all planes of the finer, all of the coarser.
pub(super) fn level_resources<'a>(
    fine: &'a GpuLevel,
    coarse: &'a GpuLevel,
) -> [(u32, BindingResource<'a>); 10] {
    let buffers = [
        &fine.shape,
        &coarse.shape,
        &fine.front,
        &fine.tint,
        &fine.depth,
        &fine.normal,
        &coarse.front,
        &coarse.tint,
        &coarse.depth,
        &coarse.normal,
    ];
    std::array::from_fn(|i| (i as u32, buffers[i].as_entire_binding()))
}
