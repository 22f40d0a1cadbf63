//! Mix of the filtered picture with the unfiltered mean of its samples on the GPU, so that the
//! error falls with the samples. Twin: `src/filter/converge.rs`.

use crate::filter::converge::{RADIUS, STANDARD_ERRORS};
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::boxes::{Boxes, Rows};
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{same_layout, same_values, sources};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::wgpu::{Buffer, BufferUsages};
use esker_render::gpu::{Gpu, GpuError, Kernel};

same_values!(filter_converge == crate::gpu::filter::converge { STANDARD_ERRORS });

/// Planes of measures.
const PLANES: u32 = 4;

/// The uniform (`shaders/common/halves.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Shares {
    pixels: u32,
    unused: u32,
    even: f32,
    odd: f32,
}

same_layout!(Shares { pixels, even, odd });

/// The kernels.
pub(crate) struct Converge {
    measures: Kernel,
    boxes: Boxes,
    mix: Kernel,
}

impl Converge {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            measures: Kernel::new(gpu, sources::FILTER_MEASURES, "main", &[])?,
            boxes: Boxes::new(gpu)?,
            mix: Kernel::new(gpu, sources::FILTER_CONVERGE, "main", &[])?,
        })
    }

    /// Appends the mix to the plan of a filter: `pictures.out` is changed. `halves` are the sums of
    /// even samples, then those of odd ones, of `samples` samples.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        halves: &Buffer,
        samples: u32,
    ) -> Result<(), GpuError> {
        let (width, height) = (pictures.light.width, pictures.light.height);
        let pixels = u64::from(width) * u64::from(height);
        let share = |samples: u32| 1.0 / samples.max(1) as f32;
        let (even, odd) = (share(samples.div_ceil(2)), share(samples / 2));
        let shares = Shares { pixels: pixels as u32, unused: 0, even, odd };
        let uniform = fixed_uniform(gpu, "shares", bytes_of(&shares))?;
        let planes = || {
            let bytes = pixels * u64::from(PLANES) * 4;
            gpu.buffer("measures", bytes, BufferUsages::STORAGE)
        };
        let (measures, along) = (planes()?, planes()?);
        let (light, out): (&Buffer, &Buffer) = (&pictures.light.buffer, &pictures.out.buffer);
        let groups = groups_of(pixels);
        plan.add(gpu, &self.measures, &[&uniform, halves, light, out, &measures], groups);
        let radius = (RADIUS as u32).min(width.max(height)) as i32;
        let shape = Rows::new(width, radius, (0, height), (0, height));
        self.boxes.add(gpu, plan, false, &shape, PLANES, [&measures, &along])?;
        self.boxes.add(gpu, plan, true, &shape, PLANES, [&along, &measures])?;
        plan.add(gpu, &self.mix, &[&uniform, halves, light, &measures, out], groups);
        plan.keep([uniform, measures, along]);
        Ok(())
    }
}
