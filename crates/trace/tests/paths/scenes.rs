//! Scenes of the tests: exact surfaces, boxes of triangles, spheres of splats; and a short way to
//! trace them.

use esker_lod::View;
use esker_render::Splat;
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::scene::{Albedo, Emitter, Material, Members, Mesh, MeshTree, Object, SplatInput};
use esker_trace::{Camera, Hit, Image, Lights, LitImage, Options, Ray, Scene, Surfaces, Tracer};
use glam::{Affine3A, DVec3, Vec3};
use std::f32::consts::PI;
use std::sync::Arc;

/// A scene without its list of emitters: emission is found by bounces.
pub struct Found<'a>(pub &'a Scene);

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
}

/// A sphere about the origin.
pub struct Sphere {
    pub radius: f32,
    pub albedo: Vec3,
    pub emission: Vec3,
}

impl Surfaces for Sphere {
    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let b = ray.origin.dot(ray.direction);
        let root = (b * b - ray.origin.length_squared() + self.radius * self.radius).sqrt();
        let distance = if -b - root > 0.0 { -b - root } else { -b + root };
        if root.is_nan() || distance <= 0.0 || distance >= ray.reach {
            return None;
        }
        let normal = ray.at(distance) / self.radius;
        let is_back = normal.dot(ray.direction) > 0.0;
        Some(Hit {
            distance,
            normal: if is_back { -normal } else { normal }.normalize_or_zero(),
            albedo: self.albedo,
            emission: self.emission,
            lift: self.radius * 1e-4,
            radius: 0.0,
            is_back,
        })
    }

    fn is_blocked(&self, ray: &Ray) -> bool {
        self.hit(ray).is_some()
    }

    fn diagonal(&self) -> f32 {
        self.radius * 12f32.sqrt()
    }
}

/// Splats evenly on a sphere about the origin, along a spiral of equal areas.
pub fn sphere_of_splats(count: usize, radius: f32) -> Vec<Splat> {
    let golden = PI * (3.0 - 5f32.sqrt());
    let spacing = radius * (4.0 * PI / count as f32).sqrt();
    let splat = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f32 / count as f32;
        let (sin, cos) = (i as f64 * f64::from(golden)).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        let normal = Vec3::new(flat * cos as f32, flat * sin as f32, z);
        Splat {
            centre: (normal * radius).to_array(),
            radius: spacing,
            normal: normal.to_array(),
            colour: [1.0; 3],
            draw: 0,
            index: i as u32,
        }
    };
    (0..count).map(splat).collect()
}

/// A scene of splats with one albedo, all of which emit `emission`.
pub fn splat_scene(splats: &[Splat], albedo: f32, emission: f32) -> Scene {
    let coloured: Vec<_> =
        splats.iter().map(|splat| Splat { colour: [albedo; 3], ..*splat }).collect();
    let everywhere = Members::Box { min: [-1e9; 3], max: [1e9; 3] };
    let emitters = [Emitter { members: everywhere, radiance: [emission; 3] }];
    let emitters = if emission > 0.0 { &emitters[..] } else { &[] };
    Scene::new(SplatInput {
        splats: &coloured,
        albedo: Albedo::AsIs,
        emitters,
        ..Default::default()
    })
}

/// A mesh of one material in its own place.
pub fn object(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>, material: Material) -> Object {
    let mesh = Mesh { positions, triangles, material, ..Default::default() };
    Object { mesh: Arc::new(MeshTree::new(mesh)), place: Affine3A::IDENTITY }
}

/// A parallelogram.
pub fn quad(corner: Vec3, a: Vec3, b: Vec3, albedo: Vec3, emission: f32) -> Object {
    let corners = vec![corner, corner + a, corner + a + b, corner + b];
    let material = Material { albedo, emission: Vec3::splat(emission) };
    object(corners, vec![[0, 1, 2], [0, 2, 3]], material)
}

/// Colours of the sides of [`cornell`]: floor, ceiling, back, front, left, right.
pub const SIDES: [Vec3; 6] = [
    Vec3::splat(0.7),
    Vec3::splat(0.7),
    Vec3::splat(0.7),
    Vec3::splat(0.5),
    Vec3::new(0.6, 0.1, 0.1),
    Vec3::new(0.1, 0.5, 0.1),
];

/// Extent of the emitting middle of the ceiling of [`cornell`] along both axes.
pub const LAMP: [f32; 2] = [0.25, 0.75];

/// The closed unit cube, the middle of its ceiling emits.
pub fn cornell() -> Scene {
    let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
    let [floor, ceiling, back, front, left, right] = SIDES;
    let lamp = LAMP[1] - LAMP[0];
    let corner = Vec3::new(LAMP[0], LAMP[0], 1.0);
    let end = Vec3::new(LAMP[1], LAMP[1], 1.0);
    let strip = |corner, a, b| quad(corner, a, b, ceiling, 0.0);
    Scene::default().with_objects(vec![
        quad(Vec3::ZERO, x, y, floor, 0.0),
        quad(y, x, z, back, 0.0),
        quad(Vec3::ZERO, x, z, front, 0.0),
        quad(Vec3::ZERO, y, z, left, 0.0),
        quad(x, y, z, right, 0.0),
        quad(corner, x * lamp, y * lamp, ceiling, 4.0),
        strip(z, x, y * LAMP[0]),
        strip(Vec3::new(0.0, LAMP[1], 1.0), x, y * (1.0 - LAMP[1])),
        strip(Vec3::new(0.0, LAMP[0], 1.0), x * LAMP[0], y * lamp),
        strip(end - y * lamp, x * (1.0 - LAMP[1]), y * lamp),
    ])
}

/// View of [`cornell`] from inside.
pub fn cornell_camera(side: u32) -> Camera {
    camera(DVec3::new(0.5, 0.05, 0.5), DVec3::new(0.5, 1.0, 0.45), 1.4, [side, side])
}

/// A camera with z up.
pub fn camera(eye: DVec3, target: DVec3, fovy_rad: f64, [width, height]: [u32; 2]) -> Camera {
    let view = View::look_at(eye, target, DVec3::Z, fovy_rad, width, height);
    Camera::new(&view, DVec3::ZERO)
}

/// Options without a filter.
pub fn unfiltered(bounces: u32) -> Options {
    Options { bounces, filter: Settings::of(FilterKind::None), ..Options::default() }
}

/// The picture of `samples` samples.
pub fn picture(
    scene: &impl Surfaces,
    lights: &Lights,
    camera: &Camera,
    samples: u32,
    options: Options,
) -> LitImage {
    let mut tracer = Tracer::new(options);
    let lights = lights.prepare(DVec3::ZERO);
    assert!(tracer.trace(scene, 0, &lights, camera, samples, &|| false));
    assert_eq!(tracer.samples(), samples);
    tracer.resolve()
}

/// Mean of each channel.
pub fn mean(image: &Image<3>) -> [f64; 3] {
    image
        .planes
        .each_ref()
        .map(|plane| plane.iter().map(|&value| f64::from(value)).sum::<f64>() / plane.len() as f64)
}

/// Mean squared difference of two images over all channels.
pub fn square_error(a: &Image<3>, b: &Image<3>) -> f64 {
    let pairs = a.planes.iter().flatten().zip(b.planes.iter().flatten());
    let sum: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
    sum / (3 * a.len()) as f64
}

/// Whether all values are finite and none is negative.
pub fn is_light(image: &Image<3>) -> bool {
    image.planes.iter().flatten().all(|value| value.is_finite() && *value >= 0.0)
}
