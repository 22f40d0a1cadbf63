//! Nested windows: the guided filter with noise-scaled epsilon at two radii. The small windows
//! follow the light more closely, the large ones have less noise. The difference of the two results
//! is light and noise; it counts by the share of light in its energy (James and Stein's estimator).
//! The share of noise is known from an image of white noise that goes through the same filters.

use super::boxes::Boxes;
use super::guided::{Ridges, regress};
use super::input::Input;
use super::moments::LUMINANCE;
use rayon::prelude::*;

/// Radii of the windows, pixels. Three and more radii from 3 pixels on have larger errors.
pub(crate) const RADII: [usize; 2] = [8, 24];
/// Radius of the windows in which the energy of the difference is measured, pixels.
pub(crate) const ENERGY_RADIUS: usize = 8;

/// Filters a picture of three signals.
pub(crate) fn nested(input: &Input<'_>, ridges: &Ridges) -> Vec<Vec<f32>> {
    let white: Vec<f32> = input.mask.iter().enumerate().map(|(i, &mask)| mask * sign(i)).collect();
    let input = input.with_signal(&white);
    let [small, mut large] = RADII.map(|radius| regress(&input, radius, ridges));
    let boxes = |radius: usize| Boxes { width: input.width, mask: &input.mask, radius };
    let [_, far] = RADII;
    let noise = boxes(far).means(|i| {
        let value = f64::from(luminance(&input.signals, i));
        [value, value * value]
    });
    let energy = boxes(ENERGY_RADIUS).means(|i| {
        let light = f64::from(luminance(&small, i) - luminance(&large, i));
        let white = f64::from(small[3][i] - large[3][i]);
        [light * light, white * white]
    });
    let weights: Vec<f32> = noise
        .par_iter()
        .zip(&energy)
        .map(|(&([mean, square], _), &([light, white], _))| {
            let noise = (square - mean * mean).max(0.0) * white;
            if light > noise { (1.0 - noise / light) as f32 } else { 0.0 }
        })
        .collect();
    for (large, small) in large.iter_mut().zip(&small) {
        large.par_iter_mut().zip(small).zip(&weights).for_each(|((large, small), weight)| {
            *large += weight * (small - *large);
        });
    }
    large
}

/// Luminance of a pixel.
fn luminance<P: AsRef<[f32]>>(planes: &[P], i: usize) -> f32 {
    LUMINANCE.iter().zip(planes).map(|(&weight, plane)| weight as f32 * plane.as_ref()[i]).sum()
}

/// White noise of variance one: a random sign, by the hash `lowbias32` (Wellons) of the pixel.
fn sign(i: usize) -> f32 {
    let mut hash = i as u32;
    hash = (hash ^ hash >> 16).wrapping_mul(0x7feb_352d);
    hash = (hash ^ hash >> 15).wrapping_mul(0x846c_a68b);
    if (hash ^ hash >> 16) & 1 == 0 { 1.0 } else { -1.0 }
}
