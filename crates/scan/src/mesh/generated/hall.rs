//! A vaulted hall with aisles, columns, arches, windows and a rose window, of closed solids: light
//! of lamps and from outside, but most of what is seen is lit indirectly.

use super::solids::{Flat, Solids};
use super::view::{Lamp, Viewpoint};
use crate::mesh::triangles::TriangleMesh;
use std::f64::consts::{PI, TAU};

pub const VIEW: Viewpoint =
    Viewpoint { eye: [1.4, 1.6, 2.3], target: [-0.6, 16.0, 4.6], fov_deg: 62.0 };

/// Lamps in the nave light walls directly, so that reveals of windows do not outshine everything.
pub const LAMPS: [Lamp; 7] = [
    Lamp::Sun {
        azimuth_deg: 118.0,
        elevation_deg: 40.0,
        diameter_deg: 1.0,
        irradiance: [3.0, 2.7, 2.2],
    },
    Lamp::Sky { zenith: [0.3, 0.42, 0.6], horizon: [0.42, 0.47, 0.52] },
    lamp(4.0),
    lamp(8.0),
    lamp(12.0),
    lamp(16.0),
    lamp(20.0),
];

const fn lamp(y: f64) -> Lamp {
    Lamp::Point { place: [0.0, y, 4.4], intensity: [24.0, 19.0, 13.5] }
}

/// Bays along the hall, and the length of each.
const BAYS: usize = 6;
const BAY_M: f64 = 4.0;
const LENGTH_M: f64 = BAYS as f64 * BAY_M;
/// Half width of the nave at the axis of its columns, and half width with the aisles.
const NAVE_M: f64 = 4.0;
const AISLE_M: f64 = 7.6;
/// Half thickness of the walls above the columns.
const WALL_M: f64 = 0.35;
/// Heights: top of a column, of the arcade, of the upper windows' sill, of the walls.
const COLUMN_M: f64 = 4.0;
const ARCADE_M: f64 = 6.4;
const SILL_M: f64 = 7.2;
const SPRING_M: f64 = 10.2;
/// Thickness of the vault.
const VAULT_M: f64 = 0.4;

const STONE: [u8; 3] = [205, 192, 168];
const PALE: [u8; 3] = [222, 214, 198];
const FLOOR: [u8; 3] = [150, 112, 86];
const WOOD: [u8; 3] = [110, 66, 40];

/// The hall with about this number of triangles.
pub fn make(triangles: u64) -> TriangleMesh {
    // Steps of an eighth: each number of parts is rounded by itself, so the sum grows evenly.
    let count = |eighths: u64| build(eighths as f64 / 8.0).triangles() as u64;
    let mut high = 32;
    while count(high) < triangles {
        high *= 2;
    }
    let mut low = high / 2;
    while high - low > 1 {
        let middle = (low + high) / 2;
        *(if count(middle) < triangles { &mut low } else { &mut high }) = middle;
    }
    // Edges of more than 40 degrees are sharp; arcs have more than nine parts a half turn.
    build(high as f64 / 8.0).finish(0.766)
}

/// The hall with about this number of parts in a turn.
fn build(parts: f64) -> Solids {
    let mut hall = Solids::default();
    floor(&mut hall);
    for side in [-1.0, 1.0] {
        aisle_wall(&mut hall, side, parts);
        nave_wall(&mut hall, side, parts);
    }
    vault(&mut hall, parts);
    ends(&mut hall, parts);
    pews(&mut hall);
    hall
}

fn even(parts: f64, least: usize) -> usize {
    (parts.round() as usize).max(least)
}

/// A half circle about a centre from the right over the top to the left.
fn half_circle([x, z]: Flat, radius: f64, parts: usize) -> Vec<Flat> {
    (0..=parts)
        .map(|i| {
            let (s, c) = libm::sincos(PI * i as f64 / parts as f64);
            [x + radius * c, z + radius * s]
        })
        .collect()
}

/// Adds a block with a half-round opening below: between `centre - half` and `centre + half` along
/// y, from the spring of the arch to `top`, at x between two depths.
fn arch(
    hall: &mut Solids,
    centre: f64,
    half: f64,
    [spring, top]: [f64; 2],
    x: [f64; 2],
    parts: usize,
) {
    let inner = half_circle([centre, spring], half, parts);
    let outer: Vec<Flat> = inner.iter().map(|&[y, _]| [y, top]).collect();
    hall.band([&outer, &inner], false, x, |[y, z], x| [x, y, z], PALE);
}

/// Two depths along x of a wall about `x`, in rising order.
fn about(x: f64) -> [f64; 2] {
    [x - WALL_M, x + WALL_M]
}

/// Adds a wall with a window in each bay, between two heights.
fn windows(
    hall: &mut Solids,
    x: f64,
    half: f64,
    [base, sill, spring, top]: [f64; 4],
    parts: usize,
) {
    let [x0, x1] = about(x);
    hall.block([x0, 0.0, base], [x1, LENGTH_M, sill], STONE);
    for bay in 0..BAYS {
        let centre = (bay as f64 + 0.5) * BAY_M;
        let [from, to] = [centre - BAY_M / 2.0, centre + BAY_M / 2.0];
        hall.block([x0, from, sill], [x1, centre - half, top], STONE);
        hall.block([x0, centre + half, sill], [x1, to, top], STONE);
        arch(hall, centre, half, [spring, top], [x0, x1], parts);
    }
}

fn aisle_wall(hall: &mut Solids, side: f64, parts: f64) {
    let heights = [0.0, 1.6, 4.0, ARCADE_M];
    windows(hall, side * AISLE_M, 0.6, heights, even(parts * 0.5, 6));
    // A flat roof with beams from the wall to the columns.
    let [a, b] = [side * NAVE_M, side * AISLE_M];
    let (x0, x1) = (a.min(b), a.max(b));
    hall.block([x0, 0.0, ARCADE_M], [x1, LENGTH_M, ARCADE_M + 0.3], PALE);
    for i in 1..BAYS * 2 {
        let y = i as f64 * BAY_M / 2.0;
        hall.block([x0, y - 0.12, ARCADE_M - 0.3], [x1, y + 0.12, ARCADE_M], WOOD);
    }
}

fn nave_wall(hall: &mut Solids, side: f64, parts: f64) {
    let x = side * NAVE_M;
    for i in 0..=BAYS {
        column(hall, [x, i as f64 * BAY_M], parts);
    }
    let gap = BAY_M / 2.0 - 0.42;
    for bay in 0..BAYS {
        let centre = (bay as f64 + 0.5) * BAY_M;
        arch(hall, centre, gap, [COLUMN_M, ARCADE_M], about(x), even(parts * 0.7, 8));
    }
    let [x0, x1] = about(x);
    for i in 0..=BAYS {
        let y = i as f64 * BAY_M;
        let (low, high) = ((y - 0.42).max(0.0), (y + 0.42).min(LENGTH_M));
        hall.block([x0, low, COLUMN_M], [x1, high, ARCADE_M], PALE);
    }
    let heights = [ARCADE_M, SILL_M, 8.8, SPRING_M];
    windows(hall, x, 0.8, heights, even(parts * 0.5, 6));
}

/// Adds a fluted column with a base and a capital.
fn column(hall: &mut Solids, centre: Flat, parts: f64) {
    let mut profile: Vec<Flat> = vec![[0.5, 0.0], [0.5, 0.12]];
    let rounds = even(parts * 0.25, 3);
    let mut bulge = |from: f64, to: f64, radius: f64, size: f64| {
        profile.extend((0..=rounds).map(|i| {
            let t = i as f64 / rounds as f64;
            [radius + size * libm::sin(PI * t), from + (to - from) * t]
        }));
    };
    bulge(0.13, 0.33, 0.42, 0.07);
    bulge(0.34, 0.46, 0.38, 0.04);
    let first = profile.len();
    let rows = even(parts * 0.6, 4);
    profile.extend((0..=rows).map(|i| {
        let t = i as f64 / rows as f64;
        [0.36 - 0.05 * t * t, 0.47 + 2.9 * t]
    }));
    let last = profile.len() - 1;
    profile.extend((0..=rounds).map(|i| {
        let t = i as f64 / rounds as f64;
        [0.32 + 0.16 * t * t, 3.4 + 0.42 * t]
    }));
    profile.extend([[0.52, 3.83], [0.52, COLUMN_M]]);
    let around = even(parts * 2.0, 16);
    let fluted = |turn: f64, i: usize| {
        let is_shaft = (first + 1..last).contains(&i);
        if is_shaft { 1.0 - 0.035 * (0.5 + 0.5 * libm::cos(turn * 16.0 * TAU)) } else { 1.0 }
    };
    hall.revolve(centre, &profile, around, fluted, PALE);
}

fn vault(hall: &mut Solids, parts: f64) {
    let n = even(parts * 1.5, 12);
    let shell = |radius: f64, thickness: f64, n: usize| {
        let centre = [0.0, SPRING_M];
        [half_circle(centre, radius + thickness, n), half_circle(centre, radius, n)]
    };
    // Seen along -y, x runs to the left: depths run from far to near to keep the orientation.
    let place = |[x, z]: Flat, depth: f64| [x, -depth, z];
    let bays = even(parts * 0.25, 2) * BAYS;
    let [outer, inner] = shell(NAVE_M, VAULT_M, n);
    for i in 0..bays {
        let [from, to] = [i, i + 1].map(|i| -(i as f64) / bays as f64 * LENGTH_M);
        hall.band([&outer, &inner], false, [to, from], place, PALE);
    }
    let [outer, inner] = shell(NAVE_M - 0.22, 0.3, n);
    for i in 1..BAYS {
        let y = i as f64 * BAY_M;
        hall.band([&outer, &inner], false, [-y - 0.22, 0.22 - y], place, STONE);
    }
}

/// Adds the wall at each end: a rose window in the far one.
fn ends(hall: &mut Solids, parts: f64) {
    let top = SPRING_M + NAVE_M + VAULT_M;
    let wide = AISLE_M + WALL_M;
    hall.block([-wide, -0.5, 0.0], [wide, 0.0, top], STONE);
    let (far, centre, half) = (LENGTH_M, 9.4, 3.0);
    let depth = [far, far + 0.5];
    hall.block([-wide, far, 0.0], [wide, depth[1], centre - half], STONE);
    hall.block([-wide, far, centre - half], [-half, depth[1], top], STONE);
    hall.block([half, far, centre - half], [wide, depth[1], top], STONE);
    hall.block([-half, far, centre + half], [half, depth[1], top], STONE);
    let n = even(parts / 4.0, 3) * 8;
    let ring = |radius: f64, is_square: bool| -> Vec<Flat> {
        (0..n)
            .map(|i| {
                let (s, c) = libm::sincos(TAU * i as f64 / n as f64);
                let r = if is_square { radius / s.abs().max(c.abs()) } else { radius };
                [r * c, centre + r * s]
            })
            .collect()
    };
    let place = |[x, z]: Flat, depth: f64| [x, -depth, z];
    let depths = [-depth[1], -depth[0]];
    hall.band([&ring(half, true), &ring(2.2, false)], true, depths, place, PALE);
    hall.band([&ring(0.7, false), &ring(0.5, false)], true, depths, place, PALE);
    for i in 0..8 {
        let (s, c) = libm::sincos(TAU * i as f64 / 8.0);
        let spoke = |r: f64, w: f64| [r * c - w * s, centre + r * s + w * c];
        let outer = [spoke(0.65, -0.08), spoke(2.25, -0.08)];
        let inner = [spoke(0.65, 0.08), spoke(2.25, 0.08)];
        hall.band([&outer, &inner], false, depths.map(|d| d * 0.999), place, PALE);
    }
}

fn floor(hall: &mut Solids) {
    let wide = AISLE_M + WALL_M;
    hall.block([-wide, -0.5, -0.3], [wide, LENGTH_M + 0.5, 0.0], FLOOR);
    for (i, height) in [0.18, 0.36, 0.54].into_iter().enumerate() {
        let y = LENGTH_M - 4.0 + 0.4 * i as f64;
        hall.block([-3.2, y, 0.0], [3.2, LENGTH_M, height], STONE);
    }
    hall.block([-1.1, LENGTH_M - 2.0, 0.54], [1.1, LENGTH_M - 1.1, 1.6], PALE);
}

/// Adds rows of benches on both sides of the middle.
fn pews(hall: &mut Solids) {
    for row in 0..9 {
        let y = 4.0 + 1.5 * row as f64;
        for side in [-1.0, 1.0] {
            let [a, b]: [f64; 2] = [side * 0.9, side * 3.0];
            let (x0, x1) = (a.min(b), a.max(b));
            hall.block([x0, y, 0.42], [x1, y + 0.4, 0.47], WOOD);
            hall.block([x0, y - 0.05, 0.42], [x1, y, 0.95], WOOD);
            for x in [x0, x1 - 0.06] {
                hall.block([x, y - 0.05, 0.0], [x + 0.06, y + 0.4, 0.42], WOOD);
            }
        }
    }
}
