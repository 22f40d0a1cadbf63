//! The filters on every adapter of the machine, with WebGPU's default limits, against references in
//! `f64`: brute-force regressions of each window, and direct sums of weights.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

mod gpus;

use esker_render::gpu::Gpu;
use esker_render::gpu::wgpu::ComputePass;
use esker_trace::Image;
use esker_trace::filter::{FilterKind, GuideKind, Guides, Settings, filter};
use esker_trace::gpu::Pixels;
use esker_trace::gpu::filter::{FilterPictures, Guided, GuidedSettings, LightFilter};
use gpus::gpus;

/// A picture for the filters: guides (normal from 0 to 1, and depth), and light with 1 where there
/// is a surface.
struct Scene {
    width: usize,
    height: usize,
    guides: Vec<[f32; 4]>,
    light: Vec<[f32; 4]>,
}

/// Numbers from 0 to 1, the same in every run.
fn noise(seed: u32) -> f32 {
    let mut x = seed.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    x = (x ^ (x >> 16)).wrapping_mul(0x21f0_aaad);
    x = (x ^ (x >> 15)).wrapping_mul(0x735a_2d97);
    ((x ^ (x >> 15)) >> 8) as f32 / (1 << 24) as f32
}

impl Scene {
    /// A ball before a wall with a corner, a border without surface, and noisy light.
    fn new(width: usize, height: usize) -> Self {
        let (mut guides, mut light) = (Vec::new(), Vec::new());
        for i in 0..width * height {
            let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
            let (dx, dy) = (x - 0.4, y - 0.5);
            let inside = 0.09 - dx * dx - dy * dy;
            let (normal, depth) = if inside > 0.0 {
                let z = inside.sqrt();
                ([dx / 0.3, dy / 0.3, z / 0.3], 0.5 - z)
            } else if x > 0.7 {
                ([-1.0, 0.0, 0.0], 0.8 - 0.5 * (x - 0.7))
            } else {
                ([0.0, 0.0, 1.0], 0.8)
            };
            let [a, b, c] = normal.map(|n: f32| n * 0.5 + 0.5);
            guides.push([a, b, c, depth]);
            let surface = if y < 0.06 && x < 0.9 { 0.0 } else { 1.0 };
            let bright = 0.2 + 0.6 * c + 0.3 * depth;
            let sample = |k: u32| bright * 2.0 * noise(7 * i as u32 + k);
            light.push([sample(0), sample(1), sample(2), surface]);
        }
        Self { width, height, guides, light }
    }

    fn is_usable(&self, i: usize) -> bool {
        self.light[i][3] > 0.0 && self.light[i][..3].iter().all(|v| v.is_finite())
    }

    /// Pixels within `radius` of pixel `i`, in both axes.
    fn window(&self, i: usize, radius: usize) -> impl Iterator<Item = usize> + use<> {
        let (w, h, x, y) = (self.width, self.height, i % self.width, i / self.width);
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(w);
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(h);
        rows.flat_map(move |y| columns.clone().map(move |x| y * w + x))
    }

    /// Runs `run` between the upload of the scene and the download of the result.
    fn on(&self, gpu: &Gpu, run: impl FnOnce(&FilterPictures<'_>)) -> Vec<[f32; 4]> {
        let pixels =
            |label| Pixels::new(gpu, label, self.width as u32, self.height as u32).unwrap();
        let (guides, light, out) = (pixels("guides"), pixels("light"), pixels("out"));
        guides.write(gpu, &self.guides);
        light.write(gpu, &self.light);
        run(&FilterPictures { guides: &guides, light: &light, out: &out });
        let image = out.read(gpu).unwrap();
        assert!(gpu.fault().is_none(), "{:?}", gpu.fault());
        (0..image.len()).map(|i| image.at(i % self.width, i / self.width)).collect()
    }
}

/// Encodes and submits a filter.
fn submit(gpu: &Gpu, encode: impl FnOnce(&mut ComputePass<'_>)) {
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encode(&mut encoder.begin_compute_pass(&Default::default()));
    gpu.queue.submit([encoder.finish()]);
}

/// Solves `a x = b` by elimination; `a` is positive definite.
#[allow(clippy::needless_range_loop, reason = "two rows of the same matrix")]
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for j in 0..n {
        for i in j + 1..n {
            let part = a[i][j] / a[j][j];
            for k in j..n {
                a[i][k] -= part * a[j][k];
            }
            b[i] -= part * b[j];
        }
    }
    for i in (0..n).rev() {
        for k in i + 1..n {
            b[i] -= a[i][k] * b[k];
        }
        b[i] /= a[i][i];
    }
    b
}

fn luminance(c: [f64; 3]) -> f64 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// The regression of a window: slopes by channel, mean guides and mean light.
type Fit = ([Vec<f64>; 3], Vec<f64>, [f64; 3]);

/// The guided filter by a centred regression of each window.
struct BruteForce<'a> {
    scene: &'a Scene,
    /// Guides that are used.
    used: &'a [usize],
    settings: GuidedSettings,
}

impl BruteForce<'_> {
    fn guide(&self, i: usize) -> Vec<f64> {
        self.used.iter().map(|&c| f64::from(self.scene.guides[i][c])).collect()
    }

    fn light(&self, i: usize) -> [f64; 3] {
        std::array::from_fn(|c| f64::from(self.scene.light[i][c]))
    }

    fn radius(&self) -> usize {
        self.settings.radius as usize
    }

    /// The regression of a window; `None` if it has no usable pixel.
    fn fit(&self, centre: usize) -> Option<Fit> {
        let n = self.used.len();
        let window = self.scene.window(centre, self.radius());
        let all: Vec<usize> = window.filter(|&i| self.scene.is_usable(i)).collect();
        let share = (!all.is_empty()).then(|| 1.0 / all.len() as f64)?;
        let (mut mean_light, mut mean) = ([0.0; 3], vec![0.0; n]);
        for &i in &all {
            (0..3).for_each(|c| mean_light[c] += self.light(i)[c] * share);
            (0..n).for_each(|k| mean[k] += self.guide(i)[k] * share);
        }
        let centre = |i: usize| self.guide(i).iter().zip(&mean).map(|(g, m)| g - m).collect();
        let centred: Vec<Vec<f64>> = all.iter().map(|&i| centre(i)).collect();
        let bright = luminance(mean_light);
        let variance: f64 = all.iter().map(|&i| (luminance(self.light(i)) - bright).powi(2)).sum();
        let noise = variance * share * share / (bright * bright);
        let mut covariance = vec![vec![0.0; n]; n];
        for (j, row) in covariance.iter_mut().enumerate() {
            for (k, value) in row.iter_mut().enumerate() {
                *value = centred.iter().map(|g| g[j] * g[k]).sum::<f64>() * share;
            }
            let epsilon = f64::from(self.settings.epsilon[j]);
            row[j] += epsilon + f64::from(self.settings.noise[j]) * noise;
        }
        let slopes = std::array::from_fn(|c| {
            let with_light = |k: usize| -> f64 {
                let each = all.iter().zip(&centred);
                each.map(|(&i, g)| g[k] * (self.light(i)[c] - mean_light[c])).sum::<f64>() * share
            };
            solve(covariance.clone(), (0..n).map(with_light).collect())
        });
        Some((slopes, mean, mean_light))
    }

    /// The filtered picture.
    fn run(&self) -> Vec<[f64; 3]> {
        let fits: Vec<_> = (0..self.scene.light.len()).map(|i| self.fit(i)).collect();
        let value = |i: usize| {
            if !self.scene.is_usable(i) {
                return self.light(i).map(|v| if v.is_finite() { v } else { 0.0 });
            }
            let window = self.scene.window(i, self.radius());
            let windows: Vec<_> = window.filter_map(|j| fits[j].as_ref()).collect();
            let guide = self.guide(i);
            std::array::from_fn(|c| {
                let at = |(slopes, mean, light): &&Fit| {
                    let steps = guide.iter().zip(mean).map(|(g, m)| g - m);
                    light[c] + steps.zip(&slopes[c]).map(|(d, a)| d * a).sum::<f64>()
                };
                windows.iter().map(at).sum::<f64>() / windows.len() as f64
            })
        };
        (0..self.scene.light.len()).map(value).collect()
    }
}

/// Greatest difference of a result from a reference, over the greatest reference.
fn error(result: &[[f32; 4]], reference: &[[f64; 3]]) -> f64 {
    let scale = reference.iter().flatten().fold(0.0, |a: f64, b| a.max(b.abs()));
    let pairs = result.iter().zip(reference);
    let each = pairs.flat_map(|(a, b)| (0..3).map(|c| (f64::from(a[c]) - b[c]).abs()));
    // NaN counts as infinite.
    each.map(|e| if e.is_nan() { f64::INFINITY } else { e }).fold(0.0, f64::max) / scale
}

fn run_guided(
    gpu: &Gpu,
    kernels: &Guided,
    scene: &Scene,
    settings: GuidedSettings,
) -> Vec<[f32; 4]> {
    scene.on(gpu, |pictures| {
        let plan = kernels.plan(gpu, pictures, settings).unwrap();
        submit(gpu, |pass| plan.run(pass));
    })
}

/// Guides that each number of guides uses.
fn used(guides: u32) -> &'static [usize] {
    match guides {
        1 => &[3],
        3 => &[0, 1, 2],
        _ => &[0, 1, 2, 3],
    }
}

/// Settings for a number of guides.
fn settings(guides: u32, radius: u32, normal: f32, depth: f32, noise: f32) -> GuidedSettings {
    let four = [normal, normal, normal, depth];
    let epsilon = if guides == 1 { [depth; 4] } else { four };
    GuidedSettings { radius, epsilon, noise: [noise; 4] }
}

#[test]
fn guided_filter_equals_a_brute_force_regression_for_one_three_and_four_guides() {
    let mut scene = Scene::new(67, 45);
    scene.light[700][1] = f32::NAN;
    scene.light[1201][0] = f32::INFINITY;
    for (guides, radius, noise) in [(1, 8, 0.0), (3, 5, 0.0), (4, 8, 0.0), (4, 11, 0.25)] {
        let settings = settings(guides, radius, 0.01, 0.02, noise);
        let reference = BruteForce { scene: &scene, used: used(guides), settings }.run();
        for gpu in gpus() {
            let kernels = Guided::new(&gpu, guides).unwrap();
            let error = error(&run_guided(&gpu, &kernels, &scene, settings), &reference);
            println!("{}: {guides} guides, radius {radius}: {error:.1e}", gpu.name);
            assert!(error < 1e-5, "{}: {guides} guides, radius {radius}: {error:.1e}", gpu.name);
        }
    }
}

#[test]
fn guided_filter_holds_at_its_least_epsilon_and_clamps_smaller_ones() {
    let scene = Scene::new(48, 33);
    let least = settings(4, 6, 1e-4, 1e-4, 0.0);
    assert_eq!(settings(4, 6, 1e-8, f32::NAN, 0.0).clamped(), least);
    let reference = BruteForce { scene: &scene, used: used(4), settings: least }.run();
    for gpu in gpus() {
        let kernels = Guided::new(&gpu, 4).unwrap();
        let smaller = settings(4, 6, 1e-8, 0.0, 0.0);
        let error = error(&run_guided(&gpu, &kernels, &scene, smaller), &reference);
        println!("{}: {error:.1e}", gpu.name);
        assert!(error < 1e-4, "{}: {error:.1e}", gpu.name);
    }
}

#[test]
fn a_firefly_leaves_no_error_in_windows_that_it_is_not_in() {
    let mut scene = Scene::new(160, 12);
    scene.light.fill([1.0; 4]);
    scene.light[5 * 160 + 80] = [1e6, 1e6, 1e6, 1.0];
    for gpu in gpus() {
        let kernels = Guided::new(&gpu, 4).unwrap();
        let result = run_guided(&gpu, &kernels, &scene, settings(4, 9, 0.01, 0.02, 0.0));
        for (i, value) in result.iter().enumerate().filter(|(i, _)| (i % 160).abs_diff(80) > 18) {
            assert!((value[1] - 1.0).abs() < 1e-5, "{}: pixel {i} is {value:?}", gpu.name);
        }
    }
}

#[test]
fn guided_filter_takes_pictures_of_any_shape() {
    let settings = settings(4, 12, 0.01, 0.02, 0.0);
    let scenes = [(1, 1), (1, 9), (19, 1), (5, 4), (33, 17)].map(|(w, h)| Scene::new(w, h));
    let reference = |scene| BruteForce { scene, used: used(4), settings }.run();
    let references = scenes.each_ref().map(reference);
    for gpu in gpus() {
        let kernels = Guided::new(&gpu, 4).unwrap();
        for (scene, reference) in scenes.iter().zip(&references) {
            let error = error(&run_guided(&gpu, &kernels, scene, settings), reference);
            let (width, height) = (scene.width, scene.height);
            assert!(error < 1e-5, "{}: {width} x {height}: {error:.1e}", gpu.name);
        }
    }
}

/// The filter of the CPU.
fn on_cpu(scene: &Scene, samples: u32, settings: &Settings) -> Vec<[f64; 3]> {
    let (width, height) = (scene.width, scene.height);
    let plane = |values: &[[f32; 4]], c: usize| values.iter().map(|v| v[c]).collect::<Vec<f32>>();
    let light = std::array::from_fn(|c| plane(&scene.light, c));
    let guides = Guides {
        width,
        height,
        planes: (0..4).map(|c| plane(&scene.guides, c)).collect(),
        kinds: [GuideKind::Normal; 3].into_iter().chain([GuideKind::Depth]).collect(),
        is_hit: scene.light.iter().map(|v| v[3] > 0.0).collect(),
    };
    let out = filter(&Image { width, height, planes: light }, &guides, samples, settings);
    (0..width * height).map(|i| out.at(i % width, i / width).map(f64::from)).collect()
}

#[test]
fn every_filter_equals_its_twin_on_the_cpu() {
    let mut scene = Scene::new(80, 60);
    scene.light[700][1] = f32::NAN;
    scene.light[1201][0] = f32::INFINITY;
    let mut noisy = Scene::new(80, 60);
    for (i, guide) in noisy.guides.iter_mut().enumerate() {
        (0..3).for_each(|c| guide[c] += 0.1 * (noise((9 * i + c) as u32) - 0.5));
    }
    let of = |kind, radius| Settings { radius: Some(radius), ..Settings::of(kind) };
    let scaled = Settings { is_noise_scaled: true, ..of(FilterKind::Guided, 10) };
    let all = [
        (of(FilterKind::Guided, 8), 1e-5),
        (scaled, 1e-5),
        (of(FilterKind::Nested, 0), 1e-4),
        (of(FilterKind::Bilateral, 5), 1e-5),
        (Settings { iterations: 4, ..of(FilterKind::Atrous, 0) }, 1e-5),
    ];
    for (scene, what) in [(&scene, "clean"), (&noisy, "noisy normals")] {
        let want: Vec<_> = all.iter().map(|(settings, _)| on_cpu(scene, 1, settings)).collect();
        for gpu in gpus() {
            let mut kernels = LightFilter::default();
            for ((settings, limit), want) in all.iter().zip(&want) {
                let got = scene.on(&gpu, |pictures| {
                    let prepared = kernels.prepare(&gpu, pictures, settings).unwrap();
                    let plan = kernels.plan(&gpu, pictures, &prepared, 1, settings).unwrap();
                    submit(&gpu, |pass| plan.run(pass));
                });
                let error = error(&got, want);
                println!("{}: {what}, {:?}: {error:.1e}", gpu.name, settings.kind);
                assert!(error < *limit, "{}: {:?}: {error:.1e}", gpu.name, settings.kind);
            }
        }
    }
}
