//! Noise of normals, as raw scans have it: an estimate of how far normals are off, and a filter of
//! the guides that runs before they guide. It pays from 5 degrees on; below, it costs detail.

use super::bilateral::bilateral;
use super::input::Input;
use super::{GuideKind, Settings};
use std::borrow::Cow;

/// Noise from which normals are filtered: 5 degrees, in the unit of the guides, which is half that
/// of normals.
pub(crate) const NOISE_MIN: f64 = 0.5 * 5.0 * std::f64::consts::PI / 180.0;
/// Radius of the filter of normals, pixels.
pub(crate) const RADIUS: usize = 6;
/// Distance of the pixels whose normals are compared. Noise of scans is nearly equal within a splat
/// of some pixels; relief is smooth over as many.
const LAG: usize = 3;
/// Pixels from one sample of the noise to the next, on both axes. Some ten thousand are enough for
/// a median.
const STRIDE: usize = 5;
/// Largest share of the variance of a normal that one component has: a normal moves in two
/// directions.
pub(crate) const COMPONENT_SHARE: f64 = 0.5;

/// Filters the normals of an input if they are noisy.
pub(crate) fn clean(input: &mut Input<'_>, kinds: &[GuideKind]) {
    let noise = normal_noise(input, kinds);
    let Some(own) = normals(kinds).filter(|_| noise >= NOISE_MIN) else { return };
    // Two normals of one surface differ by the noise times the root of two.
    let settings = Settings { sigma_normal: 2.0 * noise as f32, ..Settings::default() };
    let signals = own.map(|k| &*input.guides[k]);
    let means = bilateral::<3, false>(input, signals, kinds, RADIUS, &settings);
    for (k, mean) in own.into_iter().zip(means) {
        input.guides[k] = Cow::Owned(mean);
    }
}

/// The three planes of normals.
fn normals(kinds: &[GuideKind]) -> Option<[usize; 3]> {
    let is_normal = |k: &usize| kinds[*k] == GuideKind::Normal;
    (0..kinds.len()).filter(is_normal).collect::<Vec<_>>().try_into().ok()
}

/// Standard deviation of normals from those of a smooth surface, in the unit of the guides: from
/// the median of second differences, which neither edges nor curvature reach (Immerkaer 1996).
pub(crate) fn normal_noise(input: &Input<'_>, kinds: &[GuideKind]) -> f64 {
    let Some(own) = normals(kinds) else { return 0.0 };
    let (width, height) = (input.width, input.height);
    let mut squares = Vec::new();
    let second = |i: usize, step: usize| -> Option<f64> {
        let pixels = [i - step, i, i + step];
        if pixels.iter().any(|&i| input.mask[i] == 0.0) {
            return None;
        }
        let at = |k: usize, j: usize| f64::from(input.guides[own[k]][pixels[j]]);
        Some((0..3).map(|k| (at(k, 0) - 2.0 * at(k, 1) + at(k, 2)).powi(2)).sum())
    };
    for y in (0..height).step_by(STRIDE) {
        for x in (0..width).step_by(STRIDE) {
            let i = y * width + x;
            if x >= LAG && x + LAG < width {
                squares.extend(second(i, LAG));
            }
            if y >= LAG && y + LAG < height {
                squares.extend(second(i, LAG * width));
            }
        }
    }
    if squares.is_empty() {
        return 0.0;
    }
    let middle = squares.len() / 2;
    let (_, &mut median, _) = squares.select_nth_unstable_by(middle, f64::total_cmp);
    // A second difference has six times the variance; the square of a vector with two normal
    // components has the median ln 2 of its mean.
    (median / (6.0 * std::f64::consts::LN_2)).sqrt()
}
