//! Estimates normals for points that bring none: the direction in which the nearest neighbours of a
//! point spread least (`hoppe1992`, section 3.2). A normal depends only on positions within the
//! reach, so it is the same however a cloud is cut into chunks.

use crate::attributes::density::Distances;
use crate::attributes::eigen::Eigen;
use crate::attributes::knn::{Query, sorted_codes};
use crate::attributes::knn_index::KnnIndex;
use esker_points::{Cell, morton, quant};

/// Neighbours to which a plane is fitted; if these lie along a line, twice and four times as many.
pub(crate) const NEIGHBOURS: usize = 16;
pub(crate) const NEIGHBOURS_MAX: usize = 64;
/// Second variance over the greatest below which neighbours lie along a line, as those of one scan
/// line do.
pub(crate) const LINE: f64 = 0.01;
/// Reach in typical spacings. A larger one makes the halos of chunks large; a smaller one leaves
/// sparse parts of uneven scans without normals.
const REACH_SPACINGS: f64 = 16.0;

/// Code of a point without a normal, which is drawn facing the eye.
pub const UNKNOWN: [i16; 2] = [i16::MIN; 2];
/// Code of a point without a normal that is on a wire. Rows have it; pages have [`UNKNOWN`].
pub const WIRE: [i16; 2] = [i16::MIN, 1];

/// Origin of the normals that are drawn. Attributes stay exact in any case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NormalsMode {
    /// From the sources, if any of them has normals; otherwise as with [`Self::Fast`].
    #[default]
    Keep,
    /// Estimated for all points, from their nearest neighbours.
    Estimate,
    /// Estimated for all points, from blocks of cells: much faster, and blurred more at edges.
    Fast,
    /// No normals are drawn.
    None,
}

/// Limits of the neighbourhood of a point.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    /// Length of a lattice step on each axis.
    pub scale: [f64; 3],
    /// Greatest distance of neighbours, in steps of the first axis.
    pub reach: f64,
}

impl Bounds {
    /// Limits for a cloud whose points are so far apart.
    pub fn new(scale: [f64; 3], distances: &Distances) -> Self {
        let longest = scale.into_iter().fold(0.0, f64::max) / scale[0];
        let shortest = scale.into_iter().fold(f64::INFINITY, f64::min) / scale[0];
        let reach = (distances.spacing * longest * REACH_SPACINGS).ceil();
        Self { scale, reach: reach.min(distances.steps_max * shortest).max(shortest) }
    }

    /// The least and the greatest position that influence normals in a cell.
    pub fn around(&self, cell: &Cell) -> [[u32; 3]; 2] {
        let (low, high, steps) = (cell.corner, cell.last(), self.steps());
        [
            [0, 1, 2].map(|i| low[i].saturating_sub(steps[i])),
            [0, 1, 2].map(|i| high[i].saturating_add(steps[i])),
        ]
    }

    /// The reach on each axis, in its steps.
    pub fn steps(&self) -> [u32; 3] {
        self.scale
            .map(|s| (self.reach * (self.scale[0] / s)).ceil().min(f64::from(u32::MAX)) as u32)
    }
}

/// Estimates the normals of `own` points, which lie along the Morton curve, and returns their
/// octahedral codes. `halo` has at least all other points within the reach of them, in any order.
/// Of the two directions the upward one is chosen (along z; along y, then x, if it is level).
pub fn estimate(own: &[[u32; 3]], halo: &[[u32; 3]], bounds: &Bounds) -> Vec<[i16; 2]> {
    let (points, place_of) = joined(own, &sorted_codes(halo));
    let mut wanted = vec![false; points.len()];
    place_of.iter().for_each(|&place| wanted[place as usize] = true);
    let query = Query { count: NEIGHBOURS, count_max: NEIGHBOURS_MAX, reach: bounds.reach };
    let fit = |steps: &[[f64; 3]]| normal(steps, bounds.scale);
    let found = KnnIndex::new(&points, bounds.scale).map(&query, |p| wanted[p], fit, UNKNOWN);
    place_of.into_iter().map(|place| found[place as usize]).collect()
}

/// Merges distinct points along the Morton curve; also returns the index of each point of `own`.
pub(crate) fn joined(own: &[[u32; 3]], halo: &[u128]) -> (Vec<[u32; 3]>, Vec<u32>) {
    let mut points: Vec<[u32; 3]> = Vec::with_capacity(own.len() + halo.len());
    let mut place_of = Vec::with_capacity(own.len());
    let mut halo = halo.iter().peekable();
    let last = own.last().map_or(0, |&p| morton::encode3(p));
    for &p in own {
        if points.last() != Some(&p) {
            // A halo around a cell has no points between those of the cell.
            if halo.peek().is_some_and(|&&next| next <= last) {
                let code = morton::encode3(p);
                while let Some(&before) = halo.next_if(|&&c| c <= code) {
                    if before < code {
                        points.push(morton::decode3(before));
                    }
                }
            }
            points.push(p);
        }
        place_of.push(points.len() as u32 - 1);
    }
    points.extend(halo.map(|&c| morton::decode3(c)));
    (points, place_of)
}

/// Code of the direction in which a point and its neighbours, at the offsets `steps`, spread least;
/// `None` if there are too few or they lie along a line.
fn normal(steps: &[[f64; 3]], scale: [f64; 3]) -> Option<[i16; 2]> {
    Some(code_of(flattest(steps, scale)?.0))
}

/// The code that pages store for one of a row.
pub fn stored(code: [i16; 2]) -> [i16; 2] {
    if code == WIRE { UNKNOWN } else { code }
}

/// Code of a direction, turned upwards.
pub(crate) fn code_of([x, y, z]: [f64; 3]) -> [i16; 2] {
    let up = [z, y, x].into_iter().find(|&c| c != 0.0).unwrap_or_default();
    let turned = if up < 0.0 { [-x, -y, -z] } else { [x, y, z] };
    quant::oct_encode(turned.map(|c| c as f32))
}

/// Direction in which a point and its neighbours spread least, and the variances, largest first;
/// `None` as for [`normal`].
pub(crate) fn flattest(steps: &[[f64; 3]], scale: [f64; 3]) -> Option<([f64; 3], [f64; 3])> {
    const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
    if steps.len() < 2 {
        return None;
    }
    // Sums of integers, exact while neighbours are within some 2^24 steps.
    let (mut sum, mut square) = ([0.0; 3], [0.0; 6]);
    for s in steps {
        sum = [sum[0] + s[0], sum[1] + s[1], sum[2] + s[2]];
        PAIRS.iter().zip(&mut square).for_each(|(&(i, j), q)| *q += s[i] * s[j]);
    }
    let n = (steps.len() + 1) as f64;
    let mut covariance = [0.0; 6];
    for (k, (i, j)) in PAIRS.into_iter().enumerate() {
        covariance[k] = (n * square[k] - sum[i] * sum[j]) * (scale[i] * scale[j]);
    }
    let eigen = Eigen::of(covariance);
    if eigen.values[1] <= LINE * eigen.values[0] {
        return None;
    }
    Some((eigen.axes[2], eigen.values))
}

/// Turns a normal to the side of `direction`; unknown ones stay unknown.
pub fn turned_to(code: [i16; 2], direction: [f32; 3]) -> [i16; 2] {
    if code == WIRE {
        return code;
    }
    let n = quant::oct_decode(code);
    let towards = n[0] * direction[0] + n[1] * direction[1] + n[2] * direction[2];
    if towards < 0.0 { quant::oct_encode(n.map(|c| -c)) } else { code }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attributes::surfaces::{plane, sphere, two_walls};
    use proptest::prelude::*;

    const SCALE: f64 = 0.001;

    fn lattice(p: [f64; 3]) -> [u32; 3] {
        p.map(|c| (c / SCALE + 2e9).round() as u32)
    }

    fn along_the_curve(mut points: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
        points.sort_by_key(|&p| morton::encode3(p));
        points
    }

    /// Mean and 99th percentile of the angles to the true normals, degrees.
    fn errors(points: &[([f64; 3], [f64; 3])]) -> [f64; 2] {
        let mut sorted: Vec<_> = points.iter().map(|&(p, n)| (lattice(p), n)).collect();
        sorted.sort_by_key(|&(p, _)| morton::encode3(p));
        let own: Vec<_> = sorted.iter().map(|s| s.0).collect();
        let bounds = Bounds { scale: [SCALE; 3], reach: 1e6 };
        let mut angles: Vec<f64> = estimate(&own, &[], &bounds)
            .iter()
            .zip(&sorted)
            .map(|(&code, (_, n))| {
                let ours = quant::oct_decode(code).map(f64::from);
                let cos: f64 = (0..3).map(|i| ours[i] * n[i]).sum();
                cos.abs().min(1.0).acos().to_degrees()
            })
            .collect();
        angles.sort_by(f64::total_cmp);
        let mean = angles.iter().sum::<f64>() / angles.len() as f64;
        [mean, angles[angles.len() * 99 / 100]]
    }

    #[test]
    fn a_plane_has_its_normal_everywhere() {
        let [mean, worst] = errors(&plane(0.0));
        assert!(mean < 0.2 && worst < 0.5, "{mean} {worst}");
    }

    #[test]
    fn noise_of_a_tenth_of_the_spacing_turns_normals_by_a_few_degrees() {
        let [mean, worst] = errors(&plane(0.007));
        assert!(mean < 3.0 && worst < 8.0, "{mean} {worst}");
    }

    #[test]
    fn a_sphere_has_radial_normals() {
        let [mean, worst] = errors(&sphere(5.0));
        assert!(mean < 0.5 && worst < 1.5, "{mean} {worst}");
    }

    #[test]
    fn an_edge_is_blurred_by_no_more_than_its_neighbours() {
        // Two walls of 5 m at a right angle; normals are wrong only within four spacings of the
        // edge.
        let points = two_walls();
        let [mean, _] = errors(&points);
        let far: Vec<_> = points.iter().copied().filter(|(p, _)| p[0] + p[2] > 0.2).collect();
        let [_, worst_far] = errors(&far);
        assert!(mean < 0.5 && worst_far < 0.1, "{mean} {worst_far}");
    }

    #[test]
    fn neighbours_along_a_line_give_no_normal_and_flat_ones_do() {
        let bounds = Bounds { scale: [SCALE; 3], reach: 1e6 };
        let codes = |points: Vec<[u32; 3]>| estimate(&along_the_curve(points), &[], &bounds);
        assert!(codes(vec![]).is_empty());
        // One, two, many coincident points; a line; points beyond the reach of each other.
        for points in [
            vec![[5; 3]],
            vec![[5; 3], [9; 3]],
            vec![[5; 3]; 100],
            (0..100).map(|i| [i, i * 2, i * 3]).collect(),
            vec![[0; 3], [2_000_000; 3], [u32::MAX; 3]],
        ] {
            let n = points.len();
            assert_eq!(codes(points), vec![UNKNOWN; n]);
        }
        // Three points are a plane, also if each is repeated.
        let up = quant::oct_encode([0.0, 0.0, 1.0]);
        let corner = vec![[0, 0, 0], [0, 9, 0], [9, 0, 0]];
        assert_eq!(codes(corner.clone()), [up; 3]);
        assert_eq!(codes(corner.repeat(50)), [up; 150]);
        // Scan lines far apart: the nearest neighbours lie along one of them.
        let lines = (0..3).flat_map(|y| (0..400).map(move |x| [x, y * 20, 7]));
        assert_eq!(codes(lines.collect()), vec![up; 1200]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_cloud_cut_into_chunks_has_the_same_normals(points in prop::collection::vec([0u32..300, 0u32..300, 0u32..20], 1..600), cut in 0u32..300, reach in prop::sample::select(vec![2.0, 16.0, 64.0])) {
            let bounds = Bounds { scale: [1.0, 1.0, 2.0], reach };
            let all = along_the_curve(points);
            let whole = estimate(&all, &[], &bounds);
            let steps = bounds.steps();
            for side in [false, true] {
                let is_own = |p: &[u32; 3]| (p[0] < cut) == side;
                let own: Vec<_> = all.iter().copied().filter(is_own).collect();
                let near = |p: &&[u32; 3]| if side { p[0] < cut + steps[0] } else { p[0] + steps[0] >= cut };
                let mut halo: Vec<_> = all.iter().filter(near).copied().filter(|p| !is_own(p)).collect();
                halo.reverse();
                let codes = estimate(&own, &halo, &bounds);
                let expected: Vec<_> = all.iter().zip(&whole).filter(|(p, _)| is_own(p)).map(|(_, &c)| c).collect();
                prop_assert_eq!(codes, expected);
            }
        }
    }

    #[test]
    fn normals_turn_to_the_scanner() {
        let up = quant::oct_encode([0.0, 0.0, 1.0]);
        let down = turned_to(up, [0.3, 0.3, -0.1]);
        assert_eq!(quant::oct_decode(down), [0.0, 0.0, -1.0]);
        assert_eq!(turned_to(down, [0.3, 0.3, -0.1]), down);
        assert_eq!(turned_to(UNKNOWN, [0.0, 0.0, -1.0]), UNKNOWN);
    }
}
