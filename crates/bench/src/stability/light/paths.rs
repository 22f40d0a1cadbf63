//! Light that is known in closed form or by quadrature: in a closed scene that shines, below a
//! square lamp, and of the sun on a plane. In: a value of an axis. Out: how far the tracer is off.

use esker_engine::calls::conditions::rated::LIGHT_SHARE;
use esker_lod::View;
use esker_render::Splat;
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::scene::{
    Albedo, AreaLight, Emitter, Material, Members, Mesh, MeshTree, Object, SplatInput,
};
use esker_trace::{
    Camera, Hit, Image, Light, Lights, LitImage, Options, Ray, Scene, Surfaces, Tracer,
};
use glam::{Affine3A, DVec3, Vec3, Vec3Swizzles};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Most bounces that `--bounces` takes.
const BOUNCES: u32 = 64;
/// Points of a closed ball.
const BALL_POINTS: usize = 20_000;
/// Samples a pixel in closed scenes: paths that end at random leave the mean off by some
/// thousandths.
const CLOSED_SAMPLES: u32 = 64;
/// Side of pictures, pixels.
const SIDE: u32 = 24;
/// Samples and shadow rays of a lamp.
const LAMP_SAMPLES: u32 = 4;
const LAMP_RAYS: u32 = 64;
/// Points of the exact irradiance along a side of a lamp.
const QUADRATURE: u32 = 32;
/// Where the middle of the lamp is, whose distance is 1. No coordinate but the height is a power of
/// two, so that corners of a small lamp are rounded.
const LAMP: DVec3 = DVec3::new(0.3, 0.2, 1.0);
/// Points along a side of a far plane.
const PLANE_POINTS: i32 = 64;
/// Share of the plane's side that the picture shows.
const SHOWN: f64 = 0.5;
/// Side of the picture of a plane, pixels.
const PLANE_PX: u32 = 64;
/// Albedo of planes.
const GREY: f32 = 0.5;

/// A scene without its list of emitters: emission is found by bounces, so that each wall of a
/// closed scene is seen at each bounce, and nothing but the number of bounces is lost.
struct Found<'a>(&'a Scene);

impl Surfaces for Found<'_> {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        self.0.hit(ray)
    }

    fn is_blocked(&self, ray: &Ray) -> bool {
        self.0.is_blocked(ray)
    }

    fn diagonal(&self) -> f32 {
        Surfaces::diagonal(self.0)
    }

    fn emitters(&self) -> &[AreaLight] {
        &[]
    }
}

/// Light in a closed mesh and in a closed ball of points that shine with a radiance of 1 and have
/// this albedo: it is the sum of the geometric series, without limit for an albedo of 1.
pub fn albedo(albedo: f64) -> Vec<f64> {
    let eye = DVec3::new(0.1, 0.2, 0.1);
    let camera = camera(eye, DVec3::new(1.0, 0.3, 0.2), 1.2, SIDE);
    let off = |scene: &Scene| {
        let options = unfiltered(BOUNCES, 1);
        let lit = trace(&Found(scene), &Lights::default(), &camera, CLOSED_SAMPLES, options);
        // What is not finite is off by all light.
        (mean(&lit.radiance) * (1.0 - albedo) - 1.0).abs()
    };
    let splats = ball(BALL_POINTS, albedo as f32);
    let members = Members::Box { min: [-2.0; 3], max: [2.0; 3] };
    let emitters = [Emitter { members, radiance: [1.0; 3] }];
    let input = SplatInput {
        splats: &splats,
        albedo: Albedo::AsIs,
        emitters: &emitters,
        ..Default::default()
    };
    vec![off(&cube(albedo as f32)), off(&Scene::new(input))]
}

/// Light of a square lamp and of a square mesh of this side, 1 above a floor, whose power is the
/// same for all sides.
pub fn lamp_size(side: f64) -> Vec<f64> {
    let radiance = (side * side).recip();
    let corner = LAMP - DVec3::new(side, side, 0.0) * 0.5;
    // The camera is below the lamp, which hides nothing.
    let camera = camera(DVec3::new(-0.5, -0.5, 0.6), DVec3::ZERO, 0.7, SIDE);
    let wanted = |i: u32| {
        let ray = camera.ray((i % SIDE) as f32 + 0.5, (i / SIDE) as f32 + 0.5);
        below(ray.at(-ray.origin.z / ray.direction.z).as_dvec3(), corner, side, radiance) / PI
    };
    let wanted = (0..SIDE * SIDE).map(wanted).sum::<f64>() / f64::from(SIDE * SIDE);
    let corner_of_floor = Vec3::new(-40.0, -40.0, 0.0);
    let floor = || {
        quad(
            corner_of_floor,
            Vec3::X * 80.0,
            Vec3::Y * 80.0,
            Material { albedo: Vec3::ONE, emission: Vec3::ZERO },
        )
    };
    let off = |scene: &Scene, lights: &Lights| {
        let lit = trace(scene, lights, &camera, LAMP_SAMPLES, unfiltered(0, LAMP_RAYS));
        (mean(&lit.radiance) / wanted - 1.0).abs()
    };
    let edges = [[0.0, side, 0.0], [side, 0.0, 0.0]];
    let radiance = [radiance as f32; 3];
    let lamp = Light::Area { corner: corner.to_array(), edges, radiance, two_sided: false };
    let emission = Vec3::from_array(radiance);
    let [x, y] = [Vec3::X, Vec3::Y].map(|axis| axis * side as f32);
    let shining = quad(corner.as_vec3(), x, y, Material { albedo: Vec3::ZERO, emission });
    vec![
        off(&Scene::default().with_objects(vec![floor()]), &Lights::from(vec![lamp])),
        off(&Scene::default().with_objects(vec![floor(), shining]), &Lights::default()),
    ]
}

/// Wrong pixels of a plane of points, and of the same as a mesh, in the sun; the plane is so many
/// distances of its points away from the eye.
pub fn distance(distance: f64) -> Vec<f64> {
    let middle = DVec3::new(0.55, 0.65, 0.52).normalize_or(DVec3::X) * distance;
    let (x, y) = middle.normalize_or(DVec3::X).any_orthonormal_pair();
    // Tilted by 45 degrees against the line of sight.
    let normal = (y - middle / distance).normalize_or(DVec3::Z);
    let along = x.cross(normal);
    let sun = (normal + 0.4 * x).normalize_or(normal);
    let half = f64::from(PLANE_POINTS) * 0.5;
    let at = |i: i32, j: i32| {
        middle + x * (f64::from(i) + 0.5 - half) + along * (f64::from(j) + 0.5 - half)
    };
    let splats: Vec<Splat> = (0..PLANE_POINTS * PLANE_POINTS)
        .map(|k| Splat {
            centre: at(k % PLANE_POINTS, k / PLANE_POINTS).as_vec3().to_array(),
            radius: 1.0,
            normal: normal.as_vec3().to_array(),
            colour: [GREY; 3],
            draw: 0,
            index: k as u32,
        })
        .collect();
    let points =
        Scene::new(SplatInput { splats: &splats, albedo: Albedo::AsIs, ..Default::default() });
    let [a, b] = [x, along].map(|axis| (axis * 2.0 * half).as_vec3());
    let corner = (middle - (x + along) * half).as_vec3();
    let material = Material { albedo: Vec3::splat(GREY), emission: Vec3::ZERO };
    let mesh = Scene::default().with_objects(vec![quad(corner, a, b, material)]);
    let lights = Lights::from(vec![Light::Sun {
        azimuth_deg: sun.x.atan2(sun.y).to_degrees(),
        elevation_deg: sun.z.asin().to_degrees(),
        irradiance: [1.0; 3],
        angular_diameter_deg: 0.0,
    }]);
    let tan_half = half * SHOWN * std::f64::consts::FRAC_1_SQRT_2 / distance;
    // Views have a least angle, which hides nothing of the rays here.
    let focal_px = (f64::from(PLANE_PX) * 0.5 / tan_half) as f32;
    let camera = Camera { focal_px, ..camera(DVec3::ZERO, middle, 1.0, PLANE_PX) };
    let wanted = f64::from(GREY) / PI * sun.dot(normal);
    let wrong = |scene: &Scene| {
        let lit = trace(scene, &lights, &camera, 1, unfiltered(0, 1));
        let plane = &lit.radiance.planes[1];
        let is_wrong = |light: &&f32| {
            let off = (f64::from(**light) / wanted - 1.0).abs();
            off.is_nan() || off > LIGHT_SHARE
        };
        plane.iter().filter(is_wrong).count() as f64 / plane.len() as f64
    };
    vec![wrong(&points), wrong(&mesh)]
}

/// Irradiance at a point of the floor below a square lamp, by quadrature.
fn below(point: DVec3, corner: DVec3, side: f64, radiance: f64) -> f64 {
    let step = side / f64::from(QUADRATURE);
    let place = |i: u32| (f64::from(i) + 0.5) * step;
    let one = |k: u32| {
        let to = corner + DVec3::new(place(k % QUADRATURE), place(k / QUADRATURE), 0.0) - point;
        // Both cosines are the height over the distance.
        (to.z / to.length_squared()).powi(2)
    };
    (0..QUADRATURE * QUADRATURE).map(one).sum::<f64>() * step * step * radiance
}

/// Even points on a ball of radius 1 about the origin, along a spiral of equal areas.
fn ball(count: usize, albedo: f32) -> Vec<Splat> {
    let golden = PI * (3.0 - 5f64.sqrt());
    let spacing = (2.0 * TAU / count as f64).sqrt() as f32;
    let splat = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (i as f64 * golden).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        let normal = DVec3::new(flat * cos, flat * sin, z).as_vec3().to_array();
        let colour = [albedo; 3];
        Splat { centre: normal, radius: spacing, normal, colour, draw: 0, index: i as u32 }
    };
    (0..count).map(splat).collect()
}

/// A closed cube from -1 to 1 that shines with a radiance of 1.
fn cube(albedo: f32) -> Scene {
    let material = Material { albedo: Vec3::splat(albedo), emission: Vec3::ONE };
    let sides = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| {
        let (a, b) = (axis.zxy() * 2.0, axis.yzx() * 2.0);
        [-axis, axis].map(|middle| quad(middle - (a + b) * 0.5, a, b, material))
    });
    Scene::default().with_objects(sides.collect())
}

/// A parallelogram.
fn quad(corner: Vec3, a: Vec3, b: Vec3, material: Material) -> Object {
    let mesh = Mesh {
        positions: vec![corner, corner + a, corner + a + b, corner + b],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Mesh::default()
    };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place: Affine3A::IDENTITY }
}

/// A camera whose picture is a square.
fn camera(eye: DVec3, target: DVec3, fovy_rad: f64, side: u32) -> Camera {
    Camera::new(&View::look_at(eye, target, DVec3::Z, fovy_rad, side, side), DVec3::ZERO)
}

fn unfiltered(bounces: u32, shadow_samples: u32) -> Options {
    let filter = Settings::of(FilterKind::None);
    Options { bounces, shadow_samples, filter, ..Options::default() }
}

fn trace(
    scene: &impl Surfaces,
    lights: &Lights,
    camera: &Camera,
    samples: u32,
    options: Options,
) -> LitImage {
    let mut tracer = Tracer::new(options);
    tracer.trace(scene, 0, &lights.prepare(DVec3::ZERO), camera, samples, &|| false);
    tracer.resolve()
}

/// Mean of a channel; all have the same light.
fn mean(image: &Image<3>) -> f64 {
    let plane = &image.planes[1];
    plane.iter().map(|light| f64::from(*light)).sum::<f64>() / plane.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_below_a_small_lamp_is_that_of_a_point() {
        let (side, point) = (1e-3, DVec3::new(-0.4, 0.1, 0.0));
        let corner = LAMP - DVec3::new(side, side, 0.0) * 0.5;
        let to = LAMP - point;
        let of_a_point = (to.z / to.length_squared()).powi(2);
        let off = below(point, corner, side, (side * side).recip()) / of_a_point - 1.0;
        assert!(off.abs() < 1e-6, "{off}");
    }

    #[test]
    fn easy_conditions_are_lit_right() {
        for off in [albedo(0.5), lamp_size(0.1), distance(1e3)] {
            assert!(off.iter().all(|off| *off < 0.01), "{off:?}");
        }
    }

    #[test]
    fn light_without_limit_is_not_reached() {
        assert!(albedo(1.0).iter().all(|off| *off == 1.0));
    }
}
