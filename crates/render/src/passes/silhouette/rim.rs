//! Rims, where a surface ends in the picture, and whether a pixel at a rim lies beyond the samples
//! of its surface; for [`crate::passes::silhouette`]. At a rim nothing lies as near as the surface,
//! outwards in three neighbouring directions.

use crate::picture::pyramid::Level;
use crate::simd::values::Values;

/// Greatest distance of a surface beyond its samples, over the radius, with normals and without.
/// With normals ellipses end near silhouettes by themselves, and a smaller distance roughens them.
pub(crate) const OVERHANG: [f32; 2] = [0.5, 0.35];
/// Least value of that distance, pixels. With normals the positions of samples are exact; a smaller
/// distance tears the rims of walls seen at a grazing angle. Without normals it dents the rims of
/// dense surfaces.
pub(crate) const OVERHANG_MIN_PX: [f32; 2] = [1.2, 1.5];
/// Least and greatest distance beyond a rim without a part of its surface, pixels; in between, it
/// is the radius.
pub(crate) const OPEN_PX: (f32, f32) = (4.0, 32.0);
/// A surface continues behind a gap up to [`STEEPER`] times as steeply as it comes to it. The slope
/// is the steepest over these distances, in radii, since there may be gaps on this side too.
/// Otherwise ground at a grazing angle would be another surface behind each gap between scan lines,
/// and each gap would have a rim.
pub(crate) const SLOPE_RADII: [usize; 3] = [2, 3, 4];
pub(crate) const STEEPER: f32 = 1.5;
/// Least reach, pixels, at which slopes are followed. Below it gaps are small, and parts of clutter
/// that stick out matter more.
pub(crate) const SLOPE_REACH_MIN: usize = 8;
/// A multiple of all of [`SLOPE_RADII`].
pub(crate) const WIDTH_RADII: usize = 12;
/// Greatest distance of a line beyond its samples, pixels.
pub(crate) const LINE_OVERHANG_PX: f32 = 0.9;
// Gather moves a pixel by at most half a pixel along each axis from its sample. Plans rely on it
// that such pixels stick out neither of lines nor of surfaces.
const _: () = assert!(LINE_OVERHANG_PX * LINE_OVERHANG_PX > 0.5 * 0.5 * 2.0);
const _: () =
    assert!(OVERHANG_MIN_PX[0] > LINE_OVERHANG_PX && OVERHANG_MIN_PX[1] > LINE_OVERHANG_PX);
/// Greatest width of a band that is a line, in radii, plus a number of pixels; and distance that it
/// continues on either side, in radii: a single sample is no line, nor is a tip that stands out of
/// a surface.
pub(crate) const LINE_WIDTH: (f32, f32) = (2.0, 2.0);
pub(crate) const LINE_SIDE: f32 = 2.0;
/// Greatest radius, pixels, at which lines are detected.
pub(crate) const LINE_RADIUS_MAX_PX: f32 = 32.0;
/// Directions to the eight neighbours, in a circle.
pub(crate) const AROUND: [[isize; 2]; 8] =
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// A picture in which rims are detected.
#[derive(Clone, Copy)]
pub(crate) struct Rims<'a> {
    pub base: &'a Level,
    /// One over the focal length in pixels: GPUs round products correctly, but not quotients.
    pub per_focal: f32,
    /// Depth that each pixel shows.
    pub depth: &'a [f32],
}

impl Rims<'_> {
    pub fn grid(&self) -> Grid {
        Grid { width: self.base.width, height: self.base.height }
    }

    /// Depth beyond which there is another surface than that of `pixel`, which shows a disc of
    /// `radius`.
    #[inline(always)]
    pub fn limit(&self, pixel: usize, radius: f32) -> f32 {
        self.depth[pixel] * (1.0 + radius * self.per_focal)
    }

    /// The pixel beyond the rim if `place` lies at one: outwards in three neighbouring directions
    /// nothing lies as near as the surface. With it the outward direction plus one if the rim
    /// belongs to a line, else 0.
    pub fn beyond(&self, place: PixelAt) -> Option<(usize, u32)> {
        let pixel = place.index;
        let ellipse = PixelEllipse::at(self.base, pixel);
        if self.depth[pixel] == f32::INFINITY || !ellipse.may_stick_out() {
            return None;
        }
        let limit = self.limit(pixel, ellipse.radius);
        let is_open = |way| self.is_open(place, way, ellipse.radius, limit);
        let mut open = [false; 8];
        for i in [0, 2, 4, 6] {
            open[i] = is_open(AROUND[i]);
        }
        for i in [1, 3, 5, 7] {
            open[i] = (open[i - 1] || open[(i + 1) % 8]) && is_open(AROUND[i]);
        }
        let middle = (0..8).find(|&i| open[(i + 7) % 8] && open[i] && open[(i + 1) % 8])?;
        let line = self.line(place, &ellipse, open, limit);
        let beyond = self.grid().away(place, AROUND[middle], 1).index;
        (line > 0 || ellipse.sticks_out(0)).then_some((beyond, line))
    }

    /// Whether for a radius from a pixel in a direction nothing lies as near as `limit`, nor as
    /// near as the surface would if it continued.
    fn is_open(&self, pixel: PixelAt, [dx, dy]: [isize; 2], radius: f32, limit: f32) -> bool {
        let grid = self.grid();
        let reach = (radius + 1.0).clamp(OPEN_PX.0, OPEN_PX.1) as usize;
        let (steps, stride) = (reach.min(grid.room(pixel, [dx, dy])), grid.stride([dx, dy]));
        // Mostly the next pixel is as near, which is decided without a slope.
        if steps > 0 && self.depth[pixel.index.wrapping_add_signed(stride)] <= limit {
            return false;
        }
        let rise = self.rise(pixel, [dx, dy], reach);
        let mut at = pixel.index;
        for k in 1..=steps {
            at = at.wrapping_add_signed(stride);
            if (self.depth[at] - limit) * (WIDTH_RADII * reach) as f32 <= rise * k as f32 {
                return false;
            }
        }
        // Otherwise the next step leaves the picture.
        steps == reach || (steps + 1) as f32 > OPEN_PX.0
    }

    /// Greatest growth of depth over [`WIDTH_RADII`] times `reach` beyond a pixel in a direction
    /// with which the surface continues. Distances divide that length, since GPUs do not round
    /// quotients exactly.
    fn rise(&self, pixel: PixelAt, [dx, dy]: [isize; 2], reach: usize) -> f32 {
        if reach < SLOPE_REACH_MIN {
            return 0.0;
        }
        let back = [-dx, -dy];
        let risen = SLOPE_RADII.map(|radii| {
            let run = radii * reach;
            if self.grid().room(pixel, back) < run {
                return 0.0;
            }
            let inner = self.grid().away(pixel, back, run).index;
            (self.depth[pixel.index] - self.depth[inner]) * (STEEPER * (WIDTH_RADII / radii) as f32)
        });
        risen.into_iter().fold(0.0, f32::max)
    }

    /// Outward direction plus one of the line that a rim belongs to; 0 if there is none, or at the
    /// tip of a line.
    fn line(
        &self,
        pixel: PixelAt,
        ellipse: &PixelEllipse<f32>,
        open: [bool; 8],
        limit: f32,
    ) -> u32 {
        let count = open.into_iter().filter(|&o| o).count();
        let is_middle = |i: usize| {
            let at = |turn: usize| open[(i + turn) % 8];
            at(7) && at(0) && at(1) && (count == 4 || at(6) == at(2))
        };
        let outwards = if count > 5 { None } else { (0..8).find(|&i| is_middle(i)) };
        let is_line = |&way: &usize| {
            ellipse.sticks_out(way as u32 + 1) && self.is_line(pixel, ellipse.radius, way, limit)
        };
        outwards.filter(is_line).map_or(0, |way| way as u32 + 1)
    }

    /// Whether the band inwards of a rim, which is open in direction `outwards`, is a line: no
    /// wider than a disc, open on its other side too, and long.
    fn is_line(&self, rim: PixelAt, radius: f32, outwards: usize, limit: f32) -> bool {
        if radius > LINE_RADIUS_MAX_PX {
            return false;
        }
        let grid = self.grid();
        let [inwards, along] = [4, 2].map(|turn| AROUND[(outwards + turn) % 8]);
        let width = (radius * LINE_WIDTH.0 + LINE_WIDTH.1) / stride(inwards);
        let (wide, step) = (width as usize + 1, grid.stride(inwards));
        let mut at = rim.index;
        let band = (0..grid.room(rim, inwards).min(wide + 1)).take_while(|_| {
            at = at.wrapping_add_signed(step);
            self.depth[at] <= limit
        });
        let band = band.count();
        if band > wide || !self.is_open(grid.away(rim, inwards, band), inwards, radius, limit) {
            return false;
        }
        // Back from the far rim to the middle of the band.
        let middle = grid.away(rim, inwards, band - band / 2);
        let wanted = (radius * LINE_SIDE / stride(along)) as usize;
        let goes_on = |way: [isize; 2]| {
            let (mut at, step) = (middle.index, grid.stride(way));
            grid.room(middle, way) >= wanted
                && (0..wanted).all(|_| {
                    let before = at;
                    at = at.wrapping_add_signed(step);
                    self.depth[at] <= self.limit(before, radius)
                })
        };
        goes_on(along) && goes_on(along.map(|d| -d))
    }
}

/// A pixel: its index, column and row.
#[derive(Clone, Copy)]
pub(crate) struct PixelAt {
    pub index: usize,
    pub x: usize,
    pub y: usize,
}

/// Size of a picture, which relates pixels to their neighbours.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    pub width: usize,
    pub height: usize,
}

impl Grid {
    /// Pixels to the left, right, above and below; the pixel itself in place of those outside the
    /// picture.
    #[inline(always)]
    pub fn beside(self, place: PixelAt) -> [PixelAt; 4] {
        let PixelAt { index, x, y } = place;
        let at = |is_there: bool, other: PixelAt| if is_there { other } else { place };
        [
            at(x > 0, PixelAt { index: index.wrapping_sub(1), x: x.wrapping_sub(1), y }),
            at(x + 1 < self.width, PixelAt { index: index + 1, x: x + 1, y }),
            at(y > 0, PixelAt { index: index.wrapping_sub(self.width), x, y: y.wrapping_sub(1) }),
            at(y + 1 < self.height, PixelAt { index: index + self.width, x, y: y + 1 }),
        ]
    }

    /// The eight pixels around one that is not at the border.
    pub fn around(self, place: PixelAt) -> Option<[usize; 8]> {
        let PixelAt { index, x, y } = place;
        let is_inside = x > 0 && y > 0 && x + 1 < self.width && y + 1 < self.height;
        let (up, down) = (index.wrapping_sub(self.width), index + self.width);
        is_inside.then(|| [up - 1, up, up + 1, index - 1, index + 1, down - 1, down, down + 1])
    }

    pub fn place(self, index: usize) -> PixelAt {
        PixelAt { index, x: index % self.width, y: index / self.width }
    }

    /// The mirror image of `place` at `at`, if it is in the picture.
    pub fn mirrored(self, place: PixelAt, at: PixelAt) -> Option<usize> {
        let x = (2 * at.x).checked_sub(place.x).filter(|&x| x < self.width)?;
        let y = (2 * at.y).checked_sub(place.y).filter(|&y| y < self.height)?;
        Some(y * self.width + x)
    }

    /// Change of a pixel's index with a step in a direction.
    #[inline(always)]
    fn stride(self, [dx, dy]: [isize; 2]) -> isize {
        dx + dy * self.width as isize
    }

    /// Steps from a pixel to the border in a direction.
    #[inline(always)]
    pub fn room(self, PixelAt { x, y, .. }: PixelAt, [dx, dy]: [isize; 2]) -> usize {
        let room = |at: usize, size: usize, d: isize| match d {
            0 => usize::MAX,
            1.. => size - 1 - at,
            _ => at,
        };
        room(x, self.width, dx).min(room(y, self.height, dy))
    }

    /// Pixel a number of steps away in a direction; the steps must not leave the picture.
    pub fn away(
        self,
        PixelAt { index, x, y }: PixelAt,
        [dx, dy]: [isize; 2],
        steps: usize,
    ) -> PixelAt {
        let steps = steps as isize;
        PixelAt {
            index: index.wrapping_add_signed(self.stride([dx, dy]) * steps),
            x: x.wrapping_add_signed(dx * steps),
            y: y.wrapping_add_signed(dy * steps),
        }
    }
}

/// Length of a step in a direction, pixels.
fn stride([dx, dy]: [isize; 2]) -> f32 {
    if dx != 0 && dy != 0 { std::f32::consts::SQRT_2 } else { 1.0 }
}

/// The ellipses that pixels were interpolated from.
#[derive(Clone, Copy)]
pub(crate) struct PixelEllipse<V> {
    /// Radius, pixels.
    pub radius: V,
    /// Displacement from the ellipse's centre to the pixel.
    pub away: [V; 2],
    pub has_normal: bool,
}

impl PixelEllipse<f32> {
    #[inline(always)]
    pub fn at(base: &Level, pixel: usize) -> Self {
        let (front, has_normal) = (base.front[pixel], !base.normal.is_empty());
        Self { radius: base.tint[pixel].w, away: [front.z, front.w], has_normal }
    }
}

impl<V: Values> PixelEllipse<V> {
    /// Whether the pixel may lie beyond the samples, of a line or of a surface.
    #[inline(always)]
    pub fn may_stick_out(&self) -> V::Mask {
        let [x, y] = self.away;
        x.like(LINE_OVERHANG_PX * LINE_OVERHANG_PX).cmplt(x * x + y * y)
    }

    /// Whether the pixel lies too far beyond the samples: of the line with outward direction `line`
    /// minus one, or of a surface if `line` is 0.
    #[inline(always)]
    pub fn sticks_out(&self, line: u32) -> V::Mask {
        let [x, y] = self.away;
        if line > 0 {
            let way = AROUND[(line as usize - 1) % 8];
            let [dx, dy] = way.map(|d| d as f32 * (1.0 / stride(way)));
            return x.like(LINE_OVERHANG_PX).cmplt(x * dx + y * dy);
        }
        let kind = usize::from(!self.has_normal);
        let reach = (self.radius * OVERHANG[kind]).max(x.like(OVERHANG_MIN_PX[kind]));
        (reach * reach).cmplt(x * x + y * y)
    }
}
