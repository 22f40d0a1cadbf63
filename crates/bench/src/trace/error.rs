//! Error of a filtered image against two independent references: the product of the differences
//! has the mean square error as its mean, since the errors of the references cancel. Light is
//! scaled to a mean of 0.3 and to 255 steps; nothing is clamped.

use esker_trace::Image;
use serde::Serialize;

/// Mean of the scaled reference, of 1.
pub(super) const MEAN: f64 = 0.3;
/// Steps of the scale, as those of a picture of 8 bits.
const STEPS: f64 = 255.0;
/// Share of the pixels within [`Error::p999`].
const SHARE: f64 = 0.999;

/// Two independent references of one scene, and where they show surfaces.
pub(super) struct Reference {
    /// Incident indirect light.
    pub halves: [Image<3>; 2],
    /// The lit picture.
    pub lit: Image<3>,
    /// Pixels that show a surface.
    pub is_hit: Vec<bool>,
}

/// Error of an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Error {
    /// Mean square error, without bias by the noise of the references. It can be slightly negative
    /// for an image that is as good as they are.
    pub mse: f64,
    /// Error that 99.9 % of the pixels do not exceed, in their worst channel.
    pub p999: f64,
    /// Greatest error of a pixel.
    pub worst: f64,
    /// Mean of the image over that of the reference.
    pub mean_ratio: f64,
}

impl Reference {
    /// Mean of both halves at a value of a plane.
    fn middle(&self, channel: usize, i: usize) -> f64 {
        let [a, b] = &self.halves;
        0.5 * (f64::from(a.planes[channel][i]) + f64::from(b.planes[channel][i]))
    }

    fn pixels(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.is_hit.len()).filter(|&i| self.is_hit[i])
    }

    /// Mean over all channels of the pixels that show a surface; 0 if there are none.
    fn mean(&self) -> f64 {
        let count = self.pixels().count() as f64 * 3.0;
        let values = self.pixels().flat_map(|i| (0..3).map(move |c| (c, i)));
        values.map(|(c, i)| self.middle(c, i)).sum::<f64>() / count.max(1.0)
    }

    /// Factor that scales light to a mean of [`MEAN`].
    pub fn scale(&self) -> f64 {
        let mean = self.mean();
        if mean > 0.0 { MEAN / mean } else { 1.0 }
    }

    /// Mean of both halves.
    pub fn image(&self) -> Image<3> {
        let [a, _] = &self.halves;
        let mut image = Image::new(a.width, a.height);
        for (c, plane) in image.planes.iter_mut().enumerate() {
            for (i, value) in plane.iter_mut().enumerate() {
                *value = self.middle(c, i) as f32;
            }
        }
        image
    }

    /// Error of an image of the same size.
    pub fn error(&self, image: &Image<3>) -> Error {
        let [a, b] = &self.halves;
        let scale = self.scale() * STEPS;
        let (mut products, mut sum, mut count) = (0.0, 0.0, 0u64);
        let mut errors: Vec<f64> = Vec::with_capacity(self.is_hit.len());
        for i in self.pixels() {
            let mut worst = 0.0f64;
            for c in 0..3 {
                let value = f64::from(image.planes[c][i]);
                let off = |half: &Image<3>| (value - f64::from(half.planes[c][i])) * scale;
                products += off(a) * off(b);
                worst = worst.max((value - self.middle(c, i)).abs() * scale);
                sum += value;
                count += 1;
            }
            errors.push(worst);
        }
        errors.sort_by(f64::total_cmp);
        let at = (errors.len() as f64 * SHARE).ceil() as usize;
        let total = self.mean() * count as f64;
        Error {
            mse: products / (count as f64).max(1.0),
            p999: errors.get(at.saturating_sub(1)).copied().unwrap_or(0.0),
            worst: errors.last().copied().unwrap_or(0.0),
            mean_ratio: if total > 0.0 { sum / total } else { 1.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(values: impl Fn(usize) -> f32) -> Image<3> {
        let mut image = Image::new(40, 25);
        for plane in &mut image.planes {
            plane.iter_mut().enumerate().for_each(|(i, v)| *v = values(i));
        }
        image
    }

    /// References whose own error is 0.1 with alternating signs that do not correlate.
    fn reference() -> Reference {
        let sign = |bit: usize, i: usize| if i >> bit & 1 == 0 { 0.1 } else { -0.1 };
        Reference {
            halves: [image(|i| 0.3 + sign(0, i)), image(|i| 0.3 + sign(1, i))],
            lit: Image::new(40, 25),
            is_hit: vec![true; 1000],
        }
    }

    #[test]
    fn the_error_of_the_references_cancels() {
        let reference = reference();
        assert!((reference.scale() - 1.0).abs() < 1e-6);
        let exact = reference.error(&image(|_| 0.3));
        assert!(exact.mse.abs() < 1e-3, "{exact:?}");
        let off = reference.error(&image(|_| 0.3 + 2.0 / 255.0));
        assert!((off.mse - 4.0).abs() < 0.05, "{off:?}");
        assert!((off.mean_ratio - (1.0 + 2.0 / 76.5)).abs() < 1e-6);
    }

    #[test]
    fn one_pixel_of_a_thousand_is_the_worst_and_not_in_the_share() {
        let flat = Reference { halves: [image(|_| 0.3), image(|_| 0.3)], ..reference() };
        let error = flat.error(&image(|i| if i == 77 { 1.3 } else { 0.3 }));
        assert!((error.worst - 255.0).abs() < 1e-3 && error.p999 < 1e-3, "{error:?}");
        assert!((error.mse - 65.025).abs() < 1e-2, "{error:?}");
        let hidden = Reference { is_hit: (0..1000).map(|i| i != 77).collect(), ..flat };
        assert!(hidden.error(&image(|i| if i == 77 { 1.3 } else { 0.3 })).worst < 1e-3);
    }

    #[test]
    fn a_picture_of_nothing_has_no_error() {
        let nothing = Reference { is_hit: vec![false; 1000], ..reference() };
        let error = nothing.error(&image(|_| 7.0));
        assert_eq!((error.mse, error.p999, error.worst, error.mean_ratio), (0.0, 0.0, 0.0, 1.0));
    }
}
