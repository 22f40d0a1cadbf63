//! Drawn surfaces as a user sees them: they are closed and hide surfaces behind them, silhouettes
//! are in the right place, points have their colours.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::{CompactOctree, Drawn, View};
use esker_points::{AttrType, Lattice, Node, NodeTable};
use esker_render::inputs::colour::linear;
use esker_render::passes::pull::pull;
use esker_render::passes::push::push;
use esker_render::picture::pyramid::Pyramid;
use esker_render::{
    Background, ColourBy, ColourMap, ColourPlane, DrawNode, Frame, Gradient, Method, Picture,
    Renderer,
};
use glam::{DVec3, Vec3};
use scene::{Dice, Scene, ScenePoint, sphere};

const RED: [u8; 3] = [220, 30, 30];
const BLUE: [u8; 3] = [30, 30, 220];

/// Points of a wall through `centre`, tilted about x by `tilt` degrees, one in each cell of a grid.
fn wall(
    dice: &mut Dice,
    centre: DVec3,
    half: f64,
    tilt: f64,
    spacing: f64,
    colour: [u8; 3],
) -> Vec<ScenePoint> {
    let (sin, cos) = tilt.to_radians().sin_cos();
    let [u, v] = [DVec3::X, DVec3::new(0.0, sin, cos)];
    let [n, m] = [half / spacing, half / cos / spacing].map(|n| n as i64);
    let mut points = Vec::new();
    for i in -n..n {
        for j in -m..m {
            let [a, b] = [i, j].map(|k| (k as f64 + dice.unit()) * spacing);
            points.push(ScenePoint { at: centre + u * a + v * b, normal: u.cross(v), colour });
        }
    }
    points
}

/// View from 10 units in front of the origin, where a pixel is about `10 * 2 tan(0.05) / 256` wide.
fn narrow_view() -> View {
    View::look_at(DVec3::NEG_Y * 10.0, DVec3::ZERO, DVec3::Z, 0.1, 256, 256)
}

fn draw(scene: &Scene, view: &View, normals: bool) -> Picture {
    let draws = scene.draws(true, true, normals);
    let mut frame = scene.frame(view, &draws);
    frame.background = Background::Plain([0; 4]);
    Renderer::default().render(&frame).unwrap()
}

#[test]
fn walls_are_closed_at_any_distance_and_tilt() {
    let view = narrow_view();
    let pixel = 10.0 / view.focal_px();
    for tilt in [0.0, 30.0, 60.0, 70.0] {
        for spacing_px in [0.7, 1.0, 1.7, 3.0, 8.0, 21.0] {
            for normals in [true, false] {
                let spacing = spacing_px * pixel;
                let mut dice = Dice(11);
                let points = wall(&mut dice, DVec3::ZERO, 0.7, tilt, spacing, RED);
                let scene = Scene::new(&points, 1e-6, spacing, spacing * 2f64.sqrt(), 10_000);
                let holes = 256 * 256 - draw(&scene, &view, normals).stats.pixels_covered;
                // 0.012 % of the pixels: the mean of ellipses covers slightly less than they do.
                let allowed = 8;
                assert!(
                    holes <= allowed,
                    "{holes} holes: {tilt} degrees, {spacing_px} px, {normals}"
                );
            }
        }
    }
}

#[test]
fn nothing_shows_through_a_sparse_wall() {
    let view = narrow_view();
    let pixel = 10.0 / view.focal_px();
    for spacing_px in [2.0, 5.0, 12.0] {
        for normals in [true, false] {
            let spacing = spacing_px * pixel;
            let mut dice = Dice(12);
            let mut points = wall(&mut dice, DVec3::ZERO, 0.7, 0.0, spacing, RED);
            points.extend(wall(&mut dice, DVec3::Y * 3.0, 1.0, 0.0, pixel, BLUE));
            let scene = Scene::new(&points, 1e-6, spacing, spacing * 2f64.sqrt(), 10_000);
            let picture = draw(&scene, &view, normals);
            let behind = picture.depth.iter().filter(|&&d| d > 11.0).count();
            let (pixels, _) = picture.rgba.as_chunks::<4>();
            let blue = pixels.iter().filter(|p| p[2] > p[0]).count();
            assert!(behind <= 6 && blue <= 6, "{behind}, {blue} at {spacing_px} px, {normals}");
        }
    }
}

/// From the centre of a sphere, each of its places faces the eye, and perspective stretches it the
/// more the farther it is from the centre of the picture.
#[test]
fn surfaces_around_the_eye_are_closed_at_wide_angles() {
    let mut dice = Dice(31);
    for (fovy, most) in [(1.0, 20), (1.6, 4), (2.1, 4)] {
        let view = View::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z, fovy, 240, 180);
        for (count, normals) in [(20_000, false), (20_000, true), (4_000, false), (4_000, true)] {
            let spacing = (4.0 * std::f64::consts::PI / f64::from(count)).sqrt();
            let mut points = sphere(&mut dice, DVec3::ZERO, 1.0, count as usize, RED);
            points.iter_mut().for_each(|point| point.normal = -point.normal);
            // Wholly random points leave gaps of several spacings.
            let scene = Scene::new(&points, 1e-6, spacing, spacing * 2.0, 10_000);
            let picture = draw(&scene, &view, normals);
            let open = picture.depth.iter().filter(|d| !d.is_finite()).count();
            assert!(open <= most, "{open} open pixels of {count} points, {normals}, {fovy}");
        }
    }
}

#[test]
fn a_sphere_with_normals_ends_at_its_silhouette() {
    let view = View::look_at(DVec3::NEG_Y * 20.0, DVec3::ZERO, DVec3::Z, 0.11, 300, 300);
    let (centre, radius_px) = (150.0, view.focal_px() / (20.0f64.powi(2) - 1.0).sqrt());
    let mut dice = Dice(13);
    for count in [3_000, 30_000, 300_000] {
        let spacing = (4.0 * std::f64::consts::PI / f64::from(count)).sqrt();
        let points = sphere(&mut dice, DVec3::ZERO, 1.0, count as usize, RED);
        // Wholly random points leave gaps of several spacings.
        let scene = Scene::new(&points, 1e-6, spacing, spacing * 2.0, 10_000);
        let picture = draw(&scene, &view, true);
        let spacing_px = spacing * view.focal_px() / 20.0;
        let (mut missing, mut beyond) = (0, 0.0f64);
        // Greatest depth of the near side, and the depth by which the plane of a disc may extend
        // beyond it.
        let (limb, pixel) = (20.0 - 1.0 / 20.0, 20.0 / view.focal_px());
        let disc = 1.4 * 2.0 * spacing + 2.0 * pixel;
        for (i, d) in picture.depth.iter().enumerate() {
            let (x, y) = ((i % 300) as f64 + 0.5 - centre, (i / 300) as f64 + 0.5 - centre);
            let outside = x.hypot(y) - radius_px;
            if d.is_finite() {
                beyond = beyond.max(outside);
                let most = limb + if outside < 0.0 { 2.0 * pixel } else { disc };
                let most = most.min(20.1);
                assert!(f64::from(*d) < most, "the far side shows");
            } else if outside < -1.5 - spacing_px {
                missing += 1;
            }
        }
        assert!(missing <= 20, "{missing} holes of {count} points");
        assert!(beyond < 2.0 + 0.5 * spacing_px, "{beyond} px beyond, spacing {spacing_px} px");
    }
}

#[test]
fn points_keep_their_colours() {
    let view = narrow_view();
    let points = wall(&mut Dice(14), DVec3::ZERO, 0.4, 0.0, 0.01, [201, 13, 77]);
    let scene = Scene::new(&points, 1e-6, 0.01, 0.02, 1000);
    let draws = scene.draws(true, true, false);
    let mut frame = scene.frame(&view, &draws);
    (frame.method, frame.background) = (Method::Points, Background::Plain([1, 2, 3, 4]));
    let picture = Renderer::default().render(&frame).unwrap();
    let (pixels, _) = picture.rgba.as_chunks::<4>();
    let covered = pixels.iter().filter(|p| **p != [1, 2, 3, 4]).count();
    assert!(covered > 1000 && covered as u64 == picture.stats.pixels_covered);
    for p in pixels.iter().filter(|p| **p != [1, 2, 3, 4]) {
        assert!(p.iter().zip([201u8, 13, 77, 255]).all(|(a, b)| a.abs_diff(b) <= 1), "{p:?}");
    }
}

#[test]
fn back_faces_are_culled_on_request_and_turned_to_the_viewer_otherwise() {
    let view = narrow_view();
    let mut points = wall(&mut Dice(15), DVec3::ZERO, 2.0, 0.0, 0.01, RED);
    let facing = Scene::new(&points, 1e-6, 0.01, 0.015, 1000);
    points.iter_mut().for_each(|p| p.normal = -p.normal);
    let turned = Scene::new(&points, 1e-6, 0.01, 0.015, 1000);
    let picture = |scene: &Scene, cull| {
        let draws = scene.draws(true, true, true);
        let mut frame = scene.frame(&view, &draws);
        frame.cull_back_faces = cull;
        Renderer::default().render(&frame).unwrap()
    };
    // Normals are along u x v; one of the two scenes faces the camera.
    let covered = [&facing, &turned].map(|s| picture(s, true).stats.pixels_covered);
    assert!(covered.contains(&0) && covered.iter().any(|&c| c > 65_000), "{covered:?}");
    assert_eq!(picture(&facing, false).rgba, picture(&turned, false).rgba);
}

#[test]
fn the_number_of_threads_does_not_change_the_picture() {
    let scene =
        Scene::new(&sphere(&mut Dice(16), DVec3::ZERO, 0.4, 40_000, BLUE), 1e-6, 0.01, 0.02, 700);
    let view = narrow_view();
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| draw(&scene, &view, true))
    };
    let (one, many) = (with(1), with(7));
    assert!(one.rgba == many.rgba && one.depth == many.depth);
}

#[test]
fn a_prefix_draws_the_first_points_up_to_the_end_of_the_planes() {
    let points = wall(&mut Dice(17), DVec3::ZERO, 0.4, 0.0, 0.02, RED);
    let scene = Scene::new(&points, 1e-6, 0.02, 0.03, 200);
    let view = narrow_view();
    for (prefix, expected) in [(0, 0), (10, 10), (200, 200), (usize::MAX, 200)] {
        let mut draw = scene.nodes[0].draw(true, true, false);
        draw.prefix = prefix;
        let draws = [draw];
        let mut frame = scene.frame(&view, &draws);
        frame.colour = ColourBy::Plain;
        let stats = Renderer::default().render(&frame).unwrap().stats;
        assert_eq!(stats.points_drawn, expected);
        assert_eq!(stats.nodes_drawn, u32::from(expected > 0));
    }
}

#[test]
fn a_pixel_with_more_points_than_sums_hold_shows_the_nearest_one() {
    const MOST: usize = 1 << 18;
    let view = narrow_view();
    let pixel = 10.0 / view.focal_px();
    // The centre of a pixel next to the centre of the picture.
    let at = |nearer: f64| DVec3::new(0.5 * pixel, -nearer, 0.5 * pixel);
    for normals in [true, false] {
        let tint = |count: usize| {
            let one = |i| ScenePoint {
                at: at(0.0),
                normal: DVec3::NEG_Y,
                colour: if i % 2 == 0 { RED } else { BLUE },
            };
            let mut points: Vec<_> = (1..count).map(one).collect();
            let green = ScenePoint { at: at(0.01 * pixel), colour: [0, 255, 0], ..one(0) };
            points.push(green);
            let scene = Scene::new(&points, 1e-6, 0.5 * pixel, 0.5 * pixel, 1 << 16);
            let draws = scene.draws(true, true, normals);
            let mut pyramid = Pyramid::default();
            let frame = scene.frame(&view, &draws);
            assert_eq!(Renderer::default().base_level(&frame, &mut pyramid).unwrap(), 1);
            let base = &pyramid.levels[0];
            let won = (0..base.front.len()).find(|&p| base.is_valid(p)).unwrap();
            base.tint[won].truncate()
        };
        assert_eq!(tint(MOST + 1), Vec3::Y, "{normals}");
        let mean = tint(MOST);
        assert!(mean.x > 0.3 && mean.y < 0.02 && mean.z > 0.3, "{mean}, {normals}");
    }
}

/// A texture coordinate is an attribute like any other: mapped to grey, it is interpolated over the
/// surface.
#[test]
fn a_coordinate_across_a_wall_is_interpolated_between_its_points() {
    let view = narrow_view();
    let pixel = 10.0 / view.focal_px();
    // A value from 0 to 1 across the picture, in three bytes of a colour; the fourth byte is 255.
    let most = f64::from((1 << 24) - 1);
    let low = f64::from(u32::MAX) - most;
    let across = ColourMap { low, high: low + most, gradient: Gradient::Grey };
    for spacing_px in [2.0, 5.0] {
        let mut points = wall(&mut Dice(19), DVec3::ZERO, 0.6, 30.0, spacing_px * pixel, RED);
        for p in &mut points {
            let (right, up) = (p.at.x, 10.0 / (10.0 + p.at.y));
            let u = (right * up / (256.0 * pixel) + 0.5).clamp(0.0, 1.0);
            let [r, g, b, _] = ((u * most) as u32).to_le_bytes();
            p.colour = [r, g, b];
        }
        let radius = spacing_px * pixel * 2f64.sqrt();
        let scene = Scene::new(&points, 1e-6, spacing_px * pixel, radius, 10_000);
        for normals in [true, false] {
            let mut draws = scene.draws(true, true, normals);
            for (draw, node) in draws.iter_mut().zip(&scene.nodes) {
                draw.colour = Scene::scalar(node, AttrType::U32);
            }
            let frame = Frame { colour: ColourBy::Scalar(across), ..scene.frame(&view, &draws) };
            let mut pyramid = Pyramid::default();
            Renderer::default().base_level(&frame, &mut pyramid).unwrap();
            pull(&mut pyramid);
            push(&mut pyramid);
            let base = &pyramid.levels[0];
            // The first colour of the map is not quite black.
            let [black, white] = [16, 255].map(|c| linear([c; 3]).x);
            let off = (0..256 * 256).map(|p| {
                let u = (base.tint[p].x - black) / (white - black);
                (f64::from(u) * 256.0 - ((p % 256) as f64 + 0.5)).abs()
            });
            let mean = off.sum::<f64>() / (256.0 * 256.0);
            assert!(mean < 0.3 * spacing_px, "{mean:.2} px at {spacing_px} px, {normals}");
        }
    }
}

/// Points of inner nodes shrink where finer nodes are drawn over them, and only there.
#[test]
fn radii_follow_the_finest_drawn_cell() {
    const CORNER: u32 = 1 << 31;
    let lattice =
        Lattice { scale: [1e-3; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
    let mut root: Node = bytemuck::Zeroable::zeroed();
    (root.corner, root.cell_log2, root.box_min) = ([CORNER; 3], 16, [CORNER; 3]);
    (root.spacing, root.parent, root.first_child, root.child_count) = (8.0, u32::MAX, 1, 1);
    let mut child = root;
    (child.corner[0], child.cell_log2, child.spacing) = (CORNER + (1 << 15), 15, 4.0);
    (child.parent, child.first_child, child.child_count) = (0, 0, 0);
    root.set_levels(&[2]);
    child.set_levels(&[1]);
    let table = NodeTable::of_tree(vec![root, child]);
    let drawn = [
        Drawn { node: 0, prefix: 2, effective_spacing: 8.0 },
        Drawn { node: 1, prefix: 1, effective_spacing: 2.0 },
    ];
    let octree = CompactOctree::new(&table, &drawn);
    // Two points of the root at the same distance from the eye; the child is drawn over the right
    // one.
    let hot: Vec<u8> = [[16_000u16, 9, 9, 128], [48_000, 9, 9, 128]]
        .iter()
        .flat_map(|p| p.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<_>>())
        .collect();
    let draws = [DrawNode {
        node: &table.nodes[0],
        entry: 0,
        prefix: 2,
        above: 0.0,
        position: &hot[..],
        residual: None,
        colour: ColourPlane::None,
        normal: None,
        clip: None,
        tangents: None,
    }];
    let middle = DVec3::new(32.0, 0.0, 0.0);
    let view = View::look_at(middle - DVec3::Y * 60.0, middle, DVec3::Z, 1.0, 64, 64);
    let frame = Frame {
        octree: Some(&octree),
        cull_back_faces: true,
        ..Frame::new(&view, &lattice, &draws)
    };
    let mut pyramid = Pyramid::default();
    assert_eq!(Renderer::default().base_level(&frame, &mut pyramid).unwrap(), 2);
    let base = &pyramid.levels[0];
    let depth: Vec<_> = base.front.iter().filter(|f| f.x.is_finite()).collect();
    let [left, right] = [depth[0], depth[1]].map(|f| f.y - f.x);
    assert!((left / right - 4.0).abs() < 1e-4, "{left} {right}");
}
