//! The valley under the bridge: a height map, interpolated between its samples. Rays go from tile
//! to tile of the map, skip the tiles that they fly over, and march down to the ground in the
//! others, by steps that the tile's greatest slope allows.

use super::draw::{floor, noise, smooth};
use super::ray::{Hit, Material, Ray, Texture};

/// Half the valley's extent along x and y, and the sample distance; metres.
pub const HALF: [f64; 2] = [112.0, 84.0];
const STEP: f64 = 0.5;
const COLUMNS: usize = (2.0 * HALF[0] / STEP) as usize + 1;
const ROWS: usize = (2.0 * HALF[1] / STEP) as usize + 1;
/// Half the width of the river, whose surface is at 0, the length of the slopes, and their rise;
/// metres.
const RIVER: f64 = 11.0;
const SLOPE_M: f64 = 75.0;
const RISE: f64 = 17.0;
/// Fraction of rays on water that return.
const GLINT: f64 = 0.2;
/// Squares of the map along a tile's edge, and tiles along x and y.
const TILE: usize = 8;
const TILES: [usize; 2] = [(COLUMNS - 1) / TILE, (ROWS - 1) / TILE];
const TILE_M: f64 = TILE as f64 * STEP;
/// Greatest number of marching steps in a tile, and the distance from the ground at which they end,
/// metres.
const MARCH_MAX: usize = 60;
const NEAR: f64 = 0.02;

const GRASS: Material = Material::new([98, 122, 60], 0.45, 2, Texture::Speckle(2.5));
const GRAVEL: Material = Material::new([158, 148, 132], 0.4, 2, Texture::Speckle(9.0));
const ROCK: Material = Material::new([128, 122, 114], 0.4, 2, Texture::Speckle(5.0));
const WATER: Material = Material::new([54, 76, 80], 0.06, 9, Texture::Speckle(0.6));

/// Heights of the ground.
pub struct Valley {
    heights: Vec<f64>,
    tiles: Vec<Tile>,
    /// Greatest height of all.
    top: f64,
    seed: u64,
}

/// Bounds of a tile of the height map.
struct Tile {
    /// Greatest height, at least that of the river.
    top: f64,
    /// Greatest slope.
    slope: f64,
}

impl Tile {
    fn new(heights: &[f64], column: usize, row: usize) -> Self {
        let (mut top, mut slope) = (0.0f64, 0.0f64);
        for (i, j) in (0..=TILE).flat_map(|j| (0..=TILE).map(move |i| (i, j))) {
            let at = |i: usize, j: usize| heights[column + i + (row + j) * COLUMNS];
            let here = at(i, j);
            top = top.max(here);
            let dx = if i > 0 { here - at(i - 1, j) } else { 0.0 };
            let dy = if j > 0 { here - at(i, j - 1) } else { 0.0 };
            slope = slope.max((dx * dx + dy * dy).sqrt() / STEP);
        }
        // Inside a square, the two interpolated slopes may come from different edges.
        Self { top, slope: 1.42 * slope }
    }
}

/// Distance from the river's middle, metres.
fn from_river(seed: u64, x: f64, y: f64) -> f64 {
    (x - 7.0 * noise(seed ^ 20, y / 45.0, 0.5)).abs()
}

fn height(seed: u64, x: f64, y: f64) -> f64 {
    let d = from_river(seed, x, y);
    let rise = RISE * smooth((d - RIVER) / SLOPE_M) + 0.1 * (d - RIVER - SLOPE_M).max(0.0);
    let bumps =
        1.6 * noise(seed ^ 21, x / 9.0, y / 9.0) + 0.14 * noise(seed ^ 22, x / 1.3, y / 1.3);
    rise - 1.2 + 1.6 * smooth((d - RIVER + 4.0) / 6.0) + bumps * smooth((d - RIVER) / 12.0)
}

impl Valley {
    /// The valley of a seed.
    pub fn new(seed: u64) -> Self {
        let place = |i: usize| [i % COLUMNS, i / COLUMNS].map(|c| c as f64 * STEP);
        let heights: Vec<f64> = (0..COLUMNS * ROWS)
            .map(|i| height(seed, place(i)[0] - HALF[0], place(i)[1] - HALF[1]))
            .collect();
        let tile = |i: usize| Tile::new(&heights, i % TILES[0] * TILE, i / TILES[0] * TILE);
        let tiles: Vec<Tile> = (0..TILES[0] * TILES[1]).map(tile).collect();
        let top = tiles.iter().fold(0.0, |top: f64, tile| top.max(tile.top));
        Self { heights, tiles, top, seed }
    }

    /// Height of the ground, also under water, and its slope along x and y; `None` outside.
    fn ground(&self, x: f64, y: f64) -> Option<(f64, [f64; 2])> {
        let (u, v) = ((x + HALF[0]) / STEP, (y + HALF[1]) / STEP);
        let (i, j) = (floor(u), floor(v));
        if i < 0 || j < 0 || i as usize >= COLUMNS - 1 || j as usize >= ROWS - 1 {
            return None;
        }
        let (fu, fv) = (u - i as f64, v - j as f64);
        let at = i as usize + j as usize * COLUMNS;
        let [a, b] = [self.heights[at], self.heights[at + 1]];
        let [c, d] = [self.heights[at + COLUMNS], self.heights[at + COLUMNS + 1]];
        let (low, high) = (a + (b - a) * fu, c + (d - c) * fu);
        let along_x = (b - a) * (1.0 - fv) + (d - c) * fv;
        Some((low + (high - low) * fv, [along_x / STEP, (high - low) / STEP]))
    }

    /// Height of the ground, 0 outside.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        self.ground(x, y).map_or(0.0, |(z, _)| z)
    }

    /// Whether something can stand at a point: it is dry and not on the bank.
    pub fn is_dry(&self, x: f64, y: f64) -> bool {
        from_river(self.seed, x, y) > RIVER + 4.0
    }

    /// Casts a ray to ground or water before `t_max`: `None` if it meets neither, `Some(None)` if
    /// nothing returns. On water, `glint`, from 0 to 1, decides whether the ray returns; mostly it
    /// does not.
    pub fn cast(&self, ray: &Ray, t_max: f64, glint: f64) -> Option<Option<Hit>> {
        let level = (ray.to[0] * ray.to[0] + ray.to[1] * ray.to[1]).sqrt();
        let mut t = 0.0;
        while t < t_max {
            // Moved slightly, so that the point is within the tile that is entered.
            let p = ray.at(t + 1e-6);
            if ray.to[2] > 0.0 && p[2] > self.top {
                return None;
            }
            let at = [0, 1].map(|i| floor((p[i] + HALF[i]) / TILE_M));
            if (0..2).any(|i| at[i] < 0 || at[i] as usize >= TILES[i]) {
                return None;
            }
            let edge = |i: usize| {
                let next = at[i] + i64::from(ray.to[i] > 0.0);
                ray.reach(i, next as f64 * TILE_M - HALF[i])
            };
            let t_edge = edge(0).min(edge(1)).max(t + 1e-6);
            let tile = &self.tiles[at[0] as usize + at[1] as usize * TILES[0]];
            let closing = tile.slope * level - ray.to[2];
            if p[2].min(ray.at(t_edge)[2]) <= tile.top && closing > 0.0 {
                let end = self.march(ray, t, t_edge.min(t_max), closing, glint);
                if end.is_some() {
                    return end;
                }
            }
            t = t_edge;
        }
        None
    }

    /// Marches through a tile; `None` if the ray leaves it again.
    fn march(
        &self,
        ray: &Ray,
        mut t: f64,
        t_end: f64,
        closing: f64,
        glint: f64,
    ) -> Option<Option<Hit>> {
        for _ in 0..MARCH_MAX {
            let p = ray.at(t);
            if p[2] <= 0.0 {
                let t = ray.reach(2, 0.0);
                return Some((glint < GLINT).then(|| Hit::on_face(ray, t, 2, true, WATER)));
            }
            let (z, slope) = self.ground(p[0], p[1])?;
            let gap = p[2] - z;
            if gap < NEAR {
                // Onto the tangent plane of the ground here.
                let sinking = slope[0] * ray.to[0] + slope[1] * ray.to[1] - ray.to[2];
                let t = t + if sinking > 0.05 { gap / sinking } else { 0.0 };
                return Some(Some(self.hit(ray, t, slope, z)));
            }
            t += gap / closing;
            if t > t_end {
                return None;
            }
        }
        None
    }

    fn hit(&self, ray: &Ray, t: f64, slope: [f64; 2], z: f64) -> Hit {
        let steep = slope[0] * slope[0] + slope[1] * slope[1];
        let up = 1.0 / (1.0 + steep).sqrt();
        let facing = (slope[0] * ray.to[0] + slope[1] * ray.to[1] - ray.to[2]) * up;
        let material = if steep > 0.75 {
            ROCK
        } else if z < 0.9 {
            GRAVEL
        } else {
            GRASS
        };
        // Light from the south-east, high up.
        let light = (0.55 + 0.5 * up * (0.8 - 0.45 * slope[0] + 0.4 * slope[1])).clamp(0.4, 1.05);
        Hit { t, incidence: facing.clamp(0.0, 1.0), light, material }
    }
}
