//! Nested windows on the GPU: the guided filter with noise-scaled epsilon at two radii, and the
//! cross-bilateral filter of what they leave. Twin: `src/filter/nested.rs`.

use crate::filter::Settings;
use crate::filter::nested::{ENERGY_RADIUS, FINE_RADIUS, RADII};
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::boxes::{Boxes, Rows};
use crate::gpu::filter::guided::{Guided, GuidedSettings};
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::filter::taps::TapFilters;
use crate::gpu::{Pixels, same_values, sources, without_twin};
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::kernel::groups_of;
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError, Kernel};

same_values!(filter_add_light == crate::filter::nested { CAUTION = CAUTION as f32 });
same_values!(filter_keep_mean == crate::filter::nested { MEAN_CHANGE_MAX = MEAN_CHANGE_MAX as f32 });
without_twin!(filter_totals { LANES });

/// Planes of energies (`shaders/filter/energies.wgsl`).
const PLANES: u32 = 5;
/// Parts of the sums of all pixels.
const TOTALS: u32 = 64;

/// The kernels.
pub(crate) struct Nested {
    guided: Guided,
    /// What small windows add to large ones, and the light that both leave.
    added: Kernel,
    left: Kernel,
    taps: TapFilters,
    energies: Kernel,
    boxes: Boxes,
    add_light: Kernel,
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
        let difference = |of_light| {
            Kernel::new(gpu, sources::FILTER_DIFFERENCE, "main", &[("OF_LIGHT", of_light)])
        };
        Ok(Self {
            guided: Guided::with_signals(gpu, 4, 4)?,
            added: difference(0.0)?,
            left: difference(1.0)?,
            taps: TapFilters::new(gpu)?,
            energies: kernel(sources::FILTER_ENERGIES)?,
            boxes: Boxes::new(gpu)?,
            add_light: kernel(sources::FILTER_ADD_LIGHT)?,
            totals: kernel(sources::FILTER_TOTALS)?,
            keep_mean: kernel(sources::FILTER_KEEP_MEAN)?,
        })
    }

    /// Appends the filter to a plan. The radius of `ridges` is not used.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        ridges: GuidedSettings,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let &FilterPictures { guides, light, out } = pictures;
        let (width, height) = (light.width, light.height);
        let pixels = u64::from(width) * u64::from(height);
        let groups = groups_of(pixels);
        // What is filtered from, and what is added.
        let first = Pixels::new(gpu, "windows", width, height)?;
        let second = Pixels::new(gpu, "windows", width, height)?;
        let scratch = self.guided.scratch(gpu, pictures, &RADII.map(|radius| radius as u32))?;
        for (radius, out) in RADII.into_iter().zip([&first, out]) {
            let ridges = GuidedSettings { radius: radius as u32, ..ridges };
            let pictures = &FilterPictures { out, ..*pictures };
            self.guided.add_in(gpu, plan, pictures, ridges, &scratch)?;
        }
        plan.keep(scratch.into_buffers());
        let bytes = pixels * u64::from(PLANES) * 4;
        let planes = || gpu.buffer("energies", bytes, BufferUsages::STORAGE);
        // Energies, and room for their sums along rows.
        let energies = [planes()?, planes()?];
        let bound = [guides, light, out, &first].map(|pixels| &*pixels.buffer);
        plan.add(gpu, &self.added, &bound, groups);
        self.add_light(gpu, plan, pictures, [light, &first], &energies)?;
        plan.add(gpu, &self.left, &bound, groups);
        let fine = &FilterPictures { out: &second, ..*pictures };
        self.taps.add_bilateral_with_gain(gpu, plan, fine, &first, FINE_RADIUS, settings)?;
        self.add_light(gpu, plan, pictures, [&first, &second], &energies)?;

        let totals = gpu.buffer("totals", u64::from(TOTALS) * 32, BufferUsages::STORAGE)?;
        let [guides, light, out] = [guides, light, out].map(|pixels| &*pixels.buffer);
        plan.add(gpu, &self.totals, &[guides, light, out, &totals], [TOTALS, 1, 1]);
        plan.add(gpu, &self.keep_mean, &[guides, light, &totals, out], groups);
        plan.keep([first.buffer, second.buffer, totals]);
        plan.keep(energies);
        Ok(())
    }

    /// Adds the share of an addition that is light. It was filtered from `noisy`.
    fn add_light(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        &FilterPictures { guides, light, out }: &FilterPictures<'_>,
        [noisy, addition]: [&Pixels; 2],
        [energies, along]: &[Counted; 2],
    ) -> Result<(), GpuError> {
        let (width, height) = (light.width, light.height);
        let groups = groups_of(u64::from(width) * u64::from(height));
        let [guides, light, noisy, addition, out] =
            [guides, light, noisy, addition, out].map(|pixels| &*pixels.buffer);
        let bound = [guides, light, noisy, addition, energies];
        plan.add(gpu, &self.energies, &bound, groups);
        let radius = (ENERGY_RADIUS as u32).min(width.max(height)) as i32;
        let shape = Rows::new(width, radius, (0, height), (0, height));
        self.boxes.add(gpu, plan, false, &shape, PLANES, [energies, along])?;
        self.boxes.add(gpu, plan, true, &shape, PLANES, [along, energies])?;
        let bound = [guides, light, addition, energies, out];
        plan.add(gpu, &self.add_light, &bound, groups);
        Ok(())
    }
}
