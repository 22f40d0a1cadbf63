//! How error falls with samples, and what the filter and its mix do to it.

use crate::scenes::{cornell, cornell_camera, mean, picture, quad, square_error, unfiltered};
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::{Image, Light, Lights, Options, Scene, Sequence, Tracer};
use glam::{DVec3, Vec3};

const SIDE: u32 = 24;

/// Incident indirect light of the box.
fn incident(samples: u32, options: Options) -> Image<3> {
    let mut tracer = Tracer::new(options);
    let lights = Lights::default().prepare(DVec3::ZERO);
    tracer.trace(&cornell(), 0, &lights, &cornell_camera(SIDE), samples, &|| false);
    tracer.incident()
}

/// Slope of the root mean square error against samples on a log plot, 1 to 64 samples.
fn slope(sequence: Sequence) -> f64 {
    let truth = incident(2048, Options { seed: 99, ..unfiltered(1) });
    let error = |samples| {
        let of = |seed| incident(samples, Options { sequence, seed, ..unfiltered(1) });
        (0..4).map(|seed| square_error(&of(seed), &truth)).sum::<f64>().sqrt()
    };
    let points = [1u32, 4, 16, 64].map(|n| (f64::from(n).ln(), error(n).ln()));
    let centre = points.iter().map(|p| p.0).sum::<f64>() / 4.0;
    let mean = points.iter().map(|p| p.1).sum::<f64>() / 4.0;
    let over: f64 = points.iter().map(|p| (p.0 - centre) * (p.1 - mean)).sum();
    over / points.iter().map(|p| (p.0 - centre).powi(2)).sum::<f64>()
}

#[test]
fn error_falls_with_the_root_of_independent_samples_and_faster_along_the_z_order() {
    let independent = slope(Sequence::Independent);
    assert!((independent + 0.5).abs() < 0.03, "{independent}");
    let z_order = slope(Sequence::ZOrder);
    assert!(z_order < -0.55, "{z_order}");
}

/// Mean over blocks of 4 x 4 pixels.
fn blocks(image: &Image<3>) -> Image<3> {
    let mut out = Image::new(image.width / 4, image.height / 4);
    for y in 0..image.height {
        for x in 0..image.width {
            let i = y / 4 * out.width + x / 4;
            for (plane, value) in out.planes.iter_mut().zip(image.at(x, y)) {
                plane[i] += value / 16.0;
            }
        }
    }
    out
}

#[test]
fn along_the_z_order_errors_of_neighbours_cancel() {
    let truth = blocks(&incident(2048, Options { seed: 99, ..unfiltered(1) }));
    let error = |sequence| {
        let of = |seed| blocks(&incident(1, Options { sequence, seed, ..unfiltered(1) }));
        (0..8).map(|seed| square_error(&of(seed), &truth)).sum::<f64>()
    };
    let ratio = error(Sequence::ZOrder) / error(Sequence::Independent);
    assert!(ratio < 0.75, "{ratio}");
}

#[test]
fn calls_of_one_sample_converge_as_one_call_does() {
    let truth = incident(2048, Options { seed: 99, ..unfiltered(1) });
    let (scene, view) = (cornell(), cornell_camera(SIDE));
    let lights = Lights::default().prepare(DVec3::ZERO);
    let mut tracer = Tracer::new(unfiltered(1));
    for _ in 0..64 {
        tracer.trace(&scene, 0, &lights, &view, 1, &|| false);
    }
    let apart = square_error(&tracer.incident(), &truth);
    let together = square_error(&incident(64, unfiltered(1)), &truth);
    let independent = Options { sequence: Sequence::Independent, ..unfiltered(1) };
    let independent = square_error(&incident(64, independent), &truth);
    assert!(apart < 4.0 * together && apart < 0.7 * independent, "{apart} {together}");
}

#[test]
fn the_filter_keeps_the_mean_and_lowers_the_error() {
    let (scene, view, lights) = (cornell(), cornell_camera(64), Lights::default());
    let truth = picture(&scene, &lights, &view, 256, unfiltered(1));
    let raw = picture(&scene, &lights, &view, 1, unfiltered(1));
    let filtered = Options { filter: Settings::default(), ..unfiltered(1) };
    let filtered = picture(&scene, &lights, &view, 1, filtered);
    let before = square_error(&raw.indirect, &truth.indirect);
    let after = square_error(&filtered.indirect, &truth.indirect);
    assert!(after < 0.1 * before, "{after} {before}");
    assert_eq!(raw.direct, filtered.direct, "direct light is not filtered");
    for (raw, filtered) in mean(&raw.indirect).into_iter().zip(mean(&filtered.indirect)) {
        assert!((filtered / raw - 1.0).abs() < 0.05, "{filtered} {raw}");
    }
}

#[test]
fn mixed_pictures_converge_to_the_light_and_filtered_ones_stop_at_their_bias() {
    let (scene, view, lights) = (cornell(), cornell_camera(64), Lights::default());
    let truth = picture(&scene, &lights, &view, 512, Options { seed: 99, ..unfiltered(1) });
    let error = |samples, converges, kind| {
        let options = Options { converges, filter: Settings::of(kind), ..unfiltered(1) };
        let lit = picture(&scene, &lights, &view, samples, options);
        square_error(&lit.indirect, &truth.indirect)
    };
    let [few, many] = [2, 128].map(|n| error(n, true, FilterKind::Guided));
    let stuck = error(128, false, FilterKind::Guided);
    let raw = error(128, true, FilterKind::None);
    assert!(many < 0.3 * few.min(stuck) && many < 3.0 * raw, "{many} {stuck} {raw}");
    let unmixed = error(2, false, FilterKind::Guided);
    assert!(few < 1.1 * unmixed, "{few} {unmixed}");
}

#[test]
fn filtered_visibility_has_less_noise_and_the_same_mean() {
    let middle = quad(Vec3::new(0.4, 0.4, 0.3), Vec3::X * 0.3, Vec3::Y * 0.3, Vec3::ONE, 0.0);
    let floor = quad(Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE, 0.0);
    let scene = Scene::default().with_objects(vec![middle, floor]);
    let view = cornell_camera(96);
    let area = Light::Area {
        corner: [0.0, 0.0, 1.5],
        edges: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]],
        radiance: [4.0; 3],
        two_sided: true,
    };
    let lights = Lights::from(vec![area]);
    let noisy = Options { shadow_samples: 1, ..unfiltered(0) };
    let truth = picture(&scene, &lights, &view, 256, noisy.clone());
    let raw = picture(&scene, &lights, &view, 1, noisy.clone());
    let filters = Options { filters_visibility: true, filter: Settings::default(), ..noisy };
    let filtered = picture(&scene, &lights, &view, 1, filters);
    let before = square_error(&raw.direct, &truth.direct);
    let after = square_error(&filtered.direct, &truth.direct);
    assert!(after < before, "{after} {before}");
    for (truth, filtered) in mean(&truth.direct).into_iter().zip(mean(&filtered.direct)) {
        assert!((filtered / truth - 1.0).abs() < 0.05, "{filtered} {truth}");
    }
}
