//! Project by compute: one 64-bit atomic minimum a point (`shaders/project/atomics.wgsl`), a dispatch for each
//! combination of pages. Twin: [`crate::project`].

use super::cut::GpuCut;
use super::device::Gpu;
use super::error::GpuError;
use super::hits::Hits;
use super::kernel::{Kernel, groups_of};
use super::pool::NodePool;
use super::shader::sources;
use super::timing::Timing;
use crate::plan::{FramePlan, Pass};

/// Threads of a group.
const THREADS: u64 = 256;

/// The pass: without and with the test of normals.
pub struct Project {
    kernels: [Kernel; 2],
    touches_pixels: bool,
}

impl Project {
    /// On a device with 64-bit atomics.
    ///
    /// # Errors
    /// Where the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, true)
    }

    /// Everything but the frame buffer, which is neither cleared nor read nor written: what the pass is
    /// compared with when it is measured.
    ///
    /// # Errors
    /// As [`Project::new`].
    pub fn without_pixels(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, false)
    }

    fn with(gpu: &Gpu, touches_pixels: bool) -> Result<Self, GpuError> {
        let flag = |flag: bool| f64::from(u8::from(flag));
        let kernel = |culls: bool| {
            let constants =
                [("CULLS_BACK_FACES", flag(culls)), ("TOUCHES_PIXELS", flag(touches_pixels))];
            Kernel::new(gpu, sources::PROJECT_ATOMICS, "main", &constants)
        };
        Ok(Self { kernels: [kernel(false)?, kernel(true)?], touches_pixels })
    }

    /// Draws the cut into `hits`, which it clears first.
    #[allow(clippy::too_many_arguments, reason = "what a pass reads is named, one by one")]
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        uniform: &wgpu::Buffer,
        plan: &FramePlan,
        cut: &GpuCut,
        pool: &NodePool,
        hits: &Hits,
        timing: &mut Timing,
    ) {
        let Some(target) = hits.buffer() else { return };
        let kernel = &self.kernels[usize::from(plan.culls_back_faces)];
        let layout = kernel.pipeline().get_bind_group_layout(0);
        let mut pass = timing.compute(encoder, Pass::Project);
        if self.touches_pixels {
            hits.clear(gpu, &mut pass, uniform);
        }
        for work in &cut.work {
            let Some(bind) = cut.bind(gpu, &layout, uniform, work, pool, Some(target)) else {
                continue;
            };
            // A group of threads a chunk.
            kernel.dispatch(&mut pass, &bind, groups_of(work.range.len() as u64 * THREADS));
        }
    }

    /// Makes the kernels anew where their shader has changed on the disk.
    ///
    /// # Errors
    /// Where the changed shader does not build; the old one goes on.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        self.kernels.iter_mut().try_fold(false, |any, k| Ok(k.reload(gpu)? || any))
    }
}
