//! Radiance of the sky by direction: constant, a gradient, or a panorama of equirectangular
//! projection. In: a unit direction. Out: linear radiance.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
use std::path::PathBuf;

/// Radiance of the sky, linear light; the world's z is up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Sky {
    /// The same in all directions.
    Constant([f32; 3]),
    /// Blended from the horizon up and down, linear in the sine of the elevation.
    Gradient {
        /// Straight up.
        zenith: [f32; 3],
        /// At the horizon.
        horizon: [f32; 3],
        /// Straight down.
        ground: [f32; 3],
    },
    /// An image of all directions.
    Image(Panorama),
}

/// Equirectangular image: the first row is at the zenith, the middle of a row faces north (the
/// world's y), columns go clockwise from south over west, north and east.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Panorama {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Radiance of each pixel, row by row; missing ones are black.
    pub pixels: Vec<[f32; 3]>,
    /// File that the pixels come from; none if they were given as numbers.
    #[serde(skip)]
    pub file: Option<PanoramaFile>,
}

/// Where the pixels of a [`Panorama`] come from.
#[derive(Clone, Debug, PartialEq)]
pub struct PanoramaFile {
    /// The picture.
    pub path: PathBuf,
    /// Factor by which its light was multiplied.
    pub strength: f64,
}

impl Panorama {
    /// Radiance in a direction, bilinear between the centres of pixels.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        if self.width == 0 || self.height == 0 {
            return Vec3::ZERO;
        }
        let turn = direction.x.atan2(direction.y) / (2.0 * PI) + 0.5;
        let down = direction.z.clamp(-1.0, 1.0).acos() / PI;
        let x = turn * self.width as f32 - 0.5;
        let y = (down * self.height as f32 - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (left, top) = (x.floor(), y.floor());
        let (right_share, low_share) = (x - left, y - top);
        let row = |y: usize| {
            let column = |x: i64| self.pixel(x.rem_euclid(self.width as i64) as usize, y);
            column(left as i64).lerp(column(left as i64 + 1), right_share)
        };
        let top = top as usize;
        row(top).lerp(row((top + 1).min(self.height - 1)), low_share)
    }

    fn pixel(&self, x: usize, y: usize) -> Vec3 {
        let value = self.pixels.get(y * self.width + x).map_or(Vec3::ZERO, |&p| Vec3::from(p));
        if value.is_finite() { value.max(Vec3::ZERO) } else { Vec3::ZERO }
    }
}

impl Sky {
    /// Radiance in a direction of unit length.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match self {
            Self::Constant(colour) => Vec3::from(*colour),
            Self::Gradient { zenith, horizon, ground } => {
                let end = if direction.z >= 0.0 { zenith } else { ground };
                Vec3::from(*horizon).lerp(Vec3::from(*end), direction.z.abs().min(1.0))
            }
            Self::Image(panorama) => panorama.radiance(direction),
        }
    }
}
