//! Edges of a depth image: the pixels beside a step from one surface to another or to the
//! background. [`crate::passes::silhouette`] and [`crate::passes::antialias`] look at these pixels
//! only.

use crate::picture::marks::Marks;
use crate::picture::windows::{eight, rows_around, windows};
use crate::simd::values::{EIGHT, Values, bits};
use fearless_simd::{Level, Simd, dispatch, f32x8, mask32x8};

/// Marks the pixels of `depth` (infinite where there is nothing) whose depth differs from that of
/// the pixel to the left, to the right, above or below by more than the share `near`.
pub fn edges(depth: &[f32], width: usize, near: f32) -> Marks {
    Marks::of_rows(width, depth.len() / width, |y, band| {
        let rows = rows_around(depth, width, y);
        dispatch!(Level::new(), simd => {
            for x in (0..width).step_by(EIGHT) {
                let marks = edges_of_eight(simd, rows, x, near);
                band.add(y * width + x, EIGHT.min(width - x), marks);
            }
        });
    })
}

/// Bit mask of the edges among eight pixels of the middle row.
#[inline(always)]
fn edges_of_eight<S: Simd>(simd: S, rows: [&[f32]; 3], x: usize, near: f32) -> u64 {
    let mut space = [[0.0; _]; 3];
    let [above, here, below] = windows::<_, 3, { EIGHT + 2 }>(rows, x, &mut space);
    let middle = eight(simd, here, 1);
    // Beyond its border the picture is continued, so there is no step.
    let across =
        is_step(middle, eight(simd, here, 0), near) | is_step(middle, eight(simd, here, 2), near);
    let along =
        is_step(middle, eight(simd, above, 1), near) | is_step(middle, eight(simd, below, 1), near);
    u64::from(bits(across | along))
}

/// Mask of the pairs of depths with a step in between. The difference of two infinite depths is
/// NaN, which is no step.
#[inline(always)]
fn is_step<S: Simd>(middle: f32x8<S>, beside: f32x8<S>, near: f32) -> mask32x8<S> {
    (middle.min(beside) * near).cmplt(Values::abs(middle - beside))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn both_sides_of_a_step_are_edges_and_nothing_else_is() {
        const W: usize = 9;
        let inf = f32::INFINITY;
        // Background, a sloped surface from column 3 on, a nearer square in it.
        let depth: Vec<f32> = (0..W * W)
            .map(|i| match (i % W, i / W) {
                (0..3, _) => inf,
                (6..8, 4..6) => 1.0,
                (x, _) => 2.0 + x as f32 * 0.01,
            })
            .collect();
        let found = edges(&depth, W, 0.02);
        let near_square = |x: usize, y: usize| {
            let beside = |v: usize, low: usize, high: usize| v + 1 == low || v == high;
            let inside = (6..8).contains(&x) && (4..6).contains(&y);
            inside
                || (6..8).contains(&x) && beside(y, 4, 6)
                || (4..6).contains(&y) && beside(x, 6, 8)
        };
        let expected: Vec<usize> =
            (0..W * W).filter(|i| matches!(i % W, 2 | 3) || near_square(i % W, i / W)).collect();
        assert_eq!(found.pixels().collect::<Vec<_>>(), expected);
    }
}
