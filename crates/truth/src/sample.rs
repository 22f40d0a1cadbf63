//! Points sampled from analytic surfaces, on a regular pattern or as a Poisson-disk sample, and the
//! radius at which they cover the surface.

use crate::dice::Dice;
use crate::{Paint, Shape, Truth};
use esker_lod::View;
use glam::{DVec2, DVec3};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

/// Pattern of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A grid, or a spiral.
    Regular,
    /// Random places at a least distance.
    Poisson,
}

/// A point on a surface.
#[derive(Clone, Copy, Debug)]
pub struct ScenePoint {
    /// Position.
    pub at: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// sRGB.
    pub colour: [u8; 3],
}

/// Points and their radius.
pub struct Sample {
    /// Points of all surfaces.
    pub points: Vec<ScenePoint>,
    /// Greatest distance from a place on the surface to the nearest sample.
    pub radius: f64,
}

impl Shape {
    fn area(&self) -> f64 {
        match *self {
            Shape::Sphere { radius, .. } => 4.0 * PI * radius * radius,
            Shape::Rect { u, v, .. } => u.length() * v.length(),
            Shape::Torus { major, minor } => 4.0 * PI * PI * major * minor,
            Shape::Wire { from, to, radius } => TAU * radius * (to - from).length(),
            Shape::Floor { .. } => 0.0,
        }
    }

    /// Place on the surface, and its normal. Places are uniformly distributed if `a` and `b` are
    /// uniform in 0..1.
    fn place(&self, a: f64, b: f64) -> (DVec3, DVec3) {
        match *self {
            Shape::Sphere { centre, radius } => {
                let (z, r) = (1.0 - 2.0 * a, 2.0 * (a * (1.0 - a)).sqrt());
                let n = DVec3::new(r * (b * TAU).cos(), r * (b * TAU).sin(), z);
                (centre + n * radius, n)
            }
            Shape::Rect { corner, u, v } => {
                (corner + u * a + v * b, u.cross(v).normalize_or_zero())
            }
            Shape::Torus { major, minor } => {
                // Angle around the tube up to which the share of the area is `a`, by Newton's
                // method.
                let (k, mut angle) = (minor / major, a * TAU);
                for _ in 0..20 {
                    let f = angle + k * angle.sin() - a * TAU;
                    angle -= f / (1.0 + k * angle.cos());
                }
                let around = DVec2::from_angle(b * TAU);
                let n = (around * angle.cos()).extend(angle.sin());
                ((around * major).extend(0.0) + n * minor, n)
            }
            Shape::Wire { from, to, radius } => {
                let axis = (to - from).normalize_or_zero();
                let side = axis.any_orthonormal_vector();
                let n = side * (b * TAU).cos() + axis.cross(side) * (b * TAU).sin();
                (from + (to - from) * a + n * radius, n)
            }
            Shape::Floor { .. } => (DVec3::ZERO, DVec3::Z),
        }
    }

    /// Parameters of about `count` places on a regular pattern.
    fn regular(&self, count: f64) -> Vec<(f64, f64)> {
        let grid = |n: f64, m: f64| {
            let (n, m) = (n.round().max(1.0) as u32, m.round().max(1.0) as u32);
            let cell = move |i: u32| {
                ((f64::from(i % n) + 0.5) / f64::from(n), (f64::from(i / n) + 0.5) / f64::from(m))
            };
            (0..n * m).map(cell).collect()
        };
        match *self {
            Shape::Sphere { .. } => {
                let golden = (3.0 - 5f64.sqrt()) / 2.0;
                let n = count.round().max(4.0) as u32;
                (0..n)
                    .map(|i| ((f64::from(i) + 0.5) / f64::from(n), (f64::from(i) * golden).fract()))
                    .collect()
            }
            Shape::Rect { u, v, .. } => {
                let ratio = (u.length() / v.length()).sqrt();
                grid(count.sqrt() * ratio, count.sqrt() / ratio)
            }
            Shape::Torus { major, minor } => {
                let ratio = (minor / major).sqrt();
                grid(count.sqrt() * ratio, count.sqrt() / ratio)
            }
            Shape::Wire { from, to, radius } => {
                let ratio = ((to - from).length() / (TAU * radius)).sqrt();
                grid(count.sqrt() * ratio, (count.sqrt() / ratio).max(1.0))
            }
            Shape::Floor { .. } => Vec::new(),
        }
    }
}

fn point(shape: &Shape, paint: &Paint, (a, b): (f64, f64)) -> ScenePoint {
    let (at, normal) = shape.place(a, b);
    ScenePoint { at, normal, colour: paint.at(at) }
}

/// Samples all surfaces with spacing `spacing`, except floors, which [`floor`] samples.
pub fn sample(truth: &Truth, spacing: f64, kind: Kind, dice: &mut Dice) -> Sample {
    let (mut points, mut radius) = (Vec::new(), 0.0f64);
    for (shape, paint) in &truth.parts {
        let count = shape.area() / (spacing * spacing);
        let own: Vec<_> = match kind {
            Kind::Regular => {
                shape.regular(count).into_iter().map(|p| point(shape, paint, p)).collect()
            }
            Kind::Poisson => poisson(shape, paint, spacing, count, dice),
        };
        radius = radius.max(covering(shape, &own, spacing, dice));
        points.extend(own);
    }
    Sample { points, radius }
}

/// Key of the grid cell that holds `p`; cells are cubes of edge `edge`.
fn cell(p: DVec3, edge: f64) -> [i32; 3] {
    (p / edge).floor().to_array().map(|c| c as i32)
}

fn beside(key: [i32; 3], reach: i32) -> impl Iterator<Item = [i32; 3]> {
    let side = -reach..=reach;
    side.clone().flat_map(move |x| {
        let side = -reach..=reach;
        side.clone()
            .flat_map(move |y| (-reach..=reach).map(move |z| [key[0] + x, key[1] + y, key[2] + z]))
    })
}

/// Dart throwing with a minimum distance of 0.8 spacings.
fn poisson(
    shape: &Shape,
    paint: &Paint,
    spacing: f64,
    count: f64,
    dice: &mut Dice,
) -> Vec<ScenePoint> {
    let least = 0.8 * spacing;
    let mut grid: HashMap<[i32; 3], Vec<DVec3>> = HashMap::new();
    let mut points = Vec::new();
    for _ in 0..(count * 8.0).max(40.0) as usize {
        let p = point(shape, paint, (dice.unit(), dice.unit()));
        let key = cell(p.at, least);
        let near = beside(key, 1).filter_map(|k| grid.get(&k)).flatten();
        if near.into_iter().all(|q| q.distance(p.at) >= least) {
            grid.entry(key).or_default().push(p.at);
            points.push(p);
        }
    }
    points
}

/// Greatest distance from random places on the surface to the nearest point, plus 3 % because the
/// worst place is seldom among them.
fn covering(shape: &Shape, points: &[ScenePoint], spacing: f64, dice: &mut Dice) -> f64 {
    let mut grid: HashMap<[i32; 3], Vec<DVec3>> = HashMap::new();
    points.iter().for_each(|p| grid.entry(cell(p.at, spacing)).or_default().push(p.at));
    let tries = (points.len() * 6).clamp(200, 60_000);
    let worst = (0..tries).map(|_| {
        let at = shape.place(dice.unit(), dice.unit()).0;
        let near = beside(cell(at, spacing), 2).filter_map(|k| grid.get(&k)).flatten();
        near.map(|q| q.distance(at)).fold(spacing * 2.0, f64::min)
    });
    worst.fold(0.0, f64::max) * 1.03
}

/// Samples a floor in bands of distance with a spacing of `spacing_px` pixels at their near edge,
/// like levels of detail. Returns the spacing and the points of each band.
pub fn floor(
    view: &View,
    paint: &Paint,
    z: f64,
    spacing_px: f64,
    kind: Kind,
    dice: &mut Dice,
) -> Vec<(f64, Sample)> {
    let mut bands = Vec::new();
    // The view looks down, so the distance is greater than the distance ahead; and the margin is
    // drawn, too.
    let (half, above) = (view.tan_half().x * 1.4, view.eye.z - z);
    let mut near = 0.3;
    while near < 1500.0 {
        let far = near * 1.2;
        let spacing = near * spacing_px / view.focal_px();
        let side = half * (far + above);
        let (columns, rows) =
            ((2.0 * side / spacing) as i32, ((far - near) / spacing).ceil() as i32);
        let row_edge = (far - near) / f64::from(rows.max(1));
        let mut points = Vec::new();
        for row in 0..rows.max(1) {
            for column in 0..columns.max(1) {
                let (a, b) =
                    if kind == Kind::Regular { (0.5, 0.5) } else { (dice.unit(), dice.unit()) };
                let x = (f64::from(column) + a) * spacing - side;
                let at = DVec3::new(x, near + (f64::from(row) + b) * row_edge, z);
                points.push(ScenePoint { at, normal: DVec3::Z, colour: paint.at(at) });
            }
        }
        let radius = spacing * if kind == Kind::Regular { 0.72 } else { 1.42 };
        bands.push((spacing, Sample { points, radius }));
        near = far;
    }
    bands
}
