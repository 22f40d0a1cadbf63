//! Claims about lights: their documents, and where they shine from.

#![allow(clippy::unwrap_used, reason = "tests may panic")]

use esker_trace::light::{LIGHTS_VERSION, Panorama, SUN_DIAMETER_DEG};
use esker_trace::{Light, Lights, Sky};
use glam::{DVec3, Vec3};

#[test]
fn lights_survive_json_and_defaults_need_not_be_stated() {
    let lights = Lights::from(vec![
        Light::Spot {
            position: [1.0, 2.0, 3.0],
            direction: [0.0, 0.0, -1.0],
            intensity: [1.0, 0.5, 0.25],
            inner_angle_deg: 20.0,
            outer_angle_deg: 30.0,
        },
        Light::Sky {
            sky: Sky::Image(Panorama { width: 1, height: 1, pixels: vec![[1.0; 3]], file: None }),
        },
    ]);
    let text = serde_json::to_string(&lights).unwrap();
    assert_eq!(serde_json::from_str::<Lights>(&text).unwrap(), lights);
    let short = r#"{ "lights": [
        { "kind": "sun", "azimuth_deg": 180, "elevation_deg": 40, "irradiance": [3, 3, 2] },
        { "kind": "sky", "sky": { "constant": [0.1, 0.2, 0.3] } }
    ] }"#;
    let lights: Lights = serde_json::from_str(short).unwrap();
    assert_eq!(lights.version, LIGHTS_VERSION);
    let Light::Sun { angular_diameter_deg, .. } = lights.lights[0] else { panic!("a sun") };
    assert_eq!(angular_diameter_deg, SUN_DIAMETER_DEG);
    assert!(serde_json::from_str::<Lights>(r#"{ "lights": [{ "kind": "moon" }] }"#).is_err());
}

/// Radiance of a sky through the lights that hold it.
fn radiance(sky: Sky, direction: Vec3) -> Vec3 {
    Lights::from(vec![Light::Sky { sky }]).prepare(DVec3::ZERO).sky(direction.normalize_or_zero())
}

#[test]
fn a_gradient_has_its_colours_up_down_and_at_the_horizon() {
    let sky = Sky::Gradient { zenith: [1.0; 3], horizon: [0.5; 3], ground: [0.0, 0.0, 0.1] };
    assert_eq!(radiance(sky.clone(), Vec3::Z), Vec3::ONE);
    assert_eq!(radiance(sky.clone(), Vec3::X), Vec3::splat(0.5));
    assert_eq!(radiance(sky.clone(), Vec3::NEG_Z), Vec3::new(0.0, 0.0, 0.1));
    let half = radiance(sky, Vec3::new(3f32.sqrt(), 0.0, 1.0));
    assert!((half - 0.75).length() < 1e-6, "half of the way at 30 degrees: {half}");
}

#[test]
fn the_middle_of_a_panorama_is_north_its_right_quarter_east_and_its_top_up() {
    let (width, height) = (64, 32);
    let pixels = (0..width * height).map(|i| [(i % width) as f32, (i / width) as f32, 0.0]);
    let panorama = Panorama { width, height, pixels: pixels.collect(), file: None };
    for (direction, want) in [
        (Vec3::Y, [31.5, 15.5]),
        (Vec3::X, [47.5, 15.5]),
        (Vec3::NEG_X, [15.5, 15.5]),
        (Vec3::new(0.0, 1.0, 1.0), [31.5, 7.5]),
        (Vec3::new(0.0, 1.0, -1.0), [31.5, 23.5]),
    ] {
        let got = radiance(Sky::Image(panorama.clone()), direction);
        let error = (got.truncate() - glam::Vec2::from(want)).length();
        assert!(error < 1e-3, "{direction}: {got}");
    }
    assert!(radiance(Sky::Image(panorama.clone()), Vec3::Z).y < 1e-3);
    // Columns go on from the last to the first in the south.
    let south = radiance(Sky::Image(panorama), Vec3::NEG_Y);
    assert!((south.x - 31.5).abs() < 1e-2, "{south}");
}

#[test]
fn panoramas_with_missing_or_senseless_pixels_are_black_there() {
    let sky = |width, height, pixels| Sky::Image(Panorama { width, height, pixels, file: None });
    for sky in [sky(0, 0, vec![]), sky(8, 0, vec![]), sky(4, 4, vec![[f32::NAN; 3]])] {
        for direction in [Vec3::X, Vec3::Z, Vec3::NEG_Z, Vec3::new(-1e-9, -1.0, 0.0)] {
            assert_eq!(radiance(sky.clone(), direction), Vec3::ZERO);
        }
    }
}

#[test]
fn several_skies_add_up() {
    let sky = |value| Light::Sky { sky: Sky::Constant([value; 3]) };
    let lights = Lights::from(vec![sky(0.25), sky(0.5)]).prepare(DVec3::ZERO);
    assert!(lights.has_sky() && lights.sky(Vec3::X) == Vec3::splat(0.75));
}
