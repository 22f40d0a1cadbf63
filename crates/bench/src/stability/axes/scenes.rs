//! Scenes that get worse along an axis: exact surfaces, and scans of them.

use crate::stability::cloud::{Cloud, power_of_two};
use crate::stability::lab::Lab;
use anyhow::Result;
use esker_builder::Options;
use esker_engine::cameras::camera::Camera;
use esker_truth::dice::Dice;
use esker_truth::{Paint, Shape, Truth};
use glam::{DMat3, DVec3};
use std::f64::consts::{PI, TAU};

/// Steps of a distance of points, where the step is not what varies.
const STEPS: f64 = 1024.0;
/// Seed of the noise.
const SEED: u64 = 7;
/// Points of a scene for each square pixel of the picture's height.
const POINTS_A_PIXEL: f64 = 20_000.0 / (160.0 * 160.0);
/// Field of view of cameras that look at a plane or a ball, degrees.
const FOVY_DEG: f64 = 40.0;
/// Edge of a patch, and distance of the middles of patches, in distances of the points of sparse
/// ones. Points of patches are apart: where densities touch, there are two right radii. Patches do
/// not begin where cells do.
const PATCH_SPACINGS: f64 = 8.0;
const PATCHES_APART: f64 = 17.3;
/// Places of close-ups.
const CLOSE_UPS: usize = 16;
/// Points of a node of their scan: as few as a node may have, so that there are many nodes.
const NODE_POINTS: u32 = 1024;
/// Least field of view that is accepted, degrees.
const FOVY_MIN_DEG: f64 = 0.00574;

/// A scan of exact surfaces, and how it is seen.
pub(in crate::stability) struct Scene {
    pub cloud: Cloud,
    parts: Vec<(Shape, Paint)>,
    pub cameras: Vec<Camera>,
    pub options: Options,
    /// The patches that the scan has, if it has any.
    pub patches: Option<Patches>,
    /// Length of outlines times the distance of points, both in pixels; for errors of widths.
    pub outline_px: f64,
}

impl Scene {
    fn new(cloud: Cloud, parts: Vec<(Shape, Paint)>, cameras: Vec<Camera>) -> Self {
        let options = Options::default();
        Self { cloud, parts, cameras, options, patches: None, outline_px: f64::INFINITY }
    }

    /// Its surfaces.
    pub fn truth(&self) -> Truth {
        Truth { parts: self.parts.clone() }
    }
}

/// Squares of two densities by turns, like the fields of a chessboard, with gaps between them.
#[derive(Clone, Copy)]
pub(in crate::stability) struct Patches {
    /// Distance of the middles of patches.
    apart: f64,
    /// Distance of the points of sparse patches; that of the others is 1.
    sparse: f64,
}

impl Patches {
    /// Distance of the points around a place.
    pub fn spacing_at(&self, at: DVec3) -> f64 {
        let [column, row] = [at.x, at.y].map(|c| (c / self.apart).floor() as i64);
        if (column + row) % 2 == 0 { 1.0 } else { self.sparse }
    }
}

/// Points of a scene: as many as have the same distances on a picture of any size.
fn points(lab: &Lab<'_>) -> usize {
    (POINTS_A_PIXEL * f64::from(lab.size[1]).powi(2)) as usize
}

/// Numbers in 0..1 that fill a square evenly (an additive recurrence with the plastic number).
fn even(count: usize) -> impl Iterator<Item = [f64; 2]> {
    let share = |i: usize, k: f64| (i as f64 * k).fract();
    (1..=count).map(move |i| [share(i, 0.754_877_666_246_693), share(i, 0.569_840_290_998_053)])
}

/// A normally distributed number.
fn normal(dice: &mut Dice) -> f64 {
    (-2.0 * dice.unit().max(1e-300).ln()).sqrt() * (dice.unit() * TAU).cos()
}

/// A square in the plane z = 0.
fn square(half: f64) -> Shape {
    let corner = DVec3::new(-half, -half, 0.0);
    Shape::Rect { corner, u: DVec3::X * 2.0 * half, v: DVec3::Y * 2.0 * half }
}

/// Even points in that square.
fn in_square(count: usize, half: f64) -> impl Iterator<Item = DVec3> {
    even(count).map(move |[a, b]| DVec3::new(2.0 * a - 1.0, 2.0 * b - 1.0, 0.0) * half)
}

fn painted(places: impl Iterator<Item = DVec3>, paint: &Paint, step: f64) -> Cloud {
    Cloud::of(&places.map(|at| (at, paint.at(at))).collect::<Vec<_>>(), step)
}

/// A camera above a place, with so many pixels a unit.
fn above(at: [f64; 2], px: f64, lab: &Lab<'_>) -> Result<Camera> {
    let height = f64::from(lab.size[1]) / 2.0 / (FOVY_DEG / 2.0).to_radians().tan() / px;
    let [x, y] = at;
    Camera::parse(&format!("eye={x:?},{y:?},{height:?};direction=0,0,-1;up=0,1,0;fovy={FOVY_DEG}"))
}

/// A camera `distance` away from a ball of radius 1, which fills the picture as far as the field of
/// view can be so narrow.
fn at_ball(distance: f64, fovy_deg: f64) -> Result<Camera> {
    Camera::parse(&format!("eye=0,{:?},0;target=0,0,0;fovy={fovy_deg:?}", -distance))
}

/// Field of view of a ball of radius 1 that fills the picture.
fn ball_fovy_deg(distance: f64) -> f64 {
    2.0 * (1.2 / distance).atan().to_degrees()
}

const BALL: Shape = Shape::Sphere { centre: DVec3::ZERO, radius: 1.0 };
const BALL_PAINT: Paint = Paint::Waves(0.7);

/// Even places on the ball.
fn on_ball(count: usize) -> impl Iterator<Item = DVec3> {
    even(count).map(|[a, b]| {
        let (z, turn) = (1.0 - 2.0 * a, b * TAU);
        let side = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(side * turn.cos(), side * turn.sin(), z)
    })
}

fn ball_spacing(count: usize) -> f64 {
    (4.0 * PI / count as f64).sqrt()
}

fn ball(cloud: Cloud, camera: Camera) -> Scene {
    Scene::new(cloud, vec![(BALL, BALL_PAINT)], vec![camera])
}

/// A square of points at a distance of 1.
pub(in crate::stability) fn plane(count: usize) -> Cloud {
    let half = (count as f64).sqrt() / 2.0;
    painted(in_square(count, half), &Paint::Waves(40.0), 1.0 / STEPS)
}

/// A square of points at a distance of 1 in one of points `jump` times less dense: the scan, half
/// the edges of both, and the distance of the sparse points.
pub(in crate::stability) fn jump(jump: f64, count: usize) -> (Cloud, [f64; 2], f64) {
    let (dense, around) = (count * 15 / 16, count / 16);
    let sparse = jump.sqrt();
    let inner = (dense as f64).sqrt() / 2.0;
    // The sparse points that the dense square replaces are left out.
    let covered = (4.0 * inner * inner / (sparse * sparse)) as usize;
    let outer = ((around + covered) as f64).sqrt() * sparse / 2.0;
    let is_outside = |p: &DVec3| p.abs().max_element() > inner;
    let sparse_points = in_square(around + covered, outer).filter(is_outside);
    let step = power_of_two((outer / 1e8).max(1.0 / 64.0));
    let places = in_square(dense, inner).chain(sparse_points);
    (painted(places, &Paint::Plain([200, 120, 60]), step), [inner, outer], sparse)
}

/// A square of points of which a share is at one place.
pub(in crate::stability) fn coincident(share: f64, count: usize) -> Cloud {
    let apart = ((count as f64) * (1.0 - share)).round().max(1.0) as usize;
    let half = (apart as f64).sqrt() / 2.0;
    let same = std::iter::repeat_n(DVec3::new(0.25, 0.125, 0.0), count - apart.min(count));
    painted(in_square(apart, half).chain(same), &Paint::Waves(40.0), 1.0 / STEPS)
}

/// A square of points, and one point so many extents away.
pub(in crate::stability) fn outlier(extents: f64, count: usize) -> Cloud {
    let half = (count as f64).sqrt() / 2.0;
    let far = DVec3::new(2.0 * half * extents, 0.0, 0.0);
    let step = power_of_two((far.x / 1e9).max(1.0 / STEPS));
    painted(in_square(count, half).chain([far]), &Paint::Waves(40.0), step)
}

pub(super) fn density_jump(ratio: f64, lab: &Lab<'_>) -> Result<Scene> {
    let (cloud, [inner, outer], sparse) = jump(ratio, points(lab));
    let side = f64::from(lab.size[1]);
    let cameras = vec![
        above([0.0, 0.0], side / (2.2 * outer), lab)?,
        above([0.0, 0.0], side / (4.0 * inner), lab)?,
        above([inner, 0.2 * inner], 1.5, lab)?,
        above([inner, inner], 6.0, lab)?,
    ];
    let edge = outer - 1.5 * sparse;
    Ok(Scene::new(cloud, vec![(square(edge), Paint::Plain([200, 120, 60]))], cameras))
}

pub(super) fn step(over_spacing: f64, lab: &Lab<'_>) -> Result<Scene> {
    let spacing = ball_spacing(points(lab));
    let cloud = painted(on_ball(points(lab)), &BALL_PAINT, over_spacing * spacing);
    Ok(ball(cloud, at_ball(6.0, ball_fovy_deg(6.0))?))
}

pub(super) fn noise(over_spacing: f64, lab: &Lab<'_>) -> Result<Scene> {
    let spacing = ball_spacing(points(lab));
    let mut dice = Dice(SEED);
    let places = on_ball(points(lab)).map(|at| {
        let moved = at * (1.0 + normal(&mut dice) * over_spacing * spacing);
        (moved, BALL_PAINT.at(at))
    });
    let cloud = Cloud::of(&places.collect::<Vec<_>>(), spacing / STEPS);
    Ok(ball(cloud, at_ball(6.0, ball_fovy_deg(6.0))?))
}

/// A square that is scanned in rows, with a noise of a tenth of the distance within a row.
pub(super) fn scan_lines(ratio: f64, lab: &Lab<'_>) -> Result<Scene> {
    let (column, half) = (1.0 / ratio.sqrt(), (points(lab) as f64).sqrt() / 2.0);
    let row = column * ratio;
    let turn = DMat3::from_rotation_x(0.5) * DMat3::from_rotation_z(0.3);
    let mut dice = Dice(SEED);
    let [rows, columns] = [row, column].map(|apart| (2.0 * half / apart).round() as usize);
    let paint = Paint::Waves(40.0);
    let mut places = Vec::new();
    for (i, j) in (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))) {
        let mut off = || normal(&mut dice) * 0.1 * column;
        let noise = DVec3::new(off(), off(), off());
        let flat = DVec3::new((j as f64 + 0.5) * column - half, (i as f64 + 0.5) * row - half, 0.0);
        let at = turn * (flat + noise);
        places.push((at, paint.at(at)));
    }
    let Shape::Rect { corner, u, v } = square(half) else { anyhow::bail!("a square is one") };
    let shape = Shape::Rect { corner: turn * corner, u: turn * u, v: turn * v };
    let camera = above([0.0, 0.0], f64::from(lab.size[1]) / (2.4 * half), lab)?;
    Ok(Scene::new(Cloud::of(&places, column / STEPS), vec![(shape, paint)], vec![camera]))
}

pub(super) fn point_distance(px: f64, lab: &Lab<'_>) -> Result<Scene> {
    let count = points(lab);
    let half = (count as f64).sqrt() / 2.0;
    let cameras = vec![above([0.3, 0.2], px, lab)?];
    Ok(Scene::new(plane(count), vec![(square(half), Paint::Waves(40.0))], cameras))
}

/// A surface so rough that many of its points have no normal.
pub(super) fn parts(px: f64, lab: &Lab<'_>) -> Result<Scene> {
    let count = 10 * points(lab);
    let half = (count as f64).sqrt() / 2.0;
    let (mut dice, paint) = (Dice(SEED), Paint::Waves(40.0));
    let rough = in_square(count, half).map(|at| at + DVec3::Z * normal(&mut dice));
    let cloud = painted(rough.collect::<Vec<_>>().into_iter(), &paint, 1.0 / STEPS);
    Ok(Scene::new(cloud, vec![(square(half), paint)], vec![above([0.3, 0.2], px, lab)?]))
}

/// A chessboard of patches, the points of one of which are `ratio` times as dense as those beside.
pub(super) fn patches(ratio: f64, lab: &Lab<'_>) -> Result<Scene> {
    let sparse = ratio.sqrt();
    let (edge, apart) = (PATCH_SPACINGS * sparse, PATCHES_APART * sparse);
    let patches = Patches { apart, sparse };
    let points_of_two = edge.powi(2) * (1.0 + 1.0 / ratio);
    let across = (2.0 * points(lab) as f64 / points_of_two).sqrt().ceil() as i32;
    let mut places = Vec::new();
    for (i, j) in (0..across).flat_map(|i| (0..across).map(move |j| (i, j))) {
        let middle = DVec3::new(f64::from(i) + 0.5, f64::from(j) + 0.5, 0.0) * apart;
        let count = (edge / patches.spacing_at(middle)).powi(2).round() as usize;
        places.extend(in_square(count, edge / 2.0).map(|at| middle + at));
    }
    let (side, paint) = (f64::from(across) * apart, Paint::Waves(40.0));
    let cloud = painted(places.into_iter(), &paint, 1.0 / STEPS);
    let corner = DVec3::ZERO;
    let shape = Shape::Rect { corner, u: DVec3::X * side, v: DVec3::Y * side };
    let camera = above([side / 2.0; 2], f64::from(lab.size[1]) / (1.1 * side), lab)?;
    let scene = Scene::new(cloud, vec![(shape, paint)], vec![camera]);
    Ok(Scene { patches: Some(patches), ..scene })
}

/// A part of a plane of many small nodes, at places that begin anywhere in them.
pub(super) fn close_up(share: f64, lab: &Lab<'_>) -> Result<Scene> {
    let count = 4 * points(lab);
    let side = (count as f64).sqrt();
    let px = f64::from(lab.size[1]) / (share * side);
    let places = even(CLOSE_UPS).map(|place| place.map(|a| (a - 0.5) * (1.0 - share) * side));
    let cameras = places.map(|at| above(at, px, lab)).collect::<Result<_>>()?;
    let parts = vec![(square(side / 2.0), Paint::Waves(40.0))];
    let options = Options { node_capacity: NODE_POINTS, ..Options::default() };
    Ok(Scene { options, ..Scene::new(plane(count), parts, cameras) })
}

pub(super) fn height(over_spacing: f64, lab: &Lab<'_>) -> Result<Scene> {
    let count = 4 * points(lab);
    let half = (count as f64).sqrt() / 2.0;
    let camera = format!("eye=0.3,{:?},{over_spacing:?};direction=0.1,1,-0.2;fovy=50", -0.7 * half);
    let cameras = vec![Camera::parse(&camera)?];
    Ok(Scene::new(plane(count), vec![(square(half), Paint::Waves(40.0))], cameras))
}

/// A room, seen from within.
pub(super) fn wide(fovy_deg: f64, lab: &Lab<'_>) -> Result<Scene> {
    let camera = format!("eye=0.3,0.2,0.1;direction=1,0.3,-0.1;fovy={fovy_deg:?}");
    let camera = Camera::parse(&camera)?;
    let paint = Paint::Waves(1.3);
    let face = |i: usize| {
        let [u, v] = [1, 2].map(|k| DVec3::AXES[(i + k) % 3] * 4.0);
        let sign = if i < 3 { 2.0 } else { -2.0 };
        (Shape::Rect { corner: DVec3::AXES[i % 3] * sign - (u + v) * 0.5, u, v }, paint)
    };
    let parts: Vec<(Shape, Paint)> = (0..6).map(face).collect();
    let mut places = Vec::new();
    for (shape, _) in &parts {
        if let Shape::Rect { corner, u, v } = *shape {
            places.extend(even(points(lab) / 2).map(|[a, b]| corner + u * a + v * b));
        }
    }
    let cloud = painted(places.into_iter(), &paint, 2f64.powi(-14));
    Ok(Scene::new(cloud, parts, vec![camera]))
}

/// A ball from so far away that it fills a narrow field of view.
pub(super) fn narrow(fovy_deg: f64, lab: &Lab<'_>) -> Result<Scene> {
    let distance = 1.2 / (fovy_deg / 2.0).to_radians().tan();
    let cloud = painted(on_ball(points(lab)), &BALL_PAINT, ball_spacing(points(lab)) / STEPS);
    Ok(ball(cloud, at_ball(distance, fovy_deg)?))
}

/// A ball from so many of its diameters away.
pub(super) fn eye_distance(extents: f64, lab: &Lab<'_>) -> Result<Scene> {
    let distance = 2.0 * extents;
    let cloud = painted(on_ball(points(lab)), &BALL_PAINT, ball_spacing(points(lab)) / STEPS);
    Ok(ball(cloud, at_ball(distance, ball_fovy_deg(distance).max(FOVY_MIN_DEG))?))
}

/// 1,024 points apart, and so many at one place that they are the given share.
pub(super) fn same_place(share: f64, lab: &Lab<'_>) -> Result<Scene> {
    let apart = 1024.0;
    let cloud = coincident(share, (apart / (1.0 - share)).round() as usize);
    let parts = vec![(square(16.0), Paint::Waves(40.0))];
    let camera = above([0.0, 0.0], f64::from(lab.size[1]) / 40.0, lab)?;
    Ok(Scene::new(cloud, parts, vec![camera]))
}

/// Strips of a width in distances of their points, from sheets to wires.
pub(super) fn thickness(over_spacing: f64, lab: &Lab<'_>) -> Result<Scene> {
    const APART: f64 = 20.0;
    let (length, strips) = (200.0, 12);
    let count = (length * over_spacing.max(1.0)) as usize;
    let paint = Paint::Plain([90, 160, 210]);
    let (mut places, mut parts) = (Vec::new(), Vec::new());
    for strip in 0..strips {
        let y = (f64::from(strip) - f64::from(strips) / 2.0 + 0.5) * APART;
        let corner = DVec3::new(-length / 2.0, y - over_spacing / 2.0, 0.0);
        let (u, v) = (DVec3::X * length, DVec3::Y * over_spacing);
        parts.push((Shape::Rect { corner, u, v }, paint));
        places.extend(even(count).map(|[a, b]| corner + u * a + v * b));
    }
    let cloud = painted(places.into_iter(), &paint, 1.0 / STEPS);
    // Two strips are seen.
    let px = f64::from(lab.size[1]) / (2.0 * APART);
    let camera = above([0.0, 0.0], px, lab)?;
    let outline_px = 2.0 * f64::from(lab.size[0]) * px;
    Ok(Scene { outline_px, ..Scene::new(cloud, parts, vec![camera]) })
}
