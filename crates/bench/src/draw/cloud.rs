//! Points to draw, laid out as in a built file: nodes with hot positions and nothing else. A
//! generated cloud is a hilly ground with woods, in Morton order or shuffled. Each of its points is
//! a function of its index, the same on every machine, so that a cloud needs no memory of its own
//! and can be larger than memory.

use anyhow::{Context, Result};
use bytemuck::Zeroable;
use esker_engine::calls::info;
use esker_engine::cameras::camera::Camera;
use esker_format::{Forest, PlaneKind};
use esker_lod::View;
use esker_points::node::NONE;
use esker_points::{Lattice, Node, Task, quant};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Points of a generated node: the builder's default capacity.
const NODE_POINTS: u64 = 65_536;
/// Binary logarithm of the edge of the ground, steps.
const GROUND_LOG2: u32 = 22;
/// Length of a step, metres.
const STEP_M: f64 = 1e-3;
/// Lattice coordinate of the ground's corner.
const CORNER: u32 = 1 << 31;
/// Greatest height of hills and the woods on them, steps.
const HEIGHT: f64 = (1 << GROUND_LOG2) as f64 * 0.06;
/// Nodes that are made in parallel.
const BATCH_NODES: usize = 32;

/// Order of points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// Along a Morton curve over the ground, so that neighbours follow each other.
    Morton,
    /// Shuffled, so that each node has points of the whole ground.
    Random,
}

/// Nodes with their positions.
pub(super) enum Cloud<'a> {
    /// A generated ground with this number of points.
    Ground(u64, Order),
    /// All nodes of a file, in their order.
    File(&'a Forest),
}

impl Cloud<'_> {
    /// Name of the order in reports.
    pub fn order(&self) -> &'static str {
        match self {
            Self::Ground(_, Order::Morton) => "morton",
            Self::Ground(_, Order::Random) => "random",
            Self::File(_) => "file",
        }
    }

    /// Number of points.
    pub fn points(&self) -> u64 {
        (0..self.nodes()).map(|node| self.points_of(node)).sum()
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        match self {
            Self::Ground(points, _) => points.div_ceil(NODE_POINTS) as usize,
            Self::File(file) => file.table().nodes.len(),
        }
    }

    /// Number of points of a node.
    pub fn points_of(&self, node: usize) -> u64 {
        match self {
            Self::Ground(points, _) => (points - node as u64 * NODE_POINTS).min(NODE_POINTS),
            Self::File(file) => file.table().nodes[node].points() as u64,
        }
    }

    /// Lattice of the coordinates.
    pub fn lattice(&self) -> Lattice {
        match self {
            Self::Ground(..) => Lattice {
                scale: [STEP_M; 3],
                offset: [0.0; 3],
                shift: [0; 3],
                ..Lattice::default()
            },
            Self::File(file) => *file.metric(),
        }
    }

    /// A view with all points in the picture, which a ground fills: it is seen from above.
    pub fn view(&self, size: [u32; 2]) -> View {
        match self {
            Self::Ground(..) => {
                let side = f64::from(1u32 << GROUND_LOG2);
                let high = DVec3::new(side, side, HEIGHT) * STEP_M;
                View::fit(DVec3::ZERO, high, DVec3::NEG_Z, 1.0, size[0], size[1])
            }
            Self::File(file) => Camera::of_benchmarks(info::bounds(file), size),
        }
    }

    /// Hands each node with its hot positions to `sink`, in order and on this thread. Nodes are
    /// made or read in parallel.
    ///
    /// # Errors
    /// If a file cannot be read, `sink` fails, or `task` is cancelled.
    pub fn each(
        &self,
        task: &dyn Task,
        mut sink: impl FnMut(Node, Vec<u8>) -> Result<()>,
    ) -> Result<()> {
        for start in (0..self.nodes()).step_by(BATCH_NODES) {
            task.check()?;
            let batch = start..self.nodes().min(start + BATCH_NODES);
            let made: Vec<_> =
                batch.into_par_iter().map(|node| self.node(node)).collect::<Result<_>>()?;
            made.into_iter().try_for_each(|(node, plane)| sink(node, plane))?;
        }
        Ok(())
    }

    fn node(&self, index: usize) -> Result<(Node, Vec<u8>)> {
        match self {
            Self::Ground(points, order) => {
                let first = index as u64 * NODE_POINTS;
                let last = (first + NODE_POINTS).min(*points);
                Ok(lay_out(*points, *order, first..last))
            }
            Self::File(file) => {
                let planes = file.read_planes(index as u32, &[PlaneKind::Position])?;
                let plane = planes.get(PlaneKind::Position).context("a node has no positions")?;
                Ok((file.table().nodes[index], plane.to_vec()))
            }
        }
    }
}

/// Makes the node that holds points `range` of a ground of `points`.
fn lay_out(points: u64, order: Order, range: Range<u64>) -> (Node, Vec<u8>) {
    let at: Vec<[u32; 3]> = range
        .map(|number| match order {
            Order::Morton => number,
            Order::Random => shuffled(number, points),
        })
        .map(|index| ground_point(index, points))
        .collect();
    let fold = |f: fn(u32, u32) -> u32| {
        let corner = at.iter().copied().reduce(|a, b| [0, 1, 2].map(|i| f(a[i], b[i])));
        corner.unwrap_or_default()
    };
    let (low, high) = (fold(u32::min), fold(u32::max));
    let extent = (0..3).map(|i| high[i] - low[i]).max().unwrap_or(0);
    let shift = quant::hot_shift(extent);
    let mut plane = Vec::with_capacity(at.len() * quant::HOT_POSITION_BYTES);
    for p in &at {
        for i in 0..3 {
            plane.extend(quant::hot(p[i], low[i], shift).to_le_bytes());
        }
        // The radius is one spacing.
        plane.extend([128, 0]);
    }
    let spacing = f64::from(1u32 << GROUND_LOG2) / (points as f64).sqrt() * STEP_M;
    let mut node = Node::zeroed();
    (node.corner, node.cell_log2) = (low, (32 - extent.leading_zeros()) as u8);
    (node.box_min, node.hot_shift, node.spacing) = (low, shift, spacing as f32);
    (node.parent, node.occupancy) = (NONE, u64::MAX);
    node.set_levels(&[at.len()]);
    (node, plane)
}

/// Point `index` along the curve. The curve visits a grid of 4^k cells, at least one a point;
/// points are at random places in cells that are evenly distributed along it.
fn ground_point(index: u64, points: u64) -> [u32; 3] {
    let log2 = (0..GROUND_LOG2).find(|k| 1u64 << (2 * k) >= points).unwrap_or(GROUND_LOG2);
    let cell = ((u128::from(index) << (2 * log2)) / u128::from(points.max(1))) as u64;
    let edge = 1u64 << (GROUND_LOG2 - log2);
    let dice = mixed(index);
    let x = gather2(cell) * edge + (dice & 0xffff) * edge / 0x10000;
    let y = gather2(cell >> 1) * edge + (dice >> 16 & 0xffff) * edge / 0x10000;
    let share = |c: u64| c as f64 / f64::from(1u32 << GROUND_LOG2);
    let (u, v) = (share(x), share(y));
    let hills = 0.8 * wave(3.0 * u) * wave(2.0 * v + u) + 0.04 * wave(17.0 * u + 5.0 * v);
    // One point in four of the woods is on the ground.
    let in_woods = wave(7.0 * u + v) * wave(5.0 * v) > 0.3 && dice >> 62 != 0;
    let tree = if in_woods { 0.16 * (dice >> 32 & 0xffff) as f64 / 65_536.0 } else { 0.0 };
    [CORNER + x as u32, CORNER + y as u32, CORNER + ((hills + tree) * HEIGHT) as u32]
}

/// A smooth wave from 0 to 1 with period 1. Its operations round the same on every machine.
fn wave(t: f64) -> f64 {
    let f = t - t.floor();
    let hump = 4.0 * f * (1.0 - f);
    hump * hump
}

/// Permutes the numbers below `points`: invertible rounds on the next power of two, repeated until
/// the result is below `points`.
fn shuffled(number: u64, points: u64) -> u64 {
    let bits = 64 - (points.max(2) - 1).leading_zeros();
    let mask = (1u64 << bits) - 1;
    let mut place = number;
    loop {
        for factor in [0x9e37_79b9_7f4a_7c15u64, 0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb] {
            place = place.wrapping_mul(factor).wrapping_add(factor >> 32) & mask;
            place ^= place >> bits.div_ceil(2);
        }
        if place < points {
            return place;
        }
    }
}

/// Hashes a number to 64 bits (splitmix64).
fn mixed(number: u64) -> u64 {
    let mut z = number.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// Packs every second bit, from the lowest.
fn gather2(code: u64) -> u64 {
    let mut x = code & 0x5555_5555_5555_5555;
    x = (x | x >> 1) & 0x3333_3333_3333_3333;
    x = (x | x >> 2) & 0x0f0f_0f0f_0f0f_0f0f;
    x = (x | x >> 4) & 0x00ff_00ff_00ff_00ff;
    x = (x | x >> 8) & 0x0000_ffff_0000_ffff;
    (x | x >> 16) & 0xffff_ffff
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_points::task::Silent;

    fn all(points: u64, order: Order) -> Vec<[u32; 3]> {
        let place = |n| if order == Order::Random { shuffled(n, points) } else { n };
        (0..points).map(|n| ground_point(place(n), points)).collect()
    }

    #[test]
    fn both_orders_have_the_same_points() {
        for points in [1, 2, 3, 1000, 4096, 70_001] {
            let (mut morton, mut random) = (all(points, Order::Morton), all(points, Order::Random));
            assert!(points < 1000 || morton != random);
            morton.sort_unstable();
            random.sort_unstable();
            assert!(morton == random, "{points}");
        }
    }

    #[test]
    fn neighbours_follow_each_other_in_morton_order_only() {
        let mean_step = |order| {
            let all = all(50_000, order);
            let step =
                |w: &[[u32; 3]]| (0..2).map(|i| w[0][i].abs_diff(w[1][i]) as f64).sum::<f64>();
            all.windows(2).map(step).sum::<f64>() / 50_000.0
        };
        assert!(mean_step(Order::Morton) * 20.0 < mean_step(Order::Random));
    }

    #[test]
    fn all_points_are_in_the_picture() {
        let cloud = Cloud::Ground(100_000, Order::Random);
        let mut points = 0;
        let lattice = cloud.lattice();
        let view = cloud.view([192, 108]);
        cloud
            .each(&Silent, |node, plane| {
                for hot in plane.as_chunks::<8>().0 {
                    let q = [0, 2, 4].map(|i| u16::from_le_bytes([hot[i], hot[i + 1]]));
                    let at =
                        [0, 1, 2].map(|i| quant::exact(q[i], 0, node.box_min[i], node.hot_shift));
                    let seen = view.project(DVec3::from_array(lattice.world(at)));
                    assert!(seen.is_some_and(|p| view.is_on_picture(p)), "{at:?} {seen:?}");
                }
                points += node.points() as u64;
                Ok(())
            })
            .unwrap();
        assert_eq!((points, cloud.points()), (100_000, 100_000));
    }
}
