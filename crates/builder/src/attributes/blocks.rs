//! Estimates normals fast, from sums over cells instead of a search for neighbours. Cells of the
//! octree with a few points each lie along the Morton curve; the moments of the block of 3 x 3 x 3
//! cells around a cell give one plane for all its points (`hoppe1992`, section 3.2), or several
//! planes that meet at an edge. Where a block has too few points, or is no surface, the block of
//! the cell above it follows. A normal depends only on the cells of the coarsest level around its
//! own, so it is the same however a cloud is cut into chunks. Wires get none.

use crate::attributes::knn::sorted_codes;
use crate::attributes::normals::{UNKNOWN, code_of, joined};
use cloud::{Cells, Cloud, OPEN, SIGN};
use edges::{CORNER, Planes};
use esker_points::morton;
use plane::{Moments, Plane, Spread, add, moments};
use rayon::prelude::*;
use std::ops::Range;
use wires::{Line, Suspect};

mod cloud;
mod edges;
mod plane;
mod wires;

pub use cloud::Blocks;

/// Points of a block from which a plane is fitted: with them the error on noisy planes is less than
/// that of 16 nearest neighbours, since most blocks have more.
const FITTED: f64 = 12.0;
/// Points of a block from which it is not enlarged if it is no surface.
const FINAL: f64 = 128.0;
/// Points of a block from which one plane is its surface though it is not flat: with fewer, its
/// parts have too few points to tell an edge.
const PARTED: f64 = 36.0;
/// Least variance of a block over the sum of all three, up to which one plane is its surface.
const FLAT: f64 = 0.02;
/// The same up to which one plane is the surface of a block at all: noise of 0.55 spacings where a
/// block has 36 points, and of one spacing where it has 128. Most groups of leaves have more.
const ROUGH: f64 = 0.05;
/// Points of a block that is nearly a plane from which it is searched for an edge; of others, which
/// are mostly volumes, [`PARTED`].
const SEARCHED: f64 = 20.0;
/// Cells along an edge of a tile, whose blocks are summed together, and with those around it.
const TILE: usize = 16;
const TILE_LOG2: u32 = TILE.ilog2();
const WIDE: usize = TILE + 2;
/// Tiles that a task fits.
const TASK_TILES: usize = 16;

/// Estimates the normals of `own` points, which lie along the Morton curve, and returns their
/// octahedral codes, [`crate::attributes::normals::WIRE`] on wires. `halo` has at least all other
/// points that influence them, in any order. Directions are chosen as by
/// [`crate::attributes::normals::estimate`].
pub fn estimate(own: &[[u32; 3]], halo: &[[u32; 3]], blocks: &Blocks) -> Vec<[i16; 2]> {
    let (mut points, mut place_of) = joined(own, &sorted_codes(halo));
    if blocks.shift != [0; 3] {
        sort_by_cells(&mut points, &mut place_of, blocks);
    }
    let cloud = Cloud { points: &points, blocks };
    let mut codes = vec![UNKNOWN; points.len()];
    place_of.iter().for_each(|&place| codes[place as usize] = OPEN);
    let mut suspects = Vec::new();
    for (level, cells) in (0..).zip(cloud.levels()) {
        suspects.extend(cloud.fit(level, &cells, &mut codes));
    }
    wires::settle(&cloud, &suspects, &mut codes);
    let code = |&place: &u32| Some(codes[place as usize]).filter(|&code| code != OPEN);
    place_of.iter().map(|place| code(place).unwrap_or(UNKNOWN)).collect()
}

/// Sorts points along the Morton curve of cubes; `place_of` are places in them.
fn sort_by_cells(points: &mut Vec<[u32; 3]>, place_of: &mut [u32], blocks: &Blocks) {
    let code = |&place: &u32| morton::encode3(blocks.cell_at(points[place as usize], 0));
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.par_sort_by_cached_key(|place| (code(place), *place));
    let mut moved = vec![0; points.len()];
    (0..).zip(&order).for_each(|(to, &from)| moved[from as usize] = to);
    place_of.iter_mut().for_each(|place| *place = moved[*place as usize]);
    *points = order.iter().map(|&from| points[from as usize]).collect();
}

impl Cloud<'_> {
    /// Fits planes to the cells of a level that have open points; returns those whose points are on
    /// a line.
    fn fit(&self, level: u32, cells: &Cells, codes: &mut [[i16; 2]]) -> Vec<Suspect> {
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
        let fit =
            |tile: &mut Tile, (some, first, codes): (&[Range<usize>], u32, &mut [[i16; 2]])| {
                let mut suspects = Vec::new();
                for own in some.iter().map(|range| &cells[range.clone()]) {
                    let places = |cell: &Range<u32>| {
                        (cell.start - first) as usize..(cell.end - first) as usize
                    };
                    let is_open = |cell: &&Range<u32>| codes[places(cell)].contains(&OPEN);
                    let open: Vec<&Range<u32>> = own.iter().filter(is_open).collect();
                    if open.is_empty() {
                        continue;
                    }
                    tile.fill(self, level, tile_of(&own[0]), &tiles);
                    for cell in open {
                        let is_last = level == self.blocks.coarsest;
                        let at = self.cell(cell.start, level);
                        let Some(surface) = tile.surface(self, at, is_last) else {
                            continue;
                        };
                        if let Some(line) = tile.line(self, at, &surface) {
                            suspects.push(Suspect { points: cell.clone(), line, level });
                        }
                        if matches!(surface, Surface::Line) {
                            continue;
                        }
                        let open = cell.clone().zip(&mut codes[places(cell)]);
                        for (point, code) in open.filter(|(_, old)| **old == OPEN) {
                            *code = surface.code_at(|| tile.steps(self.points[point as usize]));
                        }
                    }
                }
                suspects
            };
        tasks.into_par_iter().map_init(Tile::default, fit).flatten_iter().collect()
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

/// What a block is.
enum Surface {
    /// One plane, or no surface: a code for all points.
    Even([i16; 2]),
    /// Planes that meet at an edge.
    Edge(Box<Planes>),
    /// A line; the block of the cell above follows.
    Line,
}

/// Moments of the cells of a tile and of those around it.
struct Tile {
    /// Cell before the first on each axis; wraps at the lattice's end.
    corner: [u32; 3],
    /// Corner of the tile, in steps, relative to the middle of the lattice.
    origin: [f64; 3],
    /// Indices of the moments of cells; 0 where there is none.
    index: Vec<u16>,
    moments: Vec<Moments>,
    /// Points of the cells.
    points: Vec<Range<u32>>,
    /// Points of a block, in steps; empty between blocks.
    steps: Vec<[f64; 3]>,
}

impl Default for Tile {
    fn default() -> Self {
        let index = vec![0; WIDE * WIDE * WIDE];
        let (corner, origin) = ([0; 3], [0.0; 3]);
        Self { corner, origin, index, moments: Vec::new(), points: Vec::new(), steps: Vec::new() }
    }
}

impl Tile {
    /// Sums the moments of the cells, relative to the corner of the tile.
    fn fill(&mut self, cloud: &Cloud<'_>, level: u32, tile: [u32; 3], tiles: &Tiles<'_>) {
        self.index.fill(0);
        self.moments.clear();
        self.moments.push([0.0; 10]);
        self.points.clear();
        self.points.push(0..0);
        let first = tile.map(|c| c << TILE_LOG2);
        self.corner = first.map(|c| c.wrapping_sub(1));
        let edge = cloud.blocks.shift.map(|shift| f64::from(1u32 << (level + shift)));
        self.origin = [0, 1, 2].map(|i| f64::from(first[i]) * edge[i] - SIGN);
        for around in 0..27 {
            let by = [around % 3, around / 3 % 3, around / 9].map(|c: i32| c - 1);
            for cell in tiles.beside(tile, by) {
                let [x, y, z] = self.place(cloud.cell(cell.start, level));
                if x.max(y).max(z) >= WIDE {
                    continue;
                }
                self.index[x + WIDE * (y + WIDE * z)] = self.moments.len() as u16;
                let mut sums = [0.0; 10];
                for &p in &cloud.points[cell.start as usize..cell.end as usize] {
                    add(&mut sums, &moments(self.steps(p)));
                }
                self.moments.push(sums);
                self.points.push(cell.clone());
            }
        }
    }

    /// Place of a cell on each axis, from [`WIDE`] on outside of the tile.
    fn place(&self, cell: [u32; 3]) -> [usize; 3] {
        [0, 1, 2].map(|i| cell[i].wrapping_sub(self.corner[i]) as usize)
    }

    /// Position of a point relative to the corner of the tile, in steps.
    fn steps(&self, p: [u32; 3]) -> [f64; 3] {
        // Signed integers are converted to floats faster.
        [0, 1, 2].map(|i| f64::from((p[i] ^ 1 << 31).cast_signed()) - self.origin[i])
    }

    /// Indices of the moments of the cells of the block around a cell of the tile, x first.
    fn block(&self, cell: [u32; 3]) -> [usize; 27] {
        let [x, y, z] = self.place(cell);
        let first = x - 1 + WIDE * (y - 1 + WIDE * (z - 1));
        let at = |i: usize| first + i % 3 + WIDE * (i / 3 % 3 + WIDE * (i / 9));
        std::array::from_fn(|i| usize::from(self.index[at(i)]))
    }

    /// What the block around a cell of the tile is; `None` if it has too few points, or if the
    /// block of the cell above follows, which it does not if `is_last`.
    fn surface(&mut self, cloud: &Cloud<'_>, cell: [u32; 3], is_last: bool) -> Option<Surface> {
        let block = self.block(cell);
        let mut sums = [0.0; 10];
        block.iter().for_each(|&cell| add(&mut sums, &self.moments[cell]));
        if sums[0] < FITTED {
            return None;
        }
        let scale = cloud.blocks.scale;
        let unknown = || (sums[0] >= FINAL).then_some(Surface::Even(UNKNOWN));
        let Some(plane) = Plane::of(&sums, scale) else { return unknown() };
        if plane.spread == Spread::Line {
            return Some(Surface::Line);
        }
        let is_plane = plane.spread == Spread::Plane && plane.share <= ROUGH;
        let is_flat = is_plane && plane.share <= FLAT;
        if !is_flat && sums[0] >= if is_plane { SEARCHED } else { PARTED } {
            let mut points = std::mem::take(&mut self.steps);
            points.clear();
            let fill = |points: &mut Vec<[f64; 3]>| {
                let cells = block.iter().flat_map(|&cell| self.points[cell].clone());
                points.extend(cells.map(|p| self.steps(cloud.points[p as usize])));
            };
            let cells = block.map(|cell| &self.moments[cell]);
            let planes = edges::planes(&plane, &cells, (&mut points, fill), scale);
            self.steps = points;
            if let Some(planes) = planes {
                return Some(Surface::Edge(Box::new(planes)));
            }
        }
        if is_plane && !is_flat && sums[0] < PARTED && !is_last {
            return None;
        }
        if is_plane {
            return Some(Surface::Even(code_of(plane.normal)));
        }
        let part = (sums[0] >= PARTED && plane.share <= CORNER)
            .then(|| edges::flattest(&block.map(|cell| &self.moments[cell]), FITTED, scale));
        let part = part.flatten().map(|part| Surface::Even(code_of(part.normal)));
        part.or_else(unknown)
    }

    /// The line that the points of a cell are on, if they may be a wire.
    fn line(&self, cloud: &Cloud<'_>, cell: [u32; 3], surface: &Surface) -> Option<Line> {
        let cells = self.block(cell).map(|cell| &self.moments[cell]);
        let scale = cloud.blocks.scale;
        match surface {
            Surface::Even(UNKNOWN) => None,
            Surface::Line => Line::of_all(&cells, self.origin, scale),
            Surface::Even(_) | Surface::Edge(_) => Line::of(&cells, self.origin, scale),
        }
    }
}

impl Surface {
    /// Code of the normal of a point at the position that `steps` returns.
    fn code_at(&self, steps: impl FnOnce() -> [f64; 3]) -> [i16; 2] {
        match self {
            Self::Even(code) => *code,
            Self::Edge(planes) => code_of(planes.nearest_to(steps()).normal),
            Self::Line => UNKNOWN,
        }
    }
}

#[cfg(test)]
mod tests;
