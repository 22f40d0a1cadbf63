//! Pictures of light as figures: tones, differences, close-ups, and pictures side by side.

use anyhow::Result;
use esker_engine::io::picture::write_png;
use esker_render::{Picture, Stats};
use esker_trace::Image;
use std::path::Path;

/// Width of the gap between pictures, pixels.
const GAP: usize = 4;
/// Grey of the gap.
const GREY: [u8; 4] = [128, 128, 128, 255];

/// A picture of sRGB with alpha.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tile {
    width: usize,
    height: usize,
    rgba: Vec<[u8; 4]>,
}

/// A rectangle of pixels: left, top, width, height.
pub(super) type Area = [usize; 4];

impl Tile {
    /// Light times `scale`, where 1 is white.
    pub fn of_light(image: &Image<3>, scale: f64) -> Self {
        let pixel = |x: usize, y: usize| image.at(x, y).map(|v| encode(f64::from(v) * scale));
        Self::of(image.width, image.height, pixel)
    }

    /// Absolute difference of two images times `scale`, without the curve of sRGB.
    pub fn of_difference(a: &Image<3>, b: &Image<3>, scale: f64) -> Self {
        let byte = |v: f64| (v * 255.0).round().clamp(0.0, 255.0) as u8;
        let pixel = |x: usize, y: usize| {
            let (a, b) = (a.at(x, y), b.at(x, y));
            [0, 1, 2].map(|c| byte(f64::from((a[c] - b[c]).abs()) * scale))
        };
        Self::of(a.width, a.height, pixel)
    }

    fn of(width: usize, height: usize, pixel: impl Fn(usize, usize) -> [u8; 3]) -> Self {
        let at = |i: usize| {
            let [r, g, b] = pixel(i % width, i / width);
            [r, g, b, 255]
        };
        Self { width, height, rgba: (0..width * height).map(at).collect() }
    }

    /// A part of the picture, each pixel `zoom` times as large.
    pub fn close_up(&self, [left, top, width, height]: Area, zoom: usize) -> Self {
        let at = |x: usize, y: usize| {
            let (x, y) = (left + x / zoom, top + y / zoom);
            let [r, g, b, _] =
                self.rgba[y.min(self.height - 1) * self.width + x.min(self.width - 1)];
            [r, g, b]
        };
        Self::of(width * zoom, height * zoom, at)
    }

    /// Pictures of equal height side by side.
    pub fn beside(tiles: &[Self]) -> Self {
        let height = tiles.iter().map(|t| t.height).max().unwrap_or(0);
        let width = tiles.iter().map(|t| t.width + GAP).sum::<usize>().saturating_sub(GAP);
        let mut all = Self { width, height, rgba: vec![GREY; width * height] };
        let mut left = 0;
        for tile in tiles {
            for y in 0..tile.height {
                all.rgba[y * width + left..][..tile.width]
                    .copy_from_slice(&tile.rgba[y * tile.width..][..tile.width]);
            }
            left += tile.width + GAP;
        }
        all
    }

    /// Pictures below each other.
    pub fn above(tiles: &[Self]) -> Self {
        let width = tiles.iter().map(|t| t.width).max().unwrap_or(0);
        let height = tiles.iter().map(|t| t.height + GAP).sum::<usize>().saturating_sub(GAP);
        let mut all = Self { width, height, rgba: vec![GREY; width * height] };
        let mut top = 0;
        for tile in tiles {
            for y in 0..tile.height {
                all.rgba[(top + y) * width..][..tile.width]
                    .copy_from_slice(&tile.rgba[y * tile.width..][..tile.width]);
            }
            top += tile.height + GAP;
        }
        all
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let picture = Picture {
            width: self.width as u32,
            height: self.height as u32,
            rgba: self.rgba.as_flattened().to_vec(),
            depth: Vec::new(),
            stats: Stats::default(),
        };
        write_png(&picture, path)
    }
}

/// A value of linear light as sRGB (IEC 61966-2-1).
fn encode(value: f64) -> u8 {
    let value = value.clamp(0.0, 1.0);
    let curve =
        if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 };
    (curve * 255.0).round() as u8
}

/// The square of `side` pixels around the pixel in which an image differs most from another, within
/// the picture.
pub(super) fn worst_area(image: &Image<3>, reference: &Image<3>, side: usize) -> Area {
    let off = |i: usize| {
        let one = |c: usize| (image.planes[c][i] - reference.planes[c][i]).abs();
        one(0).max(one(1)).max(one(2))
    };
    let worst = (0..image.len()).max_by(|&a, &b| off(a).total_cmp(&off(b))).unwrap_or(0);
    let (width, height) = (image.width.max(1), image.height);
    let start = |at: usize, size: usize| at.saturating_sub(side / 2).min(size.saturating_sub(side));
    let [w, h] = [width, height].map(|size| side.min(size));
    [start(worst % width, width), start(worst / width, height), w, h]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn light(width: usize, height: usize, at: usize) -> Image<3> {
        let mut image = Image::new(width, height);
        image.planes.iter_mut().for_each(|plane| plane[at] = 1.0);
        image
    }

    #[test]
    fn tiles_keep_their_pixels_side_by_side_and_above() {
        let (a, b) = (light(3, 2, 4), light(2, 2, 0));
        let tiles = [Tile::of_light(&a, 1.0), Tile::of_light(&b, 1.0)];
        let row = Tile::beside(&tiles);
        assert_eq!((row.width, row.height), (3 + GAP + 2, 2));
        assert_eq!(row.rgba[row.width + 1], [255; 4]);
        assert_eq!(row.rgba[3], GREY);
        assert_eq!(row.rgba[3 + GAP], [255; 4]);
        let column = Tile::above(&tiles);
        assert_eq!((column.width, column.height), (3, 4 + GAP));
        assert_eq!(column.rgba[(2 + GAP) * 3], [255; 4]);
        assert_eq!(Tile::beside(&[]).rgba, Vec::<[u8; 4]>::new());
    }

    #[test]
    fn a_close_up_shows_the_worst_pixel_within_the_picture() {
        let (spot, dark) = (light(20, 10, 19), Image::new(20, 10));
        let area = worst_area(&spot, &dark, 6);
        assert_eq!(area, [14, 0, 6, 6]);
        let shown = Tile::of_light(&spot, 1.0).close_up(area, 2);
        assert_eq!((shown.width, shown.height), (12, 12));
        assert_eq!(shown.rgba[11], [255; 4]);
        assert_eq!(worst_area(&light(3, 2, 5), &Image::new(3, 2), 6), [0, 0, 3, 2]);
    }

    #[test]
    fn half_of_the_light_is_188() {
        assert_eq!([0.0, 0.5, 1.0, 9.0, f64::NAN].map(encode), [0, 188, 255, 255, 0]);
    }
}
