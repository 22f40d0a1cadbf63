//! Pictures traced on every adapter of the machine, with WebGPU's default limits, against the CPU's
//! tracer: both take the same numbers for all samples, so that pixels are compared one by one.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpus;

use esker_lod::View;
use esker_render::Splat;
use esker_trace::filter::{FilterKind, Settings};
use esker_trace::gpu::{GpuLightError, GpuTracer, SceneKernels, Unsupported};
use esker_trace::light::Panorama;
use esker_trace::scene::{Albedo, SplatInput};
use esker_trace::{
    Camera, Gloss, Image, Light, Lights, Options, PreparedLights, Scene, Sequence, Sky, Stats,
    Tracer,
};
use glam::{DVec3, Vec3};
use gpus::gpus;

/// A ball on a floor with a wall behind it.
fn splats() -> Vec<Splat> {
    let mut splats = Vec::new();
    let mut add = |centre: Vec3, normal: Vec3, radius: f32| {
        let index = splats.len() as u32;
        let tint = 0.3 + 0.5 * ((index * 7 % 11) as f32 / 10.0);
        splats.push(Splat {
            centre: centre.to_array(),
            radius,
            normal: normal.to_array(),
            colour: [tint, 0.5, 0.8 - 0.5 * tint],
            draw: 0,
            index,
        });
    };
    for i in 0..40 {
        for j in 0..40 {
            let (x, y) = (i as f32 * 0.1 - 2.0, j as f32 * 0.1 - 2.0);
            add(Vec3::new(x, y, 0.0), Vec3::Z, 0.1);
            if j < 20 {
                add(Vec3::new(x, 2.0, y + 2.0), Vec3::NEG_Y, 0.1);
            }
        }
    }
    for i in 0..1500 {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / 1500.0;
        let angle = i as f32 * 2.399_963;
        let flat = (1.0 - z * z).sqrt();
        let normal = Vec3::new(flat * angle.cos(), flat * angle.sin(), z);
        add(normal * 0.6 + Vec3::new(0.1, 0.2, 0.6), normal, 0.035);
    }
    splats
}

fn view(width: u32, height: u32) -> View {
    let eye = DVec3::new(0.7, -3.0, 1.6);
    View::look_at(eye, DVec3::new(0.0, 0.3, 0.6), DVec3::Z, 1.0, width, height)
}

fn camera(width: u32, height: u32) -> Camera {
    Camera::new(&view(width, height), DVec3::ZERO)
}

/// An image of the sky with a bright spot, and values that have no meaning.
fn panorama() -> Panorama {
    let pixel = |i: usize| match i {
        3 => [f32::NAN, 1.0, 1.0],
        9 => [-1.0, 0.5, 0.0],
        20 => [6.0, 5.0, 4.0],
        _ => [0.1 * (i % 5) as f32, 0.2, 0.3],
    };
    Panorama { width: 8, height: 5, pixels: (0..38).map(pixel).collect(), file: None }
}

/// One light of each kind that the kernels draw.
fn lights() -> Vec<Light> {
    vec![
        Light::Sun {
            azimuth_deg: 210.0,
            elevation_deg: 40.0,
            irradiance: [2.0, 1.8, 1.5],
            angular_diameter_deg: 5.0,
        },
        Light::Sky { sky: Sky::Constant([0.1, 0.15, 0.2]) },
        Light::Sky {
            sky: Sky::Gradient { zenith: [0.2, 0.3, 0.6], horizon: [0.5; 3], ground: [0.1; 3] },
        },
        Light::Point { position: [-1.0, -1.0, 1.5], intensity: [1.0, 0.6, 0.3] },
        Light::Spot {
            position: [1.5, -1.0, 2.5],
            direction: [-0.5, 0.4, -1.0],
            intensity: [3.0; 3],
            inner_angle_deg: 10.0,
            outer_angle_deg: 30.0,
        },
        Light::Area {
            corner: [-1.0, 1.5, 1.9],
            edges: [[0.0, 0.3, 0.0], [0.6, 0.0, 0.0]],
            radiance: [4.0, 4.0, 3.0],
            two_sided: false,
        },
    ]
}

fn prepared(lights: Vec<Light>) -> PreparedLights {
    Lights::from(lights).prepare(DVec3::ZERO)
}

fn input(splats: &[Splat]) -> SplatInput<'_> {
    SplatInput { splats, albedo: Albedo::AsIs, ..SplatInput::default() }
}

/// Number of pixels of two images that differ by more than a share of the mean.
fn differing(a: &Image<3>, b: &Image<3>, share: f32) -> usize {
    let mean = b.planes.iter().flatten().sum::<f32>() / (3 * b.len()) as f32;
    let off = |c: usize, i: usize| (a.planes[c][i] - b.planes[c][i]).abs();
    // A NaN differs.
    let differs = |i: usize| (0..3).any(|c| off(c, i) > share * mean || off(c, i).is_nan());
    assert_eq!(a.len(), b.len());
    (0..a.len()).filter(|&i| differs(i)).count()
}

#[test]
fn pictures_equal_those_of_the_cpu_but_for_near_ties() {
    let (mut splats, pinhole, lights) = (splats(), camera(40, 30), prepared(lights()));
    let parallel = view(40, 30).parallel(3.2, DVec3::splat(-2.0), DVec3::splat(2.0));
    let parallel = Camera::new(&parallel, DVec3::ZERO);
    // Half of the normals are stored to the other side.
    for splat in splats.iter_mut().filter(|splat| splat.centre[0] > 0.0) {
        splat.normal = splat.normal.map(|n| -n);
    }
    let scene = Scene::new(input(&splats));
    let options = |sequence, kind| Options {
        bounces: 2,
        sequence,
        seed: 7,
        filter: Settings::of(kind),
        ..Options::default()
    };
    // A single sample is looked up at the pixel itself.
    let all = [
        (pinhole, 3, options(Sequence::ZOrder, FilterKind::Nested)),
        (pinhole, 3, options(Sequence::Independent, FilterKind::None)),
        (pinhole, 1, options(Sequence::ZOrder, FilterKind::None)),
        (parallel, 3, options(Sequence::ZOrder, FilterKind::Nested)),
    ];
    let on_cpu = |(camera, samples, options): &(Camera, u32, Options)| {
        let mut tracer = Tracer::new(options.clone());
        assert!(tracer.trace(&scene, 1, &lights, camera, *samples, &|| false));
        (tracer.resolve(), tracer.incident(), tracer.stats())
    };
    let wanted: Vec<_> = all.iter().map(on_cpu).collect();
    for gpu in gpus() {
        let on_gpu = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let mut tracer = GpuTracer::new(&gpu, Options::default()).unwrap();
        for ((camera, samples, options), (want, incident, counted)) in all.iter().zip(&wanted) {
            tracer.clear();
            tracer.set_options(options.clone());
            assert!(tracer.trace(&gpu, &on_gpu, 1, &lights, camera, *samples, &|| false).unwrap());
            let got = tracer.resolve(&gpu).unwrap();
            let [r, g, b, _] = tracer.incident(&gpu).unwrap().planes;
            let traced = Image { width: camera.width, height: camera.height, planes: [r, g, b] };
            let deep = |d: &f32| if d.is_finite() { *d } else { 1e6 };
            let depths = got.depth.iter().zip(&want.depth);
            let depth = depths.filter(|(a, b)| (deep(a) - deep(b)).abs() > 1e-3 * deep(b)).count();
            let counts = [
                depth,
                differing(&traced, incident, 0.01),
                differing(&got.direct, &want.direct, 0.01),
                differing(&got.indirect, &want.indirect, 0.01),
                differing(&got.radiance, &want.radiance, 0.01),
            ];
            println!("{}: {:?}: {counts:?} of {}", gpu.name, options.sequence, traced.len());
            assert!(counts.iter().all(|&n| n <= 3), "{}: {counts:?}", gpu.name);
            let stats = tracer.stats(&gpu).unwrap();
            assert_eq!(stats.eye_rays, counted.eye_rays);
            let parts =
                |s: &Stats| [s.bounce_rays, s.shadow_rays, s.self_hits, s.escaped, s.without_guide];
            for (got, want) in parts(&stats).into_iter().zip(parts(counted)) {
                // A path that meets a rim within rounding goes another way.
                let is_near = got.abs_diff(want) <= 4 + want / 200;
                assert!(is_near, "{}: {stats:?}, {counted:?}", gpu.name);
            }
        }
    }
}

#[test]
fn the_eye_looks_through_the_backs_that_it_looks_through_on_the_cpu() {
    let (mut splats, camera, lights) = (splats(), camera(40, 30), prepared(lights()));
    // The wall shows its back.
    splats.iter_mut().for_each(|s| s.normal[1] = s.normal[1].abs());
    let culled = SplatInput { cull_back_faces: true, ..input(&splats) };
    let options = Options { filter: Settings::of(FilterKind::None), ..Options::default() };
    let on_cpu = |input: SplatInput<'_>| {
        let mut tracer = Tracer::new(options.clone());
        assert!(tracer.trace(&Scene::new(input), 1, &lights, &camera, 2, &|| false));
        tracer.resolve().radiance
    };
    let [open, want] = [input(&splats), culled].map(on_cpu);
    assert!(differing(&open, &want, 0.1) > open.len() / 10);
    for gpu in gpus() {
        let scene = SceneKernels::new(&gpu).unwrap().scene(&gpu, &culled).unwrap();
        let mut tracer = GpuTracer::new(&gpu, options.clone()).unwrap();
        assert!(tracer.trace(&gpu, &scene, 1, &lights, &camera, 2, &|| false).unwrap());
        let off = differing(&tracer.resolve(&gpu).unwrap().radiance, &want, 0.01);
        assert!(off <= 3, "{}: {off}", gpu.name);
    }
}

#[test]
fn a_picture_goes_on_where_it_stopped_and_begins_afresh_for_another_scene() {
    let (splats, camera, lights) = (splats(), camera(16, 12), prepared(lights()));
    let options = Options { filter: Settings::of(FilterKind::None), ..Options::default() };
    for gpu in gpus() {
        let scene = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let mut tracer = GpuTracer::new(&gpu, options.clone()).unwrap();
        let trace = |tracer: &mut GpuTracer, epoch, samples, stop: bool| {
            tracer.trace(&gpu, &scene, epoch, &lights, &camera, samples, &|| stop).unwrap()
        };
        assert!(trace(&mut tracer, 1, 4, false));
        let at_once = tracer.resolve(&gpu).unwrap();
        tracer.clear();
        assert!(!trace(&mut tracer, 1, 4, true));
        assert_eq!(tracer.samples(), 0);
        assert!(trace(&mut tracer, 1, 1, false) && trace(&mut tracer, 1, 3, false));
        assert_eq!(tracer.samples(), 4);
        assert_eq!(tracer.resolve(&gpu).unwrap(), at_once, "{}", gpu.name);
        assert!(trace(&mut tracer, 2, 1, false));
        assert_eq!(tracer.samples(), 1);
        assert!(tracer.bytes() > 0);
    }
}

#[test]
fn an_image_of_the_sky_and_many_lamps_light_as_on_the_cpu() {
    let (splats, camera) = (splats(), camera(40, 30));
    let scene = Scene::new(input(&splats));
    let lamp = |i: u32| {
        let angle = i as f64 * 0.3;
        let position = [1.5 * angle.cos(), 1.5 * angle.sin() - 0.5, 1.2];
        Light::Point { position, intensity: [0.1, 0.05 + 0.002 * i as f32, 0.1] }
    };
    let mut all: Vec<Light> = (0..40).map(lamp).collect();
    all.push(Light::Sky { sky: Sky::Image(panorama()) });
    all.push(Light::Sky { sky: Sky::Constant([0.05; 3]) });
    let lights = prepared(all);
    // The number that chooses a lamp is scaled up for each that was not chosen, so that rounding
    // decides in one path of some hundred. A filter would spread these.
    let filter = Settings::of(FilterKind::None);
    let options = Options { shows_sky: true, seed: 3, filter, ..Options::default() };
    let mut tracer = Tracer::new(options.clone());
    assert!(tracer.trace(&scene, 1, &lights, &camera, 2, &|| false));
    let want = tracer.resolve();
    for gpu in gpus() {
        let on_gpu = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let mut tracer = GpuTracer::new(&gpu, options.clone()).unwrap();
        assert!(tracer.trace(&gpu, &on_gpu, 1, &lights, &camera, 2, &|| false).unwrap());
        let got = tracer.resolve(&gpu).unwrap();
        let counts = [
            differing(&got.direct, &want.direct, 0.01),
            differing(&got.radiance, &want.radiance, 0.01),
        ];
        println!("{}: {counts:?} of {}", gpu.name, got.radiance.len());
        assert!(counts[0] <= 2 && counts[1] <= 12, "{}: {counts:?}", gpu.name);
    }
}

#[test]
fn light_of_the_last_picture_is_used_again_as_on_the_cpu() {
    let (splats, lights) = (splats(), prepared(lights()));
    let scene = Scene::new(input(&splats));
    let at = |x: f64| {
        let eye = DVec3::new(x, -3.0, 1.6);
        let view = View::look_at(eye, DVec3::new(0.0, 0.3, 0.6), DVec3::Z, 1.0, 40, 30);
        Camera::new(&view, DVec3::ZERO)
    };
    let options = Options { filter: Settings::of(FilterKind::None), ..Options::default() };
    // Two samples, moved a little, and moved again so that the past has a past.
    let steps = [(at(0.7), 2), (at(0.75), 1), (at(0.6), 1)];
    let mut tracer = Tracer::new(options.clone());
    let on_cpu = steps.map(|(camera, samples)| {
        assert!(tracer.trace(&scene, 1, &lights, &camera, samples, &|| false));
        tracer.incident()
    });
    let mut afresh = Tracer::new(Options { reprojects: false, ..options.clone() });
    assert!(afresh.trace(&scene, 1, &lights, &steps[2].0, 1, &|| false));
    let noisy = differing(&afresh.incident(), &on_cpu[2], 0.01);
    assert!(noisy > 400, "light is used again at many pixels, not {noisy}");
    for gpu in gpus() {
        let on_gpu = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let mut tracer = GpuTracer::new(&gpu, options.clone()).unwrap();
        for part_bytes in [u64::MAX, 8 * 40 * 112] {
            tracer.set_part_bytes(part_bytes);
            for ((camera, samples), want) in steps.iter().zip(&on_cpu) {
                tracer.trace(&gpu, &on_gpu, 1, &lights, camera, *samples, &|| false).unwrap();
                let [r, g, b, _] = tracer.incident(&gpu).unwrap().planes;
                let got = Image { width: 40, height: 30, planes: [r, g, b] };
                let count = differing(&got, want, 0.01);
                println!("{}: {part_bytes}: {count} of {}", gpu.name, got.len());
                assert!(count <= 3, "{}: {count}", gpu.name);
            }
        }
    }
}

#[test]
fn a_picture_in_parts_is_the_same() {
    let (splats, camera, lights) = (splats(), camera(20, 27), prepared(lights()));
    let options = Options { bounces: 1, ..Options::default() };
    for gpu in gpus() {
        let scene = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let picture = |part_bytes: Option<u64>| {
            let mut tracer = GpuTracer::new(&gpu, options.clone()).unwrap();
            part_bytes.into_iter().for_each(|bytes| tracer.set_part_bytes(bytes));
            // The second call goes on with the same buffers, the third begins in them afresh.
            for (epoch, samples) in [(1, 1), (1, 2), (2, 3)] {
                tracer.trace(&gpu, &scene, epoch, &lights, &camera, samples, &|| false).unwrap();
            }
            tracer.resolve(&gpu).unwrap()
        };
        let at_once = picture(None);
        assert!(at_once.coverage.iter().any(|&covered| covered > 0.0));
        for part_bytes in [1, 16 * 20 * 112] {
            assert_eq!(picture(Some(part_bytes)), at_once, "{}: {part_bytes}", gpu.name);
        }
    }
}

#[test]
fn what_the_kernels_do_not_draw_is_refused() {
    let (splats, camera) = (splats(), camera(8, 8));
    for gpu in gpus() {
        let scene = SceneKernels::new(&gpu).unwrap().scene(&gpu, &input(&splats)).unwrap();
        let refusal = |options: Options, lights: Vec<Light>| {
            let mut tracer = GpuTracer::new(&gpu, options).unwrap();
            match tracer.trace(&gpu, &scene, 1, &prepared(lights), &camera, 1, &|| false) {
                Err(GpuLightError::Unsupported(why)) => Some(why),
                other => panic!("{other:?}"),
            }
        };
        let gloss = Some(Gloss { reflectance: 0.04, roughness: 0.5 });
        let glossy = Options { gloss, ..Options::default() };
        assert_eq!(refusal(glossy, Vec::new()), Some(Unsupported::Gloss));
        let many = {
            let mut tracer = GpuTracer::new(&gpu, Options::default()).unwrap();
            let lights = prepared(Vec::new());
            tracer.trace(&gpu, &scene, 1, &lights, &camera, 1025, &|| true)
        };
        assert!(matches!(many, Err(GpuLightError::Unsupported(Unsupported::Samples))));
        let image = || Light::Sky { sky: Sky::Image(panorama()) };
        let two = vec![image(), image()];
        assert_eq!(refusal(Options::default(), two), Some(Unsupported::Panorama));
    }
}
