//! Camera and lights of a generated mesh as plain numbers, in metres, degrees and linear light.

/// Where a mesh is seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The eye.
    pub eye: [f64; 3],
    /// The point in the middle of the picture. Up is z.
    pub target: [f64; 3],
    /// Vertical angle of view, degrees.
    pub fov_deg: f64,
}

/// A source of light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lamp {
    /// The sun.
    Sun {
        /// Direction to it from north (y) towards east (x), degrees.
        azimuth_deg: f64,
        /// Height above the horizon, degrees.
        elevation_deg: f64,
        /// Diameter of its disc, degrees.
        diameter_deg: f64,
        /// Irradiance of a surface that faces it, red, green and blue.
        irradiance: [f64; 3],
    },
    /// The sky: radiance that changes from the horizon to the zenith.
    Sky {
        /// Radiance overhead.
        zenith: [f64; 3],
        /// Radiance at the horizon and below.
        horizon: [f64; 3],
    },
    /// A small lamp.
    Point {
        /// Its place.
        place: [f64; 3],
        /// Radiant intensity in every direction.
        intensity: [f64; 3],
    },
}
