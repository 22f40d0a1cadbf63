//! Furniture of the office's rooms, made of boxes, and its positions.

use super::draw::{Draw, cos_sin};
use super::ray::{Material, Texture, Vec3};
use super::solid::{Cuboid, Thing, cuboid};

const TOP: Material = Material::new([206, 178, 138], 0.6, 64, Texture::Wood);
const METAL: Material = Material::new([150, 152, 156], 0.45, 64, Texture::Plain);
const BLACK: Material = Material::new([38, 38, 42], 0.12, 64, Texture::Plain);
const SCREEN: Material = Material::new([26, 30, 40], 0.08, 64, Texture::Plain);
const PAPER: Material = Material::new([238, 236, 228], 0.8, 64, Texture::Plain);
const FABRIC: Material = Material::new([46, 70, 112], 0.25, 65, Texture::Speckle(90.0));
const BOARD: Material = Material::new([196, 170, 132], 0.55, 66, Texture::Wood);
const BOOKS: Material = Material::new([190, 150, 120], 0.4, 66, Texture::Books);
const WHITE: Material = Material::new([240, 241, 240], 0.85, 66, Texture::Plain);
const LAMP: Material = Material::new([255, 253, 244], 0.9, 67, Texture::Plain);
const RADIATOR: Material = Material::new([232, 232, 228], 0.7, 66, Texture::Slats(0.04));
const LEAF: Material = Material::new([58, 112, 48], 0.45, 68, Texture::Speckle(25.0));
const POT: Material = Material::new([150, 82, 54], 0.4, 68, Texture::Plain);
const STEP: Material = Material::new([172, 168, 160], 0.5, 66, Texture::Speckle(40.0));

/// Coordinates of a room for its furniture: x from `-half` to `half` along the window, y from the
/// window, at 0, to the door's wall, z from the floor.
pub struct Frame {
    half: f64,
    height: f64,
    origin: Vec3,
    /// Whether it is turned by half, because the window is at the greater y.
    is_turned: bool,
}

impl Frame {
    /// The frame of a room between `x`, with its window at y = `outer`.
    pub fn new(x: [f64; 2], outer: f64, floor: f64, side: f64, height: f64) -> Self {
        let origin = [0.5 * (x[0] + x[1]), outer, floor];
        Self { half: 0.5 * (x[1] - x[0]), height, origin, is_turned: side > 0.0 }
    }

    /// A point in coordinates of the scene.
    pub fn place(&self, x: f64, y: f64, z: f64) -> Vec3 {
        let sign = if self.is_turned { -1.0 } else { 1.0 };
        [self.origin[0] + sign * x, self.origin[1] + sign * y, self.origin[2] + z]
    }

    fn put(&self, at: [f64; 3], turns: f64, cuboids: Vec<Cuboid>) -> Thing {
        let whole = if self.is_turned { 0.5 } else { 0.0 };
        Thing::new(self.place(at[0], at[1], at[2]), cos_sin(turns + whole), cuboids)
    }
}

/// A desk of this width; its user sits towards greater y.
fn desk(width: f64, draw: &mut Draw) -> Vec<Cuboid> {
    let w = 0.5 * width;
    let mut cuboids = vec![
        cuboid([-w, 0.0, 0.72], [w, 0.8, 0.75], TOP),
        cuboid([-w + 0.04, 0.06, 0.0], [-w + 0.08, 0.74, 0.72], METAL),
        cuboid([w - 0.08, 0.06, 0.0], [w - 0.04, 0.74, 0.72], METAL),
        cuboid([-w + 0.08, 0.06, 0.3], [w - 0.08, 0.08, 0.7], METAL),
        cuboid([w - 0.52, 0.15, 0.08], [w - 0.1, 0.74, 0.66], WHITE),
    ];
    for i in 0..1 + draw.choice(2) {
        let x = -0.3 + 0.62 * i as f64;
        cuboids.push(cuboid([x - 0.12, 0.18, 0.75], [x + 0.12, 0.36, 0.765], BLACK));
        cuboids.push(cuboid([x - 0.025, 0.2, 0.765], [x + 0.025, 0.24, 0.95], BLACK));
        cuboids.push(cuboid([x - 0.29, 0.24, 0.85], [x + 0.29, 0.27, 1.2], SCREEN));
    }
    cuboids.push(cuboid([-0.22, 0.5, 0.75], [0.22, 0.64, 0.775], BLACK));
    for _ in 0..draw.choice(4) {
        let (x, y) = (draw.between(-w + 0.1, w - 0.35), draw.between(0.1, 0.5));
        let z = 0.75 + draw.between(0.005, 0.12);
        cuboids.push(cuboid([x, y, 0.75], [x + 0.21, y + 0.29, z], PAPER));
    }
    if draw.happens(0.6) {
        cuboids.push(cuboid([-w + 0.15, 0.1, 0.0], [-w + 0.35, 0.55, 0.45], BLACK));
    }
    cuboids
}

/// A chair on five castors; it faces lesser y.
fn chair(draw: &mut Draw) -> Vec<Cuboid> {
    let tints = [[46, 70, 112], [40, 42, 46], [120, 44, 40], [60, 92, 74]];
    let fabric = FABRIC.tinted(tints[draw.choice(4)]);
    let mut cuboids = vec![
        cuboid([-0.3, -0.03, 0.05], [0.3, 0.03, 0.09], BLACK),
        cuboid([-0.03, -0.3, 0.05], [0.03, 0.3, 0.09], BLACK),
        cuboid([-0.03, -0.03, 0.09], [0.03, 0.03, 0.42], METAL),
        cuboid([-0.25, -0.25, 0.42], [0.25, 0.25, 0.5], fabric),
        cuboid([-0.22, 0.22, 0.58], [0.22, 0.28, 1.02], fabric),
        cuboid([-0.03, 0.25, 0.4], [0.03, 0.3, 0.6], BLACK),
    ];
    if draw.happens(0.7) {
        for x in [-0.29, 0.25] {
            cuboids.push(cuboid([x, -0.15, 0.64], [x + 0.04, 0.12, 0.68], BLACK));
            cuboids.push(cuboid([x, -0.02, 0.45], [x + 0.04, 0.02, 0.64], BLACK));
        }
    }
    cuboids
}

/// A shelf with its back to lesser y, full of books except for some gaps.
fn shelf(width: f64, levels: usize, draw: &mut Draw) -> Vec<Cuboid> {
    let w = 0.5 * width;
    let top = 0.06 + 0.37 * levels as f64;
    let mut cuboids = vec![
        cuboid([-w, 0.0, 0.0], [-w + 0.02, 0.34, top], BOARD),
        cuboid([w - 0.02, 0.0, 0.0], [w, 0.34, top], BOARD),
        cuboid([-w, 0.0, 0.0], [w, 0.01, top], BOARD),
    ];
    for level in 0..=levels {
        let z = 0.04 + 0.37 * level as f64;
        cuboids.push(cuboid([-w + 0.02, 0.0, z], [w - 0.02, 0.34, z + 0.02], BOARD));
        let mut x = -w + 0.03;
        while level < levels && x < w - 0.2 {
            let end = (x + draw.between(0.15, 0.55)).min(w - 0.03);
            if draw.happens(0.8) {
                let (deep, tall) = (draw.between(0.18, 0.3), draw.between(0.2, 0.32));
                cuboids.push(cuboid([x, 0.02, z + 0.02], [end, deep, z + 0.02 + tall], BOOKS));
            }
            x = end;
        }
    }
    cuboids
}

fn cabinet(width: f64, height: f64) -> Vec<Cuboid> {
    let w = 0.5 * width;
    vec![
        cuboid([-w, 0.0, 0.08], [w, 0.45, height], BOARD),
        cuboid([-w + 0.03, 0.02, 0.0], [w - 0.03, 0.4, 0.08], BLACK),
        cuboid([-0.06, 0.45, 0.5 * height], [-0.04, 0.48, 0.5 * height + 0.15], METAL),
        cuboid([0.04, 0.45, 0.5 * height], [0.06, 0.48, 0.5 * height + 0.15], METAL),
        cuboid([-0.004, 0.45, 0.1], [0.004, 0.452, height], BLACK),
    ]
}

fn plant(draw: &mut Draw) -> Vec<Cuboid> {
    let mut cuboids = vec![cuboid([-0.16, -0.16, 0.0], [0.16, 0.16, 0.34], POT)];
    for _ in 0..14 {
        let at = [draw.between(-0.35, 0.25), draw.between(-0.35, 0.25), draw.between(0.4, 1.35)];
        let size = [draw.between(0.05, 0.2), draw.between(0.05, 0.2), draw.between(0.005, 0.15)];
        cuboids.push(cuboid(at, [0, 1, 2].map(|i| at[i] + size[i]), LEAF));
    }
    cuboids
}

fn whiteboard(width: f64) -> Vec<Cuboid> {
    let w = 0.5 * width;
    vec![
        cuboid([-w, 0.0, 0.95], [w, 0.025, 2.05], WHITE),
        cuboid([-w, 0.0, 0.92], [w, 0.08, 0.95], METAL),
    ]
}

fn table(length: f64) -> Vec<Cuboid> {
    let l = 0.5 * length;
    let mut cuboids = vec![cuboid([-l, -0.6, 0.71], [l, 0.6, 0.75], TOP)];
    for (x, y) in [(-l + 0.15, -0.5), (-l + 0.15, 0.44), (l - 0.21, -0.5), (l - 0.21, 0.44)] {
        cuboids.push(cuboid([x, y, 0.0], [x + 0.06, y + 0.06, 0.71], METAL));
    }
    cuboids
}

/// A lamp of this length along y, hung from a ceiling at z = 0.
fn lamp(length: f64) -> Vec<Cuboid> {
    let l = 0.5 * length;
    vec![
        cuboid([-0.14, -l, -0.22], [0.14, l, -0.16], LAMP),
        cuboid([-0.01, -l + 0.1, -0.16], [0.01, -l + 0.12, 0.0], METAL),
        cuboid([-0.01, l - 0.12, -0.16], [0.01, l - 0.1, 0.0], METAL),
    ]
}

/// Furnishes a room; also returns the position of a tripod in its frame.
pub fn furnish(frame: &Frame, draw: &mut Draw) -> (Vec<Thing>, [f64; 2]) {
    let mut things = Vec::new();
    let lamps = ((2.0 * frame.half / 2.4) as usize).max(1);
    for i in 0..lamps {
        let x = frame.half * ((2 * i + 1) as f64 / lamps as f64 - 1.0);
        things.push(frame.put([x, 2.8, frame.height], 0.0, lamp(3.2)));
    }
    let radiator = vec![cuboid([-0.7, 0.03, 0.15], [0.7, 0.12, 0.75], RADIATOR)];
    things.push(frame.put([0.0, 0.0, 0.0], 0.0, radiator));
    let kind = draw.unit();
    let station = if frame.half > 3.0 && kind < 0.45 {
        meeting_room(frame, draw, &mut things)
    } else if frame.half < 2.0 && kind < 0.3 {
        store(frame, draw, &mut things)
    } else {
        study(frame, draw, &mut things)
    };
    (things, station)
}

fn meeting_room(frame: &Frame, draw: &mut Draw, things: &mut Vec<Thing>) -> [f64; 2] {
    let length = 2.0 * frame.half - 3.0;
    things.push(frame.put([0.0, 2.6, 0.0], 0.0, table(length)));
    let seats = (length / 0.75) as usize;
    for i in 0..seats {
        let x = length * ((i as f64 + 0.5) / seats as f64 - 0.5);
        for (y, turns) in [(3.45, 0.0), (1.75, 0.5)] {
            let turns = turns + draw.between(-0.06, 0.06);
            let at = [x, y + draw.between(-0.1, 0.15), 0.0];
            things.push(frame.put(at, turns, chair(draw)));
        }
    }
    things.push(frame.put([-frame.half, 2.6, 0.0], -0.25, whiteboard(2.4)));
    things.push(frame.put([frame.half, 2.2, 0.0], 0.25, cabinet(1.6, 0.8)));
    things.push(frame.put([frame.half - 0.4, 0.5, 0.0], draw.unit(), plant(draw)));
    [0.2, 4.6]
}

fn store(frame: &Frame, draw: &mut Draw, things: &mut Vec<Thing>) -> [f64; 2] {
    for y in [1.0, 2.3, 3.6] {
        things.push(frame.put([-frame.half, y, 0.0], -0.25, shelf(1.2, 6, draw)));
        things.push(frame.put([frame.half, y, 0.0], 0.25, shelf(1.2, 6, draw)));
    }
    [0.0, 3.0]
}

fn study(frame: &Frame, draw: &mut Draw, things: &mut Vec<Thing>) -> [f64; 2] {
    for side in [-1.0, 1.0] {
        // Backs to the side walls.
        let (wall, turns, inward) = (side * frame.half, 0.25 * side, -side);
        let mut y = 1.2;
        while y < 4.0 {
            let kind = draw.unit();
            if kind < 0.55 {
                things.push(frame.put([wall, y, 0.0], turns, desk(1.6, draw)));
                let seat =
                    [wall + inward * draw.between(1.0, 1.2), y + draw.between(-0.2, 0.2), 0.0];
                things.push(frame.put(seat, turns + draw.between(-0.15, 0.15), chair(draw)));
                y += 1.75;
            } else if kind < 0.8 {
                things.push(frame.put([wall, y - 0.2, 0.0], turns, shelf(1.2, 5, draw)));
                y += 1.3;
            } else {
                things.push(frame.put([wall, y - 0.3, 0.0], turns, cabinet(0.9, 1.3)));
                y += 1.1;
            }
        }
        if draw.happens(0.3) {
            let bin = vec![cuboid([-0.13, -0.13, 0.0], [0.13, 0.13, 0.32], BLACK)];
            things.push(frame.put([wall + inward * 0.3, 4.9, 0.0], 0.03, bin));
        } else if draw.happens(0.4) {
            things.push(frame.put([wall + inward * 0.45, 0.5, 0.0], draw.unit(), plant(draw)));
        }
    }
    [draw.between(-0.15, 0.15), 3.1]
}

/// An open door, hinged at the lesser x of its opening.
pub fn door(
    hinge: f64,
    wall: f64,
    floor: f64,
    side: f64,
    size: [f64; 2],
    leaf: Material,
    draw: &mut Draw,
) -> Thing {
    let cuboids = vec![
        cuboid([0.0, -0.02, 0.01], [size[0] - 0.02, 0.02, size[1] - 0.01], leaf),
        cuboid([size[0] - 0.14, -0.06, 1.03], [size[0] - 0.04, 0.06, 1.06], METAL),
    ];
    let turns = side * draw.between(0.17, 0.27);
    Thing::new([hinge + 0.03, wall + side * 0.03, floor], cos_sin(turns), cuboids)
}

/// Objects in a corridor: lamps, cabinets, a copier, plants.
pub fn corridor(low: Vec3, high: Vec3, draw: &mut Draw) -> Vec<Thing> {
    let mut things = Vec::new();
    let mut x = low[0] + 1.5;
    while x < high[0] - 1.0 {
        things.push(Thing::new([x, 0.0, high[2] + 0.12], [0.0, 1.0], lamp(1.2)));
        x += 3.0;
    }
    let mut x = low[0] + 1.2;
    while x < high[0] - 1.5 {
        let is_north = draw.happens(0.5);
        let (y, turn) = if is_north { (high[1], [-1.0, 0.0]) } else { (low[1], [1.0, 0.0]) };
        let inner = if is_north { -0.3 } else { 0.3 };
        match draw.choice(6) {
            0 => things.push(Thing::new([x, y, low[2]], turn, cabinet(0.9, 1.1))),
            1 => things.push(Thing::new([x, y + inner, low[2]], turn, plant(draw))),
            2 => things.push(Thing::new([x, y, low[2]], turn, shelf(0.9, 4, draw))),
            3 => things.push(Thing::new([x, y, low[2]], turn, whiteboard(1.2))),
            _ => {}
        }
        x += draw.between(2.5, 4.5);
    }
    things
}

/// Two flights from each floor to the next, with a landing between them.
pub fn stairs(low: Vec3, high: Vec3, floors: usize, storey: f64) -> Vec<Thing> {
    const STEPS: usize = 10;
    let rise = storey / (2 * STEPS) as f64;
    let (start, tread) = (low[0] + 1.4, 0.27);
    let width = 0.5 * (high[1] - low[1]) - 0.1;
    let flight = |from: f64, z: f64, sign: f64, y: f64| {
        let steps = (0..STEPS).map(|i| {
            let (a, b) = (sign * tread * i as f64, sign * tread * (i + 1) as f64);
            let top = rise * (i + 1) as f64;
            cuboid([a.min(b), 0.0, top - rise - 0.12], [a.max(b), width, top], STEP)
        });
        let rail = (0..STEPS).map(|i| {
            let (x, top) = (sign * tread * (i as f64 + 0.5), rise * (i + 1) as f64);
            let y = if y < 0.0 { width - 0.05 } else { 0.02 };
            cuboid([x - 0.015, y, top], [x + 0.015, y + 0.03, top + 0.95], METAL)
        });
        Thing::new([from, y, z], [1.0, 0.0], steps.chain(rail).collect())
    };
    let end = start + tread * STEPS as f64;
    let mut things = Vec::new();
    for floor in 0..floors {
        let z = floor as f64 * storey;
        if floor > 0 {
            // The slab between the corridor and the stairs.
            let slab = cuboid([0.0, 0.0, -0.2], [start - low[0], high[1] - low[1], 0.0], STEP);
            things.push(Thing::new([low[0], low[1], z], [1.0, 0.0], vec![slab]));
        }
        if floor + 1 < floors {
            things.push(flight(start, z, 1.0, low[1]));
            let landing = cuboid([0.0, 0.0, -0.2], [high[0] - end, high[1] - low[1], 0.0], STEP);
            let middle = z + 0.5 * storey;
            things.push(Thing::new([end, low[1], middle], [1.0, 0.0], vec![landing]));
            things.push(flight(end, middle, -1.0, high[1] - width));
        }
    }
    things
}
