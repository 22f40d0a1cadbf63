//! Rooms of the office scene: boxes with openings in their walls, through which rays leave.

use super::ray::{Hit, Material, Ray, Texture, Vec3};
use super::solid::Thing;

/// Frames of doors and windows.
const FRAME: Material = Material::new([238, 238, 236], 0.75, 6, Texture::Plain);

/// A box of air.
pub struct Room {
    /// Least and greatest corner, metres.
    pub low: Vec3,
    pub high: Vec3,
    /// Openings in the walls at least and greatest x, least and greatest y.
    pub openings: [Vec<Opening>; 4],
    /// Furniture.
    pub things: Vec<Thing>,
    /// Materials of floor, walls, ceiling.
    surfaces: [Material; 3],
}

/// A rectangle in a wall.
pub struct Opening {
    /// Extent along the wall, x or y.
    pub along: [f64; 2],
    /// Extent in height.
    pub up: [f64; 2],
    /// Depth of the opening: thickness of the wall.
    pub depth: f64,
    /// What is behind it.
    pub beyond: Beyond,
}

/// What is behind an opening.
pub enum Beyond {
    /// Another room.
    Room(usize),
    /// Outdoors; no ray returns from there.
    Outside,
    /// A shut door or a blind.
    Shut(Material),
}

impl Room {
    /// An empty room; its surfaces are floor, walls, ceiling.
    pub fn new(low: Vec3, high: Vec3, surfaces: [Material; 3]) -> Self {
        Self { low, high, openings: Default::default(), things: Vec::new(), surfaces }
    }

    /// The hit on the wall, floor or ceiling at which a ray leaves the room.
    pub fn surface(&self, ray: &Ray, t: f64, axis: usize) -> Hit {
        let is_low = ray.to[axis] < 0.0;
        let material = self.surfaces[match (axis, is_low) {
            (2, true) => 0,
            (2, false) => 2,
            _ => 1,
        }];
        Hit::on_face(ray, t, axis, is_low, material)
    }
}

impl Opening {
    /// Whether a point of the wall's plane is within the opening.
    pub fn holds(&self, p: Vec3, axis: usize) -> bool {
        let along = p[1 - axis];
        self.along[0] < along && along < self.along[1] && self.up[0] < p[2] && p[2] < self.up[1]
    }

    /// The hit on the frame inside the wall; `None` if the ray passes to `plane`.
    pub fn frame(&self, ray: &Ray, plane: f64, axis: usize) -> Option<Hit> {
        if self.holds(ray.at(ray.reach(axis, plane)), axis) {
            return None;
        }
        let along = 1 - axis;
        let ends = |axis: usize, span: [f64; 2]| {
            (ray.reach(axis, span[usize::from(ray.to[axis] > 0.0)]), axis)
        };
        let (side, lintel) = (ends(along, self.along), ends(2, self.up));
        let (t, axis) = if side.0 < lintel.0 { side } else { lintel };
        Some(Hit::on_face(ray, t, axis, ray.to[axis] < 0.0, FRAME))
    }
}
