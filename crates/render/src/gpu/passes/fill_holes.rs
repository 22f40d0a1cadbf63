//! Fill holes on the GPU: writes the depth image of level 0, finds its edges, and finds and closes
//! gaps in two rounds. Paper: `rosenthal2008`. Twins: [`crate::passes::fill_holes`],
//! [`crate::picture::edges`].

use crate::gpu::device::Gpu;
use crate::gpu::device::dispatch::Dispatch;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::Kernel;
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::target::SurfaceTarget;
use crate::passes::fill_holes::ROUNDS;
use crate::picture::pyramid::Planes;

same_values!(fill_holes_find == crate::passes::fill_holes { SURROUNDED, CORNERED, WITHIN_PX });
same_values!(common_around == crate::passes::fill_holes {
    BEFORE_NORMALS = BEFORE[0],
    BEFORE_BARE = BEFORE[1],
    BEFORE_MIN_PX,
});
same_values!(fill_holes_depth == crate::simd::lanes { REACH_MIN_PX });
same_values!(common_step == crate::renderer { STEP_PX });
without_twin!(common_marks { EDGE, GAP });

/// The pass.
pub struct FillHoles {
    depth: Kernel,
    /// Kernels of the first round, which also finds edges, and of later rounds.
    find: [Kernel; 2],
    fill: Kernel,
}

impl FillHoles {
    /// Builds the kernels for pyramids whose pixels carry `planes`.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, planes: Planes) -> Result<Self, GpuError> {
        let constants = [("NORMALS", f64::from(planes == Planes::Normals))];
        let moved = [("PLANE", planes.values() as f64)];
        let find = |first: f64| {
            Kernel::new(gpu, sources::FILL_HOLES_FIND, "main", &[("FIRST", first), constants[0]])
        };
        Ok(Self {
            depth: Kernel::new(gpu, sources::FILL_HOLES_DEPTH, "main", &moved)?,
            find: [find(1.0)?, find(0.0)?],
            fill: Kernel::new(gpu, sources::FILL_HOLES_FILL, "main", &constants)?,
        })
    }

    /// Dispatches that fill [`SurfaceTarget::depth`] and the marks, and close the gaps of level 0
    /// if `closes`.
    pub fn dispatches(&self, gpu: &Gpu, target: &SurfaceTarget<'_>, closes: bool) -> Vec<Dispatch> {
        let base = target.base();
        let &SurfaceTarget { depth, marks, .. } = target;
        let image = [&base.front, &base.depth, depth, &base.plane, &base.tint];
        let find = [depth, &base.tint, marks];
        let fill = [marks, depth, &base.front, &base.tint, &base.plane];
        let mut all = vec![target.dispatch(gpu, &self.depth, &image)];
        if !closes {
            all.push(target.dispatch(gpu, &self.find[0], &find));
            return all;
        }
        for round in 0..ROUNDS {
            all.push(target.dispatch(gpu, &self.find[round.min(1)], &find));
            all.push(target.dispatch(gpu, &self.fill, &fill));
        }
        all
    }

    pub(crate) fn kernels(&mut self) -> Vec<&mut Kernel> {
        let Self { depth, find, fill } = self;
        [depth, fill].into_iter().chain(find).collect()
    }
}
