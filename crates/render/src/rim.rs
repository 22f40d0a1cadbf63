//! Rims: where a surface ends on the picture, and whether a pixel there lies beyond the surface's samples; what [`crate::trim`]
//! takes back. At a rim nothing lies as near as the surface, outwards in three neighbouring directions.

use crate::marks::{Marks, bits};
use crate::pyramid::Level;
use crate::values::{EIGHT, Values, bits as bits_of, load};
use crate::windows::{eight, rows_around, windows};
use fearless_simd::{Level as Width, Simd, dispatch};

/// How far a surface may reach beyond its samples, over the radius, with normals and without. With them
/// ellipses end near silhouettes by themselves, and less only roughens them: a sphere's outline, spacing 8
/// pixels, deviates by 0.4 pixels (root mean square) with a half, by 0.8 with 0.3. Without them a third
/// leaves 0.3 spacings of the 1.1 that discs stick out.
const OVERHANG: [f32; 2] = [0.5, 0.35];
/// And in pixels, at least. With normals places are exact: with 0.9 a cube's outlines at one point a pixel are off by 0.27
/// of alpha (root mean square), with 1.5 by 0.42; but 0.9 tears the rims of walls seen at 80 degrees. Without normals
/// less than 1.5 dents the rims of dense surfaces.
const OVERHANG_MIN_PX: [f32; 2] = [1.2, 1.5];
/// Beyond a rim nothing of the surface lies for a radius, and for so many pixels at least and at most.
const OPEN_PX: (f32, f32) = (4.0, 32.0);
/// A surface goes on behind a gap as steeply as it comes to it, and half as much again, told over so many radii (the steepest,
/// since there may be a gap): else ground behind the gaps between scan lines, seen aslant, would lie too far off to be the
/// same, and each gap would have a rim.
const SLOPE_RADII: [isize; 3] = [2, 3, 4];
const STEEPER: f32 = 1.5;
/// Where it reaches less far, gaps are small, and what sticks out of clutter counts for more (0.2 % of an indoor scan's picture).
const SLOPE_REACH_MIN: usize = 8;
/// All radii above divide it.
const WIDTH_RADII: usize = 12;
/// How far a line may reach beyond its samples, pixels.
const LINE_OVERHANG_PX: f32 = 0.9;
/// A band is a line up to so many radii and pixels of width, where it goes on for so many radii on either side: one
/// sample alone is none, nor is one that stands out of a surface.
const LINE_WIDTH: (f32, f32) = (2.0, 2.0);
const LINE_SIDE: f32 = 2.0;
/// Radii beyond this, pixels, are not looked at for lines.
const LINE_RADIUS_MAX_PX: f32 = 32.0;
/// Directions to the neighbours, around.
const AROUND: [[isize; 2]; 8] =
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// A picture whose rims are looked for.
#[derive(Clone, Copy)]
pub(crate) struct Rims<'a> {
    pub base: &'a Level,
    /// One over the focal length in pixels: GPUs round products as everyone does, but not quotients.
    pub per_focal: f32,
    /// Depth of what each pixel shows.
    pub depth: &'a [f32],
}

impl Rims<'_> {
    pub fn grid(&self) -> Grid {
        Grid { width: self.base.width, height: self.base.height }
    }

    /// Depth beyond which there is another surface than the one that a pixel shows.
    pub fn limit(&self, pixel: usize, shown: usize) -> f32 {
        self.depth[pixel] * (1.0 + self.base.tint[shown].w * self.per_focal)
    }

    /// Tells of the pixels of `edges` in a row beside which another surface begins: all rims are among them.
    pub fn ends(&self, edges: &Marks, y: usize, mut tell: impl FnMut(Place)) {
        let width = self.base.width;
        let rows = rows_around(self.depth, width, y);
        dispatch!(Width::new(), simd => {
            for x in (0..width).step_by(EIGHT) {
                let index = y * width + x;
                let edges = edges.run(index, EIGHT.min(width - x));
                if edges != 0 {
                    let ends = edges & self.ends_of_eight(simd, rows, x, index);
                    bits(ends).for_each(|k| tell(Place { index: index + k, x: x + k, y }));
                }
            }
        });
    }

    /// Those of eight pixels from one on, a bit each.
    #[inline(always)]
    fn ends_of_eight<S: Simd>(&self, simd: S, rows: [&[f32]; 3], x: usize, first: usize) -> u64 {
        let mut space = [[0.0; _]; 3];
        let [above, here, below] = windows::<_, 3, { EIGHT + 2 }>(rows, x, &mut space);
        let across = eight(simd, here, 0).max(eight(simd, here, 2));
        let along = eight(simd, above, 1).max(eight(simd, below, 1));
        let here = eight(simd, here, 1);
        let tints = &self.base.tint[first..];
        let radii = match tints.first_chunk::<EIGHT>() {
            Some(tints) => tints.map(|tint| tint.w),
            None => std::array::from_fn(|k| tints.get(k).map_or(0.0, |tint| tint.w)),
        };
        let limit = here * (load(simd, &radii) * self.per_focal + 1.0);
        u64::from(bits_of(limit.cmplt(across.max(along))))
    }

    /// The pixel beyond the rim, where the pixel is at one: outwards in three neighbouring directions
    /// nothing lies as near as the surface. And where the rim is a line's, its direction outwards plus one, else 0.
    pub fn beyond(&self, place: Place) -> Option<(usize, u32)> {
        let pixel = place.index;
        if self.depth[pixel] == f32::INFINITY || !may_stick_out(self.base, pixel) {
            return None;
        }
        let (limit, radius) = (self.limit(pixel, pixel), self.base.tint[pixel].w);
        let is_open = |way| self.is_open(place, way, radius, limit);
        let mut open = [false; 8];
        for i in [0, 2, 4, 6] {
            open[i] = is_open(AROUND[i]);
        }
        if open == [false; 8] {
            return None;
        }
        for i in [1, 3, 5, 7] {
            open[i] = (open[i - 1] || open[(i + 1) % 8]) && is_open(AROUND[i]);
        }
        let middle = (0..8).find(|&i| open[(i + 7) % 8] && open[i] && open[(i + 1) % 8])?;
        let line = self.line(pixel, open, limit);
        let beyond = self.grid().step(pixel, AROUND[middle])?;
        (line > 0 || sticks_out(self.base, pixel, 0)).then_some((beyond, line))
    }

    /// Whether nothing lies as near as `limit` from a pixel in a direction, nor as near as its own slope goes on, for a radius.
    fn is_open(&self, pixel: Place, [dx, dy]: [isize; 2], radius: f32, limit: f32) -> bool {
        let Grid { width, height } = self.grid();
        let reach = (radius + 1.0).clamp(OPEN_PX.0, OPEN_PX.1) as usize;
        let room = |at: usize, size: usize, d: isize| match d {
            0 => usize::MAX,
            1.. => size - 1 - at,
            _ => at,
        };
        let steps = reach.min(room(pixel.x, width, dx)).min(room(pixel.y, height, dy));
        let stride = dx + dy * width as isize;
        // Mostly the next pixel is as near, which is seen without a slope.
        if steps > 0 && self.depth[pixel.index.wrapping_add_signed(stride)] <= limit {
            return false;
        }
        let rise = self.rise(pixel.index, [dx, dy], reach);
        let mut at = pixel.index;
        for k in 1..=steps {
            at = at.wrapping_add_signed(stride);
            if (self.depth[at] - limit) * (WIDTH_RADII * reach) as f32 <= rise * k as f32 {
                return false;
            }
        }
        // Else the next step leaves the picture.
        steps == reach || (steps + 1) as f32 > OPEN_PX.0
    }

    /// By how much depth may grow over [`WIDTH_RADII`] of reach beyond a pixel in a direction for the surface to go on: by widths
    /// that divide it, since GPUs round quotients as they like.
    fn rise(&self, pixel: usize, [dx, dy]: [isize; 2], reach: usize) -> f32 {
        if reach < SLOPE_REACH_MIN {
            return 0.0;
        }
        let risen = SLOPE_RADII.map(|radii| {
            let run = radii * reach as isize;
            let inner = self.grid().step(pixel, [-dx * run, -dy * run]);
            let times = STEEPER * (WIDTH_RADII as isize / radii) as f32;
            inner.map_or(0.0, |inner| (self.depth[pixel] - self.depth[inner]) * times)
        });
        risen.into_iter().fold(0.0, f32::max)
    }

    /// The direction outwards plus one of the line that a rim belongs to, where it does; else 0. At a tip there is none.
    fn line(&self, pixel: usize, open: [bool; 8], limit: f32) -> u32 {
        let count = open.into_iter().filter(|&o| o).count();
        let is_middle = |i: usize| {
            let at = |turn: usize| open[(i + turn) % 8];
            at(7) && at(0) && at(1) && (count == 4 || at(6) == at(2))
        };
        let outwards = if count > 5 { None } else { (0..8).find(|&i| is_middle(i)) };
        let is_line = |&way: &usize| {
            sticks_out(self.base, pixel, way as u32 + 1) && self.is_line(pixel, way, limit)
        };
        outwards.filter(is_line).map_or(0, |way| way as u32 + 1)
    }

    /// Whether the band inwards of a rim that is open in a direction is a line: no wider than a disc, as open beyond, and
    /// long.
    fn is_line(&self, pixel: usize, outwards: usize, limit: f32) -> bool {
        let radius = self.base.tint[pixel].w;
        if radius > LINE_RADIUS_MAX_PX {
            return false;
        }
        let [inwards, along] = [4, 2].map(|turn| AROUND[(outwards + turn) % 8]);
        let width = (radius * LINE_WIDTH.0 + LINE_WIDTH.1) / stride(inwards);
        let mut inner = pixel;
        for k in 0.. {
            let Some(next) = self.grid().step(inner, inwards).filter(|&p| self.depth[p] <= limit)
            else {
                if !self.is_open(self.grid().place(inner), inwards, radius, limit) {
                    return false;
                }
                // From the far rim back to the middle.
                let back = inwards.map(|d| -d * (k / 2));
                inner = self.grid().step(inner, back).unwrap_or(inner);
                break;
            };
            if k as f32 > width {
                return false;
            }
            inner = next;
        }
        let wanted = (radius * LINE_SIDE / stride(along)) as u32;
        let goes_on = |way: [isize; 2]| {
            let (mut at, mut steps) = (inner, 0);
            while let Some(next) = self.grid().step(at, way).filter(|&p| {
                steps < wanted && self.depth[p] <= self.depth[at] * (1.0 + radius * self.per_focal)
            }) {
                (at, steps) = (next, steps + 1);
            }
            steps == wanted
        };
        goes_on(along) && goes_on(along.map(|d| -d))
    }
}

/// A pixel, its column and its row.
#[derive(Clone, Copy)]
pub(crate) struct Place {
    pub index: usize,
    pub x: usize,
    pub y: usize,
}

/// The pixels' places.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub width: usize,
    pub height: usize,
}

impl Grid {
    /// The pixels left, right, above and below.
    pub fn beside(self, pixel: usize) -> [Option<usize>; 4] {
        let x = pixel % self.width;
        [
            (x > 0).then(|| pixel - 1),
            (x + 1 < self.width).then_some(pixel + 1),
            pixel.checked_sub(self.width),
            Some(pixel + self.width).filter(|&p| p < self.width * self.height),
        ]
    }

    /// The eight pixels around one that is not at the border.
    pub fn around(self, pixel: usize) -> Option<[usize; 8]> {
        let Place { x, y, .. } = self.place(pixel);
        let is_inside = x > 0 && y > 0 && x + 1 < self.width && y + 1 < self.height;
        let (up, down) = (pixel.wrapping_sub(self.width), pixel + self.width);
        is_inside.then(|| [up - 1, up, up + 1, pixel - 1, pixel + 1, down - 1, down, down + 1])
    }

    pub fn place(self, index: usize) -> Place {
        Place { index, x: index % self.width, y: index / self.width }
    }

    fn step(self, pixel: usize, [dx, dy]: [isize; 2]) -> Option<usize> {
        let x = (pixel % self.width).checked_add_signed(dx)?;
        let y = (pixel / self.width).checked_add_signed(dy)?;
        (x < self.width && y < self.height).then(|| y * self.width + x)
    }
}

/// Length of a step in a direction, pixels.
fn stride([dx, dy]: [isize; 2]) -> f32 {
    if dx != 0 && dy != 0 { std::f32::consts::SQRT_2 } else { 1.0 }
}

/// Whether a pixel may stick out, of whatever it is a part.
fn may_stick_out(base: &Level, pixel: usize) -> bool {
    let front = base.front[pixel];
    front.z * front.z + front.w * front.w > LINE_OVERHANG_PX * LINE_OVERHANG_PX
}

/// Whether a pixel lies too far from the samples that it was interpolated from: at a line with this direction outwards
/// (plus one), or where it is 0 at any surface.
pub(crate) fn sticks_out(base: &Level, pixel: usize, line: u32) -> bool {
    if line > 0 {
        let way = AROUND[(line as usize - 1) % 8];
        let [dx, dy] = way.map(|d| d as f32 * (1.0 / stride(way)));
        let front = base.front[pixel];
        return front.z * dx + front.w * dy > LINE_OVERHANG_PX;
    }
    let kind = usize::from(base.normal.is_empty());
    let (front, reach) =
        (base.front[pixel], (base.tint[pixel].w * OVERHANG[kind]).max(OVERHANG_MIN_PX[kind]));
    front.z * front.z + front.w * front.w > reach * reach
}
