//! EWA splats of clouds without normals, tilted as planes that are fitted to depths: the texture of
//! a slanted floor lies where the floor is, and a volume is covered as by discs that face the eye.

use crate::passes::draw;
use crate::scene::{Dice, Scene, ScenePoint, sheet};
use esker_lod::View;
use esker_render::Frame;
use esker_render::ewa::Options;
use glam::DVec3;

const SIZE: [u32; 2] = [320, 240];
/// Side of the floor, points along it, and the distance of edges between stripes, which lie between
/// rows of points.
const FLOOR_M: f64 = 12.0;
const POINTS: usize = 160;
const STRIPE_M: f64 = 1.5;

/// A level floor in red and blue stripes along x.
fn floor() -> Scene {
    let half = FLOOR_M / 2.0;
    let (u, v) = (DVec3::X * FLOOR_M, DVec3::Y * FLOOR_M);
    let mut points = sheet(&mut Dice(5), DVec3::new(-half, -half, 0.0), u, v, POINTS, [0, 0, 255]);
    for point in &mut points {
        if (point.at.y / STRIPE_M).rem_euclid(2.0) < 1.0 {
            point.colour = [255, 0, 0];
        }
    }
    let spacing = FLOOR_M / POINTS as f64;
    Scene::new(&points, 1e-4, spacing, spacing, 1 << 15)
}

/// Mean distance of the drawn edges below the true ones, pixels, in the view of the floor from an
/// eye. An edge is where a step has the same sum of red as the picture around it.
fn displacement(scene: &Scene, eye: DVec3, fovy: f64) -> f64 {
    let [width, height] = SIZE;
    let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, fovy.to_radians(), width, height);
    let draws = scene.draws(true, true, false);
    let (level, ..) =
        draw(&Frame { cull_back_faces: false, ..scene.frame(&view, &draws) }, Options::default());
    let share = |x: u32, y: u32| {
        let tint = level.tint[(y * width + x) as usize];
        f64::from(tint.x / (tint.x + tint.z).max(1e-6))
    };
    let mut off = Vec::new();
    for edge in -2i32..=2 {
        let at = f64::from(edge) * STRIPE_M;
        let [left, right] = [-0.4, 0.4].map(|x| {
            let at = view.project(DVec3::new(x * FLOOR_M, at, 0.0)).unwrap().x;
            at.clamp(0.0, f64::from(width)) as u32
        });
        for x in (left..right).step_by(3) {
            // The edge is seen level, at the height of its middle.
            let row = |y: f64| view.project(DVec3::new(0.0, y, 0.0)).unwrap().y;
            let middle = row(at);
            let around = (row(at - 0.45 * STRIPE_M) - row(at + 0.45 * STRIPE_M)) / 2.0;
            let [top, bottom] = [middle - around, middle + around].map(|y| y.round() as u32);
            // Blurred edges need room.
            if around < 4.0 || top < 2 || bottom + 2 > height {
                continue;
            }
            let red: f64 = (top..bottom).map(|y| share(x, y)).sum();
            // Above an even edge, farther away, the floor is red.
            let is_red_above = edge.rem_euclid(2) == 0;
            let above = if is_red_above { red } else { f64::from(bottom - top) - red };
            off.push(f64::from(top) + above - middle);
        }
    }
    assert!(off.len() > 50, "{}", off.len());
    off.iter().sum::<f64>() / off.len() as f64
}

#[test]
fn the_texture_of_a_slanted_floor_is_where_the_floor_is() {
    let scene = floor();
    // From above, at angles from 60 to 8 degrees: discs of 1.5 to 10 pixels.
    let views = [(9.0, 40.0, 8.0), (9.0, 70.0, 8.0), (30.0, 15.0, 13.0), (9.0, 15.0, 13.0)];
    for (distance, fovy, least) in views {
        for degrees in [60f64, 35.0, 24.0, 13.0, 8.0].into_iter().filter(|&d| d >= least) {
            let (up, back) = degrees.to_radians().sin_cos();
            let off = displacement(&scene, DVec3::new(0.0, -back, up) * distance, fovy);
            assert!(off.abs() < 0.1, "{distance} m, {fovy} and {degrees} degrees: {off} px");
        }
    }
}

#[test]
fn volumes_are_covered_as_by_discs_that_face_the_eye() {
    let mut dice = Dice(9);
    let mut in_ball = || loop {
        let at = DVec3::from_array([0; 3].map(|_: i32| dice.unit() * 2.0 - 1.0));
        if at.length() < 1.0 {
            return at;
        }
    };
    let leaf = |at| ScenePoint { at, normal: DVec3::Z, colour: [40, 160, 60] };
    let points: Vec<_> = (0..20_000).map(|_| leaf(in_ball())).collect();
    let scene = Scene::new(&points, 1e-5, 0.05, 0.05, 1 << 14);
    let draws = scene.draws(true, true, false);
    for distance in [3.0, 6.0, 20.0] {
        let eye = DVec3::new(0.4, -1.0, 0.3).normalize_or_zero() * distance;
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, 0.9, SIZE[0], SIZE[1]);
        let [facing, tilted] = [false, true].map(|fits_planes| {
            let frame = Frame { fits_planes, cull_back_faces: false, ..scene.frame(&view, &draws) };
            let (_, depth, _) = draw(&frame, Options::default());
            depth.iter().filter(|depth| depth.is_finite()).count()
        });
        assert!(facing.abs_diff(tilted) * 200 < facing, "{distance} m: {facing} {tilted}");
    }
}
