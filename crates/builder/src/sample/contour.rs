//! The contour of a node (`kanzok2015`, section 3.1): the box around its own points, oriented along
//! their shape if that is flat or long, else along the axes of the lattice, grown by the rounding
//! of hot positions; and masks of the 8 x 8 parts of three of its sides that hold points. The box
//! is not grown by radii: the drawn width of a splat depends on the cut, so the box is grown where
//! splats of hidden centres are drawn.

use crate::sample::shape::{Moments, Shape};
use esker_points::node::{ALL_SIDES, SHAPE_ORIENTED, Sides, pack_rotation};
use esker_points::{Cell, Node};
use fearless_simd::{Level, Simd, dispatch};

/// Points processed together.
const LANES: usize = 4;
/// Parts along an axis.
const PARTS: usize = 8;
/// 2^52: from here to twice as much, the lowest bits of an `f64` are an integer.
const WHOLE: f64 = (1u64 << 52) as f64;

/// Sets contour, occupancy and orientation of `node`, whose cell is set, for these lattice
/// positions. Each is drawn at most `reach`, in the file's unit, off its position. Returns the
/// masks of the other two sides.
pub fn enclose(node: &mut Node, positions: &[[u32; 3]], scale: [f64; 3], reach: f64) -> Sides {
    let cell = Cell { corner: node.corner, log2: node.cell_log2 };
    let shape = Shape::of(Moments::of(positions.iter().copied(), &cell).covariance(scale));
    let oriented = shape.dimension == 1 || shape.dimension == 2;
    let wanted = if oriented { shape.axes } else { upright_axes(positions, scale) };
    let (packed, axes) = pack_rotation(wanted);

    let frame = Frame { corner: node.corner, scale, axes };
    let [low, high] = dispatch!(Level::new(), simd => simd.vectorize(
        #[inline(always)]
        || frame.extent(positions),
    ));
    let middle = [0, 1, 2].map(|i| (low[i] + high[i]) / 2.0);
    let centre: [f32; 3] =
        [0, 1, 2].map(|k| (0..3).map(|i| middle[i] * axes[i][k]).sum::<f64>() as f32);
    // The stored centre is rounded: half extents are measured from the rounded one.
    let about = axes.map(|axis| dot(&axis, centre.map(f64::from)));
    let half = [0, 1, 2].map(|i| {
        let exact = (high[i] - about[i]).max(about[i] - low[i]) + reach;
        (exact * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE
    });

    node.contour_centre = centre;
    node.contour_half = half;
    node.contour_rotation = packed;
    node.shape = (node.shape & !SHAPE_ORIENTED) | if oriented { SHAPE_ORIENTED } else { 0 };
    let across = half.map(|half| 2.0 * f64::from(half));
    let marked = dispatch!(Level::new(), simd => simd.vectorize(
        #[inline(always)]
        || frame.parts(positions, about, across),
    ));
    let mut masks = [0; 3];
    for (i, _) in marked.as_flattened().as_flattened().iter().enumerate().filter(|(_, m)| **m > 0) {
        let (v, u, w) = (i / PARTS / PARTS, i / PARTS % PARTS, i % PARTS);
        [v * PARTS + u, u * PARTS + w, v * PARTS + w]
            .into_iter()
            .zip(&mut masks)
            .for_each(|(bit, mask)| *mask |= 1u64 << bit);
    }
    node.occupancy = masks[0];
    if positions.is_empty() { ALL_SIDES } else { [masks[1], masks[2]] }
}

/// Axes around the corner of a cell. Loops over points are inlined, and so compiled for the vector
/// instructions that are detected at run time.
struct Frame {
    corner: [u32; 3],
    scale: [f64; 3],
    axes: [[f64; 3]; 3],
}

impl Frame {
    /// Coordinates of points along each axis.
    #[inline(always)]
    fn along(&self, points: &[[u32; 3]; LANES]) -> [[f64; LANES]; 3] {
        let (mut local, mut out) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for k in 0..3 {
            for lane in 0..LANES {
                local[k][lane] =
                    f64::from(points[lane][k].wrapping_sub(self.corner[k])) * self.scale[k];
            }
        }
        for (out, axis) in out.iter_mut().zip(&self.axes) {
            for (lane, out) in out.iter_mut().enumerate() {
                *out = dot(axis, [local[0][lane], local[1][lane], local[2][lane]]);
            }
        }
        out
    }

    /// Least and greatest coordinates along each axis; zero if there is no point.
    #[inline(always)]
    fn extent(&self, positions: &[[u32; 3]]) -> [[f64; 3]; 2] {
        let (mut low, mut high) = ([[f64::INFINITY; LANES]; 3], [[f64::NEG_INFINITY; LANES]; 3]);
        for points in in_step(positions) {
            let along = self.along(&points);
            for axis in 0..3 {
                for lane in 0..LANES {
                    let t = along[axis][lane];
                    let (low, high) = (&mut low[axis][lane], &mut high[axis][lane]);
                    *low = if t < *low { t } else { *low };
                    *high = if t > *high { t } else { *high };
                }
            }
        }
        if positions.is_empty() {
            return [[0.0; 3]; 2];
        }
        [
            low.map(|l| l.into_iter().fold(f64::INFINITY, f64::min)),
            high.map(|h| h.into_iter().fold(f64::NEG_INFINITY, f64::max)),
        ]
    }

    /// Marks which of the 8 x 8 x 8 parts of a box around `about`, with the sides `across`, hold
    /// points; indexed by the part along the second axis, the first, the third.
    #[inline(always)]
    fn parts(
        &self,
        positions: &[[u32; 3]],
        about: [f64; 3],
        across: [f64; 3],
    ) -> [[[u8; PARTS]; PARTS]; PARTS] {
        let mut marked = [[[0; PARTS]; PARTS]; PARTS];
        for points in in_step(positions) {
            let along = self.along(&points);
            let mut part = [[0; LANES]; 3];
            for axis in 0..3 {
                for lane in 0..LANES {
                    let fraction = (along[axis][lane] - about[axis]) / across[axis] + 0.5;
                    let whole = (fraction * PARTS as f64).floor().clamp(0.0, PARTS as f64 - 1.0);
                    part[axis][lane] = (whole + WHOLE).to_bits() as usize % PARTS;
                }
            }
            for ((u, v), w) in part[0].into_iter().zip(part[1]).zip(part[2]) {
                marked[v][u][w] = 1;
            }
        }
        marked
    }
}

/// Cuts points into groups of [`LANES`]; the last one is repeated to fill the last group.
#[inline(always)]
fn in_step(positions: &[[u32; 3]]) -> impl Iterator<Item = [[u32; 3]; LANES]> {
    let (some, rest) = positions.as_chunks::<LANES>();
    let last = rest.last().map(|last| {
        let mut points = [*last; LANES];
        points[..rest.len()].copy_from_slice(rest);
        points
    });
    some.iter().copied().chain(last)
}

#[inline(always)]
fn dot(a: &[f64; 3], p: [f64; 3]) -> f64 {
    a[0] * p[0] + a[1] * p[1] + a[2] * p[2]
}

/// Axes of the lattice, the longest extent first, right-handed.
fn upright_axes(positions: &[[u32; 3]], scale: [f64; 3]) -> [[f64; 3]; 3] {
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    for p in positions {
        for i in 0..3 {
            low[i] = low[i].min(p[i]);
            high[i] = high[i].max(p[i]);
        }
    }
    let extent = |i: usize| f64::from(high[i].saturating_sub(low[i])) * scale[i];
    let mut order = [0usize, 1, 2];
    order.sort_by(|&i, &j| extent(j).total_cmp(&extent(i)).then(i.cmp(&j)));
    let unit = |k: usize, sign: f64| {
        let mut axis = [0.0; 3];
        axis[k] = sign;
        axis
    };
    let even = matches!(order, [0, 1, 2] | [1, 2, 0] | [2, 0, 1]);
    [unit(order[0], 1.0), unit(order[1], 1.0), unit(order[2], if even { 1.0 } else { -1.0 })]
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use proptest::prelude::*;

    fn enclosed(positions: &[[u32; 3]], scale: [f64; 3], reach: f64) -> (Node, Sides) {
        let mut node = Node::zeroed();
        let (mut min, mut max) = ([u32::MAX; 3], [0; 3]);
        for p in positions {
            for i in 0..3 {
                min[i] = min[i].min(p[i]);
                max[i] = max[i].max(p[i]);
            }
        }
        let cell = Cell::enclosing(min, max);
        (node.corner, node.cell_log2) = (cell.corner, cell.log2);
        let sides = enclose(&mut node, positions, scale, reach);
        (node, sides)
    }

    #[test]
    fn a_tilted_plane_gets_a_thin_box_and_a_cube_an_upright_one() {
        let plane: Vec<_> =
            (0..900u32).map(|i| [i % 30 * 100, i / 30 * 100, i % 30 * 100]).collect();
        let (node, _) = enclosed(&plane, [0.01; 3], 0.0);
        assert!(node.shape & SHAPE_ORIENTED != 0);
        assert!(node.contour_half[2] < 0.01 * node.contour_half[1], "{:?}", node.contour_half);
        let cube: Vec<_> =
            (0..1000u32).map(|i| [i % 10 * 10, i / 10 % 10 * 10, i / 100 * 10]).collect();
        assert_eq!(enclosed(&cube, [0.01; 3], 0.0).0.shape & SHAPE_ORIENTED, 0);
    }

    proptest! {
        #[test]
        fn every_point_with_its_reach_is_inside_and_marked(positions in prop::collection::vec(any::<[u32; 3]>(), 1..50), small in 0u32..32, reach in 0.0f64..10.0) {
            let positions: Vec<[u32; 3]> = positions.iter().map(|p| p.map(|c| c >> small)).collect();
            let scale = [0.001, 0.001, 0.01];
            let (node, sides) = enclosed(&positions, scale, reach);
            let contour = node.contour();
            for p in &positions {
                let local: Vec<f64> = (0..3).map(|i| f64::from(p[i] - node.corner[i]) * scale[i] - contour.centre[i]).collect();
                let t = contour.axes.map(|a| a[0] * local[0] + a[1] * local[1] + a[2] * local[2]);
                for (t, half) in t.iter().zip(contour.half) {
                    prop_assert!(t.abs() + reach <= half * (1.0 + 1e-9) + 1e-30, "{t} {reach} {half}");
                }
                let part = |i: usize| (((t[i] / (2.0 * contour.half[i]) + 0.5) * 8.0) as u64).min(7);
                prop_assert!(node.occupancy >> (part(1) * 8 + part(0)) & 1 == 1);
                prop_assert!(sides[0] >> (part(0) * 8 + part(2)) & 1 == 1);
                prop_assert!(sides[1] >> (part(1) * 8 + part(2)) & 1 == 1);
            }
        }
    }
}
