//! Visibility, attributes and normalisation: which splats are blended, and sums of thousands of
//! splats and of almost none.

use crate::scene::{Dice, Scene, ScenePoint, sheet, sphere};
use esker_lod::View;
use esker_points::quant::HIDDEN_AT;
use esker_render::ewa::{Counts, Ewa, Options, Passes};
use esker_render::inputs::camera::Camera;
use esker_render::inputs::colour;
use esker_render::inputs::lookup::{DrawList, Lookup};
use esker_render::passes::fit_planes::FittedPlanes;
use esker_render::passes::project::{EMPTY, project};
use esker_render::picture::pyramid::{Level, Pyramid};
use esker_render::picture::surface::Surface;
use esker_render::{Frame, FramePlan, Method, Renderer};
use glam::{DVec3, Vec3, Vec4};
use std::sync::atomic::AtomicU64;

/// Draws level 0; also returns its depths (infinite where there is no splat) and counts.
pub fn draw(frame: &Frame<'_>, options: Options) -> (Level, Vec<f32>, Counts) {
    let frame = Frame { method: Method::Ewa, ..*frame };
    let camera = Camera::new(frame.view, frame.lattice).unwrap();
    let [width, height] = camera.size.map(|s| s as usize);
    let list = DrawList::new(frame.draws);
    let lookup = Lookup::new(&frame, &camera, &list);
    let plan = FramePlan::new(&frame);
    let mut ewa = Ewa::default();
    ewa.options = options;
    let fitted = plan.fits_planes().then(|| {
        let target: Vec<_> = (0..width * height).map(|_| AtomicU64::new(EMPTY)).collect();
        project(&frame, &camera, &list, &target);
        let mut fitted = FittedPlanes::default();
        fitted.fill(&target, width, camera.focal_px, plan.shares(), plan.plane_levels());
        fitted
    });
    let counts = ewa.place(&frame, &camera, &list, &lookup, &plan, fitted.as_ref());
    let mut depth = vec![0.0; width * height];
    ewa.draw(&camera, plan.carries_normals, &mut depth);
    let mut pyramid = Pyramid::default();
    pyramid.fit(width, height, plan.planes());
    let mut level = pyramid.levels.swap_remove(0);
    for (pixel, &depth) in depth.iter().enumerate() {
        let (x, y, planes) = (pixel % width, pixel / width, &ewa.planes);
        level.front[pixel] = Vec4::new(depth, depth, 0.0, 0.0);
        level.depth[pixel] = depth;
        level.tint[pixel] = planes.tint(x, y).extend(0.0);
        if plan.carries_normals {
            level.normal[pixel] = planes.normal(x, y).extend(0.0);
        }
    }
    (level, depth, counts)
}

fn front(size: u32) -> View {
    let mut view =
        View::look_at(DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, DVec3::Z, 0.6, size, size);
    view.near = 0.01;
    view
}

fn wall(dice: &mut Dice, y: f64, side: usize, colour: [u8; 3]) -> Vec<ScenePoint> {
    let corner = DVec3::new(-2.0, y, -2.0);
    sheet(dice, corner, DVec3::X * 4.0, DVec3::Z * 4.0, side, colour)
}

#[test]
fn splats_close_behind_the_front_are_blended_and_those_far_behind_are_not() {
    let view = front(64);
    let mut dice = Dice(3);
    let red = |behind: f64| {
        let mut points = wall(&mut dice, 0.0, 60, [255, 0, 0]);
        points.extend(wall(&mut dice, behind, 60, [0, 255, 0]));
        let scene = Scene::new(&points, 1e-5, 4.0 / 60.0, 4.0 / 60.0, 1 << 16);
        let draws = scene.draws(true, true, true);
        let (level, ..) = draw(&scene.frame(&view, &draws), Options::default());
        let all = level.tint.len() as f32;
        level.tint.iter().map(|t| t.x).sum::<f32>() / all
    };
    let [close, far] = [0.01, 0.3].map(red);
    assert!((0.3..0.7).contains(&close), "{close}");
    assert!((far - 1.0).abs() < 1e-5, "{far}");
}

#[test]
fn thousands_of_splats_on_a_pixel_neither_overflow_nor_get_lost() {
    // Sums of half floats stop growing by one at 2,048, and overflow above 65,504.
    let view = front(16);
    let count = 70_000;
    let points: Vec<_> = (0..count)
        .map(|i| {
            // The second half of the splats must count as much as the first.
            let colour = if i < count / 2 { [255, 0, 0] } else { [0, 0, 255] };
            ScenePoint { at: DVec3::ZERO, normal: DVec3::NEG_Y, colour }
        })
        .collect();
    let scene = Scene::new(&points, 1e-5, 0.5, 0.5, 1 << 10);
    let draws = scene.draws(true, true, true);
    let (level, ..) = draw(&scene.frame(&view, &draws), Options::default());
    let tint = level.tint[8 * 16 + 8];
    assert!((tint.x - 0.5).abs() < 1e-3 && (tint.z - 0.5).abs() < 1e-3, "{tint}");
}

#[test]
fn a_single_splat_has_its_own_colour_up_to_its_edge_and_almost_edge_on() {
    let view = front(64);
    for tilt in [1.0, 1e-2, 1e-4] {
        let normal = DVec3::new(1.0, -tilt, 0.0).normalize_or_zero();
        let point = ScenePoint { at: DVec3::ZERO, normal, colour: [10, 200, 90] };
        let scene = Scene::new(&[point], 1e-5, 0.4, 0.4, 16);
        let draws = scene.draws(true, true, true);
        let options = Options { cutoff: 2.0, ..Options::default() };
        let (level, ..) = draw(&scene.frame(&view, &draws), options);
        let covered: Vec<_> = (0..level.tint.len()).filter(|&i| level.is_valid(i)).collect();
        assert!(covered.len() > 40, "{}", covered.len());
        let own = colour::linear([10, 200, 90]);
        for i in covered {
            assert!((level.tint[i].truncate() - own).length() < 1e-5);
            assert!((2.9..5.4).contains(&level.depth[i]));
            assert!(level.normal[i].truncate().normalize_or_zero().is_finite());
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_the_picture() {
    let mut dice = Dice(9);
    let points = sphere(&mut dice, DVec3::ZERO, 1.0, 40_000, [90, 120, 200]);
    let scene = Scene::new(&points, 1e-5, 0.02, 0.02, 5000);
    let view = front(200);
    let draws = scene.draws(true, true, true);
    let frame = Frame { method: Method::Ewa, ..scene.frame(&view, &draws) };
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| Renderer::default().render(&frame).unwrap())
    });
    assert_eq!(one.rgba, three.rgba);
    assert_eq!(one.depth, three.depth);
    assert!(one.stats.splats_drawn > 10_000 && one.stats.pixels_covered > 5_000);
}

#[test]
fn clouds_without_normals_have_no_holes_and_are_lit_by_their_depth() {
    let mut dice = Dice(4);
    let points = sphere(&mut dice, DVec3::ZERO, 1.0, 8000, [90, 120, 200]);
    // Uniformly random points leave wider gaps than the samples in a file.
    let spacing = 1.6 * (4.0 * std::f64::consts::PI / 8000.0f64).sqrt();
    let scene = Scene::new(&points, 1e-5, spacing, spacing, 1 << 16);
    let view = front(128);
    let draws = scene.draws(true, true, false);
    let frame = Frame { method: Method::Ewa, ..scene.frame(&view, &draws) };
    let picture = Renderer::default().render(&frame).unwrap();
    // Radius of the sphere in the picture, 4 units away, less 3 % for its rim.
    let radius = view.focal_px() / 15f64.sqrt() * 0.97;
    for (i, depth) in picture.depth.iter().enumerate() {
        let (x, y) = ((i % 128) as f64 - 63.5, (i / 128) as f64 - 63.5);
        if x.hypot(y) < radius {
            assert!((2.9..4.2).contains(depth), "{x} {y}: {depth}");
        }
    }
    let shades = |x: usize| picture.rgba[(64 * 128 + x) * 4];
    assert_ne!(shades(40), shades(88), "lit from one side");
}

#[test]
fn the_single_pass_shows_the_nearest_splat() {
    let view = front(32);
    let mut dice = Dice(8);
    let mut points = wall(&mut dice, 0.0, 40, [255, 0, 0]);
    points.extend(wall(&mut dice, 0.02, 40, [0, 255, 0]));
    let scene = Scene::new(&points, 1e-5, 0.1, 0.1, 1 << 16);
    let draws = scene.draws(true, true, true);
    let options = Options { passes: Passes::One, ..Options::default() };
    let (level, ..) = draw(&scene.frame(&view, &draws), options);
    assert!(level.tint.iter().all(|t| t.truncate() == Vec3::X));
}

#[test]
fn points_that_a_filter_hides_are_not_drawn_as_splats() {
    let view = front(32);
    let mut dice = Dice(6);
    let mut points = wall(&mut dice, 0.0, 40, [255, 0, 0]);
    points.extend(wall(&mut dice, 0.02, 40, [0, 255, 0]));
    let mut scene = Scene::new(&points, 1e-5, 0.1, 0.1, 1 << 16);
    let node = &mut scene.nodes[0];
    for (colour, position) in node.colour.chunks(4).zip(node.position.chunks_mut(8)) {
        position[HIDDEN_AT] = u8::from(colour[0] == 255);
    }
    let draws = scene.draws(true, true, true);
    let frame = Frame { hides_points: true, ..scene.frame(&view, &draws) };
    let (level, _, counts) = draw(&frame, Options::default());
    assert!(level.tint.iter().all(|t| t.x == 0.0 && (t.y - 1.0).abs() < 1e-5));
    assert!(counts.drawn <= 1600);
}
