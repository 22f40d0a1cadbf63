//! Nested windows: the guided filter with noise-scaled epsilon at two radii, then a cross-bilateral
//! filter of what they leave. Smaller windows follow the light more closely, larger ones have less
//! noise. What a smaller window adds is light and noise; it counts by the share of light in its
//! energy (James and Stein's estimator). The share of noise follows from the gain of the filter for
//! white noise: regressions filter an image of white noise beside the light, and the gain of the
//! cross-bilateral filter is computed from its weights.

use super::bilateral::bilateral;
use super::boxes::Boxes;
use super::guided::{Ridges, Workspace, regress};
use super::input::Input;
use super::moments::LUMINANCE;
use super::{GuideKind, Settings};
use rayon::prelude::*;

/// Radii of the windows of regressions, pixels. Smaller ones hold too few pixels for five
/// coefficients.
pub(crate) const RADII: [usize; 2] = [8, 24];
/// Radius of the cross-bilateral filter, pixels.
pub(crate) const FINE_RADIUS: usize = 4;
/// Radius of the windows in which the energy of an addition and its noise are measured, pixels: the
/// same for both, so that a firefly counts in both. Smaller windows hold too few independent values
/// of the filtered noise to tell light from it.
pub(crate) const ENERGY_RADIUS: usize = 16;
/// Times that the expected energy of the noise is subtracted: filtered white noise of a window
/// tells it to a fifth or so, and a firefly must not pass for light.
pub(crate) const CAUTION: f64 = 1.1;

/// Greatest change of the mean that is taken back. More is no bias of the shares: a picture of
/// almost no light, or of one firefly.
pub(crate) const MEAN_CHANGE_MAX: f64 = 0.02;

/// Filters a picture of three signals.
pub(crate) fn nested(
    input: &Input<'_>,
    kinds: &[GuideKind],
    ridges: &Ridges,
    settings: &Settings,
    workspace: &mut Workspace,
) -> Vec<Vec<f32>> {
    let white: Vec<f32> = input.mask.iter().enumerate().map(|(i, &mask)| mask * sign(i)).collect();
    let with_white = input.with_signal(&white);
    let [mut addition, mut filtered] =
        RADII.map(|radius| regress(&with_white, radius, ridges, workspace));
    for (addition, filtered) in addition.iter_mut().zip(&filtered) {
        addition.par_iter_mut().zip(filtered).for_each(|(small, large)| *small -= large);
    }
    add_light(input, &mut filtered, input.colours(), &addition);
    drop(addition);

    let residual: [Vec<f32>; 3] = std::array::from_fn(|c| {
        let values = input.signals[c].par_iter().zip(&filtered[c]).zip(&*input.mask);
        let off = |((noisy, filtered), &mask)| if mask != 0.0 { noisy - filtered } else { 0.0 };
        values.map(off).collect()
    });
    let [red, green, blue] = residual.each_ref().map(Vec::as_slice);
    let signals = [red, green, blue, &input.mask];
    let addition = bilateral::<4, true>(input, signals, kinds, FINE_RADIUS, settings);
    add_light(input, &mut filtered, [red, green, blue], &addition);

    for (filtered, noisy) in filtered.iter_mut().zip(&input.signals).take(3) {
        keep_mean(input, noisy, filtered);
    }
    filtered
}

/// Adds the share of an addition that is light and not noise. The addition was filtered from
/// `noisy`; its fourth plane is white noise that went through the same filter, or the gain.
fn add_light(
    input: &Input<'_>,
    filtered: &mut [Vec<f32>],
    noisy: [&[f32]; 3],
    addition: &[Vec<f32>],
) {
    let boxes = Boxes { width: input.width, mask: &input.mask, radius: ENERGY_RADIUS };
    let means = boxes.means(|i| {
        let value = f64::from(luminance(&noisy, i));
        let (white, light) = (f64::from(addition[3][i]), f64::from(luminance(addition, i)));
        [value, value * value, white * white, light * light]
    });
    let share = |&([mean, square, white, energy], _): &([f64; 4], f64)| {
        let noise = CAUTION * (square - mean * mean).max(0.0) * white;
        if energy > noise { (1.0 - noise / energy) as f32 } else { 0.0 }
    };
    let shares: Vec<f32> = means.par_iter().map(share).collect();
    for (filtered, addition) in filtered.iter_mut().zip(addition).take(3) {
        let values = filtered.par_iter_mut().zip(addition).zip(&shares);
        values.for_each(|((filtered, addition), share)| *filtered += share * addition);
    }
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
