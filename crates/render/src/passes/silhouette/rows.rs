//! Finds the rims in a row of pixels. Most edges are no rims, which is decided for eight pixels at
//! a time from their neighbours, radii and displacements; [`crate::passes::silhouette::rim`]
//! decides on the others one by one.

use crate::passes::silhouette::rim::{AROUND, PixelAt, PixelEllipse, Rims};
use crate::picture::marks::{Marks, bits};
use crate::picture::windows::{eight, rows_around, windows};
use crate::simd::values::{EIGHT, Values, bits as bits_of, load};
use fearless_simd::{Level as Width, Simd, dispatch, f32x8, mask32x8};
use glam::Vec4;

impl Rims<'_> {
    /// Reports the pixels of `edges` in row `y` that are at a rim, with the result of
    /// [`Rims::beyond`].
    pub fn rims_of_row(
        &self,
        edges: &Marks,
        y: usize,
        mut report: impl FnMut(PixelAt, (usize, u32)),
    ) {
        let width = self.base.width;
        let rows = rows_around(self.depth, width, y);
        dispatch!(Width::new(), simd => {
            for x in (0..width).step_by(EIGHT) {
                let first = PixelAt { index: y * width + x, x, y };
                let edges = edges.run(first.index, EIGHT.min(width - x));
                if edges != 0 {
                    self.rims_of_eight(simd, rows, first, edges, &mut report);
                }
            }
        });
    }

    /// Reports the pixels of `edges` among eight that are at a rim.
    #[inline(always)]
    fn rims_of_eight<S: Simd>(
        &self,
        simd: S,
        rows: [&[f32]; 3],
        first: PixelAt,
        edges: u64,
        report: &mut impl FnMut(PixelAt, (usize, u32)),
    ) {
        let mut space = [[0.0; _]; 3];
        let rows = windows::<_, 3, { EIGHT + 2 }>(rows, first.x, &mut space);
        // Most have no rim, which is decided without their radii and displacements.
        let here = eight(simd, rows[1], 1);
        let (_, end) = ends(simd, rows, here);
        if edges & u64::from(bits_of(end)) == 0 {
            return;
        }
        let radius = load(simd, &eight_of(&self.base.tint, first.index).map(|tint| tint.w));
        let (ways, end) = ends(simd, rows, here * (radius * self.per_focal + 1.0));
        let mut among = edges & u64::from(bits_of(end));
        if among == 0 {
            return;
        }
        let fronts = eight_of(&self.base.front, first.index);
        let x = load(simd, &fronts.map(|front| front.z));
        let y = load(simd, &fronts.map(|front| front.w));
        let ellipse =
            PixelEllipse { radius, away: [x, y], has_normal: !self.base.normal.is_empty() };
        let mut sticks_out = ellipse.sticks_out(0);
        for (is_end, line) in ways.into_iter().zip(1..) {
            sticks_out |= is_end & ellipse.sticks_out(line);
        }
        among &= u64::from(bits_of(sticks_out & ellipse.may_stick_out()));
        for k in bits(among) {
            let place = PixelAt { index: first.index + k, x: first.x + k, y: first.y };
            if let Some(rim) = self.beyond(place) {
                report(place, rim);
            }
        }
    }
}

/// For each direction and for any, whether the neighbours of eight pixels in it and in both
/// directions beside it lie behind `depth`.
#[inline(always)]
fn ends<S: Simd>(
    simd: S,
    rows: [&[f32; EIGHT + 2]; 3],
    depth: f32x8<S>,
) -> ([mask32x8<S>; 8], mask32x8<S>) {
    // Loops, since closures would not be compiled for the processor.
    let mut is_behind = [depth.cmplt(depth); 8];
    for (is_behind, [dx, dy]) in is_behind.iter_mut().zip(AROUND) {
        *is_behind = depth.cmplt(eight(simd, rows[(dy + 1) as usize], (dx + 1) as usize));
    }
    let (mut ways, mut any) = (is_behind, is_behind[0]);
    for i in 0..8 {
        ways[i] = is_behind[(i + 7) % 8] & is_behind[i] & is_behind[(i + 1) % 8];
        any = if i == 0 { ways[i] } else { any | ways[i] };
    }
    (ways, any)
}

/// Eight pixels of a plane from `first` on; zeros behind its end.
#[inline(always)]
fn eight_of(plane: &[Vec4], first: usize) -> [Vec4; EIGHT] {
    let plane = &plane[first..];
    let copied = || std::array::from_fn(|k| plane.get(k).copied().unwrap_or_default());
    plane.first_chunk().copied().unwrap_or_else(copied)
}
