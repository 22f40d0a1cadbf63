//! Bounding boxes of consecutive positions along the Morton curve: eight positions to a box, eight
//! boxes to the box above them. They lead to the positions near another one, so that a search does
//! not go through all positions of a crowded cell.

use crate::attributes::knn_index::{Box3, FAN};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// Log2 of [`FAN`].
const FAN_LOG2: u32 = FAN.ilog2();
/// Ranges with no more positions are searched without boxes.
const FEW: usize = 2 * FAN;

/// Consecutive positions to search.
#[derive(Clone, Debug)]
pub struct Run {
    /// The positions.
    pub places: Range<usize>,
    /// Square of a distance to which none of them is nearer.
    pub away2: f64,
}

/// Runs and boxes that a search has not opened yet, the nearest first; kept to save allocations.
#[derive(Default)]
pub struct Unopened(BinaryHeap<Reverse<(u64, usize, usize, usize)>>);

/// Level that stands for a whole run.
const ALL: usize = usize::MAX;

/// Boxes of distinct positions along the curve.
pub struct Boxes {
    /// Boxes of eight positions each, then of eight of these, and so on, up to a level of at most
    /// eight. Empty if no range has more than [`FEW`] positions.
    levels: Vec<Vec<Box3>>,
}

/// Vector from a position to another one, in steps.
pub fn offset(from: [i32; 3], to: [i32; 3]) -> [f64; 3] {
    [0, 1, 2].map(|axis| f64::from(to[axis]) - f64::from(from[axis]))
}

/// Square of the length of a vector. It does not become less when a component grows, so the nearest
/// corner of a box is, also after rounding, no farther than any position in the box.
pub fn length2(offset: &[f64; 3]) -> f64 {
    offset.iter().map(|along| along * along).sum()
}

impl Boxes {
    /// Makes the boxes of positions along the curve; `crowd` is the size of the largest range that
    /// is searched.
    pub fn of(q: &[[i32; 3]], crowd: usize) -> Self {
        let mut levels = Vec::new();
        if crowd > FEW {
            let boxed = |q: &[i32; 3]| Box3 { low: *q, high: *q };
            let of_eight = |q: &[[i32; 3]]| {
                let mut boxes = [boxed(&q[0]); FAN];
                boxes.iter_mut().zip(q).for_each(|(of, q)| *of = boxed(q));
                Box3::joined(&boxes)
            };
            let mut level: Vec<Box3> = q.chunks(FAN).map(of_eight).collect();
            while level.len() > FAN {
                let above = level.chunks(FAN).map(Box3::joined).collect();
                levels.push(std::mem::replace(&mut level, above));
            }
            levels.push(level);
        }
        Self { levels }
    }

    /// Calls `add` with the positions of `runs` that are nearest to `p`, and perhaps others. It
    /// gets the index of the run, that of the position and its squared distance by `metric`, a
    /// function like [`length2`], and returns the squared distance beyond which positions do not
    /// matter from then on; initially that is `limit2`. Boxes are opened nearest first, whatever
    /// their run.
    pub fn nearest(
        &self,
        (q, runs): (&[[i32; 3]], &[Run]),
        (p, metric, mut limit2): ([i32; 3], impl Fn(&[f64; 3]) -> f64, f64),
        unopened: &mut Unopened,
        mut add: impl FnMut(usize, usize, f64) -> f64,
    ) {
        let at = p.map(f64::from);
        unopened.0.clear();
        let whole = |(run, of): (usize, &Run)| Reverse((of.away2.to_bits(), run, ALL, 0));
        unopened.0.extend(runs.iter().enumerate().map(whole));
        while let Some(Reverse((away2, run, level, i))) = unopened.0.pop() {
            if f64::from_bits(away2) > limit2 {
                break;
            }
            let range = &runs[run].places;
            let (below, inside) = if level == ALL {
                let start = self.start(range);
                (start, start.map_or(range.clone(), |level| blocks(range, level)))
            } else {
                (level.checked_sub(1), inside(range, level, i))
            };
            count(inside.len());
            let Some(below) = below else {
                for i in inside {
                    let away2 = metric(&offset(p, q[i]));
                    if away2 <= limit2 {
                        limit2 = add(run, i, away2);
                    }
                }
                continue;
            };
            for i in inside {
                let away2 = metric(&self.levels[below][i].from(at));
                if away2 <= limit2 {
                    unopened.0.push(Reverse((away2.to_bits(), run, below, i)));
                }
            }
        }
    }

    /// Calls `visit` with the positions of `range` whose squared distance from `p` is at most
    /// `reach2`, in order, until it returns false; returns whether it never did. It gets the index
    /// of a position and the vector to it.
    pub fn within(
        &self,
        q: &[[i32; 3]],
        range: Range<usize>,
        p: [i32; 3],
        reach2: f64,
        visit: &mut impl FnMut(usize, [f64; 3]) -> bool,
    ) -> bool {
        let mut search = Within { levels: &self.levels, q, range, p, reach2, visit };
        match self.start(&search.range) {
            None => search.positions(search.range.clone()),
            Some(level) => search.boxes(level, blocks(&search.range, level)),
        }
    }

    /// Lowest level at which few boxes hold a range; `None` if it has few positions.
    fn start(&self, range: &Range<usize>) -> Option<usize> {
        let is_few = |level: &usize| blocks(range, *level).len() <= FAN;
        (range.len() > FEW).then(|| (0..self.levels.len()).find(is_few)).flatten()
    }
}

/// Boxes of a level that hold the positions of a range, which has at least one.
fn blocks(range: &Range<usize>, level: usize) -> Range<usize> {
    let log2 = FAN_LOG2 * (level as u32 + 1);
    range.start >> log2..((range.end - 1) >> log2) + 1
}

/// What lies in box `i` of a level: boxes of the level below, or positions, of a range.
fn inside(range: &Range<usize>, level: usize, i: usize) -> Range<usize> {
    let of_range = if level == 0 { range.clone() } else { blocks(range, level - 1) };
    of_range.start.max(i * FAN)..of_range.end.min((i + 1) * FAN)
}

/// A search for the positions within a distance.
struct Within<'a, F> {
    levels: &'a [Vec<Box3>],
    q: &'a [[i32; 3]],
    range: Range<usize>,
    p: [i32; 3],
    reach2: f64,
    visit: &'a mut F,
}

impl<F: FnMut(usize, [f64; 3]) -> bool> Within<'_, F> {
    fn boxes(&mut self, level: usize, mut boxes: Range<usize>) -> bool {
        boxes.all(|i| {
            count(1);
            if length2(&self.levels[level][i].from(self.p.map(f64::from))) > self.reach2 {
                return true;
            }
            let inside = inside(&self.range, level, i);
            match level.checked_sub(1) {
                None => self.positions(inside),
                Some(below) => self.boxes(below, inside),
            }
        })
    }

    fn positions(&mut self, mut range: Range<usize>) -> bool {
        range.all(|i| {
            count(1);
            let offset = offset(self.p, self.q[i]);
            length2(&offset) > self.reach2 || (self.visit)(i, offset)
        })
    }
}

/// Counts distances, in tests.
#[inline(always)]
fn count(_distances: usize) {
    #[cfg(test)]
    crate::sample::effort::add(_distances);
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::morton;
    use proptest::prelude::*;

    /// Clouds of several densities, along the curve, without coincident points.
    fn clouds() -> impl Strategy<Value = Vec<[i32; 3]>> {
        let near = prop::collection::vec([0u32..30, 0u32..30, 0u32..4], 1..400);
        let far = prop::collection::vec(any::<[u32; 3]>(), 0..40);
        (near, far).prop_map(|(near, far)| {
            let far = far.into_iter().map(|p| p.map(|c| c >> 1));
            let mut points: Vec<[u32; 3]> = near.into_iter().chain(far).collect();
            points.sort_unstable_by_key(|&p| morton::encode3(p));
            points.dedup();
            points.into_iter().map(|p| p.map(|c| c as i32)).collect()
        })
    }

    proptest! {
        #[test]
        fn the_nearest_are_those_of_all_positions(q in clouds(), wanted in 1usize..9, cut in 0usize..200, p in any::<prop::sample::Index>()) {
            let cut = cut.min(q.len() - 1);
            let ends = [0..cut, cut..q.len() - (q.len() - cut) / 3].into_iter();
            let runs: Vec<Run> = ends.map(|places| Run { places, away2: 0.0 }).filter(|r| !r.places.is_empty()).collect();
            let boxes = Boxes::of(&q, usize::MAX);
            let p = q[p.index(q.len())];
            let mut found: Vec<f64> = Vec::new();
            boxes.nearest((&q, &runs), (p, length2, f64::INFINITY), &mut Unopened::default(), |run, i, away2| {
                assert!(runs[run].places.contains(&i));
                found.push(away2);
                found.sort_by(f64::total_cmp);
                found.truncate(wanted);
                if found.len() == wanted { found[wanted - 1] } else { f64::INFINITY }
            });
            let range = runs.iter().flat_map(|run| run.places.clone());
            let mut all: Vec<f64> = range.map(|i| length2(&offset(p, q[i]))).collect();
            all.sort_by(f64::total_cmp);
            all.truncate(wanted);
            prop_assert_eq!(found, all);
        }

        #[test]
        fn positions_within_a_distance_are_found_in_order(q in clouds(), reach in 0.0f64..60.0, most in 1usize..50, p in any::<prop::sample::Index>()) {
            let boxes = Boxes::of(&q, usize::MAX);
            let p = q[p.index(q.len())];
            let reach2 = reach * reach;
            let mut found = Vec::new();
            let all = boxes.within(&q, 0..q.len(), p, reach2, &mut |i, _| {
                found.push(i);
                found.len() < most
            });
            let mut near: Vec<usize> = (0..q.len()).filter(|&i| length2(&offset(p, q[i])) <= reach2).collect();
            prop_assert_eq!(all, near.len() < most);
            near.truncate(most);
            prop_assert_eq!(found, near);
        }
    }
}
