//! Filters of indirect light where inputs get difficult: bright pixels, noisy normals, a small
//! epsilon. In: a value of an axis. Out: how far filtered light is off.

use crate::stability::light::pictures::{ball, dependent, guides, tilted, traced};
use crate::stability::light::regression;
use esker_trace::Image;
use esker_trace::filter::{FilterKind, GuideKind, Guides, Settings, filter};
use esker_truth::dice::Dice;

/// Seed of all noise.
const SEED: u64 = 11;
/// Size of pictures with bright pixels.
const RANGE_SIZE: [usize; 2] = [256, 64];
/// Columns of bright pixels whose light must not spill, and columns that no window of one reaches:
/// the nested filter looks twice as far as 24, 8 and 4 pixels, one after the other.
const BRIGHT: usize = 32;
const BEYOND: usize = BRIGHT + 2 * (24 + 8 + 4) + 32;
/// Bright pixels are one in so many.
const BRIGHT_EACH: u64 = 200;
/// Samples of pictures with bright pixels.
const SAMPLES: u32 = 4;
/// Size of the picture with noisy normals, and the pictures of which the error is taken. At so many
/// samples, what guides lose is not hidden by noise of the light.
const NOISE_SIZE: [usize; 2] = [128, 96];
const NOISE_SAMPLES: u32 = 64;
const PICTURES: u64 = 4;
/// Size of the picture, and radius of the windows, that are filtered in 64 bits.
const EPSILON_SIZE: [usize; 2] = [48, 40];
const EPSILON_RADIUS: usize = 8;
/// Light of its bright pixels over that of others.
const EPSILON_RANGE: f64 = 1e6;

/// Energy that the nested filter adds or takes where some pixels are brighter by this factor, and
/// the greatest change that they make beyond their reach.
pub fn range(range: f64) -> Vec<f64> {
    let [width, height] = RANGE_SIZE;
    let (seen, light) = ball(width, height);
    let guides = guides(width, height, &seen);
    let mut dice = Dice(SEED);
    let plain = traced(&light, SAMPLES, &mut dice);
    let settings = Settings::default();
    let all = with_bright(&plain, range, width, &mut dice);
    let kept = sum(&filter(&all, &guides, SAMPLES, &settings)) / sum(&all);
    let bright = with_bright(&plain, range, BRIGHT, &mut dice);
    let filtered = filter(&bright, &guides, SAMPLES, &settings);
    let wanted = filter(&plain, &guides, SAMPLES, &settings);
    let spill = (0..plain.len()).filter(|i| i % width >= BEYOND).map(|i| {
        let off = f64::from(filtered.planes[1][i]) / f64::from(wanted.planes[1][i]) - 1.0;
        if off.is_nan() { f64::INFINITY } else { off.abs() }
    });
    vec![(kept - 1.0).abs(), spill.fold(0.0, f64::max)]
}

/// Error of light that is filtered with normals which are off by an angle of this standard
/// deviation, over that without normals as guides.
pub fn guide_noise(deviation_deg: f64) -> Vec<f64> {
    let [width, height] = NOISE_SIZE;
    let (seen, light) = ball(width, height);
    let without = guides(width, height, &seen).only(&[GuideKind::Depth]);
    let (mut with_normals, mut with_none) = (0.0, 0.0);
    for picture in 0..PICTURES {
        let mut dice = Dice(SEED + picture);
        let noisy = traced(&light, NOISE_SAMPLES, &mut dice);
        let leaning = guides(width, height, &tilted(&seen, deviation_deg, &mut dice));
        let error = |guides: &Guides| {
            square_error(&filter(&noisy, guides, NOISE_SAMPLES, &Settings::default()), &light)
        };
        with_normals += error(&leaning);
        with_none += error(&without);
    }
    vec![(with_normals / with_none).sqrt()]
}

/// Greatest difference of the guided filter with this epsilon from a regression in 64 bits, over
/// the mean light around, with guides that are independent and that depend on each other.
pub fn epsilon(epsilon: f64) -> Vec<f64> {
    let [width, height] = EPSILON_SIZE;
    let (seen, light) = ball(width, height);
    let mut dice = Dice(SEED);
    let noisy = traced(&light, SAMPLES, &mut dice);
    let noisy = with_bright(&noisy, EPSILON_RANGE, width, &mut dice);
    let settings = Settings {
        radius: Some(EPSILON_RADIUS),
        epsilon_normal: epsilon as f32,
        epsilon_depth: epsilon as f32,
        ..Settings::of(FilterKind::Guided)
    };
    let independent = guides(width, height, &seen);
    let off = |guides: &Guides| {
        let got = filter(&noisy, guides, SAMPLES, &settings);
        let wanted =
            regression::guided(&noisy, guides, EPSILON_RADIUS, f64::from(settings.epsilon_normal));
        let planes = got.planes.iter().zip(&wanted.planes);
        let off = planes.flat_map(|(got, plane)| {
            let pairs = got.iter().zip(plane).zip(&wanted.light);
            pairs.map(|((got, wanted), light)| (f64::from(*got) - wanted).abs() / light)
        });
        off.fold(0.0, |most: f64, off| if off.is_nan() { f64::INFINITY } else { most.max(off) })
    };
    vec![off(&independent).max(off(&dependent(&independent)))]
}

/// A picture with bright pixels of this light in its first columns.
fn with_bright(picture: &Image<3>, light: f64, columns: usize, dice: &mut Dice) -> Image<3> {
    let mut bright = picture.clone();
    for i in (0..picture.len()).filter(|i| i % picture.width < columns) {
        if dice.bits().is_multiple_of(BRIGHT_EACH) {
            bright.planes.iter_mut().for_each(|plane| plane[i] = light as f32);
        }
    }
    bright
}

/// Sum of a channel.
fn sum(image: &Image<3>) -> f64 {
    image.planes[1].iter().map(|light| f64::from(*light)).sum()
}

/// Mean square of the difference.
fn square_error(image: &Image<3>, light: &Image<3>) -> f64 {
    let pairs = image.planes.iter().flatten().zip(light.planes.iter().flatten());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / (3 * image.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn easy_conditions_are_filtered_right() {
        let [energy, spill] = range(1.0)[..] else { panic!("two measures") };
        assert!(energy < 0.02 && spill < 1e-3, "{energy} {spill}");
        assert!(guide_noise(0.0)[0] < 0.9);
        assert!(epsilon(1e-2)[0] < 1e-5);
    }

    #[test]
    fn noise_of_normals_makes_errors_larger() {
        let [exact, off] = [0.0, 60.0].map(|deviation_deg| guide_noise(deviation_deg)[0]);
        assert!(off > 1.1 * exact, "{off} {exact}");
    }
}
