//! Polygons in plan view: parsed from rings in world units, tested exactly on the lattice. A point
//! is inside a polygon if a ray from it crosses the rings an odd number of times (even-odd rule:
//! holes and islands need no order), or if it is on an edge. It is inside a set of polygons if it
//! is inside any of them. Corners are rounded to 1/256 of a step once; all tests are on integers,
//! so that no point is lost or doubled by rounding.

use super::condition::{FilterError, PARTS, Side, in_parts};
use crate::lattice::Lattice;
use std::str::FromStr;

/// Greatest distance of a corner from the lattice's origin, in steps: products of differences then
/// fit `i128`.
const STEPS_MAX: f64 = (1u64 << 52) as f64;

/// Corners in world units, at least three; the last is joined to the first.
pub type Ring = Vec<[f64; 2]>;

/// One or more polygons, each with one or more rings.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polygon {
    polygons: Vec<Vec<Ring>>,
}

impl Polygon {
    /// A polygon of these rings.
    ///
    /// # Errors
    /// If there is no ring, one has fewer than three corners, or a coordinate is not finite.
    pub fn new(rings: Vec<Ring>) -> Result<Self, FilterError> {
        Self::any_of(vec![rings])
    }

    /// The union of several polygons, each given by its rings.
    ///
    /// # Errors
    /// If there is no polygon, or one is invalid as in [`Polygon::new`].
    pub fn any_of(polygons: Vec<Vec<Ring>>) -> Result<Self, FilterError> {
        let fault = |what: &str| Err(FilterError(format!("the polygon {what}")));
        let is_none = |rings: &Vec<Ring>| rings.is_empty() || rings.iter().any(|r| r.len() < 3);
        if polygons.is_empty() || polygons.iter().any(is_none) {
            return fault("needs at least three corners, as `x,y x,y x,y`");
        }
        if polygons.iter().flatten().flatten().flatten().any(|c| !c.is_finite()) {
            return fault("has a coordinate that is no finite number");
        }
        Ok(Self { polygons })
    }

    /// The polygons; of each its rings.
    pub fn polygons(&self) -> &[Vec<Ring>] {
        &self.polygons
    }

    /// The polygon on a lattice.
    ///
    /// # Errors
    /// If a corner is too far away.
    pub(super) fn on(&self, lattice: &Lattice) -> Result<LatticePolygon, FilterError> {
        let corner = |c: &[f64; 2]| {
            let steps = [0, 1].map(|axis| lattice.steps_axis(axis, c[axis]));
            if steps.iter().any(|s| s.is_nan() || s.abs() > STEPS_MAX) {
                let [x, y] = c;
                return Err(FilterError(format!(
                    "the polygon's corner {x},{y} is too far from the points; is it in their coordinates?"
                )));
            }
            Ok([0, 1].map(|axis| in_parts(lattice, axis, c[axis])))
        };
        let of_rings = |rings: &Vec<Ring>| {
            let mut edges = Vec::new();
            for ring in rings {
                let corners = ring.iter().map(corner).collect::<Result<Vec<_>, _>>()?;
                let next = corners.iter().cycle().skip(1);
                let apart = corners.iter().zip(next).filter(|(a, b)| a != b);
                edges.extend(apart.map(|(&a, &b)| [a, b]));
            }
            Ok(Edges(edges))
        };
        let polygons = self.polygons.iter().map(of_rings).collect::<Result<_, _>>()?;
        Ok(LatticePolygon { polygons })
    }
}

impl FromStr for Polygon {
    type Err = FilterError;

    /// Parses one ring: two numbers a corner, separated by blanks, commas or line ends
    /// (`x,y x,y x,y`).
    fn from_str(text: &str) -> Result<Self, FilterError> {
        let words = text.split(|c: char| c.is_whitespace() || c == ',' || c == ';');
        let numbers = words.filter(|w| !w.is_empty()).map(|word| {
            let shown: String = word.chars().take(40).collect();
            word.parse::<f64>()
                .map_err(|_| FilterError(format!("the polygon has `{shown}`, which is no number")))
        });
        let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
        if !numbers.len().is_multiple_of(2) {
            let n = numbers.len();
            return Err(FilterError(format!("the polygon has {n} numbers, not two a corner")));
        }
        Self::new(vec![numbers.chunks_exact(2).map(|c| [c[0], c[1]]).collect()])
    }
}

/// Polygons on a lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct LatticePolygon {
    polygons: Vec<Edges>,
}

/// Edges of a polygon on a lattice, in parts of a step.
#[derive(Clone, Debug, PartialEq)]
struct Edges(Vec<[[i64; 2]; 2]>);

/// Side of the line from `a` to `b` that a point is on: positive to the left.
fn turn([a, b]: [[i64; 2]; 2], p: [i64; 2]) -> i128 {
    let from_a = |q: [i64; 2]| [0, 1].map(|i| i128::from(q[i]) - i128::from(a[i]));
    let ([bx, by], [px, py]) = (from_a(b), from_a(p));
    bx * py - by * px
}

/// A lattice point in parts of a step.
fn scaled(p: [u32; 2]) -> [i64; 2] {
    p.map(|c| i64::from(c) * PARTS)
}

impl LatticePolygon {
    /// Whether a lattice point is inside or on an edge.
    pub fn contains(&self, p: [u32; 2]) -> bool {
        self.polygons.iter().any(|polygon| polygon.contains(p))
    }

    /// Side of the points of a box, both corners included.
    pub(super) fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let mut side = Side::Outside;
        for polygon in &self.polygons {
            match polygon.side_of_box(min, max) {
                Side::Inside => return Side::Inside,
                Side::Across => side = Side::Across,
                Side::Outside => {}
            }
        }
        side
    }

    /// The edges that matter for points of a box: those at the same height that are to its right or
    /// cross it.
    pub(super) fn in_box(&self, min: [u32; 3], max: [u32; 3]) -> Self {
        let near = self.polygons.iter().map(|polygon| polygon.in_box(min, max));
        Self { polygons: near.filter(|near| !near.0.is_empty()).collect() }
    }
}

impl Edges {
    fn contains(&self, p: [u32; 2]) -> bool {
        let p = scaled(p);
        let mut inside = false;
        for &edge in &self.0 {
            let [a, b] = edge;
            if p[1] < a[1].min(b[1]) || p[1] > a[1].max(b[1]) || p[0] > a[0].max(b[0]) {
                continue;
            }
            let crosses = (a[1] > p[1]) != (b[1] > p[1]);
            let is_left_of_both = p[0] < a[0].min(b[0]);
            if is_left_of_both {
                inside ^= crosses;
                continue;
            }
            let side = turn(edge, p);
            if side == 0 {
                return true;
            }
            // The ray goes to the right: it crosses an upward edge if the point is on the edge's
            // left.
            inside ^= crosses && (side > 0) == (b[1] > a[1]);
        }
        inside
    }

    fn side_of_box(&self, min: [u32; 3], max: [u32; 3]) -> Side {
        let (low, high) = (scaled([min[0], min[1]]), scaled([max[0], max[1]]));
        let corners = [low, [high[0], low[1]], high, [low[0], high[1]]];
        let touches = |&edge: &[[i64; 2]; 2]| {
            let [a, b] = edge;
            let apart = (0..2).any(|i| a[i].max(b[i]) < low[i] || a[i].min(b[i]) > high[i]);
            let sides = corners.map(|c| turn(edge, c));
            !apart && !sides.iter().all(|&s| s > 0) && !sides.iter().all(|&s| s < 0)
        };
        if self.0.iter().any(touches) {
            Side::Across
        } else if self.contains([min[0], min[1]]) {
            Side::Inside
        } else {
            Side::Outside
        }
    }

    fn in_box(&self, min: [u32; 3], max: [u32; 3]) -> Self {
        let (low, high) = (scaled([min[0], min[1]]), scaled([max[0], max[1]]));
        let decides = |[a, b]: &&[[i64; 2]; 2]| {
            a[1].max(b[1]) >= low[1] && a[1].min(b[1]) <= high[1] && a[0].max(b[0]) >= low[0]
        };
        Self(self.0.iter().filter(decides).copied().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lattice::ORIGIN;
    use proptest::prelude::*;

    /// A polygon whose world coordinates are small whole numbers around the lattice's middle.
    fn polygon(text: &str) -> LatticePolygon {
        text.parse::<Polygon>().unwrap().on(&Lattice::default()).unwrap()
    }

    fn at(c: i64) -> u32 {
        (ORIGIN + c) as u32
    }

    fn contains(polygon: &LatticePolygon, x: i64, y: i64) -> bool {
        polygon.contains([at(x), at(y)])
    }

    #[test]
    fn invalid_polygons_are_refused() {
        for (text, word) in [
            ("0,0 1,1", "three corners"),
            ("0,0 1,1 2", "5 numbers"),
            ("0,0 1,1 x,2", "`x`"),
            ("0,0 1,1 inf,2", "finite"),
        ] {
            let error = text.parse::<Polygon>().unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
        let far: Polygon = "0,0 1e20,0 0,1".parse().unwrap();
        assert!(far.on(&Lattice::default()).unwrap_err().to_string().contains("too far"));
    }

    #[test]
    fn edges_and_corners_are_inside() {
        let triangle = polygon("0,0 10,0 0,10");
        for (x, y) in [(0, 0), (10, 0), (0, 10), (5, 5), (5, 0), (0, 3), (1, 1)] {
            assert!(contains(&triangle, x, y), "{x} {y}");
        }
        for (x, y) in [(6, 5), (-1, 0), (11, 0), (5, -1), (-1, 10), (1, 10)] {
            assert!(!contains(&triangle, x, y), "{x} {y}");
        }
    }

    #[test]
    fn holes_are_outside_whatever_their_order() {
        let square = |a: f64, b: f64| vec![[a, a], [b, a], [b, b], [a, b]];
        for hole in [square(3.0, 7.0), square(3.0, 7.0).into_iter().rev().collect()] {
            let ring = Polygon::new(vec![square(0.0, 10.0), hole]).unwrap();
            let ring = ring.on(&Lattice::default()).unwrap();
            assert!(contains(&ring, 1, 5) && contains(&ring, 3, 5) && !contains(&ring, 5, 5));
        }
    }

    #[test]
    fn corners_between_steps_and_far_away_decide_exactly() {
        let thin = polygon("-4e9,-0.25 4e9,0.25 4e9,-0.25");
        assert!(contains(&thin, 1, 0) && contains(&thin, 0, 0) && !contains(&thin, -1, 0));
    }

    /// Winding number of a convex or any ring by angles, in `f64`: a reference away from edges.
    fn reference(ring: &[[i64; 2]], p: [i64; 2]) -> Option<bool> {
        let mut odd = false;
        for (i, a) in ring.iter().enumerate() {
            let b = ring[(i + 1) % ring.len()];
            let cross = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            let within = (0..2).all(|k| a[k].min(b[k]) <= p[k] && p[k] <= a[k].max(b[k]));
            if cross == 0 && within {
                return None;
            }
            if (a[1] > p[1]) != (b[1] > p[1]) {
                let x = a[0] as f64
                    + (p[1] - a[1]) as f64 / (b[1] - a[1]) as f64 * (b[0] - a[0]) as f64;
                odd ^= x > p[0] as f64;
            }
        }
        Some(odd)
    }

    proptest! {
        #[test]
        fn points_are_inside_as_the_reference_says_and_nodes_as_their_points(
            rings in prop::collection::vec(prop::collection::vec([-12i64..12, -12i64..12], 3..8), 1..4),
            low in [-14i64..14, -14i64..14], extent in [0i64..6, 0i64..6],
        ) {
            let corners = |ring: &Vec<[i64; 2]>| vec![ring.iter().map(|c| c.map(|v| v as f64)).collect()];
            let polygons = rings.iter().map(corners).collect();
            let polygon = Polygon::any_of(polygons).unwrap().on(&Lattice::default()).unwrap();
            let high = [low[0] + extent[0], low[1] + extent[1]];
            let corner = |c: [i64; 2]| [at(c[0]), at(c[1]), 5];
            let (min, max) = (corner(low), corner(high));
            let side = polygon.side_of_box(min, max);
            let near = polygon.in_box(min, max);
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    let inside = contains(&polygon, x, y);
                    prop_assert_eq!(inside, contains(&near, x, y));
                    prop_assert!(inside || side != Side::Inside);
                    prop_assert!(!inside || side != Side::Outside);
                    // On an edge, unless the ring is a single corner.
                    let is_in = |ring: &Vec<[i64; 2]>| {
                        reference(ring, [x, y]).unwrap_or_else(|| ring.iter().any(|c| *c != ring[0]))
                    };
                    prop_assert_eq!(inside, rings.iter().any(is_in));
                }
            }
        }
    }
}
