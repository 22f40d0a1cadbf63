//! Nested windows on the GPU: the guided filter with noise-scaled epsilon at two radii, mixed by
//! their agreement. Twin: `src/filter/nested.rs`.

use crate::filter::nested::{ENERGY_RADIUS, RADII};
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::boxes::{Boxes, Rows};
use crate::gpu::filter::guided::{Guided, GuidedSettings};
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{Pixels, sources};
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError, Kernel};

/// Planes whose means decide the mix.
const PLANES: u32 = 3;

/// The kernels.
pub(crate) struct Nested {
    guided: Guided,
    energies: Kernel,
    boxes: Boxes,
    mix: Kernel,
}

impl Nested {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            guided: Guided::with_signals(gpu, 4, 4)?,
            energies: Kernel::new(gpu, sources::FILTER_ENERGIES, "main", &[])?,
            boxes: Boxes::new(gpu)?,
            mix: Kernel::new(gpu, sources::FILTER_MIX, "main", &[])?,
        })
    }

    /// Appends the filter to a plan. The radius of `settings` is not used.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        settings: GuidedSettings,
    ) -> Result<(), GpuError> {
        let (width, height) = (pictures.light.width, pictures.light.height);
        let pixels = u64::from(width) * u64::from(height);
        let mut filtered = Vec::new();
        for radius in RADII {
            let out = Pixels::new(gpu, "nested windows", width, height)?;
            let settings = GuidedSettings { radius: radius as u32, ..settings };
            self.guided.add(gpu, plan, &FilterPictures { out: &out, ..*pictures }, settings)?;
            filtered.push(out.buffer);
        }
        let planes = || {
            let bytes = pixels * u64::from(PLANES) * 4;
            gpu.buffer("energies", bytes, BufferUsages::STORAGE)
        };
        let (noises, energies, along) = (planes()?, planes()?, planes()?);
        let (guides, light) = (&*pictures.guides.buffer, &*pictures.light.buffer);
        let [small, large] = [&*filtered[0], &*filtered[1]];
        let groups = groups_of(pixels);
        let bound = [guides, light, small, large, &noises, &energies];
        plan.add(gpu, &self.energies, &bound, groups);
        let [_, far] = RADII;
        for (planes, radius) in [(&noises, far), (&energies, ENERGY_RADIUS)] {
            self.add_sums(gpu, plan, pictures, radius, planes, &along)?;
        }
        let bound = [guides, light, small, large, &noises, &energies, &*pictures.out.buffer];
        plan.add(gpu, &self.mix, &bound, groups);
        plan.keep(filtered);
        plan.keep([noises, energies, along]);
        Ok(())
    }

    /// Replaces planes by their sums over windows.
    fn add_sums(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        radius: usize,
        planes: &Counted,
        along: &Counted,
    ) -> Result<(), GpuError> {
        let (width, height) = (pictures.light.width, pictures.light.height);
        let radius = (radius as u32).min(width.max(height)) as i32;
        let shape = Rows::new(width, radius, (0, height), (0, height));
        self.boxes.add(gpu, plan, false, &shape, PLANES, [planes, along])?;
        self.boxes.add(gpu, plan, true, &shape, PLANES, [along, planes])
    }
}
