//! Push on the GPU ([`crate::push`] is the twin): a dispatch a level, the coarsest first. With normals, pixels of
//! the coarser levels that have none then inherit one, for [`super::shade`].

use super::device::Gpu;
use super::dispatch::Dispatch;
use super::error::GpuError;
use super::kernel::Kernel;
use super::pull::level_resources;
use super::pyramid::{GpuLevel, GpuPyramid};
use super::shader::sources;

/// The pass.
pub struct Push {
    kernel: Kernel,
    /// With normals only.
    inherit: Option<Kernel>,
}

impl Push {
    /// For pyramids with normals or without.
    ///
    /// # Errors
    /// Where a shader is refused.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(has_normals))];
        let inherit = || Kernel::new(gpu, sources::PUSH_INHERIT, "main", &[]);
        Ok(Self {
            kernel: Kernel::new(gpu, sources::PUSH_PUSH, "main", &constants)?,
            inherit: if has_normals { Some(inherit()?) } else { None },
        })
    }

    /// What fills the levels of a pyramid that was pulled, from the second coarsest down to the picture.
    /// `uniform` is the frame's.
    pub fn dispatches(
        &self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
    ) -> Vec<Dispatch> {
        let levels = || pyramid.levels.windows(2).rev();
        let push = levels().map(|l| {
            let resources = level_resources(uniform, &l[0], &l[1]);
            Dispatch::over(gpu, &self.kernel, [l[0].width, l[0].height], &resources)
        });
        let inherit = self.inherit.iter().flat_map(|kernel| {
            let above_the_picture = pyramid.levels.len().saturating_sub(2);
            levels().take(above_the_picture).map(|l| inherit(gpu, kernel, &l[0], &l[1]))
        });
        push.chain(inherit).collect()
    }

    pub(super) fn kernels(&mut self) -> Vec<&mut Kernel> {
        std::iter::once(&mut self.kernel).chain(&mut self.inherit).collect()
    }
}

fn inherit(gpu: &Gpu, kernel: &Kernel, fine: &GpuLevel, coarse: &GpuLevel) -> Dispatch {
    let buffers = [&fine.shape, &coarse.shape, &fine.normal, &coarse.normal];
    let resources = [0, 1, 2, 3].map(|i| (i as u32, buffers[i].as_entire_binding()));
    Dispatch::over(gpu, kernel, [fine.width, fine.height], &resources)
}
