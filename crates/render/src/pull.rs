//! Pull (marroquim2007 section 3.2): averages each level of the pyramid into the next coarser one.
//!
//! A coarse pixel takes from its four finer ones those that are valid and whose depth interval meets
//! that of the frontmost (the least minimum; of equals the first, row by row). Their attributes are
//! averaged; its own interval runs from the least minimum to the greatest maximum of those taken. To
//! each displacement the vector from the finer pixel's centre to the coarser one's is added first, so
//! that it keeps pointing from the ellipse's exact centre to the pixel's.

use crate::pyramid::{INVALID, Level, Pyramid, RowMut, for_each_row};
use glam::Vec4;

/// Fills all levels above the first.
pub fn pull(pyramid: &mut Pyramid) {
    let has_normals = pyramid.has_normals();
    for i in 1..pyramid.levels.len() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        if has_normals {
            pull_level::<true>(&finer[i - 1], &mut coarser[0]);
        } else {
            pull_level::<false>(&finer[i - 1], &mut coarser[0]);
        }
    }
}

/// Averages `finer` into `coarser`, which has half its size, rounded up.
fn pull_level<const NORMALS: bool>(finer: &Level, coarser: &mut Level) {
    for_each_row(coarser, |row| pull_row::<NORMALS>(finer, row));
}

fn pull_row<const NORMALS: bool>(finer: &Level, row: RowMut<'_>) {
    let upper = row.y * 2 * finer.width;
    // A row or column that the finer level does not have is left out by pointing at pixels known to be
    // there and calling them invalid.
    let has_lower = row.y * 2 + 1 < finer.height;
    let quarter = finer.edge_px * 0.5;
    for x in 0..row.front.len() {
        let first = upper + x * 2;
        let has_right = x * 2 + 1 < finer.width;
        let at = |present: bool, pixel: usize| {
            if present { finer.front[pixel] } else { INVALID }
        };
        let fronts = [
            finer.front[first],
            at(has_right, first + 1),
            at(has_lower, first + finer.width),
            at(has_right && has_lower, first + finer.width + 1),
        ];
        let mut nearest = fronts[0];
        for f in &fronts[1..] {
            if f.x < nearest.x {
                nearest = *f;
            }
        }
        if nearest.x == f32::INFINITY {
            row.front[x] = INVALID;
            continue;
        }
        let (mut depth_max, mut displaced) = (nearest.y, Vec4::ZERO);
        let (mut tint, mut depth, mut normal) = (Vec4::ZERO, 0.0, Vec4::ZERO);
        let mut count = 0.0;
        for (k, f) in fronts.iter().enumerate() {
            if f.x > nearest.y || f.x == f32::INFINITY {
                continue;
            }
            let (right, down) = (k & 1, k >> 1);
            let pixel = first + right + down * finer.width;
            depth_max = depth_max.max(f.y);
            // From the finer centre to the coarser: half a finer pixel right and down, or back.
            let to_coarser = [
                if right == 0 { quarter } else { -quarter },
                if down == 0 { quarter } else { -quarter },
            ];
            displaced += *f + Vec4::new(0.0, 0.0, to_coarser[0], to_coarser[1]);
            tint += finer.tint[pixel];
            depth += finer.depth[pixel];
            if NORMALS {
                normal += finer.normal[pixel];
            }
            count += 1.0;
        }
        let share = 1.0 / count;
        row.front[x] = Vec4::new(nearest.x, depth_max, displaced.z * share, displaced.w * share);
        row.tint[x] = tint * share;
        row.depth[x] = depth * share;
        if NORMALS {
            row.normal[x] = normal * share;
        }
    }
}
