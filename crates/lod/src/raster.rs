//! Convex polygons on a grid of rows: coverage by half-planes (pineda1988), solved for x, so that a
//! polygon is one interval a row and each edge is one branch-free loop over arrays. Finds the
//! squares of the grid that a polygon touches, and the samples (centres of squares) that it covers.

use glam::DVec2;
use std::ops::Range;

/// Edges that rise less than this, in rows, add no bound to that of the range of rows.
const FLAT: f32 = 1e-5;
/// Widening of touched intervals against the rounding of `f32`, in squares.
const ROUNDING: f32 = 2e-3;

/// One interval of x a row, on a grid of `SIDE` x `SIDE` squares.
pub(crate) struct Rows<const SIDE: usize> {
    first: usize,
    len: usize,
    low: [f32; SIDE],
    high: [f32; SIDE],
}

impl<const SIDE: usize> Default for Rows<SIDE> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const SIDE: usize> Rows<SIDE> {
    /// An empty value, for repeated use.
    pub(crate) fn new() -> Self {
        Self { first: 0, len: 0, low: [0.0; SIDE], high: [0.0; SIDE] }
    }

    /// Finds the squares that a polygon touches (including its border; slightly more at sharp
    /// corners). The corners go around it counterclockwise; multiplied by `scale` they are in
    /// squares.
    pub(crate) fn touch(&mut self, corners: &[DVec2], scale: DVec2) {
        let Some((low, high)) = bounds(corners, scale) else { return self.clear() };
        let rounding = DVec2::splat(f64::from(ROUNDING));
        let (low, high) = (low - rounding, high + rounding);
        self.start(low.y.floor(), high.y.floor() + 1.0, [low.x, high.x]);
        let (top, bottom) = (low.y as f32, high.y as f32);
        self.cut(corners, scale, |row, from_y, slope| {
            // The part of the row that the polygon covers.
            let [y, below] = [row.max(top), (row + 1.0).min(bottom)].map(|y| (y - from_y) * slope);
            [y.min(below) - ROUNDING, y.max(below) + ROUNDING]
        });
    }

    /// Finds the squares whose centres a polygon covers; corners and scale as in [`Rows::touch`].
    pub(crate) fn cover(&mut self, corners: &[DVec2], scale: DVec2) {
        let Some((low, high)) = bounds(corners, scale) else { return self.clear() };
        self.start((low.y - 0.5).ceil(), (high.y - 0.5).floor() + 1.0, [low.x, high.x]);
        self.cut(corners, scale, |row, from_y, slope| {
            let x = (row + 0.5 - from_y) * slope;
            [x, x]
        });
    }

    fn clear(&mut self) {
        self.len = 0;
    }

    fn start(&mut self, first: f64, end: f64, x: [f64; 2]) {
        let limit = SIDE as f64;
        self.first = first.clamp(0.0, limit) as usize;
        self.len = (end.clamp(0.0, limit) as usize).saturating_sub(self.first);
        self.low[..self.len].fill(x[0] as f32);
        self.high[..self.len].fill(x[1] as f32);
    }

    /// Cuts the intervals at each edge. For a row and a line through x = 0 at `from_y`, `reach`
    /// returns the least and the greatest x that count.
    #[inline(always)]
    fn cut(&mut self, corners: &[DVec2], scale: DVec2, reach: impl Fn(f32, f32, f32) -> [f32; 2]) {
        let (low, high) = (&mut self.low[..self.len], &mut self.high[..self.len]);
        let first = self.first as f32;
        for (i, &to) in corners.iter().enumerate() {
            let from = corners[if i == 0 { corners.len() - 1 } else { i - 1 }];
            let [from, to] = [from * scale, to * scale];
            let rise = (to.y - from.y) as f32;
            let (x, y, slope) = (from.x as f32, from.y as f32, (to.x - from.x) as f32 / rise);
            if rise > FLAT {
                for (k, h) in high.iter_mut().enumerate() {
                    *h = h.min(x + reach(first + k as f32, y, slope)[1]);
                }
            } else if rise < -FLAT {
                for (k, l) in low.iter_mut().enumerate() {
                    *l = l.max(x + reach(first + k as f32, y, slope)[0]);
                }
            }
        }
    }

    /// Row index and touched squares of each row, after [`Rows::touch`].
    pub(crate) fn touched(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.intervals().map(move |(row, low, high)| {
            let end = ((high + 1.0).max(0.0) as usize).min(SIDE);
            (row, (low.max(0.0) as usize).min(end)..end)
        })
    }

    /// Row index and covered samples of each row, after [`Rows::cover`].
    pub(crate) fn covered(&self) -> impl Iterator<Item = (usize, Range<usize>)> + '_ {
        self.intervals().map(move |(row, low, high)| {
            // A sample on the border of two polygons belongs to the left one.
            let [start, end] = [low, high].map(|x| ((x + 0.5).max(0.0) as usize).min(SIDE));
            (row, start..end.max(start))
        })
    }

    fn intervals(&self) -> impl Iterator<Item = (usize, f32, f32)> + '_ {
        let rows = self.low[..self.len].iter().zip(&self.high[..self.len]).enumerate();
        rows.filter(|(_, (low, high))| low <= high)
            .map(|(k, (&low, &high))| (self.first + k, low, high))
    }
}

fn bounds(corners: &[DVec2], scale: DVec2) -> Option<(DVec2, DVec2)> {
    let low = corners.iter().copied().reduce(DVec2::min)? * scale;
    let high = corners.iter().copied().reduce(DVec2::max)? * scale;
    (low.is_finite() && high.is_finite()).then_some((low, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::polygon::Polygon;
    use proptest::prelude::*;

    const SIDE: usize = 24;

    fn hulls() -> impl Strategy<Value = Polygon> {
        let c = prop_oneof![-6.0f64..30.0, (-6i32..30).prop_map(f64::from)];
        prop::collection::vec([c.clone(), c], 1..9)
            .prop_map(|points| Polygon::hull_of(points.into_iter().map(DVec2::from_array)))
    }

    /// Distance of a point from the border of a polygon; negative outside.
    fn depth_inside(corners: &[DVec2], p: DVec2) -> f64 {
        (0..corners.len()).fold(f64::INFINITY, |least, i| {
            let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
            least.min((b - a).perp_dot(p - a) / a.distance(b).max(1e-9))
        })
    }

    fn outline_distance(corners: &[DVec2], p: DVec2) -> f64 {
        (0..corners.len()).fold(f64::INFINITY, |least, i| {
            let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
            let t = (p - a).dot(b - a) / (b - a).length_squared().max(1e-9);
            least.min(p.distance(a.lerp(b, t.clamp(0.0, 1.0))))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn samples_inside_are_covered_and_no_others(polygon in hulls()) {
            let corners = polygon.corners();
            prop_assume!(corners.len() > 2);
            let mut rows = Rows::<SIDE>::new();
            rows.cover(corners, DVec2::ONE);
            let mut covered = [[false; SIDE]; SIDE];
            rows.covered().for_each(|(y, xs)| covered[y][xs].fill(true));
            for (y, row) in covered.iter().enumerate() {
                for (x, &is_covered) in row.iter().enumerate() {
                    let inside = depth_inside(corners, DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
                    prop_assert!(inside.abs() < 1e-4 || is_covered == (inside > 0.0), "{x} {y}: {inside}");
                }
            }
        }

        #[test]
        fn squares_with_a_place_of_the_polygon_are_touched(
            polygon in hulls(), weights in prop::collection::vec([0.01f64..1.0, 0.01..1.0, 0.01..1.0], 50),
        ) {
            let corners = polygon.corners();
            let mut rows = Rows::<SIDE>::new();
            rows.touch(corners, DVec2::ONE);
            let mut touched = [[false; SIDE]; SIDE];
            rows.touched().for_each(|(y, xs)| touched[y][xs].fill(true));
            for (i, w) in weights.iter().enumerate() {
                let [a, b, c] = [0, 1, 2].map(|k| corners[(i + k) % corners.len()]);
                let p = (a * w[0] + b * w[1] + c * w[2]) / (w[0] + w[1] + w[2]);
                if p.cmpge(DVec2::ZERO).all()
                    && p.cmplt(DVec2::splat(SIDE as f64)).all() && depth_inside(corners, p) >= 0.0 {
                    prop_assert!(touched[p.y as usize][p.x as usize], "{p}");
                }
            }
            // Few others: within a square and a half of the polygon.
            for (y, row) in touched.iter().enumerate() {
                for (x, _) in row.iter().enumerate().filter(|(_, t)| **t) {
                    let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    prop_assert!(depth_inside(corners, p) >= 0.0 || outline_distance(corners, p) < 1.5, "{p}");
                }
            }
        }
    }
}
