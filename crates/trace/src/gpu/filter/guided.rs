//! Guided filter on the GPU (`bauszat2011` 3.3, `he2010`): moments of light and guides are summed
//! along rows, then along columns; each window's regression is solved; its coefficients are summed
//! the same way and applied to the guides of the pixels. Sums are in 32 bits and made of short
//! runs. Twin: `src/filter/guided.rs`.

use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::bands::{Band, bands};
use crate::gpu::filter::boxes::{Boxes, Rows, runs, whole};
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{sources, without_twin};
use bytemuck::bytes_of;
use esker_render::gpu::device::Counted;
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::wgpu::{Buffer, BufferUsages};
use esker_render::gpu::{Gpu, GpuError, Kernel};

without_twin!(common_guides { MIDDLE });
without_twin!(common_usable { VALUE_MAX, GUIDE_MAX });
without_twin!(filter_solve { LEAST, NOISE_MAX, RIDGE_MIN });
without_twin!(common_infinite { INFINITE_BITS });

/// Least constant epsilon: below it, the rounding of sums in 32 bits shows. Windows with noise have
/// smaller ones, down to 1e-6.
const EPSILON_MIN: f32 = 1e-4;

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidedSettings {
    /// Radius of windows, pixels.
    pub radius: u32,
    /// Epsilon of the three normals and of depth, or of depth alone with one guide. Where nothing
    /// is added for noise, at least 1e-4 is used: below that the rounding of 32-bit sums shows.
    pub epsilon: [f32; 4],
    /// What is added to epsilon for noise: this times the variance of luminance in the window over
    /// the square of its mean and the number of pixels. Zeros for none.
    pub noise: [f32; 4],
}

impl GuidedSettings {
    /// The settings as they are used: constant epsilons below the least that sums in 32 bits allow,
    /// and those that are not numbers, are raised to it.
    pub fn clamped(self) -> Self {
        let noise = self.noise.map(|n| n.max(0.0));
        let least = |k: usize| if noise[k] > 0.0 { 0.0 } else { EPSILON_MIN };
        let epsilon = std::array::from_fn(|k| self.epsilon[k].max(least(k)));
        Self { epsilon, noise, ..self }
    }
}

/// The kernels for a number of guides and signals.
pub struct Guided {
    guides: u32,
    signals: u32,
    moments: Kernel,
    boxes: Boxes,
    solve: Kernel,
    apply: Kernel,
}

impl Guided {
    /// Builds the kernels for one guide (depth), three (the normal) or four (both).
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, guides: u32) -> Result<Self, GpuError> {
        Self::with_signals(gpu, guides, 3)
    }

    /// Builds the kernels for three signals, or four: the last is white noise.
    pub(crate) fn with_signals(gpu: &Gpu, guides: u32, signals: u32) -> Result<Self, GpuError> {
        debug_assert!([1, 3, 4].contains(&guides) && [3, 4].contains(&signals));
        let counts = [("GUIDES", f64::from(guides)), ("SIGNALS", f64::from(signals))];
        let kernel = |source| Kernel::new(gpu, source, "main", &counts);
        Ok(Self {
            guides,
            signals,
            moments: kernel(sources::FILTER_MOMENTS)?,
            boxes: Boxes::new(gpu)?,
            solve: kernel(sources::FILTER_SOLVE)?,
            apply: kernel(sources::FILTER_APPLY)?,
        })
    }

    /// Prepares the filter for pictures of one size. Epsilons are used as
    /// [`GuidedSettings::clamped`] gives them.
    ///
    /// # Errors
    /// If memory is refused.
    pub fn plan(
        &self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        settings: GuidedSettings,
    ) -> Result<FilterPlan, GpuError> {
        let mut plan = FilterPlan::default();
        self.add(gpu, &mut plan, pictures, settings)?;
        Ok(plan)
    }

    /// Appends the filter to a plan.
    pub(crate) fn add(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        settings: GuidedSettings,
    ) -> Result<(), GpuError> {
        let scratch = self.scratch(gpu, pictures, &[settings.radius])?;
        self.add_in(gpu, plan, pictures, settings, &scratch)?;
        plan.keep(scratch.into_buffers());
        Ok(())
    }

    /// Memory for filters of these radii that run one after the other.
    pub(crate) fn scratch(
        &self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        radii: &[u32],
    ) -> Result<Scratch, GpuError> {
        let all: Vec<_> = radii.iter().flat_map(|&radius| self.bands(pictures, radius)).collect();
        Scratch::new(gpu, [self.moments(), self.coefficients()], &all)
    }

    /// Appends the filter to a plan, in memory that the caller keeps.
    pub(crate) fn add_in(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        settings: GuidedSettings,
        scratch: &Scratch,
    ) -> Result<(), GpuError> {
        let settings = settings.clamped();
        for mut band in self.bands(pictures, settings.radius) {
            (band.epsilon, band.noise) = (settings.epsilon, settings.noise);
            self.add_band(gpu, plan, &band, pictures, scratch)?;
        }
        Ok(())
    }

    /// Bands of the pictures.
    fn bands(&self, pictures: &FilterPictures<'_>, radius: u32) -> Vec<Band> {
        let (width, height) = (pictures.light.width, pictures.light.height);
        bands(width, height, radius.min(width.max(height)), self.moments())
    }

    /// Appends the steps of a band.
    fn add_band(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        band: &Band,
        &FilterPictures { guides, light, out }: &FilterPictures<'_>,
        Scratch { along, sums, solved }: &Scratch,
    ) -> Result<(), GpuError> {
        let uniform = fixed_uniform(gpu, "band", bytes_of(band))?;
        let pixels = (band.pixel_first, band.pixel_rows);
        let windows = (band.window_first, band.window_rows);
        let outputs = (band.first, band.rows);
        let rows = |source, to| Rows::new(band.width, band.radius, source, to);
        let (moments, coefficients) = (self.moments(), self.coefficients());
        let (light, guides, out): (&Buffer, &Buffer, &Buffer) =
            (&light.buffer, &guides.buffer, &out.buffer);
        let groups = [runs(band.width), whole(pixels.1), moments];
        plan.add(gpu, &self.moments, &[&uniform, guides, light, along], groups);
        self.boxes.add(gpu, plan, true, &rows(pixels, windows), moments, [along, sums])?;
        let groups = [whole(band.width), whole(windows.1), 1];
        plan.add(gpu, &self.solve, &[&uniform, sums, solved], groups);
        self.boxes.add(gpu, plan, false, &rows(windows, windows), coefficients, [solved, along])?;
        self.boxes.add(gpu, plan, true, &rows(windows, outputs), coefficients, [along, sums])?;
        let groups = [whole(band.width), whole(band.rows), 1];
        plan.add(gpu, &self.apply, &[&uniform, guides, light, sums, out], groups);
        plan.keep([uniform]);
        Ok(())
    }

    /// Number of moments (`shaders/common/guides.wgsl`).
    fn moments(&self) -> u32 {
        let guides = self.guides;
        1 + guides + guides * (guides + 1) / 2 + self.signals * (guides + 1) + 1
    }

    /// Number of coefficients (`shaders/common/guides.wgsl`).
    fn coefficients(&self) -> u32 {
        self.signals * (self.guides + 1)
    }
}

/// Buffers that the bands use one after the other. A window has fewer coefficients than moments,
/// so that their sums use the buffers of the moments again.
pub(crate) struct Scratch {
    /// Sums along rows.
    along: Counted,
    /// Sums along both axes.
    sums: Counted,
    /// Coefficients of windows.
    solved: Counted,
}

impl Scratch {
    /// All buffers.
    pub(crate) fn into_buffers(self) -> [Counted; 3] {
        [self.along, self.sums, self.solved]
    }

    fn new(gpu: &Gpu, [moments, coefficients]: [u32; 2], bands: &[Band]) -> Result<Self, GpuError> {
        let planes = |label, planes: u32, rows: fn(&Band) -> u32| {
            let pixels = bands.iter().map(|b| u64::from(b.width) * u64::from(rows(b))).max();
            gpu.buffer(label, pixels.unwrap_or(0) * u64::from(planes) * 4, BufferUsages::STORAGE)
        };
        Ok(Self {
            along: planes("moments along rows", moments, |b| b.pixel_rows)?,
            sums: planes("moments", moments, |b| b.window_rows)?,
            solved: planes("coefficients", coefficients, |b| b.window_rows)?,
        })
    }
}
