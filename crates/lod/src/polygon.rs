//! Convex polygons of few corners on a picture: hulls, bounds, clipping to a rectangle. All in
//! `f64`.

use glam::DVec2;

/// Greatest number of corners of a silhouette: a plane leaves at most 7 corners of a box and cuts
/// at most 6 edges; each of the picture's four sides adds at most one.
const CORNERS_MAX: usize = 7 + 6 + 4;

/// A convex polygon of few corners, counterclockwise (clockwise in a picture whose y grows
/// downwards).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Polygon {
    corners: [DVec2; CORNERS_MAX],
    len: usize,
}

impl Default for Polygon {
    fn default() -> Self {
        Self { corners: [DVec2::ZERO; CORNERS_MAX], len: 0 }
    }
}

impl Polygon {
    /// The convex hull of points, if it has at most as many corners as a box's; otherwise their
    /// bounds.
    pub(crate) fn hull_of(points: impl IntoIterator<Item = DVec2>) -> Self {
        let mut polygon = Self::default();
        for p in points {
            if polygon.len == CORNERS_MAX {
                polygon = polygon.convex_hull();
            }
            if polygon.len == CORNERS_MAX {
                polygon = polygon.rectangle();
            }
            polygon.push(p);
        }
        polygon.convex_hull()
    }

    /// Its bounding rectangle.
    fn rectangle(&self) -> Self {
        let Some([low, high]) = self.bounds() else { return *self };
        let corners = [low, DVec2::new(high.x, low.y), high, DVec2::new(low.x, high.y)];
        let mut rectangle = Self::default();
        corners.into_iter().for_each(|c| rectangle.push(c));
        rectangle
    }

    pub(crate) fn corners(&self) -> &[DVec2] {
        &self.corners[..self.len]
    }

    /// Lowest and highest x and y; `None` without corners.
    pub(crate) fn bounds(&self) -> Option<[DVec2; 2]> {
        let low = self.corners().iter().copied().reduce(DVec2::min)?;
        let high = self.corners().iter().copied().reduce(DVec2::max)?;
        Some([low, high])
    }

    /// The part within a rectangle, found by cutting at each side; `None` if that is the whole
    /// polygon.
    pub(crate) fn clipped(&self, low: DVec2, high: DVec2) -> Option<Self> {
        let [least, most] = self.bounds()?;
        let sides = [
            (least.x < low.x, 0, 1.0, low.x),
            (most.x > high.x, 0, -1.0, high.x),
            (least.y < low.y, 1, 1.0, low.y),
            (most.y > high.y, 1, -1.0, high.y),
        ];
        let mut needed = sides.iter().filter(|side| side.0);
        let &(_, axis, sign, at) = needed.next()?;
        let first = self.cut(axis, sign, at);
        Some(needed.fold(first, |p, &(_, axis, sign, at)| p.cut(axis, sign, at)))
    }

    pub(crate) fn push(&mut self, p: DVec2) {
        if let Some(slot) = self.corners.get_mut(self.len) {
            *slot = p;
            self.len += 1;
        }
    }

    /// The convex hull of its corners (Andrew's monotone chain).
    pub(crate) fn convex_hull(&mut self) -> Self {
        let points = &mut self.corners[..self.len];
        // Insertion sort: the points are few and nearly sorted.
        for i in 1..points.len() {
            let mut j = i;
            while j > 0 && is_before(points[j], points[j - 1]) {
                points.swap(j, j - 1);
                j -= 1;
            }
        }
        let mut hull = Self::default();
        for &p in points.iter() {
            hull.turn_to(p, 0);
        }
        let first = hull.len.max(1) - 1;
        for &p in points.iter().rev().skip(1) {
            hull.turn_to(p, first);
        }
        // The last corner equals the first.
        hull.len -= usize::from(hull.len > 1);
        hull
    }

    /// Appends `p`, after removing corners behind `first` that turn the wrong way.
    fn turn_to(&mut self, p: DVec2, first: usize) {
        while self.len >= first + 2 {
            let [a, b] = [self.corners[self.len - 2], self.corners[self.len - 1]];
            if (b - a).perp_dot(p - b) > 0.0 {
                break;
            }
            self.len -= 1;
        }
        self.push(p);
    }

    /// The part where `sign * (p[axis] - at)` is not negative.
    fn cut(&self, axis: usize, sign: f64, at: f64) -> Self {
        let mut kept = Self::default();
        let inside = |p: DVec2| sign * (p[axis] - at);
        for (i, &p) in self.corners().iter().enumerate() {
            let before = self.corners[(i + self.len - 1) % self.len];
            let (from, to) = (inside(before), inside(p));
            if (from < 0.0) != (to < 0.0) {
                let mut crossing = before.lerp(p, from / (from - to));
                crossing[axis] = at;
                kept.push(crossing);
            }
            if to >= 0.0 {
                kept.push(p);
            }
        }
        kept
    }
}

fn is_before(a: DVec2, b: DVec2) -> bool {
    a.x < b.x || (a.x == b.x && a.y < b.y)
}
