//! Index for the search of nearest neighbours. Points along the Morton curve are cut into runs that
//! share a cell of the octree; a hierarchy of bounding boxes, eight to a box, leads to the runs.

use rayon::prelude::*;
use std::ops::Range;

/// Largest number of points of a run. Fewer make the index larger; more make each point test more
/// candidates.
const RUN_POINTS: usize = 24;
/// Boxes in the box above them.
pub const FAN: usize = 8;
/// Number of points below which one task cuts all runs.
const TASK_POINTS: usize = 1 << 14;

/// Index of distinct lattice points.
pub struct KnnIndex {
    /// Coordinates along the Morton curve, axis by axis, less 2^31, since signed integers are
    /// converted to floats faster.
    pub(crate) points: [Vec<i32>; 3],
    pub(crate) runs: Vec<Range<u32>>,
    /// Boxes of the runs, then of eight of these each, and so on, up to a level of at most eight.
    pub(crate) levels: Vec<Vec<Box3>>,
    /// Length of a step on each axis over that on the first.
    pub(crate) aspect: [f64; 3],
}

/// Box of lattice points, both corners included.
#[derive(Clone, Copy)]
pub struct Box3 {
    pub low: [i32; 3],
    pub high: [i32; 3],
}

impl KnnIndex {
    /// Builds the index of distinct points along the Morton curve. `scale` is the length of a step
    /// on each axis.
    pub fn new(points: &[[u32; 3]], scale: [f64; 3]) -> Self {
        let mut runs = Vec::new();
        if !points.is_empty() {
            runs = cut(points, 0);
        }
        let axis = |i: usize| points.par_iter().map(|p| (p[i] ^ 1 << 31) as i32).collect();
        let mut index = Self {
            points: [axis(0), axis(1), axis(2)],
            levels: Vec::new(),
            runs,
            aspect: scale.map(|s| s / scale[0]),
        };
        let mut level: Vec<Box3> =
            index.runs.par_iter().map(|r| Box3::around(index.places(r))).collect();
        while level.len() > FAN {
            let above = level.par_chunks(FAN).map(Box3::joined).collect();
            index.levels.push(std::mem::replace(&mut level, above));
        }
        index.levels.push(level);
        index
    }

    /// Coordinates of a point, less 2^31.
    pub(crate) fn point(&self, place: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.points[i][place]))
    }

    /// Indices of the points of a run.
    pub(crate) fn run(&self, run: usize) -> Range<usize> {
        self.runs[run].start as usize..self.runs[run].end as usize
    }

    /// One coordinate of the points of a run.
    pub(crate) fn axis(&self, axis: usize, run: usize) -> &[i32] {
        &self.points[axis][self.run(run)]
    }

    fn places(&self, run: &Range<u32>) -> [&[i32]; 3] {
        [0, 1, 2].map(|i| &self.points[i][run.start as usize..run.end as usize])
    }
}

/// Cuts points into cells of the octree with at most [`RUN_POINTS`] points; `before` is the index
/// of the first point.
fn cut(points: &[[u32; 3]], before: u32) -> Vec<Range<u32>> {
    let n = points.len();
    if n <= RUN_POINTS {
        return std::iter::once(before..before + n as u32).collect();
    }
    // The first and the last point differ most: their highest differing bit separates the octants.
    let (first, last) = (points[0], points[n - 1]);
    let bit = (0..3).fold(0, |all, i| all | (first[i] ^ last[i])).ilog2();
    let octant = |p: &[u32; 3]| p[0] >> bit & 1 | (p[1] >> bit & 1) << 1 | (p[2] >> bit & 1) << 2;
    let mut parts = Vec::with_capacity(8);
    let mut start = 0;
    for o in 0..8 {
        let end = start + points[start..].partition_point(|p| octant(p) <= o);
        if end > start {
            parts.push(start..end);
        }
        start = end;
    }
    let below = |part: Range<usize>| cut(&points[part.clone()], before + part.start as u32);
    if n > TASK_POINTS {
        parts.into_par_iter().map(below).collect::<Vec<_>>().concat()
    } else {
        parts.into_iter().flat_map(below).collect()
    }
}

impl Box3 {
    fn around(axes: [&[i32]; 3]) -> Self {
        let least = |axis: &[i32]| axis.iter().copied().min().unwrap_or_default();
        let greatest = |axis: &[i32]| axis.iter().copied().max().unwrap_or_default();
        Self { low: axes.map(least), high: axes.map(greatest) }
    }

    pub(crate) fn joined(boxes: &[Self]) -> Self {
        boxes[1..].iter().fold(boxes[0], |a, b| Self {
            low: [0, 1, 2].map(|i| a.low[i].min(b.low[i])),
            high: [0, 1, 2].map(|i| a.high[i].max(b.high[i])),
        })
    }

    pub(crate) fn meets(&self, other: &Self) -> bool {
        (0..3).fold(true, |all, i| {
            all & (self.low[i] <= other.high[i]) & (other.low[i] <= self.high[i])
        })
    }

    /// Distance along each axis from a point to the box.
    pub(crate) fn from(&self, p: [f64; 3]) -> [f64; 3] {
        [0, 1, 2]
            .map(|i| (f64::from(self.low[i]) - p[i]).max(p[i] - f64::from(self.high[i])).max(0.0))
    }
}
