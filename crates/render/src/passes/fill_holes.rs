//! Fill holes: closes gaps of the front surface through which a farther surface or the background
//! shows. A gap is a pixel behind nearly all of its neighbours, or with something in front of it
//! within its radius in every direction (after the masks of rosenthal2008). It takes the mean of
//! the surrounding pixels. Pull-push leaves such gaps where a mean ellipse does not cover a pixel
//! that its parts cover, and where a depth interval has grown so long that it includes the surface
//! behind.
//!
//! A gap takes nothing from other gaps: no pixel is both read and written in a round, so that a GPU
//! may close all gaps at once, in place.

use crate::passes::silhouette::rim::{AROUND, Grid};
use crate::picture::marks::{Marks, bits};
use crate::picture::pyramid::Level;
use crate::picture::windows::{eight, rows_around, windows};
use crate::simd::values::{EIGHT, Values, bits as bits_of, only};
use fearless_simd::{Level as Width, Simd, dispatch};
use glam::Vec4;
use rayon::prelude::*;

/// Least number of the eight neighbours in front of a gap. A gap one pixel wide has six.
pub(crate) const SURROUNDED: usize = 6;
/// Least number of neighbours in front of a corner, as the four pixels of a gap of two by two are.
/// It is a gap if in all eight directions something in front begins within its own radius and
/// within `WITHIN_PX` pixels: discs of sparser samples would not close it either. (With three
/// pixels hidden nodes change pictures of offices.)
pub(crate) const CORNERED: usize = 5;
pub(crate) const WITHIN_PX: usize = 2;
/// Least distance in front, over the radius, with normals and without: surfaces with normals are
/// thinner, and gaps show nearer ones. And the least distance in pixels.
pub(crate) const BEFORE: [f32; 2] = [0.5, 1.0];
pub(crate) const BEFORE_MIN_PX: f32 = 1.0;
/// Number of rounds: the second one closes gaps that the first has left one pixel wide.
pub(crate) const ROUNDS: usize = 2;

/// New attributes of a pixel.
struct Patch {
    pixel: usize,
    front: Vec4,
    tint: Vec4,
    depth: f32,
    normal: Vec4,
}

/// Closes gaps of `base`, whose depth image is `depth` (infinite without a surface).
pub fn fill_holes(base: &mut Level, depth: &mut [f32], focal_px: f32) {
    let mut patched = close(base, depth, None, focal_px);
    for _ in 1..ROUNDS {
        // Only closed gaps and pixels near them can still be gaps.
        let near = (0..WITHIN_PX).fold(patched, |near, _| near.grown(true));
        patched = close(base, depth, Some(&near), focal_px);
    }
}

/// Closes all gaps, or those among some pixels, and returns them.
fn close(base: &mut Level, depth: &mut [f32], among: Option<&Marks>, focal_px: f32) -> Marks {
    let gaps = gaps(base, depth, among, focal_px);
    let patches = gaps.pixels().filter_map(|p| patch(base, depth, focal_px, &gaps, p));
    let patches: Vec<Patch> = patches.collect();
    let mut patched = Marks::new(base.width, base.height);
    for p in &patches {
        patched.set(p.pixel);
    }
    let Level { front, tint, depth: mean, normal, .. } = base;
    let put = |plane: &mut [Vec4], value: fn(&Patch) -> Vec4| {
        patches.iter().for_each(|p| plane[p.pixel] = value(p));
    };
    rayon::join(
        || rayon::join(|| put(front, |p| p.front), || put(tint, |p| p.tint)),
        || {
            patches.iter().for_each(|p| (depth[p.pixel], mean[p.pixel]) = (p.depth, p.depth));
            if !normal.is_empty() {
                put(normal, |p| p.normal);
            }
        },
    );
    patched
}

/// Gaps among some pixels, or all of them.
fn gaps(base: &Level, depth: &[f32], among: Option<&Marks>, focal_px: f32) -> Marks {
    let Level { width, height, .. } = *base;
    let least = 1.0 + BEFORE_MIN_PX / focal_px;
    Marks::of_rows(width, height, |y, band| {
        let rows = rows_around(depth, width, y);
        dispatch!(Width::new(), simd => {
            for x in (0..width).step_by(EIGHT) {
                let (pixel, count) = (y * width + x, EIGHT.min(width - x));
                let wanted = among.map_or((1 << count) - 1, |among| among.run(pixel, count));
                // Most pixels are none, which needs no radii to find out.
                if wanted != 0 {
                    let gaps = bits(wanted & surrounded(simd, rows, x, least)).map(|k| pixel + k);
                    gaps.filter(|&p| is_gap(base, depth, focal_px, p)).for_each(|p| band.set(p));
                }
            }
        });
    })
}

/// Marks those of eight pixels, a bit each, with enough neighbours whose depth times `times` is
/// less than theirs.
#[inline(always)]
fn surrounded<S: Simd>(simd: S, rows: [&[f32]; 3], x: usize, times: f32) -> u64 {
    let mut space = [[0.0; _]; 3];
    let rows = windows::<_, 3, { EIGHT + 2 }>(rows, x, &mut space);
    let here = eight(simd, rows[1], 1);
    let (mut count, one) = (here.like(0.0), here.like(1.0));
    for row in rows {
        for from in 0..3 {
            count += only((eight(simd, row, from) * times).cmplt(here), one);
        }
    }
    u64::from(bits_of(count.like(CORNERED as f32).cmple(count)))
}

/// Neighbours of a pixel, unless it is at the border.
fn around(base: &Level, pixel: usize) -> Option<[usize; 8]> {
    let grid = Grid { width: base.width, height: base.height };
    grid.around(grid.place(pixel))
}

/// Whether a pixel is a gap.
fn is_gap(base: &Level, depth: &[f32], focal_px: f32, pixel: usize) -> bool {
    let Some(around) = around(base, pixel) else { return false };
    let count = around.into_iter().filter(|&n| is_before(base, depth, focal_px, n, pixel)).count();
    count >= SURROUNDED || count >= CORNERED && is_enclosed(base, depth, focal_px, pixel)
}

/// Whether in every direction something in front of a pixel begins within its own radius.
fn is_enclosed(base: &Level, depth: &[f32], focal_px: f32, pixel: usize) -> bool {
    let grid = Grid { width: base.width, height: base.height };
    let place = grid.place(pixel);
    AROUND.into_iter().all(|way| {
        let steps = WITHIN_PX.min(grid.room(place, way));
        (1..=steps).any(|k| {
            let at = grid.away(place, way, k).index;
            k as f32 <= base.tint[at].w && is_before(base, depth, focal_px, at, pixel)
        })
    })
}

fn is_before(base: &Level, depth: &[f32], focal_px: f32, pixel: usize, behind: usize) -> bool {
    let reach = BEFORE[usize::from(base.normal.is_empty())] * base.tint[pixel].w;
    let reach = reach.max(BEFORE_MIN_PX);
    depth[pixel] * (1.0 + reach / focal_px) < depth[behind]
}

/// Mean of the neighbours in front that are no gaps, if there are any.
fn patch(base: &Level, depth: &[f32], focal_px: f32, gaps: &Marks, pixel: usize) -> Option<Patch> {
    let mut count = 0;
    let mut patch =
        Patch { pixel, front: Vec4::ZERO, tint: Vec4::ZERO, depth: 0.0, normal: Vec4::ZERO };
    for n in around(base, pixel)? {
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
    use crate::picture::pyramid::{INVALID, Planes, Pyramid};

    const SIDE: usize = 24;

    /// A near surface of red points, with the depths of `depth`.
    fn filled(depth: impl Fn(usize, usize) -> f32) -> Vec<f32> {
        let mut pyramid = Pyramid::default();
        pyramid.fit(SIDE, SIDE, Planes::None);
        let base = &mut pyramid.levels[0];
        let mut image: Vec<f32> = (0..SIDE * SIDE).map(|i| depth(i % SIDE, i / SIDE)).collect();
        for (i, &d) in image.iter().enumerate() {
            let valid = d < f32::INFINITY;
            base.front[i] = if valid { Vec4::new(d, d + 0.1, 0.0, 0.0) } else { INVALID };
            (base.depth[i], base.tint[i]) = (d, Vec4::new(1.0 / d, 0.0, 0.0, 2.0));
        }
        fill_holes(base, &mut image, 100.0);
        for (i, &d) in image.iter().enumerate() {
            assert!(
                base.is_valid(i) == (d < f32::INFINITY) && (d == 1.0) == (base.tint[i].x == 1.0)
            );
        }
        image
    }

    #[test]
    fn gaps_take_what_surrounds_them_whatever_is_behind() {
        for behind in [5.0, f32::INFINITY] {
            let gap =
                |x, y| matches!((x, y), (5, 5) | (9, 9) | (9, 10) | (14, 4..20) | (18..20, 7..9));
            assert_eq!(filled(|x, y| if gap(x, y) { behind } else { 1.0 }), [1.0; SIDE * SIDE]);
        }
    }

    #[test]
    fn windows_and_rims_stay() {
        let scene = |x, y| match (x, y) {
            (0..3, _) => f32::INFINITY,
            (8..12, 8..12) => 5.0,
            // Longer than the radius of discs.
            (14..16, 17..20) => 5.0,
            _ => 1.0,
        };
        let expected: Vec<f32> = (0..SIDE * SIDE).map(|i| scene(i % SIDE, i / SIDE)).collect();
        assert_eq!(filled(scene), expected);
    }
}
