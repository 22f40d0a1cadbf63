//! The uniform of the view, the lights and the sequence of samples, as the kernels of paths take it
//! (`shaders/common/world.wgsl`). Refuses what they do not draw.

use crate::camera::Camera;
use crate::gpu::{same_layout, same_values, without_twin};
use crate::light::{Lamp, PreparedLights, Sky};
use crate::paths::{Options, Sampler};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Most lamps: they lie in a uniform, of which WebGPU guarantees 64 KiB.
pub(crate) const LAMPS_MAX: usize = 16;
const SUN: f32 = 0.0;
const POINT: f32 = 1.0;
const SPOT: f32 = 2.0;
const AREA: f32 = 3.0;

same_values!(common_world == crate::gpu::world { LAMPS_MAX });
same_values!(common_lamps == crate::gpu::world { SUN, POINT, SPOT, AREA });
without_twin!(common_lamps { TURN });
without_twin!(common_sequence { PIXEL_BITS });
without_twin!(common_directions { QUARTER_PI });
without_twin!(common_place_seen { NOTHING, REFLECTS, EMITS });
without_twin!(common_direct { LIGHT_DIMENSION, SHADOW_REACH, PI_SHARE, BOUNCE_DIMENSION });
without_twin!(common_direct { ROULETTE_BOUNCE, BELOW_ONE });
without_twin!(trace_direct {
    PIXEL_DIMENSION,
    FIT_COS,
    FIT_PIXELS,
    MIDDLE_SLOT,
    NORMAL_ROUNDING,
    DEPTH_ROUNDING,
    NEAR_TIE,
});

/// Why a picture cannot be lit on a GPU; the CPU draws it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsupported {
    /// More lamps than a uniform holds.
    #[error("the scene has more than 16 lamps")]
    Lamps,
    /// A sky that is an image.
    #[error("the sky is an image")]
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
    lamp: [GpuLamp; LAMPS_MAX],
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
    lamp,
});

/// Refuses lights and options that the kernels do not draw.
///
/// # Errors
/// With the first reason.
pub fn check(lights: &PreparedLights, options: &Options) -> Result<(), Unsupported> {
    if lights.lamps().len() > LAMPS_MAX {
        return Err(Unsupported::Lamps);
    }
    if options.gloss.is_some() {
        return Err(Unsupported::Gloss);
    }
    if options.filters_visibility {
        return Err(Unsupported::Visibility);
    }
    if lights.skies().iter().any(|sky| matches!(sky, Sky::Image(_))) {
        return Err(Unsupported::Panorama);
    }
    Ok(())
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
            up: camera.up.extend(0.0).to_array(),
            forward: camera.forward.extend(0.0).to_array(),
            width: camera.width as u32,
            height: camera.height as u32,
            lamps: lights.lamps().len() as u32,
            bounces: options.bounces,
            shadow_log2: options.shadow_log2(),
            shows_sky: u32::from(options.shows_sky),
            ..Self::zeroed()
        };
        for (to, lamp) in world.lamp.iter_mut().zip(lights.lamps()) {
            *to = GpuLamp::new(lamp);
        }
        for sky in lights.skies() {
            world.add_sky(sky)?;
        }
        Ok(world)
    }

    /// Adds a sky: all skies together are one gradient.
    fn add_sky(&mut self, sky: &Sky) -> Result<(), Unsupported> {
        let [zenith, horizon, ground] = match sky {
            Sky::Constant(colour) => [*colour; 3],
            Sky::Gradient { zenith, horizon, ground } => [*zenith, *horizon, *ground],
            Sky::Image(_) => return Err(Unsupported::Panorama),
        };
        let parts = [&mut self.zenith, &mut self.horizon, &mut self.ground];
        for (sum, colour) in parts.into_iter().zip([zenith, horizon, ground]) {
            sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += value);
        }
        Ok(())
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
