//! Reads the cells of a sample, which are evenly spread over the points: all points that are drawn
//! in a cell at full resolution.

use crate::calls::conditions::measure::{CellPoints, QUERIES};
use anyhow::Result;
use esker_format::{Forest, PlaneKind};
use esker_points::Cell;
use esker_points::node::NONE;
use esker_points::quant::{HOT_POSITION_BYTES, exact, read_residual};
use glam::DVec3;
use std::collections::VecDeque;

/// Most cells of a sample.
const CELLS_MAX: usize = 32;
/// Most points of the nodes in a cell, unless one node has more: as many as a node has by default.
const POINTS_MAX: u64 = 1 << 16;

/// Cells of a sample: the largest ones that hold no more points than a node may, however a tree
/// divides them. Returns those that hold the points at even places in the order of the file, and
/// the number of all.
pub(super) fn choose(forest: &Forest) -> (Vec<u32>, usize) {
    let nodes = &forest.table().nodes;
    let mut totals: Vec<u64> = nodes.iter().map(|node| node.points() as u64).collect();
    // A parent comes before its children.
    for (index, node) in nodes.iter().enumerate().rev() {
        if node.parent != NONE {
            totals[node.parent as usize] += totals[index];
        }
    }
    let is_small = |index: usize| totals[index] <= POINTS_MAX;
    let is_cell = |index: usize| {
        let node = &nodes[index];
        let is_within = node.parent != NONE && is_small(node.parent as usize);
        totals[index] > 0 && !is_within && (is_small(index) || node.child_count == 0)
    };
    let all: Vec<usize> = (0..nodes.len()).filter(|index| is_cell(*index)).collect();
    let sum: u64 = all.iter().map(|index| totals[*index]).sum();
    let wanted = |k: usize| sum * (2 * k as u64 + 1) / (2 * CELLS_MAX as u64);
    let (mut chosen, mut before, mut next) = (Vec::new(), 0, 0);
    for &index in &all {
        before += totals[index];
        let first = next;
        while next < CELLS_MAX && wanted(next) < before {
            next += 1;
        }
        if next > first {
            chosen.push(index as u32);
        }
    }
    (chosen, all.len())
}

/// Reads a cell: the points of its nodes, and those of their ancestors in it. Returns the number of
/// points, too.
///
/// # Errors
/// If a node cannot be read.
pub(super) fn read(forest: &Forest, top: u32) -> Result<(CellPoints, usize)> {
    let cell = forest.record(top).cell();
    let mut positions = Vec::new();
    let mut below = VecDeque::from([top]);
    while let Some(index) = below.pop_front() {
        append(forest, index, &cell, &mut positions)?;
        below.extend(forest.record(index).children());
    }
    let mut above = forest.record(top).parent;
    while above != NONE {
        append(forest, above, &cell, &mut positions)?;
        above = forest.record(above).parent;
    }
    let count = positions.len();
    // The first points are an even sample of the cell's, from coarse to fine. Of points at one
    // place the first is kept.
    let mut ordered: Vec<(usize, [u32; 3])> = positions.into_iter().enumerate().collect();
    ordered.sort_unstable_by_key(|(at, position)| (*position, *at));
    let most = ordered.chunk_by(|(_, a), (_, b)| a == b).map(<[_]>::len).max().unwrap_or(0);
    ordered.dedup_by_key(|(_, position)| *position);
    ordered.sort_unstable_by_key(|(at, _)| *at);
    let positions: Vec<[u32; 3]> = ordered.into_iter().map(|(_, position)| position).collect();
    let scale = DVec3::from_array(forest.metric().scale);
    let place = |p: [u32; 3]| {
        let steps = [0, 1, 2].map(|i| f64::from(p[i]) - f64::from(cell.corner[i]));
        DVec3::from_array(steps) * scale
    };
    let queries = QUERIES.min(positions.len());
    let points = CellPoints {
        places: positions.iter().map(|position| place(*position)).collect(),
        by_points: (0..queries).map(|k| k * positions.len() / queries).collect(),
        by_place: (0..queries).collect(),
        inside: inside(forest, &cell, place),
        step: step(&positions, scale.to_array()),
        same_place: most as f64 / count.max(1) as f64,
        points_a_place: count as f64 / positions.len().max(1) as f64,
    };
    Ok((points, count))
}

/// Appends the positions of a node's points that are in `cell`.
fn append(forest: &Forest, index: u32, cell: &Cell, positions: &mut Vec<[u32; 3]>) -> Result<()> {
    let node = forest.record(index);
    let planes = forest.read_planes(index, &[PlaneKind::Position, PlaneKind::Residual])?;
    let hot = planes.get(PlaneKind::Position).unwrap_or_default();
    let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
    for (i, point) in hot.as_chunks::<HOT_POSITION_BYTES>().0.iter().enumerate() {
        let low = read_residual(residual, i, node.hot_shift);
        let position = [0, 1, 2].map(|axis| {
            let hot = u16::from_le_bytes([point[2 * axis], point[2 * axis + 1]]);
            exact(hot, low[axis], node.box_min[axis], node.hot_shift)
        });
        if cell.contains(position) {
            positions.push(position);
        }
    }
    Ok(())
}

/// The box of a cell; infinite at faces beyond which the file has no points.
fn inside(forest: &Forest, cell: &Cell, place: impl Fn([u32; 3]) -> DVec3) -> [DVec3; 2] {
    let (corner, last) = (cell.corner, cell.last());
    let mut inside = [place(corner), place(last)];
    if let Some([low, high]) = forest.bounds() {
        for axis in 0..3 {
            if low[axis] >= corner[axis] {
                inside[0][axis] = f64::NEG_INFINITY;
            }
            if high[axis] <= last[axis] {
                inside[1][axis] = f64::INFINITY;
            }
        }
    }
    inside
}

/// The longest of the axes' steps: of the greatest common divisor of differences of coordinates.
/// Axes along which nothing varies have none.
fn step(positions: &[[u32; 3]], scale: [f64; 3]) -> f64 {
    let first = positions.first().copied().unwrap_or_default();
    let common = |axis: usize| {
        let off = |p: &[u32; 3]| p[axis].abs_diff(first[axis]);
        positions.iter().map(off).fold(0, divisor)
    };
    (0..3).map(|axis| f64::from(common(axis)) * scale[axis]).fold(0.0, f64::max)
}

/// Greatest common divisor.
fn divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_those_that_coordinates_have() {
        let positions = [[7, 4, 9], [17, 4, 12], [47, 4, 21]];
        assert_eq!(step(&positions, [1.0, 1.0, 1.0]), 10.0);
        assert_eq!(step(&positions, [0.1, 1.0, 1.0]), 3.0);
        assert_eq!(step(&[], [1.0; 3]), 0.0);
    }
}
