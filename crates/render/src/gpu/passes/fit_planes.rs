//! Fit planes on the GPU, for clouds without normals. Planes are fitted to the frame buffer before
//! gather and assigned to the pixels after it, in a dispatch of its own: gather already binds as
//! many buffers as WebGPU's default limits allow. Splats look their planes up when they are placed.
//! Twin: [`crate::passes::fit_planes`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::timing::Timing;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::pyramid::GpuLevel;
use crate::pass::Pass;
use crate::passes::fit_planes::SQUARE_PX;
use crate::plan::FramePlan;
use wgpu::{Buffer, BufferUsages, CommandEncoder, ComputePass};

same_values!(common_squares == crate::passes::fit_planes { SQUARE_PX, LEVELS });
same_values!(
    common_tilt_splat
        == crate::passes::fit_planes { SIDE_MIN, SIDE_MIN_PX, LEVELS_MAX, OFF_PLANE_MAX, STEEP }
);
same_values!(common_tilt_splat == crate::ewa::splat { ACROSS_SLOPE });
same_values!(common_tilt_splat == crate::passes::tangent { SLOPE_MAX });
same_values!(fit_planes_fit == crate::passes::fit_planes {
    BARE_REACH,
    OFF_MAX,
    TRUST_APART[..] = [APART.reach, APART.distance[0], APART.distance[1]],
    TRUST_CROWDED[..] = [CROWDED.reach, CROWDED.distance[0], CROWDED.distance[1]],
    MISSING_MAX,
    AREA_MIN,
    BETTER,
    NEARER_MAX,
    NEARER_MIN,
    LEAST_SUM = f32::MIN_POSITIVE,
});
same_values!(fit_planes_tilt == crate::passes::gather {
    BARE_REACH = crate::passes::fit_planes::BARE_REACH,
    FITTED_REACH_MAX,
    RADIUS_MARGIN_PX = RADIUS_MARGIN_PX[1],
});

/// The pass, whose kernels are built when a plan first needs them.
#[derive(Default)]
pub struct FitPlanes {
    kernels: Option<Kernels>,
    memory: Option<Memory>,
}

struct Kernels {
    nearest: Kernel,
    join: Kernel,
    fit: Kernel,
    tilt: Kernel,
}

struct Memory {
    size: [u32; 2],
    levels: usize,
    /// Nearest point of each square (`shaders/fit_planes/nearest.wgsl`).
    nears: Counted,
    /// Plane of each square (`shaders/fit_planes/fit.wgsl`).
    planes: Counted,
}

/// Number of squares of the first `levels` levels of a picture.
fn squares(size: [u32; 2], levels: usize) -> u64 {
    let of = |level: usize| -> u64 {
        let side = (SQUARE_PX << level) as u64;
        size.into_iter().map(|pixels| u64::from(pixels).div_ceil(side)).product()
    };
    (0..levels).map(of).sum()
}

impl FitPlanes {
    /// Allocates the planes of squares and builds the kernels if `plan` needs them, else releases
    /// the memory.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn fit(&mut self, gpu: &Gpu, size: [u32; 2], plan: &FramePlan) -> Result<(), GpuError> {
        if !plan.fits_planes() {
            self.memory = None;
            return Ok(());
        }
        let levels = plan.plane_levels();
        let fits = |memory: &Memory| (memory.size, memory.levels) == (size, levels);
        if !self.memory.as_ref().is_some_and(fits) {
            self.memory = None;
            let plane = |name, bytes| {
                gpu.buffer(name, squares(size, levels) * bytes, BufferUsages::STORAGE)
            };
            let (nears, planes) = (plane("nearest points", 8)?, plane("planes of squares", 16)?);
            self.memory = Some(Memory { size, levels, nears, planes });
        }
        if self.kernels.is_none() {
            let kernel = |source| Kernel::new(gpu, source, "main", &[]);
            self.kernels = Some(Kernels {
                nearest: kernel(sources::FIT_PLANES_NEAREST)?,
                join: kernel(sources::FIT_PLANES_JOIN)?,
                fit: kernel(sources::FIT_PLANES_FIT)?,
                tilt: kernel(sources::FIT_PLANES_TILT)?,
            });
        }
        Ok(())
    }

    /// Encodes the fitting of planes to the frame buffer `hits`.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        uniform: &Buffer,
        hits: &Buffer,
        timing: &mut Timing,
    ) {
        let (Some(kernels), Some(memory)) = (&self.kernels, &self.memory) else { return };
        let Kernels { nearest, join, fit, .. } = kernels;
        let Memory { size, levels, nears, planes } = memory;
        let [finest, all] = [1, *levels].map(|levels| squares(*size, levels));
        let mut pass = timing.compute(encoder, Pass::FitPlanes);
        let bind = nearest.bind(gpu, &[(0, uniform), (1, hits), (2, nears)]);
        nearest.dispatch(&mut pass, &bind, groups_of(finest));
        if all > finest {
            let bind = join.bind(gpu, &[(0, uniform), (1, nears)]);
            join.dispatch(&mut pass, &bind, groups_of(all - finest));
        }
        let bind = fit.bind(gpu, &[(0, uniform), (1, nears), (2, planes)]);
        fit.dispatch(&mut pass, &bind, groups_of(all));
    }

    /// Planes of the squares, level by level, if planes are fitted.
    pub fn planes(&self) -> Option<&Buffer> {
        self.memory.as_ref().map(|memory| &*memory.planes)
    }

    /// Encodes the assignment of planes to the pixels of a gathered level.
    pub(crate) fn tilt(
        &self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        uniform: &Buffer,
        level: &GpuLevel,
    ) {
        let (Some(Kernels { tilt, .. }), Some(memory)) = (&self.kernels, &self.memory) else {
            return;
        };
        let buffers = [
            (0, uniform),
            (1, &*memory.planes),
            (2, &*level.front),
            (3, &*level.tint),
            (4, &*level.plane),
            (5, &*level.depth),
        ];
        let pixels = u64::from(level.width) * u64::from(level.height);
        tilt.dispatch(pass, &tilt.bind(gpu, &buffers), groups_of(pixels));
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let Some(Kernels { nearest, join, fit, tilt }) = &mut self.kernels else {
            return Ok(false);
        };
        let points = nearest.reload(gpu)? | join.reload(gpu)?;
        Ok(points | fit.reload(gpu)? | tilt.reload(gpu)?)
    }
}
