//! The bridge scene: a valley with a river and trees, a bridge of stone and steel across it, and
//! tripods on the banks, under the arches and on the roadway.

use super::draw::{Draw, cos_sin};
use super::ray::{Hit, Material, Ray, Texture, Vec3};
use super::scene::Scene;
use super::solid::{Thing, cuboid};
use super::station::{Terrestrial, World};
use super::tree::{Sectors, Tree};
use super::valley::{HALF, Valley};
use super::viaduct::{self, END, ROADWAY, WIDTH};

/// Tripods on the ground, and on the roadway: x and y.
const ON_GROUND: [[f64; 2]; 9] = [
    [-23.0, -16.0],
    [22.0, -24.0],
    [-26.0, 20.0],
    [24.0, 17.0],
    [33.5, 1.0],
    [-48.0, -1.0],
    [-50.0, -38.0],
    [52.0, 36.0],
    [46.0, -20.0],
];
const ON_ROADWAY: [[f64; 2]; 3] = [[-46.0, 0.6], [2.0, -0.5], [44.0, 0.4]];
const EYE: f64 = 1.75;
/// Upper end of the mirrors' fan, turns: above is little but sky.
const FAN_TOP: f64 = 52.0 / 360.0;
/// Greatest length of a ray, metres.
const RANGE_MAX: f64 = 160.0;
const TREES: u64 = 110;

const LAMP: Material = Material::new([60, 66, 70], 0.3, 17, Texture::Plain);
const CAR: Material = Material::new([150, 40, 36], 0.5, 64, Texture::Plain);
const GLASS: Material = Material::new([40, 48, 56], 0.1, 64, Texture::Plain);
const TYRE: Material = Material::new([30, 30, 32], 0.1, 64, Texture::Plain);
const PLANK: Material = Material::new([124, 98, 70], 0.4, 6, Texture::Wood);
const ROOF: Material = Material::new([112, 62, 50], 0.4, 6, Texture::Slats(0.3));

struct Bridge {
    valley: Valley,
    trees: Vec<Tree>,
    /// Trees that each station sees.
    sectors: Vec<Sectors>,
    things: Vec<Thing>,
}

impl World for Bridge {
    fn cast(&self, station: usize, ray: &Ray, draw: &mut Draw) -> Option<Hit> {
        let mut nearest = viaduct::cast(ray, RANGE_MAX);
        let reach = |nearest: &Option<Hit>| nearest.map_or(RANGE_MAX, |hit| hit.t);
        for thing in &self.things {
            nearest = thing.cast(ray, reach(&nearest)).or(nearest);
        }
        let trees = self.sectors[station].cast(&self.trees, ray, reach(&nearest), draw);
        nearest = trees.or(nearest);
        let glint = draw.unit();
        self.valley.cast(ray, reach(&nearest), glint).unwrap_or(nearest)
    }

    fn bounds(&self) -> [Vec3; 2] {
        let over = 6.0;
        [[-HALF[0] - over, -HALF[1] - over, -4.0], [HALF[0] + over, HALF[1] + over, 52.0]]
    }
}

fn plant(valley: &Valley, stations: &[Vec3], seed: u64) -> Vec<Tree> {
    let mut draw = Draw::new(seed, 2, 0);
    let mut trees = Vec::new();
    for _ in 0..TREES {
        let (x, y) = (draw.between(-100.0, 100.0), draw.between(-78.0, 78.0));
        let (height, radius) = (draw.between(5.0, 15.0), draw.between(1.5, 3.6));
        let is_clear = stations.iter().all(|s| (s[0] - x).abs().max((s[1] - y).abs()) > 6.0);
        if is_clear && y.abs() > WIDTH + 5.0 && valley.is_dry(x, y) {
            trees.push(Tree { foot: [x, y, valley.height(x, y) - 0.1], height, radius });
        }
    }
    trees
}

fn furnish(valley: &Valley, seed: u64) -> Vec<Thing> {
    let mut draw = Draw::new(seed, 3, 0);
    let mut things = Vec::new();
    let lamp = vec![
        cuboid([-0.07, -0.07, 0.0], [0.07, 0.07, 4.6], LAMP),
        cuboid([-0.05, -0.05, 4.6], [0.05, 1.2, 4.7], LAMP),
        cuboid([-0.12, 0.8, 4.5], [0.12, 1.3, 4.6], LAMP),
    ];
    for i in 0..6 {
        let x = -END + (2.0 * END / 6.0) * (i as f64 + 0.5);
        things.push(Thing::new([x, -3.7, ROADWAY], [1.0, 0.0], lamp.clone()));
    }
    for x in [-20.0, 17.0, 58.0] {
        let paint = [[150, 40, 36], [196, 198, 200], [40, 62, 110]];
        let paint = CAR.tinted(paint[draw.choice(3)]);
        let mut car = vec![
            cuboid([-2.1, -0.85, 0.3], [2.1, 0.85, 0.9], paint),
            cuboid([-1.2, -0.75, 0.9], [1.3, 0.75, 1.4], GLASS),
            cuboid([-1.1, -0.74, 1.4], [1.2, 0.74, 1.46], paint),
        ];
        for (wx, wy) in [(-1.4, -0.86), (-1.4, 0.66), (1.3, -0.86), (1.3, 0.66)] {
            car.push(cuboid([wx - 0.3, wy, 0.0], [wx + 0.3, wy + 0.2, 0.6], TYRE));
        }
        let at = [x + draw.between(-3.0, 3.0), -1.9, ROADWAY];
        things.push(Thing::new(at, cos_sin(draw.between(-0.01, 0.01)), car));
    }
    // A boathouse on the bank; its roof has steps like shingles.
    let (x, y) = (-31.0, -42.0);
    let mut house = vec![cuboid([-3.0, -2.2, -2.0], [3.0, 2.2, 2.6], PLANK)];
    for i in 0..8 {
        let (half, z) = (2.6 - 0.3 * f64::from(i), 2.6 + 0.2 * f64::from(i));
        house.push(cuboid([-3.3, -half, z], [3.3, half, z + 0.2], ROOF));
    }
    things.push(Thing::new([x, y, valley.height(x, y)], cos_sin(0.06), house));
    things
}

/// Makes the scene.
pub fn make(points: u64, seed: u64) -> Box<dyn Scene> {
    let valley = Valley::new(seed);
    let on_ground = ON_GROUND.map(|[x, y]| [x, y, valley.height(x, y).max(0.0) + EYE]);
    let on_roadway = ON_ROADWAY.map(|[x, y]| [x, y, ROADWAY + EYE]);
    let stations: Vec<Vec3> = on_ground.into_iter().chain(on_roadway).collect();
    let trees = plant(&valley, &stations, seed);
    let sectors = stations.iter().map(|&s| Sectors::new(s, &trees)).collect();
    let things = furnish(&valley, seed);
    let world = Bridge { valley, trees, sectors, things };
    Box::new(Terrestrial {
        world,
        stations,
        offset: [652_000.0, 5_412_000.0, 240.0],
        points,
        seed,
        fan_top: FAN_TOP,
    })
}
