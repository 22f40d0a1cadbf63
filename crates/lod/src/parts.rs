//! A node's contour by parts: the columns over the 8 x 8 parts of its plane that hold points
//! (`Node::occupancy`). They bound the points much closer than the contour does, so that a node is left out
//! though its contour reaches into view.

use crate::oriented_box::OrientedBox;
use glam::DVec3;
use std::ops::Range;

/// Whether `shows` holds for some occupied column of a contour, asked for the contour and then for ever
/// smaller parts of it: `shows` must hold for a box wherever it does for a part of it.
pub fn any_part(
    contour: &OrientedBox,
    occupancy: u64,
    shows: &mut impl FnMut(&OrientedBox) -> bool,
) -> bool {
    // A mask without any bit is one that nobody made.
    let occupancy = if occupancy == 0 { u64::MAX } else { occupancy };
    search(contour, occupancy, [0, 0], 8, shows)
}

fn search(
    contour: &OrientedBox,
    occupancy: u64,
    [u, v]: [u32; 2],
    side: u32,
    shows: &mut impl FnMut(&OrientedBox) -> bool,
) -> bool {
    let row = u64::from(((1u16 << side) - 1) as u8) << u;
    let square = (v..v + side).fold(0, |square, v| square | row << (v * 8));
    if occupancy & square == 0 || !shows(&part(contour, u..u + side, v..v + side)) {
        return false;
    }
    let half = side / 2;
    half == 0
        || [[0, 0], [half, 0], [0, half], [half, half]]
            .iter()
            .any(|[du, dv]| search(contour, occupancy, [u + du, v + dv], half, shows))
}

/// The column over parts `u` and `v` (of 8) of a contour's plane.
fn part(contour: &OrientedBox, u: Range<u32>, v: Range<u32>) -> OrientedBox {
    let middle = |r: &Range<u32>| f64::from(r.start + r.end) / 8.0 - 1.0;
    let share = |r: &Range<u32>| f64::from(r.end - r.start) / 8.0;
    let offset = DVec3::new(middle(&u), middle(&v), 0.0) * contour.half;
    OrientedBox {
        centre: contour.centre + contour.axes * offset,
        half: contour.half * DVec3::new(share(&u), share(&v), 1.0),
        axes: contour.axes,
    }
}
