//! Edges of a depth image: the pixels beside a step from one surface to another or to the background.
//! What goes wrong at silhouettes goes wrong there, so [`crate::mend`], [`crate::trim`] and
//! [`crate::soften`] look at these pixels alone.

use rayon::prelude::*;

/// Rows that a job has.
const ROWS: usize = 16;
/// Pixels that are looked at together.
const RUN: usize = 16;

/// The pixels of `depth` (infinite where there is nothing), in their order, of which a neighbour to the
/// side, above or below is farther or nearer by more than the share `near` of its depth.
pub fn edges(depth: &[f32], width: usize, near: f32) -> Vec<usize> {
    let height = depth.len() / width;
    let row = |y: usize| &depth[y * width..][..width];
    let bands = (0..height).into_par_iter().step_by(ROWS);
    let found: Vec<Vec<usize>> = bands
        .map(|first| {
            let (mut mask, mut found) = (vec![0; width], Vec::new());
            for y in first..height.min(first + ROWS) {
                let [above, below] = [y.saturating_sub(1), (y + 1).min(height - 1)].map(row);
                steps(above, row(y), below, near, &mut mask);
                for (x, run) in (0..).step_by(RUN).zip(mask.chunks(RUN)) {
                    if run.iter().fold(0, |any, step| any | step) == 0 {
                        continue;
                    }
                    let at_edge = run.iter().enumerate().filter(|(_, step)| **step != 0);
                    found.extend(at_edge.map(|(k, _)| y * width + x + k));
                }
            }
            found
        })
        .collect();
    found.concat()
}

/// Not 0 where a pixel of the middle row is beside a step. Free of branches: it becomes SIMD.
fn steps(above: &[f32], here: &[f32], below: &[f32], near: f32, mask: &mut [u32]) {
    // Infinity from infinity is no number, which is no step.
    let step = |a: f32, b: f32| u32::from((a - b).abs() > near * if a < b { a } else { b });
    for (((mask, &h), &a), &b) in mask.iter_mut().zip(here).zip(above).zip(below) {
        *mask = step(h, a) | step(h, b);
    }
    let across = |mask: &mut [u32], here: &[f32], beside: &[f32]| {
        for ((mask, &h), &b) in mask.iter_mut().zip(here).zip(beside) {
            *mask |= step(h, b);
        }
    };
    across(mask, here, &here[1..]);
    across(&mut mask[1..], &here[1..], here);
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
