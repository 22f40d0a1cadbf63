//! Nested windows: the guided filter with noise-scaled epsilon at two radii. The small windows
//! follow the light more closely, the large ones have less noise. The difference of the two results
//! is light and noise; it counts by the share of light in its energy (James and Stein's estimator).
//! The share of noise is known from an image of white noise that goes through the same filters.

use super::boxes::Boxes;
use super::guided::{Ridges, Workspace, regress};
use super::input::Input;
use super::moments::LUMINANCE;
use rayon::prelude::*;

/// Radii of the windows, pixels. Three and more radii from 3 pixels on have larger errors.
pub(crate) const RADII: [usize; 2] = [8, 24];
/// Radius of the windows in which the energy of the difference is measured, pixels. Smaller windows
/// hold too few independent values of the filtered noise to tell light from it.
pub(crate) const ENERGY_RADIUS: usize = 16;
/// Times that the expected energy of the noise is subtracted, since its energy in a window is known
/// to a fifth or so.
pub(crate) const CAUTION: f64 = 1.2;

/// Greatest change of the mean that is taken back. More is no bias of the shares: a picture of
/// almost no light, or of one firefly.
pub(crate) const MEAN_CHANGE_MAX: f64 = 0.02;

/// Filters a picture of three signals.
pub(crate) fn nested(
    input: &Input<'_>,
    ridges: &Ridges,
    workspace: &mut Workspace,
) -> Vec<Vec<f32>> {
    let white: Vec<f32> = input.mask.iter().enumerate().map(|(i, &mask)| mask * sign(i)).collect();
    let input = input.with_signal(&white);
    let [small, mut large] = RADII.map(|radius| regress(&input, radius, ridges, workspace));
    let boxes = |radius: usize| Boxes { width: input.width, mask: &input.mask, radius };
    let noise = boxes(RADII[1]).means(|i| {
        let value = f64::from(luminance(&input.signals, i));
        let white = f64::from(small[3][i] - large[3][i]);
        [value, value * value, white * white]
    });
    let energy = boxes(ENERGY_RADIUS).means(|i| {
        let light = f64::from(luminance(&small, i) - luminance(&large, i));
        [light * light]
    });
    let share = |([mean, square, white], _): ([f64; 3], f64), ([energy], _): ([f64; 1], f64)| {
        let noise = CAUTION * (square - mean * mean).max(0.0) * white;
        if energy > noise { (1.0 - noise / energy) as f32 } else { 0.0 }
    };
    let shares: Vec<f32> =
        noise.par_iter().zip(&energy).map(|(&noise, &energy)| share(noise, energy)).collect();
    for (large, small) in large.iter_mut().zip(&small) {
        large.par_iter_mut().zip(small).zip(&shares).for_each(|((large, small), share)| {
            *large += share * (small - *large);
        });
    }
    for (filtered, noisy) in large.iter_mut().zip(&input.signals).take(3) {
        keep_mean(&input, noisy, filtered);
    }
    large
}

/// Scales a filtered plane to the mean of the unfiltered one: the shares depend on the light, which
/// moves the mean by some thousandths.
fn keep_mean(input: &Input<'_>, noisy: &[f32], filtered: &mut [f32]) {
    // Row by row, so that the sum does not depend on the number of threads.
    let sum = |plane: &[f32]| -> f64 {
        let row = |(row, mask): (&[f32], &[f32])| -> f64 {
            row.iter().zip(mask).map(|(&v, &m)| f64::from(v) * f64::from(m)).sum()
        };
        let rows = plane.par_chunks(input.width).zip(input.mask.par_chunks(input.width));
        rows.map(row).collect::<Vec<f64>>().into_iter().sum()
    };
    let factor = sum(noisy) / sum(filtered);
    if (factor - 1.0).abs() < MEAN_CHANGE_MAX {
        filtered.par_iter_mut().for_each(|value| *value *= factor as f32);
    }
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
