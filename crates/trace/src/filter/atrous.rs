//! Edge-avoiding a-trous wavelets (`dammertz2010`): passes of five by five taps, whose distance
//! doubles from pass to pass. The weight of colour halves from pass to pass, as the noise falls.

use super::bilateral::Scaled;
use super::input::Input;
use super::taps::Tap;
use super::{GuideKind, Settings};

/// Taps of a cubic B-spline.
const SPLINE: [f32; 5] = [1.0 / 16.0, 1.0 / 4.0, 3.0 / 8.0, 1.0 / 4.0, 1.0 / 16.0];
/// Most passes: the taps of the next one would be half a thousand pixels apart.
const ITERATIONS_MAX: usize = 8;

/// Filters a picture.
pub(crate) fn atrous(input: &Input<'_>, kinds: &[GuideKind], settings: &Settings) -> Vec<Vec<f32>> {
    let iterations = settings.iterations.min(ITERATIONS_MAX);
    let guides = Scaled::new(input, kinds, 1 << iterations, settings);
    let padded = |plane: &[f32], scale: f32| guides.padded.plane(plane, scale);
    let mut planes: Vec<Vec<f32>> =
        input.signals.iter().take(3).map(|plane| padded(plane, 1.0)).collect();
    let count = input.mask.iter().map(|&mask| f64::from(mask)).sum::<f64>().max(1.0);
    let sum: f64 =
        input.signals.iter().take(3).flat_map(|plane| plane.iter()).map(|&v| f64::from(v)).sum();
    let mean = (sum / count / 3.0) as f32;
    for pass in 0..iterations {
        let step = 1_isize << pass;
        let tap = |i: usize| Tap {
            x: (i % 5) as isize * step - 2 * step,
            y: (i / 5) as isize * step - 2 * step,
            weight: SPLINE[i % 5] * SPLINE[i / 5],
        };
        let taps: Vec<Tap> = (0..25).map(tap).collect();
        let sigma = settings.sigma_colour * mean / step as f32;
        let mut colours = Vec::new();
        if sigma.is_finite() {
            let scale = std::f32::consts::FRAC_1_SQRT_2 / sigma.max(f32::MIN_POSITIVE);
            let scaled = |plane: &Vec<f32>| plane.iter().map(|v| v * scale).collect();
            colours.extend(planes.iter().map(scaled));
        }
        let signals = [&planes[0][..], &planes[1], &planes[2]];
        planes = guides.neighbours::<3, false>(signals, &colours).means(&taps).into();
    }
    planes.iter().map(|plane| guides.padded.inner(plane)).collect()
}
