//! Objects made of boxes (a desk, a shelf, a flight of stairs), each with a position and a rotation
//! about z. Only rays that hit the bounding box of an object are tested against its boxes.

use super::ray::{Hit, Material, Ray, Vec3};

/// One box of an object, in the object's own frame.
#[derive(Clone, Copy, Debug)]
pub struct Cuboid {
    /// Least corner.
    pub low: Vec3,
    /// Greatest corner.
    pub high: Vec3,
    /// Material of its faces.
    pub material: Material,
}

/// Makes a box of these corners.
pub fn cuboid(low: Vec3, high: Vec3, material: Material) -> Cuboid {
    Cuboid { low, high, material }
}

/// An object in a scene.
#[derive(Clone, Debug)]
pub struct Thing {
    low: Vec3,
    high: Vec3,
    origin: Vec3,
    turn: [f64; 2],
    cuboids: Vec<Cuboid>,
}

impl Thing {
    /// Places boxes at `origin`, rotated by the angle of this cosine and sine.
    pub fn new(origin: Vec3, turn: [f64; 2], cuboids: Vec<Cuboid>) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for cuboid in &cuboids {
            for i in 0..8 {
                let pick = |axis: usize| [cuboid.low, cuboid.high][(i >> axis) & 1][axis];
                let [x, y, z] = [pick(0), pick(1), pick(2)];
                let [c, s] = turn;
                let corner = [origin[0] + x * c - y * s, origin[1] + x * s + y * c, origin[2] + z];
                low = [0, 1, 2].map(|i| low[i].min(corner[i]));
                high = [0, 1, 2].map(|i| high[i].max(corner[i]));
            }
        }
        Self { low, high, origin, turn, cuboids }
    }

    /// The nearest box that the ray enters before `t_max`.
    pub fn cast(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let [(near, _), _] = ray.through(self.low, self.high)?;
        if near >= t_max {
            return None;
        }
        let own = ray.turned(self.origin, self.turn);
        let mut nearest = (t_max, None);
        for cuboid in &self.cuboids {
            if let Some([(t, axis), _]) = own.through(cuboid.low, cuboid.high)
                && t > 0.0
                && t < nearest.0
            {
                nearest = (t, Some((axis, cuboid.material)));
            }
        }
        let (t, hit) = nearest;
        hit.map(|(axis, material)| Hit::on_face(&own, t, axis, own.to[axis] < 0.0, material))
    }
}
