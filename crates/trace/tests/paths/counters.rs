//! Counters of what goes wrong against clouds in which it is known: rays that hit the surface that
//! they left, and rays that leak out of a closed room.

use crate::scenes::{camera, sphere_of_splats, splat_scene, unfiltered};
use esker_render::Splat;
use esker_trace::{Lights, Stats, Tracer};
use glam::{DVec3, Vec3};

/// Random numbers in -1 to 1 (`splitmix64`).
fn random(seed: u64) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// A square floor about the origin with splats anywhere on it, one a unit of area. Places are off
/// by up to `off` units upwards or downwards, normals by about `tilt` radians.
fn floor(off: f32, tilt: f32) -> Vec<Splat> {
    let (mut random, half) = (random(5), 100.0);
    let splat = |index: u32| {
        let centre = [half * random(), half * random(), off * random()];
        let normal = Vec3::new(tilt * random(), tilt * random(), 1.0).normalize_or_zero();
        let normal = normal.to_array();
        Splat { centre, radius: 1.0, normal, colour: [0.5; 3], draw: 0, index }
    };
    (0..(4.0 * half * half) as u32).map(splat).collect()
}

/// A sphere of radius 1 about the origin with splats anywhere on it.
fn sphere_at_random(count: u32) -> Vec<Splat> {
    let mut random = random(9);
    let radius = (4.0 * std::f32::consts::PI / count as f32).sqrt();
    let mut splat = |index: u32| {
        let normal = loop {
            let v = Vec3::new(random(), random(), random());
            if (0.01..1.0).contains(&v.length_squared()) {
                break v.normalize_or_zero().to_array();
            }
        };
        Splat { centre: normal, radius, normal, colour: [0.5; 3], draw: 0, index }
    };
    (0..count).map(&mut splat).collect()
}

/// Counts of a picture of splats, and the share of its bounce rays that `count` has.
fn share(splats: &[Splat], eye: [f64; 3], bounces: u32, count: impl Fn(&Stats) -> u64) -> f64 {
    let view = camera(eye.into(), DVec3::new(0.1, 0.2, 0.0), 1.2, [96, 96]);
    let mut tracer = Tracer::new(unfiltered(bounces));
    let none = Lights::default().prepare(DVec3::ZERO);
    assert!(tracer.trace(&splat_scene(splats, 0.5, 0.0), 0, &none, &view, 8, &|| false));
    let stats = tracer.stats();
    assert!(stats.bounce_rays > 70_000, "{stats:?}");
    count(&stats) as f64 / stats.bounce_rays as f64
}

#[test]
fn rays_from_a_noisy_floor_hit_it_and_are_counted_and_those_from_a_smooth_one_do_not() {
    let eye = [10.0, -30.0, 40.0];
    let own = |off: f32, tilt: f32| share(&floor(off, tilt), eye, 1, |stats| stats.self_hits);
    let all = |off: f32, tilt: f32| {
        // Nothing else is there to be hit.
        share(&floor(off, tilt), eye, 1, |stats| stats.bounce_rays - stats.escaped)
    };
    assert_eq!(own(0.0, 0.0), 0.0);
    assert_eq!(all(0.0, 0.0), 0.0);
    // Layers of misaligned scans: up to three spacings apart, normals off by ten degrees.
    let (counted, hits) = (own(3.0, 0.17), all(3.0, 0.17));
    assert!((0.005..0.05).contains(&hits), "{hits}");
    assert!((0.7 * hits..=hits).contains(&counted), "{counted} of {hits}");
}

#[test]
fn what_a_hollow_surface_sends_to_itself_is_no_self_hit() {
    let splats = sphere_of_splats(20_000, 1.0);
    let own = share(&splats, [0.3, 0.2, 0.1], 2, |stats| stats.self_hits);
    assert!(own < 2e-5, "{own}");
}

#[test]
fn a_closed_room_of_random_points_leaks_a_five_hundredth_of_its_rays_and_an_even_one_none() {
    let eye = [0.3, 0.2, 0.1];
    let escaped = |splats: &[Splat]| share(splats, eye, 2, |stats| stats.escaped);
    let random = escaped(&sphere_at_random(30_000));
    assert!((0.001..0.004).contains(&random), "{random}");
    let even = escaped(&sphere_of_splats(30_000, 1.0));
    assert!(even < 1e-4, "{even}");
}
