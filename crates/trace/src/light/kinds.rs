//! Lights as users state them: plain data with positions in world coordinates, which a document can
//! embed. Light that arrives from sampled lights is direct, that of the sky is estimated with
//! indirect light (`bauszat2011`, section 3.1).

use super::sky::Sky;
use serde::{Deserialize, Serialize};

/// Version of [`Lights`] that this crate writes.
pub const LIGHTS_VERSION: u32 = 1;

/// Angular diameter of the sun seen from the earth, degrees.
pub const SUN_DIAMETER_DEG: f64 = 0.533;

/// All lights of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lights {
    /// Version of the data, at most [`LIGHTS_VERSION`].
    #[serde(default = "version")]
    pub version: u32,
    /// The lights.
    pub lights: Vec<Light>,
}

impl Default for Lights {
    fn default() -> Self {
        Self { version: LIGHTS_VERSION, lights: Vec::new() }
    }
}

impl From<Vec<Light>> for Lights {
    fn from(lights: Vec<Light>) -> Self {
        Self { lights, ..Self::default() }
    }
}

fn version() -> u32 {
    LIGHTS_VERSION
}

fn sun_diameter_deg() -> f64 {
    SUN_DIAMETER_DEG
}

/// A light. Colours are linear light: red, green, blue. Positions are world coordinates, lengths
/// the file's unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Light {
    /// Parallel light from a disc at infinite distance.
    Sun {
        /// Direction to the sun, degrees clockwise from north (the world's y) to east (its x).
        azimuth_deg: f64,
        /// Height above the horizon (the plane of the world's x and y), degrees.
        elevation_deg: f64,
        /// Irradiance of a surface that faces the sun.
        irradiance: [f32; 3],
        /// Apparent diameter, degrees; 0 for sharp shadows.
        #[serde(default = "sun_diameter_deg")]
        angular_diameter_deg: f64,
    },
    /// Light from all directions in which nothing is hit.
    Sky {
        /// Its radiance.
        sky: Sky,
    },
    /// A lamp that shines equally in all directions.
    Point {
        /// Its place.
        position: [f64; 3],
        /// Radiant intensity: irradiance of a facing surface at distance 1.
        intensity: [f32; 3],
    },
    /// A lamp that shines into a cone.
    Spot {
        /// Its place.
        position: [f64; 3],
        /// Direction in which it shines, any length.
        direction: [f64; 3],
        /// Radiant intensity on the axis.
        intensity: [f32; 3],
        /// Angle between the axis and the end of full intensity, degrees.
        inner_angle_deg: f64,
        /// Angle between the axis and the end of the cone, degrees, at most 180.
        outer_angle_deg: f64,
    },
    /// A parallelogram that shines.
    Area {
        /// A corner.
        corner: [f64; 3],
        /// The edges that start at the corner. Light leaves the side from which the first turns
        /// counterclockwise to the second.
        edges: [[f64; 3]; 2],
        /// Radiance, the same in all directions.
        radiance: [f32; 3],
        /// Whether the other side shines too.
        #[serde(default)]
        two_sided: bool,
    },
}
