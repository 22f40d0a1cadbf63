//! Sums of planes over square windows, along rows and then along columns. Twin:
//! `src/filter/boxes.rs`.

use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{same_layout, sources};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::wgpu::Buffer;
use esker_render::gpu::{Gpu, GpuError, Kernel};
use sources::constants::common_box_sum::RUN;

/// Pixels on a side of a workgroup.
const GROUP_SIDE: u32 = 8;

/// Workgroups over pixels along an axis.
pub(crate) fn whole(pixels: u32) -> u32 {
    pixels.div_ceil(GROUP_SIDE)
}

/// Workgroups over runs of pixels along an axis.
pub(crate) fn runs(pixels: u32) -> u32 {
    pixels.div_ceil(RUN as u32 * GROUP_SIDE)
}

/// The uniform of the sums (`shaders/filter/boxes.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct Rows {
    width: u32,
    radius: i32,
    source_first: u32,
    source_rows: u32,
    first: u32,
    rows: u32,
    unused: [u32; 2],
}

same_layout!(Rows { width, radius, source_first, source_rows, first, rows });

/// The kernels.
pub(crate) struct Boxes {
    across: Kernel,
    down: Kernel,
}

impl Rows {
    /// From rows of a source to rows of sums, each as the first and their number.
    pub(crate) fn new(width: u32, radius: i32, source: (u32, u32), to: (u32, u32)) -> Self {
        let (source_first, source_rows) = source;
        let (first, rows) = to;
        Self { width, radius, source_first, source_rows, first, rows, unused: [0; 2] }
    }
}

impl Boxes {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let boxes = |down| Kernel::new(gpu, sources::FILTER_BOXES, "main", &[("DOWN", down)]);
        Ok(Self { across: boxes(0.0)?, down: boxes(1.0)? })
    }

    /// Appends sums of `planes` planes along rows or along columns.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        is_down: bool,
        shape: &Rows,
        planes: u32,
        [from, to]: [&Buffer; 2],
    ) -> Result<(), GpuError> {
        let uniform = fixed_uniform(gpu, "rows of sums", bytes_of(shape))?;
        let (kernel, groups) = if is_down {
            (&self.down, [whole(shape.width), runs(shape.rows), planes])
        } else {
            (&self.across, [runs(shape.width), whole(shape.rows), planes])
        };
        plan.add(gpu, kernel, &[&uniform, from, to], groups);
        plan.keep([uniform]);
        Ok(())
    }
}
