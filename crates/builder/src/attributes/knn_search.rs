//! Search for nearest neighbours. The points of a run share candidates: the points of all runs near
//! theirs. A point that does not find enough neighbours among them searches the boxes alone,
//! nearest first. Neighbours at equal distance (as `f32`) are chosen in Morton order.

use crate::attributes::knn_index::{Box3, FAN, KnnIndex};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Candidates for each neighbour, beyond which every point searches alone. A stray over a dense
/// surface would otherwise collect all of it.
const CANDIDATES_EACH: usize = 64;

/// Nearest neighbours of a point, along the Morton curve.
#[derive(Clone, Copy, Debug)]
pub struct Neighbourhood<'a> {
    /// Steps from the point to them.
    pub steps: &'a [[f64; 3]],
    /// Their indices.
    pub places: &'a [u32],
}

/// The search of one task. What it keeps from run to run saves work and changes no result.
pub struct Search<'a> {
    index: &'a KnnIndex,
    reach: f64,
    /// Squares of the aspect.
    weights: [f64; 3],
    /// Distance of candidates from the box of the run; zero if there are none.
    radius: f64,
    /// Distance of the farthest neighbour: in the last run, and in this one so far.
    usual: f64,
    farthest: f64,
    /// The last point searched, and the distance of its farthest neighbour.
    last: Option<([f64; 3], f64)>,
    /// Coordinates of the candidates, axis by axis, in Morton order.
    candidates: [Vec<f64>; 3],
    /// Indices of the candidates' points.
    places: Vec<u32>,
    squares: Vec<f64>,
    /// Upper half: bits of the squared distance; lower half: index of the candidate.
    keys: Vec<u64>,
    order: Vec<u64>,
    steps: Vec<[f64; 3]>,
    found: Vec<u32>,
    open: Vec<(usize, usize)>,
    heap: BinaryHeap<Reverse<(u32, usize, usize)>>,
    greatest: BinaryHeap<u64>,
}

impl<'a> Search<'a> {
    /// Searches within `reach` steps of the first axis.
    pub fn new(index: &'a KnnIndex, reach: f64) -> Self {
        Self {
            weights: index.aspect.map(|a| a * a),
            index,
            reach,
            radius: 0.0,
            usual: 0.0,
            farthest: 0.0,
            last: None,
            candidates: Default::default(),
            places: Vec::new(),
            squares: Vec::new(),
            keys: Vec::new(),
            order: Vec::new(),
            steps: Vec::new(),
            found: Vec::new(),
            open: Vec::new(),
            heap: BinaryHeap::new(),
            greatest: BinaryHeap::new(),
        }
    }

    /// Collects candidates for the points of a run that need `count` neighbours.
    pub fn around(&mut self, run: usize, count: usize) {
        let own = self.index.levels[0][run];
        if self.farthest > 0.0 {
            self.usual = self.farthest;
        }
        (self.farthest, self.last) = (0.0, None);
        self.radius = self.guess(&own, self.index.run(run).len(), count).min(self.reach);
        let by = self.index.aspect.map(|a| (self.radius / a).ceil() as u32);
        let wide = Box3 {
            low: [0, 1, 2].map(|i| own.low[i].saturating_sub_unsigned(by[i])),
            high: [0, 1, 2].map(|i| own.high[i].saturating_add_unsigned(by[i])),
        };
        let mut n = 0;
        self.open.clear();
        self.open.push((self.index.levels.len(), 0));
        while let Some((level, i)) = self.open.pop() {
            if level > 0 {
                let below = &self.index.levels[level - 1];
                for j in (i * FAN..below.len().min(i * FAN + FAN)).rev() {
                    if wide.meets(&below[j]) {
                        self.open.push((level - 1, j));
                    }
                }
                continue;
            }
            let run = [0, 1, 2].map(|axis| self.index.axis(axis, i));
            let points = run[0].iter().zip(run[1]).zip(run[2]);
            let room = n + run[0].len();
            self.candidates.iter_mut().filter(|c| c.len() < room).for_each(|c| c.resize(room, 0.0));
            if self.places.len() < room {
                self.places.resize(room, 0);
            }
            let [xs, ys, zs] = &mut self.candidates;
            let first = self.index.run(i).start as u32;
            for (place, ((&x, &y), &z)) in (first..).zip(points) {
                (xs[n], ys[n], zs[n]) = (f64::from(x), f64::from(y), f64::from(z));
                self.places[n] = place;
                n += usize::from(wide.meets(&Box3 { low: [x, y, z], high: [x, y, z] }));
            }
            if n > count * CANDIDATES_EACH {
                self.radius = 0.0;
                break;
            }
        }
        self.candidates.iter_mut().for_each(|c| c.truncate(n));
    }

    /// Guesses the distance to search: from the density of the run if it has enough points, else
    /// from the last run.
    fn guess(&self, own: &Box3, points: usize, count: usize) -> f64 {
        let mut square = 0.0;
        for i in 0..3 {
            let side = f64::from(own.high[i]) - f64::from(own.low[i]);
            square += self.weights[i] * (side * side);
        }
        // A square with this diagonal has `points` points; the circle has `count`, and a margin.
        let dense = (square * count as f64 / points as f64 / 2.0).sqrt();
        if points >= 8 || self.usual == 0.0 { dense.max(1.0) } else { self.usual * 1.2 }
    }

    /// Returns the `count` nearest neighbours of a point of the run, or all within the reach if
    /// there are fewer.
    pub fn nearest(&mut self, place: usize, count: usize) -> Neighbourhood<'_> {
        let p = self.index.point(place);
        if self.radius == 0.0 || !self.among_candidates(p, count) {
            self.alone(p, count);
        }
        let far = self.steps.iter().map(|s| self.square(*s)).fold(0.0, f64::max).sqrt();
        self.farthest = self.farthest.max(far);
        self.last = (self.steps.len() == count).then_some((p, far));
        Neighbourhood { steps: &self.steps, places: &self.found }
    }

    fn square(&self, step: [f64; 3]) -> f64 {
        let [x, y, z] = step;
        self.weights[0] * (x * x) + self.weights[1] * (y * y) + self.weights[2] * (z * z)
    }

    /// Searches the candidates; returns false if there are too few to be certain.
    fn among_candidates(&mut self, p: [f64; 3], count: usize) -> bool {
        // Neighbours of the last point are neighbours of this one too, a little farther away.
        let near = self.last.map_or(f64::INFINITY, |(q, far)| {
            let between = self.square([q[0] - p[0], q[1] - p[1], q[2] - p[2]]);
            (far + between.sqrt()) * (1.0 + 1e-6)
        });
        let bound = (near * near).min(self.radius * self.radius);
        let [wx, wy, wz] = self.weights;
        let [xs, ys, zs] = &self.candidates;
        self.squares.clear();
        self.squares.extend(xs.iter().zip(ys).zip(zs).map(|((x, y), z)| {
            let (x, y, z) = (x - p[0], y - p[1], z - p[2]);
            wx * (x * x) + wy * (y * y) + wz * (z * z)
        }));
        self.keys.clear();
        self.keys.resize(self.squares.len() + 1, 0);
        let mut n = 0;
        for (c, &square) in self.squares.iter().enumerate() {
            self.keys[n] = u64::from((square as f32).to_bits()) << 32 | c as u64;
            n += usize::from((square <= bound) & (square > 0.0));
        }
        self.keys.truncate(n);
        if n < count {
            return false;
        }
        self.order.clear();
        self.order.extend_from_slice(&self.keys);
        let last = *self.order.select_nth_unstable(count - 1).1;
        self.steps.clear();
        self.found.clear();
        for &key in self.keys.iter().filter(|&&key| key <= last) {
            let c = key as u32 as usize;
            self.found.push(self.places[c]);
            self.steps.push([xs[c] - p[0], ys[c] - p[1], zs[c] - p[2]]);
        }
        true
    }

    /// Searches the boxes, nearest first, until none can hold a nearer point than those found.
    fn alone(&mut self, p: [f64; 3], count: usize) {
        let bits = |square: f64| (square as f32).to_bits();
        let bound = bits(self.reach * self.reach);
        self.greatest.clear();
        self.heap.clear();
        self.heap.push(Reverse((0, self.index.levels.len(), 0)));
        while let Some(Reverse((square, level, i))) = self.heap.pop() {
            let full = self.greatest.len() == count;
            let farthest = self.greatest.peek().map_or(0, |&key| (key >> 32) as u32);
            if square > bound || full && square > farthest {
                break;
            }
            if level > 0 {
                let below = &self.index.levels[level - 1];
                for (j, of_child) in below.iter().enumerate().skip(i * FAN).take(FAN) {
                    let square = bits(self.square(of_child.from(p)));
                    self.heap.push(Reverse((square, level - 1, j)));
                }
                continue;
            }
            for place in self.index.run(i) {
                let q = self.index.point(place);
                let square = bits(self.square([q[0] - p[0], q[1] - p[1], q[2] - p[2]]));
                if square > 0 && square <= bound {
                    self.greatest.push(u64::from(square) << 32 | place as u64);
                    if self.greatest.len() > count {
                        self.greatest.pop();
                    }
                }
            }
        }
        self.order.clear();
        self.order.extend(self.greatest.iter().map(|&key| u64::from(key as u32)));
        self.order.sort_unstable();
        self.steps.clear();
        self.found.clear();
        for &place in &self.order {
            self.found.push(place as u32);
            let q = self.index.point(place as usize);
            self.steps.push([q[0] - p[0], q[1] - p[1], q[2] - p[2]]);
        }
    }
}
