//! The office scene: rays go from room to room through openings, and end at walls, furniture, shut
//! doors or blinds; rays through a window are lost.

use super::draw::Draw;
use super::floor_plan::{FLOORS, HALF_DEPTH, LENGTH, STOREY, draw_up};
use super::ray::{Hit, Ray, Vec3};
use super::room::{Beyond, Opening, Room};
use super::scene::Scene;
use super::station::{Terrestrial, World};

/// Extent beyond the rooms: walls, and the stairwell at the greater x; metres.
const WALLS_M: f64 = 0.5;
const STAIRWELL_M: f64 = 6.0;
/// Greatest number of rooms that a ray passes.
const ROOMS_MAX: usize = 8;
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
