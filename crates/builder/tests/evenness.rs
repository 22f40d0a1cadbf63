//! Every prefix of a node, together with the points of its ancestors, is an even sample: compared
//! with a Poisson-disk sample of as many points, the largest gap is at most 1.5 times and the mean
//! distance to the nearest neighbour at least 0.7 times as large. Tested are prefixes with 100
//! points or more of the root, and of the fullest inner node and leaf from the second depth on.
#![allow(clippy::unwrap_used, reason = "tests may unwrap, also outside of test functions")]

mod cloud;
mod poisson;

use cloud::{below, built, cloud, random};
use esker_format::{EskerFile, PlaneKind};
use esker_points::quant::{HOT_POSITION_BYTES, RADIUS_AT, radius_factor};
use esker_points::strata::{STRATA, stratum_len};
use poisson::{Growing, P, Poisson};
use rayon::prelude::*;

/// With fewer points, chance dominates the largest gap.
const POINTS_MIN: usize = 100;

/// Positions of a cloud's points in millimetres, by seed and index.
type Position = fn(u64, u64) -> [i32; 3];

const CLOUDS: [(&str, Position); 6] = [
    ("plane", |seed, i| {
        let (u, v) = (below(seed ^ (3 * i), 40_000), below(seed ^ (3 * i + 1), 30_000));
        [u, v, u / 3 + v / 5]
    }),
    ("volume", |seed, i| [0, 1, 2].map(|axis| below(seed ^ (3 * i + axis), 30_000))),
    ("volume around the origin", |seed, i| {
        [0, 1, 2].map(|axis| below(seed ^ (3 * i + axis), 3_000) - 1_500)
    }),
    ("line", |seed, i| {
        let t = below(seed ^ i, 4_000_000);
        [t, t / 2, t / 4]
    }),
    ("strip", |seed, i| {
        let (t, u) = (below(seed ^ (2 * i), 400_000), below(seed ^ (2 * i + 1), 8_000));
        [t + u / 5, t / 3 - u / 2, t / 9]
    }),
    ("ground", |seed, i| {
        let (x, y) = (below(seed ^ (3 * i), 50_000), below(seed ^ (3 * i + 1), 50_000));
        let (u, v) = (f64::from(x) / 9000.0, f64::from(y) / 11000.0);
        [x, y, (3000.0 * (u.sin() + v.cos() * u.cos())) as i32]
    }),
];

/// Capacity of nodes, and number of points.
const SIZES: [(u32, u64); 4] = [(512, 16_000), (1024, 12_000), (1024, 24_000), (2048, 30_000)];

/// Seeds of clouds; the variable `ESKER_EVENNESS_SEEDS` sets others, in hexadecimal, separated by
/// commas.
const SEEDS: &str = "0,5151";

/// Measures of a prefix over those of a Poisson-disk sample of as many points.
struct Ratio {
    gap: f64,
    nearest: f64,
    what: String,
}

/// A built cloud, and its points in random order.
struct Built {
    name: String,
    file: EskerFile,
    world: Vec<P>,
}

impl Built {
    fn new(name: &str, seed: u64, (capacity, count): (u32, u64), position: Position) -> Self {
        let options = esker_builder::Options { node_capacity: capacity, ..Default::default() };
        let source = cloud("cloud", 0.001, count, move |i| position(seed, i));
        let (_, file, _folder) = built(vec![source], &options);
        let mut world: Vec<P> =
            (0..count).map(|i| position(seed, i).map(|c| f64::from(c) * 0.001)).collect();
        let chance = |p: &P| random(p.iter().fold(seed, |s, c| s.rotate_left(11) ^ c.to_bits()));
        world.sort_by_cached_key(chance);
        let name = format!("{name} of {count}, {capacity} a node, seed {:x}", seed >> 32);
        Self { name, file, world }
    }

    /// The root, and the fullest inner node and leaf below it.
    fn nodes(&self) -> Vec<usize> {
        let table = self.file.table();
        let depths = table.depths();
        let pick = |inner: bool| {
            let fits = |i: &usize| depths[*i] >= 2 && (table.nodes[*i].child_count > 0) == inner;
            (0..table.nodes.len()).filter(fits).max_by_key(|&i| table.nodes[i].points())
        };
        [Some(0), pick(true), pick(false)].into_iter().flatten().collect()
    }

    /// World positions of a node's points.
    fn points(&self, node: usize) -> Vec<P> {
        let page = self.file.read_page(node as u32).unwrap();
        let lattice = self.file.metadata().lattice;
        page.points().unwrap().positions.iter().map(|&p| lattice.world(p)).collect()
    }

    /// Compares the prefixes of a node, with the points of its ancestors in its cell, with samples
    /// of all points of the cell.
    fn compare(&self, node: usize) -> Vec<Ratio> {
        let nodes = &self.file.table().nodes;
        let (cell, lattice) = (nodes[node].cell(), self.file.metadata().lattice);
        let is_inside =
            |p: &P| cell.contains([0, 1, 2].map(|i| lattice.steps_axis(i, p[i]).round() as u32));
        let inside =
            |points: &[P]| -> Vec<P> { points.iter().copied().filter(is_inside).collect() };
        let cloud = inside(&self.world);
        let (mut growing, mut poisson) = (Growing::new(&cloud), Poisson::new(&cloud));
        let mut up = nodes[node].parent;
        while up != esker_points::node::NONE {
            growing.add(&inside(&self.points(up as usize)));
            up = nodes[up as usize].parent;
        }
        let own = self.points(node);
        let (mut prefix, mut ratios) = (0, Vec::new());
        let strata = |n| (0..STRATA).map(move |s| stratum_len(n, s));
        for more in nodes[node].levels().flat_map(strata).filter(|n| *n > 0) {
            growing.add(&own[prefix..prefix + more]);
            prefix += more;
            let sample = growing.spread();
            if sample.points < POINTS_MIN {
                continue;
            }
            let reference = poisson.of(sample.points);
            let over = |ours: f64, theirs: f64| if ours == 0.0 { 0.0 } else { ours / theirs };
            let gap = over(sample.gap, reference.gap);
            let nearest = over(sample.nearest, reference.nearest);
            let what = format!(
                "{}: node {node}, prefix {prefix}, with its ancestors' points {} of {}, against {}: gap {gap:.2}, nearest {nearest:.2}",
                self.name,
                sample.points,
                cloud.len(),
                reference.points
            );
            ratios.push(Ratio { gap, nearest, what });
        }
        ratios
    }
}

#[test]
fn prefixes_with_their_ancestors_are_as_even_as_poisson_disk_samples() {
    let seeds = std::env::var("ESKER_EVENNESS_SEEDS").unwrap_or(SEEDS.into());
    let mut cases = Vec::new();
    for seed in seeds.split(',').map(|s| u64::from_str_radix(s, 16).unwrap() << 32) {
        for size in SIZES {
            cases.extend(CLOUDS.map(|(name, position)| (name, seed, size, position)));
        }
    }
    let compared = cases.into_par_iter().flat_map_iter(|(name, seed, size, position)| {
        let built = Built::new(name, seed, size, position);
        built.nodes().into_iter().flat_map(|node| built.compare(node)).collect::<Vec<_>>()
    });
    let ratios: Vec<Ratio> = compared.collect();
    let widest = ratios.iter().max_by(|a, b| a.gap.total_cmp(&b.gap)).unwrap();
    let nearest = ratios.iter().min_by(|a, b| a.nearest.total_cmp(&b.nearest)).unwrap();
    println!("{} prefixes\nworst: {}\nworst: {}", ratios.len(), widest.what, nearest.what);
    assert!(ratios.len() > 2000 * seeds.split(',').count());
    assert!(widest.gap <= 1.5, "{}", widest.what);
    assert!(nearest.nearest >= 0.7, "{}", nearest.what);
}

/// A road, a wall, a flight strip: however long it is, its points have the radii of a surface.
#[test]
fn radii_of_a_strip_are_those_of_a_square_as_dense() {
    for (capacity, long, wide) in [(65_536, 200, 200), (65_536, 1000, 40), (1024, 2000, 20)] {
        let position = move |i: u64| {
            let (along, across) = ((i / wide) as i32, (i % wide) as i32);
            let shaken = |k: u64| below(2 * i + k, 30);
            [along * 50 + shaken(0), 0, across * 50 + shaken(1)]
        };
        let options = esker_builder::Options { node_capacity: capacity, ..Default::default() };
        let (_, file, _folder) =
            built(vec![cloud("strip", 0.001, long * wide, position)], &options);
        let nodes = &file.table().nodes;
        assert!(nodes.iter().all(|node| node.dimension() == 2), "{long} x {wide}");
        // In leaves, own points and those of ancestors are all points.
        let mut radii = Vec::new();
        for (i, node) in (0..).zip(nodes).filter(|(_, node)| node.child_count == 0) {
            let planes = file.read_planes(i, &[PlaneKind::Position]).unwrap();
            let points = planes.get(PlaneKind::Position).unwrap();
            let points = points.as_chunks::<HOT_POSITION_BYTES>().0;
            radii.extend(points.iter().map(|p| radius_factor(p[RADIUS_AT]) * node.spacing));
        }
        radii.sort_by(f32::total_cmp);
        let median = radii[radii.len() / 2];
        assert!(
            (0.04..0.07).contains(&median),
            "{long} x {wide}: {median} m, where points are 0.05 m apart"
        );
    }
}

/// A floor whose noise crosses a border of cells here and there: the few points beyond it are far
/// apart, but part of the floor.
#[test]
fn points_scattered_beyond_a_cell_border_have_no_wide_radii() {
    let position = |i: u64| {
        let (x, y) = ((i / 400) as i32, (i % 400) as i32);
        let up = if below(i, 500) == 0 { 3 } else { -3 };
        [x * 50 + below(2 * i, 30), y * 50 + below(2 * i + 1, 30), up]
    };
    let options = esker_builder::Options { node_capacity: 4096, ..Default::default() };
    let (_, file, _folder) = built(vec![cloud("floor", 0.001, 160_000, position)], &options);
    let (mut scattered, mut widest) = (0, 0.0f32);
    for (i, node) in (0..).zip(&file.table().nodes) {
        assert_eq!(node.hot_shift, 0, "hot positions are exact");
        let planes = file.read_planes(i, &[PlaneKind::Position]).unwrap();
        let points = planes.get(PlaneKind::Position).unwrap().as_chunks::<HOT_POSITION_BYTES>().0;
        for point in points {
            let z = node.box_min[2] + u32::from(u16::from_le_bytes([point[4], point[5]]));
            if file.metadata().lattice.world([0, 0, z])[2] > 0.0 {
                scattered += 1;
                widest = widest.max(radius_factor(point[RADIUS_AT]));
            }
        }
    }
    assert!(scattered > 200, "{scattered} points beyond the border");
    assert!(widest < 1.8, "a radius of {widest} times its node's spacing");
}

/// A floor that crosses a border of cells by 2 cm: only the root holds the points beyond, and its
/// points are six times as far apart as those of the floor.
#[test]
fn a_floor_that_reaches_over_a_cell_border_is_as_fine_there() {
    let position = |i: u64| [below(2 * i, 20_020) - 20_000, below(2 * i + 1, 20_000), 0];
    let options = esker_builder::Options { node_capacity: 4096, ..Default::default() };
    let (_, file, _folder) = built(vec![cloud("floor", 0.001, 160_000, position)], &options);
    let (mut beyond, mut widest) = (0, 0.0f32);
    for (i, node) in (0..).zip(&file.table().nodes) {
        let planes = file.read_planes(i, &[PlaneKind::Position]).unwrap();
        let points = planes.get(PlaneKind::Position).unwrap().as_chunks::<HOT_POSITION_BYTES>().0;
        for point in points {
            let x = u32::from(u16::from_le_bytes([point[0], point[1]])) << node.hot_shift;
            if file.metadata().lattice.world([node.box_min[0] + x, 0, 0])[0] >= 0.0 {
                assert_eq!(i, 0, "only the root holds them");
                beyond += 1;
                widest = widest.max(radius_factor(point[RADIUS_AT]) * node.spacing);
            }
        }
    }
    assert!(beyond > 100, "{beyond} points beyond the border");
    assert!(widest < 0.15, "{widest} m, where points are 0.05 m apart");
}

/// A sphere that is sampled as evenly as possible and grazes cells: no point of the root is much
/// wider than another.
#[test]
fn a_surface_that_grazes_cells_has_no_wide_radii_in_the_root() {
    const POINTS: u64 = 100_000;
    let position = |i: u64| {
        let (z, turn) =
            (1.0 - (2 * i + 1) as f64 / POINTS as f64, i as f64 * 2.399_963_229_728_653);
        let across = (1.0 - z * z).sqrt();
        [across * turn.cos(), across * turn.sin(), z].map(|c| (c * 1e6) as i32)
    };
    let options = esker_builder::Options::default();
    let (_, file, _folder) = built(vec![cloud("sphere", 1e-6, POINTS, position)], &options);
    let planes = file.read_planes(0, &[PlaneKind::Position]).unwrap();
    let points = planes.get(PlaneKind::Position).unwrap().as_chunks::<HOT_POSITION_BYTES>().0;
    let widest = points.iter().map(|p| radius_factor(p[RADIUS_AT])).fold(0.0, f32::max);
    assert!(points.len() > 10_000 && widest < 2.1, "{} points, {widest} spacings", points.len());
}

/// A few points are no surface: drawn whole, they are dots.
#[test]
fn a_few_points_are_dots() {
    for count in [1, 2, 31, 32] {
        let position = |i: u64| [0, 1, 2].map(|axis| below(3 * i + axis, 3000));
        let options = esker_builder::Options::default();
        let (_, file, _folder) = built(vec![cloud("few", 0.001, count, position)], &options);
        let planes = file.read_planes(0, &[PlaneKind::Position]).unwrap();
        let points = planes.get(PlaneKind::Position).unwrap().as_chunks::<HOT_POSITION_BYTES>().0;
        let widest = points.iter().map(|p| radius_factor(p[RADIUS_AT])).fold(0.0, f32::max);
        assert_eq!(widest < 0.035, count < 32, "{count} points: {widest} spacings");
    }
}
