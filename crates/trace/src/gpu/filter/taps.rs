//! Cross-bilateral filter and a-trous wavelets on the GPU, which are weighted means over
//! neighbours. Twins: `src/filter/bilateral.rs` and `src/filter/atrous.rs`.

use crate::filter::Settings;
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::boxes::whole;
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::{Pixels, same_layout, sources, without_twin};
use bytemuck::{Pod, Zeroable, bytes_of};
use esker_render::gpu::device::dispatch::fixed_uniform;
use esker_render::gpu::{Gpu, GpuError, Kernel};

without_twin!(filter_taps { LEAST });

/// Most passes of a-trous, as on the CPU.
const ITERATIONS_MAX: usize = 8;
/// Least standard deviation of guides.
const SIGMA_MIN: f32 = 1e-6;

/// The uniform (`shaders/filter/taps.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Taps {
    width: u32,
    height: u32,
    reach: i32,
    step: i32,
    scale: [f32; 4],
    sigma: f32,
    unused: u32,
    unused_2: u32,
    unused_3: u32,
}

same_layout!(Taps { width, height, reach, step, scale, sigma });

/// The kernels.
pub(crate) struct TapFilters {
    gaussian: Kernel,
    spline: Kernel,
    on_guides: Kernel,
    with_gain: Kernel,
}

impl TapFilters {
    /// Builds the kernels.
    ///
    /// # Errors
    /// If the driver refuses a shader.
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let kernel = |on: &str| {
            let all = ["SPLINE", "ON_GUIDES", "HAS_GAIN"];
            let constants = all.map(|name| (name, f64::from(u8::from(name == on))));
            Kernel::new(gpu, sources::FILTER_TAPS, "main", &constants)
        };
        Ok(Self {
            gaussian: kernel("")?,
            spline: kernel("SPLINE")?,
            on_guides: kernel("ON_GUIDES")?,
            with_gain: kernel("HAS_GAIN")?,
        })
    }

    /// Appends the cross-bilateral filter to a plan.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_bilateral(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        radius: usize,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let taps = Taps::new(pictures, radius, 1, settings);
        add(gpu, plan, &self.gaussian, &taps, pictures, [pictures.light, pictures.out])
    }

    /// Appends the same filter of normals under their own guidance: from the guides of `pictures`
    /// to its `out`.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_cleaning(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        radius: usize,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let taps = Taps::new(pictures, radius, 1, settings);
        add(gpu, plan, &self.on_guides, &taps, pictures, [pictures.guides, pictures.out])
    }

    /// Appends the same filter of `source` to a plan; the fourth value becomes its gain for white
    /// noise.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_bilateral_with_gain(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        source: &Pixels,
        radius: usize,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let taps = Taps::new(pictures, radius, 1, settings);
        add(gpu, plan, &self.with_gain, &taps, pictures, [source, pictures.out])
    }

    /// Appends a-trous wavelets without weights of colour to a plan.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn add_atrous(
        &self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        settings: &Settings,
    ) -> Result<(), GpuError> {
        let passes = settings.iterations.clamp(1, ITERATIONS_MAX);
        let other = Pixels::new(gpu, "a-trous", pictures.light.width, pictures.light.height)?;
        // The last pass writes the result.
        let target = |pass: usize| if (passes - pass) % 2 == 1 { pictures.out } else { &other };
        for pass in 0..passes {
            let source = if pass == 0 { pictures.light } else { target(pass - 1) };
            let taps = Taps::new(pictures, 2, 1 << pass, settings);
            add(gpu, plan, &self.spline, &taps, pictures, [source, target(pass)])?;
        }
        plan.keep([other.buffer]);
        Ok(())
    }
}

impl Taps {
    fn new(pictures: &FilterPictures<'_>, reach: usize, step: i32, settings: &Settings) -> Self {
        let scale = |sigma: f32| std::f32::consts::FRAC_1_SQRT_2 / sigma.max(SIGMA_MIN);
        let normal = scale(settings.sigma_normal);
        Self {
            width: pictures.light.width,
            height: pictures.light.height,
            reach: reach as i32,
            step,
            scale: [normal, normal, normal, scale(settings.sigma_depth)],
            // Half the radius: the border of the disc has a weight of 0.14.
            sigma: (reach as f32 * 0.5).max(0.5),
            ..Self::zeroed()
        }
    }
}

/// Appends a pass.
fn add(
    gpu: &Gpu,
    plan: &mut FilterPlan,
    kernel: &Kernel,
    taps: &Taps,
    pictures: &FilterPictures<'_>,
    [source, out]: [&Pixels; 2],
) -> Result<(), GpuError> {
    let uniform = fixed_uniform(gpu, "taps", bytes_of(taps))?;
    let (guides, light) = (&*pictures.guides.buffer, &*pictures.light.buffer);
    let groups = [whole(taps.width), whole(taps.height), 1];
    plan.add(gpu, kernel, &[&uniform, guides, light, &source.buffer, &out.buffer], groups);
    plan.keep([uniform]);
    Ok(())
}
