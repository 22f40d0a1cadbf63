//! Pictures and guides for the tests of filters, and the regression by brute force that they are
//! compared with.

#![allow(dead_code, reason = "each test file uses some of them")]

use esker_trace::Image;
use esker_trace::filter::{GuideKind, Guides, Settings};
use glam::Vec3;

/// A linear congruential generator (Knuth, MMIX).
pub struct Lcg(pub u64);

impl Lcg {
    /// A number in [0, 1).
    pub fn next(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Smooth guides with steps, and a few misses.
pub fn guides_of(width: usize, height: usize, planes: usize, random: &mut Lcg) -> Guides {
    let mut kinds = vec![GuideKind::Normal; planes];
    for (k, kind) in kinds.iter_mut().enumerate() {
        match k {
            3 => *kind = GuideKind::Depth,
            4 => *kind = GuideKind::Occlusion,
            _ => {}
        }
    }
    let plane = |k: usize, random: &mut Lcg| {
        let (a, b, step) = (random.next(), random.next(), random.next());
        let value = |i: usize| {
            let (x, y) = ((i % width) as f64 / 40.0, (i / width) as f64 / 40.0);
            let smooth = 0.5 + 0.3 * (a * 5.0 * x + b * 7.0 * y + k as f64).sin();
            (smooth + if x > step { 0.2 } else { 0.0 }) as f32
        };
        (0..width * height).map(value).collect()
    };
    let planes = (0..planes).map(|k| plane(k, random)).collect();
    let is_hit = (0..width * height).map(|_| random.next() > 0.05).collect();
    Guides { width, height, planes, kinds, is_hit }
}

/// Values of 0 to 1, and fireflies of `firefly` in one of 2000.
pub fn noisy_of(width: usize, height: usize, firefly: f32, random: &mut Lcg) -> Image<3> {
    let mut image = Image::new(width, height);
    for i in 0..width * height {
        let scale = if random.next() < 0.0005 { firefly } else { 1.0 };
        for plane in &mut image.planes {
            plane[i] = random.next() as f32 * scale;
        }
    }
    image
}

/// A ball on a floor before a wall, seen along a slanted direction: guides, and the smooth light
/// that falls on them.
pub fn ball(width: usize, height: usize) -> (Guides, Image<3>) {
    let mut surfaces = Vec::new();
    let mut light = Image::new(width, height);
    for i in 0..width * height {
        let x = ((i % width) as f32 + 0.5) / width as f32 * 2.0 - 1.0;
        let y = ((i / width) as f32 + 0.5) / height as f32 * 2.0 - 1.0;
        let radius = (x * x + y * y).sqrt() / 0.5;
        let (normal, depth) = if radius < 1.0 {
            let z = (1.0 - radius * radius).sqrt();
            (Vec3::new(x / 0.5, -y / 0.5, z), 2.0 - 0.5 * z)
        } else if y > 0.3 {
            (Vec3::new(0.0, 0.9, 0.435_89), 2.6 - y)
        } else {
            (Vec3::Z, 2.3)
        };
        surfaces.push((y > -0.95).then_some((normal, depth)));
        let fade = 1.0 - 0.3 * (-(radius - 1.0).max(0.0) * 4.0).exp();
        let colour = [0.6 + 0.3 * normal.y, 0.5 + 0.2 * normal.x, 0.4 + 0.1 * normal.z];
        for (plane, colour) in light.planes.iter_mut().zip(colour) {
            plane[i] = if y > -0.95 { colour * fade * (1.0 + 0.2 * x) } else { 0.1 };
        }
    }
    (Guides::of_surfaces(width, height, &surfaces, 4.0), light)
}

/// One in so many samples is bright.
const RARE: f64 = 20.0;

/// Noise of path tracing with `samples` a pixel: most samples are black, few are bright, and the
/// mean is `light`. If `is_spread`, bright samples are spread evenly over squares of four pixels,
/// so that the errors of neighbours cancel.
pub fn traced(light: &Image<3>, samples: u32, is_spread: bool, random: &mut Lcg) -> Image<3> {
    let mut out = Image::new(light.width, light.height);
    let squares = (light.width.div_ceil(4) * light.height.div_ceil(4)).max(1);
    for _ in 0..samples {
        let starts: Vec<f64> = (0..squares).map(|_| random.next()).collect();
        for i in 0..light.len() {
            let (x, y) = (i % light.width, i / light.width);
            let order = (x % 4 * 7 + y % 4 * 3) % 16;
            let square = y / 4 * light.width.div_ceil(4) + x / 4;
            let number = if is_spread {
                (starts[square] + (order as f64 + random.next()) / 16.0).fract()
            } else {
                random.next()
            };
            if number < 1.0 / RARE {
                // Exponentially distributed, of mean one.
                let bright = -(1.0 - random.next()).ln() * RARE / f64::from(samples);
                for (out, light) in out.planes.iter_mut().zip(&light.planes) {
                    out[i] += light[i] * bright as f32;
                }
            }
        }
    }
    out
}

/// Mean square of the difference over pixels with a hit.
pub fn mean_square(image: &Image<3>, light: &Image<3>, guides: &Guides) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (plane, light) in image.planes.iter().zip(&light.planes) {
        for i in (0..plane.len()).filter(|&i| guides.is_hit[i]) {
            sum += f64::from(plane[i] - light[i]).powi(2);
            count += 1.0;
        }
    }
    sum / f64::max(count, 1.0)
}

/// Solves a small system by elimination with pivots.
fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for i in 0..n {
        let pivot = (i..n).max_by(|&p, &q| a[p][i].abs().total_cmp(&a[q][i].abs())).unwrap_or(i);
        a.swap(i, pivot);
        b.swap(i, pivot);
        for j in i + 1..n {
            let factor = a[j][i] / a[i][i];
            let row = a[i].clone();
            a[j].iter_mut().zip(&row).skip(i).for_each(|(to, from)| *to -= factor * from);
            b[j] -= factor * b[i];
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] -= a[i][j] * b[j];
        }
        b[i] /= a[i][i];
    }
    b
}

/// The guided filter by brute force: covariances about the mean, window by window. A fourth plane
/// holds the mean magnitude in the windows that cover a pixel, which errors are relative to.
pub fn reference(
    noisy: &Image<3>,
    guides: &Guides,
    radius: usize,
    settings: &Settings,
) -> [Vec<f64>; 4] {
    let (w, h, planes) = (noisy.width, noisy.height, guides.planes.len());
    let window = |c: usize, length: usize| c.saturating_sub(radius)..(c + radius + 1).min(length);
    let mut sums = [(); 4].map(|()| vec![0.0; w * h]);
    let mut counts = vec![0.0; w * h];
    for centre in 0..w * h {
        let pixels: Vec<usize> = window(centre / w, h)
            .flat_map(|y| window(centre % w, w).map(move |x| y * w + x))
            .filter(|&i| guides.is_hit[i])
            .collect();
        if pixels.is_empty() {
            continue;
        }
        let n = pixels.len() as f64;
        let mean = |v: &dyn Fn(usize) -> f64| pixels.iter().map(|&i| v(i)).sum::<f64>() / n;
        let guide = |k: usize, i: usize| f64::from(guides.planes[k][i]);
        let centres: Vec<f64> = (0..planes).map(|k| mean(&|i| guide(k, i))).collect();
        let mut matrix = vec![vec![0.0; planes]; planes];
        for (k, row) in matrix.iter_mut().enumerate() {
            for (l, value) in row.iter_mut().enumerate() {
                *value = mean(&|i| (guide(k, i) - centres[k]) * (guide(l, i) - centres[l]));
            }
            row[k] += f64::from(match guides.kinds[k] {
                GuideKind::Normal => settings.epsilon_normal,
                _ => settings.epsilon_depth,
            });
        }
        for (plane, sums) in noisy.planes.iter().zip(&mut sums) {
            let value = mean(&|i| f64::from(plane[i]));
            let right =
                |k: usize| mean(&|i| (guide(k, i) - centres[k]) * (f64::from(plane[i]) - value));
            let slopes = solve(matrix.clone(), (0..planes).map(right).collect());
            for &i in &pixels {
                let fit = |k: usize| slopes[k] * (guide(k, i) - centres[k]);
                sums[i] += value + (0..planes).map(fit).sum::<f64>();
            }
        }
        let magnitude = mean(&|i| f64::from(noisy.planes.iter().map(|p| p[i].abs()).sum::<f32>()));
        for &i in &pixels {
            sums[3][i] += magnitude / 3.0;
            counts[i] += 1.0;
        }
    }
    for (sums, plane) in sums.iter_mut().zip(noisy.planes.iter().chain([&noisy.planes[0]])) {
        for i in 0..w * h {
            sums[i] = if guides.is_hit[i] { sums[i] / counts[i] } else { f64::from(plane[i]) };
        }
    }
    sums
}
