//! Software depth buffer: what the nodes of a cut hide of a view (kanzok2015, sections 3.2.1 and
//! 3.2.2). Occluders are flat nodes drawn densely enough, by the closed parts of their occupancy
//! mask. Each is a slab: a line of sight that enters a closed part of its front and leaves through
//! a closed part of its back has met the surface between. So a slab covers the samples covered by
//! both, and hides what lies behind its back.
//!
//! Samples of all nodes accumulate in the tiles, the nearest nodes first, until a tile has all of
//! its samples: a wall of many nodes is closed across their seams.

use crate::closed::closed_parts;
use crate::grid::{DepthGrid, SIDE};
use crate::occlusion::Occlusion;
use crate::oriented_box::OrientedBox;
use crate::polygon::Polygon;
use crate::prefix::spacing;
use crate::project::Projection;
use crate::raster::Rows;
use crate::selection::Drawn;
use crate::view::View;
use esker_points::{Lattice, NodeTable};
use glam::{DVec2, DVec3};
use std::ops::Range;

/// Samples of a tile on a side: gaps narrower than an eighth of a tile are missed.
const SAMPLES: usize = 8;
/// Samples of the picture on a side.
const SAMPLE_SIDE: usize = SIDE * SAMPLES;
/// Words of 64 samples in a row.
const WORDS: usize = SAMPLE_SIDE / 64;
/// Greatest spacing of an occluder, in tiles.
const SPACING_TILES_MAX: f64 = 0.5;

/// Depth of the surfaces that certainly cover the view.
#[derive(Clone, Debug)]
pub struct SoftwareDepth {
    projection: Projection,
    grid: DepthGrid,
    occluders: usize,
}

impl SoftwareDepth {
    /// Rasterises the occluders among `drawn`: resident nodes, for instance those of the last cut.
    pub fn new(table: &NodeTable, lattice: &Lattice, view: &View, drawn: &[Drawn]) -> Self {
        let projection = Projection::of(view);
        let grid = DepthGrid::new(view);
        let tile_px = 1.0 / grid.tiles_per_px().max_element();
        let spacing_max = tile_px * SPACING_TILES_MAX / view.focal_px();
        let mut slabs: Vec<_> = drawn
            .iter()
            .filter_map(|d| {
                let node = table.nodes.get(d.node as usize)?;
                let contour = OrientedBox::of_contour(node, lattice);
                let [nearest, farthest] = projection.depths(&contour);
                let is_dense = f64::from(d.effective_spacing) < spacing_max * nearest;
                if !(is_dense && nearest > view.near) {
                    return None;
                }
                let above = table.nodes.get(node.parent as usize);
                let closed = closed_parts(node, d, above.map_or(f64::INFINITY, spacing));
                (closed != 0).then_some(Slab { contour, farthest, closed })
            })
            .collect();
        slabs.sort_by(|a, b| a.farthest.total_cmp(&b.farthest));
        let mut canvas = Canvas::new(&grid);
        let mut occluders = 0;
        for slab in &slabs {
            occluders += usize::from(canvas.draw(slab, &projection));
        }
        let grid = canvas.finish(grid);
        Self { projection, grid, occluders }
    }

    /// Number of nodes that contributed.
    pub fn occluders(&self) -> usize {
        self.occluders
    }
}

impl Occlusion for SoftwareDepth {
    fn hides(&self, b: &OrientedBox) -> bool {
        let [nearest, _] = self.projection.depths(b);
        if nearest <= self.projection.near()
            || self.grid.shows_at(self.projection.on_picture(b.centre), nearest)
        {
            return false;
        }
        let Some(silhouette) = self.projection.silhouette(b) else { return false };
        self.grid.hides(silhouette.polygon(), silhouette.nearest)
    }
}

/// A node as an occluder.
struct Slab {
    contour: OrientedBox,
    farthest: f64,
    /// Closed parts of its mask.
    closed: u64,
}

/// One bit a sample, row by row.
type Samples = Vec<[u64; WORDS]>;

/// Tiles while occluders are drawn.
struct Canvas {
    samples_per_px: DVec2,
    size_px: DVec2,
    rows: Rows<SAMPLE_SIDE>,
    front: Samples,
    back: Samples,
    tiles: Vec<Tile>,
}

#[derive(Clone, Copy, Default)]
struct Tile {
    /// Covered samples, a byte a row.
    covered: u64,
    /// Greatest depth of the covered samples.
    farthest: f32,
}

impl Canvas {
    fn new(grid: &DepthGrid) -> Self {
        Self {
            samples_per_px: grid.tiles_per_px() * SAMPLES as f64,
            size_px: grid.size_px(),
            rows: Rows::new(),
            front: vec![[0; WORDS]; SAMPLE_SIDE],
            back: vec![[0; WORDS]; SAMPLE_SIDE],
            tiles: vec![Tile::default(); SIDE * SIDE],
        }
    }

    fn finish(self, mut grid: DepthGrid) -> DepthGrid {
        for (to, tile) in grid.farthest_mut().iter_mut().zip(&self.tiles) {
            *to = if tile.covered == u64::MAX { tile.farthest } else { f32::INFINITY };
        }
        grid
    }

    /// Draws an occluder, all of whose parts are in front of the near plane. Returns whether it
    /// covers anything.
    fn draw(&mut self, slab: &Slab, projection: &Projection) -> bool {
        let b = &slab.contour;
        let normal = b.axes.z_axis;
        let height = normal.dot(projection.eye() - b.centre);
        // From within the slab, or nearly along it, nothing is certain.
        if height.abs() <= b.half.z {
            return false;
        }
        let half = normal * b.half.z.copysign(height);
        let (front, back) = (b.centre + half, b.centre - half);
        let mut bounds = SampleBounds::default();
        for (u, v) in rectangles(slab.closed) {
            for (middle, is_front) in [(front, true), (back, false)] {
                let outline = self.outline(b, middle, [&u, &v], projection);
                self.rows.cover(outline.corners(), self.samples_per_px);
                let samples = if is_front { &mut self.front } else { &mut self.back };
                for (row, run) in self.rows.covered() {
                    if !run.is_empty() {
                        set(&mut samples[row], &run);
                        bounds.add(row, &run);
                    }
                }
            }
        }
        let depth = Plane::through(back, normal, projection, slab.farthest, self);
        self.gather(&bounds, &depth)
    }

    /// Outline of the parts `u` x `v` of the slab's face through `middle`.
    fn outline(
        &self,
        b: &OrientedBox,
        middle: DVec3,
        [u, v]: [&Range<u32>; 2],
        projection: &Projection,
    ) -> Polygon {
        let at = |part: u32| f64::from(part) / 4.0 - 1.0;
        let corners = [(u.start, v.start), (u.end, v.start), (u.end, v.end), (u.start, v.end)];
        let corners = corners.map(|(u, v)| {
            let offset = b.axes.x_axis * (b.half.x * at(u)) + b.axes.y_axis * (b.half.y * at(v));
            projection.on_picture(middle + offset)
        });
        let outline = Polygon::hull_of(corners);
        outline.clipped(DVec2::ZERO, self.size_px).unwrap_or(outline)
    }

    /// Adds the samples that front and back both cover to the tiles, and clears them.
    fn gather(&mut self, bounds: &SampleBounds, depth: &Plane) -> bool {
        let mut any = false;
        for y in bounds.rows.start / SAMPLES..bounds.rows.end.div_ceil(SAMPLES) {
            for w in bounds.words.clone() {
                let mut lines = [0u64; SAMPLES];
                for (line, row) in lines.iter_mut().zip(y * SAMPLES..) {
                    *line = self.front[row][w] & self.back[row][w];
                    (self.front[row][w], self.back[row][w]) = (0, 0);
                }
                if lines.iter().fold(0, |any, line| any | line) == 0 {
                    continue;
                }
                for i in 0..64 / SAMPLES {
                    let bytes = lines.map(|line| (line >> (i * SAMPLES)) as u8);
                    let covered = u64::from_le_bytes(bytes);
                    if covered != 0 {
                        any = true;
                        let x = w * (64 / SAMPLES) + i;
                        self.tiles[y * SIDE + x].add(covered, || depth.farthest_in(x, y));
                    }
                }
            }
        }
        any
    }
}

/// Rows and words of the samples that an occluder has set.
#[derive(Default)]
struct SampleBounds {
    rows: Range<usize>,
    words: Range<usize>,
}

impl SampleBounds {
    fn add(&mut self, row: usize, run: &Range<usize>) {
        let words = run.start / 64..(run.end - 1) / 64 + 1;
        if self.rows.is_empty() {
            (self.rows, self.words) = (row..row + 1, words);
        } else {
            self.rows = self.rows.start.min(row)..self.rows.end.max(row + 1);
            self.words = self.words.start.min(words.start)..self.words.end.max(words.end);
        }
    }
}

impl Tile {
    /// Adds samples, unless nearer nodes cover all of them.
    fn add(&mut self, covered: u64, farthest: impl Fn() -> f32) {
        if covered & !self.covered != 0 {
            self.covered |= covered;
            self.farthest = self.farthest.max(farthest());
        }
    }
}

/// Depths of a plane on the grid, where the inverse of the depth is affine.
struct Plane {
    /// Inverse depth at the grid's corner, and its slope per tile.
    inverse: f64,
    slope: DVec2,
    farthest: f64,
}

impl Plane {
    fn through(
        at: DVec3,
        normal: DVec3,
        projection: &Projection,
        farthest: f64,
        on: &Canvas,
    ) -> Self {
        // A ray of depth 1 through a pixel meets the plane at the depth height / (normal . ray).
        let height = normal.dot(at - projection.eye());
        let ray = |px: DVec2| normal.dot(projection.place(px, 1.0) - projection.eye()) / height;
        let tile = SAMPLES as f64 / on.samples_per_px;
        let inverse = ray(DVec2::ZERO);
        let slope = DVec2::new(
            ray(DVec2::new(tile.x, 0.0)) - inverse,
            ray(DVec2::new(0.0, tile.y)) - inverse,
        );
        Self { inverse, slope, farthest }
    }

    /// Greatest depth of the plane in a tile, limited to that of its slab.
    fn farthest_in(&self, x: usize, y: usize) -> f32 {
        let at = DVec2::new(x as f64, y as f64) + 0.5;
        let least = self.inverse + self.slope.dot(at) - 0.5 * self.slope.abs().element_sum();
        let depth = if least > 0.0 { (1.0 / least).min(self.farthest) } else { self.farthest };
        depth as f32
    }
}

/// Divides the set bits of an 8 x 8 mask into few rectangles (u and v).
fn rectangles(mut mask: u64) -> impl Iterator<Item = (Range<u32>, Range<u32>)> {
    std::iter::from_fn(move || {
        if mask == 0 {
            return None;
        }
        let first = mask.trailing_zeros();
        let (u, v) = (first % 8, first / 8);
        let row = (mask >> (v * 8)) as u8;
        let width = (row >> u).trailing_ones();
        let run = u64::from(((1u16 << width) - 1) as u8) << u;
        let mut end = v;
        while end < 8 && mask >> (end * 8) & run == run {
            mask &= !(run << (end * 8));
            end += 1;
        }
        Some((u..u + width, v..end))
    })
}

/// Sets a run of bits, which is not empty.
fn set(row: &mut [u64; WORDS], run: &Range<usize>) {
    let (first, last) = (run.start / 64, (run.end - 1) / 64);
    for (w, word) in row.iter_mut().enumerate().take(last + 1).skip(first) {
        let from = if w == first { u64::MAX << (run.start % 64) } else { u64::MAX };
        let to = if w == last { u64::MAX >> (63 - (run.end - 1) % 64) } else { u64::MAX };
        *word |= from & to;
    }
}
