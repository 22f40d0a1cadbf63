//! A picture that others are compared with: drawn finer than it is shown, and reduced.

use esker_render::Picture;
use esker_truth::image::{linear, srgb};
use glam::Vec3;

/// Pixels of a drawn reference along a side of a shown pixel.
pub(super) const FINER: usize = 2;

/// A picture that others are compared with.
pub(crate) struct Reference {
    /// Pixels in a row.
    pub width: usize,
    /// sRGB, four bytes a pixel.
    pub rgba: Vec<u8>,
    /// Depths in the unit of the file; infinite where any part of the pixel is empty.
    pub depth: Vec<f32>,
}

impl Reference {
    /// Reduces a picture that is [`FINER`] times as wide and high.
    pub fn of(picture: &Picture) -> Self {
        let wide = picture.width as usize;
        let (width, height) = (wide / FINER, picture.height as usize / FINER);
        let mut out = Self { width, rgba: Vec::new(), depth: Vec::new() };
        let share = 1.0 / (FINER * FINER) as f32;
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let parts = (0..FINER * FINER)
                .map(|part| (y * FINER + part / FINER) * wide + x * FINER + part % FINER);
            let (mut light, mut depth, mut alpha) = (Vec3::ZERO, 0.0, 0.0);
            for at in parts {
                let [r, g, b, a] = *picture.rgba[at * 4..].first_chunk().unwrap_or(&[0; 4]);
                light += linear([r, g, b]) * share;
                alpha += f32::from(a) * share;
                depth += picture.depth[at] * share;
            }
            let [r, g, b] = srgb(light).to_array().map(|value| value.round() as u8);
            out.rgba.extend([r, g, b, alpha.round() as u8]);
            out.depth.push(depth);
        }
        out
    }

    /// The picture itself.
    pub fn picture(&self) -> Picture {
        Picture {
            width: self.width as u32,
            height: (self.depth.len() / self.width.max(1)) as u32,
            rgba: self.rgba.clone(),
            depth: self.depth.clone(),
            ..Picture::default()
        }
    }
}
