//! How far points are from each other over borders of cells, where densities of cells tell too little.
//!
//! The fringe are points in cells that end where a cell above has taken all of theirs. No finer node tells how densely they
//! stand, so they would be drawn as wide as the sample above is coarse: balls on the tops of trees that reach over a border of
//! cells. And few points of a sample that lie behind such a border seem to stand alone there.

use crate::candidates::Candidates;
use crate::rest::NONE;
use crate::tiles::{Cells, Filling, TILE_LOG2, between};
use std::f64::consts::PI;
use std::ops::Range;

/// The distance to so many neighbours tells of a place. On a wire they reach twice as far as its points stand apart.
const NEIGHBOURS: f32 = 4.0;
/// Radii of a sample are looked at again where they are so many times its spacing.
const WIDE_SPACINGS: f64 = 2.0;
/// Points around which so few cells, of all 27, have any may be on a wire: how many these are tells nothing of distances.
const LINE_CELLS: usize = 4;

/// What a cell offers to the one above.
#[derive(Clone, Copy, Debug)]
pub struct Offer {
    /// Whether it ends.
    pub ends: bool,
    /// How many of its points each that it offers stands for.
    pub weight: f32,
}

/// For each point that is offered, the share that the typical distance of the points around it has of `spacing`, in the
/// file's unit, where its cell ends; else, and at most, 1. `from` tells which of `offers` each is among.
pub fn shares(candidates: &Candidates, from: &[u8], offers: &[Offer], spacing: f64) -> Vec<f32> {
    let from = candidates.along_curve(from);
    let offer = |i: usize| offers[usize::from(from[i])];
    let spacing = spacing / candidates.step;
    let near = Near::new(&candidates.q, spacing);
    let share = |i| {
        let (mut cells, mut points, mut nearest) = (0, 0.0, Nearest::default());
        near.each_run(i, |run| {
            let weight = offer(run.start).weight;
            (cells, points) = (cells + 1, points + run.len() as f32 * weight);
            run.filter(|&j| j != i).for_each(|j| nearest.add(near.away2(i, j), weight));
        });
        // As evenly as on surfaces through the cells that have any.
        let each =
            if cells > LINE_CELLS { cells as f64 / f64::from(points) } else { f64::INFINITY };
        let typical = each.sqrt() * near.edge();
        (typical.min(nearest.distance()) / spacing).min(1.0) as f32
    };
    let shares = (0..candidates.len()).map(|i| if offer(i).ends { share(i) } else { 1.0 });
    candidates.as_offered(shares.collect())
}

/// Where the radii of a sample's points, which follow from the densities of cells, are wide beside its spacing, they reach no
/// farther than the typical distance of the points around them, over borders of cells too. All is in steps; `q` tells where the
/// points stand, along the curve.
pub fn narrow(radii: &mut [f32], q: impl FnOnce() -> Vec<[i32; 3]>, spacing: f64) {
    let is_wide = |radius: f32| f64::from(radius) > spacing * WIDE_SPACINGS;
    if !radii.iter().any(|&radius| is_wide(radius)) {
        return;
    }
    let q = q();
    let near = Near::new(&q, spacing * WIDE_SPACINGS);
    for (i, radius) in radii.iter_mut().enumerate().filter(|(_, radius)| is_wide(**radius)) {
        let mut nearest = Nearest::default();
        near.each_run(i, |run| {
            run.filter(|&j| j != i).for_each(|j| nearest.add(near.away2(i, j), 1.0));
        });
        *radius = radius.min(nearest.distance() as f32);
    }
}

/// Points by cells as large as they look far, at least.
struct Near<'a> {
    /// In steps, along the curve.
    q: &'a [[i32; 3]],
    /// Log2 of the edge of cells, in steps.
    log2: u32,
    cells: Cells,
}

impl<'a> Near<'a> {
    fn new(q: &'a [[i32; 3]], far: f64) -> Self {
        let log2 = far.log2().ceil().clamp(0.0, 30.0) as u32;
        let mut cells = Cells::default();
        let mut filling = Filling::new(&mut cells, log2);
        for (i, &p) in q.iter().enumerate() {
            filling.tile(p, i);
        }
        cells.close(q.len());
        Self { q, log2, cells }
    }

    /// The edge of a cell, in steps.
    fn edge(&self) -> f64 {
        f64::from(1u32 << self.log2)
    }

    /// The points of each cell that has any, of that of a point and the 26 around it.
    fn each_run(&self, i: usize, mut f: impl FnMut(Range<usize>)) {
        let cell = self.q[i].map(|c| c >> self.log2);
        let (low, high) = (cell.map(|c| c - 1), cell.map(|c| c + 1));
        let tiles = |axis: usize| low[axis] >> TILE_LOG2..=high[axis] >> TILE_LOG2;
        for z in tiles(2) {
            for (x, y) in tiles(1).flat_map(|y| tiles(0).map(move |x| (x, y))) {
                let tile = self.cells.find([x, y, z]);
                if tile == NONE {
                    continue;
                }
                let tile = self.cells.tiles[tile as usize];
                // Of a tile between others, all cells.
                let corner = [x, y, z].map(|c| c << TILE_LOG2);
                let from = [0, 1, 2].map(|axis| low[axis].max(corner[axis]));
                let to = [0, 1, 2].map(|axis| high[axis].min(corner[axis] | 3));
                let mut wanted = tile.occupied & between([from, to]);
                while wanted != 0 {
                    let before = tile.occupied & ((1 << wanted.trailing_zeros()) - 1);
                    let at = (tile.first + before.count_ones()) as usize;
                    f(self.cells.first[at] as usize..self.cells.first[at + 1] as usize);
                    wanted &= wanted - 1;
                }
            }
        }
    }

    /// Square of the distance of two points, in steps.
    fn away2(&self, i: usize, j: usize) -> f64 {
        let away = |axis| f64::from(self.q[i][axis]) - f64::from(self.q[j][axis]);
        (0..3).map(|axis| away(axis) * away(axis)).sum()
    }
}

/// The nearest points to a place, as many as suffice where each stands for one: squares of their distances, ascending, and
/// how many each stands for.
struct Nearest([(f64, f32); NEIGHBOURS as usize]);

impl Default for Nearest {
    fn default() -> Self {
        Self([(f64::INFINITY, 0.0); NEIGHBOURS as usize])
    }
}

impl Nearest {
    fn add(&mut self, away2: f64, weight: f32) {
        let Self([.., last]) = self;
        if away2 < last.0 {
            let place = self.0.partition_point(|other| other.0 <= away2);
            self.0[place..].rotate_right(1);
            self.0[place] = (away2, weight);
        }
    }

    /// The typical distance there: as on a surface, where each has its part of the disc that reaches [`NEIGHBOURS`]. Infinite
    /// where there are not so many.
    fn distance(&self) -> f64 {
        let mut sum = 0.0;
        let enough = self.0.iter().find(|(_, weight)| {
            sum += weight;
            sum >= NEIGHBOURS
        });
        enough.map_or(f64::INFINITY, |(away2, _)| (away2 * PI / f64::from(NEIGHBOURS)).sqrt())
    }
}
