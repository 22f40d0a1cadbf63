//! Figures 2, 3 and 7 of zwicker2004: splats that touch in space touch in the picture, and splats
//! that cover a surface leave no hole.

use crate::exact::{Exact, lens};
use crate::passes::draw;
use crate::scene::{Dice, Scene, ScenePoint};
use esker_lod::View;
use esker_points::quant::{oct_decode, oct_encode};
use esker_render::ewa::Options;
use esker_render::ewa::mapping::Shape;
use esker_render::ewa::splat::{Disc, Lens};
use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

/// Signed distance of a place to an ellipse, to first order, pixels.
fn distance(shape: &Shape, place: Vec2) -> f64 {
    let c = shape.conic();
    let [across, shear, along] = [c.across, c.shear, c.along].map(f64::from);
    let d = place.as_dvec2();
    let (u, v) = (across * d.x - shear * d.y, along * d.y);
    let slope = DVec2::new(across * u, along * v - shear * u) * 2.0;
    (u * u + v * v - 1.0) / slope.length()
}

/// The affine approximation of earlier EWA splatting, which is exact at the centre only; for
/// comparison.
fn centre_exact(disc: &Disc, lens: &Lens) -> (Vec2, Shape) {
    let m = disc.mapping(lens.focal_px);
    let (a, b) = (m.a, m.b);
    let shape = Shape {
        xx: a[0] * a[0] + b[0] * b[0],
        xy: a[0] * a[1] + b[0] * b[1],
        yy: a[1] * a[1] + b[1] * b[1],
        root: m.area().abs(),
    };
    (Vec2::from_array(m.centre), shape)
}

fn contour(disc: &Disc, lens: &Lens) -> (Vec2, Shape) {
    let m = disc.mapping(lens.focal_px);
    (Vec2::from_array(m.centre) + Vec2::from_array(m.middle()), m.isocontour())
}

#[test]
fn splats_that_touch_in_the_plane_touch_in_the_picture() {
    let lens = lens(1024, 1024, 500.0, 1e-3, 0.0);
    let mut dice = Dice(5);
    let (mut worst, mut classical, mut count) = (0f64, 0f64, 0);
    while count < 20_000 {
        // Grazing angles, and up to 75 degrees off the axis.
        let slope = Vec2::new(dice.unit() as f32 - 0.5, dice.unit() as f32 - 0.5) * 6.0;
        let depth = 1.0 + 9.0 * dice.unit() as f32;
        let contact = Vec3::new(slope.x, slope.y, 1.0) * depth;
        let along = contact.cross(Vec3::new(0.3, 0.9, 0.2)).normalize_or_zero();
        let tilt = 0.01 + 0.6 * dice.unit() as f32;
        let across = along.cross(contact).normalize_or_zero();
        let normal = across * (1.0 - tilt * tilt).sqrt() + contact.normalize_or_zero() * tilt;
        let turn = Vec2::from_angle(dice.unit() as f32 * 6.3);
        let other = normal.cross(along);
        let to_centre = along * turn.x + other * turn.y;
        let radius = depth * 0.1 * dice.unit() as f32;
        for side in [1.0, -1.0] {
            let disc = Disc::round(contact + to_centre * (radius * side), normal, radius);
            let place = (contact.truncate() * (lens.focal_px / contact.z)).as_dvec2();
            let off = |(middle, shape): (Vec2, Shape)| {
                distance(&shape, (place - middle.as_dvec2()).as_vec2()).abs()
            };
            worst = worst.max(off(contour(&disc, &lens)));
            classical = classical.max(off(centre_exact(&disc, &lens)));
            count += 1;
        }
    }
    eprintln!("touching splats: {worst:.5} px apart, exact at the centre {classical:.1} px");
    assert!(worst < 0.01);
    assert!(classical > 5.0);
}

/// The discs of a scene as they are drawn, in view space (x right, y down, z depth), without those
/// that face away.
fn discs(points: &[ScenePoint], view: &View, radius: f64) -> Vec<Exact> {
    let to_view = view.view_from_world();
    let flip = |v: DVec3| DVec3::new(v.x, -v.y, -v.z);
    let focal = view.focal_px();
    let lens = lens(view.width, view.height, focal as f32, view.near as f32, 0.0);
    let facing = points.iter().filter(|p| p.normal.dot(p.at - view.eye) < 0.0);
    facing
        .map(|p| {
            let code = oct_encode(p.normal.as_vec3().to_array());
            let n = Vec3::from_array(oct_decode(code)).as_dvec3().normalize_or_zero();
            let (p, n) = (flip(to_view * (p.at - view.eye)), flip(to_view * n));
            let (a, b) = n.any_orthonormal_pair();
            Exact { p, a: a * radius, b: b * radius, focal, centre: lens.centre_px.as_dvec2() }
        })
        .collect()
}

/// Counts empty pixels whose ray meets a disc more than 0.1 % of its radius inside.
fn holes(discs: &[Exact], view: &View, depth: &[f32]) -> usize {
    let width = view.width as usize;
    let empty = (0..depth.len()).filter(|&i| depth[i] == f32::INFINITY);
    empty
        .filter(|i| {
            let at = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            discs.iter().any(|d| {
                let ray = ((at - d.centre) / d.focal).extend(1.0);
                let normal = d.a.cross(d.b);
                // Discs that are edge on within the precision of `f32` may be missing.
                let sine = normal.dot(d.p).abs() / (normal.length() * d.p.length());
                let depth = normal.dot(d.p) / normal.dot(ray);
                let squared = (ray * depth - d.p).length_squared() / d.a.length_squared();
                sine > 2e-6 && depth > view.near * 1.001 && squared < 0.998
            })
        })
        .count()
}

/// Points of a torus, evenly spread over its parameters.
fn torus(count: usize) -> Vec<ScenePoint> {
    let golden = 0.618_033_988_75;
    (0..count)
        .map(|i| {
            let (u, v) = (i as f64 / count as f64, (i as f64 * golden).fract());
            let (su, cu) = (u * std::f64::consts::TAU).sin_cos();
            let (sv, cv) = (v * std::f64::consts::TAU).sin_cos();
            let normal = DVec3::new(cu * cv, su * cv, sv);
            ScenePoint { at: DVec3::new(cu, su, 0.0) + normal * 0.4, normal, colour: [200; 3] }
        })
        .collect()
}

#[test]
fn no_extreme_view_of_a_closed_model_has_a_hole() {
    let points = torus(700);
    // Spacing and radius are equal, so the drawn radius is the radius times the option's factor.
    let step = 1.0 / f64::from(1u32 << 24);
    let scene = Scene::new(&points, step, 0.2, 0.2, 1 << 16);
    let radius = 0.2 * f64::from(Options::default().radius_factor);
    let found: Vec<(usize, u64, u64)> = (0..1000u64)
        .into_par_iter()
        .map(|seed| {
            let mut dice = Dice(seed * 7919 + 1);
            let mut unit = || dice.unit();
            let near_point = points[(unit() * 699.0) as usize];
            // From almost touching the surface, on either side, to far away; in any direction.
            let height = (0.002f64.ln() + 10f64.ln() * 3.5 * unit()).exp();
            let side = if unit() < 0.2 { -0.3 } else { 1.0 };
            let aside = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 0.3;
            let eye = near_point.at + near_point.normal * height * side + aside * height;
            let target = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 2.5;
            let fovy = 0.1 + 2.5 * unit();
            let up = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5);
            let mut view = View::look_at(eye, target, up, fovy, 48, 40);
            view.near = 1e-4;
            let draws = scene.draws(true, true, true);
            let frame = scene.frame(&view, &draws);
            let options = Options { lowpass: unit() < 0.5, ..Options::default() };
            let (_, depth, counts) = draw(&frame, options);
            let found = holes(&discs(&points, &view, radius), &view, &depth);
            (found, counts.drawn, counts.dropped)
        })
        .collect();
    let [holes, drawn, dropped] = [
        found.iter().map(|f| f.0 as u64).sum::<u64>(),
        found.iter().map(|f| f.1).sum(),
        found.iter().map(|f| f.2).sum(),
    ];
    eprintln!("{drawn} splats in 1000 views, {dropped} dropped, {holes} holes");
    assert_eq!(holes, 0);
    assert!(drawn > 50_000 && dropped * 1000 < drawn);
}

#[test]
fn splats_that_cover_a_plane_leave_no_hole_at_grazing_angles_and_far_off_axis() {
    // A square grid with radius spacing / sqrt(2), plus a margin for the rounding of the radius
    // code.
    const SIDE: i32 = 24;
    let points: Vec<ScenePoint> = (0..SIDE * SIDE)
        .map(|i| {
            let at = DVec3::new(f64::from(i % SIDE - SIDE / 2), f64::from(i / SIDE), 0.0);
            ScenePoint { at, normal: DVec3::Z, colour: [200; 3] }
        })
        .collect();
    let scene = Scene::new(&points, 1.0 / 65536.0, 1.0, 1.0, 1 << 16);
    let factor = 0.7072f32;
    let options = Options { lowpass: false, radius_factor: factor, ..Options::default() };
    let mut dice = Dice(11);
    let mut seen = 0;
    for _ in 0..60 {
        let eye = DVec3::new(dice.unit() * 8.0 - 4.0, -2.0 * dice.unit(), 0.1 + dice.unit());
        let target = DVec3::new(dice.unit() * 30.0 - 15.0, 12.0, -3.0 * dice.unit());
        let mut view = View::look_at(eye, target, DVec3::Z, 2.0, 160, 120);
        view.near = 1e-3;
        let draws = scene.draws(true, true, true);
        let (_, depth, _) = draw(&scene.frame(&view, &draws), options);
        // All rays that meet the square of the grid hit some disc.
        let to_world: DMat3 = view.world_from_view;
        for (i, depth) in depth.iter().enumerate() {
            let (x, y) = ((i % 160) as f64 + 0.5 - 80.0, 60.0 - (i / 160) as f64 - 0.5);
            let ray = to_world * DVec3::new(x, y, -view.focal_px());
            let t = -eye.z / ray.z;
            let at = eye + ray * t;
            let half = f64::from(SIDE / 2);
            let within =
                (-half..half - 1.0).contains(&at.x) && (0.0..f64::from(SIDE) - 1.0).contains(&at.y);
            if t > 0.0 && within && t * view.focal_px() > 2e-3 {
                seen += 1;
                assert!(depth.is_finite(), "a hole at {at} seen from {eye}");
            }
        }
    }
    assert!(seen > 100_000, "{seen}");
}
