//! The country of the terrain scene, without bounds: hills and lakes, woods, fields in parcels,
//! roads, villages and power lines; and the echoes of a laser pulse from above, from the top down.
//! Everything follows from hashes of the position, so nothing is stored.

use super::draw::{Draw, at, beyond, floor, noise, smooth, unit};
use super::ray::{Material, Texture};

/// Greatest number of echoes of a pulse.
pub const ECHOES_MAX: usize = 5;
/// Least and greatest height of the country, metres.
pub const HEIGHTS: [f64; 2] = [-60.0, 130.0];

/// Distance of roads, and half their width, metres.
const ROADS: [f64; 2] = [210.0, 3.0];
/// Surface of the lakes, metres.
const LAKE_Z: f64 = -21.0;
/// Edge of the squares that may have a house each, and of those that have a tree each, metres.
const PLOT: f64 = 23.0;
const TREES: f64 = 4.6;
/// Greatest distance that a crown reaches from its stem, metres.
const CROWN_MAX: f64 = 3.65;
/// Edges of a parcel of one crop, metres.
const PARCEL: [f64; 2] = [130.0, 70.0];
/// Distance of power lines, and of the pylons in one, metres.
const LINES: f64 = 1200.0;
const SPAN: f64 = 160.0;
/// Wires: offset and height above the pylon's foot; their sag, and the distance within which a
/// pulse hits one; metres.
const WIRES: [[f64; 2]; 5] = [[-7.0, 26.0], [0.0, 26.0], [7.0, 26.0], [-4.5, 34.0], [4.5, 34.0]];
const SAG: f64 = 7.0;
const WIRE_REACH: f64 = 0.2;

const SOIL: Material = surface([142, 116, 84], 0.35, 2);
const GRASS: Material = surface([104, 128, 66], 0.5, 2);
const LITTER: Material = surface([96, 84, 60], 0.3, 2);
const TARMAC: Material = surface([112, 112, 116], 0.18, 11);
const WATER: Material = surface([44, 62, 74], 0.05, 9);
const BUSH: Material = surface([84, 112, 52], 0.45, 3);
const LEAVES: Material = surface([58, 92, 40], 0.4, 5);
const WALL: Material = surface([214, 206, 190], 0.6, 6);
const ROOF: Material = surface([150, 78, 58], 0.4, 6);
const WIRE: Material = surface([70, 72, 76], 0.12, 14);
const PYLON: Material = surface([132, 138, 140], 0.3, 15);

const fn surface(rgb: [u8; 3], reflectance: f64, class: u8) -> Material {
    Material::new(rgb, reflectance, class, Texture::Plain)
}

/// One echo of a pulse.
#[derive(Clone, Copy, Debug)]
pub struct Echo {
    /// Height, metres.
    pub z: f64,
    /// Material that reflected it.
    pub material: Material,
}

/// The echoes of a pulse, from the top down.
#[derive(Clone, Copy, Debug)]
pub struct Echoes {
    all: [Echo; ECHOES_MAX],
    count: usize,
}

impl Echoes {
    fn one(z: f64, material: Material) -> Self {
        Self { all: [Echo { z, material }; ECHOES_MAX], count: 1 }
    }

    /// The echoes, at least one.
    pub fn all(&self) -> &[Echo] {
        &self.all[..self.count]
    }

    /// Adds an echo on top, if there is room.
    fn above(mut self, z: f64, material: Material) -> Self {
        if self.count < ECHOES_MAX {
            self.all.copy_within(..self.count, 1);
            self.all[0] = Echo { z, material };
            self.count += 1;
        }
        self
    }
}

/// The country of a seed.
pub struct Landscape {
    /// Seed of the random numbers.
    pub seed: u64,
}

impl Landscape {
    fn noise(&self, kind: u64, x: f64, y: f64, metres: f64) -> f64 {
        noise(self.seed.wrapping_add(kind), x / metres, y / metres)
    }

    /// Height of the hills alone: the ground to about a metre.
    pub fn hills(&self, x: f64, y: f64) -> f64 {
        34.0 * self.noise(1, x, y, 310.0) + 8.0 * self.noise(2, x, y, 76.0)
    }

    /// Height of the ground, also under water.
    fn ground(&self, x: f64, y: f64) -> f64 {
        self.hills(x, y) + 1.1 * self.noise(3, x, y, 17.0) + 0.12 * self.noise(4, x, y, 2.3)
    }

    /// The echoes of a pulse that comes down at a point.
    pub fn echoes(&self, x: f64, y: f64, draw: &mut Draw) -> Echoes {
        let ground = self.ground(x, y);
        // Along and across the power lines, whose direction is 3 : 4.
        let (along, across) = (0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x);
        let across = beyond(across + 0.5 * LINES, LINES) - 0.5 * LINES;
        let below = self.below_lines(x, y, ground, across, draw);
        if across.abs() < 9.0 { self.lines(x, y, along, across, below, draw) } else { below }
    }

    fn below_lines(&self, x: f64, y: f64, ground: f64, across: f64, draw: &mut Draw) -> Echoes {
        if ground < LAKE_Z {
            return Echoes::one(LAKE_Z + 0.02 * draw.bell(), WATER);
        }
        let road = beyond(x + 18.0 * self.noise(5, 0.0, y, 60.0), ROADS[0]) - 0.5 * ROADS[0];
        if road.abs() < ROADS[1] {
            // Cambered, and level across even if the ground is not.
            return Echoes::one(ground + 0.1 - 0.01 * road * road, TARMAC);
        }
        let wood = self.noise(6, x, y, 62.0) + 0.2 * self.noise(7, x, y, 9.0);
        if wood > 0.05 && road.abs() > 6.0 && across.abs() > 13.0 {
            return self.wood(x, y, ground, smooth((wood - 0.05) * 6.0), draw);
        }
        if let Some(house) = self.house(x, y, ground, draw) {
            return house;
        }
        self.field(x, y, ground, draw)
    }

    fn field(&self, x: f64, y: f64, ground: f64, draw: &mut Draw) -> Echoes {
        let parcel = [x / PARCEL[0], y / PARCEL[1]].map(floor);
        let kind = unit(at(self.seed ^ 8, parcel[0], parcel[1]));
        let tint = self.noise(9, x, y, 5.0) * 14.0;
        let tinted = |m: Material, by: f64| {
            let rgb = m.colour.map(|c| (f64::from(c) * 255.0 + tint + by).clamp(0.0, 255.0) as u8);
            m.tinted(rgb)
        };
        if kind < 0.3 {
            let furrow = beyond(x + 0.3 * y, 0.8);
            return Echoes::one(ground + 0.12 * (furrow - 0.4).abs(), tinted(SOIL, 0.0));
        }
        let earth = Echoes::one(ground, tinted(GRASS, 30.0 * (kind - 0.6)));
        // Crops and tussocks, of which some let a part of the pulse through.
        let height = (kind - 0.3) * 1.1 * (0.6 + 0.4 * draw.unit());
        match draw.unit() {
            u if u < 0.55 => earth,
            u if u < 0.9 => Echoes::one(ground + height, tinted(BUSH, 40.0 * (kind - 0.5))),
            _ => earth.above(ground + height.max(0.35), tinted(BUSH, 0.0)),
        }
    }

    /// Trees, one in each square, as paraboloids that gradually absorb a pulse.
    fn wood(&self, x: f64, y: f64, ground: f64, edge: f64, draw: &mut Draw) -> Echoes {
        let (i, j) = (floor(x / TREES), floor(y / TREES));
        let (mut top, mut tint) = (0.0, 0.0);
        // Neighbours whose tree may reach here; trees stand at 0.2 to 0.8 of their squares.
        let near = |c: f64, i: i64| {
            let into = c / TREES - i as f64;
            i64::from(into + 0.2 >= CROWN_MAX / TREES) - 1
                ..=1 - i64::from(1.2 - into >= CROWN_MAX / TREES)
        };
        let squares = near(x, i).flat_map(|di| near(y, j).map(move |dj| (di, dj)));
        for (di, dj) in squares {
            let tree = at(self.seed ^ 10, i + di, j + dj);
            let share = |k: u32| f64::from((tree >> (16 * k)) as u16) * (1.0 / 65_536.0);
            let dx = ((i + di) as f64 + 0.2 + 0.6 * share(0)) * TREES - x;
            let dy = ((j + dj) as f64 + 0.2 + 0.6 * share(1)) * TREES - y;
            let (height, radius) = ((9.0 + 15.0 * share(2)) * edge, 1.8 + 1.7 * share(3));
            let crown = height * (1.0 - 0.6 * (dx * dx + dy * dy) / (radius * radius));
            if crown > top && crown > 0.35 * height {
                (top, tint) = (crown, share(2));
            }
        }
        let litter = Echoes::one(ground + 0.05 * draw.unit(), LITTER);
        if top < 1.0 {
            return if draw.happens(0.3) {
                litter.above(ground + 0.6 * draw.unit() + 0.3, BUSH)
            } else {
                litter
            };
        }
        let leaves = |height: f64| {
            let rgb =
                [40.0 + 44.0 * tint, 74.0 + 40.0 * tint, 34.0 + 12.0 * tint].map(|c: f64| c as u8);
            let class = if height > 5.0 { 5 } else { 4 };
            Material { class, ..LEAVES.tinted(rgb) }
        };
        // Echoes from the top down, each deeper at random; the last is often from the ground.
        let mut heights = [0.0; ECHOES_MAX];
        let (mut count, mut height) = (0, top * (1.0 - 0.25 * draw.unit() * draw.unit()));
        while count < ECHOES_MAX - 1 && height > 0.8 {
            heights[count] = height;
            count += 1;
            if draw.happens(0.45) {
                break;
            }
            height -= 0.8 + 0.5 * top * draw.unit();
        }
        let reaches_ground = count == 0 || draw.happens(0.55);
        let lowest = heights[count.saturating_sub(1)];
        let (mut echoes, rest) = if reaches_ground {
            (litter, count)
        } else {
            (Echoes::one(ground + lowest, leaves(lowest)), count - 1)
        };
        for &height in heights[..rest].iter().rev() {
            echoes = echoes.above(ground + height, leaves(height));
        }
        echoes
    }

    /// The echoes of a house with a gable roof, if the plot has one at this point.
    fn house(&self, x: f64, y: f64, ground: f64, draw: &mut Draw) -> Option<Echoes> {
        let plot = [x / PLOT, y / PLOT].map(floor);
        let [cx, cy] = plot.map(|p| (p as f64 + 0.5) * PLOT);
        let bits = at(self.seed ^ 11, plot[0], plot[1]);
        let share = |k: u32| f64::from((bits >> (16 * k)) as u16) * (1.0 / 65_536.0);
        let half = [4.0 + 3.0 * share(1), 3.5 + 2.0 * share(2)];
        let (u, v) = if bits & 1 == 0 { (x - cx, y - cy) } else { (y - cy, x - cx) };
        let (du, dv) = (half[0] - u.abs(), half[1] - v.abs());
        let is_built = share(0) < 0.85 && du > 0.0 && dv > 0.0;
        if !is_built || self.noise(12, cx, cy, 95.0) < 0.12 {
            return None;
        }
        let foot = self.ground(cx, cy);
        let eaves = foot + 3.0 + 3.5 * share(3);
        let rgb = [[150, 78, 58], [128, 62, 52], [96, 94, 96], [164, 104, 74]];
        let roof = ROOF.tinted(rgb[(bits >> 8) as usize & 3]);
        let z = eaves + 0.7 * dv + 0.03 * beyond(u, 0.35);
        if du.min(dv) > 0.18 {
            return Some(Echoes::one(z, roof));
        }
        // At the edge, a pulse is split, or runs down the wall.
        Some(if draw.happens(0.5) {
            Echoes::one(ground, GRASS).above(z, roof)
        } else {
            Echoes::one(ground + (eaves - ground) * draw.unit(), WALL)
        })
    }

    /// Adds pylons and wires above other echoes.
    fn lines(
        &self,
        x: f64,
        y: f64,
        along: f64,
        across: f64,
        below: Echoes,
        draw: &mut Draw,
    ) -> Echoes {
        let part = beyond(along, SPAN) / SPAN;
        let foot_at = |to: f64| self.hills(x + 0.8 * to, y + 0.6 * to);
        let from_pylon = (part.min(1.0 - part)) * SPAN;
        if from_pylon < 2.6 && across.abs() < 2.6 {
            let foot = foot_at(if part < 0.5 { -from_pylon } else { from_pylon });
            let height = 36.0 * (1.0 - from_pylon.max(across.abs()) / 2.8) * draw.unit();
            if draw.happens(0.5) {
                return below.above(foot + height.max(1.0), PYLON);
            }
        }
        let Some([_, height]) = WIRES.iter().find(|w| (w[0] - across).abs() < WIRE_REACH) else {
            return below;
        };
        if from_pylon < 0.6 || !draw.happens(0.8) {
            return below;
        }
        let (back, ahead) = (foot_at(-part * SPAN), foot_at((1.0 - part) * SPAN));
        let foot = back + (ahead - back) * part;
        let z = foot + height - 4.0 * SAG * part * (1.0 - part);
        let top = below.all()[0].z;
        if z > top + 1.0 { below.above(z, WIRE) } else { below }
    }
}
