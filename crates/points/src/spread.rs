//! Distribution of coordinates, as one pass over the points of an input computes it: for each axis
//! a histogram whose bins are as wide as a small fraction of the coordinate. From it follow the
//! bounds of nearly all points, so that a few stray points do not decide the lattice
//! ([`crate::lattice`]). The result does not depend on the order of the points.

use std::collections::BTreeMap;

/// Coordinates of this size and above stand for no value: some programs write the greatest float,
/// or 1e30. No scan is that large in any unit.
pub const NO_VALUE_MIN: f64 = 1e20;

/// Greatest number of bins of an axis; beyond it bins become twice as wide.
const BINS_MAX: usize = 4096;
/// Bits of an ordered double that the narrowest bins ignore: bins of a thousandth of the value.
const SHIFT_MIN: u32 = 42;
/// Bins of an axis that are held beside the others: neighbouring points fall into few bins.
const RECENT: usize = 64;
/// Inputs of fewer points have no strays: each point counts.
const POINTS_MIN: u64 = 20;
/// At most one point in so many is a stray ...
const POINTS_PER_STRAY: u64 = 1000;
/// ... and at most this many points of an input are.
const STRAYS_MAX: u64 = 1000;

/// Steps on each side of the middle of a lattice.
const HALF_STEPS: f64 = ((1u64 << 31) - 2) as f64;

/// Least and greatest coordinates of a box.
pub type Corners = [[f64; 3]; 2];

/// Greatest number of points of an input of `points` points that may lie far from all others
/// without being counted among them.
pub fn strays_max(points: u64) -> u64 {
    if points < POINTS_MIN { 0 } else { (points / POINTS_PER_STRAY).clamp(1, STRAYS_MAX) }
}

/// Distribution of the coordinates of points.
#[derive(Clone, Debug, Default)]
pub struct Spread {
    points: u64,
    axes: [Axis; 3],
    /// Points with a coordinate of [`NO_VALUE_MIN`] or above: their number and bounds.
    no_value: Option<(u64, Corners)>,
}

/// Points between two coordinates of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bin {
    points: u64,
    min: f64,
    max: f64,
}

impl Bin {
    const EMPTY: Self = Self { points: 0, min: f64::INFINITY, max: f64::NEG_INFINITY };

    fn merge(&mut self, other: Self) {
        self.points += other.points;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
    }

    fn is_within(&self, low: f64, high: f64) -> bool {
        low <= self.min && self.max <= high
    }
}

#[derive(Clone, Debug)]
struct Axis {
    shift: u32,
    recent: Vec<(i64, Bin)>,
    bins: BTreeMap<i64, Bin>,
}

impl Default for Axis {
    fn default() -> Self {
        Self { shift: SHIFT_MIN, recent: vec![(0, Bin::EMPTY); RECENT], bins: BTreeMap::new() }
    }
}

/// An integer whose order is that of the doubles.
fn ordered(v: f64) -> i64 {
    let bits = v.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

impl Axis {
    fn add(&mut self, v: f64) {
        let key = ordered(v) >> self.shift;
        let slot = &mut self.recent[(key & (RECENT as i64 - 1)) as usize];
        if slot.0 != key && slot.1.points > 0 {
            let (old, bin) = std::mem::replace(slot, (key, Bin::EMPTY));
            self.put(old, bin);
            // Bins may have become wider.
            return self.add(v);
        }
        slot.0 = key;
        slot.1.merge(Bin { points: 1, min: v, max: v });
    }

    /// Adds a bin of the current width.
    fn put(&mut self, key: i64, bin: Bin) {
        self.bins.entry(key).or_insert(Bin::EMPTY).merge(bin);
        while self.bins.len() > BINS_MAX {
            self.widen();
        }
    }

    fn widen(&mut self) {
        self.shift += 1;
        let recent = std::mem::replace(&mut self.recent, vec![(0, Bin::EMPTY); RECENT]);
        let recent = recent.into_iter().filter(|(_, bin)| bin.points > 0);
        for (key, bin) in std::mem::take(&mut self.bins).into_iter().chain(recent) {
            self.bins.entry(key >> 1).or_insert(Bin::EMPTY).merge(bin);
        }
    }

    /// Moves all points to the map of bins.
    fn settle(&mut self) {
        for at in 0..RECENT {
            let (key, bin) = std::mem::replace(&mut self.recent[at], (0, Bin::EMPTY));
            // Widening empties the slots, so that keys are of the current width.
            if bin.points > 0 {
                self.put(key, bin);
            }
        }
    }

    fn merge(&mut self, mut other: Self) {
        self.settle();
        other.settle();
        while self.shift < other.shift {
            self.widen();
        }
        for (key, bin) in other.bins {
            // `put` may widen the bins.
            self.put(key >> (self.shift - other.shift), bin);
        }
    }

    /// All bins in order.
    fn sorted(&self) -> Vec<Bin> {
        let mut settled = self.clone();
        settled.settle();
        settled.bins.into_values().collect()
    }
}

impl Spread {
    /// Adds a position of finite coordinates.
    pub fn add(&mut self, place: [f64; 3]) {
        if place.iter().any(|c| c.abs() >= NO_VALUE_MIN) {
            self.add_no_value(1, [place; 2]);
            return;
        }
        self.points += 1;
        for (axis, v) in self.axes.iter_mut().zip(place) {
            axis.add(v);
        }
    }

    /// The distribution of two opposite corners of a box that holds all points.
    pub fn of(corners: Option<Corners>) -> Self {
        let mut spread = Self::default();
        corners.into_iter().flatten().for_each(|corner| spread.add(corner));
        spread
    }

    fn add_no_value(&mut self, points: u64, bounds: Corners) {
        let (n, known) = self.no_value.unwrap_or((0, bounds));
        self.no_value = Some((n + points, join(known, bounds)));
    }

    /// Adds the points of another distribution.
    pub fn merge(&mut self, other: Self) {
        self.points += other.points;
        for (axis, other) in self.axes.iter_mut().zip(other.axes) {
            axis.merge(other);
        }
        if let Some((points, bounds)) = other.no_value {
            self.add_no_value(points, bounds);
        }
    }

    /// Number of points, without those whose coordinates stand for no value.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Bounds of all points. Coordinates that stand for no value count only if there are no others.
    pub fn bounds(&self) -> Option<Corners> {
        if self.points == 0 {
            return self.no_value.map(|(_, bounds)| bounds);
        }
        self.bounds_within([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]])
    }

    /// Bounds of the points in bins that lie within `window`.
    pub fn bounds_within(&self, window: Corners) -> Option<Corners> {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for (i, axis) in self.axes.iter().enumerate() {
            for bin in axis.sorted().iter().filter(|bin| bin.is_within(window[0][i], window[1][i]))
            {
                bounds[0][i] = bounds[0][i].min(bin.min);
                bounds[1][i] = bounds[1][i].max(bin.max);
            }
        }
        (0..3).all(|i| bounds[0][i] <= bounds[1][i]).then_some(bounds)
    }

    /// Bounds of all points if they fit a lattice of this scale; else, if nearly all do, the bounds
    /// of those within the lattice around these; else the bounds of all.
    pub fn within_steps(&self, scale: [f64; 3]) -> Option<Corners> {
        let bounds = self.bounds()?;
        let fits = |[low, high]: Corners| {
            (0..3).all(|i| (high[i] - low[i]) / scale[i] <= f64::from(u32::MAX) - 2.0)
        };
        let Some(core) = self.core().filter(|core| !fits(bounds) && fits(*core)) else {
            return Some(bounds);
        };
        let half = scale.map(|s| s * HALF_STEPS);
        let middle = [0, 1, 2].map(|i| core[0][i] / 2.0 + core[1][i] / 2.0);
        let window = |sign: f64| [0, 1, 2].map(|i| middle[i] + sign * half[i]);
        self.bounds_within([window(-1.0), window(1.0)]).or(Some(core))
    }

    /// The narrowest bounds that leave out at most [`strays_max`] points on each axis: bins are
    /// removed from both ends, that farther from the median first.
    pub fn core(&self) -> Option<Corners> {
        let most = strays_max(self.points);
        let mut bounds = self.bounds()?;
        if self.points == 0 {
            return Some(bounds);
        }
        for (i, axis) in self.axes.iter().enumerate() {
            let bins = axis.sorted();
            let median = median(&bins, self.points);
            let (mut first, mut last, mut removed) = (0, bins.len() - 1, 0);
            while first < last {
                let is_low = median - bins[first].min > bins[last].max - median;
                let end = if is_low { first } else { last };
                removed += bins[end].points;
                if removed > most {
                    break;
                }
                if is_low { first += 1 } else { last -= 1 }
            }
            (bounds[0][i], bounds[1][i]) = (bins[first].min, bins[last].max);
        }
        Some(bounds)
    }
}

fn median(bins: &[Bin], points: u64) -> f64 {
    let mut below = 0;
    let half = bins.iter().find(|bin| {
        below += bin.points;
        below > points / 2
    });
    half.map_or(0.0, |bin| bin.min + (bin.max - bin.min) / 2.0)
}

/// The bounds of two boxes.
pub fn join(a: Corners, b: Corners) -> Corners {
    [[0, 1, 2].map(|i| a[0][i].min(b[0][i])), [0, 1, 2].map(|i| a[1][i].max(b[1][i]))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn room(points: u64) -> Spread {
        let mut spread = Spread::default();
        for i in 0..points {
            let t = i as f64 / points as f64;
            spread.add([8.0 * t, 6.0 * (1.0 - t), 3.0 * t * t]);
        }
        spread
    }

    #[test]
    fn a_stray_is_not_in_the_core() {
        for stray in [1e9, -1e9, 60_000.0, 1e19] {
            let mut spread = room(1000);
            spread.add([stray; 3]);
            let [low, high] = spread.core().unwrap();
            assert!(low[0] >= 0.0 && high[0] < 8.0, "{stray}: {low:?} {high:?}");
            let bounds = spread.bounds().unwrap();
            assert_eq!(bounds[usize::from(stray > 0.0)], [stray; 3]);
        }
    }

    #[test]
    fn coordinates_that_stand_for_no_value_do_not_count_beside_others() {
        let mut spread = room(100);
        let bounds = spread.bounds();
        for _ in 0..300 {
            spread.add([f64::from(f32::MAX), 1.0, 1.0]);
        }
        assert_eq!((spread.points(), spread.bounds()), (100, bounds));
        let mut alone = Spread::default();
        alone.add([1e30; 3]);
        assert_eq!(alone.bounds(), Some([[1e30; 3]; 2]));
    }

    #[test]
    fn a_few_points_have_no_strays() {
        let mut spread = room(18);
        spread.add([1e9; 3]);
        assert_eq!(spread.core(), spread.bounds());
    }

    proptest! {
        #[test]
        fn the_order_of_points_does_not_matter(
            values in prop::collection::vec((-1e6..1e6, -1e-3..1e-3, any::<f32>()), 1..3000),
            cut in 0usize..3000,
        ) {
            let place = |&(x, y, z): &(f64, f64, f32)| {
                [x, y, if z.is_finite() { f64::from(z) } else { 0.0 }]
            };
            let mut whole = Spread::default();
            values.iter().for_each(|v| whole.add(place(v)));
            let cut = cut.min(values.len());
            let (mut a, mut b) = (Spread::default(), Spread::default());
            values[..cut].iter().rev().for_each(|v| a.add(place(v)));
            values[cut..].iter().for_each(|v| b.add(place(v)));
            b.merge(a);
            prop_assert_eq!(whole.bounds(), b.bounds());
            prop_assert_eq!(whole.core(), b.core());
            for (one, other) in whole.axes.iter().zip(&b.axes) {
                prop_assert_eq!(one.sorted(), other.sorted());
            }
        }
    }
}
