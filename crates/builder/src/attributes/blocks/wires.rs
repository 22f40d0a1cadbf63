//! Tells parallel wires from surfaces that are scanned line by line. Both are lines of points that
//! lie in a plane; a surface has many of them, wires are few. Cells whose points lie on a line are
//! noted while planes are fitted. Afterwards the lines beside each are counted, across it and
//! within the plane that was found; where they are few, the points get no normal.

use crate::attributes::blocks::cloud::{Blocks, Cloud, OPEN, SIGN};
use crate::attributes::blocks::plane::{Moments, add, is_line};
use crate::attributes::normals::{UNKNOWN, WIRE};
use esker_points::{morton, quant};
use rayon::prelude::*;
use std::ops::Range;

/// The middle cell of a block.
const MIDDLE: usize = 13;
/// Cells around the middle one from which a block is closed: three lines fill fewer.
const CLOSED: u32 = 11;
/// For each cell of a block, by bits, those after it that are about opposite of it.
const OPPOSITE: [u32; 27] = opposite();
/// Points on a line, at least.
const LEAST: f64 = 5.0;
/// Distance of lines over that of their points, at least: with less, they are a surface.
const APART: f64 = 3.0;
/// Distance from a line up to which points are on it, in distances of its points.
const ON_LINE: f64 = 0.5;
/// Cosine of the angle between the cells before and after a cell that may be on a line.
const STRAIGHT: f64 = -0.98;
/// Half of the length of a line along which points are counted, in distances of its points.
const WINDOW: f64 = 8.0;
/// Distance to which lines are counted, in distances of lines: the line at the border of a surface
/// has three beside it, as many as there are wires.
const COUNTED: f64 = 3.5;
/// The same at least: within less, a surface has no more lines than there are wires.
const COUNTED_MIN: f64 = 2.0;
/// Lines up to which they are wires, with a half for unevenness.
const WIRES_MAX: f64 = 3.5;
/// Distance from the plane up to which points count, over that across it: wires sag, and surfaces
/// are curved.
const THICK: f64 = 0.25;

/// Distance to which lines are counted first, in edges of the cells of a suspect.
const FIRST: f64 = 4.0;
/// Half of the longest side of the box around a window, over its greatest distance across a line.
const BOX: f64 = 1.5;
/// Points beside a line from which they are a surface: six times those of a line.
const MANY: usize = 100;
/// Square of the sine of the angle between a line and the normal of a plane through it, at least.
const ACROSS2: f64 = 0.5;

/// A line of points.
#[derive(Clone, Debug)]
pub struct Line {
    /// A place on it within the cell, in steps from the middle of the lattice.
    through: [f64; 3],
    /// Its direction, of length one, in metres.
    along: [f64; 3],
    /// Distance of its points, metres.
    gap: f64,
    /// Distance to the nearest other line, metres, if it is known.
    apart: Option<f64>,
}

/// Points of a cell that are on a line.
pub struct Suspect {
    pub points: Range<u32>,
    pub line: Line,
    /// Level of the cell.
    pub level: u32,
}

impl Line {
    /// The line through the middle cell of a block and two of the cells around it; `None` if its
    /// points are on none, or others are close to it. `origin` of the moments is in steps from the
    /// middle of the lattice.
    pub fn of(cells: &[&Moments; 27], origin: [f64; 3], scale: [f64; 3]) -> Option<Self> {
        let occupied: u32 = (0..27).map(|i| u32::from(i != MIDDLE && cells[i][0] > 0.0) << i).sum();
        if occupied.count_ones() >= CLOSED {
            return None;
        }
        let pairs = |i: usize| bits(occupied & OPPOSITE[i]).map(move |j| (i, j));
        let mean = |i: usize| [0, 1, 2].map(|k| cells[i][k + 1] / cells[i][0] * scale[k]);
        let middle = mean(MIDDLE);
        let mut best: Option<(Moments, [f64; 3])> = None;
        for (i, j) in bits(occupied).flat_map(pairs) {
            let sums: Moments =
                std::array::from_fn(|k| cells[MIDDLE][k] + cells[i][k] + cells[j][k]);
            if sums[0] < LEAST || best.as_ref().is_some_and(|(most, _)| sums[0] <= most[0]) {
                continue;
            }
            let [before, after] = [i, j].map(|i| minus(mean(i), middle));
            let (cosine, squares) = (dot(before, after), dot(before, before) * dot(after, after));
            if cosine < 0.0
                && cosine * cosine >= STRAIGHT * STRAIGHT * squares
                && is_line(&sums, scale)
            {
                best = Some((sums, minus(after, before)));
            }
        }
        let (sums, along) = best?;
        let line = Self::along(&sums, along, middle_of(cells, origin), scale)?;
        let [on_line, least] = [ON_LINE, APART].map(|gaps| (gaps * line.gap).powi(2));
        let mut apart = f64::INFINITY;
        for i in bits(occupied) {
            let to = minus(mean(i), middle);
            let across = dot(to, to) - dot(to, line.along).powi(2);
            if across > on_line {
                apart = apart.min(across);
            }
        }
        let apart = (apart < f64::INFINITY).then_some(apart.sqrt());
        (apart.is_none_or(|apart| apart * apart >= least)).then_some(Self { apart, ..line })
    }

    /// The line of all points of a block that spread along one.
    pub fn of_all(cells: &[&Moments; 27], origin: [f64; 3], scale: [f64; 3]) -> Option<Self> {
        let mut sums = [0.0; 10];
        cells.iter().for_each(|cell| add(&mut sums, cell));
        // The row of the covariance of the axis along which points vary most.
        let axis = (0..3).max_by(|&a, &b| {
            let variance = |i: usize| {
                (sums[0] * sums[4 + i] - sums[1 + i] * sums[1 + i]) * scale[i] * scale[i]
            };
            variance(a).total_cmp(&variance(b))
        })?;
        let product = |i: usize, j: usize| match (i.min(j), i.max(j)) {
            (i, j) if i == j => sums[4 + i],
            (0, 1) => sums[7],
            (0, _) => sums[8],
            _ => sums[9],
        };
        let row = [0, 1, 2].map(|i| {
            (sums[0] * product(axis, i) - sums[1 + axis] * sums[1 + i]) * scale[axis] * scale[i]
        });
        Self::along(&sums, row, middle_of(cells, origin), scale)
    }

    /// The line of points in a direction of any length.
    fn along(sums: &Moments, along: [f64; 3], through: [f64; 3], scale: [f64; 3]) -> Option<Self> {
        let along = unit(along)?;
        let [n, x, y, z, xx, yy, zz, xy, xz, yz] = *sums;
        let [a, b, c] = [0, 1, 2].map(|i| along[i] * scale[i]);
        let squares = a * a * xx + b * b * yy + c * c * zz;
        let products = a * b * xy + a * c * xz + b * c * yz;
        let mean = (a * x + b * y + c * z) / n;
        let variance = (squares + 2.0 * products) / n - mean * mean;
        // Variance of points at equal distances.
        let gap = (12.0 * variance / (n * n - 1.0)).sqrt();
        (gap > 0.0 && gap.is_finite()).then_some(Self { through, along, gap, apart: None })
    }
}

/// Mean of the points of the middle cell of a block, in steps from the middle of the lattice.
fn middle_of(cells: &[&Moments; 27], origin: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| cells[MIDDLE][i + 1] / cells[MIDDLE][0] + origin[i])
}

/// Sets the codes of suspects that are wires: those beside few others, and those that are on no
/// plane. `codes` are those of the points of `cloud`.
pub fn settle(cloud: &Cloud<'_>, suspects: &[Suspect], codes: &mut [[i16; 2]]) {
    /// Suspects of a task.
    const TASK: usize = 1 << 10;
    let known = &*codes;
    let wires = |some: &[Suspect]| {
        let mut near = Near::new(cloud);
        let mut is_wire = |suspect: &&Suspect| {
            let places = suspect.points.start as usize..suspect.points.end as usize;
            let code = known[places].iter().find(|code| **code != OPEN && **code != UNKNOWN);
            code.is_none_or(|&code| near.is_wire(suspect, quant::oct_decode(code)))
        };
        let found = some.iter().filter(|suspect| is_wire(suspect));
        found.map(|suspect| suspect.points.clone()).collect::<Vec<_>>()
    };
    let wires: Vec<Vec<Range<u32>>> = suspects.par_chunks(TASK).map(wires).collect();
    for points in wires.into_iter().flatten() {
        codes[points.start as usize..points.end as usize].fill(WIRE);
    }
}

/// Cells of a level around a place.
#[derive(Clone, Default)]
struct Cells {
    /// The middle one.
    middle: Option<[u32; 3]>,
    /// Points of the middle cell, then of those around it.
    cells: Vec<Range<usize>>,
}

/// Points near a suspect, by cells. Suspects along the curve share them.
struct Near<'a> {
    cloud: &'a Cloud<'a>,
    /// Cells of each level.
    near: Vec<Cells>,
    /// Distances across a line.
    across: Vec<f64>,
}

impl<'a> Near<'a> {
    fn new(cloud: &'a Cloud<'a>) -> Self {
        let levels = cloud.blocks.reach as usize + 1;
        Self { cloud, near: vec![Cells::default(); levels], across: Vec::new() }
    }

    /// Whether the lines of points beside a suspect are too few for the surface with this normal.
    fn is_wire(&mut self, suspect: &Suspect, normal: [f32; 3]) -> bool {
        let line = &suspect.line;
        let across = cross(normal.map(f64::from), line.along);
        let across = Some(across).filter(|across| dot(*across, *across) > ACROSS2).and_then(unit);
        // A plane that the line pierces is not that of its points.
        let Some(across) = across else { return true };
        let axes = [line.along, across, cross(line.along, across)];
        let edge = |level: u32| edge(self.cloud.blocks, level);
        let reach = edge(self.cloud.blocks.reach);
        let first = line.apart.map_or(edge(suspect.level) * FIRST, |apart| apart * COUNTED);
        let mut far = first.min(reach);
        loop {
            self.count(line, axes, [far, reach]);
            if self.across.len() >= MANY {
                return false;
            }
            let other = self.across.iter().copied().filter(|c| *c > APART * line.gap);
            let apart = other.fold(f64::INFINITY, f64::min);
            if far >= COUNTED * apart || far == reach {
                let within = |far: f64| self.across.iter().filter(|c| **c <= far).count() as f64;
                let lines = within(COUNTED * apart) / within(ON_LINE * apart);
                return far >= COUNTED_MIN * apart && lines <= WIRES_MAX;
            }
            far = if apart.is_finite() { apart * COUNTED } else { far * 2.0 }.min(reach);
        }
    }

    /// Finds the points beside a part of a line, up to the distance `far` across it and `reach` on
    /// each axis of the lattice; not many more than [`MANY`]. `axes` lie along the line, across it
    /// in the plane, and across the plane.
    fn count(&mut self, line: &Line, axes: [[f64; 3]; 3], [far, reach]: [f64; 2]) {
        self.across.clear();
        let blocks = self.cloud.blocks;
        // The box around the window fits into the cells around the middle one.
        let level = (0..blocks.reach).find(|&level| edge(blocks, level) >= BOX * far);
        let level = level.unwrap_or(blocks.reach);
        self.go_to(line.through, level);
        let window = Window {
            through: line.through,
            scale: self.cloud.blocks.scale,
            axes,
            most: [(WINDOW * line.gap).min(far), far, THICK * far],
            reach,
        };
        let near = self.near.get(level as usize);
        for cell in near.into_iter().flat_map(|near| &near.cells) {
            if !window.collect(self.cloud, cell.clone(), level, &mut self.across) {
                return;
            }
        }
    }

    /// Finds the cells of a level around a position in steps.
    fn go_to(&mut self, at: [f64; 3], level: u32) {
        let Cloud { points, blocks } = *self.cloud;
        let Some(near) = self.near.get_mut(level as usize) else { return };
        let at = at.map(|c| (c + SIGN).clamp(0.0, f64::from(u32::MAX)) as u32);
        let middle = blocks.cell_at(at, level);
        if near.middle == Some(middle) {
            return;
        }
        near.middle = Some(middle);
        near.cells.clear();
        // The middle one first, where most points of the line are.
        for around in (13..27).chain(0..13) {
            let by = [around % 3, around / 3 % 3, around / 9].map(|c: i32| c - 1);
            let moved = |i: usize| middle[i].checked_add_signed(by[i]);
            let (Some(x), Some(y), Some(z)) = (moved(0), moved(1), moved(2)) else { continue };
            let code = morton::encode3([x, y, z]);
            let code_of = |p: &[u32; 3]| morton::encode3(blocks.cell_at(*p, level));
            let start = points.partition_point(|p| code_of(p) < code);
            let end = start + points[start..].partition_point(|p| code_of(p) == code);
            if start < end {
                near.cells.push(start..end);
            }
        }
    }
}

/// A box along a line.
struct Window {
    /// Its middle, in steps from the middle of the lattice.
    through: [f64; 3],
    scale: [f64; 3],
    /// Its axes, and half of its lengths along them, in metres.
    axes: [[f64; 3]; 3],
    most: [f64; 3],
    /// Greatest distance from the middle on each axis of the lattice, metres.
    reach: f64,
}

impl Window {
    /// Adds the distances along the second axis of the points in a cell of a level; returns whether
    /// there are few yet.
    fn collect(
        &self,
        cloud: &Cloud<'_>,
        cell: Range<usize>,
        level: u32,
        across: &mut Vec<f64>,
    ) -> bool {
        /// Points of a cell that are not divided.
        const FEW: usize = 8;
        let metres = |steps: [f64; 3]| [0, 1, 2].map(|i| steps[i] * self.scale[i]);
        if cell.len() <= FEW || level == 0 {
            for &p in &cloud.points[cell] {
                let at = p.map(|c| f64::from((c ^ 1 << 31).cast_signed()));
                let to = metres(minus(at, self.through));
                // Most points are off the part of the line.
                let is_within = |i: usize| dot(self.axes[i], to).abs() <= self.most[i];
                if (0..3).all(is_within) && to.iter().all(|c| c.abs() <= self.reach) {
                    across.push(dot(self.axes[1], to).abs());
                }
            }
            return across.len() < MANY;
        }
        let blocks = cloud.blocks;
        let place = blocks.cell_at(cloud.points[cell.start], level);
        let edge = blocks.shift.map(|shift| f64::from(1u32 << (level + shift)));
        let middle = [0, 1, 2].map(|i| (f64::from(place[i]) + 0.5) * edge[i] - SIGN);
        let (to, half) = (metres(minus(middle, self.through)), metres(edge.map(|c| c / 2.0)));
        let is_beyond = |i: usize| {
            let reach: f64 = (0..3).map(|k| self.axes[i][k].abs() * half[k]).sum();
            dot(self.axes[i], to).abs() > self.most[i] + reach
        };
        if (0..3).any(is_beyond) {
            return true;
        }
        let mut start = cell.start;
        while start < cell.end {
            let part = blocks.cell_at(cloud.points[start], level - 1);
            let rest = &cloud.points[start..cell.end];
            let end = start + rest.partition_point(|&p| blocks.cell_at(p, level - 1) == part);
            if !self.collect(cloud, start..end, level - 1, across) {
                return false;
            }
            start = end;
        }
        true
    }
}

/// Edge of the cells of a level, on the axis on which it is least, in metres.
fn edge(blocks: &Blocks, level: u32) -> f64 {
    let steps = blocks.shift.map(|shift| f64::from(1u32 << (level + shift)));
    (0..3).map(|i| steps[i] * blocks.scale[i]).fold(f64::INFINITY, f64::min)
}

/// Cells whose directions from the middle one differ by 135 degrees or more.
const fn opposite() -> [u32; 27] {
    let mut table = [0; 27];
    let mut pair = 0;
    while pair < 27 * 27 {
        let (i, j) = (pair / 27, pair % 27);
        let (mut product, mut squares, mut axis, mut edge) = (0, [0, 0], 0, 1);
        while axis < 3 {
            let (a, b) = ((i / edge % 3) as i32 - 1, (j / edge % 3) as i32 - 1);
            product += a * b;
            squares = [squares[0] + a * a, squares[1] + b * b];
            (axis, edge) = (axis + 1, edge * 3);
        }
        if i < j && product < 0 && 2 * product * product >= squares[0] * squares[1] {
            table[i] |= 1 << j;
        }
        pair += 1;
    }
    table
}

/// The places of the bits that are set.
fn bits(mut mask: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = mask.trailing_zeros();
        mask &= mask.wrapping_sub(1);
        (place < 32).then_some(place as usize)
    })
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The direction with length one; `None` without length.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(v, v).sqrt();
    (length > 0.0 && length.is_finite()).then(|| v.map(|c| c / length))
}
