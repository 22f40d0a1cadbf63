//! The filtered picture goes over to the mean of the samples: the error falls with the samples
//! where that of the filter alone stays, and is hardly ever worse than the better of the two.

mod filter_support;

use esker_trace::Image;
use esker_trace::filter::{FilterKind, GuideKind, Halves, Settings, filter};
use filter_support::{Lcg, ball, mean_square, traced};

#[test]
fn error_falls_with_samples_below_the_bias_of_the_filter() {
    let (guides, light) = ball(160, 120);
    // Depth alone does not show which way a surface faces: a large bias.
    let guides = guides.only(&[GuideKind::Depth]);
    let settings = Settings {
        radius: Some(16),
        epsilon_normal: 0.03,
        epsilon_depth: 0.03,
        ..Settings::of(FilterKind::Guided)
    };
    let mut last = f64::INFINITY;
    for (step, samples) in [2_u32, 16, 128, 1024, 4096].into_iter().enumerate() {
        let mut random = Lcg(11 + u64::from(samples));
        let [a, b] = [(); 2].map(|()| traced(&light, samples / 2, true, &mut random));
        let halves = Halves { a, b };
        let mean = halves.mean();
        let filtered = filter(&mean, &guides, samples, &settings);
        let mixed = halves.mix(&filtered, &guides.is_hit);
        let error = |image: &Image<3>| mean_square(image, &light, &guides);
        let (raw, own, both) = (error(&mean), error(&filtered), error(&mixed));
        println!("{samples}: raw {raw:.6} filtered {own:.6} mixed {both:.6}");
        assert!(both <= 1.05 * raw.min(own), "{samples}: {both} {raw} {own}");
        assert!(both < last, "{samples}");
        if step > 3 {
            assert!(both < 0.5 * own, "{samples}");
        }
        last = both;
    }
}

#[test]
fn mixture_equals_the_mean_without_noise_and_the_filter_without_bias() {
    let (guides, light) = ball(64, 48);
    let mut shifted = light.clone();
    for value in shifted.planes.iter_mut().flatten() {
        *value += 0.5;
    }
    let exact = Halves { a: light.clone(), b: light.clone() };
    let mixed = exact.mix(&shifted, &guides.is_hit);
    for i in (0..light.len()).filter(|&i| guides.is_hit[i]) {
        assert!((mixed.planes[0][i] - light.planes[0][i]).abs() < 1e-6);
    }
    let mut random = Lcg(3);
    let [a, b] = [(); 2].map(|()| traced(&light, 1, false, &mut random));
    let mixed = Halves { a, b }.mix(&light, &guides.is_hit);
    assert!(mean_square(&mixed, &light, &guides) < 1e-6);
}

#[test]
fn values_that_are_not_finite_stay_filtered() {
    let (guides, light) = ball(32, 24);
    let mut a = light.clone();
    for (i, bad) in [(40, f32::NAN), (300, f32::INFINITY), (500, 1e38)] {
        a.planes[0][i] = bad;
    }
    let mixed = Halves { a, b: light.clone() }.mix(&light, &guides.is_hit);
    assert!(mixed.planes.iter().flatten().all(|value| value.is_finite()));
    assert_eq!(mixed.planes[0][300], light.planes[0][300]);
}
