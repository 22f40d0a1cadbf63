//! Exposure compensation: a darker and a brighter scan of one wall are drawn without a seam or
//! speckles, the texture of the wall is kept, and nothing changes across an edge of depth.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::picture::pyramid::Pyramid;
use esker_render::{Frame, FramePlan, Renderer};
use glam::{DVec3, Vec4};
use scene::{Dice, Scene, ScenePoint};

const SIDE: u32 = 256;
/// Width of the wall, pixels.
const WALL_PX: f64 = 200.0;
/// Exposures of the two scans.
const GAINS: [f64; 2] = [0.7, 1.3];

fn view() -> View {
    View::look_at(DVec3::NEG_Y * 20.0, DVec3::ZERO, DVec3::Z, 0.11, SIDE, SIDE)
}

/// Width of a pixel at the wall, metres.
fn pixel() -> f64 {
    20.0 / view().focal_px()
}

/// Linear light of the wall, of mean 0.3: stripes six pixels wide, and slow vertical waves.
fn texture(x: f64, z: f64) -> f64 {
    let stripes = (x / (6.0 * pixel()) * std::f64::consts::PI).sin();
    0.3 + 0.1 * stripes + 0.05 * (z / (60.0 * pixel())).cos()
}

/// A wall at depth `depth` with `density` points a pixel. `scan` chooses the scan of a point from
/// its place (pixels), `light` gives its linear light from scan and place (metres). The lowest bit
/// of blue holds the scan.
fn wall(
    dice: &mut Dice,
    depth: f64,
    density: f64,
    scan: impl Fn(&mut Dice, f64) -> usize,
    light: impl Fn(usize, f64, f64) -> f64,
) -> Vec<ScenePoint> {
    let side = (WALL_PX * density.sqrt()) as usize;
    (0..side * side)
        .map(|i| {
            let mut at = |k: usize| ((k as f64 + dice.unit()) / side as f64 - 0.5) * WALL_PX;
            let [x, z] = [at(i % side), at(i / side)];
            let scan = scan(dice, x);
            let light = light(scan, x * pixel(), z * pixel());
            let byte = (srgb(light) * 255.0).round() as u8;
            let at = DVec3::new(x * pixel(), depth, z * pixel());
            let colour = [byte, byte, byte & 0xfe | scan as u8];
            ScenePoint { at, normal: DVec3::NEG_Y, colour }
        })
        .collect()
}

fn srgb(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// A scene of `points`; the fourth byte of a colour holds the number of its scan.
fn scene(points: &[ScenePoint], density: f64) -> Scene {
    let spacing = pixel() / density.sqrt();
    let mut scene = Scene::new(points, 1e-5, spacing, spacing, 5000);
    for colour in scene.nodes.iter_mut().flat_map(|n| n.colour.as_chunks_mut::<4>().0) {
        colour[3] = 40 + (colour[2] & 1);
    }
    scene
}

/// Red (linear light) and scan of each pixel that a point won, with or without exposure
/// compensation.
fn lights(scene: &Scene, evens_exposure: bool, normals: bool) -> Vec<Option<(f64, usize)>> {
    let view = view();
    let draws = scene.draws(true, true, normals);
    let frame = Frame { evens_exposure, averages: false, ..scene.frame(&view, &draws) };
    assert_eq!(FramePlan::new(&frame).evens_exposure(), evens_exposure);
    let mut pyramid = Pyramid::default();
    let mut renderer = Renderer::default();
    renderer.base_level(&frame, &mut pyramid).unwrap();
    let plain = Frame { evens_exposure: false, ..frame };
    let mut untouched = Pyramid::default();
    renderer.base_level(&plain, &mut untouched).unwrap();
    let base = &pyramid.levels[0];
    let scan = |tint: Vec4| {
        let blue = srgb(f64::from(tint.z)) * 255.0;
        blue.round() as usize & 1
    };
    let all = base.tint.iter().zip(&untouched.levels[0].tint).enumerate();
    all.map(|(i, (tint, own))| base.is_valid(i).then(|| (f64::from(tint.x), scan(*own)))).collect()
}

/// Mean square difference of vertically adjacent pixels over the square of the mean light: of pairs
/// of one scan, and of pairs of two scans.
fn roughness(lights: &[Option<(f64, usize)>]) -> [f64; 2] {
    let (mut sums, mut counts, mut all) = ([0.0; 2], [0.0; 2], (0.0, 0.0));
    let pairs = lights.iter().zip(&lights[SIDE as usize..]);
    for ((a, scan), (b, other)) in pairs.filter_map(|(a, b)| a.as_ref().zip(b.as_ref())) {
        let kind = usize::from(scan != other);
        sums[kind] += (a - b).powi(2);
        counts[kind] += 1.0;
        all = (all.0 + a, all.1 + 1.0);
    }
    assert!(counts.into_iter().all(|count| count > 100.0), "{counts:?}");
    [0, 1].map(|kind| sums[kind] / counts[kind] / (all.0 / all.1).powi(2))
}

/// Contrast of the stripes in the picture, relative to their contrast on the wall.
fn contrast(lights: &[Option<(f64, usize)>], columns: std::ops::Range<usize>) -> f64 {
    let (mut along, mut mean, mut count, mut squares) = (0.0, 0.0, 0.0, 0.0);
    for (i, (light, _)) in lights.iter().enumerate().filter_map(|(i, l)| Some((i, (*l)?))) {
        let column = i % SIDE as usize;
        if !columns.contains(&column) {
            continue;
        }
        let x = (column as f64 + 0.5 - f64::from(SIDE) / 2.0) * pixel();
        let stripe = (texture(x, 0.0) - texture(0.0, 0.0)) / 0.1;
        along += stripe * light;
        squares += stripe * stripe;
        mean += light;
        count += 1.0;
    }
    // The stripes of the wall have an amplitude of 0.1 at a mean of 0.3.
    (along / squares) / (mean / count) * 3.0
}

fn mixed(dice: &mut Dice, _: f64) -> usize {
    (dice.bits() >> 40) as usize & 1
}

#[test]
fn speckles_of_two_mixed_scans_vanish_and_the_texture_stays() {
    for (density, normals) in [(2.0, true), (2.0, false), (0.5, true), (0.25, false)] {
        let points = wall(&mut Dice(5), 0.0, density, mixed, |s, x, z| GAINS[s] * texture(x, z));
        let scene = scene(&points, density);
        let [before, after] =
            [false, true].map(|evens_exposure| lights(&scene, evens_exposure, normals));
        let [[one, two], [one_after, two_after]] = [&before, &after].map(|l| roughness(l));
        let contrasts = [&before, &after].map(|l| contrast(l, 0..SIDE as usize));
        let what = format!(
            "{density} points a pixel: {two:.4} to {two_after:.4} between scans, {one:.4} to {one_after:.4} within, \
             contrast {contrasts:.3?}"
        );
        eprintln!("{what}");
        // The remaining differences are those of the texture.
        assert!(
            two > two_after * 100.0 && two_after < one * 1.5 && one_after < one * 1.1,
            "{what}"
        );
        assert!((contrasts[1] / contrasts[0] - 1.0).abs() < 0.03, "{what}");
    }
}

#[test]
fn a_border_between_two_scans_becomes_a_slope() {
    let points = wall(
        &mut Dice(6),
        0.0,
        2.0,
        |_, x| usize::from(x > 0.0),
        |s, x, z| GAINS[s] * texture(x, z),
    );
    let scene = scene(&points, 2.0);
    // Mean light of two stripes (12 pixels) that start `from` pixels right of the border.
    let mean = |lights: &[Option<(f64, usize)>], from: i32| {
        let first = (SIDE as i32 / 2 + from) as usize;
        let columns = first..first + 12;
        let all = lights.iter().enumerate().filter(|(i, _)| columns.contains(&(i % SIDE as usize)));
        let all: Vec<f64> = all.filter_map(|(_, l)| l.map(|(light, _)| light)).collect();
        all.iter().sum::<f64>() / all.len() as f64
    };
    let [before, after] = [false, true].map(|evens_exposure| lights(&scene, evens_exposure, true));
    let step = |lights: &[Option<(f64, usize)>]| mean(lights, 0) / mean(lights, -12);
    let (old, new) = (step(&before), step(&after));
    assert!(old > 1.8 && new < 1.25, "across the border {old:.2}, then {new:.2}");
    // Light far from the border is unchanged, and the texture on the slope is kept.
    for from in [-90, 78] {
        let (old, new) = (mean(&before, from), mean(&after, from));
        assert!((new / old - 1.0).abs() < 0.01, "{old} and {new} at {from}");
    }
    let at_border = SIDE as usize / 2 - 36..SIDE as usize / 2 + 36;
    let sides = [at_border.start..SIDE as usize / 2, SIDE as usize / 2..at_border.end];
    for columns in sides {
        let [old, new] = [&before, &after].map(|l| contrast(l, columns.clone()));
        assert!((new / old - 1.0).abs() < 0.2, "{old} and {new}");
    }
}

#[test]
fn exposure_does_not_change_across_an_edge_of_depth_or_within_a_scan() {
    // A dark wall of one scan in front of the left half of a bright wall of the other.
    let mut dice = Dice(7);
    let left = |_: &mut Dice, _: f64| 0;
    let mut points = wall(&mut dice, -8.0, 2.0, left, |_, x, z| 0.5 * texture(x, z));
    points.retain(|p| p.at.x < 0.0);
    points.extend(wall(&mut dice, 0.0, 2.0, |_, _| 1, |_, x, z| 1.5 * texture(x, z)));
    let scene = scene(&points, 2.0);
    let [before, after] = [false, true].map(|evens_exposure| lights(&scene, evens_exposure, true));
    let mut seen = 0;
    for (old, new) in before.iter().zip(&after) {
        let (Some((old, _)), Some((new, _))) = (old, new) else { continue };
        assert!((old - new).abs() <= 1e-5, "{old} and {new}");
        seen += 1;
    }
    assert!(seen > 10_000);
}

#[test]
fn points_of_one_scan_keep_every_bit() {
    let mut dice = Dice(5);
    let points = wall(&mut dice, 0.0, 1.3, |_, _| 1, |_, x, z| texture(x, z));
    let (scene, view) = (scene(&points, 1.3), view());
    for normals in [true, false] {
        let draws = scene.draws(true, true, normals);
        let [plain, evened] = [false, true].map(|evens_exposure| {
            let frame = Frame { evens_exposure, ..scene.frame(&view, &draws) };
            assert_eq!(FramePlan::new(&frame).evens_exposure(), evens_exposure);
            Renderer::default().render(&frame).unwrap().rgba
        });
        assert!(plain == evened, "normals {normals}");
    }
}
