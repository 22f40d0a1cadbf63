//! Rays and the surfaces that they meet: what is hit where, and what it is made of. Lengths in
//! metres, z up, relative to the scene's offset.

use super::draw::{at, beyond, floor, noise, unit};

/// A place, or a direction.
pub type Vec3 = [f64; 3];

/// A half-line.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it begins.
    pub from: Vec3,
    /// Where it goes; of length 1.
    pub to: Vec3,
    /// One over each component of `to`.
    over: Vec3,
}

impl Ray {
    /// A ray; no component of `to` stays so small that dividing by it would make no number.
    pub fn new(from: Vec3, to: Vec3) -> Self {
        let to = to.map(|c| if c.abs() < 1e-9 { 1e-9 } else { c });
        Self { from, to, over: to.map(|c| 1.0 / c) }
    }

    /// The place so many metres along.
    pub fn at(&self, t: f64) -> Vec3 {
        [0, 1, 2].map(|i| self.from[i] + self.to[i] * t)
    }

    /// Metres to where one coordinate has this value; negative behind.
    pub fn reach(&self, axis: usize, value: f64) -> f64 {
        (value - self.from[axis]) * self.over[axis]
    }

    /// Enters and leaves a box: metres and the axis of the face, each; `None` where it passes by.
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

    /// The same ray seen from `origin`, turned back about z by the angle of this cosine and sine.
    pub fn turned(&self, origin: Vec3, [c, s]: [f64; 2]) -> Self {
        let back = |v: Vec3| [v[0] * c + v[1] * s, v[1] * c - v[0] * s, v[2]];
        Self::new(back([0, 1, 2].map(|i| self.from[i] - origin[i])), back(self.to))
    }
}

/// How a surface's colour varies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Texture {
    /// Not.
    Plain,
    /// Blotches, so many a metre.
    Speckle(f64),
    /// Square tiles of this edge with dark joints, metres.
    Tiles(f64),
    /// Boards with a grain.
    Wood,
    /// Spines of books, each of its own colour.
    Books,
    /// Courses of blocks of this height with joints, metres.
    Masonry(f64),
    /// Blades with slits between them, metres apart.
    Slats(f64),
}

/// What a surface is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Red, green, blue, 0 to 1.
    pub colour: [f32; 3],
    /// Share of the laser's light that comes back, 0 to 1.
    pub reflectance: f64,
    /// ASPRS class; 64 and above are the scenes' own.
    pub class: u8,
    /// How the colour varies.
    pub texture: Texture,
}

impl Material {
    /// Of plain colour, red, green, blue of 0 to 255.
    pub const fn new(rgb: [u8; 3], reflectance: f64, class: u8, texture: Texture) -> Self {
        let [r, g, b] = rgb;
        let colour = [r as f32 / 255.0, g as f32 / 255.0, b as f32 / 255.0];
        Self { colour, reflectance, class, texture }
    }

    /// The same in another colour.
    pub const fn tinted(self, rgb: [u8; 3]) -> Self {
        Self::new(rgb, self.reflectance, self.class, self.texture)
    }

    /// Red, green, blue at a place, 0 to 1 and somewhat above.
    pub fn colour_at(&self, seed: u64, p: Vec3) -> [f64; 3] {
        // One mapping for floors and walls: a wall along x varies with x and z, one along y with y
        // and z.
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

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// Metres from the ray's beginning.
    pub t: f64,
    /// Cosine between the ray and the surface's normal, 0 to 1.
    pub incidence: f64,
    /// How light falls on it, 0 to 1.
    pub light: f64,
    /// What it is made of.
    pub material: Material,
}

impl Hit {
    /// On a face across an axis; `is_upper` where the ray meets it from above along that axis.
    pub fn on_face(ray: &Ray, t: f64, axis: usize, is_upper: bool, material: Material) -> Self {
        let light = [[0.80, 0.88], [0.92, 0.96], [0.62, 1.0]][axis][usize::from(is_upper)];
        Self { t, incidence: ray.to[axis].abs(), light, material }
    }
}
