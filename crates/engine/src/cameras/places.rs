//! Places of points along an axis, without strays: for ranges of heights and for views that are
//! fitted. Points are assumed to be evenly spread over their node's contour; those of a few long
//! nodes, which a stray may have stretched, are read.

use crate::cameras::ranges::{COARSE, outer};
use anyhow::Result;
use esker_format::{Forest, ForestFilter, OverviewNode, PlaneKind};
use esker_points::Node;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, exact, read_residual};

/// Bins of places.
const BINS: usize = 1024;
/// A node is long from this multiple of the median length.
const LONG: f64 = 2.0;
/// Most long nodes that are read: a stray makes its own node long, and those above it.
const LONG_READ: usize = 12;
/// Most rounds in which places are counted again without strays.
const ROUNDS: usize = 8;
/// Fraction of the points at either end of an axis that fitted views may leave out.
const FIT_STRAYS: f64 = 0.001;
/// An axis is cut if all points take more than this multiple of the length that nearly all take.
const FIT_LONGER: f64 = 4.0;
/// Room at either end of a cut axis, as a part of its length.
const FIT_ROOM: f64 = 0.02;

/// The box that views are fitted to: of all points, `bounds`, or of nearly all where a few points
/// make it much larger.
///
/// # Errors
/// If a node cannot be read.
pub fn fitted_bounds(
    forest: &Forest,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
) -> Result<[[f64; 3]; 2]> {
    let mut fitted = bounds;
    for axis in 0..3 {
        let (low, high) = central_range(forest, bounds, shown, axis, FIT_STRAYS)?;
        let length = high - low;
        if bounds[1][axis] - bounds[0][axis] > FIT_LONGER * length && length > 0.0 {
            fitted[0][axis] = bounds[0][axis].max(low - FIT_ROOM * length);
            fitted[1][axis] = bounds[1][axis].min(high + FIT_ROOM * length);
        }
    }
    Ok(fitted)
}

/// Range of the places of the points that `shown` accepts along axis `axis`, without the outermost
/// ones: up to the fraction `strays` at either end. `bounds` are those of all points.
///
/// # Errors
/// If a node cannot be read.
pub fn central_range(
    forest: &Forest,
    bounds: [[f64; 3]; 2],
    shown: &ForestFilter,
    axis: usize,
    strays: f64,
) -> Result<(f64, f64)> {
    let mut range = (bounds[0][axis], bounds[1][axis]);
    let known = Places::of(forest, shown, axis)?;
    for _ in 0..ROUNDS {
        let cut = known.central(range, strays);
        let is_coarse = cut.1 - cut.0 < (range.1 - range.0) * COARSE;
        range = cut;
        if !is_coarse {
            break;
        }
    }
    Ok(range)
}

/// What places are read from.
const PLANES: [PlaneKind; 2] = [PlaneKind::Position, PlaneKind::Residual];

/// Places of points along an axis.
#[derive(Default)]
struct Places {
    axis: usize,
    /// Ranges of places, and how many points are evenly spread over each.
    spread: Vec<([f64; 2], f64)>,
    /// Places that were read, and how many points each stands for.
    exact: Vec<(f64, f64)>,
}

impl Places {
    /// Places of the points that `shown` accepts.
    fn of(forest: &Forest, shown: &ForestFilter, axis: usize) -> Result<Self> {
        let mut nodes: Vec<_> = forest
            .overview()
            .into_iter()
            .map(|OverviewNode { node, points_below, .. }| {
                let record = forest.record(node);
                let own = record.points().min(shown.points_max(node));
                let is_below = points_below > 0 && !shown.rejects_subtree(node);
                let points = own as u64 + if is_below { points_below } else { 0 };
                (node, extent(forest, record, axis), points)
            })
            .filter(|(.., points)| *points > 0)
            .collect();
        let length = |[low, high]: [f64; 2]| high - low;
        let mut all: Vec<f64> = nodes.iter().map(|(_, of, _)| length(*of)).collect();
        let middle = all.len() / 2;
        let usual = match all.len() {
            // Too few nodes have no usual length.
            0..=3 => 0.0,
            _ => *all.select_nth_unstable_by(middle, f64::total_cmp).1,
        };
        // Those on which the range depends most are read.
        let weight = |&(_, of, points): &(u32, [f64; 2], u64)| match length(of) > LONG * usual {
            true => length(of) * points as f64,
            false => -1.0,
        };
        if nodes.len() > LONG_READ {
            nodes.select_nth_unstable_by(LONG_READ, |a, b| weight(b).total_cmp(&weight(a)));
        }
        let mut known = Self { axis, ..Self::default() };
        let read = nodes.iter().take(LONG_READ).filter(|&node| weight(node) >= 0.0);
        forest.will_read_planes(read.map(|node| node.0), &PLANES);
        for (i, node) in nodes.into_iter().enumerate() {
            let (index, of, points) = node;
            if i < LONG_READ && weight(&node) >= 0.0 {
                // Points below it are where its own are.
                let own = forest.record(index).points().min(shown.points_max(index));
                let weight = if own > 0 { points as f64 / own as f64 } else { 0.0 };
                known.read(forest, shown, index, (own, weight))?;
            } else {
                known.spread.push((of, points as f64));
            }
        }
        Ok(known)
    }

    /// Reads the places of the first `points` points of a node that the filter does not hide; each
    /// counts `weight` times.
    fn read(
        &mut self,
        forest: &Forest,
        shown: &ForestFilter,
        index: u32,
        (points, weight): (usize, f64),
    ) -> Result<()> {
        let (node, axis) = (forest.record(index), self.axis);
        // In a box that a stray has stretched, hot positions alone are coarse.
        let planes = shown.read(forest, index, &PLANES)?;
        let plane = planes.get(PlaneKind::Position).unwrap_or_default();
        let residual = planes.get(PlaneKind::Residual).unwrap_or_default();
        let (hides, [min, _]) = (shown.hides_points(index), node.own_box());
        let points = plane.as_chunks::<HOT_POSITION_BYTES>().0.iter().take(points).enumerate();
        let shown = points.filter(|(_, point)| !hides || point[HIDDEN_AT] == 0);
        self.exact.extend(shown.map(|(i, point)| {
            let hot = u16::from_le_bytes([point[2 * axis], point[2 * axis + 1]]);
            let low = read_residual(residual, i, node.hot_shift)[axis];
            let steps = exact(hot, low, min[axis], node.hot_shift);
            (forest.metric().world_axis(axis, f64::from(steps)), weight)
        }));
        Ok(())
    }

    /// Range without the fraction `strays` at either end; places may be outside `low` to `high`.
    fn central(&self, (low, high): (f64, f64), strays: f64) -> (f64, f64) {
        // One bin more at either end, for places outside the range.
        let mut counts = [0.0; BINS + 2];
        let place = |at: f64| (at - low) / (high - low) * BINS as f64 + 1.0;
        let bin = |place: f64| (place.max(0.0) as usize).min(BINS + 1);
        for &(at, weight) in &self.exact {
            // The greatest place belongs to the last bin.
            counts[if at == high { BINS } else { bin(place(at)) }] += weight;
        }
        for &([from, to], points) in &self.spread {
            let (from, to) = (place(from), place(to));
            let per_bin = points / (to - from);
            let is_all = bin(from) == bin(to);
            for (at, count) in counts.iter_mut().enumerate().take(bin(to) + 1).skip(bin(from)) {
                let begin = if at == 0 { f64::NEG_INFINITY } else { at as f64 };
                let end = if at == BINS + 1 { f64::INFINITY } else { (at + 1) as f64 };
                let share = (to.min(end) - from.max(begin)) * per_bin;
                *count += if is_all { points } else { share };
            }
        }
        let strays = counts.iter().sum::<f64>() * strays;
        if low >= high || strays == 0.0 {
            return (low, high);
        }
        // Bins outside the range do not count.
        let within = |bins: usize| bins.saturating_sub(1) as f64;
        let below = within(outer(counts.into_iter(), strays));
        let above = within(outer(counts.into_iter().rev(), strays));
        let width = (high - low) / BINS as f64;
        (low + width * below, high - width * above)
    }
}

/// Least and greatest place of the contour of a node along an axis.
fn extent(forest: &Forest, node: &Node, axis: usize) -> [f64; 2] {
    let contour = node.contour();
    let reach = (0..3).map(|i| contour.half[i] * contour.axes[i][axis].abs()).sum::<f64>();
    let middle =
        forest.metric().world_axis(axis, f64::from(node.corner[axis])) + contour.centre[axis];
    [middle - reach, middle + reach]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cameras::ranges::STRAYS;

    #[test]
    fn places_are_cut_by_points_wherever_they_were_counted() {
        let even = ([0.0, 100.0], 1000.0);
        let known = Places { spread: vec![even], ..Places::default() };
        let (low, high) = known.central((0.0, 100.0), STRAYS);
        assert!((low - 1.0).abs() < 0.11 && (high - 99.0).abs() < 0.11, "{low} {high}");
        // Half of the points are high: no strays.
        let tower =
            Places { spread: vec![([0.0, 1.0], 500.0), ([1.0, 50.0], 500.0)], ..Places::default() };
        let (low, high) = tower.central((0.0, 50.0), STRAYS);
        assert!(low < 0.06 && high > 48.9, "{low} {high}");
        // A stray far above, and the range around what is left.
        let exact = (0..10_000).map(|i| f64::from(i) * 0.001).chain([1e6]);
        let exact: Vec<_> = exact.map(|at| (at, 1.0)).collect();
        let known = Places { exact, ..Places::default() };
        let (low, high) = known.central((0.0, 1e6), STRAYS);
        assert!(low == 0.0 && high < 1000.0);
        let (low, high) = known.central((0.0, high), STRAYS);
        assert!(low == 0.0 && high < 11.0, "{low} {high}");
        let (low, high) = known.central((0.0, high), STRAYS);
        assert!((low - 0.1).abs() < 0.02 && (high - 9.9).abs() < 0.02, "{low} {high}");
        assert_eq!(Places::default().central((1.0, 2.0), STRAYS), (1.0, 2.0));
    }
}
