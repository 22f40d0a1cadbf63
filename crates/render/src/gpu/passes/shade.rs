//! Shade on the GPU: lights level 0 with a deferred Phong model. Paper: `marroquim2007`, section
//! 3.4. Twin: [`crate::passes::shade`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::variants::Variants;
use crate::gpu::target::SurfaceTarget;

same_values!(common_phong == crate::passes::shade {
    KEY[..] = KEY.to_array(),
    KEY_SHARE,
    EYE_SHARE,
    SKY_SHARE,
    GROUND_SHARE,
    SHINE,
});
same_values!(shade_shade == crate::passes::shade {
    EDGE[..] = [EDGE.0, EDGE.1],
    DOME[..] = [DOME.0, DOME.1],
});
same_values!(shade_shade == crate::passes::smooth_depth { REACH, BEHIND_MAX });

/// The pass.
pub struct Shade {
    /// Variants: whether pixels carry normals, whether surfaces have highlights, and whether they
    /// are darkened behind edges.
    kernels: Variants<3>,
    has_normals: bool,
}

impl Shade {
    /// Builds the kernels for pyramids with or without normals.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu, has_normals: bool) -> Result<Self, GpuError> {
        let mut kernels = Variants::new(sources::SHADE_SHADE, ["NORMALS", "SHINES", "EDGES"]);
        kernels.get(gpu, [u32::from(has_normals), 1, 1])?;
        Ok(Self { kernels, has_normals })
    }

    /// Dispatches that light level 0 to [`SurfaceTarget::shaded`], with highlights if `shines`, and
    /// darken it behind edges if `darkens_edges`.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn dispatches(
        &mut self,
        gpu: &Gpu,
        target: &SurfaceTarget<'_>,
        shines: bool,
        darkens_edges: bool,
    ) -> Result<Vec<Dispatch>, GpuError> {
        let (base, levels) = (target.base(), &target.pyramid.levels);
        let coarse = levels.get(1).unwrap_or(base);
        let depth = if self.has_normals { &target.picture.depth } else { target.spare };
        let (tint, normal, coarse) = (&base.tint, &base.plane, &coarse.plane);
        let &SurfaceTarget { radii, sources, shaded, .. } = target;
        let buffers = [&radii.corners, depth, tint, normal, coarse, sources, shaded];
        let kernel =
            self.kernels.get(gpu, [self.has_normals, shines, darkens_edges].map(u32::from))?;
        Ok(vec![target.dispatch(gpu, kernel, &buffers)])
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        self.kernels.all().collect()
    }
}
