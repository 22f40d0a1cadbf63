//! Trees in a valley: a stem, and a crown that gradually absorbs a ray. The trees that a station
//! may see in a direction are listed beforehand, by sectors.

use super::draw::Draw;
use super::ray::{Hit, Material, Ray, Texture, Vec3};

/// Sectors around a station.
const SECTORS: usize = 64;
/// Mean depth that rays reach in a crown, metres.
const DEPTH: f64 = 0.5;

const BARK: Material = Material::new([92, 76, 60], 0.35, 5, Texture::Speckle(14.0));
const LEAVES: Material = Material::new([70, 104, 44], 0.45, 5, Texture::Speckle(6.0));

/// One tree.
pub struct Tree {
    /// Where its stem meets the ground.
    pub foot: Vec3,
    /// Height of the whole tree.
    pub height: f64,
    /// Greatest radius of the crown.
    pub radius: f64,
}

impl Tree {
    fn cast(&self, ray: &Ray, t_max: f64, draw: &mut Draw) -> Option<Hit> {
        let crown = self.crown(ray, t_max, draw);
        let t_max = crown.map_or(t_max, |hit| hit.t);
        self.stem(ray, t_max).or(crown)
    }

    fn crown(&self, ray: &Ray, t_max: f64, draw: &mut Draw) -> Option<Hit> {
        // An ellipsoid, scaled along z to a ball.
        let half = 0.4 * self.height;
        let squash = self.radius / half;
        let middle = self.foot[2] + self.height - half;
        let from = [
            ray.from[0] - self.foot[0],
            ray.from[1] - self.foot[1],
            (ray.from[2] - middle) * squash,
        ];
        let to = [ray.to[0], ray.to[1], ray.to[2] * squash];
        let dot = |a: Vec3, b: Vec3| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let (a, b) = (dot(to, to), dot(from, to));
        let root = b * b - a * (dot(from, from) - self.radius * self.radius);
        if root <= 0.0 || b > 0.0 {
            return None;
        }
        let root = root.sqrt();
        let (enter, leave) = (((-b - root) / a).max(0.0), (-b + root) / a);
        let u = draw.unit();
        let t = enter + DEPTH * u / (1.02 - u);
        let shade = 0.55 + 0.45 * draw.unit();
        let material = LEAVES;
        (t < leave && t < t_max).then_some(Hit { t, incidence: 0.6, light: shade, material })
    }

    fn stem(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let radius = 0.012 * self.height + 0.08;
        let (x, y) = (ray.from[0] - self.foot[0], ray.from[1] - self.foot[1]);
        let a = ray.to[0] * ray.to[0] + ray.to[1] * ray.to[1];
        let b = x * ray.to[0] + y * ray.to[1];
        let root = b * b - a * (x * x + y * y - radius * radius);
        if root <= 0.0 || b > 0.0 {
            return None;
        }
        let t = (-b - root.sqrt()) / a;
        let up = ray.at(t)[2] - self.foot[2];
        let incidence = (root.sqrt() / radius).min(1.0);
        let is_stem = t > 0.0 && t < t_max && (-1.0..0.75 * self.height).contains(&up);
        is_stem.then_some(Hit { t, incidence, light: 0.8, material: BARK })
    }
}

/// The trees that a station may see, by sector.
pub struct Sectors(Vec<Vec<u32>>);

/// The direction as a number of 0 to 4 that grows with the angle, in place of an arc tangent.
fn diamond(x: f64, y: f64) -> f64 {
    match (x >= 0.0, y >= 0.0) {
        (true, true) => y / (x + y),
        (false, true) => 1.0 - x / (y - x),
        (false, false) => 2.0 + y / (x + y),
        (true, false) => 3.0 + x / (x - y),
    }
}

fn sector(x: f64, y: f64) -> usize {
    (diamond(x, y) * (SECTORS / 4) as f64) as usize % SECTORS
}

impl Sectors {
    /// Sorts trees into the sectors of a station.
    pub fn new(station: Vec3, trees: &[Tree]) -> Self {
        let mut sectors = vec![Vec::new(); SECTORS];
        for (index, tree) in trees.iter().enumerate() {
            let (x, y) = (tree.foot[0] - station[0], tree.foot[1] - station[1]);
            let far = (x * x + y * y).sqrt();
            // Sine and cosine of half the angle that the crown covers.
            let s = (tree.radius + 0.1) / far;
            let c = (1.0 - s * s).max(0.0).sqrt();
            let (first, last) = if s < 0.9 {
                (sector(x * c + y * s, y * c - x * s), sector(x * c - y * s, y * c + x * s))
            } else {
                (0, SECTORS - 1)
            };
            let count = (last + SECTORS - first) % SECTORS;
            for i in 0..=count {
                sectors[(first + i) % SECTORS].push(index as u32);
            }
        }
        Self(sectors)
    }

    /// The first hit of a ray on a tree before `t_max`.
    pub fn cast(&self, trees: &[Tree], ray: &Ray, t_max: f64, draw: &mut Draw) -> Option<Hit> {
        let seen = &self.0[sector(ray.to[0], ray.to[1])];
        seen.iter().fold(None, |nearest: Option<Hit>, &tree| {
            let t_max = nearest.map_or(t_max, |hit| hit.t);
            trees[tree as usize].cast(ray, t_max, draw).or(nearest)
        })
    }
}
