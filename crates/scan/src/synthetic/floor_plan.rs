//! The floor plan of the office: floors of rooms on both sides of a corridor, and a stairwell that
//! joins the floors. Rooms are boxes; doors and windows are rectangles in their walls.

use super::draw::Draw;
use super::furniture;
use super::ray::{Material, Texture, Vec3};
use super::room::{Beyond, Opening, Room};

/// Length of the corridors, metres.
pub const LENGTH: f64 = 46.0;
/// Number of floors, and their distance, metres.
pub const FLOORS: usize = 3;
pub const STOREY: f64 = 3.4;
/// Clear height of rooms and of corridors.
const ROOM_HEIGHT: f64 = 2.95;
const CORRIDOR_HEIGHT: f64 = 2.6;
/// Distance from the corridor's middle to its walls, and from a room's door to its window.
const CORRIDOR_HALF: f64 = 1.25;
const ROOM_DEPTH: f64 = 5.6;
/// Distance from the corridors' middle to the windows.
pub const HALF_DEPTH: f64 = CORRIDOR_HALF + WALL + ROOM_DEPTH;
/// Thickness of inner and of outer walls.
const WALL: f64 = 0.15;
const OUTER_WALL: f64 = 0.35;
/// Widths of rooms; the last of a row takes what is left.
const ROOM_WIDTHS: [f64; 4] = [3.3, 4.4, 5.2, 7.4];
const DOOR: [f64; 2] = [0.95, 2.1];
/// Length of the stairwell, and half its width.
const STAIRWELL: [f64; 2] = [5.4, 1.9];
/// Height of a tripod's head.
const EYE: f64 = 1.6;
/// Number of tripods in a corridor.
const CORRIDOR_STATIONS: usize = 5;
/// Fractions of doors and blinds that are shut.
const SHUT_DOORS: f64 = 0.35;
const SHUT_BLINDS: f64 = 0.3;

const FLOOR: Material = Material::new([104, 110, 120], 0.35, 2, Texture::Speckle(60.0));
const CORRIDOR_FLOOR: Material = Material::new([168, 160, 146], 0.5, 2, Texture::Tiles(0.6));
const WALL_PAINT: Material = Material::new([226, 222, 212], 0.8, 6, Texture::Speckle(1.5));
const CEILING: Material = Material::new([236, 236, 232], 0.85, 6, Texture::Tiles(0.625));
const DOOR_LEAF: Material = Material::new([150, 104, 62], 0.5, 66, Texture::Wood);
const BLIND: Material = Material::new([206, 206, 200], 0.7, 66, Texture::Slats(0.05));

/// Rooms, and the tripods: position and room.
pub struct FloorPlan {
    pub rooms: Vec<Room>,
    pub stations: Vec<(Vec3, usize)>,
}

/// Makes the plan of a seed.
pub fn draw_up(seed: u64) -> FloorPlan {
    let mut plan = FloorPlan { rooms: Vec::new(), stations: Vec::new() };
    let mut draw = Draw::new(seed, 1, 0);
    let stairwell = plan.stairwell();
    for floor in 0..FLOORS {
        let corridor = plan.corridor(floor, stairwell, &mut draw);
        for side in [-1.0, 1.0] {
            let mut x = 0.0;
            while x < LENGTH {
                let width = ROOM_WIDTHS[draw.choice(ROOM_WIDTHS.len())];
                let end =
                    if LENGTH - x - width < ROOM_WIDTHS[0] + WALL { LENGTH } else { x + width };
                plan.room([x, end], floor, side, corridor, &mut draw);
                x = end + WALL;
            }
        }
    }
    plan
}

impl FloorPlan {
    fn stairwell(&mut self) -> usize {
        let low = [LENGTH + WALL, -STAIRWELL[1], 0.0];
        let top = (FLOORS - 1) as f64 * STOREY + ROOM_HEIGHT;
        let high = [low[0] + STAIRWELL[0], STAIRWELL[1], top];
        let mut room = Room::new(low, high, [CORRIDOR_FLOOR, WALL_PAINT, CEILING]);
        room.things = furniture::stairs(low, high, FLOORS, STOREY);
        self.rooms.push(room);
        for floor in 0..FLOORS {
            let z = floor as f64 * STOREY + EYE;
            self.stations.push(([low[0] + 0.7, 0.0, z], 0));
        }
        0
    }

    fn corridor(&mut self, floor: usize, stairwell: usize, draw: &mut Draw) -> usize {
        let z = floor as f64 * STOREY;
        let (low, high) = ([0.0, -CORRIDOR_HALF, z], [LENGTH, CORRIDOR_HALF, z + CORRIDOR_HEIGHT]);
        let wall =
            WALL_PAINT.tinted([[214, 220, 206], [206, 216, 224], [226, 214, 200]][floor % 3]);
        let mut room = Room::new(low, high, [CORRIDOR_FLOOR, wall, CEILING]);
        room.things = furniture::corridor(low, high, draw);
        let corridor = self.rooms.len();
        let passage = |beyond| Opening {
            along: [-0.9, 0.9],
            up: [z, z + DOOR[1] + 0.2],
            depth: WALL,
            beyond,
        };
        room.openings[1].push(passage(Beyond::Room(stairwell)));
        room.openings[0].push(Opening {
            along: [-0.8, 0.8],
            up: [z + 0.9, z + 2.3],
            depth: OUTER_WALL,
            beyond: Beyond::Outside,
        });
        self.rooms.push(room);
        self.rooms[stairwell].openings[0].push(passage(Beyond::Room(corridor)));
        for i in 0..CORRIDOR_STATIONS {
            let x = LENGTH * (i as f64 + 0.5) / CORRIDOR_STATIONS as f64;
            self.stations.push(([x, 0.15, z + EYE], corridor));
        }
        corridor
    }

    fn room(&mut self, x: [f64; 2], floor: usize, side: f64, corridor: usize, draw: &mut Draw) {
        let z = floor as f64 * STOREY;
        let inner = side * (CORRIDOR_HALF + WALL);
        let outer = inner + side * ROOM_DEPTH;
        let low = [x[0], inner.min(outer), z];
        let high = [x[1], inner.max(outer), z + ROOM_HEIGHT];
        let carpet = [[104, 110, 120], [92, 100, 92], [120, 106, 98], [96, 98, 124]];
        let floor = FLOOR.tinted(carpet[draw.choice(4)]);
        let paint = [[226, 222, 212], [232, 230, 226], [216, 224, 226], [230, 216, 198]];
        let wall = WALL_PAINT.tinted(paint[draw.choice(4)]);
        let mut room = Room::new(low, high, [floor, wall, CEILING]);
        let index = self.rooms.len();

        let hinge = if draw.happens(0.5) { x[0] + 0.25 } else { x[1] - 0.25 - DOOR[0] };
        let (along, up) = ([hinge, hinge + DOOR[0]], [z, z + DOOR[1]]);
        let is_shut = draw.happens(SHUT_DOORS);
        let door = |to: usize| {
            let (beyond, depth) =
                if is_shut { (Beyond::Shut(DOOR_LEAF), 0.5) } else { (Beyond::Room(to), 1.0) };
            Opening { along, up, depth: depth * WALL, beyond }
        };
        let north = side > 0.0;
        room.openings[if north { 2 } else { 3 }].push(door(corridor));
        self.rooms[corridor].openings[if north { 3 } else { 2 }].push(door(index));
        room.openings[if north { 3 } else { 2 }] = windows(x, z, draw);

        let frame = furniture::Frame::new(x, outer, z, side, ROOM_HEIGHT);
        let (things, station) = furniture::furnish(&frame, draw);
        room.things = things;
        if !is_shut {
            room.things.push(furniture::door(hinge, inner, z, side, DOOR, DOOR_LEAF, draw));
        }
        self.rooms.push(room);
        self.stations.push((frame.place(station[0], station[1], EYE), index));
    }
}

fn windows(x: [f64; 2], z: f64, draw: &mut Draw) -> Vec<Opening> {
    let count = ((x[1] - x[0]) / 1.7) as usize;
    let apart = (x[1] - x[0]) / count as f64;
    let window = |i: usize| {
        let middle = x[0] + (i as f64 + 0.5) * apart;
        let is_shut = draw.happens(SHUT_BLINDS);
        Opening {
            along: [middle - 0.62, middle + 0.62],
            up: [z + 0.9, z + 2.4],
            depth: if is_shut { 0.12 } else { OUTER_WALL },
            beyond: if is_shut { Beyond::Shut(BLIND) } else { Beyond::Outside },
        }
    };
    (0..count).map(window).collect()
}
