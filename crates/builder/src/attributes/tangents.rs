//! Estimates the shapes of splats from positions: the distance of points along their surface, in
//! each direction. Scan lines are far apart, their points close together; an ellipse as wide as
//! points are apart closes the gaps between lines and keeps what they resolve.
//!
//! The shape is given by the second moments of the cell that a point has among its nearest
//! neighbours and their mirror images, since splats are symmetric. Variances of neighbours would
//! not show it, for these fill a circle however they are spread. See docs/design/building.md.

use crate::attributes::knn::{Query, sorted_codes};
use crate::attributes::knn_index::KnnIndex;
use crate::attributes::normals::{Bounds, NEIGHBOURS, NEIGHBOURS_MAX, flattest, joined};
use esker_points::quant::oct_decode;
use esker_points::tangents::{ASPECT_MAX, Shape};

/// Distance from the tangent plane over the distance along it, above which a neighbour belongs to
/// another surface.
const OFF: f64 = 1.0;
/// Greatest share of the variance of neighbours across the plane that fits them best: points that
/// scatter more are no surface, and the few of them near the plane would make spikes.
const ROUGH: f64 = 0.1;
/// Range of distances, over the length of the cell along its long axis, within which there is a
/// neighbour that lies within 45 degrees of that axis: the next line. Otherwise it is noise of the
/// points on one scan line that closes the cell across it, and the long axis has any direction.
const REACHED: [f64; 2] = [0.75, 1.5];
/// Greatest length of a cell over its width: ellipses of lines that are farther apart do not reach
/// the next line, and would look like teeth of a saw.
const LONGEST: f64 = 10.0;
/// Half the side of the square that bounds a cell, in mean distances of points.
const BOUND: f64 = 3.0;
/// Largest number of corners of a cell: each neighbour cuts one off on each side.
const CORNERS: usize = 2 * NEIGHBOURS_MAX + 8;

type Vec2 = [f64; 2];
type Vec3 = [f64; 3];

/// Shape of a splat that is not known to be elongated.
pub const ROUND: Shape = Shape { along: [0.0; 3], apart: 0.0, aspect: 1.0 };

/// Estimates the shapes of `own` points, whose normals have the codes `normals`. Points are as in
/// [`crate::attributes::normals::estimate`].
pub fn shapes(
    own: &[[u32; 3]],
    halo: &[[u32; 3]],
    bounds: &Bounds,
    normals: &[[i16; 2]],
) -> Vec<Shape> {
    let (points, place_of) = joined(own, &sorted_codes(halo));
    let mut normal_of = vec![None; points.len()];
    for (&place, &code) in place_of.iter().zip(normals) {
        let normal = oct_decode(code);
        normal_of[place as usize] = Some(normal).filter(|n| *n != [0.0; 3]);
    }
    let query = Query { count: NEIGHBOURS, count_max: NEIGHBOURS_MAX, reach: bounds.reach };
    let estimate = |place: usize, steps: &[Vec3]| {
        let normal: [f32; 3] = normal_of[place]?;
        shape(steps, bounds.scale, normal.map(f64::from))
    };
    let found = KnnIndex::new(&points, bounds.scale).map_placed(
        &query,
        |place| normal_of[place].is_some(),
        |place, found| estimate(place, found.steps),
        ROUND,
    );
    place_of.into_iter().map(|place| found[place as usize]).collect()
}

/// Shape of a point with neighbours at the offsets `steps`; `None` if they leave its cell open, are
/// no surface, or no next line bounds the cell.
fn shape(steps: &[Vec3], scale: Vec3, normal: Vec3) -> Option<Shape> {
    let variances = flattest(steps, scale).map(|(_, variances)| variances);
    if variances.is_some_and(|of| of[2] > ROUGH * of.iter().sum::<f64>()) {
        return None;
    }
    let [u, v] = across(normal);
    let offsets = steps.iter().map(|s| [0, 1, 2].map(|i| s[i] * scale[i]));
    let mut beside: Vec<(f64, Vec2)> = offsets
        .filter_map(|offset| {
            let at = [dot(u, offset), dot(v, offset)];
            let square = at[0] * at[0] + at[1] * at[1];
            let off = dot(normal, offset);
            (square > 0.0 && off * off <= OFF * OFF * square).then_some((square, at))
        })
        .collect();
    // Sorted, so that the order in which they were found does not matter.
    beside.sort_by(|a, b| {
        a.0.total_cmp(&b.0).then(a.1[0].total_cmp(&b.1[0])).then(a.1[1].total_cmp(&b.1[1]))
    });
    let far = beside.last()?.0.sqrt();
    // A circle of this radius has `beside.len()` points.
    let mean = far * (std::f64::consts::PI / beside.len() as f64).sqrt();
    let cell = Cell::of(&beside, mean * BOUND)?;
    let [xx, xy, yy] = cell.moments()?;
    // Eigenvalues and the direction of the first.
    let (middle, half) = ((xx + yy) * 0.5, (xx - yy) * 0.5);
    let root = (half * half + xy * xy).sqrt();
    let (most, least) = (middle + root, middle - root);
    let direction = if half > 0.0 { [half + root, xy] } else { [xy, root - half] };
    let length = (direction[0] * direction[0] + direction[1] * direction[1]).sqrt();
    if !(least > 0.0 && length > 0.0) {
        return Some(ROUND);
    }
    let along = [0, 1, 2].map(|i| (u[i] * direction[0] + v[i] * direction[1]) / length);
    // A rectangle with these sides has these moments.
    let sides = [most, least].map(|m| (12.0 * m).sqrt());
    let is_there = beside.iter().any(|(square, at)| {
        let reach = (direction[0] * at[0] + direction[1] * at[1]).abs() / length;
        let is_across = reach * reach >= 0.5 * square;
        is_across && (REACHED[0]..=REACHED[1]).contains(&(reach / sides[0]))
    });
    if !is_there || sides[0] > LONGEST * sides[1] {
        return None;
    }
    let aspect = (sides[0] / sides[1]).sqrt().min(f64::from(ASPECT_MAX));
    Some(Shape { along: along.map(|c| c as f32), apart: sides[0] as f32, aspect: aspect as f32 })
}

/// Corners of a convex polygon around the origin, in order.
#[derive(Clone, Copy)]
struct Cell {
    corners: [Vec2; CORNERS],
    count: usize,
}

impl Cell {
    /// Cell of the origin among `beside` (squared distance and position, the nearest first) and
    /// their mirror images, within a square. `None` if it reaches the corners of the square, and so
    /// is open.
    fn of(beside: &[(f64, Vec2)], bound: f64) -> Option<Self> {
        let mut corners = [[0.0; 2]; CORNERS];
        let square = [[-bound, -bound], [bound, -bound], [bound, bound], [-bound, bound]];
        corners[..4].copy_from_slice(&square);
        let mut cell = Self { corners, count: 4 };
        for &(square, at) in beside {
            // Neighbours more than twice as far as the farthest corner cut nothing.
            if square * 0.25 > cell.farthest() {
                break;
            }
            cell.cut(at, square * 0.5);
            cell.cut(at.map(|c| -c), square * 0.5);
        }
        let open = cell.farthest() > bound * bound;
        (!open).then_some(cell)
    }

    fn corners(&self) -> &[Vec2] {
        &self.corners[..self.count]
    }

    /// Square of the distance of the farthest corner.
    fn farthest(&self) -> f64 {
        self.corners().iter().map(|c| c[0] * c[0] + c[1] * c[1]).fold(0.0, f64::max)
    }

    /// Keeps the part where `dot(at, position) <= limit`.
    fn cut(&mut self, at: Vec2, limit: f64) {
        let over = |c: &Vec2| at[0] * c[0] + at[1] * c[1] - limit;
        let before = *self;
        if before.corners().iter().all(|c| over(c) <= 0.0) {
            return;
        }
        self.count = 0;
        let corners = before.corners();
        for (i, from) in corners.iter().enumerate() {
            let to = &corners[(i + 1) % corners.len()];
            let (a, b) = (over(from), over(to));
            if a <= 0.0 {
                self.add(*from);
            }
            if (a <= 0.0) != (b <= 0.0) {
                let share = a / (a - b);
                self.add([0, 1].map(|k| from[k] + (to[k] - from[k]) * share));
            }
        }
    }

    fn add(&mut self, corner: Vec2) {
        if self.count < CORNERS {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// Second moments xx, xy, yy around the origin, over the area.
    fn moments(&self) -> Option<Vec3> {
        let (mut area, mut sums) = (0.0, [0.0; 3]);
        let corners = self.corners();
        for (i, a) in corners.iter().enumerate() {
            let b = &corners[(i + 1) % corners.len()];
            let cross = a[0] * b[1] - a[1] * b[0];
            area += cross * 0.5;
            sums[0] += cross * (a[0] * a[0] + a[0] * b[0] + b[0] * b[0]) / 12.0;
            sums[1] +=
                cross * (2.0 * (a[0] * a[1] + b[0] * b[1]) + a[0] * b[1] + b[0] * a[1]) / 24.0;
            sums[2] += cross * (a[1] * a[1] + a[1] * b[1] + b[1] * b[1]) / 12.0;
        }
        (area > 0.0).then(|| sums.map(|s| s / area))
    }
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Two unit vectors perpendicular to `n` and to each other (`duff2017`).
fn across(n: Vec3) -> [Vec3; 2] {
    let sign = 1f64.copysign(n[2]);
    let a = -1.0 / (sign + n[2]);
    let b = n[0] * n[1] * a;
    [[1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]], [b, sign + n[1] * n[1] * a, -n[1]]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use nalgebra::{Matrix2, SymmetricEigen, Vector2};
    use proptest::prelude::*;

    /// The nearest points of a plane to its origin, in space.
    fn nearest(mut points: Vec<Vec2>, [u, v]: [Vec3; 2]) -> Vec<Vec3> {
        points.retain(|p| *p != [0.0; 2]);
        points.sort_by(|a, b| (a[0] * a[0] + a[1] * a[1]).total_cmp(&(b[0] * b[0] + b[1] * b[1])));
        points.truncate(NEIGHBOURS);
        points.iter().map(|p| [0, 1, 2].map(|i| u[i] * p[0] + v[i] * p[1])).collect()
    }

    /// Lines `apart` from each other with points one unit apart, each line shifted along itself at
    /// random, seen from one of the points.
    fn lines(apart: f64, turn: f64, random: &mut Random) -> Vec<Vec2> {
        let (sine, cosine) = turn.sin_cos();
        let mut points = Vec::new();
        for line in -9i32..=9 {
            let moved = if line == 0 { 0.0 } else { random.unit() };
            for along in -60i32..=60 {
                let (x, y) = (f64::from(along) + moved, f64::from(line) * apart);
                points.push([x * cosine - y * sine, x * sine + y * cosine]);
            }
        }
        points
    }

    /// Second moments, on a fine grid, of the area that is nearer to the origin than to any point
    /// or mirror image.
    fn sampled(points: &[Vec2], half: f64) -> Matrix2<f64> {
        const STEPS: i32 = 400;
        let (mut sum, mut count) = (Matrix2::zeros(), 0.0);
        for i in -STEPS..=STEPS {
            for j in -STEPS..=STEPS {
                let at = Vector2::new(f64::from(i), f64::from(j)) * (half / f64::from(STEPS));
                let is_nearer = |p: &Vec2| {
                    (p[0] * at.x + p[1] * at.y).abs() <= 0.5 * (p[0] * p[0] + p[1] * p[1])
                };
                if points.iter().all(is_nearer) {
                    sum += at * at.transpose();
                    count += 1.0;
                }
            }
        }
        sum / count
    }

    const NORMAL: Vec3 = [0.48, 0.6, 0.64];

    #[test]
    fn shapes_are_the_principal_axes_of_cells_in_double_precision() {
        let mut random = Random(1);
        let [u, v] = across(NORMAL);
        for _ in 0..24 {
            let mut points: Vec<Vec2> = Vec::new();
            while points.len() < 60 {
                let p = [random.unit() * 8.0 - 4.0, random.unit() * 8.0 - 4.0];
                if p[0].hypot(p[1]) > 0.3 {
                    points.push(p);
                }
            }
            let steps = nearest(points, [u, v]);
            let Some(found) = shape(&steps, [1.0; 3], NORMAL) else { continue };
            let beside: Vec<Vec2> = steps.iter().map(|s| [dot(*s, u), dot(*s, v)]).collect();
            let eigen = SymmetricEigen::new(sampled(&beside, 4.0));
            let most = usize::from(eigen.eigenvalues[1] > eigen.eigenvalues[0]);
            let sides = [most, 1 - most].map(|i| (12.0 * eigen.eigenvalues[i]).sqrt());
            let aspect = (sides[0] / sides[1]).sqrt().min(f64::from(ASPECT_MAX));
            assert!((f64::from(found.aspect) / aspect - 1.0).abs() < 0.01, "{found:?} {aspect}");
            assert!((f64::from(found.apart) / sides[0] - 1.0).abs() < 0.01, "{found:?} {sides:?}");
            let axis = eigen.eigenvectors.column(most);
            let along = [0, 1, 2].map(|i| u[i] * axis[0] + v[i] * axis[1]);
            let cosine = dot(along, found.along.map(f64::from)).abs();
            assert!(cosine > 1.0 - 0.02 / (aspect - 1.0).max(0.02), "{cosine} {aspect}");
        }
    }

    #[test]
    fn scan_lines_make_ellipses_across_them_where_variances_see_hardly_any() {
        let mut random = Random(2);
        let [u, v] = across(NORMAL);
        for apart in [1.0, 2.0, 3.0, 4.0] {
            let (mut of_cells, mut of_variances, mut off) = (0.0, 0.0, 0f64);
            for i in 0..40 {
                let turn = f64::from(i) * 0.37;
                let steps = nearest(lines(apart, turn, &mut random), [u, v]);
                let found = shape(&steps, [1.0; 3], NORMAL).unwrap_or(ROUND);
                of_cells += f64::from(found.aspect).powi(2) / 40.0;
                let across_lines = [-turn.sin(), turn.cos()];
                let wanted = [0, 1, 2].map(|i| u[i] * across_lines[0] + v[i] * across_lines[1]);
                if apart >= 2.0 {
                    let cosine = dot(wanted, found.along.map(f64::from)).abs();
                    off = off.max(cosine.min(1.0).acos().to_degrees());
                }
                let mut variances = Matrix2::zeros();
                for s in &steps {
                    let p = Vector2::new(dot(*s, u), dot(*s, v));
                    variances += p * p.transpose();
                }
                let values = SymmetricEigen::new(variances).eigenvalues;
                of_variances += (values.max() / values.min()).sqrt() / 40.0;
            }
            println!(
                "lines {apart} apart: aspects {of_cells:.2} of cells, {of_variances:.2} of variances, off by {off:.1} degrees"
            );
            assert!(of_variances < 1.5, "{apart}: {of_variances}");
            assert!((of_cells / apart - 1.0).abs() < 0.2, "{apart}: {of_cells}");
            assert!(off < 12.0, "{apart}: {off}");
        }
    }

    #[test]
    fn noise_of_points_on_one_line_makes_no_shape() {
        let mut random = Random(3);
        let [u, v] = across(NORMAL);
        for apart in [2.0, 4.0, 14.0, 1e3] {
            let mut elongated = 0;
            for _ in 0..100 {
                let mut points = lines(apart, 0.0, &mut random);
                points.iter_mut().for_each(|p| p[1] += (random.unit() - 0.5) * 0.8);
                points.retain(|p| p[0] != 0.0 && p[0].abs() < 30.0);
                let mut steps = nearest(points, [u, v]);
                // Of lines that are far apart only one is found.
                steps.retain(|s| dot(*s, v).abs() < 0.5 * apart || apart < 10.0);
                let found = shape(&steps, [1.0; 3], NORMAL).unwrap_or(ROUND);
                elongated += usize::from(found.aspect > 1.3);
            }
            assert!((elongated > 60) == (apart < 10.0), "{apart}: {elongated}");
            assert!(elongated < 5 || apart < 10.0, "{apart}: {elongated}");
        }
    }

    #[test]
    fn points_of_a_volume_make_no_shape() {
        let mut random = Random(4);
        let mut elongated = 0;
        for _ in 0..200 {
            let mut steps: Vec<Vec3> =
                (0..300).map(|_| [0; 3].map(|_: i32| random.unit() * 2.0 - 1.0)).collect();
            steps.sort_by(|a, b| dot(*a, *a).total_cmp(&dot(*b, *b)));
            steps.truncate(NEIGHBOURS);
            elongated +=
                usize::from(shape(&steps, [1.0; 3], NORMAL).is_some_and(|s| s.aspect > 1.3));
        }
        assert!(elongated < 6, "{elongated} of 200");
    }

    #[test]
    fn open_cells_and_points_of_other_surfaces_make_no_shape() {
        let [u, _] = across(NORMAL);
        let line: Vec<Vec3> =
            (1..=8).flat_map(|i| [f64::from(i), -f64::from(i)]).map(|t| u.map(|c| c * t)).collect();
        assert_eq!(shape(&line, [1.0; 3], NORMAL), None);
        assert_eq!(shape(&[], [1.0; 3], NORMAL), None);
        // Points above and below the plane only.
        let over: Vec<Vec3> = (1..=8).map(|i| NORMAL.map(|c| c * f64::from(i))).collect();
        assert_eq!(shape(&over, [1.0; 3], NORMAL), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn a_cloud_cut_into_chunks_has_the_same_shapes(points in prop::collection::vec([0u32..300, 0u32..300, 0u32..20], 1..500), cut in 0u32..300) {
            let bounds = Bounds { scale: [1.0, 1.0, 2.0], reach: 40.0 };
            let mut all = points;
            all.sort_by_key(|&p| esker_points::morton::encode3(p));
            let of = |own: &[[u32; 3]], halo: &[[u32; 3]]| {
                let normals = crate::attributes::normals::estimate(own, halo, &bounds);
                shapes(own, halo, &bounds, &normals)
            };
            let whole = of(&all, &[]);
            let steps = bounds.steps();
            for side in [false, true] {
                let is_own = |p: &[u32; 3]| (p[0] < cut) == side;
                let own: Vec<_> = all.iter().copied().filter(is_own).collect();
                let near = |p: &&[u32; 3]| if side { p[0] < cut + steps[0] } else { p[0] + steps[0] >= cut };
                let halo: Vec<_> = all.iter().filter(near).copied().filter(|p| !is_own(p)).collect();
                let expected: Vec<_> = all.iter().zip(&whole).filter(|(p, _)| is_own(p)).map(|(_, &s)| s).collect();
                prop_assert_eq!(of(&own, &halo), expected);
            }
        }
    }
}
