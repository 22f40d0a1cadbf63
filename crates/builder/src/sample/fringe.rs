//! Narrows radii by the distance to points in the cells around, where densities of single cells say
//! too little.
//!
//! The *fringe* is the points of a cell that ends because the cell above took all of them. No finer
//! node shows how dense they are, so they would be drawn as wide as the sample above is coarse:
//! balls on the tops of trees that reach into another cell. Likewise, a few points of a sample just
//! across a border of cells would seem to be alone. See docs/design/building.md.

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
    let share = |i| {
        let (mut cells, mut points, mut nearest) = (0, 0.0, Nearest::default());
        near.each_run(i, |run| {
            let weight = offer(run.start).weight;
            (cells, points) = (cells + 1, points + run.len() as f32 * weight);
            run.filter(|&j| j != i).for_each(|j| nearest.add(near.distance2(i, j), weight));
        });
        // Points are taken as evenly spread on surfaces through the occupied cells. A wire is no
        // surface, but the result is still wider than its points are apart.
        let typical = near.edge() * (cells as f64 / f64::from(points)).sqrt();
        (typical.min(nearest.distance()) / spacing).min(1.0) as f32
    };
    let shares = (0..candidates.len()).map(|i| if offer(i).ends { share(i) } else { 1.0 });
    candidates.as_offered(shares.collect())
}

/// Narrows radii that are wide beside the spacing of a sample to the typical distance of the points
/// around, including those across borders of cells. Radii and `spacing` are in steps; `q` returns
/// the positions of the points, along the curve.
pub fn narrow(radii: &mut [f32], q: impl FnOnce() -> Vec<[i32; 3]>, spacing: f64) {
    let is_wide = |radius: f32| f64::from(radius) > spacing * WIDE_SPACINGS;
    if !radii.iter().any(|&radius| is_wide(radius)) {
        return;
    }
    let q = q();
    let near = NeighbourGrid::new(&q, spacing * WIDE_SPACINGS);
    for (i, radius) in radii.iter_mut().enumerate().filter(|(_, radius)| is_wide(**radius)) {
        let mut nearest = Nearest::default();
        near.each_run(i, |run| {
            run.filter(|&j| j != i).for_each(|j| nearest.add(near.distance2(i, j), 1.0));
        });
        *radius = radius.min(nearest.distance() as f32);
    }
}

/// The nearest points to a position, as many as suffice if each has a weight of one: squared
/// distances, ascending, with weights.
struct Nearest([(f64, f32); NEIGHBOURS as usize]);

impl Default for Nearest {
    fn default() -> Self {
        Self([(f64::INFINITY, 0.0); NEIGHBOURS as usize])
    }
}

impl Nearest {
    fn add(&mut self, away2: f64, weight: f32) {
        let Self([.., last]) = self;
        // Coincident points have no distance.
        if away2 > 0.0 && away2 < last.0 {
            let place = self.0.partition_point(|other| other.0 <= away2);
            self.0[place..].rotate_right(1);
            self.0[place] = (away2, weight);
        }
    }

    /// Typical distance of points: on a surface each of the [`NEIGHBOURS`] nearest has its part of
    /// the disc that reaches the last one. Infinite if there are fewer.
    fn distance(&self) -> f64 {
        let mut sum = 0.0;
        let enough = self.0.iter().find(|(_, weight)| {
            sum += weight;
            sum >= NEIGHBOURS
        });
        enough.map_or(f64::INFINITY, |(away2, _)| (away2 * PI / f64::from(NEIGHBOURS)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use esker_points::morton;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_nearest_are_those_of_a_sorted_list(points in prop::collection::vec((0.01..100.0, 0.0f32..6.0), 0..30)) {
            let mut nearest = Nearest::default();
            points.iter().for_each(|&(away2, weight)| nearest.add(away2, weight));
            let mut sorted: Vec<(f64, f32)> = points;
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            sorted.truncate(NEIGHBOURS as usize);
            let mut sum = 0.0;
            let reached = sorted.iter().find(|p| { sum += p.1; sum >= NEIGHBOURS });
            let expected = reached.map_or(f64::INFINITY, |p| (p.0 * PI / 4.0).sqrt());
            prop_assert_eq!(nearest.distance(), expected);
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
