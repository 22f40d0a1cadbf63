//! Times of the filters at 1024 x 768 as JSON, table 2 of `bauszat2011`: each filter and setting,
//! as wall time (best of the runs) and as CPU time of all threads (mean of the runs), milliseconds.
//!
//! `cargo run --release -p esker-trace --example filters -- [RUNS] [NAME]`

use esker_trace::Image;
use esker_trace::filter::{FilterKind, GuideKind, Guides, Settings, Workspace, filter_in};
use glam::Vec3;
use std::time::Instant;

const WIDTH: usize = 1024;
const HEIGHT: usize = 768;

/// A ball before a wall.
fn guides() -> Guides {
    let surface = |i: usize| {
        let x = (i % WIDTH) as f32 / 512.0 - 1.0;
        let y = (i / WIDTH) as f32 / 384.0 - 1.0;
        let height = 0.5 - x * x - y * y;
        if height > 0.0 {
            let normal = Vec3::new(x, -y, height.sqrt()).normalize_or_zero();
            Some((normal, 2.0 - height.sqrt()))
        } else {
            Some((Vec3::Z, 2.5 + 0.2 * x))
        }
    };
    let surfaces: Vec<_> = (0..WIDTH * HEIGHT).map(surface).collect();
    let occlusion = (0..WIDTH * HEIGHT).map(|i| (i % 97) as f32 / 97.0).collect();
    Guides::of_surfaces(WIDTH, HEIGHT, &surfaces, 4.0).with_occlusion(occlusion)
}

/// Light of which one sample in twenty carries all.
fn noisy() -> Image<3> {
    let mut image = Image::new(WIDTH, HEIGHT);
    let mut state = 1_u32;
    for value in image.planes.iter_mut().flatten() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = if state >> 8 < 838_861 { 10.0 } else { 0.0 };
    }
    image
}

/// CPU time of all threads, milliseconds; zero where the system does not tell.
fn cpu_ms() -> f64 {
    let read = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the name in brackets, user and system time are the 12th and 13th value, in hundredths
    // of a second.
    let values = read.rsplit(')').next().unwrap_or_default().split_whitespace();
    values.skip(11).take(2).filter_map(|value| value.parse::<f64>().ok()).sum::<f64>() * 10.0
}

fn settings() -> Vec<(&'static str, &'static [GuideKind], Settings)> {
    use GuideKind::{Depth, Normal, Occlusion};
    let guided = |radius| Settings { radius: Some(radius), ..Settings::of(FilterKind::Guided) };
    let scaled = |radius| Settings { is_noise_scaled: true, ..guided(radius) };
    let both: &[GuideKind] = &[Normal, Depth];
    let mut list = Vec::new();
    for radius in [8, 32] {
        list.push(("guided", &[Depth][..], guided(radius)));
        list.push(("guided", &[Normal], guided(radius)));
        list.push(("guided", both, guided(radius)));
        list.push(("guided", &[Normal, Depth, Occlusion], guided(radius)));
        list.push(("noise-scaled", both, scaled(radius)));
    }
    list.push(("nested", both, Settings::of(FilterKind::Nested)));
    for radius in [16, 24, 32] {
        let settings = Settings { radius: Some(radius), ..Settings::of(FilterKind::Bilateral) };
        list.push(("bilateral", both, settings));
    }
    for iterations in [4, 5, 6] {
        let settings = Settings { iterations, ..Settings::of(FilterKind::Atrous) };
        list.push(("atrous", both, settings.clone()));
        list.push(("atrous-colour", both, Settings { sigma_colour: 4.0, ..settings }));
    }
    list
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let runs: u32 = arguments.next().and_then(|runs| runs.parse().ok()).unwrap_or(5).max(1);
    let only = arguments.next();
    let (all, noisy) = (guides(), noisy());
    let mut workspace = Workspace::default();
    let mut rows = Vec::new();
    for (name, kinds, settings) in settings() {
        if only.as_ref().is_some_and(|only| only != name) {
            continue;
        }
        let guides = all.only(kinds);
        let mut run = || filter_in(&mut workspace, &noisy, &guides, 1, &settings);
        std::hint::black_box(run());
        let (before, mut wall) = (cpu_ms(), f64::INFINITY);
        for _ in 0..runs {
            let start = Instant::now();
            std::hint::black_box(run());
            wall = wall.min(start.elapsed().as_secs_f64() * 1e3);
        }
        rows.push(serde_json::json!({
            "filter": name,
            "guides": guides.planes.len(),
            "radius": settings.radius,
            "iterations": (settings.kind == FilterKind::Atrous).then_some(settings.iterations),
            "wall_ms": wall,
            "cpu_ms": (cpu_ms() - before) / f64::from(runs),
        }));
    }
    let rows: Vec<String> = rows.iter().map(|row| format!("  {row}")).collect();
    println!("{{\"rows\": [\n{}\n]}}", rows.join(",\n"));
}
