//! Scenes, lights and cameras that nobody means: no NaN, no hang, no panic.

use crate::scenes::{
    Sphere, camera, cornell, cornell_camera, is_light, picture, quad, sphere_of_splats,
    splat_scene, unfiltered,
};
use esker_trace::{Gloss, Hit, Light, Lights, Options, Ray, Scene, Sky, Surfaces, Tracer};
use glam::{DVec3, Vec3};

fn all_lights() -> Lights {
    Lights::from(vec![
        Light::Sky { sky: Sky::Constant([0.5; 3]) },
        Light::Point { position: [0.0; 3], intensity: [1.0; 3] },
        Light::Point { position: [1.0, 0.0, 0.0], intensity: [1.0; 3] },
        Light::Sun {
            azimuth_deg: 10.0,
            elevation_deg: 80.0,
            irradiance: [1.0; 3],
            angular_diameter_deg: 0.5,
        },
        Light::Area {
            corner: [0.0, 0.0, 1.0],
            edges: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            radiance: [1.0; 3],
            two_sided: true,
        },
    ])
}

#[test]
fn splats_without_extent_or_normal_are_lit_without_nan() {
    let good = sphere_of_splats(200, 1.0);
    let mut splats = vec![good[0]; 50];
    splats.extend(good.iter().skip(1));
    for (i, splat) in splats.iter_mut().enumerate() {
        match i % 7 {
            0 => splat.normal = [0.0; 3],
            1 => splat.normal = [f32::NAN; 3],
            2 => splat.radius = 0.0,
            3 => splat.centre[0] = f32::NAN,
            4 => splat.colour = [f32::NAN, -1.0, f32::INFINITY],
            _ => {}
        }
    }
    let gloss = Some(Gloss { reflectance: f32::NAN, roughness: f32::NAN });
    for splats in [&splats[..], &splats[..1], &[]] {
        let scene = splat_scene(splats, 0.9, 0.0);
        for eye in [DVec3::new(0.0, -3.0, 0.0), DVec3::ZERO, DVec3::new(0.0, 0.0, 1.0)] {
            let view = camera(eye, DVec3::new(0.1, 0.0, 0.0), 1.0, [20, 20]);
            for gloss in [None, gloss] {
                let options = Options { gloss, bounces: 4, ..Options::default() };
                assert!(is_light(&picture(&scene, &all_lights(), &view, 2, options).radiance));
            }
        }
    }
}

/// Hits everything everywhere with values that are not numbers.
struct Nonsense;

impl Surfaces for Nonsense {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let value = if ray.direction.x > 0.1 { f32::NAN } else { f32::INFINITY };
        Some(Hit {
            distance: if ray.direction.y > 0.1 { value } else { 1.0 },
            normal: Vec3::splat(value),
            albedo: Vec3::splat(value),
            emission: Vec3::splat(value),
            lift: value,
            radius: 0.0,
            is_back: false,
        })
    }

    fn is_blocked(&self, _: &Ray) -> bool {
        false
    }

    fn diagonal(&self) -> f32 {
        f32::NAN
    }
}

#[test]
fn hits_that_are_not_numbers_give_no_light_that_is_none() {
    let view = camera(DVec3::ZERO, DVec3::X, 2.0, [20, 20]);
    let options = Options { bounces: 3, ..Options::default() };
    assert!(is_light(&picture(&Nonsense, &all_lights(), &view, 2, options).radiance));
}

#[test]
fn albedo_one_in_a_closed_room_ends() {
    let room = Sphere { radius: 1.0, albedo: Vec3::ONE, emission: Vec3::splat(0.01) };
    let view = camera(DVec3::ZERO, DVec3::X, 1.0, [8, 8]);
    let lit = picture(&room, &Lights::default(), &view, 1, unfiltered(200));
    let want = 0.01 * 201.0;
    assert!(lit.radiance.planes[0].iter().all(|value| (value - want).abs() < 1e-3));
}

#[test]
fn lights_and_eyes_inside_of_bodies_are_dark() {
    let scene = splat_scene(&sphere_of_splats(5000, 1.0), 0.8, 0.0);
    let inside = camera(DVec3::ZERO, DVec3::X, 1.0, [16, 16]);
    let sky = Lights::from(vec![Light::Sky { sky: Sky::Constant([1.0; 3]) }]);
    let lit = picture(&scene, &sky, &inside, 4, unfiltered(2));
    let brightest = lit.radiance.planes[0].iter().fold(0.0, |a: f32, b| a.max(*b));
    assert!(brightest < 0.05, "{brightest}");
    let lamp = Light::Point { position: [0.0; 3], intensity: [1.0; 3] };
    let outside = camera(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, 0.7, [16, 16]);
    let lit = picture(&scene, &Lights::from(vec![lamp]), &outside, 4, unfiltered(2));
    assert!(lit.radiance.planes[0].iter().all(|value| *value < 0.01));
}

#[test]
fn without_lights_all_is_black_and_lights_without_sense_are_left_out() {
    let nan = f64::NAN;
    let lights = Lights::from(vec![
        Light::Point { position: [nan; 3], intensity: [1.0; 3] },
        Light::Point { position: [0.5; 3], intensity: [-1.0, f32::NAN, 0.0] },
        Light::Area {
            corner: [0.0; 3],
            edges: [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
            radiance: [1.0; 3],
            two_sided: true,
        },
        Light::Spot {
            position: [0.5; 3],
            direction: [0.0; 3],
            intensity: [1.0; 3],
            inner_angle_deg: 1.0,
            outer_angle_deg: nan,
        },
        Light::Sky { sky: Sky::Constant([f32::NAN, -1.0, f32::INFINITY]) },
    ]);
    let floor = quad(Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE, 0.0);
    let scene = Scene::default().with_objects(vec![floor]);
    let view = camera(DVec3::new(0.5, 0.5, 2.0), DVec3::new(0.5, 0.6, 0.0), 1.0, [9, 7]);
    for lights in [lights, Lights::default()] {
        let lit = picture(&scene, &lights, &view, 2, Options::default());
        assert!(lit.radiance.planes.iter().flatten().all(|value| *value == 0.0));
    }
}

#[test]
fn pictures_of_any_shape_are_traced() {
    let scene = cornell();
    for [width, height] in [[1, 1], [1, 50], [50, 1], [17, 33]] {
        let eye = DVec3::splat(0.5);
        let view = camera(eye, eye + DVec3::Y, 1.0, [width, height]);
        let lit = picture(&scene, &all_lights(), &view, 3, Options::default());
        assert!(is_light(&lit.radiance));
        assert_eq!(lit.depth.len(), (width * height) as usize);
        assert!(lit.depth.iter().all(|depth| (0.0..0.6).contains(depth)));
        assert!(lit.coverage.iter().all(|share| *share == 1.0));
    }
    let mut tracer = Tracer::default();
    assert_eq!(tracer.resolve().radiance.len(), 0);
    let mut none = cornell_camera(4);
    none.width = 0;
    let lights = Lights::default().prepare(DVec3::ZERO);
    assert!(tracer.trace(&scene, 0, &lights, &none, 1, &|| false));
}
