//! Things made of boxes (a desk, a shelf, a flight of stairs): each stands somewhere, turned about
//! z, and is looked into only by rays that meet the box around it.

use super::ray::{Hit, Material, Ray, Vec3};

/// One box of a thing, in the thing's own frame.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Least corner.
    pub low: Vec3,
    /// Greatest corner.
    pub high: Vec3,
    /// What it is made of.
    pub material: Material,
}

/// A part of these corners.
pub fn part(low: Vec3, high: Vec3, material: Material) -> Part {
    Part { low, high, material }
}

/// A thing that stands in a scene.
#[derive(Clone, Debug)]
pub struct Thing {
    low: Vec3,
    high: Vec3,
    origin: Vec3,
    turn: [f64; 2],
    parts: Vec<Part>,
}

impl Thing {
    /// Puts parts at `origin`, turned by the angle of this cosine and sine.
    pub fn new(origin: Vec3, turn: [f64; 2], parts: Vec<Part>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for part in &parts {
            for i in 0..8 {
                let pick = |axis: usize| [part.low, part.high][(i >> axis) & 1][axis];
                let [x, y, z] = [pick(0), pick(1), pick(2)];
                let [c, s] = turn;
                let corner = [origin[0] + x * c - y * s, origin[1] + x * s + y * c, origin[2] + z];
                low = [0, 1, 2].map(|i| low[i].min(corner[i]));
                high = [0, 1, 2].map(|i| high[i].max(corner[i]));
            }
        }
        Self { low, high, origin, turn, parts }
    }

    /// The nearest part that the ray enters before `t_max`.
    pub fn cast(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let [(near, _), _] = ray.through(self.low, self.high)?;
        if near >= t_max {
            return None;
        }
        let own = ray.turned(self.origin, self.turn);
        let mut nearest = (t_max, None);
        for part in &self.parts {
            if let Some([(t, axis), _]) = own.through(part.low, part.high)
                && t > 0.0
                && t < nearest.0
            {
                nearest = (t, Some((axis, part.material)));
            }
        }
        let (t, hit) = nearest;
        hit.map(|(axis, material)| Hit::on_face(&own, t, axis, own.to[axis] < 0.0, material))
    }
}
