//! Planes that meet in a block of cells. One plane for a block with an edge would lie across it. The
//! eight parts of 2 x 2 x 2 cells around the middle one each get a plane; where the planes of flat
//! parts differ, the points of the block are distributed to two or three of them, and the planes are
//! fitted again, as k-means does with centres. They count only if they explain the block far better
//! than one plane.

use crate::attributes::blocks::plane::{Moments, Plane, Spread, add, moments};

/// Points of a part, at least.
const PART: f64 = 6.0;
/// Least variance of a part over the sum of all three, at most.
const BROAD: f64 = 0.1;
/// Square of the cosine of the angle from which two planes are an edge: 25 degrees.
const EDGE_COS2: f64 = 0.82;
/// Variance of a part over that of the block, at most: parts of planes under noise are no finer
/// than the whole.
const FINER: f64 = 0.25;
/// Variance around all planes over that around one, at most. Two planes through a volume leave
/// more.
const EXPLAINED: f64 = 0.08;
/// Square of the distance of points from the planes of parts, over the variance of the block, above
/// which they belong to another plane.
const FAR: f64 = 0.5;
/// Planes that meet, at most: those of a corner of a box.
const PLANES: usize = 3;
/// How often points are distributed and planes are fitted again.
const ROUNDS: usize = 3;

/// Finds the planes that meet in a block, at least two; `None` if it has no edge. `whole` is the
/// plane of all its points, `cells` has the moments of its cells, x first, `points` returns its
/// points in steps.
pub fn planes(
    whole: &Plane,
    cells: &[&Moments; 27],
    points: impl FnOnce() -> Vec<[f64; 3]>,
    scale: [f64; 3],
) -> Option<Vec<Plane>> {
    let mut planes = planes_of_parts(whole, cells, scale);
    if planes.is_empty() {
        return None;
    }
    let points = points();
    while planes.len() < PLANES
        && let Some(plane) = plane_of_rest(&planes, whole, &points, scale)
    {
        planes.push(plane);
    }
    for _ in 0..ROUNDS {
        if planes.len() < 2 {
            return None;
        }
        let mut sums = [[0.0; 10]; PLANES];
        for &p in &points {
            add(&mut sums[nearest(&planes, p).0], &moments(p));
        }
        let fitted = sums.iter().filter(|sums| sums[0] >= PART);
        let fitted = fitted.filter_map(|sums| Plane::of(sums, scale));
        planes = fitted.filter(|plane| plane.spread == Spread::Plane).collect();
    }
    let squares: f64 = points.iter().map(|&p| nearest(&planes, p).1).sum();
    let free = points.len() as f64 - 3.0 * planes.len() as f64;
    (squares <= EXPLAINED * whole.variance * free && has_edge(&planes)).then_some(planes)
}

/// Index of the plane nearest to a point, and the square of its distance.
fn nearest(planes: &[Plane], p: [f64; 3]) -> (usize, f64) {
    let squares = planes.iter().map(|plane| plane.square_distance(p)).enumerate();
    squares.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f64::INFINITY))
}

fn is_edge(a: &Plane, b: &Plane) -> bool {
    a.square_cosine(b) < EDGE_COS2
}

fn has_edge(planes: &[Plane]) -> bool {
    planes.iter().enumerate().any(|(i, a)| planes[..i].iter().any(|b| is_edge(a, b)))
}

/// Planes of the finest parts that differ from each other.
fn planes_of_parts(whole: &Plane, cells: &[&Moments; 27], scale: [f64; 3]) -> Vec<Plane> {
    let sums = parts(cells);
    let flat = |sums: &Moments| {
        let plane = Plane::of(sums, scale).filter(|plane| plane.spread == Spread::Plane)?;
        let is_flat = plane.share <= BROAD && plane.variance <= FINER * whole.variance;
        is_flat.then_some(plane)
    };
    let mut flat: Vec<Plane> = sums.iter().filter(|s| s[0] >= PART).filter_map(flat).collect();
    flat.sort_by(|a, b| a.variance.total_cmp(&b.variance));
    let mut planes: Vec<Plane> = Vec::with_capacity(PLANES);
    for plane in flat {
        if planes.len() < PLANES && planes.iter().all(|other| is_edge(&plane, other)) {
            planes.push(plane);
        }
    }
    planes
}

/// Plane of the points that are far from all planes: near an edge, all parts but those of one side
/// may have points of both sides.
fn plane_of_rest(
    planes: &[Plane],
    whole: &Plane,
    points: &[[f64; 3]],
    scale: [f64; 3],
) -> Option<Plane> {
    let mut rest = [0.0; 10];
    for &p in points.iter().filter(|&&p| nearest(planes, p).1 > FAR * whole.variance) {
        add(&mut rest, &moments(p));
    }
    if rest[0] < PART {
        return None;
    }
    let plane = Plane::of(&rest, scale)?;
    (plane.spread == Spread::Plane && plane.share <= BROAD).then_some(plane)
}

/// Moments of the eight parts of 2 x 2 x 2 cells that contain the middle cell.
fn parts(cells: &[&Moments; 27]) -> [Moments; 8] {
    let both = |a: &Moments, b: &Moments| -> Moments {
        let mut sums = *a;
        add(&mut sums, b);
        sums
    };
    // Pairs of cells along x, of those along y, of those along z.
    let along_x: [Moments; 18] =
        std::array::from_fn(|i| both(cells[i / 2 * 3 + i % 2], cells[i / 2 * 3 + i % 2 + 1]));
    let along_y: [Moments; 12] = std::array::from_fn(|i| {
        let first = i / 4 * 6 + i % 4;
        both(&along_x[first], &along_x[first + 2])
    });
    std::array::from_fn(|i| both(&along_y[i], &along_y[i + 4]))
}
