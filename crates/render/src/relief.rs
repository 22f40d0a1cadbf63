//! Relief: the shape that a depth image alone tells, for clouds without normals and for edges. Normals
//! from differences of smoothed depth; and how much a pixel lies behind its surroundings, which darkens
//! it (eye-dome lighting, after Boucheny 2009).
//!
//! Smoothing is a separable bilateral mean of five pixels an axis: what differs from the middle by more
//! than the surface can between two pixels is another surface, and takes no part.

use glam::Vec3;
use rayon::prelude::*;

/// Steepest slope (depth over width) that still counts as one surface.
const SLOPE_MAX: f32 = 6.0;
/// Weights of the smoothing, from the middle outwards (binomial).
const TAPS: [f32; 3] = [6.0, 4.0, 1.0];
/// Distance of the surroundings that darken, pixels.
const REACH: usize = 2;
/// Beyond this slope more depth darkens no more.
const BEHIND_MAX: f32 = 4.0;

/// A depth image: infinite where there is nothing.
#[derive(Clone, Copy)]
pub struct DepthImage<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Linear eye depth, row by row.
    pub depth: &'a [f32],
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle, pixels.
    pub centre_px: [f32; 2],
}

impl DepthImage<'_> {
    fn height(&self) -> usize {
        self.depth.len() / self.width
    }

    /// Depth at a place, infinite outside the picture.
    fn at(&self, x: isize, y: isize) -> f32 {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height();
        if inside { self.depth[y as usize * self.width + x as usize] } else { f32::INFINITY }
    }

    /// The mean along one axis, within the surface. `step` is the distance of taps, pixels.
    pub fn smooth(&self, horizontal: bool, step: usize, out: &mut [f32]) {
        out.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let middle = self.depth[y * self.width + x];
                if middle == f32::INFINITY {
                    *out = middle;
                    continue;
                }
                let (mut sum, mut weights) = (middle * TAPS[0], TAPS[0]);
                let pixel = middle / self.focal_px;
                for (k, &weight) in TAPS.iter().enumerate().skip(1) {
                    let d = (k * step) as isize;
                    let (dx, dy) = if horizontal { (d, 0) } else { (0, d) };
                    let a = self.at(x as isize - dx, y as isize - dy);
                    let b = self.at(x as isize + dx, y as isize + dy);
                    let near = SLOPE_MAX * pixel * d as f32;
                    // In pairs, so that a slope's edge does not bend towards its inside.
                    if (a - middle).abs() < near && (b - middle).abs() < near {
                        sum += (a + b) * weight;
                        weights += 2.0 * weight;
                    }
                }
                *out = sum / weights;
            }
        });
    }

    /// The normal in view space at a pixel that has a depth: towards the eye, unit length.
    pub fn normal(&self, x: usize, y: usize) -> Vec3 {
        let here = self.point(x, y, self.depth[y * self.width + x]);
        let right = self.tangent(here, x, y, 1, 0);
        let up = self.tangent(here, x, y, 0, -1);
        let n = right.cross(up).normalize_or(Vec3::Z);
        if n.dot(here) > 0.0 { -n } else { n }
    }

    /// The way along the surface in a direction: of the two sides the one of least change in depth,
    /// their mean where they are about as steep.
    fn tangent(&self, here: Vec3, x: usize, y: usize, dx: isize, dy: isize) -> Vec3 {
        let (x, y) = (x as isize, y as isize);
        let ahead = self.at(x + dx, y + dy) + here.z;
        let behind = self.at(x - dx, y - dy) + here.z;
        let pixel = -here.z / self.focal_px;
        let step = |d: isize, change: f32| {
            let (px, py) = ((x + dx * d) as usize, (y + dy * d) as usize);
            (self.point(px, py, change - here.z) - here) * d as f32
        };
        let (a, b) = (ahead.abs(), behind.abs());
        let limit = SLOPE_MAX * pixel;
        if a < limit && b < limit {
            step(1, ahead) + step(-1, behind)
        } else if a < b.min(limit) {
            step(1, ahead)
        } else if b < limit {
            step(-1, behind)
        } else {
            Vec3::new(dx as f32, -dy as f32, 0.0) * pixel
        }
    }

    /// A pixel in view space at a depth.
    fn point(&self, x: usize, y: usize, depth: f32) -> Vec3 {
        let across = depth / self.focal_px;
        let [cx, cy] = self.centre_px;
        Vec3::new((x as f32 + 0.5 - cx) * across, (cy - y as f32 - 0.5) * across, -depth)
    }

    /// How far a pixel lies behind its surroundings, 0 to 1; slopes up to `flat` do not count.
    pub fn behind(&self, x: usize, y: usize, flat: f32) -> f32 {
        let here = self.depth[y * self.width + x];
        let per_slope = self.focal_px / (here * REACH as f32);
        let r = REACH as isize;
        let around = [(r, 0), (-r, 0), (0, r), (0, -r), (r, r), (r, -r), (-r, r), (-r, -r)];
        let mut sum = 0.0;
        for (dx, dy) in around {
            let d = self.at(x as isize + dx, y as isize + dy);
            if d < here {
                sum += ((here - d) * per_slope - flat).clamp(0.0, BEHIND_MAX);
            }
        }
        sum / (BEHIND_MAX * around.len() as f32)
    }
}
