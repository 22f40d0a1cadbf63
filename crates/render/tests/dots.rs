//! Points that are drawn alone: dots are those of a reference that draws point by point, adaptive
//! ones close surfaces, and neither they nor eye-dome lighting depend on the unit. Mixed with
//! surfaces, points are dots where they are too far apart on the picture for a surface.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_render::{Background, Dots, Frame, Method, Picture, PointSize, Renderer};
use glam::DVec3;
use scene::{Dice, Scene, ScenePoint};

const SIDE: u32 = 160;

fn view(unit: f64) -> View {
    let eye = DVec3::new(0.3, -6.0, 1.1) * unit;
    let near = 1e-3 * unit;
    View { near, ..View::look_at(eye, DVec3::ZERO, DVec3::Z, 0.5, SIDE, SIDE) }
}

/// Points of random colours in a ball of radius 1.
fn ball(unit: f64) -> Vec<ScenePoint> {
    let mut dice = Dice(5);
    (0..900)
        .map(|_| {
            let mut place = || DVec3::from_array([0; 3].map(|_| 2.0 * dice.unit() - 1.0));
            let mut at = place();
            while at.length() > 1.0 {
                at = place();
            }
            let colour = [0; 3].map(|_| (dice.bits() % 256) as u8);
            ScenePoint { at: at * unit, normal: DVec3::Z, colour }
        })
        .collect()
}

fn draw(points: &[ScenePoint], unit: f64, spacing: f64, dots: Dots) -> Picture {
    let scene = Scene::new(points, unit * 2f64.powi(-24), spacing * unit, spacing * unit, 250);
    let view = view(unit);
    let draws = scene.draws(true, true, false);
    let frame = Frame {
        method: Method::Points,
        cull_back_faces: false,
        dots,
        background: Background::Plain([0; 4]),
        ..scene.frame(&view, &draws)
    };
    Renderer::default().render(&frame).unwrap()
}

/// Colours and depths of discs of this diameter around the centres of the points' pixels.
fn reference(points: &[ScenePoint], diameter: f64) -> Vec<([u8; 3], f64)> {
    let view = view(1.0);
    let side = SIDE as usize;
    let mut picture = vec![([0; 3], f64::INFINITY); side * side];
    for point in points {
        let Some(at) = view.project(point.at).filter(|&at| view.is_on_picture(at)) else {
            continue;
        };
        let (x, y, depth) = (at.x.floor(), at.y.floor(), view.depth(point.at));
        for (i, pixel) in picture.iter_mut().enumerate() {
            let away2 = (x - (i % side) as f64).powi(2) + (y - (i / side) as f64).powi(2);
            if away2 <= diameter * diameter / 4.0 && depth < pixel.1 {
                *pixel = (point.colour, depth);
            }
        }
    }
    picture
}

#[test]
fn dots_are_those_that_are_drawn_point_by_point() {
    let points = ball(1.0);
    for diameter in [1.0f32, 2.0, 3.0, 6.5, 20.0] {
        let dots = Dots { size: PointSize::Pixels(diameter), eye_dome: 0.0 };
        let picture = draw(&points, 1.0, 0.1, dots);
        let expected = reference(&points, diameter.into());
        let off = picture.rgba.as_chunks::<4>().0.iter().zip(&picture.depth).zip(&expected).filter(
            |((rgba, depth), (colour, expected))| {
                let is_near = (f64::from(**depth) - expected).abs() < 1e-4;
                rgba[..3] != *colour || (depth.is_finite() && !is_near)
            },
        );
        let (off, wide) = (off.count(), expected.iter().filter(|p| p.1.is_finite()).count());
        assert!(off * 500 <= wide, "{diameter} px: {off} of {wide} pixels differ");
    }
}

#[test]
fn adaptive_dots_close_surfaces_and_are_no_wider_than_a_bound() {
    // A wall across the view with points 4 pixels apart, and then so far apart that they are no
    // surface.
    let pixel = 6.1 / view(1.0).focal_px();
    let covered = |apart_px: f64| {
        let (apart, half) = (apart_px * pixel, (90.0 / apart_px) as i32);
        let place = |i: i32, k: i32| DVec3::new(f64::from(i) * apart, 0.0, f64::from(k) * apart);
        let wall: Vec<_> = (-half..=half)
            .flat_map(|i| (-half..=half).map(move |k| place(i, k)))
            .map(|at| ScenePoint { at, normal: DVec3::NEG_Y, colour: [200; 3] })
            .collect();
        let dots = Dots { size: PointSize::Adaptive, eye_dome: 0.0 };
        let picture = draw(&wall, 1.0, apart, dots);
        let middle = (40..120).flat_map(|y| (40..120).map(move |x| y * SIDE as usize + x));
        middle.filter(|&i| picture.depth[i].is_finite()).count() as f64 / 6400.0
    };
    for apart_px in [1.0, 2.5, 4.0, 5.5] {
        assert!(covered(apart_px) > 0.99, "{apart_px} px apart: {}", covered(apart_px));
    }
    let sparse = covered(30.0);
    assert!((0.06..0.13).contains(&sparse), "discs of 10 px, 30 px apart: {sparse}");
}

#[test]
fn pictures_do_not_depend_on_the_unit() {
    for size in [PointSize::Pixels(4.0), PointSize::Adaptive] {
        let dots = Dots { size, eye_dome: 0.8 };
        let picture = |unit: f64| draw(&ball(unit), unit, 0.1, dots);
        let one = picture(1.0);
        for unit in [2f64.powi(20), 2f64.powi(-20)] {
            assert!(picture(unit).rgba == one.rgba, "{size:?}, unit {unit}");
        }
    }
}

/// A point without a normal beside a wall of points with normals, all 40 pixels apart: a dot of at
/// most 10 pixels by both methods, and not a disc as wide as points are apart.
#[test]
fn points_of_no_surface_are_dots_where_the_camera_is_near() {
    let apart = 40.0 * 6.1 / view(1.0).focal_px();
    let point = |at| ScenePoint { at, normal: DVec3::NEG_Y, colour: [200; 3] };
    let wall: Vec<_> = (0..9)
        .map(|i| point(DVec3::new(f64::from(i % 3) * apart, 0.0, f64::from(i / 3) * apart)))
        .collect();
    let stray = [point(DVec3::new(-1.6 * apart, 0.0, 0.0))];
    let scenes = [&wall[..], &stray[..]].map(|p| Scene::new(p, 2f64.powi(-24), apart, apart, 250));
    let view = view(1.0);
    for method in [Method::PullPush, Method::Ewa] {
        let covered = |has_normal: bool| {
            let mut draws = scenes[0].draws(true, true, true);
            draws.extend(scenes[1].draws(true, true, has_normal));
            let background = Background::Plain([0; 4]);
            let frame = Frame {
                method,
                cull_back_faces: false,
                background,
                ..scenes[0].frame(&view, &draws)
            };
            let picture = Renderer::default().render(&frame).unwrap();
            // Columns left of the discs of the wall.
            let side = SIDE as usize;
            (0..side * side).filter(|i| i % side < 26 && picture.depth[*i].is_finite()).count()
        };
        let (dot, disc) = (covered(false), covered(true));
        // A disc of 10 pixels has 79; pull-push draws a lone one narrower.
        assert!((12..=100).contains(&dot) && disc > 1000, "{method:?}: {dot}, {disc}");
    }
}

/// Points of a wall across the view at `depth` from the eye, `apart_px` apart on the picture, and
/// their distance.
fn wall(apart_px: f64, depth: f64, count: i32) -> (Vec<ScenePoint>, f64) {
    let view = view(1.0);
    let apart = apart_px * depth / view.focal_px();
    let (right, up) = (view.world_from_view.x_axis, view.world_from_view.y_axis);
    let middle = view.eye + view.forward() * depth;
    let place = |i: i32, k: i32| middle + (right * f64::from(i) + up * f64::from(k)) * apart;
    let points = (-count..=count).flat_map(|i| (-count..=count).map(move |k| place(i, k)));
    let normal = -view.forward();
    let points = points.map(|at| ScenePoint { at, normal, colour: [200; 3] });
    (points.collect(), apart)
}

/// A picture of scenes, each with whether it has normals; surfaces alone or mixed with dots.
fn mixed(scenes: &[(&Scene, bool)], mixes_dots: bool) -> Picture {
    let view = view(1.0);
    let draws: Vec<_> =
        scenes.iter().flat_map(|(scene, normals)| scene.draws(true, true, *normals)).collect();
    let frame = Frame {
        cull_back_faces: false,
        mixes_dots,
        background: Background::Plain([0; 4]),
        ..scenes[0].0.frame(&view, &draws)
    };
    Renderer::default().render(&frame).unwrap()
}

fn scene(points: &[ScenePoint], apart: f64) -> Scene {
    Scene::new(points, 2f64.powi(-24), apart, apart, 1 << 12)
}

fn covered(picture: &Picture) -> usize {
    picture.depth.iter().filter(|depth| depth.is_finite()).count()
}

#[test]
fn points_are_dots_only_where_they_are_too_far_apart_for_a_surface() {
    for (normals, surface_px, dots_px) in [(true, 55.0, 72.0), (false, 28.0, 36.0)] {
        let (points, apart) = wall(surface_px, 6.0, 2);
        let wall_near = scene(&points, apart);
        let [mixed_near, alone] = [true, false].map(|m| mixed(&[(&wall_near, normals)], m));
        assert!(mixed_near.rgba == alone.rgba && mixed_near.depth == alone.depth);
        assert!(covered(&alone) > 9_000, "{normals}: {}", covered(&alone));
        let (points, apart) = wall(dots_px, 6.0, 2);
        let wall_far = scene(&points, apart);
        let picture = mixed(&[(&wall_far, normals)], true);
        let in_view = points.iter().filter_map(|p| view(1.0).project(p.at));
        let in_view = in_view.filter(|&at| view(1.0).is_on_picture(at)).count();
        // A disc of 10 pixels has 81; those at the border are cut.
        let range = in_view * 40..=in_view * 90;
        assert!(range.contains(&covered(&picture)), "{normals}: {}", covered(&picture));
        assert_eq!(picture.stats.pixels_covered as usize, covered(&picture));
    }
}

/// Points in a box around the target with normals in all directions, as of leaves.
fn leaves(count: usize) -> Vec<ScenePoint> {
    let mut dice = Dice(11);
    (0..count)
        .map(|_| {
            let mut way = || DVec3::from_array([0; 3].map(|_| 2.0 * dice.unit() - 1.0));
            let (at, normal) = (way() * 1.2, way().normalize_or(DVec3::Z));
            ScenePoint { at, normal, colour: [90, 160, 60] }
        })
        .collect()
}

#[test]
fn points_whose_normals_agree_with_few_around_them_are_dots() {
    let pixel = 6.1 / view(1.0).focal_px();
    // Leaves, and three points in a plane: their discs would be 40 and 60 pixels wide.
    let (row, apart) = wall(30.0, 6.0, 1);
    for (points, apart, most) in [
        (leaves(60), 20.0 * pixel, 60),
        (row[..3].to_vec(), apart, 3),
        (row[..1].to_vec(), apart, 1),
    ] {
        let alone = scene(&points, apart);
        let [mixed, discs] = [true, false].map(|mixes| covered(&mixed(&[(&alone, true)], mixes)));
        // A disc of 10 pixels has 81.
        assert!(mixed > 0 && mixed <= most * 90, "{most} points: {mixed} pixels are covered");
        assert!(discs > 3 * mixed, "{most} points: {discs} by surfaces, {mixed} mixed");
    }
}

#[test]
fn sparse_surfaces_stay_surfaces_behind_leaves() {
    for apart_px in [10.0, 16.0, 24.0] {
        let (points, apart) = wall(apart_px, 8.0, 12);
        let wall = scene(&points, apart);
        let alone = mixed(&[(&wall, true)], true);
        assert!(covered(&alone) + 8 >= alone.depth.len(), "{apart_px}: {}", covered(&alone));
        let leaves = leaves(40);
        let leaves = scene(&leaves, 0.3);
        let picture = mixed(&[(&wall, true), (&leaves, true)], true);
        // Nothing is open, and leaves cover little of the wall.
        let behind = picture.depth.iter().filter(|&&depth| depth > 7.5 && depth.is_finite());
        let behind = behind.count();
        assert!(covered(&picture) + 8 >= picture.depth.len(), "{}", covered(&picture));
        assert!(behind * 10 > picture.depth.len() * 8, "{apart_px}: {behind}");
    }
}

#[test]
fn dots_are_seen_before_surfaces_and_hidden_behind_them() {
    let (points, apart) = wall(4.0, 6.0, 30);
    let surface = scene(&points, apart);
    let (before, apart) = wall(20.0, 5.0, 2);
    let before = scene(&before, apart);
    let (behind, apart) = wall(20.0, 7.0, 2);
    let behind = scene(&behind, apart);
    let alone = mixed(&[(&surface, true)], true);
    let hidden = mixed(&[(&surface, true), (&behind, false)], true);
    // The picture has no margin: a corner may be open.
    assert!(covered(&alone) + 4 >= alone.depth.len());
    assert!(hidden.rgba == alone.rgba);
    let shown = mixed(&[(&surface, true), (&before, false)], true);
    let near = shown.depth.iter().filter(|&&depth| depth < 5.5).count();
    assert!((25 * 40..25 * 90).contains(&near), "{near}");
    // Around dots the surface is as it is without them.
    let differs = shown.depth.iter().zip(&alone.depth).filter(|(a, b)| (*a - *b).abs() > 0.05);
    assert_eq!(differs.count(), near);
}
