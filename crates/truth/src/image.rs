//! The perfect picture of a view of an analytic scene.

use crate::Truth;
use esker_lod::View;
use glam::{DVec2, DVec3, Vec3};

/// A pixel of a perfect picture.
#[derive(Clone, Copy, Debug)]
pub struct TruePixel {
    /// Linear eye depth.
    pub depth: f64,
    /// Depth of the next surface on the same ray, infinite if there is none.
    pub behind: f64,
    /// Normal in view space.
    pub normal: DVec3,
    /// Mean over the pixel, linear light.
    pub colour: Vec3,
    /// Index of the surface in [`Truth::parts`].
    pub part: usize,
}

/// A perfect picture.
pub struct Image {
    /// Pixels in a row.
    pub width: usize,
    /// Surfaces at the centres of the pixels.
    pub pixels: Vec<Option<TruePixel>>,
    /// Share of each pixel that surfaces cover.
    pub coverage: Vec<f64>,
}

/// Rays along the side of a pixel, for means over the pixel.
const RAYS: usize = 3;

impl Image {
    /// The perfect picture of a view: nine rays a pixel for its mean colour and coverage.
    pub fn new(truth: &Truth, view: &View) -> Self {
        let [width, height] = [view.width, view.height].map(|s| s as usize);
        let (mut pixels, mut coverage) = (Vec::new(), Vec::new());
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let corner = DVec2::new(x as f64, y as f64);
            let hits = |place: DVec2| truth.hits(view.eye, Truth::ray(view, place));
            let (mut colour, mut count) = (Vec3::ZERO, 0);
            for i in 0..RAYS * RAYS {
                let part = DVec2::new((i % RAYS) as f64 + 0.5, (i / RAYS) as f64 + 0.5);
                if let Some(first) = hits(corner + part / RAYS as f64).first() {
                    colour += linear(first.colour);
                    count += 1;
                }
            }
            let all = hits(corner + 0.5);
            let depth = |t: f64| t;
            pixels.push(all.first().map(|first| TruePixel {
                depth: depth(first.t),
                behind: all.get(1).map_or(f64::INFINITY, |h| depth(h.t)),
                normal: view.view_from_world() * first.normal,
                colour: if count > 0 { colour / count as f32 } else { linear(first.colour) },
                part: first.part,
            }));
            coverage.push(f64::from(count) / (RAYS * RAYS) as f64);
        }
        Self { width, pixels, coverage }
    }

    /// Whether all pixels within `reach` of `pixel` are fully covered, with no step in depth
    /// between them.
    pub fn is_inside(&self, pixel: usize, reach: usize) -> bool {
        let (x, y, height) =
            (pixel % self.width, pixel / self.width, self.pixels.len() / self.width);
        let Some(here) = self.pixels[pixel] else { return false };
        let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
        rows.flat_map(|v| {
            (x.saturating_sub(reach)..(x + reach + 1).min(self.width))
                .map(move |u| v * self.width + u)
        })
        .all(|p| {
            self.coverage[p] == 1.0
                && self.pixels[p].is_some_and(|s| {
                    s.part == here.part && (s.depth / here.depth - 1.0).abs() < 0.3
                })
        })
    }
}

/// Converts sRGB to linear light, 0 to 1.
pub fn linear(colour: [u8; 3]) -> Vec3 {
    let one = |v: u8| {
        let v = f32::from(v) / 255.0;
        if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    Vec3::from(colour.map(one))
}

/// Converts linear light to sRGB, 0 to 255.
pub fn srgb(c: Vec3) -> Vec3 {
    let one = |v: f32| {
        let v = v.clamp(0.0, 1.0);
        255.0 * if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
    };
    Vec3::new(one(c.x), one(c.y), one(c.z))
}
