//! Fill holes (after the masks of `rosenthal2008`): a pixel that lies behind nearly all of its
//! neighbours, or behind a surface within its radius in every direction, is a gap in the surface in
//! front. It takes the mean of the neighbours in front. Pull-push leaves gaps where the mean of
//! several ellipses misses a pixel that they cover, and where a depth interval has grown so long
//! that it includes the surface behind.
//!
//! A gap takes nothing from other gaps: pixels that a round reads are not written in it, so a GPU
//! may close all gaps at once, in place.

use crate::passes::silhouette::rim::{AROUND, Grid};
use crate::picture::marks::{Marks, bits};
use crate::picture::pyramid::Level;
use crate::picture::windows::{eight, rows_around, windows};
use crate::simd::values::{EIGHT, Values, bits as bits_of, only};
use fearless_simd::{Level as Width, Simd, dispatch};
use glam::Vec4;
use rayon::prelude::*;

/// Least number of the eight neighbours that are in front. A gap one pixel wide has six.
pub(crate) const SURROUNDED: usize = 6;
/// Least number of neighbours in front of a pixel that is enclosed: the pixels of a gap two by two
/// pixels wide have five. A pixel is enclosed if in all eight directions a surface in front begins
/// within its own radius, and within [`WITHIN_PX`]: discs of samples farther apart would not close
/// the gap either. Three pixels would exceed the bound of `crates/engine/tests/occlusion.rs`.
pub(crate) const CORNERED: usize = 5;
pub(crate) const WITHIN_PX: usize = 2;
/// Least distance of the neighbours in front, over their radius, with normals and without:
/// intervals are shorter with normals, so gaps show nearer surfaces. And their least value, pixels.
pub(crate) const BEFORE: [f32; 2] = [0.5, 1.0];
pub(crate) const BEFORE_MIN_PX: f32 = 1.0;
/// Number of rounds: the second closes the pixels that the first left of wider gaps.
pub(crate) const ROUNDS: usize = 2;

/// New attributes of a pixel.
struct Patch {
    pixel: usize,
    front: Vec4,
    tint: Vec4,
    depth: f32,
    normal: Vec4,
}

/// Closes gaps of `base`; `depth` is its depth image, infinite where the picture is empty.
pub fn fill_holes(base: &mut Level, depth: &mut [f32], focal_px: f32) {
    let mut patched = close(base, depth, None, focal_px);
    for _ in 1..ROUNDS {
        // Only gaps that were closed, and pixels near enough to see one, may have changed.
        let near = (0..WITHIN_PX).fold(patched, |near, _| near.grown(true));
        patched = close(base, depth, Some(&near), focal_px);
    }
}

/// Runs one round, among the pixels of `within` if given. Returns the pixels that were closed.
fn close(base: &mut Level, depth: &mut [f32], within: Option<&Marks>, focal_px: f32) -> Marks {
    let gaps = gaps(base, depth, within, focal_px);
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

/// Gaps among the pixels of `within`, or of the whole picture.
fn gaps(base: &Level, depth: &[f32], within: Option<&Marks>, focal_px: f32) -> Marks {
    let Level { width, height, .. } = *base;
    let least = 1.0 + BEFORE_MIN_PX / focal_px;
    Marks::of_rows(width, height, |y, band| {
        let rows = rows_around(depth, width, y);
        dispatch!(Width::new(), simd => {
            for x in (0..width).step_by(EIGHT) {
                let (pixel, count) = (y * width + x, EIGHT.min(width - x));
                let wanted = within.map_or((1 << count) - 1, |within| within.run(pixel, count));
                // Most pixels are not gaps, which is decided without their radii.
                if wanted != 0 {
                    let gaps = bits(wanted & surrounded(simd, rows, x, least)).map(|k| pixel + k);
                    gaps.filter(|&p| is_gap(base, depth, focal_px, p)).for_each(|p| band.set(p));
                }
            }
        });
    })
}

/// Pixels among eight (a bit each) with at least [`CORNERED`] neighbours whose depth times `times`
/// is less than their own.
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

/// Whether a pixel is a gap: enough neighbours are in front of it by more than a share of their
/// radius.
fn is_gap(base: &Level, depth: &[f32], focal_px: f32, pixel: usize) -> bool {
    let Some(around) = around(base, pixel) else { return false };
    let count = around.into_iter().filter(|&n| is_before(base, depth, focal_px, n, pixel)).count();
    count >= SURROUNDED || count >= CORNERED && is_enclosed(base, depth, focal_px, pixel)
}

/// Whether in every direction a surface in front of a pixel begins within its own radius.
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

/// New attributes of a gap: the mean of the neighbours in front that are not gaps, if there are
/// any.
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

    /// Fills the holes of a near surface of red points, which has other depths where `depth` gives
    /// them.
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
            // Longer than the radius of the discs.
            (14..16, 17..20) => 5.0,
            _ => 1.0,
        };
        let expected: Vec<f32> = (0..SIDE * SIDE).map(|i| scene(i % SIDE, i / SIDE)).collect();
        assert_eq!(filled(scene), expected);
    }
}
