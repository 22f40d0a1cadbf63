//! Smooth depth on the GPU, for clouds without normals: smooths the depth image, from which shade
//! computes normals. Only the GPU knows how wide it has to be: all rounds are dispatched, and those
//! that no pixel needs end at once. Twin: [`crate::passes::smooth_depth`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::target::{Radii, SurfaceTarget};
use crate::passes::smooth_depth::STEPS;
use crate::picture::radii::EVERY;

same_values!(common_smoothing == crate::passes::smooth_depth { SLOPE_MAX });
same_values!(smooth_depth_smooth == crate::passes::smooth_depth { TAPS[..], RADIUS_PER_STEP[..] });
same_values!(common_radii == crate::picture::radii { RADII_TILE = TILE as u32 });
same_values!(smooth_depth_tiles == crate::picture::radii { EVERY = EVERY as u32, RADIUS_MAX_PX });
without_twin!(smooth_depth_tiles { SAMPLES });

/// The pass.
pub struct SmoothDepth {
    /// Kernels that measure the radii of discs: of tiles, and at their corners.
    radii: [Kernel; 2],
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
            radii: [
                Kernel::unzeroed(gpu, sources::SMOOTH_DEPTH_TILES, "main", &[])?,
                Kernel::new(gpu, sources::SMOOTH_DEPTH_CORNERS, "main", &[])?,
            ],
            smooth: rounds.collect::<Result<_, GpuError>>()?,
        })
    }

    /// Dispatches that measure the radii of discs and smooth the picture's depth to
    /// [`SurfaceTarget::spare`].
    pub fn dispatches(&self, gpu: &Gpu, target: &SurfaceTarget<'_>) -> Vec<Dispatch> {
        let depth = &target.picture.depth;
        let Radii { tiles, corners, most } = target.radii;
        let [of_tiles, at_corners] = &self.radii;
        let samples = [depth, &target.base().tint, target.sources, tiles, most];
        let means = [tiles, corners, most];
        let size = [target.picture.width, target.picture.height];
        let [sampled, cornered] =
            [size.map(|side| side.div_ceil(EVERY as u32)), Radii::corners(size)];
        let mut all = vec![
            Dispatch::over(gpu, of_tiles, sampled, &target.resources(&samples)),
            Dispatch::over(gpu, at_corners, cornered, &target.resources(&means)),
        ];
        let (rows, smooth) = (target.depth, target.spare);
        for [along, down] in &self.smooth {
            all.push(target.dispatch(gpu, along, &[most, depth, rows, smooth, corners]));
            all.push(target.dispatch(gpu, down, &[most, rows, smooth, rows, corners]));
        }
        all
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        self.radii.iter_mut().chain(self.smooth.iter_mut().flatten()).collect()
    }
}
