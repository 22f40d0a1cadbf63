//! Outlines inside the picture: a ball in front of a wall, whose outline is as smooth as if there
//! were nothing behind it, however near the wall is, and has no dark line along it.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::{Frame, Method, Picture, Renderer};
use glam::{DVec2, DVec3};
use scene::{Dice, Scene, ScenePoint, even_sphere};

const SIDE: usize = 320;
/// Most isolated pixels of an outline with normals, which is about 1,200 pixels long.
const ISOLATED_MAX: usize = 2;
/// Distance of the eye from the centre of the ball, whose radius is 1.
const DISTANCE: f64 = 20.0;

fn view() -> View {
    let eye = DVec3::NEG_Y * DISTANCE;
    View::look_at(eye, DVec3::ZERO, DVec3::Z, 0.11, SIDE as u32, SIDE as u32)
}

/// A wall that faces the eye, one random point in each cell of a grid, and fills the picture.
fn wall(dice: &mut Dice, behind: f64, spacing: f64) -> Vec<ScenePoint> {
    let half = 1.3;
    let n = (2.0 * half / spacing).ceil() as usize;
    (0..n * n)
        .map(|i| {
            let cell = DVec2::new((i % n) as f64, (i / n) as f64);
            let at = (cell + DVec2::new(dice.unit(), dice.unit())) * spacing - half;
            let at = DVec3::new(at.x, behind, at.y);
            ScenePoint { at, normal: DVec3::NEG_Y, colour: [60, 110, 180] }
        })
        .collect()
}

/// Deviation of a drawn outline from the true circle.
#[derive(Debug)]
struct Outline {
    /// Mean distance beyond the circle, pixels.
    mean: f64,
    /// Root mean square around the mean, pixels.
    rough: f64,
    /// Pixels that differ from seven or eight of their neighbours.
    isolated: usize,
}

impl Outline {
    /// The outline of the pixels that are nearer than `far`.
    fn of(depth: &[f32], far: f64) -> Self {
        let is_near = |x: usize, y: usize| f64::from(depth[y * SIDE + x]) < far;
        let radius_px = view().focal_px() / (DISTANCE.powi(2) - 1.0).sqrt();
        let (mut off, mut isolated) = (Vec::new(), 0);
        for (x, y) in (1..SIDE - 1).flat_map(|y| (1..SIDE - 1).map(move |x| (x, y))) {
            let here = is_near(x, y);
            let around = (0..9).filter(|&k| k != 4);
            let others = around.filter(|k| is_near(x + k % 3 - 1, y + k / 3 - 1) != here).count();
            isolated += usize::from(others >= 7);
            let beside = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
            for (a, b) in beside.into_iter().filter(|&(a, b)| here && !is_near(a, b)) {
                let border = DVec2::new((x + a) as f64, (y + b) as f64) / 2.0 + 0.5;
                off.push((border - SIDE as f64 / 2.0).length() - radius_px);
            }
        }
        let count = off.len() as f64;
        let mean = off.iter().sum::<f64>() / count;
        let rough = (off.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / count).sqrt();
        Self { mean, rough, isolated }
    }
}

/// Points of a ball, and of a wall `behind` its centre unless that is infinite.
fn ball_before_wall(behind: f64, spacing: f64) -> Vec<ScenePoint> {
    let dice = &mut Dice(5);
    let mut points = even_sphere(dice, spacing);
    if behind.is_finite() {
        points.extend(wall(dice, behind, spacing));
    }
    points
}

fn drawn(points: &[ScenePoint], spacing: f64, method: Method, normals: bool) -> Picture {
    let view = view();
    let scene = Scene::new(points, 1e-6, spacing, spacing, 10_000);
    let draws = scene.draws(true, true, normals);
    let frame = Frame { method, ..scene.frame(&view, &draws) };
    Renderer::default().render(&frame).unwrap()
}

/// Draws a ball at distances of points of `spacing_px` pixels, before nothing and before walls up
/// to a fifth of its radius behind its centre. `rough` bounds the deviation of its outline, pixels,
/// `isolated` the number of isolated pixels, and `mean` the distance from the true outline.
fn check_outlines(
    (method, normals): (Method, bool),
    (spacing_px, rough): (f64, f64),
    isolated: usize,
    mean: f64,
) {
    let spacing = spacing_px * DISTANCE / view().focal_px();
    for behind in [0.2, 0.5, 3.0, f64::INFINITY] {
        let picture = drawn(&ball_before_wall(behind, spacing), spacing, method, normals);
        let far = DISTANCE + if behind.is_finite() { behind * 0.6 } else { 1.0 };
        let outline = Outline::of(&picture.depth, far);
        let what =
            format!("{method:?}, {normals}, {spacing_px} px, {behind} behind: {outline:.2?}");
        println!("{what}");
        assert!(outline.rough < rough && outline.isolated <= isolated, "{what}");
        assert!(outline.mean.abs() < mean, "{what}");
    }
}

#[test]
fn the_outline_of_a_ball_before_a_wall_is_as_smooth_as_before_nothing() {
    for (spacing_px, rough) in [(1.0, 0.3), (2.0, 0.5), (4.0, 0.42), (6.0, 0.42), (10.0, 0.6)] {
        let mean = 0.9 + 0.12 * spacing_px;
        let with_normals = (Method::PullPush, true);
        check_outlines(with_normals, (spacing_px, rough), ISOLATED_MAX, mean);
    }
}

/// Discs that face the eye stick out by their radius.
#[test]
fn outlines_of_splats_before_a_wall_are_as_smooth_as_before_nothing() {
    for spacing_px in [1.0, 2.0, 4.0, 6.0, 10.0] {
        check_outlines((Method::Ewa, true), (spacing_px, 0.3), 0, 1.6);
        check_outlines((Method::Ewa, false), (spacing_px, 0.4), 0, 1.0 + 1.2 * spacing_px);
    }
}

/// Without normals a surface less than two radii behind takes part in the outline, so distances of
/// points are at most 4 pixels here (`docs/design/surfaces.md`, *Known limits*).
#[test]
fn outlines_without_normals_before_a_wall_deviate_by_less_than_a_pixel() {
    for (spacing_px, rough, isolated) in [(1.0, 0.6, 0), (2.0, 1.0, 50), (4.0, 0.8, 10)] {
        check_outlines((Method::PullPush, false), (spacing_px, rough), isolated, 1.5);
    }
}

/// Light of a splatted picture changes across an outline from that of the front to that of the back
/// without a dark line between both.
#[test]
fn no_line_along_an_outline_of_splats_is_darker_than_both_sides() {
    let radius_px = view().focal_px() / (DISTANCE.powi(2) - 1.0).sqrt();
    for (spacing_px, behind) in [(1.0, 0.2), (1.0, 3.0), (4.0, 0.5), (10.0, 0.2), (10.0, 3.0)] {
        let spacing = spacing_px * DISTANCE / view().focal_px();
        let picture = drawn(&ball_before_wall(behind, spacing), spacing, Method::Ewa, true);
        let light = |distance_px: std::ops::Range<f64>| {
            let pixels = (0..SIDE * SIDE).filter(|i| {
                let at = DVec2::new((i % SIDE) as f64, (i / SIDE) as f64) + 0.5;
                let from_outline = (at - SIDE as f64 / 2.0).length() - radius_px;
                distance_px.contains(&from_outline)
            });
            let colours: Vec<_> = pixels.map(|i| picture.rgba.as_chunks::<4>().0[i]).collect();
            let sums = colours.iter().map(|c| c[..3].iter().map(|&c| f64::from(c)).sum::<f64>());
            sums.sum::<f64>() / (3.0 * colours.len() as f64)
        };
        let (front, back) = (light(-4.0..-3.0), light(8.0..12.0));
        let rings: Vec<_> = (-3..8).map(|k| light(f64::from(k)..f64::from(k + 1))).collect();
        let darkest = rings.iter().copied().fold(f64::MAX, f64::min);
        let what = format!("{spacing_px} px, {behind} behind: {front:.0} {rings:.0?} {back:.0}");
        println!("{what}");
        assert!(darkest > 0.95 * front.min(back), "{what}");
    }
}
