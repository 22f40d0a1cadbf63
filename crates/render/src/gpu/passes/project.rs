//! Project by compute: one 64-bit atomic minimum a point (`shaders/project/atomics.wgsl`), a
//! dispatch for each combination of pages. Runs of points outside the picture are not read. Paper:
//! `schuetz2021`. Twin: [`crate::passes::project`].

use crate::gpu::device::Gpu;
use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::groups_of;
use crate::gpu::device::shader::{sources, without_twin};
use crate::gpu::device::timing::Timing;
use crate::gpu::device::variants::Variants;
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::hits::Hits;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::passes::bounds::Bounds;
use crate::pass::Pass;
use crate::plan::FramePlan;

without_twin!(project_atomics { ROUNDING });

/// Threads of a workgroup.
const THREADS: u64 = 256;

/// The pass.
pub struct Project {
    /// Variants: the three tests of points, and the two switches below.
    kernels: Variants<5>,
    touches_pixels: bool,
    skips_runs: bool,
    bounds: Bounds,
}

impl Project {
    /// Creates the pass on a device with 64-bit atomics.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, true, true)
    }

    /// Creates a pass that neither clears nor reads nor writes the frame buffer, for comparison in
    /// benchmarks.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn without_pixels(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, false, true)
    }

    /// Creates a pass that skips no runs and draws the same pixels, for comparison in tests and
    /// benchmarks.
    ///
    /// # Errors
    /// If the driver refuses the shader.
    pub fn without_skips(gpu: &Gpu) -> Result<Self, GpuError> {
        Self::with(gpu, true, false)
    }

    fn with(gpu: &Gpu, touches_pixels: bool, skips_runs: bool) -> Result<Self, GpuError> {
        let constants =
            ["CULLS_BACK_FACES", "HIDES_POINTS", "THINS_POINTS", "TOUCHES_PIXELS", "SKIPS_RUNS"];
        let kernels = Variants::new(sources::PROJECT_ATOMICS, constants);
        let mut pass = Self { kernels, touches_pixels, skips_runs, bounds: Bounds::new(gpu)? };
        // Built here so that a driver refuses the shader before anything is drawn.
        pass.kernels.get(gpu, pass.variant([0; 3]))?;
        Ok(pass)
    }

    fn variant(&self, [culls, hides, thins]: [u32; 3]) -> [u32; 5] {
        [culls, hides, thins, u32::from(self.touches_pixels), u32::from(self.skips_runs)]
    }

    /// Encodes the boxes of stale runs, the clearing of `hits`, and the drawing of the cut to it.
    ///
    /// # Errors
    /// If memory is refused.
    #[allow(clippy::too_many_arguments, reason = "each input of a pass has its own argument")]
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        uniform: &wgpu::Buffer,
        plan: &FramePlan,
        cut: &GpuCut,
        pool: &NodePool,
        hits: &Hits,
        timing: &mut Timing,
    ) -> Result<(), GpuError> {
        let variant = self.variant(plan.project_constants().map(|(_, value)| value));
        let kernel = self.kernels.get(gpu, variant)?;
        let layout = kernel.pipeline().get_bind_group_layout(0);
        let mut pass = timing.compute(encoder, Pass::Project);
        self.bounds.encode(gpu, &mut pass, pool)?;
        let Some(target) = hits.buffer() else { return Ok(()) };
        if self.touches_pixels {
            hits.clear(gpu, &mut pass, uniform);
        }
        for work in &cut.work {
            let Some(boxes) = pool.boxes(work.pages.position as usize) else { continue };
            let bound = [target, boxes];
            let Some(bind) = cut.bind(gpu, &layout, uniform, work, pool, &bound) else { continue };
            // A workgroup a chunk.
            kernel.dispatch(&mut pass, &bind, groups_of(work.range.len() as u64 * THREADS));
        }
        Ok(())
    }

    /// To be called after the submission of the commands.
    pub fn submitted(&self, pool: &NodePool) {
        self.bounds.submitted(pool);
    }

    /// Rebuilds the kernels if their shader has changed on disk (debug runs only).
    ///
    /// # Errors
    /// If the changed shader does not build; the old one stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let bounds = self.bounds.reload(gpu)?;
        Ok(self.kernels.reload(gpu)? || bounds)
    }
}
