//! Tests a node's contour by parts: those of 8 x 8 x 8 that may hold points, by the masks of its
//! plane (`Node::occupancy`) and of its sides (`NodeTable::sides`). They bound the points much
//! closer than the contour does, so that a node can be culled although its contour reaches into
//! view.

use crate::oriented_box::OrientedBox;
use esker_points::node::Sides;
use glam::DVec3;
use std::ops::Range;

/// Parts along an edge.
const PARTS: u32 = 8;

/// Whether `shows` holds for some part of the contour that may hold points. It is called for the
/// contour and then for ever smaller parts: `shows` must hold for a box if it does for a part of
/// the box.
pub(crate) fn any_part(
    contour: &OrientedBox,
    occupancy: u64,
    sides: Sides,
    shows: &mut impl FnMut(&OrientedBox) -> bool,
) -> bool {
    // A mask without any bit was not computed.
    let or_full = |mask: u64| if mask == 0 { u64::MAX } else { mask };
    let masks = [or_full(occupancy), or_full(sides[0]), or_full(sides[1])];
    search(contour, masks, [0; 2], PARTS, shows)
}

/// Searches the columns over `side` by `side` parts of the plane.
fn search(
    contour: &OrientedBox,
    masks: [u64; 3],
    [u, v]: [u32; 2],
    side: u32,
    shows: &mut impl FnMut(&OrientedBox) -> bool,
) -> bool {
    let row = u64::from(((1u16 << side) - 1) as u8) << u;
    let square = (v..v + side).fold(0, |square, v| square | row << (v * PARTS));
    let heights = heights(masks[1], u, side) & heights(masks[2], v, side);
    if masks[0] & square == 0 || heights == 0 {
        return false;
    }
    let [low, high] = [heights.trailing_zeros(), 8 - heights.leading_zeros()];
    let mut part = |w: Range<u32>| shows(&part(contour, u..u + side, v..v + side, w));
    if !part(low..high) {
        return false;
    }
    let half = side / 2;
    if half == 0 {
        // In a single column, tests each run of parts that may hold points.
        return heights.count_ones() == high - low || runs(heights).any(part);
    }
    [[0, 0], [half, 0], [0, half], [half, half]]
        .iter()
        .any(|[du, dv]| search(contour, masks, [u + du, v + dv], half, shows))
}

/// Parts along the third axis that `count` rows of a side's mask may hold points in, a bit each.
fn heights(mask: u64, first: u32, count: u32) -> u8 {
    mask.to_le_bytes()[first as usize..][..count as usize].iter().fold(0, |all, row| all | row)
}

/// Runs of consecutive bits.
fn runs(mut bits: u8) -> impl Iterator<Item = Range<u32>> {
    std::iter::from_fn(move || {
        let first = bits.trailing_zeros();
        let count = bits.checked_shr(first)?.trailing_ones();
        bits &= !(((1u16 << count) - 1) << first) as u8;
        Some(first..first + count)
    })
}

/// The box of the parts `u`, `v` and `w` (of 8 each) of a contour.
fn part(contour: &OrientedBox, u: Range<u32>, v: Range<u32>, w: Range<u32>) -> OrientedBox {
    let parts = f64::from(PARTS);
    let middle = |r: &Range<u32>| f64::from(r.start + r.end) / parts - 1.0;
    let share = |r: &Range<u32>| f64::from(r.end - r.start) / parts;
    let offset = DVec3::new(middle(&u), middle(&v), middle(&w)) * contour.half;
    OrientedBox {
        centre: contour.centre + contour.axes * offset,
        half: contour.half * DVec3::new(share(&u), share(&v), share(&w)),
        axes: contour.axes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn parts_that_hold_points_are_found_and_those_off_every_mask_are_not(
            points in prop::collection::vec(any::<[u32; 3]>(), 1..40),
            other in any::<[u32; 3]>(),
        ) {
            let part_of = |p: &[u32; 3]| p.map(|c| c >> 29);
            let bits = |[u, v, w]: [u32; 3]| [v * 8 + u, u * 8 + w, v * 8 + w].map(|bit| 1u64 << bit);
            let masks = points.iter().map(part_of).map(bits);
            let masks = masks.fold([0; 3], |a, b| [a[0] | b[0], a[1] | b[1], a[2] | b[2]]);
            let half = DVec3::new(4.0, 2.0, 1.0);
            let contour = OrientedBox { centre: DVec3::ONE, half, axes: DMat3::IDENTITY };
            let finds = |part: [u32; 3]| {
                let middle = DVec3::from(part.map(|c| (f64::from(c) + 0.5) / 4.0 - 1.0)) * half;
                let mut holds = |b: &OrientedBox| {
                    (b.centre - DVec3::ONE - middle).abs().cmple(b.half).all()
                };
                any_part(&contour, masks[0], [masks[1], masks[2]], &mut holds)
            };
            prop_assert!(points.iter().map(part_of).all(finds));
            let other = part_of(&other);
            let may_hold = bits(other).iter().zip(masks).all(|(bit, mask)| bit & mask != 0);
            prop_assert_eq!(finds(other), may_hold);
        }
    }
}
