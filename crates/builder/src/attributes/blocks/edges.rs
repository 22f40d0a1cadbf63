//! Planes that meet in a block of cells. One plane for a block with an edge would lie across it.
//! The eight parts of 2 x 2 x 2 cells around the middle one each get a plane; where the planes of
//! flat parts differ, or cells are far from them, the cells and then the points of the block are
//! distributed to two or three planes, which are fitted again, as k-means does with centres. They
//! count only if they explain the block far better than one plane.

use crate::attributes::blocks::plane::{Moments, Plane, Spread, add, moments};

/// Points of a part, at least.
const PART: f64 = 6.0;
/// Least variance of a part over the sum of all three, at most.
const BROAD: f64 = 0.1;
/// Least variance over the sum of all three up to which a part stands for a block without planes:
/// groups of leaves are seldom as flat.
const EVEN: f64 = 0.01;
/// Square of the cosine of the angle from which two planes are an edge: 25 degrees.
const EDGE_COS2: f64 = 0.82;
/// Variance of a part over that of the block, at most: parts of planes under noise are no finer
/// than the whole.
const FINER: f64 = 0.25;
/// Square of the distance of cells from the planes of parts, over the variance of the block, above
/// which they belong to another plane.
const FAR: f64 = 0.25;
/// Variance around all planes over that around one, at most. Two planes through a volume leave
/// more.
const EXPLAINED: f64 = 0.08;
/// The same while whole cells belong to planes; most blocks without an edge end there.
const EXPLAINED_BY_CELLS: f64 = 0.25;
/// Least variance of a block over the sum of all three, at most; that of a corner of a box is 1/6.
pub const CORNER: f64 = 0.18;
/// Planes that meet, at most: those of a corner of a box.
const PLANES: usize = 3;

/// Planes that meet, at most [`PLANES`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Planes {
    planes: [Plane; PLANES],
    count: usize,
}

/// Occupied cells of a block: their moments and the means of their points.
struct Occupied<'a> {
    cells: [(&'a Moments, [f64; 3]); 27],
    count: usize,
}

impl<'a> Occupied<'a> {
    fn of(cells: &[&'a Moments; 27]) -> Self {
        let mut occupied = Self { cells: [(cells[0], [0.0; 3]); 27], count: 0 };
        for &cell in cells.iter().filter(|cell| cell[0] > 0.0) {
            let over = 1.0 / cell[0];
            occupied.cells[occupied.count] = (cell, [1, 2, 3].map(|i| cell[i] * over));
            occupied.count += 1;
        }
        occupied
    }

    fn all(&self) -> &[(&'a Moments, [f64; 3])] {
        &self.cells[..self.count]
    }
}

/// Finds the planes that meet in a block, at least two; `None` if it has no edge. `whole` is the
/// plane of all its points, `cells` has the moments of its cells, x first, `fill` puts its points
/// in steps into `points`, which is empty.
pub fn planes(
    whole: &Plane,
    cells: &[&Moments; 27],
    (points, fill): (&mut Vec<[f64; 3]>, impl FnOnce(&mut Vec<[f64; 3]>)),
    scale: [f64; 3],
) -> Option<Planes> {
    if whole.share > CORNER {
        return None;
    }
    let occupied = Occupied::of(cells);
    let planes = planes_from(&parts(cells), whole, &occupied, scale)
        .or_else(|| planes_from(&sides(cells), whole, &occupied, scale))?;
    let cells = occupied;
    let mut sums = [[0.0; 10]; PLANES];
    for (cell, mean) in cells.all() {
        add(&mut sums[planes.nearest(*mean).0], cell);
    }
    let planes = Planes::fitted(&sums, scale)?;
    let count: f64 = sums.iter().map(|sums| sums[0]).sum();
    let squares =
        cells.all().iter().map(|(cell, mean)| planes.nearest_to(*mean).square_distances(cell));
    if squares.sum::<f64>() > EXPLAINED_BY_CELLS * whole.variance * count {
        return None;
    }
    fill(points);
    let mut sums = [[0.0; 10]; PLANES];
    for &p in &*points {
        add(&mut sums[planes.nearest(p).0], &moments(p));
    }
    let planes = Planes::fitted(&sums, scale)?;
    let squares: f64 = points.iter().map(|&p| planes.nearest(p).1).sum();
    let free = count - 3.0 * planes.count as f64;
    (squares <= EXPLAINED * whole.variance * free && planes.has_edge()).then_some(planes)
}

impl Planes {
    /// Fits planes to sums of points; `None` if fewer than two are left.
    fn fitted(sums: &[Moments; PLANES], scale: [f64; 3]) -> Option<Self> {
        let mut planes = Self::default();
        let fitted = sums.iter().filter(|sums| sums[0] >= PART);
        let fitted = fitted.filter_map(|sums| Plane::of(sums, scale));
        fitted.filter(|plane| plane.spread == Spread::Plane).for_each(|plane| planes.push(plane));
        (planes.count > 1).then_some(planes)
    }

    fn all(&self) -> &[Plane] {
        &self.planes[..self.count]
    }

    /// Adds a plane; there must be room.
    fn push(&mut self, plane: Plane) {
        self.planes[self.count] = plane;
        self.count += 1;
    }

    /// The plane nearest to a point.
    pub fn nearest_to(&self, p: [f64; 3]) -> &Plane {
        &self.planes[self.nearest(p).0]
    }

    /// Index of the plane nearest to a point, and the square of its distance.
    fn nearest(&self, p: [f64; 3]) -> (usize, f64) {
        let mut nearest = (0, f64::INFINITY);
        for (i, plane) in self.all().iter().enumerate() {
            let square = plane.square_distance(p);
            if square < nearest.1 {
                nearest = (i, square);
            }
        }
        nearest
    }

    fn has_edge(&self) -> bool {
        let all = self.all();
        all.iter().enumerate().any(|(i, a)| all[..i].iter().any(|b| is_edge(a, b)))
    }
}

fn is_edge(a: &Plane, b: &Plane) -> bool {
    a.square_cosine(b) < EDGE_COS2
}

/// At least two planes, from parts of a block and from the cells that are far from those.
fn planes_from(
    parts: &[Moments],
    whole: &Plane,
    cells: &Occupied<'_>,
    scale: [f64; 3],
) -> Option<Planes> {
    let mut planes = planes_of(parts, whole, scale);
    while (1..PLANES).contains(&planes.count)
        && let Some(plane) = plane_of_rest(&planes, whole, cells, scale)
    {
        planes.push(plane);
    }
    (planes.count > 1).then_some(planes)
}

/// Planes of the flattest parts that differ from each other.
fn planes_of(parts: &[Moments], whole: &Plane, scale: [f64; 3]) -> Planes {
    let mut flat = [Plane::default(); 8];
    let mut count = 0;
    for sums in parts.iter().filter(|sums| sums[0] >= PART) {
        if let Some(plane) = Plane::flat(sums, scale, (BROAD, FINER * whole.variance)) {
            flat[count] = plane;
            count += 1;
        }
    }
    let flat = &mut flat[..count];
    flat.sort_by(|a, b| a.variance.total_cmp(&b.variance));
    let mut planes = Planes::default();
    for plane in flat {
        if planes.count < PLANES && planes.all().iter().all(|other| is_edge(plane, other)) {
            planes.push(*plane);
        }
    }
    planes
}

/// Plane of the flattest of the eight parts of 2 x 2 x 2 cells with `least` points; `None` if none
/// is flat.
pub fn flattest(cells: &[&Moments; 27], least: f64, scale: [f64; 3]) -> Option<Plane> {
    let parts = parts(cells);
    let enough = parts.iter().filter(|sums| sums[0] >= least);
    let flat = enough.filter_map(|sums| Plane::flat(sums, scale, (EVEN, f64::INFINITY)));
    flat.min_by(|a, b| a.share.total_cmp(&b.share))
}

/// Plane of the cells that are far from all planes: near an edge, all parts but those of one side
/// may have points of both sides.
fn plane_of_rest(
    planes: &Planes,
    whole: &Plane,
    cells: &Occupied<'_>,
    scale: [f64; 3],
) -> Option<Plane> {
    let mut rest = [0.0; 10];
    for (cell, mean) in cells.all() {
        if planes.nearest(*mean).1 > FAR * whole.variance {
            add(&mut rest, cell);
        }
    }
    if rest[0] < PART { None } else { Plane::flat(&rest, scale, (BROAD, f64::INFINITY)) }
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

/// Moments of the six sides of 3 x 3 cells: where the middle cell has an edge, all parts have it.
fn sides(cells: &[&Moments; 27]) -> [Moments; 6] {
    std::array::from_fn(|side| {
        let (axis, last) = (side / 2, side % 2 * 2);
        let mut sums = [0.0; 10];
        for (i, cell) in cells.iter().enumerate() {
            if [i % 3, i / 3 % 3, i / 9][axis] == last {
                add(&mut sums, cell);
            }
        }
        sums
    })
}
