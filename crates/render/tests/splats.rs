//! Splats of a frame as discs in the world: they are where EWA splatting draws them, exact far from
//! the origin of the coordinates, the same for any number of threads, and harmless to damage.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::{CompactOctree, Drawn, View};
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES};
use esker_points::{Lattice, Node, NodeTable};
use esker_render::inputs::camera::Positions;
use esker_render::inputs::colour::linear;
use esker_render::{
    Background, ColourBy, ColourMap, ColourPlane, DrawNode, Frame, Gradient, Method, Renderer,
    Splat, ewa, splats,
};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use scene::{Dice, Scene, ScenePoint, sphere};

/// A view of the unit sphere.
fn view() -> View {
    View::look_at(DVec3::new(0.3, -4.0, 0.5), DVec3::ZERO, DVec3::Z, 0.6, 320, 240)
}

/// The unit sphere, in several nodes.
fn ball() -> Scene {
    let points = sphere(&mut Dice(7), DVec3::ZERO, 1.0, 9000, [200, 90, 30]);
    Scene::new(&points, 2f64.powi(-20), 2f64.powi(-6), 2f64.powi(-6), 5000)
}

/// A few points that face the eye, far apart on the picture.
fn lone_points(eye: DVec3) -> Vec<ScenePoint> {
    let places = (0..25).map(|i| [f64::from(i % 5) - 2.0, f64::from(i / 5) - 2.0]);
    places
        .enumerate()
        .map(|(i, [x, z])| {
            let at = DVec3::new(x * 0.4, 0.1 * x * z, z * 0.3);
            let colour = [10 * i as u8, 255 - 10 * i as u8, 128];
            ScenePoint { at, normal: (eye - at).normalize_or_zero(), colour }
        })
        .collect()
}

#[test]
fn ewa_splatting_draws_the_discs_of_points_in_view() {
    let view = view();
    let points = lone_points(view.eye);
    let radius = 0.05;
    let scene = Scene::new(&points, 2f64.powi(-20), radius, radius, 10);
    let draws = scene.draws(true, true, true);
    let (method, background) = (Method::Ewa, Background::Plain([0; 4]));
    let frame = Frame { method, background, ..scene.frame(&view, &draws) };
    let picture = Renderer::default().render(&frame).unwrap();
    let origin = DVec3::new(0.25, -0.5, 0.125);
    let made = splats(&frame, origin);
    assert_eq!(made.len(), points.len());
    let factor = f64::from(ewa::Options::default().radius_factor);
    let depth_at = |at: DVec3| {
        let on = view.project(at).unwrap();
        (on.z, picture.depth[on.y as usize * picture.width as usize + on.x as usize])
    };
    for splat in &made {
        let centre = origin + Vec3::from_array(splat.centre).as_dvec3();
        let point = points.iter().find(|p| p.at.distance(centre) < 1e-5).unwrap();
        assert_eq!(splat.colour, linear(point.colour).to_array());
        assert!(Vec3::from_array(splat.normal).dot(point.normal.as_vec3()) > 0.99999);
        let (exact, drawn) = depth_at(centre);
        assert!((exact / f64::from(drawn) - 1.0).abs() < 1e-3, "{drawn} at depth {exact}");
        // Two pixels for the low-pass filter and the centre of the pixel.
        let pixel = exact / view.focal_px();
        let edge = factor * f64::from(splat.radius);
        for way in [view.world_from_view.x_axis, -view.world_from_view.y_axis] {
            assert!(depth_at(centre + way * (edge - 2.0 * pixel)).1.is_finite());
            assert!(depth_at(centre + way * (edge + 3.0 * pixel)).1.is_infinite());
        }
    }
}

#[test]
fn points_out_of_view_have_splats_too() {
    let (scene, seen) = (ball(), view());
    let draws = scene.draws(true, true, true);
    let made = splats(&scene.frame(&seen, &draws), DVec3::ZERO);
    let away = View::look_at(seen.eye, seen.eye * 2.0, DVec3::Z, 0.6, 320, 240);
    assert_eq!(made, splats(&scene.frame(&away, &draws), DVec3::ZERO));
    assert_eq!(made.len(), 9000);
    let numbers: Vec<_> = made.iter().map(|s| (s.draw, s.index)).collect();
    assert!(numbers.is_sorted() && numbers.last() == Some(&(1, 3999)));
}

#[test]
fn positions_are_exact_far_from_the_origin_of_the_coordinates() {
    let points = sphere(&mut Dice(3), DVec3::ZERO, 50.0, 3000, [9; 3]);
    for (offset, step) in [(0.0, 1e-3), (1e6, 1e-3), (-7e6, 1e-4)] {
        let mut scene = Scene::new(&points, step, 0.5, 0.5, 1000);
        scene.lattice.offset = [offset, -offset, 2.0 * offset];
        let draws = scene.draws(true, true, true);
        let view = view();
        let frame = scene.frame(&view, &draws);
        let exact = |splat: &Splat, origin: DVec3| {
            let draw = &draws[splat.draw as usize];
            let (offset, _) = Positions::of(draw).offset(splat.index as usize);
            let at = [0, 1, 2].map(|i| draw.node.box_min[i] + offset[i]);
            DVec3::from_array(scene.lattice.world(at)) - origin
        };
        for near in [DVec3::ZERO, DVec3::new(50.3, 0.7, -0.1)] {
            let origin = DVec3::from_array(scene.lattice.offset) + near;
            // Coordinates in f64 have this error themselves.
            let rounding = 4.0 * f64::EPSILON * origin.abs().max_element();
            let made = splats(&frame, origin);
            assert_eq!(made.len(), points.len());
            for splat in &made {
                let exact = exact(splat, origin);
                for axis in 0..3 {
                    let off = (f64::from(splat.centre[axis]) - exact[axis]).abs();
                    let allowed = 2.0 * f64::from(f32::EPSILON) * exact[axis].abs();
                    assert!(off <= allowed + rounding + step * 1e-6, "{off} of {exact}");
                }
            }
        }
    }
}

#[test]
fn splats_scale_with_the_unit_and_move_with_the_cloud() {
    let (mut scene, view) = (ball(), view());
    let made = |scene: &Scene, origin| {
        let draws = scene.draws(true, true, true);
        splats(&scene.frame(&view, &draws), origin)
    };
    let origin = DVec3::new(0.5, -0.25, 2.0);
    let before = made(&scene, origin);
    // Powers of two, which round nothing.
    let place = DVec3::new(65_536.0, -1024.0, 512.0);
    scene.lattice.offset = place.to_array();
    assert_eq!(made(&scene, origin + place), before);
    scene.lattice.scale = scene.lattice.scale.map(|s| s * 4.0);
    scene.nodes.iter_mut().for_each(|n| n.node.spacing *= 4.0);
    let larger =
        |s: &Splat| Splat { centre: s.centre.map(|c| c * 4.0), radius: s.radius * 4.0, ..*s };
    let expected: Vec<_> = before.iter().map(larger).collect();
    assert_eq!(made(&scene, origin * 4.0 + place), expected);
}

#[test]
fn a_prefix_has_the_first_splats_of_each_node() {
    let (scene, view) = (ball(), view());
    let whole_draws = scene.draws(true, true, true);
    let whole = splats(&scene.frame(&view, &whole_draws), DVec3::ZERO);
    for prefix in [0, 1, 7, 4097, 9000] {
        let draws: Vec<_> = whole_draws.iter().map(|d| DrawNode { prefix, ..*d }).collect();
        let expected: Vec<_> =
            whole.iter().filter(|s| (s.index as usize) < prefix).copied().collect();
        assert_eq!(splats(&scene.frame(&view, &draws), DVec3::ZERO), expected);
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let (scene, view) = (ball(), view());
    let draws = scene.draws(false, true, true);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| splats(&scene.frame(&view, &draws), DVec3::ONE))
    };
    let one = with(1);
    assert!(one.len() == 9000 && [2, 3, 5].iter().all(|&threads| with(threads) == one));
}

#[test]
fn hidden_points_are_left_out_where_the_frame_hides_points() {
    let (mut scene, view) = (ball(), view());
    for hot in scene.nodes[0].position.chunks_exact_mut(HOT_POSITION_BYTES).step_by(3) {
        hot[HIDDEN_AT] = 1;
    }
    let draws = scene.draws(true, true, true);
    let frame = scene.frame(&view, &draws);
    let all = splats(&frame, DVec3::ZERO);
    let shown = splats(&Frame { hides_points: true, ..frame }, DVec3::ZERO);
    let is_shown = |s: &&Splat| s.draw == 1 || !s.index.is_multiple_of(3);
    assert_eq!(all.len(), 9000);
    assert_eq!(shown, all.iter().filter(is_shown).copied().collect::<Vec<_>>());
}

#[test]
fn radii_follow_the_spacing_that_is_drawn() {
    let (scene, view) = (ball(), view());
    let mut table = NodeTable::default();
    table.nodes.push(Node { parent: esker_points::node::NONE, ..scene.nodes[0].node });
    let octree = |spacing| {
        let drawn = [Drawn { node: 0, prefix: 1, effective_spacing: spacing }];
        CompactOctree::new(&table, &drawn)
    };
    let draws = &scene.draws(true, true, true)[..1];
    let frame = scene.frame(&view, draws);
    let radius = |octree| splats(&Frame { octree, ..frame }, DVec3::ZERO)[0].radius;
    let stored = radius(None);
    // The radius code of one spacing is rounded up by at most a sixteenth of an octave.
    let spacing = scene.nodes[0].node.spacing;
    assert!((1.0..=1.0444).contains(&(stored / spacing)));
    assert_eq!(radius(Some(&octree(spacing * 0.5))), stored * 0.5);
}

#[test]
fn there_are_no_splats_of_nothing_or_from_nowhere() {
    let (scene, view) = (ball(), view());
    let draws = scene.draws(true, true, true);
    assert!(splats(&scene.frame(&view, &[]), DVec3::ZERO).is_empty());
    for origin in [DVec3::splat(f64::NAN), DVec3::X * f64::INFINITY] {
        assert!(splats(&scene.frame(&view, &draws), origin).is_empty());
    }
}

fn plane(bytes: usize) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..bytes)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn random_bits_give_finite_discs(
        record: [[u8; 16]; 9], position in plane(3000), residual in prop::option::of(plane(2000)),
        colours in plane(1500), normal in prop::option::of(plane(1500)),
        prefix in prop_oneof![0usize..400, Just(usize::MAX)], source in 0usize..5, hides_points: bool,
        scale in prop_oneof![Just(1e-3), Just(1e-300), Just(1e300), Just(2f64.powi(-30))],
    ) {
        let node: Node = bytemuck::pod_read_unaligned(&record.concat());
        let draw = DrawNode {
            node: &node, entry: 0, prefix, above: 0.0, position: &position[..], residual: residual.as_deref(),
            colour: ColourPlane::Rgba(&colours[..]), normal: normal.as_deref(), clip: None,
            tangents: None,
        };
        let lattice = Lattice { scale: [scale; 3], offset: [0.0; 3], shift: [0; 3], ..Lattice::default() };
        let map = ColourMap { low: 0.0, high: 1.0, gradient: Gradient::Terrain };
        let by = [ColourBy::Plain, ColourBy::Rgb, ColourBy::Normal, ColourBy::Coordinate(2, map),
            ColourBy::EyeDepth(map)];
        let (view, draws) = (view(), [draw; 2]);
        let frame = Frame { colour: by[source], hides_points, ..Frame::new(&view, &lattice, &draws) };
        let made = splats(&frame, DVec3::ONE);
        prop_assert!(made.len() <= 2 * position.len() / HOT_POSITION_BYTES);
        for s in made {
            prop_assert!(s.centre.iter().chain(&s.colour).all(|c| c.is_finite()), "{:?}", s);
            prop_assert!((0.0..=1e30).contains(&s.radius), "{:?}", s);
            let length = Vec3::from_array(s.normal).length();
            prop_assert!(length == 0.0 || (length - 1.0).abs() < 1e-5, "{:?}", s);
        }
    }
}
