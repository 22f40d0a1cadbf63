//! Push on the GPU: a dispatch a level, the coarsest first. In clouds with normals, pixels of the
//! first levels without a normal then inherit one from the level above, for
//! [`crate::gpu::passes::shade`]. Paper: `marroquim2007`, section 3.3. Twin:
//! [`crate::passes::push`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::device::variants::Variants;
use crate::gpu::memory::pyramid::{GpuLevel, GpuPyramid};
use crate::gpu::passes::pull::level_resources;
use crate::picture::pyramid::Planes;
use crate::picture::surface::NORMAL_LEVELS;

same_values!(push_push == crate::passes::push { HIDING_PX, ENCLOSING, SMOOTH, NEAR, ROUNDING });
without_twin!(common_ellipse { FACING });

/// The pass.
pub struct Push {
    /// Variants: number of values of a pixel's plane, and whether pixels that are kept are
    /// smoothed.
    kernels: Variants<2>,
    planes: Planes,
    /// `None` without normals.
    inherit: Option<Kernel>,
}

impl Push {
    /// Builds the kernels for pyramids whose pixels carry `planes`.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, planes: Planes) -> Result<Self, GpuError> {
        let mut kernels = Variants::new(sources::PUSH_PUSH, ["PLANE", "SMOOTHS"]);
        kernels.get(gpu, [planes.values() as u32, 0])?;
        let inherit = match planes {
            Planes::Normals => Some(Kernel::new(gpu, sources::PUSH_INHERIT, "main", &[])?),
            Planes::None | Planes::Fitted => None,
        };
        Ok(Self { kernels, planes, inherit })
    }

    /// Dispatches that fill the levels of a pulled pyramid, from the second coarsest down to level
    /// 0, whose kept pixels are smoothed if `smooths`. `uniform` is the frame's.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn dispatches(
        &mut self,
        gpu: &Gpu,
        uniform: &wgpu::Buffer,
        pyramid: &GpuPyramid,
        smooths: bool,
    ) -> Result<Vec<Dispatch>, GpuError> {
        let values = self.planes.values() as u32;
        let mut dispatches = Vec::new();
        for (level, l) in pyramid.levels.windows(2).enumerate().rev() {
            let kernel = self.kernels.get(gpu, [values, u32::from(smooths && level == 0)])?;
            let resources = level_resources(uniform, &l[0], &l[1]);
            dispatches.push(Dispatch::over(gpu, kernel, [l[0].width, l[0].height], &resources));
        }
        let inherit = self.inherit.iter().flat_map(|kernel| {
            let levels = pyramid.levels.windows(2).take(NORMAL_LEVELS).skip(1).rev();
            levels.map(|l| inherit(gpu, kernel, &l[0], &l[1]))
        });
        dispatches.extend(inherit);
        Ok(dispatches)
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        self.kernels.all().chain(&mut self.inherit).collect()
    }
}

fn inherit(gpu: &Gpu, kernel: &Kernel, fine: &GpuLevel, coarse: &GpuLevel) -> Dispatch {
    let buffers = [&fine.shape, &coarse.shape, &fine.plane, &coarse.plane];
    let resources = [0, 1, 2, 3].map(|i| (i as u32, buffers[i].as_entire_binding()));
    Dispatch::over(gpu, kernel, [fine.width, fine.height], &resources)
}
