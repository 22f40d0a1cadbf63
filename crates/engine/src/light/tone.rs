//! From linear light to the bytes of a picture: one exposure for the whole picture, then sRGB.
//! Without an exposure of the user, one is chosen so that bright surfaces are just not white.

use esker_render::Background;
use rayon::prelude::*;

/// Share of the lit pixels that are brighter than [`BRIGHT`] at the exposure that is chosen: few
/// enough for a picture that is not burnt out, and more than fireflies and lamps in view.
const BRIGHT_SHARE: f64 = 0.02;
/// Linear light that the brightest pixels but for [`BRIGHT_SHARE`] are shown as.
const BRIGHT: f64 = 0.8;
/// Exposures that are chosen: beyond, a picture is black or has no light.
const EXPOSURES: [f64; 2] = [1e-12, 1e12];

/// Exposure for the luminances of surfaces in view; 1 without any light.
fn exposure_of(luminances: impl Iterator<Item = f32>) -> f64 {
    let mut lit: Vec<f32> = luminances.filter(|l| l.is_finite() && *l >= 0.0).collect();
    let Some(last) = lit.len().checked_sub(1) else { return 1.0 };
    let at = (last as f64 * (1.0 - BRIGHT_SHARE)) as usize;
    let bright = f64::from(*lit.select_nth_unstable_by(at, f32::total_cmp).1);
    if bright > 0.0 { (BRIGHT / bright).clamp(EXPOSURES[0], EXPOSURES[1]) } else { 1.0 }
}

/// Luminance of linear light.
fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// Light of the pixels of a picture, row by row.
pub struct Tones<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Radiance, one plane a channel; where surfaces cover a part of a pixel, that of the part.
    pub radiance: &'a [Vec<f32>; 3],
    /// Share of each pixel that is lit.
    pub coverage: &'a [f32],
    /// Factor from radiance to the picture.
    pub exposure: f64,
    /// Background of what is not lit; none where the sky is seen.
    pub background: Option<Background>,
}

impl Tones<'_> {
    /// Exposure for the pixels that are lit.
    pub fn chosen_exposure(&self) -> f64 {
        let lit = (0..self.coverage.len()).filter(|&i| self.coverage[i] > 0.5);
        exposure_of(lit.map(|i| luminance(self.at(i)) / self.coverage[i]))
    }

    fn at(&self, i: usize) -> [f32; 3] {
        std::array::from_fn(|c| self.radiance[c][i])
    }

    /// Writes the picture: sRGB with alpha, four bytes a pixel.
    pub fn encode(&self, rgba: &mut [u8]) {
        let width = self.width.max(1);
        let height = self.coverage.len() / width;
        rgba.par_chunks_exact_mut(width * 4).enumerate().for_each(|(y, row)| {
            let behind = self.background.map_or([0.0; 3], |b| background_at(b, y, height));
            for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
                let i = y * width + x;
                let open = 1.0 - self.coverage[i].clamp(0.0, 1.0);
                let light = self.at(i).map(|l| l * self.exposure as f32);
                for c in 0..3 {
                    let lit = if light[c].is_finite() { light[c].clamp(0.0, 1.0) } else { 0.0 };
                    pixel[c] = to_srgb((lit + behind[c] * open).min(1.0));
                }
                pixel[3] = 255;
            }
        });
    }
}

/// Linear colour of the background in a row.
fn background_at(background: Background, y: usize, height: usize) -> [f32; 3] {
    let colour = match background {
        Background::Plain([r, g, b, _]) => [r, g, b].map(f32::from),
        Background::Gradient(top, bottom) => {
            let down = (y as f32 + 0.5) / height.max(1) as f32;
            std::array::from_fn(|c| {
                f32::from(top[c]) + (f32::from(bottom[c]) - f32::from(top[c])) * down
            })
        }
    };
    colour.map(|c| srgb_to_linear(c / 255.0))
}

/// Decodes a value of sRGB, 0 to 1.
pub fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// Encodes linear light, 0 to 1, as a byte of sRGB.
fn to_srgb(value: f32) -> u8 {
    let value =
        if value <= 0.003_130_8 { value * 12.92 } else { value.powf(1.0 / 2.4) * 1.055 - 0.055 };
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_survives_linear_light() {
        for byte in 0..=255u8 {
            assert_eq!(to_srgb(srgb_to_linear(f32::from(byte) / 255.0)), byte);
        }
    }

    #[test]
    fn the_chosen_exposure_follows_the_light_and_ignores_few_bright_pixels() {
        let exposure = |factor: f32, lamp: f32| {
            let surfaces = (0..1000).map(|i| i as f32 * 1e-3 * factor);
            exposure_of(surfaces.chain([lamp; 5]))
        };
        let base = exposure(1.0, 1.0);
        assert!((exposure(100.0, 1.0) * 100.0 / base - 1.0).abs() < 0.02);
        assert!((exposure(1.0, 1e9) / base - 1.0).abs() < 0.02);
        assert_eq!([exposure(0.0, 0.0), exposure_of([].into_iter())], [1.0; 2]);
        assert_eq!(exposure_of([f32::NAN, f32::INFINITY].into_iter()), 1.0);
    }

    #[test]
    fn invalid_light_is_black_and_what_is_not_lit_shows_the_background() {
        let radiance = [[f32::NAN, f32::INFINITY, -1.0, 1e30, 0.0]; 3].map(Vec::from);
        let tones = Tones {
            width: 5,
            radiance: &radiance,
            coverage: &[1.0, 1.0, 1.0, 1.0, 0.0],
            exposure: 1.0,
            background: Some(Background::Plain([9, 8, 7, 255])),
        };
        let mut rgba = [7; 20];
        tones.encode(&mut rgba);
        let black = [0, 0, 0, 255];
        assert_eq!(rgba[..12], [black; 3].concat());
        assert_eq!(rgba[12..], [255, 255, 255, 255, 9, 8, 7, 255]);
    }
}
