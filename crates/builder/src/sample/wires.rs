//! Narrows the radii of points on wires ([`crate::sample::marks`]). Radii follow from densities as
//! if points were on a surface, so parallel wires would merge into one. Half of such a radius or
//! less closes each wire.

use crate::attributes::eigen::Eigen;
use crate::sample::boxes::{Run, length2};
use crate::sample::candidates::Candidates;
use crate::sample::nearby::NeighbourGrid;

/// Distance to which gaps are searched, in spacings: no radius is wider, and cells of this size
/// hold few points where radii are wide.
const FAR_SPACINGS: f64 = 8.0;
/// Radius over the larger of the two gaps beside a point of a wire: half, and a margin for bends.
const GAP_SHARE: f64 = 0.6;
/// Neighbours used to estimate a direction; more do not improve it.
const NEIGHBOURS_MAX: usize = 256;

/// Whether any point is on a wire.
pub fn has_any(wires: &[bool]) -> bool {
    // Branch-free.
    wires.iter().fold(false, |any, wire| any | wire)
}

/// Narrows the radii of points on wires; they and the `spacing` of all are in steps. `places` has
/// the index among the candidates of each radius.
pub fn narrow(radii: &mut [f32], spacing: f64, places: &[u32], candidates: &Candidates) {
    let is_wire = |i: usize| candidates.wires.get(places[i] as usize) == Some(&true);
    if !(0..radii.len()).any(is_wire) {
        return;
    }
    let wires: Vec<usize> = (0..radii.len()).filter(|&i| is_wire(i)).collect();
    let points: Vec<[i32; 3]> = wires.iter().map(|&i| candidates.q[places[i] as usize]).collect();
    let far = spacing * FAR_SPACINGS;
    let near = NeighbourGrid::new(&points, far);
    let mut runs = Vec::new();
    for place in 0..near.len() {
        for &i in &wires[near.points_at(place)] {
            // A wider gap would not narrow the radius.
            let far = far.min(f64::from(radii[i]) / GAP_SHARE);
            if let Some(gap) = gap(&near, place, far, &mut runs) {
                radii[i] = radii[i].min((gap * GAP_SHARE) as f32);
            }
        }
    }
}

/// Returns the larger of the gaps beside a point on its wire, among the points within `far`; `None`
/// if there is none.
fn gap(near: &NeighbourGrid, place: usize, far: f64, runs: &mut Vec<Run>) -> Option<f64> {
    let (mut offsets, mut room): (Vec<[f64; 3]>, _) = (Vec::new(), NEIGHBOURS_MAX);
    near.around(place, runs);
    let mut add = |other: usize, offset: [f64; 3]| {
        // Points at the same place take room, but are no neighbours.
        let others = near.points_at(other).len() - usize::from(other == place);
        let taken = others.min(room);
        offsets.extend((0..taken).filter(|_| other != place).map(|_| offset));
        room -= taken;
        room > 0
    };
    for run in runs.iter() {
        if !near.within(place, run, far, &mut add) {
            break;
        }
    }
    larger_gap(&offsets)
}

/// Larger of the gaps on a wire among points at these offsets; `None` if there are no points.
fn larger_gap(offsets: &[[f64; 3]]) -> Option<f64> {
    // Directions are weighted by the inverse of their length: the nearest give the direction of the
    // point's own wire rather than that of several.
    let directions: Vec<_> =
        offsets.iter().map(|offset| offset.map(|c| c / length2(offset))).collect();
    let along = Eigen::of(square(&directions)).axes[0];
    let mut gaps = [f64::INFINITY; 2];
    for offset in offsets {
        let on_it: f64 = offset.iter().zip(along).map(|(a, b)| a * b).sum();
        let away2 = length2(offset);
        // Ahead or behind, not on the next wire.
        if 2.0 * on_it * on_it >= away2 {
            let gap = &mut gaps[usize::from(on_it > 0.0)];
            *gap = gap.min(away2.sqrt());
        }
    }
    gaps.into_iter().filter(|gap| gap.is_finite()).max_by(f64::total_cmp)
}

/// Mean products of the components of `offsets`, as a symmetric matrix.
fn square(offsets: &[[f64; 3]]) -> [f64; 6] {
    let n = offsets.len().max(1) as f64;
    let entry = |(i, j): (usize, usize)| {
        offsets.iter().map(|offset| offset[i] * offset[j]).sum::<f64>() / n
    };
    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(entry)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::boxes::offset;
    use crate::sample::candidates::tests::candidates_of;
    use crate::sample::effort;
    use crate::sample::marks::{WireMarks, has_wires};
    use crate::sample::nearby::tests::plain_around;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn parallel_wires_stay_closed_and_become_narrow(gaps in prop::collection::vec(40u32..80, 60), turn in 0.0f64..1.5, apart in 100.0f64..300.0) {
            // Three wires a metre or more apart, in steps of a centimetre, and a field below.
            let (sin, cos) = turn.sin_cos();
            let mut wires: Vec<Vec<[u32; 3]>> = vec![Vec::new(); 3];
            for (wire, points) in wires.iter_mut().enumerate() {
                let mut at = f64::from(gaps[wire]);
                for gap in &gaps {
                    at += f64::from(*gap);
                    let across = apart * wire as f64;
                    let [x, y] = [at * cos - across * sin, at * sin + across * cos];
                    points.push([(x + 9000.0) as u32, (y + 9000.0) as u32, 3000 + (at / 20.0) as u32]);
                }
            }
            let all: Vec<[u32; 3]> = wires.concat();
            let mut candidates = candidates_of(&all, [0.01; 3]);
            candidates.wires = vec![true; all.len()];
            let low = [0, 1, 2].map(|axis| candidates.q.iter().map(|q| q[axis]).min().unwrap());
            let mut radii = vec![200.0f32; all.len()];
            narrow(&mut radii, 70.0, &Vec::from_iter(0..all.len() as u32), &candidates);
            let least = [0, 1, 2].map(|axis| all.iter().map(|p| p[axis]).min().unwrap());
            let radius = |p: &[u32; 3]| {
                let p = [0, 1, 2].map(|axis| (p[axis] - least[axis]) as i32 + low[axis]);
                radii[candidates.q.iter().position(|q| *q == p).unwrap()]
            };
            for wire in &wires {
                for pair in wire.windows(2) {
                    let away2: f64 = (0..3).map(|axis| f64::from(pair[0][axis].abs_diff(pair[1][axis])).powi(2)).sum();
                    prop_assert!(f64::from(radius(&pair[0]) + radius(&pair[1])) >= away2.sqrt());
                }
                // Beyond the end of a wire another one may seem to be ahead.
                prop_assert!(wire[8..52].iter().all(|p| radius(p) < 54.0));
            }
        }
    }

    /// Gap beside point `i` by its definition: among the first of all points in the 27 cells
    /// around.
    fn plain(q: &[[i32; 3]], i: usize, edge: f64, far: f64) -> Option<f64> {
        let others = plain_around(q, i, edge).into_iter().filter(|&j| j != i);
        let offsets = others.map(|j| offset(q[i], q[j])).filter(|o| length2(o) <= far * far);
        let mut offsets: Vec<_> = offsets.take(NEIGHBOURS_MAX).collect();
        offsets.retain(|offset| length2(offset) > 0.0);
        larger_gap(&offsets)
    }

    proptest! {
        #[test]
        fn gaps_are_those_among_all_points_around(points in prop::collection::vec([0u32..40, 0u32..40, 0u32..9], 1..300), lone in prop::collection::vec([0u32..3000, 0u32..3000, 0u32..90], 0..50), stack in 0usize..300, spacing in 0.5f64..60.0, share in 0.01f64..1.0) {
            let stack = vec![[20, 20, 4]; stack];
            let candidates = candidates_of(&[points, lone, stack].concat(), [1.0; 3]);
            let (q, edge) = (&candidates.q, spacing * FAR_SPACINGS);
            let near = NeighbourGrid::new(q, edge);
            for place in 0..near.len() {
                let found = gap(&near, place, edge * share, &mut Vec::new());
                for i in near.points_at(place).take(2) {
                    prop_assert_eq!(found, plain(q, i, edge, edge * share));
                }
            }
        }
    }

    /// Distances for each point of any cloud, most of them to neighbours.
    const OPERATIONS_EACH: usize = NEIGHBOURS_MAX * 3 / 2;

    #[test]
    fn work_grows_with_the_number_of_points_however_they_are_spread() {
        for (name, cloud) in effort::CLOUDS {
            for spacing in [1e3, 1e6] {
                effort::assert_linear(
                    &format!("{name}, {spacing}"),
                    (2000, OPERATIONS_EACH),
                    |n| {
                        let mut candidates = candidates_of(&cloud(n), [1.0; 3]);
                        candidates.wires = vec![true; n];
                        let places = Vec::from_iter(0..n as u32);
                        effort::restart();
                        let mut radii = vec![spacing as f32; n];
                        narrow(&mut radii, spacing, &places, &candidates);
                    },
                );
            }
        }
    }

    #[test]
    fn other_points_and_lone_ones_keep_their_radii() {
        let mut candidates =
            candidates_of(&[0, 1, 2, 3, 4, 5, 6, 7, 8].map(|i| [i * 50, 0, 0]), [0.01; 3]);
        let mut narrowed = |radius: f32, wires: &[bool]| {
            candidates.wires = wires.to_vec();
            let mut radii = vec![radius; 9];
            narrow(&mut radii, 100.0, &[0, 1, 2, 3, 4, 5, 6, 7, 8], &candidates);
            radii
        };
        let lone = [false, false, false, false, true, false, false, false, false];
        assert_eq!(narrowed(150.0, &[false; 9]), [150.0; 9]);
        assert_eq!(narrowed(150.0, &[]), [150.0; 9]);
        assert_eq!(narrowed(150.0, &lone), [150.0; 9]);
        assert_eq!(narrowed(150.0, &[true; 9]), [30.0; 9]);
        assert_eq!(narrowed(20.0, &[true; 9]), [20.0; 9]);
        assert!(has_wires([1.0, 14.0]) && has_wires([16.0, 16.0]) && !has_wires([15.0, 15.0]));
        assert!(has_any(&[false, true]) && !has_any(&[false; 3]) && !has_any(&[]));
        let by_class = WireMarks { class_at: Some(1), normal_at: None };
        assert!([13, 14, 16].iter().all(|&class| by_class.is_wire(&[0, class])));
        assert!([0, 12, 15, 17].iter().all(|&class| !by_class.is_wire(&[14, class])));
        let by_normal = WireMarks { class_at: None, normal_at: Some(1) };
        assert!(
            by_normal.is_wire(&[0, 0, 0x80, 1, 0]) && !by_normal.is_wire(&[0, 0, 0x80, 0, 0x80])
        );
        assert!(!has_wires([0.0, 12.0]) && !has_wires([f64::INFINITY, f64::NEG_INFINITY]));
    }
}
