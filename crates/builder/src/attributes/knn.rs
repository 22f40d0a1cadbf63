//! The k nearest neighbours of lattice points, exact within a reach. Points along the Morton curve are cut
//! into runs that share a cell of the octree; boxes of runs, eight to a box above, are the index
//! (`nearest.rs` searches it). What is found of a point depends only on the points within the reach of it.

use crate::attributes::knn_search::{Found, Search};
use esker_points::morton;
use rayon::prelude::*;
use std::ops::Range;

/// Points of a run at most: fewer make the index dear, more make each point look at more candidates.
const RUN_POINTS: usize = 24;
/// Boxes that a box above holds.
pub const FAN: usize = 8;
/// Below so many points runs are cut by one task.
const TASK_POINTS: usize = 1 << 14;
/// Runs that one task asks about.
const TASK_RUNS: usize = 256;

/// Distinct lattice points, indexed.
pub struct Neighbours {
    /// Along the Morton curve, axis by axis; less 2^31, since signed numbers become floats faster.
    points: [Vec<i32>; 3],
    runs: Vec<Range<u32>>,
    /// Boxes of the runs, of eight of these each, and so on, to at most eight.
    pub(crate) levels: Vec<Vec<Box3>>,
    /// Steps of the axes over that of the first.
    pub(crate) aspect: [f64; 3],
}

/// A box of lattice points, both corners in it.
#[derive(Clone, Copy)]
pub struct Box3 {
    pub low: [i32; 3],
    pub high: [i32; 3],
}

/// What is asked of each point.
#[derive(Clone, Copy, Debug)]
pub struct Ask {
    /// Neighbours wanted.
    pub count: usize,
    /// Where nothing can be said of these, twice as many are asked for, up to this number.
    pub count_max: usize,
    /// How far neighbours may be, in steps of the first axis.
    pub reach: f64,
}

impl Neighbours {
    /// Of points along the Morton curve, no two alike. `scale` is the length of a step on each axis.
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

    /// For every point that is `wanted`, what `tell` makes of the steps from it to its nearest neighbours, in
    /// Morton order; `none` where it has nothing to tell.
    pub fn map<T: Copy + Send + Sync>(
        &self,
        ask: &Ask,
        wanted: impl Fn(usize) -> bool + Sync,
        tell: impl Fn(&[[f64; 3]]) -> Option<T> + Sync,
        none: T,
    ) -> Vec<T> {
        self.map_placed(ask, wanted, |_, found| tell(found.steps), none)
    }

    /// The same where `tell` is given the point's place and those of its neighbours as well.
    pub fn map_placed<T: Copy + Send + Sync>(
        &self,
        ask: &Ask,
        wanted: impl Fn(usize) -> bool + Sync,
        tell: impl Fn(usize, Found<'_>) -> Option<T> + Sync,
        none: T,
    ) -> Vec<T> {
        let mut out = vec![none; self.points[0].len()];
        let mut tasks = Vec::new();
        let (mut rest, mut run) = (out.as_mut_slice(), 0);
        for runs in self.runs.chunks(TASK_RUNS) {
            let points = runs.iter().map(ExactSizeIterator::len).sum();
            let (part, after) = rest.split_at_mut(points);
            tasks.push((run..run + runs.len(), part));
            (rest, run) = (after, run + runs.len());
        }
        tasks.into_par_iter().for_each(|(runs, out)| {
            let first = self.runs[runs.start].start as usize;
            let mut search = Search::new(self, ask.reach);
            let mut open = Vec::new();
            for run in runs {
                open.clear();
                open.extend(self.run(run).filter(|&p| wanted(p)));
                let mut count = ask.count;
                while !open.is_empty() && count <= ask.count_max {
                    search.around(run, count);
                    open.retain(|&place| {
                        let found = search.nearest(place, count);
                        let told = tell(place, found);
                        if let Some(told) = told {
                            out[place - first] = told;
                        }
                        told.is_none() && found.steps.len() == count
                    });
                    count *= 2;
                }
            }
        });
        out
    }

    /// A point's coordinates, less 2^31.
    pub(crate) fn point(&self, place: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.points[i][place]))
    }

    /// Places of a run's points.
    pub(crate) fn run(&self, run: usize) -> Range<usize> {
        self.runs[run].start as usize..self.runs[run].end as usize
    }

    /// One coordinate of a run's points.
    pub(crate) fn axis(&self, axis: usize, run: usize) -> &[i32] {
        &self.points[axis][self.run(run)]
    }

    fn places(&self, run: &Range<u32>) -> [&[i32]; 3] {
        [0, 1, 2].map(|i| &self.points[i][run.start as usize..run.end as usize])
    }
}

/// Cuts points into cells of the octree with at most a run's points; `before` is the place of the first.
fn cut(points: &[[u32; 3]], before: u32) -> Vec<Range<u32>> {
    let n = points.len();
    if n <= RUN_POINTS {
        return std::iter::once(before..before + n as u32).collect();
    }
    // The first and the last differ most: their highest differing bit is that of the children's octants.
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

    fn joined(boxes: &[Self]) -> Self {
        boxes[1..].iter().fold(boxes[0], |a, b| Self {
            low: [0, 1, 2].map(|i| a.low[i].min(b.low[i])),
            high: [0, 1, 2].map(|i| a.high[i].max(b.high[i])),
        })
    }
}

/// The Morton codes of positions, each once, in order.
pub fn sorted_codes(positions: &[[u32; 3]]) -> Vec<u128> {
    let mut codes: Vec<u128> = positions.par_iter().map(|&p| morton::encode3(p)).collect();
    codes.par_sort_unstable();
    codes.dedup();
    codes
}
