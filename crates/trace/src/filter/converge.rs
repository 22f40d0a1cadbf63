//! Mixes the filtered picture with the unfiltered mean of the samples, so that the error falls with
//! the samples instead of staying at the bias of the filter. The samples are kept as the means of
//! two halves. Both differ from the filtered picture by its bias and by noise, which is independent
//! in the halves: the mean product of the two differences in a window estimates the square of the
//! bias, and half their difference the noise of the mean.

use super::boxes::Boxes;
use super::input::VALUE_MAX;
use crate::Image;
use rayon::prelude::*;

/// Radius of the windows in which bias and noise are measured, pixels.
pub(crate) const RADIUS: usize = 8;
/// Standard errors that are subtracted from the square of the bias: noise of a few bright samples
/// must not be taken for bias, since the unfiltered mean can have a thousand times the error.
pub(crate) const STANDARD_ERRORS: f64 = 3.0;

/// Means of the two halves of the samples of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Halves {
    /// Mean of every other sample.
    pub a: Image<3>,
    /// Mean of the others. Both halves have the same number of samples.
    pub b: Image<3>,
}

impl Halves {
    /// Mean of all samples.
    pub fn mean(&self) -> Image<3> {
        let mut mean = self.a.clone();
        for (mean, b) in mean.planes.iter_mut().zip(&self.b.planes) {
            mean.par_iter_mut().zip(b).for_each(|(mean, b)| *mean = 0.5 * (*mean + b));
        }
        mean
    }

    /// Mixes the filtered picture with the mean of the samples: `filtered + w (mean - filtered)`
    /// with `w = bias^2 / (bias^2 + noise)`. `is_hit` are the pixels that were filtered; the
    /// others, and pixels that are not finite, are taken from `filtered`.
    pub fn mix(&self, filtered: &Image<3>, is_hit: &[bool]) -> Image<3> {
        let mut mixed = filtered.clone();
        let is_valid = |i: usize| {
            let all = [&self.a, &self.b, filtered];
            all.iter().flat_map(|image| &image.planes).all(|plane| plane[i].abs() <= VALUE_MAX)
        };
        let mask: Vec<f32> = is_hit
            .par_iter()
            .enumerate()
            .map(|(i, &is_hit)| f32::from(u8::from(is_hit && is_valid(i))))
            .collect();
        let boxes = Boxes { width: filtered.width, mask: &mask, radius: RADIUS };
        let measures = boxes.means(|i| self.measures(filtered, i));
        for (c, plane) in mixed.planes.iter_mut().enumerate() {
            let (a, b) = (&self.a.planes[c], &self.b.planes[c]);
            plane.par_iter_mut().enumerate().filter(|(i, _)| mask[*i] != 0.0).for_each(
                |(i, value)| {
                    let mean = 0.5 * (a[i] + b[i]);
                    *value += weight(measures[i]) * (mean - *value);
                },
            );
        }
        mixed
    }

    /// Square of the bias, its own square, and square of the noise, from one pixel.
    fn measures(&self, filtered: &Image<3>, i: usize) -> [f64; 3] {
        let (mut bias, mut noise) = (0.0, 0.0);
        for c in 0..3 {
            let [a, b] = [&self.a, &self.b].map(|half| f64::from(half.planes[c][i]));
            let own = f64::from(filtered.planes[c][i]);
            bias += (a - own) * (b - own);
            noise += 0.25 * (a - b) * (a - b);
        }
        [bias, bias * bias, noise]
    }
}

/// Share of the unfiltered mean, from the measures of a window and its number of pixels.
fn weight(([bias, square, noise], count): ([f64; 3], f64)) -> f32 {
    let certain = bias - STANDARD_ERRORS * (square / count.max(1.0)).sqrt();
    if certain > 0.0 { (certain / (certain + noise)) as f32 } else { 0.0 }
}
