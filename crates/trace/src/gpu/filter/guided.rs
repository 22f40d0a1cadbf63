//! Guided filter on the GPU (`bauszat2011` 3.3, `he2010`): moments of light and guides are summed
//! along rows, then along columns; each window's regression is solved; its coefficients are summed
//! the same way and applied to the guides of the pixels. Sums are in 32 bits and made of short
//! runs. Twin: `src/filter/guided.rs`.

use crate::gpu::filter::bands::{Band, bands};
use crate::gpu::{Pixels, same_layout, sources, without_twin};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::{Counted, DispatchCount};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::wgpu::{BindGroup, Buffer, BufferUsages, ComputePass, ComputePipeline};
use esker_render::gpu::{Gpu, GpuError, Kernel};
use sources::constants::common_box_sum::RUN;
pub(crate) use sources::constants::filter_solve::EPSILON_MIN;

without_twin!(common_guides { MIDDLE });
without_twin!(common_usable { VALUE_MAX, GUIDE_MAX });
without_twin!(filter_solve { LEAST, NOISE_MAX });
without_twin!(common_infinite { INFINITE_BITS });

/// Pixels on a side of a workgroup.
const GROUP_SIDE: u32 = 8;

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuidedSettings {
    /// Radius of windows, pixels.
    pub radius: u32,
    /// Epsilon of the three normals and of depth, or of depth alone with one guide. At least 1e-4
    /// is used: below that the rounding of 32-bit sums shows.
    pub epsilon: [f32; 4],
    /// What is added to epsilon for noise: this times the variance of luminance in the window over
    /// the square of its mean and the number of pixels. Zeros for none.
    pub noise: [f32; 4],
}

impl GuidedSettings {
    /// The settings as they are used: epsilons below the least that sums in 32 bits allow, and
    /// those that are not numbers, are raised to it.
    pub fn clamped(self) -> Self {
        let epsilon = self.epsilon.map(|e| e.max(EPSILON_MIN));
        let noise = self.noise.map(|n| n.max(0.0));
        Self { epsilon, noise, ..self }
    }
}

/// The uniform of the sums (`shaders/filter/boxes.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Rows {
    width: u32,
    radius: i32,
    source_first: u32,
    source_rows: u32,
    first: u32,
    rows: u32,
    unused: [u32; 2],
}

same_layout!(Rows { width, radius, source_first, source_rows, first, rows });

/// The kernels for a number of guides.
pub struct Guided {
    guides: u32,
    moments: Kernel,
    across: Kernel,
    down: Kernel,
    solve: Kernel,
    apply: Kernel,
}

/// What a filter reads and writes: pictures of one size.
#[derive(Clone, Copy, Debug)]
pub struct FilterPictures<'a> {
    /// Normal (0 to 1) and depth over a constant of the scene.
    pub guides: &'a Pixels,
    /// Light, and 1 where there is a surface, else 0.
    pub light: &'a Pixels,
    /// Filtered light.
    pub out: &'a Pixels,
}

/// A filter that is ready to run in every frame: its dispatches over pictures.
#[derive(Debug)]
pub struct GuidedPlan {
    steps: Vec<Step>,
    /// Buffers that the bindings refer to, kept so that their bytes are counted.
    kept: Vec<Counted>,
}

/// A dispatch.
#[derive(Debug)]
struct Step {
    pipeline: ComputePipeline,
    bind: BindGroup,
    groups: [u32; 3],
    count: DispatchCount,
}

impl Guided {
    /// Builds the kernels for one guide (depth), three (the normal) or four (both).
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub fn new(gpu: &Gpu, guides: u32) -> Result<Self, GpuError> {
        debug_assert!([1, 3, 4].contains(&guides));
        let count = [("GUIDES", f64::from(guides))];
        let boxes = |down| Kernel::new(gpu, sources::FILTER_BOXES, "main", &[("DOWN", down)]);
        Ok(Self {
            guides,
            moments: Kernel::new(gpu, sources::FILTER_MOMENTS, "main", &count)?,
            across: boxes(0.0)?,
            down: boxes(1.0)?,
            solve: Kernel::new(gpu, sources::FILTER_SOLVE, "main", &count)?,
            apply: Kernel::new(gpu, sources::FILTER_APPLY, "main", &count)?,
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
    ) -> Result<GuidedPlan, GpuError> {
        let settings = settings.clamped();
        let (width, height) = (pictures.light.width, pictures.light.height);
        let radius = settings.radius.min(width.max(height));
        let all = bands(width, height, radius, moments(self.guides));
        let scratch = Scratch::new(gpu, self.guides, &all)?;
        let mut plan = GuidedPlan { steps: Vec::new(), kept: Vec::new() };
        for mut band in all {
            (band.epsilon, band.noise) = (settings.epsilon, settings.noise);
            self.add_band(gpu, &band, pictures, &scratch, &mut plan)?;
        }
        plan.kept.extend([scratch.along, scratch.sums, scratch.solved]);
        Ok(plan)
    }

    /// Appends the steps of a band.
    fn add_band(
        &self,
        gpu: &Gpu,
        band: &Band,
        &FilterPictures { guides, light, out }: &FilterPictures<'_>,
        Scratch { along, sums, solved }: &Scratch,
        plan: &mut GuidedPlan,
    ) -> Result<(), GpuError> {
        let uniform = fixed_uniform(gpu, "band", bytes_of(band))?;
        let pixels = (band.pixel_first, band.pixel_rows);
        let windows = (band.window_first, band.window_rows);
        let outputs = (band.first, band.rows);
        let rows = |source, to| fixed_uniform(gpu, "rows", bytes_of(&Rows::new(band, source, to)));
        let of_moments = rows(pixels, windows)?;
        let of_windows = [rows(windows, windows)?, rows(windows, outputs)?];
        let (moments, coefficients) = (moments(self.guides), coefficients(self.guides));
        let runs = |pixels: u32| pixels.div_ceil(RUN as u32 * GROUP_SIDE);
        let whole = |pixels: u32| pixels.div_ceil(GROUP_SIDE);
        let (width, runs_across) = (whole(band.width), runs(band.width));
        let (light, guides, out) = (&*light.buffer, &*guides.buffer, &*out.buffer);
        let mut step = |kernel: &Kernel, buffers: &[&Buffer], groups| {
            let bound: Vec<_> = (0..).zip(buffers.iter().copied()).collect();
            let (pipeline, bind) = (kernel.pipeline().clone(), kernel.bind(gpu, &bound));
            plan.steps.push(Step { pipeline, bind, groups, count: kernel.dispatch_count().clone() });
        };
        step(&self.moments, &[&uniform, guides, light, along], [
            runs_across,
            whole(pixels.1),
            moments,
        ]);
        let groups = [width, runs(windows.1), moments];
        step(&self.down, &[&of_moments, along, sums], groups);
        let groups = [width, whole(windows.1), 1];
        step(&self.solve, &[&uniform, sums, solved], groups);
        let groups = [runs_across, whole(windows.1), coefficients];
        step(&self.across, &[&of_windows[0], solved, along], groups);
        let groups = [width, runs(band.rows), coefficients];
        step(&self.down, &[&of_windows[1], along, sums], groups);
        let groups = [width, whole(band.rows), 1];
        step(&self.apply, &[&uniform, guides, light, sums, out], groups);
        plan.kept.extend([uniform, of_moments]);
        plan.kept.extend(of_windows);
        Ok(())
    }
}

/// Number of moments (`shaders/common/guides.wgsl`).
fn moments(guides: u32) -> u32 {
    1 + guides + guides * (guides + 1) / 2 + 3 + 3 * guides + 1
}

/// Number of coefficients (`shaders/common/guides.wgsl`).
fn coefficients(guides: u32) -> u32 {
    3 * guides + 3
}

impl Rows {
    /// From rows of a source to rows of sums, each as the first and their number.
    fn new(band: &Band, source: (u32, u32), to: (u32, u32)) -> Self {
        let (source_first, source_rows) = source;
        let (first, rows) = to;
        let (width, radius) = (band.width, band.radius);
        Self { width, radius, source_first, source_rows, first, rows, unused: [0; 2] }
    }
}

/// Buffers that the bands use one after the other. A window has fewer coefficients than moments,
/// so that their sums use the buffers of the moments again.
struct Scratch {
    /// Sums along rows.
    along: Counted,
    /// Sums along both axes.
    sums: Counted,
    /// Coefficients of windows.
    solved: Counted,
}

impl Scratch {
    fn new(gpu: &Gpu, guides: u32, bands: &[Band]) -> Result<Self, GpuError> {
        let planes = |label, planes: u32, rows: fn(&Band) -> u32| {
            let pixels = bands.iter().map(|b| u64::from(b.width) * u64::from(rows(b))).max();
            gpu.buffer(label, pixels.unwrap_or(0) * u64::from(planes) * 4, BufferUsages::STORAGE)
        };
        Ok(Self {
            along: planes("moments along rows", moments(guides), |b| b.pixel_rows)?,
            sums: planes("moments", moments(guides), |b| b.window_rows)?,
            solved: planes("coefficients", coefficients(guides), |b| b.window_rows)?,
        })
    }
}

impl GuidedPlan {
    /// Encodes the filter.
    pub fn run(&self, pass: &mut ComputePass<'_>) {
        for Step { pipeline, bind, groups, count } in &self.steps {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, bind, &[]);
            pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
            count.add_one();
        }
    }
}
