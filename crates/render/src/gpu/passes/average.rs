//! Average on the GPU: averages the points of each pixel's front surface. A dispatch over the
//! pixels comes before and after one over the points for each combination of pages. Paper:
//! `schuetz2021`. Twin: [`crate::passes::average`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::groups_of;
use crate::gpu::device::shader::{same_values, sources, without_twin};
use crate::gpu::device::timing::Timing;
use crate::gpu::device::variants::Variants;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::cut::GpuCut;
use crate::gpu::memory::lookup::GpuLookup;
use crate::gpu::memory::pool::NodePool;
use crate::gpu::memory::pyramid::GpuLevel;
use crate::pass::Pass;
use crate::plan::FramePlan;
use wgpu::BufferUsages;

same_values!(common_average == crate::passes::average { STEPS, POINTS_MAX });
same_values!(average_add == crate::passes::average { LEAST_REACH = f32::MIN_POSITIVE });
without_twin!(common_average {
    AT_SCALE,
    AT_SLOPE,
    AT_REACH,
    AT_COUNT,
    AT_COLOUR,
    AT_NORMAL,
    AT_DEPTH,
});

/// Threads of a workgroup.
const THREADS: u64 = 256;

/// The pass.
pub struct Average {
    begin: Variants<1>,
    add: Variants<5>,
    finish: Variants<1>,
    sums: Option<Counted>,
}

impl Default for Average {
    fn default() -> Self {
        let add = ["CULLS_BACK_FACES", "HIDES_POINTS", "NORMALS", "COLOURS", "COLOUR"];
        Self {
            begin: Variants::new(sources::AVERAGE_BEGIN, ["PLANE"]),
            add: Variants::new(sources::AVERAGE_ADD, add),
            finish: Variants::new(sources::AVERAGE_FINISH, ["NORMALS"]),
            sums: None,
        }
    }
}

impl Average {
    /// Bytes of the sums of a picture (`words` in `shaders/common/average.wgsl`).
    fn bytes(pixels: u64, plan: &FramePlan) -> u64 {
        pixels * if plan.carries_normals { 48 } else { 36 }
    }

    /// Whether the device can bind the sums of a picture of `pixels` pixels.
    pub fn fits(gpu: &Gpu, pixels: u64, plan: &FramePlan) -> bool {
        Self::bytes(pixels, plan) <= gpu.tier.binding_bytes_max
    }

    /// Allocates the sums if `plan` needs them, else releases them.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn fit(&mut self, gpu: &Gpu, pixels: u64, plan: &FramePlan) -> Result<(), GpuError> {
        let bytes = if plan.averages() { Self::bytes(pixels, plan) } else { 0 };
        if self.sums.as_ref().map_or(0, |sums| sums.size()) != bytes.next_multiple_of(16) {
            self.sums = None;
            if bytes > 0 {
                self.sums = Some(gpu.buffer("averages", bytes, BufferUsages::STORAGE)?);
            }
        }
        Ok(())
    }

    /// Encodes the replacement of the winning points' attributes in `level` by averages.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    #[allow(clippy::too_many_arguments, reason = "each input of a pass has its own argument")]
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        uniform: &wgpu::Buffer,
        plan: &FramePlan,
        cut: &GpuCut,
        pool: &NodePool,
        lookup: &GpuLookup,
        level: &GpuLevel,
        timing: &mut Timing,
    ) -> Result<(), GpuError> {
        let Some(sums) = &self.sums else { return Ok(()) };
        let pixels = groups_of(u64::from(level.width) * u64::from(level.height));
        let normals = [u32::from(plan.carries_normals)];
        let mut pass = timing.compute(encoder, Pass::Average);
        let begin = self.begin.get(gpu, [plan.planes().values() as u32])?;
        let buffers = [(0, uniform), (1, &*level.front), (2, &*level.plane), (3, &**sums)];
        begin.dispatch(&mut pass, &begin.bind(gpu, &buffers), pixels);
        let add = self.add.get(gpu, plan.average_constants().map(|(_, value)| value))?;
        let layout = add.pipeline().get_bind_group_layout(0);
        for work in &cut.work {
            let Some(colours) = cut.colours(work, pool) else { continue };
            let more = [colours, &**sums, lookup.uniform()];
            let Some(bind) = cut.bind(gpu, &layout, uniform, work, pool, &more) else { continue };
            // A workgroup a chunk.
            add.dispatch(&mut pass, &bind, groups_of(work.range.len() as u64 * THREADS));
        }
        let finish = self.finish.get(gpu, normals)?;
        let buffers = [
            (0, uniform),
            (1, &**sums),
            (2, &*level.front),
            (3, &*level.tint),
            (4, &*level.depth),
            (5, &*level.plane),
        ];
        finish.dispatch(&mut pass, &finish.bind(gpu, &buffers), pixels);
        Ok(())
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        Ok(self.begin.reload(gpu)? | self.add.reload(gpu)? | self.finish.reload(gpu)?)
    }
}
