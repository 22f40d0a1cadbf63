//! Alpha at silhouettes against the true coverage of each pixel by a sphere and a cube, and drawn
//! widths of wires against true ones, over densities, with normals and without. Excess and lack of
//! coverage have separate bounds: discs stick out of a surface, and sparse samples dent its
//! outline.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::{Background, Renderer};
use glam::{DMat3, DVec2, DVec3};
use scene::{Dice, Scene, ScenePoint, even_sphere};

const SIDE: usize = 320;
/// Samples of the true coverage along the side of a pixel.
const SAMPLES: usize = 8;

fn view() -> View {
    View::look_at(DVec3::NEG_Y * 20.0, DVec3::ZERO, DVec3::Z, 0.11, SIDE as u32, SIDE as u32)
}

/// Pixels a unit of length at the origin.
fn pixels_per_unit() -> f64 {
    view().focal_px() / 20.0
}

/// Projection of `at`, pixels from the centre of the picture, y down.
fn place(at: DVec3) -> DVec2 {
    let scale = view().focal_px() / (at.y + 20.0);
    DVec2::new(at.x, -at.z) * scale
}

/// Draws points and returns the alpha of each pixel.
fn alpha(points: &[ScenePoint], spacing: f64, normals: bool) -> Vec<f64> {
    let scene = Scene::new(points, 1e-6, spacing, spacing, 10_000);
    let view = view();
    let draws = scene.draws(true, true, normals);
    let mut frame = scene.frame(&view, &draws);
    frame.background = Background::Plain([0; 4]);
    let picture = Renderer::default().render(&frame).unwrap();
    picture.rgba.as_chunks::<4>().0.iter().map(|p| f64::from(p[3]) / 255.0).collect()
}

/// Share of each pixel that lies inside, from samples.
fn truth(inside: impl Fn(DVec2) -> bool) -> Vec<f64> {
    let share = |i: usize| {
        let corner = DVec2::new((i % SIDE) as f64, (i / SIDE) as f64) - SIDE as f64 / 2.0;
        let at = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
        let samples = (0..SAMPLES * SAMPLES).map(|k| DVec2::new(at(k % SAMPLES), at(k / SAMPLES)));
        samples.filter(|&sample| inside(corner + sample)).count() as f64
    };
    (0..SIDE * SIDE).map(|i| share(i) / (SAMPLES * SAMPLES) as f64).collect()
}

/// Errors of alpha.
#[derive(Debug)]
struct AlphaErrors {
    /// Excess coverage over the length of the outline, pixels.
    over: f64,
    /// Missing coverage over the length of the outline, pixels.
    under: f64,
    /// Root mean square over the pixels that the true outline crosses.
    rms: f64,
}

fn alpha_errors(alpha: &[f64], truth: &[f64], length_px: f64) -> AlphaErrors {
    let errors = || alpha.iter().zip(truth).map(|(a, t)| a - t);
    let crossed = |t: &&f64| **t > 0.0 && **t < 1.0;
    let pixels = truth.iter().filter(crossed).count() as f64;
    let squares = alpha.iter().zip(truth).filter(|(_, t)| crossed(t)).map(|(a, t)| (a - t).powi(2));
    AlphaErrors {
        over: errors().map(|e| e.max(0.0)).sum::<f64>() / length_px,
        under: errors().map(|e| (-e).max(0.0)).sum::<f64>() / length_px,
        rms: (squares.sum::<f64>() / pixels).sqrt(),
    }
}

/// Half the edge of the cube.
const HALF: f64 = 0.7;

fn turned() -> DMat3 {
    DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.6)
}

/// Points on a turned cube, one in each cell of a grid on each side.
fn cube(dice: &mut Dice, spacing: f64) -> Vec<ScenePoint> {
    let side = (2.0 * HALF / spacing).round() as usize;
    let mut points = Vec::new();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut normal = DVec3::ZERO;
            normal[axis] = sign;
            for i in 0..side * side {
                let mut at = normal * HALF;
                let mut along =
                    |k: usize| ((k as f64 + dice.unit()) / side as f64 * 2.0 - 1.0) * HALF;
                at[(axis + 1) % 3] = along(i % side);
                at[(axis + 2) % 3] = along(i / side);
                points.push(ScenePoint {
                    at: turned() * at,
                    normal: turned() * normal,
                    colour: [180; 3],
                });
            }
        }
    }
    points
}

/// Outline of the cube in the picture: its corners in order.
fn cube_outline() -> Vec<DVec2> {
    let sign = |bits: usize, axis: usize| if bits >> axis & 1 == 1 { HALF } else { -HALF };
    let corners = (0..8).map(|b| place(turned() * DVec3::new(sign(b, 0), sign(b, 1), sign(b, 2))));
    let corners: Vec<DVec2> = corners.collect();
    // Gift wrapping.
    let mut hull = vec![*corners.iter().min_by(|a, b| a.x.total_cmp(&b.x)).unwrap()];
    loop {
        let last = hull[hull.len() - 1];
        let others = || corners.iter().copied().filter(|c| *c != last);
        let next =
            others().find(|&n| others().all(|c| (n - last).perp_dot(c - last) >= 0.0)).unwrap();
        if next == hull[0] {
            return hull;
        }
        hull.push(next);
    }
}

/// Bounds of `over`, `under` and `rms` of [`AlphaErrors`], by spacing (pixels): of the sphere and
/// of the cube with normals, then of both without.
type Bounds = (f64, [[[f64; 3]; 2]; 2]);
const BOUNDS: [Bounds; 5] = [
    (0.5, [[[0.28, 0.06, 0.24], [0.18, 0.10, 0.22]], [[0.55, 0.04, 0.38], [0.36, 0.07, 0.36]]]),
    (1.0, [[[0.25, 0.07, 0.24], [0.24, 0.11, 0.25]], [[0.80, 0.03, 0.47], [0.75, 0.04, 0.48]]]),
    (2.0, [[[0.60, 0.03, 0.39], [0.45, 0.11, 0.37]], [[0.36, 0.30, 0.39], [0.62, 0.05, 0.41]]]),
    (4.0, [[[0.80, 0.02, 0.46], [1.10, 0.09, 0.52]], [[0.65, 0.12, 0.46], [0.42, 0.27, 0.41]]]),
    (8.0, [[[1.10, 0.02, 0.56], [2.40, 0.17, 0.60]], [[2.10, 0.06, 0.60], [0.95, 0.42, 0.54]]]),
];

#[test]
fn alpha_is_close_to_the_coverage_of_the_pixel() {
    let radius = view().focal_px() / (20f64.powi(2) - 1.0).sqrt();
    let circle = truth(|at| at.length() <= radius);
    let hull = cube_outline();
    let edges = || hull.iter().zip(hull.iter().cycle().skip(1));
    let polygon = truth(|at| edges().all(|(a, b)| (b - a).perp_dot(at - a) >= 0.0));
    let polygon_px = edges().map(|(a, b)| a.distance(*b)).sum::<f64>();
    for (spacing_px, bounds) in BOUNDS {
        let spacing = spacing_px / pixels_per_unit();
        for (normals, [of_sphere, of_cube]) in [true, false].into_iter().zip(bounds) {
            let round = alpha(&even_sphere(&mut Dice(3), spacing), spacing, normals);
            let round = alpha_errors(&round, &circle, radius * std::f64::consts::TAU);
            let flat = alpha(&cube(&mut Dice(4), spacing), spacing, normals);
            let flat = alpha_errors(&flat, &polygon, polygon_px);
            for (what, errors, bound) in [("sphere", round, of_sphere), ("cube", flat, of_cube)] {
                let what =
                    format!("{what}, spacing {spacing_px} px, normals {normals}: {errors:.2?}");
                eprintln!("{what}");
                let AlphaErrors { over, under, rms } = errors;
                assert!(over < bound[0] && under < bound[1] && rms < bound[2], "{what}");
            }
        }
    }
}

/// Points on the whole surface of a slanted wire, seen from the front.
fn wire(dice: &mut Dice, width_px: f64, spacing_px: f64) -> Vec<ScenePoint> {
    let per_px = 1.0 / pixels_per_unit();
    let radius = width_px / 2.0 * per_px;
    let length = 250.0 * per_px;
    let around = std::f64::consts::TAU * radius;
    let count = (length * around.max(spacing_px * per_px) / (spacing_px * per_px).powi(2)) as usize;
    (0..count)
        .map(|i| {
            let along = ((i as f64 + dice.unit()) / count as f64 - 0.5) * length;
            let (s, c) = (dice.unit() * std::f64::consts::TAU).sin_cos();
            let normal = DVec3::new(c, s, 0.0);
            let axis = DVec3::new(along * 0.2, 0.0, along);
            ScenePoint { at: axis + normal * radius, normal, colour: [200; 3] }
        })
        .collect()
}

/// Spacings of the samples of wires, pixels.
const SPACINGS_PX: [f64; 4] = [0.25, 0.5, 1.0, 2.0];
/// True width of a wire; then, by spacing, the greatest mean width and the least width anywhere, as
/// drawn. All in pixels.
type Wires = [(f64, [f64; 4], [f64; 4]); 5];
const WIRES: Wires = [
    (0.5, [1.15, 1.25, 1.30, 1.30], [0.5; 4]),
    (1.0, [1.70, 1.70, 1.65, 1.55], [0.6; 4]),
    (2.0, [2.30, 2.45, 2.95, 2.25], [1.1; 4]),
    (4.0, [4.20, 4.30, 4.60, 4.75], [3.2; 4]),
    (8.0, [8.10, 8.15, 9.40, 9.30], [6.9; 4]),
];
/// Bounds with normals. Rows of a wire may be empty if it is narrower than the spacing of its
/// samples.
const WIRES_WITH_NORMALS: Wires = [
    (0.5, [1.05, 1.25, 1.20, 1.20], [0.50, 0.75, 0.0, 0.0]),
    (1.0, [1.65, 1.50, 1.55, 1.45], [1.00, 0.60, 0.60, 0.0]),
    (2.0, [2.30, 2.25, 2.20, 2.00], [1.70, 1.55, 1.30, 0.90]),
    (4.0, [4.25, 4.30, 4.15, 3.65], [3.70, 3.35, 2.85, 1.60]),
    (8.0, [8.35, 8.35, 8.45, 8.60], [7.30, 7.20, 6.45, 5.35]),
];

/// Mean and least width of a drawn wire, pixels.
fn widths(width_px: f64, spacing_px: f64, normals: bool) -> (f64, f64) {
    let points = wire(&mut Dice(9), width_px, spacing_px);
    let alpha = alpha(&points, spacing_px / pixels_per_unit(), normals);
    // Widths across the wire are smaller than along rows, because the wire is slanted.
    let width = |y: usize| alpha[y * SIDE..][..SIDE].iter().sum::<f64>() / 1.04f64.sqrt();
    let widths: Vec<f64> = (60..260).map(width).collect();
    let mean = widths.iter().sum::<f64>() / widths.len() as f64;
    (mean, widths.into_iter().fold(f64::INFINITY, f64::min))
}

#[test]
fn wires_neither_swell_nor_vanish() {
    for (wires, normals) in [(WIRES, false), (WIRES_WITH_NORMALS, true)] {
        for (width_px, most, narrowest) in wires {
            for (spacing_px, (most, narrowest)) in
                SPACINGS_PX.into_iter().zip(most.into_iter().zip(narrowest))
            {
                let (mean, least) = widths(width_px, spacing_px, normals);
                let what = format!(
                    "{width_px} px, spacing {spacing_px} px, normals {normals}: {mean:.2}, least {least:.2}"
                );
                eprintln!("{what}");
                assert!(mean < most && (least > narrowest || narrowest == 0.0), "{what}");
            }
        }
    }
}
