//! Keeps the samples of cells of uneven density as coarse as their sparse parts: where a part of a
//! cell is far sparser than the sample that a node holds, the node has fewer points, and the cells
//! below have the rest of the dense part. So sparse points are not much farther apart than the
//! spacing of their node, as in [`crate::sample::uneven`].

use crate::sample::turns::{LAST_TURN, radius_at};
use crate::sample::uneven::{Leaf, SAMPLE_RADIUS, coarser_half};
use crate::sample::unevenness::Unevenness;

/// Spacings beyond this multiple of that of the sample are sparse; beyond `BETWEEN` of that they
/// are between.
const FAR: f32 = 2.5;
const BETWEEN: f32 = 0.6;
/// What is between covers at most this part of the area of what is sparse.
const BETWEEN_AREA: f64 = 0.15;
/// Local spacing of a point, at most, over the radius at which it was picked.
const TURN_SPACINGS: f32 = 1.2;
/// Points that a sample keeps in any case.
const KEPT: usize = 8;

/// The points that a cell has picked.
pub struct Sample {
    /// Indices of these among all offered points, ascending.
    pub chosen: Vec<u32>,
    /// Their turns.
    pub turns: Vec<u16>,
    /// Their local spacings, in the file's unit; 0 where they are unknown.
    pub radii: Vec<f32>,
    /// Spacing of the sample, in the file's unit.
    pub spacing: f64,
}

/// The least radius of thinning that the sparse part of a sample allows; 0 if the sample is even.
/// `positions` are those of the chosen points.
pub fn least_radius(
    sample: &Sample,
    positions: impl Iterator<Item = [u32; 3]>,
    scale: [f64; 3],
) -> f64 {
    let far = sample.spacing as f32 * FAR;
    // Cells do not tell the spacing of points beside dense ones. It is at most about the radius at
    // which these were picked.
    let most = sample.radii.iter().zip(&sample.turns).map(|(&radius, &turn)| {
        if radius > 0.0 { radius } else { radius_at(turn) as f32 * TURN_SPACINGS }
    });
    let most: Vec<f32> = most.collect();
    let unevenness = |local: &[f32]| Unevenness::beyond(local, [far * BETWEEN, far]);
    if !unevenness(&most).is_jump(BETWEEN_AREA) {
        return 0.0;
    }
    let mut local = points(positions.collect(), sample, scale).spacings_beyond(far);
    if !unevenness(&local).is_jump(BETWEEN_AREA) {
        return 0.0;
    }
    local.retain(|&local| local > far);
    let coarse = coarser_half(&mut local).unwrap_or(0.0);
    f64::from(coarse * SAMPLE_RADIUS)
}

/// Takes points out of a sample that were picked at radii below `least`, but not those that
/// [`last_kept`] names.
pub fn unpick(turns: &mut [u16], least: f64) {
    let kept = last_kept(turns);
    for turn in turns.iter_mut().filter(|turn| **turn > kept) {
        if radius_at(*turn) < least {
            *turn = LAST_TURN;
        }
    }
}

/// Last turn whose points a sample keeps in any case: enough for the samples of all cells above, of
/// which each leaves every cell below a point. A node without points would link nothing.
pub fn last_kept(turns: &[u16]) -> u16 {
    let mut picked: Vec<u16> = turns.iter().copied().filter(|&turn| turn != LAST_TURN).collect();
    let Some(last) = picked.len().min(KEPT).checked_sub(1) else { return LAST_TURN };
    *picked.select_nth_unstable(last).1
}

/// Exact local spacings of the points of a sample.
pub fn spacings(sample: &Sample, positions: Vec<[u32; 3]>, scale: [f64; 3]) -> Vec<f32> {
    points(positions, sample, scale).spacings_beyond(0.0)
}

fn points<'a>(positions: Vec<[u32; 3]>, sample: &'a Sample, scale: [f64; 3]) -> Leaf<'a> {
    Leaf {
        positions,
        turns: &sample.turns,
        radii: &sample.radii,
        scale,
        capacity: sample.turns.len(),
        is_part: true,
        taken: &[],
        above: f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::candidates::tests::candidates_of;
    use crate::sample::choose::choose;
    use crate::sample::spacing::radii;
    use esker_points::morton;

    /// Points of a square, evenly spread.
    fn square(count: usize, edge: u32, from: u32) -> impl Iterator<Item = [u32; 3]> {
        let at = move |i: usize, k: f64| ((i as f64 * k).fract() * f64::from(edge)) as u32 + from;
        (1..=count).map(move |i| [at(i, 0.754_877_666_2), at(i, 0.569_840_291), 7])
    }

    /// The sample of so many of the points, and the positions in it.
    fn sample(mut points: Vec<[u32; 3]>, capacity: usize) -> (Sample, Vec<[u32; 3]>) {
        points.sort_unstable_by_key(|&p| morton::encode3(p));
        points.dedup();
        let candidates = candidates_of(&points, [1.0; 3]);
        let turns = choose(&candidates, &[], capacity, f64::from(u32::MAX), 2);
        let is_chosen = |i: &usize| turns[*i] != LAST_TURN;
        let chosen: Vec<usize> = (0..points.len()).filter(is_chosen).collect();
        let positions: Vec<[u32; 3]> = chosen.iter().map(|&i| points[i]).collect();
        let of_sample = candidates_of(&positions, [1.0; 3]);
        let own: Vec<u16> = chosen.iter().map(|&i| turns[i]).collect();
        let last = own.iter().copied().max().unwrap();
        let sample = Sample {
            chosen: chosen.iter().map(|&i| i as u32).collect(),
            radii: radii(&of_sample.shared_log2, 2),
            spacing: radius_at(last) * 1.15,
            turns: own,
        };
        (sample, positions)
    }

    fn least(points: Vec<[u32; 3]>, capacity: usize) -> f64 {
        let (sample, positions) = sample(points, capacity);
        least_radius(&sample, positions.into_iter(), [1.0; 3])
    }

    #[test]
    fn even_points_bound_no_radius() {
        let even = || square(9000, 1_000_000, 0);
        assert_eq!(least(even().collect(), 2000), 0.0);
        assert_eq!(least(even().collect(), 9000), 0.0);
        let outliers = (0..3).map(|i| [i << 26, 1 << 30, 1 << 30]);
        assert_eq!(least(even().chain(outliers).collect(), 2000), 0.0, "strays are no part");
    }

    #[test]
    fn a_sparse_part_bounds_the_radius_by_half_its_distances() {
        // 1000 points that are 31,600 apart, and dense ones in a corner.
        for jump in [30, 100, 1000] {
            let dense = square(9000, 3_000_000 / jump, 0);
            let (sample, positions) =
                sample(dense.chain(square(1000, 1_000_000, 0)).collect(), 3000);
            let least = least_radius(&sample, positions.into_iter(), [1.0; 3]);
            assert!((10_000.0..32_000.0).contains(&least), "{jump}: {least}");
            // The sparse part stays whole.
            let mut turns = sample.turns.clone();
            unpick(&mut turns, least);
            let left = turns.iter().filter(|turn| **turn != LAST_TURN).count();
            assert!((700..1300).contains(&left), "{jump}: {left}");
        }
    }
}
