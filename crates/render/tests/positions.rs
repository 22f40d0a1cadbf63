//! Accuracy of drawn positions: greatest displacement in the picture against exact `f64`
//! coordinates, in views from within large clouds far from the origin.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

#[allow(dead_code, reason = "shared with other tests, which use more of it")]
mod scene;

use esker_lod::View;
use esker_points::{Cell, Lattice, Node, quant};
use esker_render::inputs::camera::{Camera, Positions};
use esker_render::{ColourPlane, DrawNode, Frame};
use glam::DVec3;
use scene::Dice;

/// A node of random points within `extent` steps from `min`, many of them close to `near`. Returns
/// the node, its points, hot positions and residuals.
fn node(
    dice: &mut Dice,
    min: [u32; 3],
    extent: u32,
    near: [u32; 3],
) -> (Node, Vec<[u32; 3]>, Vec<u8>, Vec<u8>) {
    let mut points: Vec<[u32; 3]> = (0..4000)
        .map(|i| {
            // Half of the points get closer and closer to the eye.
            let span = if i % 2 == 0 { extent } else { extent >> (i % 30) };
            [0, 1, 2].map(|a| {
                let at = f64::from(near[a]) + (dice.unit() - 0.5) * f64::from(span);
                at.clamp(f64::from(min[a]), f64::from(min[a]) + f64::from(extent)) as u32
            })
        })
        .collect();
    points.push(min);
    points.push(min.map(|c| c + extent));
    let mut node: Node = bytemuck::Zeroable::zeroed();
    let cell = Cell::enclosing(min, min.map(|c| c + extent));
    (node.corner, node.cell_log2, node.box_min) = (cell.corner, cell.log2, min);
    node.hot_shift = quant::hot_shift(extent);
    let (mut hot, mut residual) = (Vec::new(), Vec::new());
    for p in &points {
        for a in 0..3 {
            hot.extend(quant::hot(p[a], min[a], node.hot_shift).to_le_bytes());
        }
        hot.extend([128, 0]);
        let low = [0, 1, 2].map(|a| quant::residual(p[a], min[a], node.hot_shift));
        quant::push_residual(low, node.hot_shift, &mut residual);
    }
    (node, points, hot, residual)
}

/// A node of all its points, without attributes.
fn drawn<'a>(node: &'a Node, hot: &'a [u8], residual: Option<&'a [u8]>) -> DrawNode<'a> {
    DrawNode {
        node,
        entry: 0,
        prefix: hot.len() / quant::HOT_POSITION_BYTES,
        above: 0.0,
        position: hot,
        residual,
        colour: ColourPlane::None,
        normal: None,
        clip: None,
        tangents: None,
    }
}

/// Checks the distance, in pixels, between drawn and exact positions of the points in the picture
/// against `bound_px` of their exact depth. Returns the number of these points.
fn check(
    lattice: &Lattice,
    view: &View,
    draw: &DrawNode<'_>,
    points: &[[u32; 3]],
    bound_px: impl Fn(f64) -> f64,
) -> usize {
    let camera = Camera::of(&Frame::new(view, lattice, std::slice::from_ref(draw))).unwrap();
    let positions = Positions::of(draw);
    let place = camera.place(draw.node, positions.is_exact());
    let mut seen = 0;
    for (i, p) in points.iter().enumerate() {
        let Some(exact) = view.project(DVec3::from_array(lattice.world(*p))) else { continue };
        if !view.is_on_picture(exact) {
            continue;
        }
        let v = camera.to_view(place.steps_from_anchor(positions.offset(i).0) * camera.step);
        let depth = camera.anchor_depth - v.z;
        let scale = camera.focal_px / depth;
        let drawn = [camera.centre_px[0] + v.x * scale, camera.centre_px[1] - v.y * scale];
        let off = (f64::from(drawn[0]) - exact.x).hypot(f64::from(drawn[1]) - exact.y);
        assert!(off <= bound_px(exact.z), "{off} px at depth {} of {p:?}", exact.z);
        let depth_off = (f64::from(depth) / exact.z - 1.0).abs();
        assert!(depth_off <= 1e-3 * bound_px(exact.z).max(1e-3), "depth off by {depth_off}");
        seen += 1;
    }
    seen
}

#[test]
fn exact_points_are_drawn_within_a_hundredth_of_a_pixel_however_close_the_view() {
    let mut dice = Dice(4);
    // Millimetres at 10^7 m; hundredths of a foot; a fine lattice that fills all 32 bits.
    let lattices = [
        Lattice {
            scale: [1e-3; 3],
            offset: [1e7, -1.2e7, 400.0],
            shift: [3, 0, -7],
            ..Lattice::default()
        },
        Lattice {
            scale: [0.01; 3],
            offset: [0.0; 3],
            shift: [500_000_000, 360_000_000, 0],
            ..Lattice::default()
        },
        Lattice {
            scale: [2f64.powi(-34); 3],
            offset: [0.0; 3],
            shift: [0; 3],
            ..Lattice::default()
        },
    ];
    let mut seen = 0;
    for lattice in &lattices {
        for extent in [900, 70_000, 1_000_000, 100_000_000, u32::MAX] {
            let min = if extent == u32::MAX { [0; 3] } else { [2_000_000_000; 3] };
            for _ in 0..6 {
                let near = [0; 3].map(|_| min[0] + (dice.unit() * f64::from(extent)) as u32);
                let (node, points, hot, residual) = node(&mut dice, min, extent, near);
                let eye = DVec3::from_array(lattice.world(near)) + lattice.scale[0] * 0.37;
                let towards = DVec3::new(dice.unit() - 0.5, dice.unit() - 0.5, dice.unit() - 0.5);
                // From within and from outside the lattice.
                for back in [0.0, 5.0 * f64::from(extent) * lattice.scale[0]] {
                    let eye = eye - towards.normalize_or_zero() * back;
                    let mut view = View::look_at(eye, eye + towards, DVec3::Z, 1.0, 1920, 1080);
                    view.near = lattice.scale[0];
                    let draw = drawn(&node, &hot, Some(&residual));
                    // The eye itself is rounded to f64; at 10^7 m that is 2 nm.
                    let eye_error = eye.abs().max_element() * f64::EPSILON * 2.0;
                    let focal = view.focal_px();
                    seen += check(lattice, &view, &draw, &points, |depth| {
                        0.01 + 4.0 * focal * eye_error / depth
                    });
                }
            }
        }
    }
    assert!(seen > 50_000, "only {seen} points are in a picture");
}

#[test]
fn points_are_where_they_belong_through_the_narrowest_pinhole() {
    let mut dice = Dice(6);
    let lattice =
        Lattice { scale: [1e-3; 3], offset: [4e5, 5e6, 90.0], shift: [0; 3], ..Lattice::default() };
    let mut seen = 0;
    for (extent, farther) in [(60_000u32, 3e2), (1_000_000, 1e3), (1_000_000, 1e4)] {
        let near = [2_000_000_000 + extent / 2; 3];
        let (node, points, hot, residual) = node(&mut dice, [2_000_000_000; 3], extent, near);
        let size = f64::from(extent) * 1e-3;
        let target = DVec3::from_array(lattice.world(near));
        // Along an axis and oblique.
        for direction in [DVec3::NEG_Y, DVec3::new(3.0, -8.0, 5.2) / 10.0] {
            let eye = target + direction * size * farther;
            let fovy = 1.5 / (direction.length() * farther);
            let view = View::look_at(eye, target, DVec3::Z, fovy, 1024, 1024);
            let draw = drawn(&node, &hot, Some(&residual));
            // The eye and its direction are rounded to f64, which the reference shares in part.
            seen += check(&lattice, &view, &draw, &points, |_| 0.01);
        }
    }
    assert!(seen > 1000, "only {seen} points are in a picture");
}

#[test]
fn hot_points_alone_are_off_by_at_most_half_a_hot_step() {
    let mut dice = Dice(5);
    let lattice =
        Lattice { scale: [1e-3; 3], offset: [1e7, 1e7, 0.0], shift: [0; 3], ..Lattice::default() };
    let mut seen = 0;
    for extent in [60_000, 1_000_000, 100_000_000] {
        let near = [2_000_000_000 + extent / 2; 3];
        let (node, points, hot, _) = node(&mut dice, [2_000_000_000; 3], extent, near);
        let target = DVec3::from_array(lattice.world(near));
        let eye = target + DVec3::new(0.7, -0.5, 0.6) * f64::from(extent) * 1e-3;
        let view = View::look_at(eye, target, DVec3::Z, 1.0, 1920, 1080);
        let draw = drawn(&node, &hot, None);
        // Half a step an axis, at worst along the diagonal and at the corner of the picture.
        let half = f64::from((1u32 << node.hot_shift) - 1) * 0.5e-3 * 3f64.sqrt();
        let focal = view.focal_px();
        seen += check(&lattice, &view, &draw, &points, |depth| {
            0.01 + 1.6 * focal * half / (depth - half).max(1e-9)
        });
    }
    assert!(seen > 1000);
}
