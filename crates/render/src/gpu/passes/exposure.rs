//! Exposure on the GPU: removes differences of exposure between scans. The slots of scans are read
//! between fetch and gather, while the words of the points are available. Paper: `kanzok2015`,
//! section 3.2.4. Twin: [`crate::passes::exposure`].

use crate::gpu::device::error::GpuError;
use crate::gpu::device::kernel::{Kernel, groups_of};
use crate::gpu::device::shader::{same_values, sources};
use crate::gpu::device::timing::Timing;
use crate::gpu::device::{Counted, Gpu};
use crate::gpu::memory::lookup::WinningPoints;
use crate::gpu::memory::pyramid::GpuLevel;
use crate::pass::Pass;
use crate::passes::exposure::{CELL_PX, SLICES, SLOTS};
use crate::plan::FramePlan;
use wgpu::{Buffer, BufferUsages, CommandEncoder, ComputePass};

same_values!(
    common_exposure == crate::passes::exposure { CELL_PX, SLICE_BITS, SLICES, SLOTS, STEPS }
);
same_values!(exposure_apply == crate::passes::exposure { GAIN_MAX, DARK });

/// The pass, whose kernels are built when a plan first needs them.
#[derive(Default)]
pub struct Exposure {
    kernels: Option<Kernels>,
    memory: Option<Memory>,
}

struct Kernels {
    slot: Kernel,
    add: Kernel,
    apply: Kernel,
}

struct Memory {
    /// Slot of the scan of each pixel, a word a pixel.
    slots: Counted,
    /// Sums of the grid's cells (`shaders/common/exposure.wgsl`).
    sums: Counted,
}

impl Exposure {
    /// Bytes of the grid of a picture.
    fn bytes(size: [u32; 2]) -> u64 {
        let cells = size.map(|side| u64::from(side).div_ceil(CELL_PX as u64));
        cells[0] * cells[1] * (SLICES * SLOTS * 16) as u64
    }

    /// Whether the device can bind the grid of a picture.
    pub fn fits(gpu: &Gpu, size: [u32; 2]) -> bool {
        Self::bytes(size) <= gpu.tier.binding_bytes_max
    }

    /// Allocates the grid and builds the kernels if `plan` needs them, else releases them.
    ///
    /// # Errors
    /// If the driver refuses a shader or memory.
    pub fn fit(&mut self, gpu: &Gpu, size: [u32; 2], plan: &FramePlan) -> Result<(), GpuError> {
        if !plan.evens_exposure() {
            *self = Self::default();
            return Ok(());
        }
        let [bytes, pixels] = [Self::bytes(size), size.into_iter().map(u64::from).product()];
        let fits = |m: &Memory| m.sums.size() == bytes && m.slots.size() >= pixels * 4;
        if !self.memory.as_ref().is_some_and(fits) {
            self.memory = None;
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
            self.memory = Some(Memory {
                slots: gpu.buffer("slots of scans", pixels * 4, BufferUsages::STORAGE)?,
                sums: gpu.buffer("exposures", bytes, usage)?,
            });
        }
        if self.kernels.is_none() {
            let kernel = |source| Kernel::new(gpu, source, "main", &[]);
            self.kernels = Some(Kernels {
                slot: kernel(sources::EXPOSURE_SLOT)?,
                add: kernel(sources::EXPOSURE_ADD)?,
                apply: kernel(sources::EXPOSURE_APPLY)?,
            });
        }
        Ok(())
    }

    /// Reads the slots of the scans of the winning points, whose words are in `paint`.
    pub(crate) fn encode_slots(
        &self,
        gpu: &Gpu,
        pass: &mut ComputePass<'_>,
        winners: &WinningPoints<'_>,
        paint: &Buffer,
    ) {
        let (Some(Kernels { slot, .. }), Some(memory)) = (&self.kernels, &self.memory) else {
            return;
        };
        let buffers = [(0, winners.uniform), (1, winners.hits), (2, paint), (3, &*memory.slots)];
        slot.dispatch(pass, &slot.bind(gpu, &buffers), winners.groups());
    }

    /// Encodes the compensation of the colours of `level`.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut CommandEncoder,
        uniform: &Buffer,
        level: &GpuLevel,
        timing: &mut Timing,
    ) {
        let (Some(kernels), Some(Memory { slots, sums })) = (&self.kernels, &self.memory) else {
            return;
        };
        encoder.clear_buffer(sums, 0, None);
        let mut pass = timing.compute(encoder, Pass::Exposure);
        let pixels = groups_of(u64::from(level.width) * u64::from(level.height));
        let buffers = [
            (0, uniform),
            (1, &*level.front),
            (2, &*level.tint),
            (3, &*level.depth),
            (4, &**slots),
            (5, &**sums),
        ];
        for kernel in [&kernels.add, &kernels.apply] {
            kernel.dispatch(&mut pass, &kernel.bind(gpu, &buffers), pixels);
        }
    }

    /// Rebuilds the kernels whose shaders have changed on disk (debug runs only).
    ///
    /// # Errors
    /// If a changed shader does not build; the old kernel stays.
    pub fn reload(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        let Some(Kernels { slot, add, apply }) = &mut self.kernels else { return Ok(false) };
        Ok(slot.reload(gpu)? | add.reload(gpu)? | apply.reload(gpu)?)
    }
}
