//! What the tracer takes of the settings of lit pictures: its options and the lights; and which of
//! them a GPU does not draw.

use crate::light::document::Lights;
use crate::light::lights;
use crate::light::settings::{FilterName, Gloss, LightSettings};
use esker_trace::filter::{FilterKind, Settings as FilterSettings};
use esker_trace::gpu::Unsupported;
use esker_trace::light::{Light, Sky};
use esker_trace::{Gloss as Lobe, Options};
use glam::DVec3;

/// Why a GPU does not trace triangles.
pub(crate) const MESHES_REFUSED: &str = "pictures with meshes are lit by the CPU";

/// Options of the tracer for settings.
pub(crate) fn options(settings: &LightSettings, lights: &Lights) -> Options {
    let kind = match settings.filter {
        FilterName::Guided => FilterKind::Guided,
        FilterName::Nested => FilterKind::Nested,
        FilterName::Bilateral => FilterKind::Bilateral,
        FilterName::Atrous => FilterKind::Atrous,
        FilterName::None => FilterKind::None,
    };
    Options {
        bounces: settings.bounces,
        shadow_samples: settings.shadow_samples,
        seed: settings.seed,
        filter: FilterSettings::of(kind),
        filters_visibility: settings.filters_shadows,
        gloss: settings
            .gloss
            .map(|Gloss { reflectance, roughness }| Lobe { reflectance, roughness }),
        shows_sky: lights.have_sky(),
        ..Options::default()
    }
}

/// The lights of settings, with their places on the metric lattice.
pub(crate) fn lights_of(settings: &LightSettings) -> Lights {
    settings.lights.clone().unwrap_or_else(lights::defaults).measured(settings.factor)
}

/// Why a GPU does not draw the lit frames of a session; none if it does. What depends on the size
/// of the picture is found when it is drawn.
pub(crate) fn gpu_refusal(settings: &LightSettings) -> Option<String> {
    let lights = lights_of(settings);
    if !settings.meshes.is_empty() {
        return Some(MESHES_REFUSED.into());
    }
    if !lights.emissive.is_empty() {
        return Some(Unsupported::Emitters.to_string());
    }
    let prepared = esker_trace::Lights::from(lights.lights.clone()).prepare(DVec3::ZERO);
    let refusal = esker_trace::gpu::check(&prepared, &options(settings, &lights)).err();
    refusal.map(|why| why.to_string())
}

/// Bytes of images of the sky in the memory of a GPU, four floats a pixel.
pub(crate) fn gpu_bytes(settings: &LightSettings) -> u64 {
    let lights = settings.lights.iter().flat_map(|lights| &lights.lights);
    let pixels = lights.map(|light| match light {
        Light::Sky { sky: Sky::Image(image) } => image.pixels.len() as u64,
        _ => 0,
    });
    pixels.sum::<u64>() * 16
}
