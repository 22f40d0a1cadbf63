//! Pull (marroquim2007 section 3.2): averages each level of the pyramid into the next coarser one.
//!
//! A coarse pixel takes from its four finer ones those that are valid and whose depth interval meets
//! that of the frontmost (the least minimum; of equals the first, row by row). Their attributes are
//! averaged; its own interval runs from the least minimum to the greatest maximum of those taken. To
//! each displacement the vector from the finer pixel's centre to the coarser one's is added first, so
//! that it keeps pointing from the ellipse's exact centre to the pixel's.
//!
//! Where pixels have normals, depths are moved along their planes ([`crate::tangent`]): compared at the middle of
//! the valid ones, and averaged at the middle of those taken.

use crate::pyramid::{INVALID, Level, Pyramid, RowMut, for_each_row};
use crate::tangent::Lens;
use glam::{Vec2, Vec4};

/// Fills all levels above the first.
pub fn pull(pyramid: &mut Pyramid) {
    let (has_normals, lens) = (pyramid.has_normals(), pyramid.lens);
    for i in 1..pyramid.levels.len() {
        let (finer, coarser) = pyramid.levels.split_at_mut(i);
        if has_normals {
            pull_level::<true>(&lens, &finer[i - 1], &mut coarser[0]);
        } else {
            pull_level::<false>(&lens, &finer[i - 1], &mut coarser[0]);
        }
    }
}

/// Averages `finer` into `coarser`, which has half its size, rounded up.
fn pull_level<const NORMALS: bool>(lens: &Lens, finer: &Level, coarser: &mut Level) {
    let edge_px = coarser.edge_px;
    for_each_row(coarser, |row| pull_row::<NORMALS>(lens, finer, edge_px, row));
}

fn pull_row<const NORMALS: bool>(lens: &Lens, finer: &Level, edge_px: f32, row: RowMut<'_>) {
    let upper = row.y * 2 * finer.width;
    let has_lower = row.y * 2 + 1 < finer.height;
    let quarter = finer.edge_px * 0.5;
    for x in 0..row.front.len() {
        let first = upper + x * 2;
        let has_right = x * 2 + 1 < finer.width;
        let pixels = [first, first + 1, first + finer.width, first + finer.width + 1];
        let inside = [true, has_right, has_lower, has_right && has_lower];
        let mut four = Four { pixels, fronts: [INVALID; 4], kept: [false; 4] };
        for k in 0..4 {
            if inside[k] && finer.is_valid(pixels[k]) {
                // From the finer centre to the coarser: half a finer pixel right and down, or back.
                let right = if k & 1 == 0 { quarter } else { -quarter };
                let down = if k >> 1 == 0 { quarter } else { -quarter };
                four.fronts[k] = finer.front[pixels[k]] + Vec4::new(0.0, 0.0, right, down);
                four.kept[k] = true;
            }
        }
        if four.kept == [false; 4] {
            row.front[x] = INVALID;
            continue;
        }
        let centre = Vec2::new(x as f32 + 0.5, row.y as f32 + 0.5) * edge_px;
        let mut middle = four.middle();
        let mut factors = four.factors::<NORMALS>(lens, finer, centre, middle);
        if four.keep_frontmost(&factors) {
            middle = four.middle();
            factors = four.factors::<NORMALS>(lens, finer, centre, middle);
        }
        let (mut depth_min, mut depth_max) = (f32::INFINITY, 0.0f32);
        let (mut tint, mut depth, mut normal) = (Vec4::ZERO, 0.0, Vec4::ZERO);
        for k in 0..4 {
            if !four.kept[k] {
                continue;
            }
            depth_min = depth_min.min(four.fronts[k].x * factors[k]);
            depth_max = depth_max.max(four.fronts[k].y * factors[k]);
            tint += finer.tint[pixels[k]];
            depth += finer.depth[pixels[k]] * factors[k];
            if NORMALS {
                normal += finer.normal[pixels[k]];
            }
        }
        let share = four.share();
        row.front[x] = Vec4::new(depth_min, depth_max, middle.x, middle.y);
        row.tint[x] = tint * share;
        row.depth[x] = depth * share;
        if NORMALS {
            row.normal[x] = normal * share;
        }
    }
}

/// The four finer pixels of a coarser one.
struct Four {
    pixels: [usize; 4],
    /// As in [`Level`], but displacements are to the coarser pixel's centre.
    fronts: [Vec4; 4],
    /// Which of them take part.
    kept: [bool; 4],
}

impl Four {
    /// One over their number.
    fn share(&self) -> f32 {
        1.0 / self.kept.iter().map(|&k| f32::from(u8::from(k))).sum::<f32>()
    }

    /// The mean displacement.
    fn middle(&self) -> Vec2 {
        let each = self.fronts.iter().zip(self.kept).filter(|(_, kept)| *kept);
        each.fold(Vec2::ZERO, |sum, (f, _)| sum + Vec2::new(f.z, f.w)) * self.share()
    }

    /// What each one's depths change by from its ellipse's centre to the place that `middle` is the displacement of.
    fn factors<const NORMALS: bool>(
        &self,
        lens: &Lens,
        finer: &Level,
        centre: Vec2,
        middle: Vec2,
    ) -> [f32; 4] {
        let mut factors = [1.0; 4];
        for (k, factor) in factors.iter_mut().enumerate() {
            if NORMALS && self.kept[k] {
                let displaced = Vec2::new(self.fronts[k].z, self.fronts[k].w);
                let normal = finer.normal[self.pixels[k]];
                *factor = lens.along(normal, centre - displaced, displaced - middle);
            }
        }
        factors
    }

    /// Drops those whose depth interval does not meet that of the frontmost. Whether it drops any.
    fn keep_frontmost(&mut self, factors: &[f32; 4]) -> bool {
        let (mut least, mut limit) = (f32::INFINITY, f32::INFINITY);
        for (front, factor) in self.fronts.iter().zip(factors) {
            if front.x * factor < least {
                (least, limit) = (front.x * factor, front.y * factor);
            }
        }
        let before = self.kept;
        for (kept, (front, factor)) in self.kept.iter_mut().zip(self.fronts.iter().zip(factors)) {
            *kept &= front.x * factor <= limit;
        }
        self.kept != before
    }
}
