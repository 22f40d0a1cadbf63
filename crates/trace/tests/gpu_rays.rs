//! Rays on every adapter of the machine, with WebGPU's default limits, against the CPU's scene: the
//! tree that the GPU builds is not the CPU's, so that both also check each other.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpus;

use esker_render::Splat;
use esker_trace::gpu::{GpuHit, SceneKernels};
use esker_trace::scene::{Albedo, SplatInput};
use esker_trace::{Hit, Ray, Scene};
use glam::Vec3;
use gpus::gpus;

/// Share of rays that may differ: those that pass a rim or the end of a blend within rounding.
const NEAR_TIES: f64 = 1e-3;

/// Numbers from 0 to 1, the same in every run.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        let x = ((self.0 >> ((self.0 >> 28) + 4)) ^ self.0).wrapping_mul(277_803_737);
        ((x >> 22 ^ x) >> 8) as f32 / (1 << 24) as f32
    }

    /// A vector in a cube from -1 to 1.
    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }
}

/// A noisy ball of splats over a floor; some splats have no normal.
fn splats(count: u32) -> Vec<Splat> {
    let mut random = Random(count);
    (0..count)
        .map(|index| {
            let normal = random.vector().normalize_or(Vec3::Z);
            let on_floor = index % 4 == 0;
            let offset = random.vector() * 0.01;
            let (centre, normal) = if on_floor {
                (Vec3::new(offset.x * 150.0, offset.y * 150.0, offset.z - 0.8), Vec3::Z)
            } else {
                (normal * 0.7 + offset, (normal + offset * 5.0).normalize_or(normal))
            };
            let normal = if index % 50 == 1 { Vec3::ZERO } else { normal };
            let colour = [random.next(), random.next(), random.next()];
            let radius = 1.5 / (count as f32).sqrt() * (0.5 + random.next());
            let (centre, normal) = (centre.to_array(), normal.to_array());
            Splat { centre, radius, normal, colour, draw: 0, index }
        })
        .collect()
}

/// Rays from around the scene and from within, some along an axis, some of finite reach.
fn rays(count: u32) -> Vec<Ray> {
    let mut random = Random(17);
    (0..count)
        .map(|i| {
            let outside = random.vector().normalize_or(Vec3::X) * 3.0;
            let (origin, target) = if i % 2 == 0 {
                (outside, random.vector())
            } else {
                (random.vector() * 0.5, outside)
            };
            let direction = (target - origin).normalize_or(Vec3::X);
            let direction = if i % 31 == 0 { Vec3::NEG_Z } else { direction };
            let reach = if i % 3 == 0 { 2.0 * random.next() } else { f32::INFINITY };
            Ray { origin, direction, reach }
        })
        .collect()
}

fn input(splats: &[Splat]) -> SplatInput<'_> {
    SplatInput { splats, albedo: Albedo::AsIs, ..SplatInput::default() }
}

#[test]
fn rays_meet_the_same_blended_surfaces_as_on_the_cpu() {
    let (rays, counts) = (rays(9_600), [1, 7, 9, 65, 20_000]);
    let clouds: Vec<_> = counts.into_iter().map(splats).collect();
    let on_cpu = |splats: &Vec<Splat>| -> Vec<_> {
        let scene = Scene::new(input(splats));
        rays.iter().map(|ray| scene.hit(ray)).collect()
    };
    let wanted: Vec<_> = clouds.iter().map(on_cpu).collect();
    for gpu in gpus() {
        let kernels = SceneKernels::new(&gpu).unwrap();
        for (splats, wanted) in clouds.iter().zip(&wanted) {
            let on_gpu = kernels.scene(&gpu, &input(splats)).unwrap();
            let got = kernels.hits(&gpu, &on_gpu, &rays).unwrap();
            let (mut met, mut differ) = (0, 0);
            for (got, want) in got.iter().zip(wanted) {
                met += usize::from(want.is_some());
                differ += usize::from(!is_same(got.as_ref(), want.as_ref()));
            }
            let count = splats.len();
            println!("{}: {count} splats: {met} hits, {differ} differ", gpu.name);
            assert!(count < 100 || met > rays.len() / 4, "{met} hits");
            assert!(differ as f64 <= NEAR_TIES * rays.len() as f64, "{}: {differ}", gpu.name);
        }
    }
}

/// Whether two hits are equal within the rounding of both and of stored normals.
fn is_same(got: Option<&GpuHit>, want: Option<&Hit>) -> bool {
    match (got, want) {
        (Some(got), Some(want)) => {
            (got.distance - want.distance).abs() < 2e-4 * want.distance.max(0.1)
                && (got.normal - want.normal).length() < 5e-3
                && (got.lift - want.lift).abs() < 2e-3 * want.lift
                && (got.albedo - want.albedo).length() < 5e-3
        }
        (None, None) => true,
        _ => false,
    }
}

#[test]
fn rays_are_blocked_by_the_same_splats_as_on_the_cpu() {
    let (splats, rays) = (splats(5_000), rays(9_600));
    let scene = Scene::new(input(&splats));
    let want: Vec<_> = rays.iter().map(|ray| scene.is_blocked(ray)).collect();
    for gpu in gpus() {
        let kernels = SceneKernels::new(&gpu).unwrap();
        let on_gpu = kernels.scene(&gpu, &input(&splats)).unwrap();
        let got = kernels.blocked(&gpu, &on_gpu, &rays).unwrap();
        let differ = got.iter().zip(&want).filter(|(a, b)| a != b).count();
        println!("{}: {differ} of {} differ", gpu.name, rays.len());
        assert!(want.iter().any(|&b| b) && want.iter().any(|&b| !b));
        assert!(differ as f64 <= NEAR_TIES * rays.len() as f64, "{}: {differ}", gpu.name);
    }
}

#[test]
fn degenerate_scenes_have_trees_that_end() {
    let one = |centre: [f32; 3], radius: f32| Splat {
        centre,
        radius,
        normal: [0.0, 0.0, 1.0],
        colour: [0.5; 3],
        draw: 0,
        index: 0,
    };
    let coincident = vec![one([1.0, 2.0, 0.0], 0.5); 3000];
    let unusable = [one([f32::NAN, 0.0, 0.0], 1.0), one([0.0; 3], 0.0)];
    let rays = [Ray::new(Vec3::new(1.0, 2.0, 4.0), Vec3::NEG_Z), Ray::new(Vec3::ZERO, Vec3::X)];
    for gpu in gpus() {
        let kernels = SceneKernels::new(&gpu).unwrap();
        let scene = kernels.scene(&gpu, &input(&coincident)).unwrap();
        let hits = kernels.hits(&gpu, &scene, &rays).unwrap();
        let first = hits[0].unwrap();
        assert!((first.distance - 4.0).abs() < 1e-5 && (first.normal - Vec3::Z).length() < 1e-4);
        assert_eq!(hits[1], None);
        for splats in [&unusable[..], &[]] {
            let scene = kernels.scene(&gpu, &input(splats)).unwrap();
            assert_eq!(scene.splats(), 0);
            assert_eq!(kernels.hits(&gpu, &scene, &rays).unwrap(), [None, None]);
        }
    }
}
