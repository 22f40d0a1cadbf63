//! Smooth depth on the GPU, for clouds without normals: smooths the depth image, from which shade
//! computes normals. Only the GPU knows how wide it has to be: all rounds are dispatched, and those
//! that are not needed end at once. Twin: [`crate::passes::smooth_depth`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::target::SurfaceTarget;
use crate::passes::smooth_depth::STEPS;

same_values!(common_smoothing == crate::passes::smooth_depth { SLOPE_MAX });
same_values!(smooth_depth_smooth == crate::passes::smooth_depth { TAPS[..], RADIUS_PER_STEP[..] });
same_values!(smooth_depth_radius == crate::passes::smooth_depth { EVERY });
without_twin!(smooth_depth_radius { LANES });

/// The pass.
pub struct SmoothDepth {
    radius: Kernel,
    /// Kernels along rows and along columns, for each round.
    smooth: Vec<[Kernel; 2]>,
}

impl SmoothDepth {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let smooth = |step: usize, down: f64| {
            let constants = [("STEP", step as f64), ("DOWN", down)];
            Kernel::new(gpu, sources::SMOOTH_DEPTH_SMOOTH, "main", &constants)
        };
        let rounds = STEPS.iter().map(|&step| Ok([smooth(step, 0.0)?, smooth(step, 1.0)?]));
        Ok(Self {
            radius: Kernel::unzeroed(gpu, sources::SMOOTH_DEPTH_RADIUS, "main", &[])?,
            smooth: rounds.collect::<Result<_, GpuError>>()?,
        })
    }

    /// Dispatches that compute the mean radius and smooth the picture's depth to
    /// [`SurfaceTarget::spare`].
    pub fn dispatches(&self, gpu: &Gpu, target: &SurfaceTarget<'_>) -> Vec<Dispatch> {
        let depth = &target.picture.depth;
        let radius = [depth, &target.base().tint, target.sources, target.smoothing];
        let mut all = vec![target.one_group(gpu, &self.radius, &radius)];
        let (rows, smooth) = (target.depth, target.spare);
        for [along, down] in &self.smooth {
            all.push(target.dispatch(gpu, along, &[target.smoothing, depth, rows, smooth]));
            all.push(target.dispatch(gpu, down, &[target.smoothing, rows, smooth, rows]));
        }
        all
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        std::iter::once(&mut self.radius).chain(self.smooth.iter_mut().flatten()).collect()
    }
}
