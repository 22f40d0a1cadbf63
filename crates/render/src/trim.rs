//! Trim: takes back what sticks out. Discs close a surface because they are wider than the samples lie
//! apart, so at its rim they stick out by up to a radius, each by another length. Discs are a dilation of
//! the samples; this is the erosion that makes a closing of it.
//!
//! Within a surface the ellipse of a filled pixel is the mean of those around, centred near the pixel. At a
//! rim they all lie on one side, and the displacement from the ellipse's centre to the pixel (marroquim2007
//! section 3.2) tells how far beyond the samples the pixel lies. Such pixels are given to what is behind,
//! from the rim inwards. Gaps smaller than a radius have no rim: they are not to grow.

use crate::pyramid::Level;
use rayon::prelude::*;
use std::collections::VecDeque;

/// How far a surface may reach beyond its samples, over the radius, with normals and without. With them
/// ellipses end near silhouettes by themselves, and less only roughens them: a sphere's outline, spacing 8
/// pixels, deviates by 0.4 pixels (root mean square) with a half, by 0.8 with 0.3. Without them a third
/// leaves 0.3 spacings of the 1.1 that discs stick out.
const OVERHANG: [f32; 2] = [0.5, 0.35];
/// And in pixels, at least: less would tear dense surfaces between their pixels.
const OVERHANG_MIN_PX: f32 = 1.5;
/// Beyond a rim nothing of the surface lies for a radius, and for so many pixels at least and at most.
const OPEN_PX: (f32, f32) = (4.0, 32.0);
/// Directions to the neighbours, around.
const AROUND: [[isize; 2]; 8] =
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// A pixel that goes, the one that takes its place, and how many went before it from the rim inwards.
struct Step {
    pixel: usize,
    from: usize,
    before: u32,
}

/// Trims `base`, whose depth image is `depth` (infinite where there is nothing) with its
/// [`crate::edges`]. Returns the pixels that changed and those
/// that have become a rim.
pub fn trim(base: &mut Level, depth: &mut [f32], edges: &[usize], focal_px: f32) -> Vec<usize> {
    let mut touched = Vec::new();
    let grid = Grid { width: base.width, height: base.height };
    let rim = edges.par_iter().with_min_len(1024).filter_map(|&pixel| {
        let from = beyond_rim(base, depth, grid, focal_px, pixel)?;
        Some(Step { pixel, from, before: 0 })
    });
    let mut queue: VecDeque<Step> = rim.collect::<Vec<_>>().into();
    while let Some(Step { pixel, from, before }) = queue.pop_front() {
        let radius = base.tint[pixel].w;
        touched.push(pixel);
        let is_in_front = depth[from] > depth[pixel] * (1.0 + radius / focal_px);
        if !is_in_front || !overhangs(base, pixel) {
            continue;
        }
        replace(base, depth, pixel, from);
        for next in grid.beside(pixel).into_iter().flatten() {
            if depth[next] >= depth[pixel] {
                continue;
            }
            if before < radius as u32 && overhangs(base, next) {
                queue.push_back(Step { pixel: next, from: pixel, before: before + 1 });
            } else {
                touched.push(next);
            }
        }
    }
    touched.par_sort_unstable();
    touched.dedup();
    touched
}

/// The pixels' places.
#[derive(Clone, Copy)]
struct Grid {
    width: usize,
    height: usize,
}

impl Grid {
    /// The pixels left, right, above and below.
    fn beside(self, pixel: usize) -> [Option<usize>; 4] {
        let x = pixel % self.width;
        [
            (x > 0).then(|| pixel - 1),
            (x + 1 < self.width).then_some(pixel + 1),
            pixel.checked_sub(self.width),
            Some(pixel + self.width).filter(|&p| p < self.width * self.height),
        ]
    }

    fn step(self, pixel: usize, [dx, dy]: [isize; 2]) -> Option<usize> {
        let x = (pixel % self.width).checked_add_signed(dx)?;
        let y = (pixel / self.width).checked_add_signed(dy)?;
        (x < self.width && y < self.height).then(|| y * self.width + x)
    }
}

/// The pixel beyond the rim, where the pixel is at one: outwards in three neighbouring directions nothing
/// lies as near as the surface.
fn beyond_rim(
    base: &Level,
    depth: &[f32],
    grid: Grid,
    focal_px: f32,
    pixel: usize,
) -> Option<usize> {
    let (here, radius) = (depth[pixel], base.tint[pixel].w);
    if here == f32::INFINITY || !overhangs(base, pixel) {
        return None;
    }
    let limit = here * (1.0 + radius / focal_px);
    let reach = (radius + 1.0).clamp(OPEN_PX.0, OPEN_PX.1) as isize;
    let (x, y) = ((pixel % grid.width) as isize, (pixel / grid.width) as isize);
    let is_open = |[dx, dy]: [isize; 2]| {
        for k in 1..=reach {
            let (u, v) = ((x + dx * k) as usize, (y + dy * k) as usize);
            // What is left of the picture or above it wraps round to far beyond it.
            if u >= grid.width || v >= grid.height {
                return k as f32 > OPEN_PX.0;
            }
            if depth[v * grid.width + u] <= limit {
                return false;
            }
        }
        true
    };
    let open = AROUND.map(is_open);
    let middle = (0..8).find(|&i| open[(i + 7) % 8] && open[i] && open[(i + 1) % 8])?;
    grid.step(pixel, AROUND[middle])
}

fn replace(base: &mut Level, depth: &mut [f32], pixel: usize, from: usize) {
    depth[pixel] = depth[from];
    base.front[pixel] = base.front[from];
    base.tint[pixel] = base.tint[from];
    base.depth[pixel] = base.depth[from];
    if !base.normal.is_empty() {
        base.normal[pixel] = base.normal[from];
    }
}

/// Whether a pixel lies too far from the samples that it was interpolated from.
fn overhangs(base: &Level, pixel: usize) -> bool {
    let share = OVERHANG[usize::from(base.normal.is_empty())];
    let (front, reach) = (base.front[pixel], (base.tint[pixel].w * share).max(OVERHANG_MIN_PX));
    front.z * front.z + front.w * front.w > reach * reach
}
