//! Progress of a picture: threads, stops, changes of options, and moves of the camera.

use crate::scenes::{camera, cornell, cornell_camera, picture, square_error, unfiltered};
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::{Light, Lights, Options, PreparedLights, Sequence, Tracer};
use glam::DVec3;
use std::sync::atomic::{AtomicU32, Ordering};

fn no_lights() -> PreparedLights {
    Lights::default().prepare(DVec3::ZERO)
}

#[test]
fn the_picture_has_the_same_bits_for_any_number_of_threads() {
    let scene = cornell();
    let view = camera(DVec3::new(0.5, 0.05, 0.5), DVec3::new(0.4, 1.0, 0.4), 1.3, [70, 45]);
    for sequence in [Sequence::ZOrder, Sequence::Independent] {
        let render = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = Options { sequence, bounces: 2, ..Options::default() };
            pool.install(|| picture(&scene, &Lights::default(), &view, 3, options))
        };
        assert_eq!(render(1), render(2));
    }
}

#[test]
fn a_stopped_picture_goes_on_to_the_same_bits() {
    let (scene, view) = (cornell(), cornell_camera(40));
    let mut whole = Tracer::new(unfiltered(2));
    assert!(whole.trace(&scene, 0, &no_lights(), &view, 4, &|| false));
    let mut parts = Tracer::new(unfiltered(2));
    let asked = AtomicU32::new(0);
    let mut stops = 0;
    // A call has no time for all guides, nor for a whole sample.
    while parts.samples() < 4 {
        asked.store(0, Ordering::Relaxed);
        let should_stop = || asked.fetch_add(1, Ordering::Relaxed) >= 2;
        let left = 4 - parts.samples();
        stops += u32::from(!parts.trace(&scene, 0, &no_lights(), &view, left, &should_stop));
    }
    assert!((3..40).contains(&stops), "{stops}");
    assert_eq!(whole.resolve(), parts.resolve());
    assert_eq!(whole.stats().rays(), parts.stats().rays());
}

#[test]
fn a_move_before_there_are_guides_keeps_the_light_of_the_picture_before() {
    let (scene, view, between) = (cornell(), cornell_camera(40), cornell_camera(41));
    let moved = camera(DVec3::new(0.53, 0.06, 0.51), DVec3::new(0.5, 1.0, 0.47), 1.4, [32, 32]);
    let light_after = |stops_between: bool| {
        let mut tracer = Tracer::new(unfiltered(1));
        assert!(tracer.trace(&scene, 0, &no_lights(), &view, 8, &|| false));
        if stops_between {
            assert!(!tracer.trace(&scene, 0, &no_lights(), &between, 1, &|| true));
            assert_eq!(tracer.samples(), 0);
        }
        assert!(tracer.trace(&scene, 0, &no_lights(), &moved, 1, &|| false));
        tracer.incident()
    };
    assert_eq!(light_after(true), light_after(false));
}

#[test]
fn another_filter_keeps_the_samples_and_other_paths_do_not() {
    let (scene, view) = (cornell(), cornell_camera(24));
    let mut tracer = Tracer::new(unfiltered(1));
    tracer.trace(&scene, 0, &no_lights(), &view, 2, &|| false);
    let filter = Settings::of(FilterKind::Guided);
    tracer.set_options(Options { filter: filter.clone(), ..unfiltered(1) });
    assert_eq!(tracer.samples(), 2);
    let fresh = Options { filter, ..unfiltered(1) };
    assert_eq!(tracer.resolve(), picture(&scene, &Lights::default(), &view, 2, fresh));
    tracer.set_options(unfiltered(2));
    assert_eq!(tracer.samples(), 0);
}

#[test]
fn other_lights_scenes_and_cameras_begin_afresh() {
    let (scene, view) = (cornell(), cornell_camera(16));
    let mut tracer = Tracer::new(unfiltered(1));
    let mut samples_after = |epoch, lights: &PreparedLights, view: &_| {
        tracer.trace(&scene, epoch, lights, view, 1, &|| false);
        tracer.samples()
    };
    let lamp = Light::Point { position: [0.5; 3], intensity: [1.0; 3] };
    let lit = Lights::from(vec![lamp]).prepare(DVec3::ZERO);
    assert_eq!(samples_after(0, &no_lights(), &view), 1);
    assert_eq!(samples_after(0, &no_lights(), &view), 2);
    assert_eq!(samples_after(1, &no_lights(), &view), 1);
    assert_eq!(samples_after(1, &lit, &view), 1);
    assert_eq!(samples_after(1, &lit, &cornell_camera(17)), 1);
}

#[test]
fn after_a_move_light_of_the_last_picture_helps_until_there_is_enough_of_the_new() {
    let scene = cornell();
    let view = cornell_camera(32);
    let moved = camera(DVec3::new(0.53, 0.06, 0.51), DVec3::new(0.5, 1.0, 0.47), 1.4, [32, 32]);
    let mut tracer = Tracer::new(unfiltered(1));
    tracer.trace(&scene, 0, &no_lights(), &view, 8, &|| false);
    tracer.trace(&scene, 0, &no_lights(), &moved, 1, &|| false);
    let again = tracer.incident();
    let mut fresh = Tracer::new(unfiltered(1));
    fresh.trace(&scene, 0, &no_lights(), &moved, 1, &|| false);
    let mut truth = Tracer::new(Options { seed: 7, ..unfiltered(1) });
    truth.trace(&scene, 0, &no_lights(), &moved, 512, &|| false);
    let error = |image| square_error(&image, &truth.incident());
    let (with, without) = (error(again), error(fresh.incident()));
    assert!(with < 0.4 * without, "{with} {without}");
    for tracer in [&mut tracer, &mut fresh] {
        for _ in 0..7 {
            tracer.trace(&scene, 0, &no_lights(), &moved, 1, &|| false);
        }
    }
    assert_eq!(tracer.resolve(), fresh.resolve(), "the last picture is forgotten");
}
