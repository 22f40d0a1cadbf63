//! The contour of a node: the box around its own points, oriented along their shape where that is flat
//! enough, else along the lattice's axes (kanzok2015, section 3.1), grown by the rounding of hot positions;
//! and which of 8 x 8 parts of its plane and of its sides hold points. It is not grown by drawn radii: how wide a splat is
//! drawn depends on the cut, so who draws splats whose centres are out of view grows the box then.

use crate::shape::{Moments, Shape};
use esker_points::node::{ALL_SIDES, SHAPE_ORIENTED, Sides, pack_rotation};
use esker_points::{Cell, Node};

/// Points whose parts of the plane are marked before it is asked whether all are.
const LOOKED_AT: usize = 1024;
/// Points whose places are looked at in step.
const LANES: usize = 4;

/// Sets contour, occupancy and orientation of `node` (whose cell is set) for these lattice positions,
/// each of which is drawn at most `reach`, in the file's unit, off its place. Gives the contour's sides.
pub fn enclose(node: &mut Node, positions: &[[u32; 3]], scale: [f64; 3], reach: f64) -> Sides {
    let cell = Cell { corner: node.corner, log2: node.cell_log2 };
    let shape = Shape::of(Moments::of(positions.iter().copied(), &cell).covariance(scale));
    let [x0, y0, z0] = node.corner;
    let local = |&[x, y, z]: &[u32; 3]| {
        let [x, y, z] = [x - x0, y - y0, z - z0];
        [f64::from(x) * scale[0], f64::from(y) * scale[1], f64::from(z) * scale[2]]
    };
    let oriented = shape.dimension == 1 || shape.dimension == 2;
    let wanted = if oriented { shape.axes } else { upright_axes(positions, scale) };
    let (packed, axes) = pack_rotation(wanted);

    let [low, high] = extent(positions, |p| along(&axes, local(p)));
    let middle = [0, 1, 2].map(|i| (low[i] + high[i]) / 2.0);
    let centre: [f32; 3] =
        [0, 1, 2].map(|k| (0..3).map(|i| middle[i] * axes[i][k]).sum::<f64>() as f32);
    // The stored centre is rounded: the box is measured about where it really is.
    let about = along(&axes, centre.map(f64::from));
    let half = [0, 1, 2].map(|i| {
        let exact = (high[i] - about[i]).max(about[i] - low[i]) + reach;
        (exact * (1.0 + 1e-6)) as f32 + f32::MIN_POSITIVE
    });

    node.contour_centre = centre;
    node.contour_half = half;
    node.contour_rotation = packed;
    node.shape = (node.shape & !SHAPE_ORIENTED) | if oriented { SHAPE_ORIENTED } else { 0 };
    let across = half.map(|half| 2.0 * f64::from(half));
    let parts_of = |p: &[u32; 3]| {
        let p = local(p);
        let [u, v, w] = [0, 1, 2].map(|i| {
            let fraction = (dot(&axes[i], p) - about[i]) / across[i] + 0.5;
            ((fraction * 8.0) as i64).clamp(0, 7)
        });
        [v * 8 + u, u * 8 + w, v * 8 + w].map(|bit| 1u64 << bit)
    };
    let mut some = positions.chunks(LOOKED_AT);
    let mut masks = [0; 3];
    // Many nodes have points everywhere, as the first ones show.
    while masks != [u64::MAX; 3]
        && let Some(some) = some.next()
    {
        let join = |a: [u64; 3], b: [u64; 3]| [a[0] | b[0], a[1] | b[1], a[2] | b[2]];
        masks = some.iter().map(parts_of).fold(masks, join);
    }
    node.occupancy = masks[0];
    if positions.is_empty() { ALL_SIDES } else { [masks[1], masks[2]] }
}

/// The least and greatest that a place has of points along each axis; zero of no point.
fn extent(positions: &[[u32; 3]], place: impl Fn(&[u32; 3]) -> [f64; 3]) -> [[f64; 3]; 2] {
    // Several, so that none waits for the one before.
    let (mut low, mut high) = ([[f64::INFINITY; LANES]; 3], [[f64::NEG_INFINITY; LANES]; 3]);
    let mut add = |lanes: [[f64; 3]; LANES]| {
        for axis in 0..3 {
            for lane in 0..LANES {
                let t = lanes[lane][axis];
                let (low, high) = (&mut low[axis][lane], &mut high[axis][lane]);
                *low = if t < *low { t } else { *low };
                *high = if t > *high { t } else { *high };
            }
        }
    };
    let (some, rest) = positions.as_chunks::<LANES>();
    some.iter().for_each(|p| add(p.each_ref().map(&place)));
    rest.iter().for_each(|p| add([place(p); LANES]));
    if positions.is_empty() {
        return [[0.0; 3]; 2];
    }
    [
        low.map(|l| l.into_iter().fold(f64::INFINITY, f64::min)),
        high.map(|h| h.into_iter().fold(f64::NEG_INFINITY, f64::max)),
    ]
}

fn along(axes: &[[f64; 3]; 3], p: [f64; 3]) -> [f64; 3] {
    [dot(&axes[0], p), dot(&axes[1], p), dot(&axes[2], p)]
}

fn dot(a: &[f64; 3], p: [f64; 3]) -> f64 {
    a[0] * p[0] + a[1] * p[1] + a[2] * p[2]
}

/// The lattice's axes, the longest extent first, right-handed.
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
