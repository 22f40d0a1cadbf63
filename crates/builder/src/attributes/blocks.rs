//! Estimates normals fast, from sums over cells instead of a search for neighbours. Cells of the
//! octree with a few points each lie along the Morton curve; the moments of the block of 3 x 3 x 3
//! cells around a cell give one plane for all its points (`hoppe1992`, section 3.2). Where a block
//! has too few points, or is no surface, the block of the cell above it follows. A normal depends
//! only on the cells of the coarsest level around its own, so it is the same however a cloud is cut
//! into chunks.

use crate::attributes::knn::sorted_codes;
use crate::attributes::normals::{LINE, UNKNOWN, code_of, joined};
use esker_points::{Cell, morton};
use rayon::prelude::*;
use std::ops::Range;

/// A cell with fewer points is not divided.
const DIVIDED: u32 = 4;
/// Points of a block from which a plane is fitted: with them the error on noisy planes is less than
/// that of 16 nearest neighbours, since most blocks have more.
const FITTED: f64 = 12.0;
/// Points of a block from which it is not enlarged if it is no surface.
const FINAL: f64 = 64.0;
/// Edge of the coarsest cells, at most, in typical spacings.
const COARSEST_SPACINGS: f64 = 16.0;
/// Log2 of the edge of the coarsest cells, at most.
const LOG2_MAX: u32 = 31;
/// Cells along an edge of a tile, whose blocks are summed together, and with those around it.
const TILE: usize = 16;
const TILE_LOG2: u32 = TILE.ilog2();
const WIDE: usize = TILE + 2;
/// Points from which a task makes cells, and tiles that it fits.
const TASK_POINTS: usize = 1 << 14;
const TASK_TILES: usize = 16;
/// Code of a point whose plane is still to be fitted; no direction has it.
const OPEN: [i16; 2] = [i16::MIN, 0];
/// Difference between unsigned and signed coordinates.
const SIGN: f64 = (1u32 << 31) as f64;
/// Newton's steps to the least eigenvalue.
const STEPS: usize = 6;

/// Number of points, sums of x, y, z, and of xx, yy, zz, xy, xz, yz.
type Moments = [f64; 10];

/// Cells of one level, as ranges of points.
type Cells = Vec<Range<u32>>;

/// Limits of blocks.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    /// Length of a lattice step on each axis.
    pub scale: [f64; 3],
    /// Log2 of the edge of the coarsest cells.
    pub coarsest: u32,
}

impl Blocks {
    /// Limits for a cloud whose points are typically `spacing` steps apart.
    pub fn new(scale: [f64; 3], spacing: f64) -> Self {
        let steps = (spacing * COARSEST_SPACINGS).clamp(1.0, f64::from(1u32 << LOG2_MAX));
        Self { scale, coarsest: steps.log2() as u32 }
    }

    /// Edge of the coarsest cells, in steps. Points farther from the faces of a cell of the octree
    /// influence no normal outside of it.
    pub fn steps(&self) -> u32 {
        1 << self.coarsest
    }

    /// The least and the greatest position that influence normals in a cell.
    pub fn around(&self, cell: &Cell) -> [[u32; 3]; 2] {
        let low = cell.corner.map(|c| c >> self.coarsest << self.coarsest);
        let high = cell.last().map(|c| c | (self.steps() - 1));
        [low.map(|c| c.saturating_sub(self.steps())), high.map(|c| c.saturating_add(self.steps()))]
    }
}

/// Estimates the normals of `own` points, which lie along the Morton curve, and returns their
/// octahedral codes. `halo` has at least all other points that influence them, in any order.
/// Directions are chosen as by [`crate::attributes::normals::estimate`].
pub fn estimate(own: &[[u32; 3]], halo: &[[u32; 3]], blocks: &Blocks) -> Vec<[i16; 2]> {
    let (points, place_of) = joined(own, &sorted_codes(halo));
    let cloud = Cloud { points: &points, blocks };
    let mut codes = vec![UNKNOWN; points.len()];
    place_of.iter().for_each(|&place| codes[place as usize] = OPEN);
    for (level, cells) in (0..).zip(cloud.levels()) {
        cloud.fit(level, &cells, &mut codes);
    }
    let code = |&place: &u32| Some(codes[place as usize]).filter(|&code| code != OPEN);
    place_of.iter().map(|place| code(place).unwrap_or(UNKNOWN)).collect()
}

/// Distinct points along the Morton curve.
struct Cloud<'a> {
    points: &'a [[u32; 3]],
    blocks: &'a Blocks,
}

impl Cloud<'_> {
    /// The cell of a level that has a point, as multiples of its edge.
    fn cell(&self, point: u32, level: u32) -> [u32; 3] {
        self.points[point as usize].map(|c| c >> level)
    }

    /// Cells of each level, the finest first. A level has no cells within cells that are not
    /// divided: they would hold hardly any points.
    fn levels(&self) -> Vec<Cells> {
        let (coarsest, count) = (self.blocks.coarsest, self.points.len());
        let mut tasks = Vec::new();
        let mut start = 0;
        while start < count {
            // Tasks end with a cell of the coarsest level.
            let mut end = (start + TASK_POINTS).min(count);
            let last = self.cell(end as u32 - 1, coarsest);
            end += self.points[end..].partition_point(|p| p.map(|c| c >> coarsest) == last);
            tasks.push(start as u32..end as u32);
            start = end;
        }
        let of_task = |task: Range<u32>| {
            let mut levels = vec![Cells::new(); coarsest as usize + 1];
            self.divide(task, coarsest, &mut levels);
            levels
        };
        let parts: Vec<Vec<Cells>> = tasks.into_par_iter().map(of_task).collect();
        let level = |level: usize| parts.iter().flat_map(|part| part[level].clone()).collect();
        (0..=coarsest as usize).map(level).collect()
    }

    /// Adds the cells of `level` and below that hold these points, which begin and end with a cell.
    fn divide(&self, points: Range<u32>, level: u32, levels: &mut [Cells]) {
        /// Points of a cell that are walked; more are searched.
        const WALKED: u32 = 16;
        let mut start = points.start;
        while start < points.end {
            let cell = self.cell(start, level);
            let mut end = start + 1;
            while end < points.end && end - start < WALKED && self.cell(end, level) == cell {
                end += 1;
            }
            if end - start == WALKED {
                let rest = &self.points[end as usize..points.end as usize];
                end += rest.partition_point(|p| p.map(|c| c >> level) == cell) as u32;
            }
            levels[level as usize].push(start..end);
            if end - start >= DIVIDED && level > 0 {
                self.divide(start..end, level - 1, levels);
            }
            start = end;
        }
    }

    /// Fits planes to the cells of a level that have open points.
    fn fit(&self, level: u32, cells: &Cells, codes: &mut [[i16; 2]]) {
        let tile_of = |cell: &Range<u32>| self.cell(cell.start, level).map(|c| c >> TILE_LOG2);
        let mut tiles = Tiles { cells, codes: Vec::new(), ranges: Vec::new() };
        let mut start = 0;
        for run in cells.chunk_by(|a, b| tile_of(a) == tile_of(b)) {
            tiles.codes.push(morton::encode3(tile_of(&run[0])));
            tiles.ranges.push(start..start + run.len());
            start += run.len();
        }
        let mut tasks = Vec::new();
        let (mut rest, mut before) = (codes, 0);
        for some in tiles.ranges.chunks(TASK_TILES) {
            let first = cells[some[0].start].start;
            let end = cells[some[some.len() - 1].end - 1].end;
            let from = &mut rest[(first - before) as usize..];
            let (part, after) = from.split_at_mut((end - first) as usize);
            tasks.push((some, first, part));
            (rest, before) = (after, end);
        }
        tasks.into_par_iter().for_each_init(Tile::default, |tile, (some, first, codes)| {
            for own in some.iter().map(|range| &cells[range.clone()]) {
                let places =
                    |cell: &Range<u32>| (cell.start - first) as usize..(cell.end - first) as usize;
                let is_open = |cell: &&Range<u32>| codes[places(cell)].contains(&OPEN);
                let open: Vec<&Range<u32>> = own.iter().filter(is_open).collect();
                if open.is_empty() {
                    continue;
                }
                tile.fill(self, level, tile_of(&own[0]), &tiles);
                for cell in open {
                    let sums = tile.block(self.cell(cell.start, level));
                    if let Some(code) = code_of_block(&sums, self.blocks.scale) {
                        let own = codes[places(cell)].iter_mut();
                        own.filter(|old| **old == OPEN).for_each(|old| *old = code);
                    }
                }
            }
        });
    }
}

/// Tiles of a level along the Morton curve: their codes, and their ranges of cells.
struct Tiles<'a> {
    cells: &'a Cells,
    codes: Vec<u128>,
    ranges: Vec<Range<usize>>,
}

impl Tiles<'_> {
    /// Cells of the tile that is moved by -1 to 1 on each axis.
    fn beside(&self, tile: [u32; 3], by: [i32; 3]) -> &[Range<u32>] {
        let moved = |i: usize| tile[i].checked_add_signed(by[i]);
        let (Some(x), Some(y), Some(z)) = (moved(0), moved(1), moved(2)) else { return &[] };
        let found = self.codes.binary_search(&morton::encode3([x, y, z]));
        found.map_or(&[], |at| &self.cells[self.ranges[at].clone()])
    }
}

/// Moments of the cells of a tile and of those around it.
struct Tile {
    /// Cell before the first on each axis; wraps at the lattice's end.
    corner: [u32; 3],
    /// Indices of the moments of cells; 0 where there is none.
    index: Vec<u16>,
    moments: Vec<Moments>,
}

impl Default for Tile {
    fn default() -> Self {
        Self { corner: [0; 3], index: vec![0; WIDE * WIDE * WIDE], moments: Vec::new() }
    }
}

impl Tile {
    /// Sums the moments of the cells, relative to the corner of the tile.
    fn fill(&mut self, cloud: &Cloud<'_>, level: u32, tile: [u32; 3], tiles: &Tiles<'_>) {
        self.index.fill(0);
        self.moments.clear();
        self.moments.push([0.0; 10]);
        let first = tile.map(|c| c << TILE_LOG2);
        self.corner = first.map(|c| c.wrapping_sub(1));
        // Signed integers are converted to floats faster.
        let origin = first.map(|c| f64::from(c) * f64::from(1u32 << level) - SIGN);
        for around in 0..27 {
            let by = [around % 3, around / 3 % 3, around / 9].map(|c: i32| c - 1);
            for cell in tiles.beside(tile, by) {
                let [x, y, z] = self.place(cloud.cell(cell.start, level));
                if x.max(y).max(z) >= WIDE {
                    continue;
                }
                self.index[x + WIDE * (y + WIDE * z)] = self.moments.len() as u16;
                let mut moments = [0.0; 10];
                for p in &cloud.points[cell.start as usize..cell.end as usize] {
                    let step = |i: usize| f64::from((p[i] ^ 1 << 31).cast_signed()) - origin[i];
                    let [x, y, z] = [step(0), step(1), step(2)];
                    let terms = [1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z];
                    moments.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                }
                self.moments.push(moments);
            }
        }
    }

    /// Place of a cell on each axis, from [`WIDE`] on outside of the tile.
    fn place(&self, cell: [u32; 3]) -> [usize; 3] {
        [0, 1, 2].map(|i| cell[i].wrapping_sub(self.corner[i]) as usize)
    }

    /// Moments of the block around a cell of the tile.
    fn block(&self, cell: [u32; 3]) -> Moments {
        let [x, y, z] = self.place(cell);
        let mut sums = [0.0; 10];
        for row in [0, 1, 2].map(|k| WIDE * WIDE * (z + k - 1)) {
            for row in [0, 1, 2].map(|j| row + WIDE * (y + j - 1) + x - 1) {
                for &slot in &self.index[row..row + 3] {
                    let moments = &self.moments[usize::from(slot)];
                    sums.iter_mut().zip(moments).for_each(|(sum, term)| *sum += term);
                }
            }
        }
        sums
    }
}

/// Code of the normal of a block; `None` if it has too few points, or is no surface and may be
/// enlarged.
fn code_of_block(sums: &Moments, scale: [f64; 3]) -> Option<[i16; 2]> {
    let [n, x, y, z, xx, yy, zz, xy, xz, yz] = *sums;
    if n < FITTED {
        return None;
    }
    let [a, b, c] = scale;
    let covariance = [
        (n * xx - x * x) * (a * a),
        (n * yy - y * y) * (b * b),
        (n * zz - z * z) * (c * c),
        (n * xy - x * y) * (a * b),
        (n * xz - x * z) * (a * c),
        (n * yz - y * z) * (b * c),
    ];
    let normal = normal_of(covariance);
    normal.map(code_of).or((n >= FINAL).then_some(UNKNOWN))
}

/// Direction, of any length, in which points with this covariance (xx, yy, zz, xy, xz, yz) spread
/// least; `None` if they are no surface: they lie along a line, or are more of a volume than of a
/// plane by the measures of `westin1997`. Without square roots and trigonometry, so the bits are
/// the same on every machine.
fn normal_of(covariance: [f64; 6]) -> Option<[f64; 3]> {
    let trace = covariance[0] + covariance[1] + covariance[2];
    if !(trace > 0.0 && trace.is_finite()) {
        return None;
    }
    let [xx, yy, zz, xy, xz, yz] = covariance.map(|c| c / trace);
    let minors = (xx * yy - xy * xy) + (xx * zz - xz * xz) + (yy * zz - yz * yz);
    let det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    // Newton's steps from below approach the least root of the characteristic polynomial and do not
    // pass it.
    let mut least = 0.0;
    for _ in 0..STEPS {
        let value = ((least - 1.0) * least + minors) * least - det;
        let slope = (3.0 * least - 2.0) * least + minors;
        if value >= 0.0 || slope <= 0.0 {
            break;
        }
        least -= value / slope;
    }
    // Sum and product of the other two. A volume has a least eigenvalue over half of the second.
    let (sum, product) = (1.0 - least, minors - least * (1.0 - least));
    let twice = 2.0 * least;
    let is_line = product * (1.0 + LINE) * (1.0 + LINE) <= LINE * sum * sum;
    let is_volume = twice * (twice - sum) + product < 0.0 || twice > 0.5 * sum;
    if is_line || is_volume {
        return None;
    }
    let rows = [[xx - least, xy, xz], [xy, yy - least, yz], [xz, yz, zz - least]];
    let cross = |[i, j]: [usize; 2]| {
        let (a, b) = (rows[i], rows[j]);
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let square = |v: &[f64; 3]| v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    let all = [[0, 1], [0, 2], [1, 2]].map(cross);
    all.into_iter().max_by(|a, b| square(a).total_cmp(&square(b)))
}

#[cfg(test)]
mod tests;
