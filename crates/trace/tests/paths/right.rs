//! Light that is known: the white furnace, plates, a rectangle's form factor, a box against an
//! independent estimate in `f64`.

use crate::scenes::{
    Found, LAMP, SIDES, Sphere, camera, cornell, cornell_camera, mean, picture, quad,
    sphere_of_splats, splat_scene, unfiltered,
};
use esker_trace::{Gloss, Image, Light, Lights, Options, Scene, Sky, Surfaces, Tracer};
use glam::{DVec3, Vec3};
use std::f64::consts::PI;

fn white_sky() -> Lights {
    Lights::from(vec![Light::Sky { sky: Sky::Constant([1.0; 3]) }])
}

fn worst(image: &Image<3>, want: f32) -> f32 {
    image.planes.iter().flatten().map(|value| (value / want - 1.0).abs()).fold(0.0, f32::max)
}

#[test]
fn in_a_closed_sphere_that_emits_light_sums_to_the_geometric_series() {
    let view = camera(DVec3::new(0.3, 0.2, 0.1), DVec3::X, 1.5, [16, 16]);
    for (albedo, bounces) in [(0.5f32, 3), (1.0, 6)] {
        let want: f32 = (0..=bounces + 1).map(|k| albedo.powi(k)).sum();
        // Found by bounces, light is emitted at the end of the path: one reflection fewer.
        let found = want - albedo.powi(bounces + 1);
        let exact = Sphere { radius: 1.0, albedo: Vec3::splat(albedo), emission: Vec3::ONE };
        let options = unfiltered(bounces as u32);
        let lit = picture(&exact, &Lights::default(), &view, 4, options.clone());
        assert!(worst(&lit.radiance, found) < 1e-5, "exact");
        let splats = sphere_of_splats(20_000, 1.0);
        let scene = splat_scene(&splats, albedo, 1.0);
        let lit = picture(&Found(&scene), &Lights::default(), &view, 16, options.clone());
        let got = mean(&lit.radiance)[1] / f64::from(found);
        assert!((got - 1.0).abs() < 0.005, "splats, found by bounces: {got}");
        let lit = picture(&scene, &Lights::default(), &view, 16, options);
        let got = mean(&lit.radiance)[1] / f64::from(want);
        // Splats stand for the area of their spacing, and those near a point are cut off.
        assert!((got - 1.0).abs() < 0.03, "splats, sampled: {got}");
    }
}

#[test]
fn a_white_convex_body_under_a_white_sky_cannot_be_told_from_it() {
    let view = camera(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, 0.7, [32, 32]);
    let exact = Sphere { radius: 1.0, albedo: Vec3::ONE, emission: Vec3::ZERO };
    let lit = picture(&exact, &white_sky(), &view, 4, unfiltered(2));
    assert!(worst(&lit.radiance, 1.0) < 1e-5);
    let scene = splat_scene(&sphere_of_splats(20_000, 1.0), 1.0, 0.0);
    let lit = picture(&scene, &white_sky(), &view, 16, unfiltered(4));
    let got = mean(&lit.radiance)[0];
    assert!((got - 1.0).abs() < 0.005, "{got}");
}

#[test]
fn gloss_adds_no_light() {
    let view = camera(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, 0.7, [32, 32]);
    let exact = Sphere { radius: 1.0, albedo: Vec3::ONE, emission: Vec3::ZERO };
    for roughness in [0.1, 0.5, 1.0] {
        let gloss = Some(Gloss { reflectance: 0.2, roughness });
        let lit = picture(&exact, &white_sky(), &view, 64, Options { gloss, ..unfiltered(2) });
        let got = mean(&lit.radiance)[0];
        // Fresnel's term, which grows towards the rim, is not taken from the Lambert term.
        assert!((0.93..1.06).contains(&got), "{roughness}: {got}");
    }
}

/// Irradiance over pi times radiance at `point` below a rectangle at height `z` that spans `x` and
/// `y`: the sum of the four parts that meet above the point (Hottel's factor of a corner).
fn rectangle_factor(point: DVec3, x: [f64; 2], y: [f64; 2], z: f64) -> f64 {
    let height = z - point.z;
    let corner = |x: f64, y: f64| {
        let (a, b) = (x / height, y / height);
        let (u, v) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / u * (b / u).atan() + b / v * (a / v).atan()) / (2.0 * PI)
    };
    let (x, y) = (x.map(|x| x - point.x), y.map(|y| y - point.y));
    corner(x[1], y[1]) - corner(x[0], y[1]) - corner(x[1], y[0]) + corner(x[0], y[0])
}

/// A large white floor at z = 0 and its view from above.
fn floor_below(z: f64) -> (Vec<esker_trace::scene::Object>, esker_trace::Camera) {
    let corner = Vec3::new(-50.0, -50.0, 0.0);
    let floor = quad(corner, Vec3::X * 100.0, Vec3::Y * 100.0, Vec3::ONE, 0.0);
    (vec![floor], camera(DVec3::new(0.01, 0.0, z), DVec3::ZERO, 1.2, [24, 24]))
}

#[test]
fn below_a_rectangle_light_is_that_of_its_form_factor_however_it_is_found() {
    let (objects, view) = floor_below(0.9);
    let (x, y) = ([-0.4, 0.8], [-0.5, 0.5]);
    let place = |i: usize| {
        let ray = view.ray((i % 24) as f32 + 0.5, (i / 24) as f32 + 0.5);
        (ray.at(-ray.origin.z / ray.direction.z)).as_dvec3()
    };
    let want: Vec<f64> = (0..24 * 24).map(|i| rectangle_factor(place(i), x, y, 1.0)).collect();
    let check = |image: &Image<3>, limit: f64, name: &str| {
        let errors = image.planes[0].iter().zip(&want).map(|(got, want)| f64::from(*got) - want);
        let bias = errors.clone().sum::<f64>() / want.iter().sum::<f64>();
        let worst = errors.map(f64::abs).fold(0.0, f64::max);
        assert!(bias.abs() < 0.001 && worst < limit, "{name}: {bias} {worst}");
    };
    let first_only = |samples: u32, scene: &dyn Fn(&mut Tracer)| {
        let mut tracer = Tracer::new(Options { shadow_samples: samples, ..unfiltered(1) });
        scene(&mut tracer);
        (tracer.incident(), tracer.resolve().direct)
    };
    let corner = [x[0], y[0], 1.0];
    let edges = [[0.0, y[1] - y[0], 0.0], [x[1] - x[0], 0.0, 0.0]];
    let area = Light::Area { corner, edges, radiance: [1.0; 3], two_sided: false };
    let lamp = Lights::from(vec![area]).prepare(DVec3::ZERO);
    let none = Lights::default().prepare(DVec3::ZERO);
    let scene = Scene::default().with_objects(objects.clone());
    let (_, direct) = first_only(64, &|tracer| {
        tracer.trace(&scene, 0, &lamp, &view, 1, &|| false);
    });
    check(&direct, 0.02, "area light");
    let [low, size] = [[x[0], y[0]], [x[1] - x[0], y[1] - y[0]]];
    let corner = Vec3::new(low[0] as f32, low[1] as f32, 1.0);
    let panel = quad(corner, Vec3::X * size[0] as f32, Vec3::Y * size[1] as f32, Vec3::ZERO, 1.0);
    let scene = Scene::default().with_objects(objects.into_iter().chain([panel]).collect());
    let (_, direct) = first_only(64, &|tracer| {
        tracer.trace(&scene, 0, &none, &view, 1, &|| false);
    });
    check(&direct, 0.02, "emitting triangles");
    let (incident, _) = first_only(1, &|tracer| {
        tracer.trace(&Found(&scene), 0, &none, &view, 1024, &|| false);
    });
    check(&incident, 0.02, "emission found by bounces");
}

#[test]
fn between_plates_light_is_that_of_the_radiosities() {
    let wide = 4000.0;
    let corner = Vec3::new(-wide, -wide, 0.0) * 0.5;
    let (a, b, albedo) = (Vec3::X * wide, Vec3::Y * wide, [0.6, 0.3]);
    let scene = Scene::default().with_objects(vec![
        quad(corner, a, b, Vec3::splat(albedo[0]), 1.0),
        quad(corner + Vec3::Z, a, b, Vec3::splat(albedo[1]), 0.0),
    ]);
    let view = camera(DVec3::new(0.0, 0.0, 0.5), DVec3::new(0.1, 0.0, 0.0), 0.8, [16, 16]);
    // B0 = 1 + p0 B1 and B1 = p1 B0; 16 bounces leave 0.18^8.
    let want = 1.0 / (1.0 - f64::from(albedo[0] * albedo[1]));
    let lit = picture(&Found(&scene), &Lights::default(), &view, 64, unfiltered(16));
    let got = mean(&lit.radiance)[0];
    assert!((got / want - 1.0).abs() < 0.001, "{got} {want}");
}

/// Numbers of a path in [0, 1) that share nothing with the tracer's: Halton's sequence, shifted at
/// random (by splitmix64).
struct Numbers {
    shift: u64,
    sample: u32,
    dimension: usize,
}

impl Numbers {
    fn next(&mut self) -> f64 {
        const BASES: [u32; 14] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43];
        self.shift = self.shift.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.shift;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let mut sum = ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64;
        let (base, mut rest) = (BASES[self.dimension], self.sample);
        let mut digit = 1.0 / f64::from(base);
        while rest > 0 {
            sum += f64::from(rest % base) * digit;
            rest /= base;
            digit /= f64::from(base);
        }
        self.dimension += 1;
        sum.fract()
    }
}

/// Where a ray inside the unit cube leaves it: the point, the inward normal, the side.
fn leave(origin: DVec3, direction: DVec3) -> (DVec3, DVec3, usize) {
    let mut nearest = (f64::INFINITY, 0, 0.0);
    for axis in 0..3 {
        let end = if direction[axis] > 0.0 { 1.0 } else { 0.0 };
        let distance = (end - origin[axis]) / direction[axis];
        if distance < nearest.0 {
            nearest = (distance, axis, end);
        }
    }
    let (distance, axis, end) = nearest;
    let mut point = origin + direction * distance;
    point[axis] = end;
    let mut normal = DVec3::ZERO;
    normal[axis] = 1.0 - 2.0 * end;
    let side = match (axis, end > 0.5) {
        (2, false) => 0,
        (2, true) => 1,
        (1, true) => 2,
        (1, false) => 3,
        (0, false) => 4,
        _ => 5,
    };
    (point, normal, side)
}

/// Incident indirect light of [`cornell`] where a ray from inside leaves it: each place that a path
/// meets adds what it reflects of a point of the lamp.
fn plain_path(origin: DVec3, direction: DVec3, bounces: u32, numbers: &mut Numbers) -> DVec3 {
    let (mut origin, mut direction) = (origin, direction);
    let (mut sum, mut throughput) = (DVec3::ZERO, DVec3::ONE);
    let [low, high] = LAMP.map(f64::from);
    let place = |u: f64| low + u * (high - low);
    for bounce in 0..=bounces {
        let (point, normal, side) = leave(origin, direction);
        if bounce > 0 {
            throughput *= SIDES[side].as_dvec3();
            let towards = DVec3::new(place(numbers.next()), place(numbers.next()), 1.0) - point;
            let squared = towards.length_squared();
            if side != 1 {
                let cosines = normal.dot(towards) * towards.z / squared;
                sum += throughput * (4.0 * (high - low).powi(2) * cosines / squared / PI);
            }
        }
        let (u, angle) = (numbers.next(), 2.0 * PI * numbers.next());
        let (x, y) = normal.any_orthonormal_pair();
        direction = (x * angle.cos() + y * angle.sin()) * u.sqrt() + normal * (1.0 - u).sqrt();
        origin = point;
    }
    sum
}

/// Sums over the quarters of a picture.
fn quarters(side: usize, mut value: impl FnMut(usize, usize) -> DVec3) -> [DVec3; 4] {
    let mut sums = [DVec3::ZERO; 4];
    for y in 0..side {
        for x in 0..side {
            sums[y / (side / 2) * 2 + x / (side / 2)] += value(x, y);
        }
    }
    sums
}

#[test]
fn indirect_light_of_a_box_converges_to_an_independent_estimate() {
    const SIDE: usize = 24;
    const ESTIMATES: u64 = 4;
    const SAMPLES: u32 = 3000;
    let (scene, view, bounces) = (cornell(), cornell_camera(SIDE as u32), 2);
    let mut tracer = Tracer::new(unfiltered(bounces));
    let lights = Lights::default().prepare(DVec3::ZERO);
    tracer.trace(&scene, 0, &lights, &view, 1024, &|| false);
    let incident = tracer.incident();
    let got = quarters(SIDE, |x, y| DVec3::from(incident.at(x, y).map(f64::from)));
    let estimates = (0..ESTIMATES).map(|estimate| {
        quarters(SIDE, |x, y| {
            let mut sum = DVec3::ZERO;
            for sample in 0..SAMPLES {
                let shift = ((y * SIDE + x) as u64 * ESTIMATES + estimate) << 32;
                let mut numbers = Numbers { shift, sample, dimension: 0 };
                let towards = view.ray(x as f32 + 0.5, y as f32 + 0.5).direction.as_dvec3();
                sum += plain_path(view.eye.as_dvec3(), towards, bounces, &mut numbers);
            }
            sum / f64::from(SAMPLES)
        })
    });
    let estimates: Vec<_> = estimates.collect();
    let count = ESTIMATES as f64;
    let mean_of = |part: usize| estimates.iter().map(|e| e[part]).sum::<DVec3>() / count;
    for (part, got) in got.iter().enumerate() {
        let error = (*got / mean_of(part) - 1.0).abs();
        assert!(error.max_element() < 0.003, "{part}: {error}");
    }
    let want = (0..4).map(mean_of).sum::<DVec3>();
    let sums = estimates.iter().map(|e| e.iter().sum::<DVec3>());
    let spread = sums.map(|sum| (sum - want).powf(2.0)).sum::<DVec3>();
    let deviation = (spread / (count - 1.0) / count).powf(0.5) / want;
    let error = (got.iter().sum::<DVec3>() / want - 1.0).abs();
    assert!(deviation.max_element() < 0.0005, "{deviation}");
    assert!(error.max_element() < 0.001, "{error} {deviation}");
}

#[test]
fn lamps_light_by_the_inverse_square_and_the_cosine() {
    let (objects, _) = floor_below(1.0);
    let scene = Scene::default().with_objects(objects);
    let view = camera(DVec3::new(0.0, 0.0, 1.0), DVec3::new(3.0, 0.0, 0.0), 0.01, [1, 1]);
    let light = |light: Light| {
        let lit = picture(&scene, &Lights::from(vec![light]), &view, 1, unfiltered(0));
        f64::from(lit.direct.planes[0][0])
    };
    let (position, intensity) = ([0.0, 0.0, 4.0], [1.0; 3]);
    // At distance 5 under a cosine of 4 / 5.
    let want = 0.8 / 25.0 / PI;
    let near = |got: f64, want: f64| assert!((got - want).abs() <= 1e-3 * want, "{got} {want}");
    near(light(Light::Point { position, intensity }), want);
    let spot = |inner_angle_deg, outer_angle_deg| Light::Spot {
        position,
        direction: [0.0, 0.0, -2.0],
        intensity,
        inner_angle_deg,
        outer_angle_deg,
    };
    // The point is 36.87 degrees off the axis.
    near(light(spot(40.0, 60.0)), want);
    near(light(spot(10.0, 36.0)), 0.0);
    assert!((0.0..want).contains(&light(spot(20.0, 60.0))));
    let sun = |azimuth_deg, elevation_deg| Light::Sun {
        azimuth_deg,
        elevation_deg,
        irradiance: [PI as f32; 3],
        angular_diameter_deg: 0.0,
    };
    near(light(sun(77.0, 30.0)), 0.5);
    near(light(sun(77.0, -1.0)), 0.0);
    // A wall to the east of the point hides a sun in the east, not one in the north.
    let mut objects: Vec<_> = scene.objects().to_vec();
    objects.push(quad(Vec3::new(3.5, -5.0, 0.0), Vec3::Y * 10.0, Vec3::Z * 9.0, Vec3::ONE, 0.0));
    let walled = Scene::default().with_objects(objects);
    let lit = |light| {
        let lit = picture(&walled, &Lights::from(vec![light]), &view, 1, unfiltered(0));
        f64::from(lit.direct.planes[0][0])
    };
    near(lit(sun(90.0, 30.0)), 0.0);
    near(lit(sun(0.0, 30.0)), 0.5);
    assert!(Surfaces::diagonal(&walled) > 100.0);
}
