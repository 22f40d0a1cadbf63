//! What holds for every filter: no NaN whatever comes in, misses keep their value, edges of the
//! guides are kept, the mean is kept, noise falls, and threads do not matter.

mod filter_support;

use esker_trace::Image;
use esker_trace::filter::{
    FilterKind, GuideKind, Guides, Settings, Workspace, filter, filter_in, invalid_pixels,
    normal_noise_degrees,
};
use filter_support::{Lcg, ball, guides_of, mean_square, noisy_of, traced};
use glam::Vec3;

const KINDS: [FilterKind; 4] =
    [FilterKind::Guided, FilterKind::Nested, FilterKind::Bilateral, FilterKind::Atrous];

fn mean(image: &Image<3>, guides: &Guides) -> f64 {
    let hits = (0..guides.len()).filter(|&i| guides.is_hit[i]);
    let sum = |i: usize| image.planes.iter().map(|plane| f64::from(plane[i])).sum::<f64>();
    hits.clone().map(sum).sum::<f64>() / hits.count() as f64
}

#[test]
fn no_filter_makes_nan_of_anything() {
    let mut random = Lcg(1);
    for (width, height) in [(1, 1), (1, 9), (17, 1), (33, 29), (0, 0)] {
        for planes in [1, 3, 4, 5] {
            let mut guides = guides_of(width, height, planes, &mut random);
            let mut noisy = noisy_of(width, height, 1e30, &mut random);
            for i in (0..noisy.len()).step_by(5) {
                let bad = [f32::NAN, f32::INFINITY, -f32::INFINITY, 1e38, 1e18, -1e18];
                noisy.planes[i % 3][i] = bad[i / 5 % bad.len()];
                guides.planes[i % planes][(i * 7 + 2) % (width * height)] = bad[i % bad.len()];
            }
            for kind in KINDS {
                for radius in [0, 3, 1000] {
                    let radius = if kind == FilterKind::Bilateral { radius.min(3) } else { radius };
                    let settings = Settings { radius: Some(radius), ..Settings::of(kind) };
                    let filtered = filter(&noisy, &guides, 1, &settings);
                    assert!(filtered.planes.iter().flatten().all(|v| v.is_finite()), "{kind:?}");
                }
            }
        }
    }
}

#[test]
fn pixels_that_are_not_finite_count_as_misses() {
    let mut random = Lcg(2);
    let mut guides = guides_of(40, 30, 4, &mut random);
    let mut noisy = noisy_of(40, 30, 1.0, &mut random);
    guides.is_hit.fill(true);
    let mut missed = guides.clone();
    let bad = [3, 77, 600, 1199];
    for i in bad {
        noisy.planes[1][i] = f32::NAN;
        missed.is_hit[i] = false;
    }
    assert_eq!(invalid_pixels(&noisy, &guides), 4);
    assert_eq!(invalid_pixels(&noisy, &missed), 0);
    for kind in KINDS {
        let settings = Settings { radius: Some(6), cleans_guides: false, ..Settings::of(kind) };
        let filtered = filter(&noisy, &guides, 1, &settings);
        assert!(filtered == filter(&noisy, &missed, 1, &settings), "{kind:?}");
        assert_eq!(filtered.planes[1][77], 0.0);
        assert_eq!(filtered.planes[0][77], noisy.planes[0][77]);
    }
}

#[test]
fn nothing_passes_an_edge_of_the_guides() {
    let surfaces: Vec<_> =
        (0..64 * 48).map(|i| Some((if i % 64 < 32 { Vec3::X } else { Vec3::Z }, 1.0))).collect();
    let guides = Guides::of_surfaces(64, 48, &surfaces, 4.0);
    let mut noisy = Image::<3>::new(64, 48);
    for plane in &mut noisy.planes {
        plane.iter_mut().enumerate().for_each(|(i, v)| *v = if i % 64 < 32 { 1.0 } else { 0.0 });
    }
    for kind in KINDS {
        let filtered =
            filter(&noisy, &guides, 1, &Settings { radius: Some(8), ..Settings::of(kind) });
        for (value, expected) in filtered.planes[0].iter().zip(&noisy.planes[0]) {
            assert!((value - expected).abs() < 0.07, "{kind:?} {value} {expected}");
        }
    }
}

#[test]
fn slanted_planes_are_smoothed_like_facing_ones() {
    let guides = |right: f32, down: f32| {
        let depth = |i: usize| 1.0 + right * (i % 70) as f32 + down * (i / 70) as f32;
        let surfaces: Vec<_> = (0..70 * 60).map(|i| Some((Vec3::Z, depth(i)))).collect();
        Guides::of_surfaces(70, 60, &surfaces, 4.0)
    };
    let noisy = noisy_of(70, 60, 1.0, &mut Lcg(4));
    for kind in [FilterKind::Bilateral, FilterKind::Atrous] {
        let settings = Settings { radius: Some(9), ..Settings::of(kind) };
        let facing = filter(&noisy, &guides(0.0, 0.0), 1, &settings);
        let slanted = filter(&noisy, &guides(0.03, -0.05), 1, &settings);
        for (a, b) in facing.planes.iter().flatten().zip(slanted.planes.iter().flatten()) {
            assert!((a - b).abs() < 1e-3, "{kind:?} {a} {b}");
        }
    }
}

#[test]
fn cross_bilateral_filter_equals_a_sum_over_the_disc() {
    let (guides, light) = ball(48, 40);
    let mut guides = guides.only(&[GuideKind::Normal]);
    guides.is_hit.fill(true);
    let noisy = traced(&light, 16, true, &mut Lcg(14));
    let settings = Settings { radius: Some(6), ..Settings::of(FilterKind::Bilateral) };
    let filtered = filter(&noisy, &guides, 16, &settings);
    for i in 0..guides.len() {
        let (mut sum, mut total) = (0.0, 0.0);
        for j in 0..guides.len() {
            let [x, y] = [i % 48, i / 48].map(|c| c as f32);
            let [dx, dy] = [(j % 48) as f32 - x, (j / 48) as f32 - y];
            if dx * dx + dy * dy <= 36.0 {
                let change = |plane: &Vec<f32>| f64::from((plane[i] - plane[j]) / 0.1).powi(2);
                let change: f64 = guides.planes.iter().map(change).sum();
                // The filter takes this power for exp(-change / 2).
                let similar = (1.0 - change / 32.0).max(0.0).powi(16);
                let weight = similar * (-0.5 * f64::from(dx * dx + dy * dy) / 9.0).exp();
                sum += weight * f64::from(noisy.planes[0][j]);
                total += weight;
            }
        }
        let (value, expected) = (f64::from(filtered.planes[0][i]), sum / total);
        assert!((value - expected).abs() < 1e-4 * expected.max(0.1), "{value} {expected}");
    }
}

#[test]
fn light_that_no_guide_shows_is_kept_where_it_exceeds_the_noise() {
    // Squares of 10 pixels on a wall, as crowns of trees shade each other.
    let (width, height) = (200, 160);
    let surfaces = vec![Some((Vec3::Z, 1.0)); width * height];
    let guides = Guides::of_surfaces(width, height, &surfaces, 4.0);
    let mut light = Image::<3>::new(width, height);
    for plane in &mut light.planes {
        let square = |i: usize| if (i % width / 10) % 2 == i / width / 10 % 2 { 0.3 } else { 0.7 };
        plane.iter_mut().enumerate().for_each(|(i, v)| *v = square(i));
    }
    let variance = 0.04;
    let mut random = Lcg(21);
    // Noise and greatest error, as shares of the variance of the light. Windows of the guided
    // filter leave an error of one; in the last row noise hides the light.
    for (noise, most) in [(0.01, 0.4), (1.0, 0.45), (100.0, 1.1)] {
        let amplitude = (3.0_f64 * noise * variance).sqrt() as f32;
        let mut noisy = light.clone();
        for plane in &mut noisy.planes {
            plane.iter_mut().for_each(|v| *v += amplitude * (2.0 * random.next() as f32 - 1.0));
        }
        let filtered = filter(&noisy, &guides, 1, &Settings::of(FilterKind::Nested));
        let error = mean_square(&filtered, &light, &guides) / variance;
        println!("{noise} {error}");
        assert!(error < most, "{noise}: {error}");
    }
}

#[test]
fn fine_windows_let_no_firefly_through() {
    let (width, height) = (240, 200);
    let guides =
        Guides::of_surfaces(width, height, &vec![Some((Vec3::Z, 1.0)); width * height], 4.0);
    let mut noisy = Image::<3>::new(width, height);
    let mut random = Lcg(22);
    for plane in &mut noisy.planes {
        plane.fill(0.5);
    }
    // One somewhere in each square of 40 pixels, apart from the next.
    for square in 0..30 {
        let at = [square % 6, square / 6].map(|s| s * 40 + 8 + (random.next() * 24.0) as usize);
        noisy.planes.iter_mut().for_each(|plane| plane[at[1] * width + at[0]] = 1e4);
    }
    let worst = |settings: &Settings| {
        let filtered = filter(&noisy, &guides, 1, settings);
        filtered.planes[0].iter().fold(0.0_f32, |worst, v| worst.max(*v))
    };
    // The windows of radius 8 alone spread each over 289 pixels.
    let of = Settings::of(FilterKind::Guided);
    let alone = worst(&Settings { radius: Some(8), is_noise_scaled: true, ..of });
    let nested = worst(&Settings::of(FilterKind::Nested));
    println!("{nested} {alone}");
    assert!(nested < alone, "{nested}, windows of radius 8 alone {alone}");
}

#[test]
fn every_filter_removes_most_noise_and_keeps_the_mean() {
    let (guides, light) = ball(320, 240);
    for is_spread in [false, true] {
        let noisy = traced(&light, 1, is_spread, &mut Lcg(5));
        let before = mean_square(&noisy, &light, &guides);
        for kind in KINDS {
            let radius = (kind == FilterKind::Bilateral).then_some(16);
            let filtered = filter(&noisy, &guides, 1, &Settings { radius, ..Settings::of(kind) });
            let after = mean_square(&filtered, &light, &guides);
            let ratio = mean(&filtered, &guides) / mean(&noisy, &guides);
            println!("{kind:?} {is_spread} {before:.3} {after:.5} {ratio:.5}");
            assert!(after < before / 50.0, "{kind:?} {before} {after}");
            assert!((ratio - 1.0).abs() < 0.003, "{kind:?} {ratio}");
        }
    }
}

#[test]
fn guided_filters_keep_the_mean_within_a_thousandth() {
    let (guides, light) = ball(512, 384);
    let noisy = traced(&light, 4, true, &mut Lcg(9));
    for kind in [FilterKind::Guided, FilterKind::Nested] {
        let filtered = filter(&noisy, &guides, 4, &Settings::of(kind));
        let ratio = mean(&filtered, &guides) / mean(&noisy, &guides);
        assert!((ratio - 1.0).abs() < 1e-3, "{kind:?} {ratio}");
    }
}

#[test]
fn noise_scaled_epsilon_leaves_light_without_noise_as_it_is() {
    let (guides, _) = ball(96, 72);
    let mut light = Image::<3>::new(96, 72);
    for (c, plane) in light.planes.iter_mut().enumerate() {
        plane.iter_mut().enumerate().for_each(|(i, v)| *v = 1.0 + guides.planes[c][i]);
    }
    let settings = |is_noise_scaled| Settings {
        radius: Some(8),
        is_noise_scaled,
        ..Settings::of(FilterKind::Guided)
    };
    let error = |settings: &Settings| {
        mean_square(&filter(&light, &guides, 1, settings), &light, &guides).sqrt()
    };
    assert!(error(&settings(true)) < 0.2 * error(&settings(false)));
}

#[test]
fn a_workspace_changes_nothing() {
    let (guides, light) = ball(90, 70);
    let noisy = traced(&light, 1, true, &mut Lcg(12));
    let mut workspace = Workspace::default();
    for kind in [FilterKind::Nested, FilterKind::Guided] {
        let settings = Settings::of(kind);
        let fresh = filter(&noisy, &guides, 1, &settings);
        assert!(filter_in(&mut workspace, &noisy, &guides, 1, &settings) == fresh);
        assert!(workspace.bytes() > 0);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let (guides, light) = ball(150, 270);
    let noisy = traced(&light, 1, false, &mut Lcg(6));
    let of = |threads: usize, settings: &Settings| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| filter(&noisy, &guides, 1, settings))
    };
    for kind in KINDS {
        let settings = Settings { radius: Some(7), ..Settings::of(kind) };
        assert!(of(1, &settings) == of(3, &settings), "{kind:?}");
    }
}

#[test]
fn noise_of_normals_is_estimated_and_removed() {
    let (guides, _) = ball(320, 240);
    assert!(normal_noise_degrees(&guides) < 1.0);
    for degrees in [5.0_f64, 10.0, 20.0] {
        let mut random = Lcg(8);
        let mut noisy = guides.clone();
        // Two directions across the normal share the variance; guides are half of normals.
        let sigma = 0.5 * degrees.to_radians() / 2.0_f64.sqrt();
        for i in 0..guides.len() {
            let normal = Vec3::from([0, 1, 2].map(|k| guides.planes[k][i] * 2.0 - 1.0));
            let (a, b) = normal.any_orthonormal_pair();
            let mut gauss = || (0..12).map(|_| random.next()).sum::<f64>() - 6.0;
            let change = (a * gauss() as f32 + b * gauss() as f32) * sigma as f32;
            for k in 0..3 {
                noisy.planes[k][i] += change[k];
            }
        }
        let estimate = normal_noise_degrees(&noisy);
        assert!((estimate / degrees - 1.0).abs() < 0.15, "{estimate} {degrees}");
    }
}

#[test]
fn windows_shrink_with_samples() {
    let radius = |samples| Settings::of(FilterKind::Guided).radius(samples);
    assert_eq!([1, 4, 16, 1000].map(radius), [32, 28, 24, 24]);
    assert_eq!(radius(0), 32);
}
