//! Mend: pixels that lie behind nearly all of their neighbours are gaps of the surface in front, through
//! which a farther one or the background is seen. They take the mean of what surrounds them (after the masks of
//! Rosenthal and Linsen, Image-space point cloud rendering, 2008). Pull-push leaves such gaps where an
//! ellipse that should cover a pixel is a mean that does not, and where a depth interval has grown so
//! long that it takes in the surface behind. A gap takes nothing from other gaps: what is read in a round is not
//! written in it, so that a GPU may close all of them at once, in place.

use crate::pyramid::Level;
use crate::rim::Grid;
use glam::Vec4;
use rayon::prelude::*;

/// Of the eight neighbours, how many must be in front. A gap one pixel wide has six.
const SURROUNDED: usize = 6;
/// How far in front they have to be, over their radius, with normals and without: where surfaces are as thin as their
/// normals let them be, gaps show what lies nearer.
const BEFORE: [f32; 2] = [0.5, 1.0];
/// How often: a second time closes what the first has left one pixel wide.
const ROUNDS: usize = 2;

/// A pixel's new attributes.
struct Patch {
    pixel: usize,
    front: Vec4,
    tint: Vec4,
    depth: f32,
    normal: Vec4,
}

/// A bit for every pixel.
struct Marks(Vec<u64>);

impl Marks {
    fn new(pixels: usize) -> Self {
        Self(vec![0; pixels.div_ceil(64)])
    }

    fn set(&mut self, pixel: usize) {
        self.0[pixel / 64] |= 1 << (pixel % 64);
    }

    fn clear(&mut self, pixel: usize) {
        self.0[pixel / 64] &= !(1 << (pixel % 64));
    }

    fn has(&self, pixel: usize) -> bool {
        self.0[pixel / 64] >> (pixel % 64) & 1 == 1
    }
}

/// Closes gaps of `base`, whose depth image is `depth` (infinite where there is nothing) with its
/// [`crate::edges`], in their order: all gaps are among them.
pub fn mend(base: &mut Level, depth: &mut [f32], edges: &[usize], focal_px: f32) {
    let mut is_edge = Marks::new(depth.len());
    edges.iter().for_each(|&p| is_edge.set(p));
    let mut is_gap_now = Marks::new(depth.len());
    let mut candidates: Option<Vec<usize>> = None;
    for _ in 0..ROUNDS {
        let found = candidates.as_deref().unwrap_or(edges).par_iter().with_min_len(1024);
        let gaps = found.copied().filter(|&p| is_gap(base, depth, focal_px, p));
        let gaps: Vec<usize> = gaps.collect();
        gaps.iter().for_each(|&p| is_gap_now.set(p));
        let patches = gaps.par_iter().with_min_len(256);
        let patches: Vec<Patch> =
            patches.filter_map(|&p| patch(base, depth, focal_px, &is_gap_now, p)).collect();
        gaps.iter().for_each(|&p| is_gap_now.clear(p));
        let mut next = Vec::new();
        for p in patches {
            depth[p.pixel] = p.depth;
            base.depth[p.pixel] = p.depth;
            base.front[p.pixel] = p.front;
            base.tint[p.pixel] = p.tint;
            if let Some(normal) = base.normal.get_mut(p.pixel) {
                *normal = p.normal;
            }
            // Only a gap that was closed, or another beside it, may be one still. Each is noted once.
            for n in around(base, p.pixel).into_iter().flatten().chain([p.pixel]) {
                if is_edge.has(n) {
                    is_edge.clear(n);
                    next.push(n);
                }
            }
        }
        next.iter().for_each(|&p| is_edge.set(p));
        candidates = Some(next);
    }
}

/// The neighbours of a pixel that is not at the border.
fn around(base: &Level, pixel: usize) -> Option<[usize; 8]> {
    Grid { width: base.width, height: base.height }.around(pixel)
}

/// Whether a pixel is a gap: enough neighbours are in front by more than a share of their radius.
fn is_gap(base: &Level, depth: &[f32], focal_px: f32, pixel: usize) -> bool {
    let Some(around) = around(base, pixel) else { return false };
    // Most are none, which is seen without their radii.
    around.into_iter().filter(|&n| depth[n] < depth[pixel]).count() >= SURROUNDED
        && around.into_iter().filter(|&n| is_before(base, depth, focal_px, n, pixel)).count()
            >= SURROUNDED
}

fn is_before(base: &Level, depth: &[f32], focal_px: f32, pixel: usize, behind: usize) -> bool {
    let reach = BEFORE[usize::from(base.normal.is_empty())] * base.tint[pixel].w;
    depth[pixel] * (1.0 + reach / focal_px) < depth[behind]
}

/// What closes the gap at a pixel: the mean of those in front that are no gaps, if any.
fn patch(base: &Level, depth: &[f32], focal_px: f32, gaps: &Marks, pixel: usize) -> Option<Patch> {
    let mut count = 0;
    let mut patch =
        Patch { pixel, front: Vec4::ZERO, tint: Vec4::ZERO, depth: 0.0, normal: Vec4::ZERO };
    for n in around(base, pixel).into_iter().flatten() {
        if is_before(base, depth, focal_px, n, pixel) && !gaps.has(n) {
            count += 1;
            patch.front += base.front[n];
            patch.tint += base.tint[n];
            patch.depth += depth[n];
            patch.normal += base.normal.get(n).copied().unwrap_or_default();
        }
    }
    let share = 1.0 / count as f32;
    patch.front *= share * Vec4::new(1.0, 1.0, 0.0, 0.0);
    patch.tint *= share;
    patch.depth *= share;
    patch.normal *= share;
    (count > 0).then_some(patch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edges::edges;
    use crate::pyramid::{INVALID, Pyramid};

    const SIDE: usize = 24;

    /// A near surface of red points, with other depths where `depth` has them.
    fn mended(depth: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        let mut pyramid = Pyramid::default();
        pyramid.fit(SIDE, SIDE, false);
        let base = &mut pyramid.levels[0];
        let mut image: Vec<f32> = (0..SIDE * SIDE).map(|i| depth(i % SIDE, i / SIDE)).collect();
        for (i, &d) in image.iter().enumerate() {
            let valid = d < f32::INFINITY;
            base.front[i] = if valid { Vec4::new(d, d + 0.1, 0.0, 0.0) } else { INVALID };
            (base.depth[i], base.tint[i]) = (d, Vec4::new(1.0 / d, 0.0, 0.0, 2.0));
        }
        let edges = edges(&image, SIDE, 0.02);
        mend(base, &mut image, &edges, 100.0);
        for (i, &d) in image.iter().enumerate() {
            assert!(
                base.is_valid(i) == (d < f32::INFINITY) && (d == 1.0) == (base.tint[i].x == 1.0)
            );
        }
        image
    }

    #[test]
    fn gaps_a_pixel_wide_take_what_surrounds_them_whatever_is_behind() {
        for behind in [5.0, f32::INFINITY] {
            let gap = |x, y| matches!((x, y), (5, 5) | (9, 9) | (9, 10) | (14, 4..20));
            assert_eq!(mended(|x, y| if gap(x, y) { behind } else { 1.0 }), [1.0; SIDE * SIDE]);
        }
    }

    #[test]
    fn windows_and_rims_stay() {
        let scene = |x, y| match (x, y) {
            (0..3, _) => f32::INFINITY,
            (8..12, 8..12) => 5.0,
            _ => 1.0,
        };
        let expected: Vec<f32> = (0..SIDE * SIDE).map(|i| scene(i % SIDE, i / SIDE)).collect();
        assert_eq!(mended(scene), expected);
    }
}
