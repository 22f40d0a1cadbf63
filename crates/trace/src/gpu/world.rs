//! The uniform of the view, the lights and the sequence of samples, as the kernels of paths take it
//! (`shaders/common/world.wgsl`). Refuses what they do not draw.

use crate::camera::Camera;
use crate::gpu::{same_layout, same_values, without_twin};
use crate::light::{Lamp, Panorama, PreparedLights, Sky};
use crate::paths::{Options, Sampler};
use bytemuck::{Pod, Zeroable, cast_slice};
use esker_render::gpu::device::{BINDING_BYTES_MAX, Counted};
use esker_render::gpu::wgpu::BufferUsages;
use esker_render::gpu::{Gpu, GpuError};
use glam::Vec3;

/// Most pixels of an image of the sky: they fit in a binding.
const SKY_PIXELS_MAX: usize = (BINDING_BYTES_MAX / 16) as usize;
const SUN: f32 = 0.0;
const POINT: f32 = 1.0;
const SPOT: f32 = 2.0;
const AREA: f32 = 3.0;

same_values!(common_fits == crate::paths::lookup { FIT_COS, FIT_PIXELS });
without_twin!(common_sky { FULL_TURN, HALF_TURN });
same_values!(common_lamps == crate::gpu::world { SUN, POINT, SPOT, AREA });
without_twin!(common_lamps { TURN });
without_twin!(common_sequence { PIXEL_BITS });
without_twin!(common_directions { QUARTER_PI });
without_twin!(common_place_seen { NOTHING, REFLECTS, EMITS, REFLECTS_BACK });
same_values!(common_direct == crate::paths::direct { LIGHT_DIMENSION, SHADOW_REACH });
same_values!(
    common_direct
        == crate::paths::indirect { BOUNCE_DIMENSION, ROULETTE_BOUNCE, OWN_LIFTS, OWN_COS }
);
without_twin!(common_direct { PI_SHARE, BELOW_ONE });
same_values!(trace_direct == crate::paths::band { PIXEL_DIMENSION });
without_twin!(trace_direct { MIDDLE_SLOT, NORMAL_ROUNDING, DEPTH_ROUNDING, NEAR_TIE });

/// Why a picture cannot be lit on a GPU; the CPU draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsupported {
    /// Skies that are several images, or one that exceeds a storage binding.
    #[error("the sky is several images, or one of more than 8 million pixels")]
    Panorama,
    /// Glossy surfaces.
    #[error("surfaces are glossy")]
    Gloss,
    /// Splats that emit light.
    #[error("splats emit light")]
    Emitters,
    /// Filtered visibility.
    #[error("visibility is filtered")]
    Visibility,
    /// More samples than sums of albedo have bits for.
    #[error("there are more than 1,024 samples a pixel")]
    Samples,
    /// A picture whose sums exceed a storage binding.
    #[error("the picture has too many pixels for this GPU")]
    Size,
}

/// A lamp (`shaders/common/lamps.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct GpuLamp {
    place: [f32; 4],
    axis: [f32; 4],
    x: [f32; 4],
    y: [f32; 4],
    colour: [f32; 4],
}

/// The uniform.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub(crate) struct World {
    eye: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    zenith: [f32; 4],
    horizon: [f32; 4],
    ground: [f32; 4],
    width: u32,
    height: u32,
    lamps: u32,
    bounces: u32,
    shadow_log2: u32,
    shows_sky: u32,
    number: u32,
    index: u32,
    sequence: [u32; 4],
    part: Part,
    sky_width: u32,
    sky_height: u32,
    unused: [u32; 2],
}

/// Rows of the picture that a dispatch goes over, and those whose places are in memory
/// (`shaders/common/world.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Part {
    pub(crate) first: u32,
    pub(crate) rows: u32,
    pub(crate) first_place: u32,
    pub(crate) place_rows: u32,
}

same_layout!(Part { first, rows, first_place, place_rows });
same_layout!(World {
    eye,
    right,
    up,
    forward,
    zenith,
    horizon,
    ground,
    width,
    height,
    lamps,
    bounces,
    shadow_log2,
    shows_sky,
    number,
    index,
    sequence,
    part,
    sky_width,
    sky_height,
});

/// Refuses lights and options that the kernels do not draw.
///
/// # Errors
/// With the first reason.
pub fn check(lights: &PreparedLights, options: &Options) -> Result<(), Unsupported> {
    if options.gloss.is_some() {
        return Err(Unsupported::Gloss);
    }
    if options.filters_visibility {
        return Err(Unsupported::Visibility);
    }
    let images = || lights.skies().iter().filter_map(image);
    if images().count() > 1 || images().any(|image| image.pixels.len() > SKY_PIXELS_MAX) {
        return Err(Unsupported::Panorama);
    }
    Ok(())
}

fn image(sky: &Sky) -> Option<&Panorama> {
    if let Sky::Image(image) = sky { Some(image) } else { None }
}

/// Lamps and sky in GPU memory.
#[derive(Debug)]
pub(crate) struct LightBuffers {
    /// Lamps (`shaders/common/lamps.wgsl`); one without light if there is none.
    pub(crate) lamps: Counted,
    /// Pixels of the image of the sky, four floats each; one if there is none.
    pub(crate) sky: Counted,
}

impl LightBuffers {
    /// Uploads lights.
    ///
    /// # Errors
    /// If memory is refused.
    pub(crate) fn new(gpu: &Gpu, lights: &PreparedLights) -> Result<Self, GpuError> {
        let mut lamps: Vec<_> = lights.lamps().iter().map(GpuLamp::new).collect();
        if lamps.is_empty() {
            lamps.push(GpuLamp::zeroed());
        }
        let image = lights.skies().iter().find_map(image);
        let pixels = image.map_or(0, |image| image.width * image.height).max(1);
        // Negative light and what is not finite are black, as when the CPU looks them up.
        let clean = |v: f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
        let pixel = |i: usize| -> [f32; 4] {
            let value = image.and_then(|image| image.pixels.get(i)).copied().unwrap_or_default();
            let is_finite = value.iter().all(|v| v.is_finite());
            let [r, g, b] = if is_finite { value.map(clean) } else { [0.0; 3] };
            [r, g, b, 0.0]
        };
        let sky: Vec<_> = (0..pixels.min(SKY_PIXELS_MAX)).map(pixel).collect();
        let buffer = |label, bytes: &[u8]| {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
            let made = gpu.buffer(label, bytes.len() as u64, usage)?;
            gpu.queue.write_buffer(&made, 0, bytes);
            Ok::<_, GpuError>(made)
        };
        Ok(Self {
            lamps: buffer("lamps", cast_slice(&lamps))?,
            sky: buffer("image of the sky", cast_slice(&sky))?,
        })
    }

    /// Bytes of both.
    pub(crate) fn bytes(&self) -> u64 {
        self.lamps.size() + self.sky.size()
    }
}

impl World {
    /// The world of a picture, without a sample.
    ///
    /// # Errors
    /// If the kernels do not draw these lights or options.
    pub(crate) fn new(
        camera: &Camera,
        lights: &PreparedLights,
        options: &Options,
    ) -> Result<Self, Unsupported> {
        check(lights, options)?;
        let mut world = Self {
            eye: camera.eye.extend(camera.focal_px).to_array(),
            right: camera.right.extend(camera.near).to_array(),
            up: camera.up.extend(camera.parallel_at).to_array(),
            forward: camera.forward.extend(0.0).to_array(),
            width: camera.width as u32,
            height: camera.height as u32,
            lamps: lights.lamps().len() as u32,
            bounces: options.bounces,
            shadow_log2: options.shadow_log2(),
            shows_sky: u32::from(options.shows_sky),
            ..Self::zeroed()
        };
        lights.skies().iter().for_each(|sky| world.add_sky(sky));
        Ok(world)
    }

    /// Adds a sky: all skies but an image are one gradient.
    fn add_sky(&mut self, sky: &Sky) {
        let [zenith, horizon, ground] = match sky {
            Sky::Constant(colour) => [*colour; 3],
            Sky::Gradient { zenith, horizon, ground } => [*zenith, *horizon, *ground],
            Sky::Image(image) => {
                (self.sky_width, self.sky_height) = (image.width as u32, image.height as u32);
                return;
            }
        };
        let parts = [&mut self.zenith, &mut self.horizon, &mut self.ground];
        for (sum, colour) in parts.into_iter().zip([zenith, horizon, ground]) {
            sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += value);
        }
    }

    /// The world for the pixels of a part.
    pub(crate) fn in_part(&self, part: Part) -> Self {
        Self { part, ..*self }
    }

    /// The world for sample `index` of all pixels, number `number` of its batch.
    pub(crate) fn at_sample(&self, sampler: &Sampler, number: u32, index: u32) -> Self {
        Self { sequence: sampler.parts(), number, index, ..*self }
    }
}

impl GpuLamp {
    fn new(lamp: &Lamp) -> Self {
        let four = |v: Vec3, w: f32| v.extend(w).to_array();
        let mut to = Self::zeroed();
        match *lamp {
            Lamp::Sun { direction, x, y, tan_radius, irradiance } => {
                to.place = four(Vec3::ZERO, SUN);
                to.axis = four(direction, tan_radius);
                (to.x, to.y) = (four(x, 0.0), four(y, 0.0));
                to.colour = four(irradiance, 0.0);
            }
            Lamp::Point { position, intensity } => {
                to.place = four(position, POINT);
                to.colour = four(intensity, 0.0);
            }
            Lamp::Spot { position, axis, intensity, cos_inner, cos_outer } => {
                to.place = four(position, SPOT);
                to.axis = four(axis, cos_inner);
                to.x = four(Vec3::ZERO, cos_outer);
                to.colour = four(intensity, 0.0);
            }
            Lamp::Area { corner, edges: [x, y], normal, area, radiance, two_sided } => {
                to.place = four(corner, AREA);
                to.axis = four(normal, area);
                (to.x, to.y) = (four(x, if two_sided { 1.0 } else { 0.0 }), four(y, 0.0));
                to.colour = four(radiance, 0.0);
            }
        }
        to
    }
}
