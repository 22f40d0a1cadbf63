//! The office scene: rays go from room to room through what is open, and end at walls, things, shut
//! doors or blinds; through a window they are lost.

use super::Scene;
use super::draw::Draw;
use super::floor_plan::{FLOORS, HALF_DEPTH, LENGTH, STOREY, draw_up};
use super::ray::{Hit, Material, Ray, Texture, Vec3};
use super::solid::Thing;
use super::station::{Terrestrial, World};

/// What lies beyond the rooms' ends: walls, and the stairwell at the greater x; metres.
const WALLS_M: f64 = 0.5;
const STAIRWELL_M: f64 = 6.0;
/// Rooms that a ray passes at most.
const ROOMS_MAX: usize = 8;
/// Frames of doors and windows.
const FRAME: Material = Material::new([238, 238, 236], 0.75, 6, Texture::Plain);

/// A box of air.
pub struct Room {
    low: Vec3,
    high: Vec3,
    /// Through the walls at least and greatest x, at least and greatest y.
    pub openings: [Vec<Opening>; 4],
    /// What stands in it.
    pub things: Vec<Thing>,
    /// Floor, walls, ceiling.
    surfaces: [Material; 3],
}

/// A rectangle in a wall.
pub struct Opening {
    /// From where to where along the wall, x or y.
    pub along: [f64; 2],
    /// From which to which height.
    pub up: [f64; 2],
    /// Thickness of the wall, to what is beyond.
    pub depth: f64,
    /// What is beyond.
    pub beyond: Beyond,
}

/// What is behind an opening.
pub enum Beyond {
    /// Another room.
    Room(usize),
    /// The open, from where nothing comes back.
    Outside,
    /// A shut door, a blind.
    Shut(Material),
}

impl Room {
    /// A bare room; its surfaces are floor, walls, ceiling.
    pub fn new(low: Vec3, high: Vec3, surfaces: [Material; 3]) -> Self {
        Self { low, high, openings: Default::default(), things: Vec::new(), surfaces }
    }

    /// The wall, floor or ceiling that a ray ends at, which leaves through it.
    fn surface(&self, ray: &Ray, t: f64, axis: usize) -> Hit {
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
    fn holds(&self, p: Vec3, axis: usize) -> bool {
        let along = p[1 - axis];
        self.along[0] < along && along < self.along[1] && self.up[0] < p[2] && p[2] < self.up[1]
    }

    /// Where the ray ends inside the wall, on the frame; `None` where it comes through to `plane`.
    fn frame(&self, ray: &Ray, plane: f64, axis: usize) -> Option<Hit> {
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

struct Office {
    rooms: Vec<Room>,
    /// The room of each station.
    room_of: Vec<usize>,
}

impl World for Office {
    fn cast(&self, station: usize, ray: &Ray, _draw: &mut Draw) -> Option<Hit> {
        let mut room = &self.rooms[self.room_of[station]];
        for _ in 0..ROOMS_MAX {
            let [_, (t, axis)] = ray.through(room.low, room.high)?;
            let nearest = room.things.iter().fold(None, |nearest: Option<Hit>, thing| {
                thing.cast(ray, nearest.map_or(t, |hit| hit.t)).or(nearest)
            });
            if nearest.is_some() {
                return nearest;
            }
            let is_upper = ray.to[axis] > 0.0;
            let openings: &[Opening] =
                if axis == 2 { &[] } else { &room.openings[2 * axis + usize::from(is_upper)] };
            let p = ray.at(t);
            let Some(opening) = openings.iter().find(|o| o.holds(p, axis)) else {
                return Some(room.surface(ray, t, axis));
            };
            let wall = if is_upper { room.high[axis] } else { room.low[axis] };
            let plane = if is_upper { wall + opening.depth } else { wall - opening.depth };
            if let Some(hit) = opening.frame(ray, plane, axis) {
                return Some(hit);
            }
            match opening.beyond {
                Beyond::Room(next) => room = &self.rooms[next],
                Beyond::Outside => return None,
                Beyond::Shut(material) => {
                    let t = ray.reach(axis, plane);
                    return Some(Hit::on_face(ray, t, axis, !is_upper, material));
                }
            }
        }
        None
    }

    fn bounds(&self) -> [Vec3; 2] {
        let top = FLOORS as f64 * STOREY;
        [[-WALLS_M, -HALF_DEPTH - WALLS_M, 0.0], [LENGTH + STAIRWELL_M, HALF_DEPTH + WALLS_M, top]]
    }
}

/// Makes the scene.
pub fn make(points: u64, seed: u64) -> Box<dyn Scene> {
    let plan = draw_up(seed);
    let (stations, room_of) = plan.stations.into_iter().unzip();
    let world = Office { rooms: plan.rooms, room_of };
    Box::new(Terrestrial {
        world,
        stations,
        offset: [691_000.0, 5_335_000.0, 520.0],
        points,
        seed,
        fan_top: 0.25,
    })
}
