//! Perceived difference of two pictures by the metric FLIP (`andersson2020`), written from the
//! paper: the crate that wraps the authors' code needs a C++ compiler, which nothing else here
//! needs. Pictures are 8-bit sRGB, four bytes a pixel.

use glam::{Mat3, Vec3, Vec4};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Pixels a degree of the visual angle: a display 3840 pixels and 0.7 m wide, seen from 0.7 m.
const PIXELS_A_DEGREE: f32 = 67.020_64;
/// Reference white (D65), XYZ.
const WHITE: Vec3 = Vec3::new(0.950_428_55, 1.0, 1.088_900_4);
/// Width of detected features, degrees (section 4.2).
const FEATURE_DEGREES: f32 = 0.082;

/// Mean of the metric over the picture, from 0 (equal) to 1; 0 for a picture without pixels. Alpha
/// is ignored.
pub fn mean_flip(a: &[u8], b: &[u8], width: usize) -> f64 {
    let map = flip(a, b, width);
    map.iter().map(|share| f64::from(*share)).sum::<f64>() / map.len().max(1) as f64
}

/// The metric of each pixel, from 0 (equal) to 1. Alpha is ignored.
pub fn flip(a: &[u8], b: &[u8], width: usize) -> Vec<f32> {
    let [a, b] = [a, b].map(opponent);
    let colours = colour_differences(&filtered(&a, width), &filtered(&b, width));
    let [a, b] = [&a, &b].map(|image| features(image, width));
    let shares = colours.par_iter().zip(a.par_iter().zip(&b)).map(|(colour, (a, b))| {
        let feature = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        let feature = (feature / 2f32.sqrt()).clamp(0.0, 1.0).sqrt();
        colour.powf(1.0 - feature)
    });
    shares.collect()
}

fn xyz_from_rgb() -> Mat3 {
    Mat3::from_cols(
        Vec3::new(0.412_390_8, 0.212_639, 0.019_330_82),
        Vec3::new(0.357_584_34, 0.715_168_7, 0.119_194_78),
        Vec3::new(0.180_480_8, 0.072_192_32, 0.950_532_15),
    )
}

/// Converts a picture to opponent colours: luminance, red to green, blue to yellow (section 4.1).
fn opponent(rgba: &[u8]) -> Vec<Vec3> {
    let linear: [f32; 256] = std::array::from_fn(|c| {
        let c = c as f32 / 255.0;
        if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    });
    let xyz_from_rgb = xyz_from_rgb();
    let pixel = |p: &[u8; 4]| {
        let [r, g, b, _] = p.map(|c| linear[usize::from(c)]);
        let xyz = xyz_from_rgb * Vec3::new(r, g, b) / WHITE;
        Vec3::new(116.0 * xyz.y - 16.0, 500.0 * (xyz.x - xyz.y), 200.0 * (xyz.y - xyz.z))
    };
    rgba.as_chunks::<4>().0.par_iter().map(pixel).collect()
}

fn rgb_from_opponent(c: Vec3, rgb_from_xyz: &Mat3) -> Vec3 {
    let y = (c.x + 16.0) / 116.0;
    let xyz = Vec3::new(y + c.y / 500.0, y, y - c.z / 200.0) * WHITE;
    *rgb_from_xyz * xyz
}

/// Convolves the rows with `along` and the columns with `across`, which have weights for each of
/// four channels. Pixels of the border are repeated beyond it.
fn convolve(image: &[Vec4], width: usize, along: &[Vec4], across: &[Vec4]) -> Vec<Vec4> {
    let (width, reach) = (width.max(1), along.len() / 2);
    let height = image.len() / width;
    let mut rows = vec![Vec4::ZERO; image.len()];
    rows.par_chunks_mut(width).zip(image.par_chunks(width)).for_each(|(to, from)| {
        let (first, last) = (from[0], from[from.len() - 1]);
        let wide: Vec<Vec4> = std::iter::repeat_n(first, reach)
            .chain(from.iter().copied())
            .chain(std::iter::repeat_n(last, reach))
            .collect();
        for (to, from) in to.iter_mut().zip(wide.windows(along.len())) {
            *to = from
                .iter()
                .zip(along)
                .fold(Vec4::ZERO, |sum, (from, weight)| sum + *from * *weight);
        }
    });
    let mut out = vec![Vec4::ZERO; image.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
        for (k, weight) in across.iter().enumerate() {
            let at = (y + k).saturating_sub(across.len() / 2).min(height - 1);
            let from = &rows[at * width..][..width];
            to.iter_mut().zip(from).for_each(|(to, from)| *to += *from * *weight);
        }
    });
    out
}

/// Weights of four channels, of a kernel each.
fn joined([x, y, z, w]: [&[f32]; 4]) -> Vec<Vec4> {
    let pairs = x.iter().zip(y).zip(z.iter().zip(w));
    pairs.map(|((x, y), (z, w))| Vec4::new(*x, *y, *z, *w)).collect()
}

fn gaussian(radius: i32, at: impl Fn(f32) -> f32) -> Vec<f32> {
    let weights: Vec<f32> = (-radius..=radius).map(|x| at(x as f32)).collect();
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|w| w / sum).collect()
}

/// Blurs each opponent channel by the contrast sensitivity of the eye (table 1) and converts the
/// result to linear RGB, clamped to 0..1.
fn filtered(image: &[Vec3], width: usize) -> Vec<Vec3> {
    // Three sigmas of the widest filter, for all channels.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_A_DEGREE).ceil() as i32;
    let kernel = |b: f32| gaussian(radius, |x| (-(PI * x / PIXELS_A_DEGREE).powi(2) / b).exp());
    let kernels = [0.0047, 0.0053, 0.04, 0.025].map(kernel);
    let kernel = joined(kernels.each_ref().map(Vec::as_slice));
    // The third channel has two filters.
    let image: Vec<Vec4> = image.par_iter().map(|c| Vec4::new(c.x, c.y, c.z, c.z)).collect();
    let blurred = convolve(&image, width, &kernel, &kernel);
    // Weight of a filter: its factor times sqrt(b).
    let [broad, narrow] = [34.1 * 0.04f32.sqrt(), 13.5 * 0.025f32.sqrt()];
    let share = broad / (broad + narrow);
    let to_rgb = xyz_from_rgb().inverse();
    let rgb = |c: &Vec4| {
        let c = Vec3::new(c.x, c.y, c.z * share + c.w * (1.0 - share));
        rgb_from_opponent(c, &to_rgb).clamp(Vec3::ZERO, Vec3::ONE)
    };
    blurred.par_iter().map(rgb).collect()
}

/// Converts to CIELAB with the Hunt effect: chroma counts less in dark pixels.
fn hunt_lab(rgb: Vec3) -> Vec3 {
    let f = |t: f32| {
        let d: f32 = 6.0 / 29.0;
        if t > d.powi(3) { t.cbrt() } else { t / (3.0 * d * d) + 4.0 / 29.0 }
    };
    let xyz = xyz_from_rgb() * rgb / WHITE;
    let (x, y, z) = (f(xyz.x), f(xyz.y), f(xyz.z));
    let lightness = 116.0 * y - 16.0;
    Vec3::new(lightness, 5.0 * (x - y) * lightness, 2.0 * (y - z) * lightness)
}

/// Computes differences of colours, 0 to 1 (section 4.1).
fn colour_differences(a: &[Vec3], b: &[Vec3]) -> Vec<f32> {
    let distance = |a: Vec3, b: Vec3| {
        let d = (hunt_lab(a) - hunt_lab(b)).abs();
        (d.x + d.y.hypot(d.z)).powf(0.7)
    };
    let most = distance(Vec3::Y, Vec3::Z);
    let (knee, at_knee) = (0.4 * most, 0.95);
    let share = |(a, b): (&Vec3, &Vec3)| {
        let d = distance(*a, *b);
        let over = at_knee + (d - knee) / (most - knee) * (1.0 - at_knee);
        (if d < knee { d * at_knee / knee } else { over }).clamp(0.0, 1.0)
    };
    a.par_iter().zip(b).map(share).collect()
}

/// Detects edges and points in the luminance (section 4.2).
fn features(image: &[Vec3], width: usize) -> Vec<[f32; 2]> {
    let luminance: Vec<Vec4> =
        image.par_iter().map(|c| Vec4::splat((c.x + 16.0) / 116.0)).collect();
    let sigma = 0.5 * FEATURE_DEGREES * PIXELS_A_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    let bell = |x: f32| (-x * x / (2.0 * sigma * sigma)).exp();
    let smooth = gaussian(radius, bell);
    // Weights above and below zero sum to one each.
    let balanced = |at: &dyn Fn(f32) -> f32| -> Vec<f32> {
        let weights: Vec<f32> = (-radius..=radius).map(|x| at(x as f32)).collect();
        let above: f32 = weights.iter().filter(|w| **w > 0.0).sum();
        let below: f32 = -weights.iter().filter(|w| **w < 0.0).sum::<f32>();
        weights.into_iter().map(|w| w / if w > 0.0 { above } else { below }).collect()
    };
    let edge = balanced(&|x| -x * bell(x));
    let point = balanced(&|x| (x * x / (sigma * sigma) - 1.0) * bell(x));
    // Channels: edges along rows and columns, points along rows and columns.
    let along = joined([&edge, &smooth, &point, &smooth]);
    let across = joined([&smooth, &edge, &smooth, &point]);
    let found = convolve(&luminance, width, &along, &across);
    found.par_iter().map(|c| [c.x.hypot(c.y), c.z.hypot(c.w)]).collect()
}
