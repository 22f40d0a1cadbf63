//! Gather on the GPU: level 0 of the pyramid from the points that won ([`crate::passes::gather`] is the twin). First the
//! points' own bytes are fetched, page by page, into the very planes that they are turned into afterwards.

use crate::gpu::device::Gpu;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::variants::Variants;
use crate::gpu::memory::lookup::{GpuLookup, WinningPoints};
use crate::gpu::memory::pyramid::GpuPyramid;
use crate::gpu::passes::exposure::Exposure;
use crate::gpu::passes::fit_planes::FitPlanes;
use crate::picture::pyramid::Planes;
use crate::plan::FramePlan;
use wgpu::ComputePass;

same_values!(gather_gather == crate::passes::gather {
    RADIUS_FACTOR_NORMALS = RADIUS_FACTOR[0],
    RADIUS_FACTOR_BARE = RADIUS_FACTOR[1],
    RADIUS_MARGIN_PX_NORMALS = RADIUS_MARGIN_PX[0],
    RADIUS_MARGIN_PX_BARE = RADIUS_MARGIN_PX[1],
    MINOR_FACTOR,
    MINOR_MIN_PX,
    BARE_REACH = crate::passes::fit_planes::BARE_REACH,
    THICKNESS,
});
same_values!(common_radius == crate::passes::gather { RADIUS_MAX });
same_values!(common_seen == crate::passes::gather { STRETCHED });

/// The pass.
pub struct Gather {
    /// By whether pixels carry normals and planes, and what gives them their colour.
    kernels: Variants<3>,
    /// The planes that are told where there are no normals.
    pub fit_planes: FitPlanes,
    /// What is told of the points' scans, where that is asked.
    pub exposure: Exposure,
}

impl Default for Gather {
    fn default() -> Self {
        Self {
            kernels: Variants::new(sources::GATHER_GATHER, ["NORMALS", "PLANES", "COLOUR"]),
            fit_planes: FitPlanes::default(),
            exposure: Exposure::default(),
        }
    }
}

impl Gather {
    /// Fills level 0 of a pyramid, which has the picture's size. Adds to the first of the counts.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &mut GpuLookup,
        won: &WinningPoints<'_>,
        pyramid: &GpuPyramid,
    ) -> Result<(), GpuError> {
        let Some(level) = pyramid.levels.first() else { return Ok(()) };
        lookup.fetch(gpu, pass, won, plan, [&level.front, &level.tint])?;
        self.exposure.take(gpu, pass, won, &level.tint);
        let kernel = self.kernels.get(gpu, plan.gather_constants().map(|(_, value)| value))?;
        let buffers = [
            (0, won.uniform),
            (1, lookup.uniform()),
            (2, won.hits),
            (3, won.draws),
            (4, lookup.octree()),
            (5, &level.front),
            (6, &level.tint),
            (7, &level.depth),
            (8, &level.plane),
            (9, won.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), won.groups());
        if plan.planes() == Planes::Fitted {
            self.fit_planes.tilt(gpu, pass, won.uniform, level);
        }
        Ok(())
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        Ok(self.kernels.reload(gpu)? | self.fit_planes.reload(gpu)? | self.exposure.reload(gpu)?)
    }
}
