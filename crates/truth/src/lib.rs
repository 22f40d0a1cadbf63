//! What pictures are measured against: analytic scenes with exact ground truth, in `f64`.
//!
//! A [`Truth`] is surfaces with colours, of which any ray tells depth, normal and colour.
//! [`image`] makes the perfect picture of a view, [`sample`] points on the surfaces as a scanner
//! would see them, and [`flip`] compares two pictures as an eye does. Tests of the crates that draw
//! and the benchmark of error against time share it.

pub mod dice;
pub mod flip;
pub mod image;
pub mod sample;

use esker_lod::View;
use glam::{DMat3, DVec2, DVec3};

/// A surface.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// Sphere.
    Sphere {
        /// Centre.
        centre: DVec3,
        /// Radius.
        radius: f64,
    },
    /// Rectangle with a corner and its two edges.
    Rect {
        /// Corner from which the edges start.
        corner: DVec3,
        /// First edge.
        u: DVec3,
        /// Second edge.
        v: DVec3,
    },
    /// Torus around the z axis, centred at the origin.
    Torus {
        /// Radius of the circle in the middle of the tube.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// Cylinder without end caps.
    Wire {
        /// One end of its axis.
        from: DVec3,
        /// The other end.
        to: DVec3,
        /// Radius.
        radius: f64,
    },
    /// Infinite plane of constant z.
    Floor {
        /// Its height.
        z: f64,
    },
}

/// Colours on a surface, sRGB.
#[derive(Clone, Copy, Debug)]
pub enum Paint {
    /// One colour.
    Plain([u8; 3]),
    /// Checkerboard of cubes: edge and two colours.
    Checks(f64, [u8; 3], [u8; 3]),
    /// Smooth waves, by wavelength.
    Waves(f64),
}

/// A scene: surfaces and their colours.
pub struct Truth {
    /// Surfaces, each with its colours.
    pub parts: Vec<(Shape, Paint)>,
}

/// An intersection of a ray and a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Parameter along the ray, in lengths of its direction vector.
    pub t: f64,
    /// Unit normal in world space, towards the origin of the ray.
    pub normal: DVec3,
    /// sRGB.
    pub colour: [u8; 3],
    /// Index of the surface in [`Truth::parts`].
    pub part: usize,
}

impl Paint {
    /// Colour at a place.
    pub fn at(&self, p: DVec3) -> [u8; 3] {
        match *self {
            Paint::Plain(c) => c,
            Paint::Checks(edge, a, b) => {
                let cell = (p / edge + 1e-4).floor();
                if (cell.x + cell.y + cell.z).rem_euclid(2.0) < 0.5 { a } else { b }
            }
            Paint::Waves(length) => {
                let wave = |v: f64| 127.5 + 100.0 * (v / length * std::f64::consts::TAU).sin();
                [wave(p.x) as u8, wave(p.y + p.z) as u8, wave(p.z - p.x) as u8]
            }
        }
    }
}

impl Shape {
    /// Intersections with a ray: parameters, smallest first, and outward normals.
    pub fn hits(&self, from: DVec3, direction: DVec3) -> Vec<(f64, DVec3)> {
        let at = |t: f64| from + direction * t;
        match *self {
            Shape::Sphere { centre, radius } => {
                let o = from - centre;
                let roots = quadratic(
                    direction.dot(direction),
                    2.0 * o.dot(direction),
                    o.dot(o) - radius * radius,
                );
                roots.into_iter().map(|t| (t, (at(t) - centre) / radius)).collect()
            }
            Shape::Rect { corner, u, v } => {
                let normal = u.cross(v).normalize_or_zero();
                let t = normal.dot(corner - from) / normal.dot(direction);
                let p = at(t) - corner;
                let [a, b] = [u, v].map(|e| p.dot(e) / e.length_squared());
                let inside = (0.0..=1.0).contains(&a) && (0.0..=1.0).contains(&b);
                if inside { vec![(t, normal)] } else { Vec::new() }
            }
            Shape::Floor { z } => vec![((z - from.z) / direction.z, DVec3::Z)],
            Shape::Wire { from: a, to: b, radius } => {
                let axis = (b - a).normalize_or_zero();
                let across = |v: DVec3| v - axis * v.dot(axis);
                let (o, d) = (across(from - a), across(direction));
                let roots = quadratic(d.dot(d), 2.0 * o.dot(d), o.dot(o) - radius * radius);
                let on = |t: &f64| (0.0..=(b - a).length()).contains(&(at(*t) - a).dot(axis));
                let roots = roots.into_iter().filter(on);
                roots.map(|t| (t, across(at(t) - a) / radius)).collect()
            }
            Shape::Torus { major, minor } => {
                let ring = |p: DVec3| p.truncate().length() - major;
                let far = |p: DVec3| ring(p).hypot(p.z) - minor;
                let (mut t, mut found) = (0.0, Vec::new());
                let length = direction.length();
                let end = (from.length() + 2.0 * (major + minor)) / length;
                while t < end && found.len() < 4 {
                    let step = far(at(t)).abs();
                    if step < 1e-9 {
                        let p = at(t);
                        let flat = p.truncate().normalize_or_zero() * ring(p);
                        found.push((t, (flat.extend(p.z) / minor).normalize_or_zero()));
                        t += 1e-4 * minor / length;
                        continue;
                    }
                    t += step.max(1e-10) / length;
                }
                found
            }
        }
    }
}

fn quadratic(a: f64, b: f64, c: f64) -> Vec<f64> {
    let under = b * b - 4.0 * a * c;
    if under < 0.0 {
        return Vec::new();
    }
    let root = under.sqrt();
    vec![(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)]
}

impl Truth {
    /// Intersections of a ray with all surfaces, nearest first.
    pub fn hits(&self, from: DVec3, direction: DVec3) -> Vec<Hit> {
        let mut all: Vec<Hit> = Vec::new();
        for (part, (shape, paint)) in self.parts.iter().enumerate() {
            for (t, normal) in shape.hits(from, direction) {
                if t > 1e-9 && t.is_finite() {
                    let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
                    all.push(Hit { t, normal, colour: paint.at(from + direction * t), part });
                }
            }
        }
        all.sort_by(|a, b| a.t.total_cmp(&b.t));
        all
    }

    /// Direction of the ray through a place of the picture (pixels); its depth is 1.
    pub fn ray(view: &View, place: DVec2) -> DVec3 {
        let middle = DVec2::new(f64::from(view.width), f64::from(view.height)) * 0.5;
        let flat = (place - middle) / view.focal_px();
        view.world_from_view * DVec3::new(flat.x, -flat.y, -1.0)
    }
}

/// The scenes: name, surfaces and view. Pictures have `side` x `side` pixels.
pub fn scenes(side: u32) -> Vec<(&'static str, Truth, View)> {
    let look = |eye: [f64; 3], fov: f64| {
        View::look_at(DVec3::from_array(eye), DVec3::ZERO, DVec3::Z, fov, side, side)
    };
    let one = |shape, paint| Truth { parts: vec![(shape, paint)] };
    let turned = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_x(0.4);
    let face = |axis: usize, sign: f64| {
        let [u, v] = [1, 2].map(|k| {
            let mut e = DVec3::ZERO;
            e[(axis + k) % 3] = 2.0;
            e
        });
        let (u, v) = if sign > 0.0 { (u, v) } else { (v, u) };
        let mut middle = DVec3::ZERO;
        middle[axis] = sign;
        let corner = middle - (u + v) * 0.5;
        (Shape::Rect { corner: turned * corner, u: turned * u, v: turned * v }, Paint::Waves(1.3))
    };
    let cube =
        Truth { parts: (0..6).map(|i| face(i % 3, f64::from(i as u32 / 3) * 2.0 - 1.0)).collect() };
    let sphere = Shape::Sphere { centre: DVec3::ZERO, radius: 1.0 };
    vec![
        ("sphere", one(sphere, Paint::Waves(0.7)), look([0.0, -6.0, 0.0], 0.42)),
        ("cube", cube, look([0.0, -9.0, 1.0], 0.42)),
        (
            "torus",
            one(Shape::Torus { major: 1.0, minor: 0.4 }, Paint::Waves(0.7)),
            look([0.0, -6.0, 4.0], 0.45),
        ),
        (
            "checks",
            one(Shape::Floor { z: -1.0 }, Paint::Checks(1.0, [230, 230, 220], [40, 40, 60])),
            View::look_at(DVec3::ZERO, DVec3::Y - DVec3::Z * 0.25, DVec3::Z, 0.9, side, side),
        ),
        ("walls", walls(0.01, 2.0), walls_view(side, 0.0, 1.0)),
        ("wires", wires(side), look([0.0, -10.0, 0.0], 0.2)),
    ]
}

/// Two parallel walls of width `width`, `gap` apart, the near one red and the far one blue.
pub fn walls(gap: f64, width: f64) -> Truth {
    let wall = |y: f64, c: [u8; 3], half: f64| {
        let corner = DVec3::new(-half, y, -half);
        let (u, v) = (DVec3::X * 2.0 * half, DVec3::Z * 2.0 * half);
        (Shape::Rect { corner, u, v }, Paint::Plain(c))
    };
    let parts = vec![wall(0.0, [255, 0, 0], width / 2.0), wall(gap, [0, 0, 255], width / 2.0)];
    Truth { parts }
}

/// View of the centre of the near wall, turned by `degrees`. The picture is `across` wide at the
/// wall.
pub fn walls_view(side: u32, degrees: f64, across: f64) -> View {
    let (s, c) = degrees.to_radians().sin_cos();
    let distance = 4.0 * across.max(0.25);
    let fov = 2.0 * (across / 2.0 / distance).atan();
    View::look_at(DVec3::new(s, -c, 0.0) * distance, DVec3::ZERO, DVec3::Z, fov, side, side)
}

/// Slanted wires, 0.5 to 4 pixels wide.
fn wires(side: u32) -> Truth {
    let pixel = 2.0 * 10.0 * 0.1f64.tan() / f64::from(side);
    let wire = |i: u32| {
        let x = (f64::from(i) - 1.5) * 0.4;
        let (from, to) = (DVec3::new(x - 0.1, 0.0, -0.8), DVec3::new(x + 0.1, 0.0, 0.8));
        let radius = 0.25 * pixel * f64::from(1u32 << i);
        (Shape::Wire { from, to, radius }, Paint::Plain([200; 3]))
    };
    Truth { parts: (0..4).map(wire).collect() }
}
