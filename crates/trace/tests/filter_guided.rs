//! The guided filter equals a regression in each window that is computed by brute force in 64 bits
//! (`bauszat2011`, equations 6 to 9), for all numbers of guides, sizes and values.

mod filter_support;

use esker_trace::Image;
use esker_trace::filter::{FilterKind, Guides, Settings, filter};
use filter_support::{Lcg, guides_of, noisy_of, reference};
use proptest::prelude::*;

/// Greatest error of a filtered image, relative to the mean magnitude around.
fn error(noisy: &Image<3>, guides: &Guides, settings: &Settings) -> f64 {
    let filtered = filter(noisy, guides, 1, settings);
    let expected = reference(noisy, guides, settings.radius(1), settings);
    let [.., magnitude] = &expected;
    let mut worst = 0.0_f64;
    for (plane, expected) in filtered.planes.iter().zip(&expected) {
        for i in 0..plane.len() {
            let difference = (f64::from(plane[i]) - expected[i]).abs();
            worst = worst.max(difference / magnitude[i].max(1e-3));
            assert!(worst.is_finite());
        }
    }
    worst
}

fn guided(radius: usize, epsilon: f32) -> Settings {
    Settings {
        radius: Some(radius),
        epsilon_normal: epsilon,
        epsilon_depth: epsilon,
        ..Settings::of(FilterKind::Guided)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn filter_equals_brute_force(
        width in 1_usize..40,
        height in 1_usize..40,
        radius in 0_usize..50,
        planes in prop::sample::select(vec![1_usize, 3, 4, 5]),
        epsilon in prop::sample::select(vec![1e-2_f32, 1e-4]),
        seed in 0_u64..1000,
    ) {
        let mut random = Lcg(seed);
        let guides = guides_of(width, height, planes, &mut random);
        let noisy = noisy_of(width, height, 1e6, &mut random);
        prop_assert!(error(&noisy, &guides, &guided(radius, epsilon)) < 1e-5);
    }

    #[test]
    fn filter_with_tiny_epsilon_equals_brute_force(
        width in 1_usize..40,
        height in 1_usize..40,
        radius in 0_usize..20,
        planes in prop::sample::select(vec![1_usize, 3, 4, 5]),
        epsilon in prop::sample::select(vec![1e-6_f32, 1e-8]),
        seed in 0_u64..1000,
    ) {
        let mut random = Lcg(seed);
        let guides = guides_of(width, height, planes, &mut random);
        let noisy = noisy_of(width, height, 1e6, &mut random);
        // Coefficients are summed in 32 bits. A slope is at most the deviation of the signal over
        // twice the root of epsilon, so that is what its rounding grows with. There is a slope for
        // each plane, and an offset as large as their sum.
        let rounding = 2.0 * planes as f64 * 2f64.powi(-24) / f64::from(epsilon).sqrt();
        prop_assert!(error(&noisy, &guides, &guided(radius, epsilon)) < rounding);
    }
}

#[test]
fn guides_that_depend_on_each_other_equal_brute_force() {
    let mut random = Lcg(11);
    let mut guides = guides_of(64, 48, 4, &mut random);
    let first = guides.planes[0].clone();
    for (plane, scale) in guides.planes.iter_mut().skip(1).zip([0.5, -0.3, 0.9]) {
        plane.iter_mut().zip(&first).for_each(|(to, from)| *to = scale * from);
    }
    let noisy = noisy_of(64, 48, 1e6, &mut random);
    for (epsilon, limit) in [(1e-2, 1e-5), (1e-4, 1e-5), (1e-6, 1e-4), (1e-8, 1e-4)] {
        for radius in [3, 12] {
            let error = error(&noisy, &guides, &guided(radius, epsilon));
            println!("epsilon {epsilon}, radius {radius}: {error:.2e}");
            assert!(error < limit, "epsilon {epsilon}, radius {radius}: {error:.2e}");
        }
    }
}

#[test]
fn sums_over_many_bands_equal_brute_force() {
    let mut random = Lcg(7);
    let guides = guides_of(61, 333, 4, &mut random);
    let noisy = noisy_of(61, 333, 1e6, &mut random);
    for epsilon in [1e-2, 1e-4] {
        let error = error(&noisy, &guides, &guided(8, epsilon));
        println!("epsilon {epsilon}: {error:.2e}");
        assert!(error < 1e-5);
    }
}

#[test]
fn constant_guides_give_the_mean_of_means() {
    let mut random = Lcg(3);
    let mut guides = guides_of(33, 21, 4, &mut random);
    for plane in &mut guides.planes {
        plane.fill(0.7);
    }
    let noisy = noisy_of(33, 21, 1.0, &mut random);
    assert!(error(&noisy, &guides, &guided(5, 1e-8)) < 1e-6);
}
