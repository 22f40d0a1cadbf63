//! Edges of a depth image: the pixels beside a step from one surface to another or to the background.
//! What goes wrong at silhouettes goes wrong there, so [`crate::mend`], [`crate::trim`] and
//! [`crate::soften`] look at these pixels alone.

use crate::values::{EIGHT, Values, load};
use fearless_simd::{Level, Simd, SimdMask, dispatch, f32x8, mask32x8};
use rayon::prelude::*;

/// Rows that a job has.
const ROWS: usize = 16;

/// The pixels of `depth` (infinite where there is nothing), in their order, of which a neighbour to the
/// side, above or below is farther or nearer by more than the share `near` of its depth.
pub fn edges(depth: &[f32], width: usize, near: f32) -> Vec<usize> {
    let height = depth.len() / width;
    let bands = (0..height).into_par_iter().step_by(ROWS);
    let found: Vec<Vec<usize>> = bands
        .map(|first| {
            let mut found = Vec::new();
            for y in first..height.min(first + ROWS) {
                dispatch!(Level::new(), simd => edges_of_row(simd, depth, width, y, near, &mut found));
            }
            found
        })
        .collect();
    found.concat()
}

/// Adds those of a row.
#[inline(always)]
fn edges_of_row<S: Simd>(
    simd: S,
    depth: &[f32],
    width: usize,
    y: usize,
    near: f32,
    found: &mut Vec<usize>,
) {
    let start = y * width;
    let above = start - if y > 0 { width } else { 0 };
    let below = if start + width < depth.len() { start + width } else { start };
    let here = &depth[start..start + width];
    let (above, below) = (&depth[above..above + width], &depth[below..below + width]);
    for first in (0..width).step_by(EIGHT) {
        if first == 0 || first + EIGHT >= width {
            // Beside the picture there is nothing to step to.
            let step = |a: f32, b: f32| (a - b).abs() > near * a.min(b);
            for x in first..width.min(first + EIGHT) {
                let (left, right) = (here[x.saturating_sub(1)], here[(x + 1).min(width - 1)]);
                if [above[x], below[x], left, right].into_iter().any(|d| step(here[x], d)) {
                    found.push(start + x);
                }
            }
            continue;
        }
        let middle = eight(simd, here, first);
        let across = is_step(middle, eight(simd, here, first - 1), near)
            | is_step(middle, eight(simd, here, first + 1), near);
        let along = is_step(middle, eight(simd, above, first), near)
            | is_step(middle, eight(simd, below, first), near);
        let is_edge = across | along;
        if is_edge.any_true() {
            found.extend((0..EIGHT).filter(|&k| is_edge.test(k)).map(|k| start + first + k));
        }
    }
}

/// Eight of a row, from one on.
#[inline(always)]
fn eight<S: Simd>(simd: S, row: &[f32], first: usize) -> f32x8<S> {
    load(simd, row[first..].first_chunk().unwrap_or(&[f32::INFINITY; EIGHT]))
}

/// Between which depths there is a step. Infinity from infinity is no number, which is no step.
#[inline(always)]
fn is_step<S: Simd>(middle: f32x8<S>, beside: f32x8<S>, near: f32) -> mask32x8<S> {
    (middle.min(beside) * near).cmplt(Values::abs(middle - beside))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sides_of_a_step_are_edges_and_nothing_else_is() {
        const W: usize = 9;
        let inf = f32::INFINITY;
        // Sky, a surface in columns 3 and up with a slope, a nearer square in it.
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
        assert_eq!(found, expected);
    }
}
