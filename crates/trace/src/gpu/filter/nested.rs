//! Nested windows on the GPU: the guided filter with noise-scaled epsilon at two radii, mixed by
//! their agreement. Twin: `src/filter/nested.rs`.

use crate::filter::nested::{ENERGY_RADIUS, RADII};
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::boxes::{Boxes, Rows};
use crate::gpu::filter::guided::{Guided, GuidedSettings};
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{Pixels, same_values, sources, without_twin};
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError, Kernel};

same_values!(filter_mix == crate::filter::nested { CAUTION = CAUTION as f32 });
same_values!(filter_keep_mean == crate::filter::nested { MEAN_CHANGE_MAX = MEAN_CHANGE_MAX as f32 });
without_twin!(filter_totals { LANES });

/// Planes of the noise, and of the energy (`shaders/filter/energies.wgsl`).
const NOISE_PLANES: u32 = 4;
const ENERGY_PLANES: u32 = 2;
/// Parts of the sums of all pixels.
const TOTALS: u32 = 64;

/// The kernels.
pub(crate) struct Nested {
    guided: Guided,
    energies: Kernel,
    boxes: Boxes,
    mix: Kernel,
    totals: Kernel,
    keep_mean: Kernel,
}

impl Nested {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |source| Kernel::new(gpu, source, "main", &[]);
        Ok(Self {
            guided: Guided::with_signals(gpu, 4, 4)?,
            energies: kernel(sources::FILTER_ENERGIES)?,
            boxes: Boxes::new(gpu)?,
            mix: kernel(sources::FILTER_MIX)?,
            totals: kernel(sources::FILTER_TOTALS)?,
            keep_mean: kernel(sources::FILTER_KEEP_MEAN)?,
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
        let scratch = self.guided.scratch(gpu, pictures, &RADII.map(|radius| radius as u32))?;
        for radius in RADII {
            let out = Pixels::new(gpu, "nested windows", width, height)?;
            let settings = GuidedSettings { radius: radius as u32, ..settings };
            let pictures = &FilterPictures { out: &out, ..*pictures };
            self.guided.add_in(gpu, plan, pictures, settings, &scratch)?;
            filtered.push(out.buffer);
        }
        plan.keep(scratch.into_buffers());
        let planes = |planes: u32| {
            gpu.buffer("energies", pixels * u64::from(planes) * 4, BufferUsages::STORAGE)
        };
        let (noises, energies) = (planes(NOISE_PLANES)?, planes(ENERGY_PLANES)?);
        let along = planes(NOISE_PLANES)?;
        let totals = gpu.buffer("totals", u64::from(TOTALS) * 32, BufferUsages::STORAGE)?;
        let [guides, light, out] =
            [pictures.guides, pictures.light, pictures.out].map(|pixels| &*pixels.buffer);
        let [small, large] = [&*filtered[0], &*filtered[1]];
        let groups = groups_of(pixels);
        let bound = [guides, light, small, large, &noises, &energies];
        plan.add(gpu, &self.energies, &bound, groups);
        let [_, far] = RADII;
        let windows = [(NOISE_PLANES, far, &noises), (ENERGY_PLANES, ENERGY_RADIUS, &energies)];
        for (planes, radius, sums) in windows {
            self.add_sums(gpu, plan, (width, height, radius), planes, [sums, &along])?;
        }
        let bound = [guides, light, small, large, &noises, &energies, out];
        plan.add(gpu, &self.mix, &bound, groups);
        plan.add(gpu, &self.totals, &[guides, light, out, &totals], [TOTALS, 1, 1]);
        plan.add(gpu, &self.keep_mean, &[guides, light, &totals, out], groups);
        plan.keep(filtered);
        plan.keep([noises, energies, along, totals]);
        Ok(())
    }

    /// Replaces planes of a picture by their sums over windows.
    fn add_sums(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        (width, height, radius): (u32, u32, usize),
        planes: u32,
        [sums, along]: [&Counted; 2],
    ) -> Result<(), GpuError> {
        let radius = (radius as u32).min(width.max(height)) as i32;
        let shape = Rows::new(width, radius, (0, height), (0, height));
        self.boxes.add(gpu, plan, false, &shape, planes, [sums, along])?;
        self.boxes.add(gpu, plan, true, &shape, planes, [along, sums])
    }
}
