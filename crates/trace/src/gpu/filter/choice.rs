//! The filter that settings name, with kernels that are built when they are first used. In:
//! settings of the CPU's filters. Out: a plan of dispatches.

use crate::filter::clean::{COMPONENT_SHARE, NOISE_MIN, RADIUS};
use crate::filter::{FilterKind, GuideKind, Guides, Settings, normal_noise_degrees};
use crate::gpu::Pixels;
use crate::gpu::filter::FilterPictures;
use crate::gpu::filter::converge::Converge;
use crate::gpu::filter::guided::{Guided, GuidedSettings};
use crate::gpu::filter::nested::Nested;
use crate::gpu::filter::plan::FilterPlan;
use crate::gpu::filter::taps::TapFilters;
use esker_render::gpu::wgpu::Buffer;
use esker_render::gpu::{Gpu, GpuError};

/// Kernels of the filters.
#[derive(Default)]
pub struct LightFilter {
    guided: Option<Guided>,
    nested: Option<Nested>,
    taps: Option<TapFilters>,
    converge: Option<Converge>,
}

/// What a filter knows of guides beforehand: the noise of their normals, and guides with filtered
/// normals where there is much of it. It holds as long as the guides do.
#[derive(Debug, Default)]
pub struct PreparedGuides {
    noise: GuideNoise,
    cleaned: Option<Pixels>,
}

/// Standard deviations of the normals of guides, in the unit of the guides. It hardly differs
/// between the pictures of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct GuideNoise {
    /// As they are seen.
    own: f64,
    /// Once they are filtered; none if they are not.
    cleaned: Option<f64>,
}

impl PreparedGuides {
    /// The noise of the guides.
    pub(crate) fn noise(&self) -> GuideNoise {
        self.noise
    }
}

impl LightFilter {
    /// Estimates the noise of normals, and filters them if the settings demand it. Reads the guides
    /// and waits for them. `pictures` hold guides, and in their light which pixels count.
    ///
    /// # Errors
    /// If memory is refused, the driver refuses a shader, or the device is lost.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        settings: &Settings,
    ) -> Result<PreparedGuides, GpuError> {
        if !needs_noise(settings) {
            return Ok(PreparedGuides::default());
        }
        let light = pictures.light.read(gpu)?;
        let noise = |guides: &Pixels| -> Result<f64, GpuError> {
            let guides = guides.read(gpu)?;
            let kinds = [GuideKind::Normal; 3].into_iter().chain([GuideKind::Depth]).collect();
            let counts = |i: usize| {
                light.planes[3][i] > 0.0 && light.planes.iter().all(|plane| plane[i].is_finite())
            };
            let is_hit = (0..light.len()).map(counts).collect();
            let (width, height) = (guides.width, guides.height);
            let planes = guides.planes.into();
            let guides = Guides { width, height, planes, kinds, is_hit };
            // Guides have half the unit of normals.
            Ok(0.5 * normal_noise_degrees(&guides).to_radians())
        };
        let own = noise(pictures.guides)?;
        let cleaned = self.clean(gpu, pictures, settings, own)?;
        let left = cleaned.as_ref().map(noise).transpose()?;
        Ok(PreparedGuides { noise: GuideNoise { own, cleaned: left }, cleaned })
    }

    /// Prepares guides whose noise is known from another picture of the scene; reads nothing.
    ///
    /// # Errors
    /// If memory is refused or the driver refuses a shader.
    pub(crate) fn prepare_known(
        &mut self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        settings: &Settings,
        noise: GuideNoise,
    ) -> Result<PreparedGuides, GpuError> {
        if !needs_noise(settings) {
            return Ok(PreparedGuides::default());
        }
        let cleaned = self.clean(gpu, pictures, settings, noise.own)?;
        Ok(PreparedGuides { noise, cleaned })
    }

    /// Guides with filtered normals, if the settings demand it for this noise.
    fn clean(
        &mut self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        settings: &Settings,
        own: f64,
    ) -> Result<Option<Pixels>, GpuError> {
        if !settings.cleans_guides || own < NOISE_MIN {
            return Ok(None);
        }
        let (width, height) = (pictures.light.width, pictures.light.height);
        let out = Pixels::new(gpu, "cleaned guides", width, height)?;
        // Two normals of one surface differ by the noise times the root of two.
        let bilateral = Settings { sigma_normal: 2.0 * own as f32, ..Settings::default() };
        let mut plan = FilterPlan::default();
        let taps = built(&mut self.taps, || TapFilters::new(gpu))?;
        let pictures = FilterPictures { out: &out, ..*pictures };
        taps.add_cleaning(gpu, &mut plan, &pictures, RADIUS, &bilateral)?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        plan.run(&mut encoder.begin_compute_pass(&Default::default()));
        gpu.queue.submit([encoder.finish()]);
        Ok(Some(out))
    }

    /// Prepares the filter for pictures of one size. `samples` is the number of samples a pixel of
    /// the light. Weights of colour of a-trous wavelets are left out.
    ///
    /// # Errors
    /// If memory is refused or the driver refuses a shader.
    pub fn plan(
        &mut self,
        gpu: &Gpu,
        pictures: &FilterPictures<'_>,
        prepared: &PreparedGuides,
        samples: u32,
        settings: &Settings,
    ) -> Result<FilterPlan, GpuError> {
        let guides = prepared.cleaned.as_ref().unwrap_or(pictures.guides);
        let pictures = &FilterPictures { guides, ..*pictures };
        let radius = settings.radius(samples);
        let mut plan = FilterPlan::default();
        let is_scaled = settings.kind == FilterKind::Nested || settings.is_noise_scaled;
        let noise = prepared.noise.cleaned.unwrap_or(prepared.noise.own);
        let ridges = ridges(settings, noise, is_scaled, radius);
        match settings.kind {
            FilterKind::None => {}
            FilterKind::Guided => {
                let guided = built(&mut self.guided, || Guided::new(gpu, 4))?;
                guided.add(gpu, &mut plan, pictures, ridges)?;
            }
            FilterKind::Nested => {
                let nested = built(&mut self.nested, || Nested::new(gpu))?;
                nested.add(gpu, &mut plan, pictures, ridges, settings)?;
            }
            FilterKind::Bilateral => {
                let taps = built(&mut self.taps, || TapFilters::new(gpu))?;
                taps.add_bilateral(gpu, &mut plan, pictures, radius, settings)?;
            }
            FilterKind::Atrous => {
                let taps = built(&mut self.taps, || TapFilters::new(gpu))?;
                taps.add_atrous(gpu, &mut plan, pictures, settings)?;
            }
        }
        Ok(plan)
    }
}

impl LightFilter {
    /// Appends to the plan of a filter the mix of its result with the unfiltered mean: `halves` are
    /// the sums of even samples, then those of odd ones, `vec4<f32>` a pixel.
    ///
    /// # Errors
    /// If memory is refused or the driver refuses a shader.
    pub fn add_converging(
        &mut self,
        gpu: &Gpu,
        plan: &mut FilterPlan,
        pictures: &FilterPictures<'_>,
        halves: &Buffer,
        samples: u32,
    ) -> Result<(), GpuError> {
        let converge = built(&mut self.converge, || Converge::new(gpu))?;
        converge.add(gpu, plan, pictures, halves, samples)
    }
}

/// Whether the filter of these settings depends on the noise of guides.
fn needs_noise(settings: &Settings) -> bool {
    let scales = settings.kind == FilterKind::Nested
        || settings.kind == FilterKind::Guided && settings.is_noise_scaled;
    settings.kind != FilterKind::None && (scales || settings.cleans_guides)
}

/// Epsilons of normals and depth: constant, or by the noise of each window and of normals.
fn ridges(settings: &Settings, noise: f64, is_scaled: bool, radius: usize) -> GuidedSettings {
    let four = |normal: f32, depth: f32| [normal, normal, normal, depth];
    let (epsilon, noise) = if is_scaled {
        let variance = noise.powi(2) * COMPONENT_SHARE;
        (four(variance as f32, 0.0), four(settings.noise_normal, settings.noise_depth))
    } else {
        (four(settings.epsilon_normal, settings.epsilon_depth), [0.0; 4])
    };
    GuidedSettings { radius: radius as u32, epsilon, noise }
}

/// Kernels that are built on first use.
fn built<T>(
    kept: &mut Option<T>,
    build: impl FnOnce() -> Result<T, GpuError>,
) -> Result<&T, GpuError> {
    match kept {
        Some(built) => Ok(built),
        none => Ok(none.insert(build()?)),
    }
}
