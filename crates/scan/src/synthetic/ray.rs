//! Rays, and the materials of the surfaces that they hit. Lengths in metres, z up, relative to the
//! scene's offset.

use super::draw::{at, beyond, floor, noise, unit};

/// A point or a direction.
pub type Vec3 = [f64; 3];

/// A half-line.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Origin.
    pub from: Vec3,
    /// Unit direction.
    pub to: Vec3,
    /// Reciprocal of each component of `to`.
    over: Vec3,
}

impl Ray {
    /// Makes a ray. Components of `to` near zero are enlarged so that their reciprocals are finite.
    pub fn new(from: Vec3, to: Vec3) -> Self {
        let to = to.map(|c| if c.abs() < 1e-9 { 1e-9 } else { c });
        Self { from, to, over: to.map(|c| 1.0 / c) }
    }

    /// The point at distance `t`, metres.
    pub fn at(&self, t: f64) -> Vec3 {
        [0, 1, 2].map(|i| self.from[i] + self.to[i] * t)
    }

    /// Distance at which a coordinate has this value; negative behind the origin.
    pub fn reach(&self, axis: usize, value: f64) -> f64 {
        (value - self.from[axis]) * self.over[axis]
    }

    /// Distance and axis of the faces at which the ray enters and leaves a box; `None` if it
    /// misses.
    pub fn through(&self, low: Vec3, high: Vec3) -> Option<[(f64, usize); 2]> {
        let (mut enter, mut leave) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
        for axis in 0..3 {
            let (a, b) = (self.reach(axis, low[axis]), self.reach(axis, high[axis]));
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            if near > enter.0 {
                enter = (near, axis);
            }
            if far < leave.0 {
                leave = (far, axis);
            }
        }
        (enter.0 <= leave.0 && leave.0 > 0.0).then_some([enter, leave])
    }

    /// The ray in coordinates with this `origin`, rotated back about z by the angle of this cosine
    /// and sine.
    pub fn turned(&self, origin: Vec3, [c, s]: [f64; 2]) -> Self {
        let back = |v: Vec3| [v[0] * c + v[1] * s, v[1] * c - v[0] * s, v[2]];
        Self::new(back([0, 1, 2].map(|i| self.from[i] - origin[i])), back(self.to))
    }
}

/// Pattern of a surface's colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// No pattern.
    Plain,
    /// Blotches; number per metre.
    Speckle(f64),
    /// Square tiles of this edge with dark joints, metres.
    Tiles(f64),
    /// Boards with a grain.
    Wood,
    /// Spines of books, each of its own colour.
    Books,
    /// Courses of blocks of this height with joints, metres.
    Masonry(f64),
    /// Blades with slits between them, at this distance, metres.
    Slats(f64),
}

/// Material of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Red, green, blue, 0 to 1.
    pub colour: [f32; 3],
    /// Fraction of the laser's light that is reflected, 0 to 1.
    pub reflectance: f64,
    /// ASPRS class; 64 and above are defined by the scenes.
    pub class: u8,
    /// Pattern of the colour.
    pub texture: Texture,
}

impl Material {
    /// A material whose red, green and blue are given as 0 to 255.
    pub const fn new(rgb: [u8; 3], reflectance: f64, class: u8, texture: Texture) -> Self {
        let [r, g, b] = rgb;
        let colour = [r as f32 / 255.0, g as f32 / 255.0, b as f32 / 255.0];
        Self { colour, reflectance, class, texture }
    }

    /// The material in another colour.
    pub const fn tinted(self, rgb: [u8; 3]) -> Self {
        Self::new(rgb, self.reflectance, self.class, self.texture)
    }

    /// Red, green, blue at a point, 0 to 1 or slightly more.
    pub fn colour_at(&self, seed: u64, p: Vec3) -> [f64; 3] {
        // One mapping for floors and walls: a wall along x varies with x and z, a wall along y with
        // y and z.
        let (u, v) = (p[0] + p[1], p[1] - p[0] + 2.0 * p[2]);
        let factor = match self.texture {
            Texture::Plain => 1.0,
            Texture::Speckle(n) => 1.0 + 0.22 * noise(seed, u * n, v * n),
            Texture::Tiles(edge) => {
                let is_joint = [p[0], p[1]].map(|c| beyond(c, edge) < 0.02 * edge.min(1.0) + 0.004);
                if is_joint[0] || is_joint[1] { 0.72 } else { 1.0 }
            }
            Texture::Wood => 1.0 + 0.16 * noise(seed, p[0] * 2.0 + p[2] * 9.0, p[1] * 45.0),
            Texture::Books => {
                let spine = at(seed, floor(u * 31.0), floor(p[2] * 3.0));
                let tint = |i: u64| 0.25 + 0.85 * unit(spine.rotate_left(21 * i as u32));
                return [0, 1, 2].map(|i| f64::from(self.colour[i as usize]) * tint(i));
            }
            Texture::Masonry(course) => {
                let row = floor(p[2] / course);
                let along = u / (course * 1.9) + 0.5 * (row & 1) as f64;
                let block = unit(at(seed, floor(along), row));
                let is_joint = beyond(p[2], course) < 0.03 || beyond(along, 1.0) < 0.025;
                let stain = 0.12 * noise(seed, u * 0.7, v * 0.3);
                if is_joint { 0.62 + stain } else { 0.84 + 0.3 * block + stain }
            }
            Texture::Slats(apart) => 0.7 + 0.45 * beyond(p[2], apart) / apart,
        };
        self.colour.map(|c| f64::from(c) * factor)
    }
}

/// Hit of a ray on a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Distance from the ray's origin, metres.
    pub t: f64,
    /// Cosine between the ray and the surface's normal, 0 to 1.
    pub incidence: f64,
    /// Illumination, 0 to 1.
    pub light: f64,
    /// Material of the surface.
    pub material: Material,
}

impl Hit {
    /// A hit on a face across an axis; `is_upper` if the ray meets it from above along that axis.
    pub fn on_face(ray: &Ray, t: f64, axis: usize, is_upper: bool, material: Material) -> Self {
        let light = [[0.80, 0.88], [0.92, 0.96], [0.62, 1.0]][axis][usize::from(is_upper)];
        Self { t, incidence: ray.to[axis].abs(), light, material }
    }
}
