//! Gather on the GPU: fills level 0 of the pyramid from the winning points. The words of the points
//! are fetched, page by page, into the planes of the level, and are replaced there by attributes.
//! Paper: `marroquim2007`, section 3.1. Twin: [`crate::passes::gather`].

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

same_values!(common_facing == crate::simd::values { OUTLINE_COS2 });
same_values!(gather_gather == crate::passes::gather {
    RADIUS_FACTOR_NORMALS = RADIUS_FACTOR[0],
    RADIUS_FACTOR_BARE = RADIUS_FACTOR[1],
    RADIUS_MARGIN_PX_NORMALS = RADIUS_MARGIN_PX[0],
    RADIUS_MARGIN_PX_BARE = RADIUS_MARGIN_PX[1],
    MINOR_FACTOR,
    MINOR_MIN_PX,
    BARE_REACH = crate::passes::fit_planes::BARE_REACH,
    THICKNESS,
    THICK_MAX[..],
    THICK_FROM_PX[..],
    SHARE_MIN,
    BACK_DEPTH,
    DOT_RADIUS_PX,
});
same_values!(common_radius == crate::inputs::lookup { RADIUS_MAX });
same_values!(common_radius == esker_points::quant { SCALED_CODE_MAX });
same_values!(common_seen == crate::passes::gather { STRETCHED });

/// The pass.
pub struct Gather {
    /// Variants: whether pixels carry normals, whether they carry planes, and the source of
    /// colours.
    kernels: Variants<3>,
    /// Planes fitted to surfaces without normals.
    pub fit_planes: FitPlanes,
    /// Exposure compensation, which reads the scans of the points between fetch and gather.
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
    /// Encodes the filling of level 0, which has the size of the picture. Adds to the count of
    /// pixels with a winning point.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        plan: &FramePlan,
        lookup: &mut GpuLookup,
        winners: &WinningPoints<'_>,
        pyramid: &GpuPyramid,
    ) -> Result<(), GpuError> {
        let Some(level) = pyramid.levels.first() else { return Ok(()) };
        lookup.fetch(gpu, pass, winners, plan, [&level.front, &level.tint])?;
        self.exposure.encode_slots(gpu, pass, winners, &level.tint);
        let kernel = self.kernels.get(gpu, plan.gather_constants().map(|(_, value)| value))?;
        let buffers = [
            (0, winners.uniform),
            (1, lookup.uniform()),
            (2, winners.hits),
            (3, winners.draws),
            (4, lookup.octree()),
            (5, &level.front),
            (6, &level.tint),
            (7, &level.depth),
            (8, &level.plane),
            (9, winners.counts),
        ];
        kernel.dispatch(pass, &kernel.bind(gpu, &buffers), winners.groups());
        if plan.planes() == Planes::Fitted {
            self.fit_planes.tilt(gpu, pass, winners.uniform, level);
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
