//! Narrows radii by the distance to points in the cells around, where densities of single cells say
//! too little.
//!
//! The *fringe* is the points of a cell that ends because the cell above took all of them. No finer
//! node shows how dense they are, so they would be drawn as wide as the sample above is coarse:
//! balls on the tops of trees that reach into another cell. Likewise, a few points of a sample just
//! across a border of cells would seem to be alone. See docs/design/building.md.

use crate::sample::boxes::{Run, Unopened};
use crate::sample::candidates::Candidates;
use crate::sample::nearby::NeighbourGrid;
use std::f64::consts::PI;

/// Number of nearest points, by weight, whose distance is used. On a wire they reach twice as far
/// as its points are apart.
const NEIGHBOURS: f32 = 4.0;
/// Radii of a sample are narrowed where they exceed this multiple of its spacing.
const WIDE_SPACINGS: f64 = 2.0;

/// What a cell offers to the one above.
#[derive(Clone, Copy, Debug)]
pub struct Offer {
    /// Whether the cell ends: all of its points go to the cell above.
    pub ends: bool,
    /// Number of points that each offered point represents.
    pub weight: f32,
}

/// Computes, for each offered point whose cell ends, the typical distance of the points around it
/// as a share of `spacing` (in the file's unit), at most 1; 1 for other points. `from` has the
/// index in `offers` of each point's cell.
pub fn shares(candidates: &Candidates, from: &[u8], offers: &[Offer], spacing: f64) -> Vec<f32> {
    let from = candidates.along_curve(from);
    let offer = |i: usize| offers[usize::from(from[i])];
    let spacing = spacing / candidates.step;
    let near = NeighbourGrid::new(&candidates.q, spacing);
    let (mut runs, mut unopened) = (Vec::new(), Unopened::default());
    let mut share = |place| {
        let (mut cells, mut points) = (0, 0.0);
        let weight = |run: &Run| offer(near.points(&run.places).start).weight;
        near.around(place, &mut runs);
        for run in &runs {
            let count = near.points(&run.places).len();
            (cells, points) = (cells + 1, points + count as f32 * weight(run));
        }
        // Points are taken as evenly spread on surfaces through the occupied cells. A wire is no
        // surface, but the result is still wider than its points are apart.
        let typical = near.edge() * (cells as f64 / f64::from(points)).sqrt();
        let nearest = Nearest::among((&runs, &mut unopened), &near, place, weight);
        (typical.min(nearest.distance()) / spacing).min(1.0) as f32
    };
    let mut shares = vec![1.0; candidates.len()];
    for place in 0..near.len() {
        let is_wanted = |&i: &usize| offer(i).ends;
        // Coincident points have the same share.
        if near.points_at(place).any(|i| is_wanted(&i)) {
            let share = share(place);
            near.points_at(place).filter(is_wanted).for_each(|i| shares[i] = share);
        }
    }
    candidates.as_offered(shares)
}

/// Narrows radii that are wide beside the spacing of a sample to the typical distance of the points
/// around, including those across borders of cells. Radii and `spacing` are in steps; `q` returns
/// the positions of the points, along the curve.
pub fn narrow(radii: &mut [f32], q: impl FnOnce() -> Vec<[i32; 3]>, spacing: f64) {
    let is_wide = |radius: f32| f64::from(radius) > spacing * WIDE_SPACINGS;
    if !radii.iter().any(|&radius| is_wide(radius)) {
        return;
    }
    let near = NeighbourGrid::new(&q(), spacing * WIDE_SPACINGS);
    let (mut runs, mut unopened) = (Vec::new(), Unopened::default());
    for place in 0..near.len() {
        let of_place = &mut radii[near.points_at(place)];
        if of_place.iter().any(|&radius| is_wide(radius)) {
            near.around(place, &mut runs);
            let distance =
                Nearest::among((&runs, &mut unopened), &near, place, |_| 1.0).distance() as f32;
            let wide = of_place.iter_mut().filter(|radius| is_wide(**radius));
            wide.for_each(|radius| *radius = radius.min(distance));
        }
    }
}

/// The nearest points to a position, as many as suffice if each has a weight of one, nearest first;
/// of equally near ones those of the first run.
struct Nearest([Neighbour; NEIGHBOURS as usize]);

/// A point near another one.
#[derive(Clone, Copy)]
struct Neighbour {
    /// Square of the distance.
    away2: f64,
    /// Rank of the run with the point.
    rank: usize,
    weight: f32,
}

impl Default for Nearest {
    fn default() -> Self {
        let none = Neighbour { away2: f64::INFINITY, rank: 0, weight: 0.0 };
        Self([none; NEIGHBOURS as usize])
    }
}

impl Nearest {
    /// Finds the points nearest to a place among those of `runs`; `weight` is that of each point of
    /// a run.
    fn among(
        (runs, unopened): (&[Run], &mut Unopened),
        near: &NeighbourGrid,
        place: usize,
        weight: impl Fn(&Run) -> f32,
    ) -> Self {
        let mut nearest = Self::default();
        near.nearest(place, runs, unopened, |rank, other, away2| {
            let new = Neighbour { away2, rank, weight: weight(&runs[rank]) };
            let count = near.points_at(other).len().min(NEIGHBOURS as usize);
            (0..count).for_each(|_| nearest.add(new));
            let Self([.., last]) = &nearest;
            last.away2
        });
        nearest
    }

    fn add(&mut self, new: Neighbour) {
        let is_before = |other: &Neighbour| (other.away2, other.rank) <= (new.away2, new.rank);
        let at = self.0.partition_point(is_before);
        // Coincident points have no distance.
        if new.away2 > 0.0 && at < self.0.len() {
            self.0[at..].rotate_right(1);
            self.0[at] = new;
        }
    }

    /// Typical distance of points: on a surface each of the [`NEIGHBOURS`] nearest has its part of
    /// the disc that reaches the last one. Infinite if there are fewer.
    fn distance(&self) -> f64 {
        let mut sum = 0.0;
        let enough = self.0.iter().find(|neighbour| {
            sum += neighbour.weight;
            sum >= NEIGHBOURS
        });
        enough.map_or(f64::INFINITY, |last| (last.away2 * PI / f64::from(NEIGHBOURS)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::boxes::{length2, offset};
    use crate::sample::candidates::tests::candidates_of;
    use crate::sample::effort;
    use crate::sample::nearby::tests::plain_around;
    use esker_points::morton;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_are_those_of_a_sorted_list(points in prop::collection::vec((0.01..100.0, 0.0f32..6.0), 0..30)) {
            let mut nearest = Nearest::default();
            points.iter().for_each(|&(away2, weight)| nearest.add(Neighbour { away2, rank: 0, weight }));
            let mut sorted: Vec<(f64, f32)> = points;
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            sorted.truncate(NEIGHBOURS as usize);
            let mut sum = 0.0;
            let reached = sorted.iter().find(|p| { sum += p.1; sum >= NEIGHBOURS });
            let expected = reached.map_or(f64::INFINITY, |p| (p.0 * PI / 4.0).sqrt());
            prop_assert_eq!(nearest.distance(), expected);
        }
    }

    /// Typical distances around point `i` by their definition: of the nearest points in the 27
    /// cells around it, and by the counts of these cells. `weight` is that of a cell with this
    /// first point.
    fn plain(q: &[[i32; 3]], i: usize, far: f64, weight: impl Fn(usize) -> f32) -> (f64, f64) {
        let log2 = far.log2().ceil().clamp(0.0, 30.0) as u32;
        let cell = |j: usize| q[j].map(|c| c >> log2);
        let near = plain_around(q, i, far);
        let (mut cells, mut points, mut nearest) = (0, 0.0, Vec::new());
        for run in near.chunk_by(|&a, &b| cell(a) == cell(b)) {
            let weight = weight(run[0]);
            (cells, points) = (cells + 1, points + run.len() as f32 * weight);
            let away2 = |&j: &usize| length2(&offset(q[i], q[j]));
            nearest.extend(run.iter().map(away2).filter(|a| *a > 0.0).map(|a| (a, weight)));
        }
        nearest.sort_by(|a, b| a.0.total_cmp(&b.0));
        nearest.truncate(NEIGHBOURS as usize);
        let mut sum = 0.0;
        let reached = nearest.iter().find(|(_, weight)| {
            sum += weight;
            sum >= NEIGHBOURS
        });
        let distance = reached.map_or(f64::INFINITY, |r| (r.0 * PI / 4.0).sqrt());
        (distance, f64::from(1 << log2) * (f64::from(cells) / f64::from(points)).sqrt())
    }

    /// Clouds with stacks of coincident points, several densities and equal distances.
    fn clouds() -> impl Strategy<Value = Vec<[u32; 3]>> {
        let near = prop::collection::vec([0u32..12, 0u32..12, 0u32..3], 1..250);
        let far = prop::collection::vec([0u32..900, 0u32..900, 0u32..40], 0..150);
        let stack = ([0u32..900, 0u32..900, 0u32..40], 0usize..30);
        (near, far, stack).prop_map(|(near, far, (place, count))| {
            let all: Vec<_> = near.into_iter().chain(far).chain(vec![place; count]).collect();
            all.into_iter().map(|p| p.map(|c| c + 40)).collect()
        })
    }

    proptest! {
        #[test]
        fn narrow_radii_and_shares_are_those_of_all_points_around(points in clouds(), spacing in 1.0f64..90.0, wide in prop::collection::vec(1.0f32..999.0, 1..9), kinds in prop::collection::vec((any::<bool>(), 0.2f32..5.0), 8)) {
            let candidates = candidates_of(&points, [1.0; 3]);
            let n = candidates.len();
            let radii: Vec<f32> = (0..n).map(|i| wide[i * 7 % wide.len()]).collect();
            let mut narrowed = radii.clone();
            narrow(&mut narrowed, || candidates.q.clone(), spacing);
            let far = spacing * WIDE_SPACINGS;
            let expected: Vec<f32> = (0..n).map(|i| {
                let distance = plain(&candidates.q, i, far, |_| 1.0).0 as f32;
                if f64::from(radii[i]) > far { radii[i].min(distance) } else { radii[i] }
            }).collect();
            prop_assert_eq!(narrowed, expected);

            let offers: Vec<Offer> = kinds.iter().map(|&(ends, weight)| Offer { ends, weight }).collect();
            let from: Vec<u8> = candidates.q.iter().map(|p| (p[0] >> 6) as u8 % 8).collect();
            let offer = |i: usize| offers[usize::from(from[i])];
            let expected: Vec<f32> = (0..n).map(|i| {
                let (distance, typical) = plain(&candidates.q, i, spacing, |first| offer(first).weight);
                if offer(i).ends { (typical.min(distance) / spacing).min(1.0) as f32 } else { 1.0 }
            }).collect();
            prop_assert_eq!(shares(&candidates, &from, &offers, spacing), expected);
        }
    }

    /// Distances for each point of any cloud.
    const OPERATIONS_EACH: usize = 200;

    #[test]
    fn work_grows_with_the_number_of_points_however_they_are_spread() {
        for (name, cloud) in effort::CLOUDS {
            for spacing in [1e3, 1e6] {
                let of = |work: fn(&Candidates, f64)| {
                    let name = format!("{name}, {spacing}");
                    effort::assert_linear(&name, (2000, OPERATIONS_EACH), |n| {
                        let candidates = candidates_of(&cloud(n), [1.0; 3]);
                        effort::restart();
                        work(&candidates, spacing);
                    });
                };
                of(|candidates, spacing| {
                    let q = || candidates.q.clone();
                    narrow(&mut vec![f32::MAX; candidates.len()], q, spacing);
                });
                of(|candidates, spacing| {
                    let offers = [Offer { ends: true, weight: 2.0 }];
                    shares(candidates, &vec![0; candidates.len()], &offers, spacing);
                });
            }
        }
    }

    /// Least share of points beyond x = 2,048, whose cell ends, while each of the others represents
    /// 16 points.
    fn share_beyond(points: &[[u32; 3]]) -> f32 {
        let mut points = points.to_vec();
        points.sort_unstable_by_key(|&p| morton::encode3(p));
        let candidates = candidates_of(&points, [0.01; 3]);
        let from: Vec<u8> = points.iter().map(|p| u8::from(p[0] >= 2048)).collect();
        let offers = [Offer { ends: false, weight: 16.0 }, Offer { ends: true, weight: 1.0 }];
        let shares = shares(&candidates, &from, &offers, 1.0);
        assert!(shares.iter().zip(&from).all(|(share, from)| *from == 1 || *share == 1.0));
        shares.into_iter().fold(1.0, f32::min)
    }

    #[test]
    fn the_border_of_a_floor_is_narrow_and_wires_stay_closed() {
        let floor: Vec<_> = (0..10_000).map(|i| [1050 + i % 100 * 10, i / 100 * 10, 100]).collect();
        let with = |more: &[[u32; 3]]| share_beyond(&[&floor, more].concat());
        // Points 0.1 m apart, each of which represents 16: 0.025 m, of a spacing of 1 m.
        let border: Vec<_> = (0..100).map(|i| [2050, i * 10, 100]).collect();
        let share = with(&border);
        assert!((0.01..0.06).contains(&share), "{share}");
        // A wire with points 0.5 m apart, each of which closes it beyond the next; and a lone bird.
        let wire: Vec<_> = (0..40).map(|i| [3000, i * 50, 1500]).collect();
        assert!(with(&wire) > 0.5);
        assert_eq!(with(&[[3000, 500, 1500]]), 1.0);
        // Repeated points at one place are no denser.
        let share = with(&[[3000, 500, 1500]; 9]);
        assert!(share > 0.3, "{share}");
        let share = with(&[border[3]; 9]);
        assert!((0.01..0.1).contains(&share), "{share}");
    }

    #[test]
    fn wide_radii_shrink_to_the_distance_of_neighbours_and_others_stay() {
        let q: Vec<[i32; 3]> =
            (0..64).map(|i| morton::decode3(i).map(|c| c as i32 * 100)).collect();
        let mut radii = vec![130.0f32; q.len()];
        radii[5] = 800.0;
        narrow(&mut radii, || q.clone(), 100.0);
        assert!(radii.iter().enumerate().all(|(i, r)| i == 5 || *r == 130.0));
        assert!((80.0..150.0).contains(&radii[5]), "{}", radii[5]);
        // A lone point keeps its radius.
        let mut alone = [900.0];
        narrow(&mut alone, || vec![[5; 3]], 100.0);
        assert_eq!(alone, [900.0]);
    }
}
