//! Silhouette: takes back the parts of discs that stick out beyond the samples. Discs close a
//! surface because they are wider than its samples are apart, so at a rim they stick out by up to a
//! radius, each by another length. Discs are a dilation of the samples; this erosion makes a
//! closing of it (`docs/design/surfaces.md`).
//!
//! Within a surface the ellipse of a filled pixel is a mean of ellipses all around, with its centre
//! near the pixel. At a rim they all lie on one side, and the displacement from the ellipse's
//! centre to the pixel (`marroquim2007`, section 3.2) is the distance of the pixel beyond the
//! samples. Such pixels are eroded, from the rim inwards: they take the attributes of the surface
//! behind. Gaps smaller than a radius have no rim, so that they do not grow.
//!
//! - Samples on a line (a wire, a railing) make a band of discs, both of whose rims lie beyond the
//!   samples. Pixels of a line are eroded by their displacement across it alone, since along it a
//!   pixel may be far from its samples.
//! - Halfway between two samples far apart the displacement is zero, so single pixels of discs that
//!   span a gap would stay. A pixel that is isolated is eroded too.
//! - The surface behind continues where pixels were eroded: they show the pixel as far beyond the
//!   rim, mirrored.
//!
//! Erosion runs in waves, which only record for each pixel the one whose attributes it shows. As on
//! a chessboard, a wave decides on pixels of one colour from those of the other, so the result does
//! not depend on the order, the number of threads, or the machine: a GPU runs a pass per wave.

pub(crate) mod rim;
pub(crate) mod rows;

use crate::passes::silhouette::rim::{Grid, PixelAt, PixelEllipse, Rims};
use crate::picture::marks::Marks;
use crate::picture::pyramid::Level;
use esker_points::fetch::fetch;
use rayon::prelude::*;

/// Bits of a source that hold its pixel; the bits above them hold the outward direction of the line
/// that was eroded, plus one.
pub(crate) const PIXEL_BITS: u32 = 28;
pub(crate) const PIXEL_MASK: u32 = (1 << PIXEL_BITS) - 1;
/// Most waves after that of the rims. A surface takes as many as its radius has pixels, so only
/// pictures of a few huge discs would change with more.
pub(crate) const WAVES: u32 = 256;
/// Pixels of a wave per job: fewer take less time than waking another thread.
const JOB: usize = 256;
/// Distance of the prefetch, pixels of a wave.
const AHEAD: usize = 8;
/// A pixel is isolated if at least [`ALONE`] of its eight neighbours show a surface behind it, and
/// its radius is at least [`ALONE_RADIUS_PX`]. The own pixel of a sample keeps at least three
/// neighbours, since it is eroded to more than a pixel around it. Where radii are smaller, rims
/// need such pixels.
pub(crate) const ALONE: usize = 7;
pub(crate) const ALONE_RADIUS_PX: f32 = 3.0;

/// The surface behind continues where pixels were eroded, as long as its depth changes by at most
/// this many pixels' width per pixel (ground at a grazing angle), and by at most [`RISE_MAX`] of
/// the depth.
pub(crate) const STEEPEST: f32 = 4.0;
/// Least distance from the rim at which the mirrored pixel is shown, pixels. Nearer to it the pixel
/// at the rim is shown: mirrored pixels flicker there, and stripes are no longer than that.
pub(crate) const MIRRORED_PX: usize = 8;
pub(crate) const RISE_MAX: f32 = 0.5;

/// Erodes the silhouettes of `base`. `depth` is its depth image (infinite where the picture is
/// empty), and `edges` are the [`crate::picture::edges`] of that image. Returns the changed pixels
/// and those beside them.
pub fn trim(base: &mut Level, depth: &mut [f32], edges: &Marks, focal_px: f32) -> Marks {
    trim_with(&mut Vec::new(), base, depth, edges, focal_px)
}

/// Version of [`trim`] that keeps `scratch` from frame to frame; it is all zeros in between.
pub(crate) fn trim_with(
    scratch: &mut Vec<u32>,
    base: &mut Level,
    depth: &mut [f32],
    edges: &Marks,
    focal_px: f32,
) -> Marks {
    scratch.resize(depth.len(), 0);
    let (source, eroded) = (std::mem::take(scratch), Marks::new(base.width, base.height));
    let mut waves = Waves { base, per_focal: 1.0 / focal_px, depth, source, eroded };
    let rims = waves.write(waves.rims(edges));
    let (mut last, mut waiting): (Vec<_>, Vec<_>) = rims.into_iter().partition(|p| !p.is_due(1));
    for wave in 1..=WAVES {
        last = waves.write(waves.inwards(wave, &last));
        // Rims that are due in the first wave follow in the second, with those of this wave.
        last.append(&mut waiting);
        if last.is_empty() {
            break;
        }
    }
    let eroded_pixels: Vec<_> = waves.eroded.pixels().collect();
    let isolated = waves.isolated();
    let of_eroded = eroded_pixels.par_iter().map(|&p| (p, waves.source_of(p), waves.depth[p]));
    let of_isolated =
        isolated.par_iter().map(|pixel| (pixel.place.index, pixel.shown_pixel(), pixel.depth));
    let continued = of_eroded.chain(of_isolated).map(|(pixel, source, depth)| {
        (pixel, waves.continued(waves.grid().place(pixel), source, depth))
    });
    let continued: Vec<_> = continued.collect();
    isolated.iter().for_each(|pixel| waves.eroded.set(pixel.place.index));
    let touched = waves.eroded.grown(false);
    eroded_pixels.iter().for_each(|&pixel| waves.source[pixel] = 0);
    continued.iter().for_each(|&(pixel, (_, depth))| waves.depth[pixel] = depth);
    *scratch = waves.source;
    let (gone, sources): (Vec<_>, Vec<_>) =
        continued.into_iter().map(|(pixel, (source, _))| (pixel, source)).unzip();
    replace(base, &gone, &sources);
    touched
}

/// State of the erosion between two waves.
struct Waves<'a> {
    base: &'a Level,
    /// One over the focal length, as in [`Rims`].
    per_focal: f32,
    /// Depth that each pixel shows.
    depth: &'a mut [f32],
    /// Pixel whose attributes a pixel shows, plus one, with the direction of the line above
    /// [`PIXEL_BITS`]; 0 if it shows its own.
    source: Vec<u32>,
    /// Pixels that were eroded.
    eroded: Marks,
}

/// A pixel that is eroded, and its source.
struct Eroded {
    place: PixelAt,
    source: u32,
    depth: f32,
}

impl Eroded {
    /// Pixel whose attributes it shows.
    fn shown_pixel(&self) -> usize {
        (self.source & PIXEL_MASK) as usize - 1
    }
}

impl PixelAt {
    /// Whether a wave decides on the pixel. The pixels beside it belong to the waves before and
    /// after.
    fn is_due(self, wave: u32) -> bool {
        (self.x + self.y + wave as usize).is_multiple_of(2)
    }
}

impl Waves<'_> {
    /// Pixel whose attributes a pixel shows.
    #[inline(always)]
    fn source_of(&self, pixel: usize) -> usize {
        ((self.source[pixel] & PIXEL_MASK) as usize).checked_sub(1).unwrap_or(pixel)
    }

    /// Pixels of `edges` that lie at a rim, each with the pixel beyond it as its source.
    fn rims(&self, edges: &Marks) -> Vec<Eroded> {
        let (picture, width) = (self.picture(), self.base.width);
        let rims = edges.bands().flat_map_iter(|pixels| {
            let mut eroded = Vec::new();
            for y in pixels.start / width..pixels.end / width {
                picture.rims_of_row(edges, y, |place, (after, line)| {
                    eroded.push(self.erode(place, after, line));
                });
            }
            eroded
        });
        rims.collect()
    }

    /// Pixels eroded in a wave, beside the pixels of the `last` one.
    fn inwards(&self, wave: u32, last: &[PixelAt]) -> Vec<Eroded> {
        last.par_chunks(JOB).flat_map_iter(|last| self.followers(wave, last)).collect()
    }

    /// Version of [`Waves::inwards`] for one job.
    fn followers(&self, wave: u32, last: &[PixelAt]) -> Vec<Eroded> {
        let mut candidates = Vec::with_capacity(2 * last.len());
        let width = self.base.width;
        for (i, &gone) in last.iter().enumerate() {
            if let Some(ahead) = last.get(i + AHEAD) {
                // The rows of its neighbours and of theirs.
                for row in 0..5 {
                    let pixel = (ahead.index + row * width).wrapping_sub(2 * width);
                    fetch(self.depth, pixel);
                    fetch(&self.source, pixel);
                }
            }
            for place in self.grid().beside(gone) {
                // A pixel beside several eroded ones follows the farthest.
                let is_behind = self.depth[gone.index] > self.depth[place.index];
                if is_behind && self.farthest(place) == Some(gone.index) {
                    let shown = self.source_of(place.index);
                    fetch(&self.base.tint, shown);
                    fetch(&self.base.front, shown);
                    candidates.push((place, gone.index, shown));
                }
            }
        }
        // All are read before any is decided, so that reads overlap.
        let shown: Vec<_> =
            candidates.iter().map(|&(.., by)| PixelEllipse::at(self.base, by)).collect();
        let mut eroded = Vec::with_capacity(candidates.len());
        for (&(place, gone, _), shown) in candidates.iter().zip(&shown) {
            let line = self.source[gone] >> PIXEL_BITS;
            let limit = self.picture().limit(place.index, shown.radius);
            if self.depth[gone] > limit && wave <= shown.radius as u32 && shown.sticks_out(line) {
                eroded.push(self.erode(place, gone, line));
            }
        }
        eroded
    }

    fn erode(&self, place: PixelAt, after: usize, line: u32) -> Eroded {
        let source = (self.source_of(after) as u32 + 1) | line << PIXEL_BITS;
        Eroded { place, source, depth: self.depth[after] }
    }

    /// Records the decisions of a wave, once all are made. Returns its pixels.
    fn write(&mut self, eroded: Vec<Eroded>) -> Vec<PixelAt> {
        let written = eroded.into_iter().filter_map(|Eroded { place, source, depth }| {
            let pixel = place.index;
            match self.source[pixel] {
                0 => self.eroded.set(pixel),
                // Decided twice, beside a pixel that was twice in the last wave.
                before if before == source => return None,
                _ => {}
            }
            (self.source[pixel], self.depth[pixel]) = (source, depth);
            Some(place)
        });
        written.collect()
    }

    /// The eroded neighbour of a pixel that shows the greatest depth; of equal ones the first in
    /// the order left, right, above, below.
    #[inline(always)]
    fn farthest(&self, place: PixelAt) -> Option<usize> {
        let mut farthest = None;
        for beside in self.grid().beside(place).map(|beside| beside.index) {
            let is_farther = farthest.is_none_or(|f: usize| self.depth[beside] > self.depth[f]);
            if is_farther && self.source[beside] > 0 && beside != place.index {
                farthest = Some(beside);
            }
        }
        farthest
    }

    /// Isolated pixels beside eroded ones, except where a line was eroded.
    fn isolated(&self) -> Vec<Eroded> {
        let beside = self.eroded.grown(false).without(&self.eroded);
        let isolated = beside.pixels().filter_map(|pixel| {
            let place = self.grid().place(pixel);
            let (picture, around) = (self.picture(), self.grid().around(place)?);
            let behind = |limit: f32| around.iter().filter(|p| self.depth[**p] > limit).count();
            // Most pixels are not isolated, which is decided without their radii.
            if behind(self.depth[pixel]) < ALONE {
                return None;
            }
            let radius = self.base.tint[pixel].w;
            let limit = picture.limit(pixel, radius);
            let is_isolated = radius >= ALONE_RADIUS_PX
                && behind(limit) >= ALONE
                && around.into_iter().all(|p| self.source[p] <= PIXEL_MASK);
            let after = self.farthest(place).filter(|_| is_isolated)?;
            (self.depth[after] > limit).then(|| self.erode(place, after, 0))
        });
        isolated.collect()
    }

    /// Source and depth that an eroded pixel shows in the end, given its `source` at the rim, which
    /// lies at `depth`. That is the pixel as far beyond the rim, mirrored, if it belongs to the
    /// same surface and was not eroded itself. Showing the pixel at the rim would make stripes.
    fn continued(&self, place: PixelAt, source: usize, depth: f32) -> (usize, f32) {
        let rim = self.grid().place(source);
        let Some(mirrored) = self.grid().mirrored(place, rim) else { return (source, depth) };
        let away = rim.x.abs_diff(place.x).max(rim.y.abs_diff(place.y));
        let slack = (self.base.tint[source].w + away as f32 * STEEPEST) * self.per_focal;
        let rise = self.depth[mirrored] - depth;
        if away >= MIRRORED_PX
            && self.source[mirrored] == 0
            && depth < f32::INFINITY
            && rise.abs() <= depth * slack.min(RISE_MAX)
        {
            (mirrored, depth - rise)
        } else {
            (source, depth)
        }
    }

    fn picture(&self) -> Rims<'_> {
        Rims { base: self.base, per_focal: self.per_focal, depth: self.depth }
    }

    fn grid(&self) -> Grid {
        self.picture().grid()
    }
}

/// Copies the attributes of `sources` to `pixels`.
fn replace(base: &mut Level, pixels: &[usize], sources: &[usize]) {
    let Level { front, tint, depth, normal, .. } = base;
    rayon::join(
        || rayon::join(|| copy(front, pixels, sources), || copy(tint, pixels, sources)),
        || {
            copy(depth, pixels, sources);
            if !normal.is_empty() {
                copy(normal, pixels, sources);
            }
        },
    );
}

fn copy<T: Copy>(plane: &mut [T], pixels: &[usize], sources: &[usize]) {
    // All are read first, since a source may be among the pixels.
    let taken: Vec<T> = sources.iter().map(|&p| plane[p]).collect();
    for (&pixel, taken) in pixels.iter().zip(taken) {
        plane[pixel] = taken;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::edges::edges;
    use crate::picture::pyramid::{INVALID, Planes, Pyramid};
    use glam::Vec4;

    const WIDTH: usize = 83;
    const HEIGHT: usize = 61;
    const FOCAL_PX: f32 = 100.0;

    /// Rectangles in front of each other, of pixels displaced at random.
    fn layers(seed: u64, has_normals: bool) -> (Pyramid, Vec<f32>) {
        let mut bits = seed;
        let mut dice = |n: usize| {
            bits ^= bits << 13;
            bits ^= bits >> 7;
            bits ^= bits << 17;
            (bits >> 20) as usize % n
        };
        let mut pyramid = Pyramid::default();
        pyramid.fit(WIDTH, HEIGHT, if has_normals { Planes::Normals } else { Planes::None });
        let base = &mut pyramid.levels[0];
        let mut depth = vec![f32::INFINITY; WIDTH * HEIGHT];
        base.front.fill(INVALID);
        for layer in 0..24 {
            let near = 24.0 / (layer + 1) as f32;
            let radius = 1.0 + dice(20) as f32;
            let [x, y] = [dice(WIDTH), dice(HEIGHT)];
            for (u, v) in (0..HEIGHT.min(y + 25))
                .skip(y)
                .flat_map(|v| (x..WIDTH.min(x + 25)).map(move |u| (u, v)))
            {
                let pixel = v * WIDTH + u;
                let mut moved = || (dice(32) as f32 - 16.0) / 16.0 * radius;
                base.front[pixel] = Vec4::new(near, near, moved(), moved());
                base.tint[pixel] = Vec4::new(0.0, 0.0, pixel as f32, radius);
                (base.depth[pixel], depth[pixel]) = (near, near);
                if has_normals {
                    base.normal[pixel] = Vec4::splat(pixel as f32);
                }
            }
        }
        (pyramid, depth)
    }

    /// Erosion pixel by pixel in the given order: the source of each pixel, and how many pixels
    /// were isolated, had an eroded source, and show a mirrored pixel.
    fn reference(
        base: &Level,
        depth: &mut [f32],
        edges: &Marks,
        order: &[usize],
    ) -> (Vec<Option<usize>>, [usize; 3]) {
        let before = &depth.to_vec();
        let rim = Rims { base, per_focal: 1.0 / FOCAL_PX, depth: before };
        let mut source = vec![None; depth.len()];
        let mut lines = vec![0; depth.len()];
        for pixel in edges.among(0..depth.len()) {
            let Some((beyond, line)) = rim.beyond(rim.grid().place(pixel)) else { continue };
            (source[pixel], lines[pixel]) = (Some(beyond), line);
            depth[pixel] = rim.depth[beyond];
        }
        for wave in 1..=WAVES {
            for &pixel in order {
                let (x, y) = (pixel % WIDTH, pixel / WIDTH);
                if (x + y + wave as usize) % 2 == 1 {
                    continue;
                }
                let shown = source[pixel].unwrap_or(pixel);
                let radius = base.tint[shown].w;
                let mut beyond = depth[pixel] * (1.0 + radius * (1.0 / FOCAL_PX));
                if wave as f32 > radius {
                    continue;
                }
                let mut chosen = None;
                for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                    let (u, v) = (x as isize + dx, y as isize + dy);
                    if !(0..WIDTH as isize).contains(&u) || !(0..HEIGHT as isize).contains(&v) {
                        continue;
                    }
                    let next = v as usize * WIDTH + u as usize;
                    if source[next].is_some() && depth[next] > beyond {
                        (beyond, chosen) = (depth[next], Some(next));
                    }
                }
                let shown = PixelEllipse::at(base, shown);
                if let Some(next) = chosen.filter(|&next| shown.sticks_out(lines[next])) {
                    (source[pixel], lines[pixel]) = (source[next], lines[next]);
                }
                depth[pixel] = source[pixel].map_or(depth[pixel], |s| rim.depth[s]);
            }
        }
        let (eroded_pixels, shown, mut isolated) = (source.clone(), depth.to_vec(), 0);
        for (x, y) in (1..HEIGHT - 1).flat_map(|y| (1..WIDTH - 1).map(move |x| (x, y))) {
            let pixel = y * WIDTH + x;
            let limit = depth[pixel] * (1.0 + base.tint[pixel].w * (1.0 / FOCAL_PX));
            let at = |dx: isize, dy: isize| pixel.wrapping_add_signed(dx + dy * WIDTH as isize);
            let around = || (0..9).filter(|&i| i != 4).map(|i| at(i % 3 - 1, i / 3 - 1));
            let is_isolated = around().filter(|&p| shown[p] > limit).count() >= 7
                && around().all(|p| lines[p] == 0)
                && base.tint[pixel].w >= 3.0;
            let mut after: Option<usize> = None;
            for next in [at(-1, 0), at(1, 0), at(0, -1), at(0, 1)] {
                if eroded_pixels[next].is_some() && after.is_none_or(|a| shown[next] > shown[a]) {
                    after = Some(next);
                }
            }
            let Some(after) = after
                .filter(|&a| eroded_pixels[pixel].is_none() && is_isolated && shown[a] > limit)
            else {
                continue;
            };
            (source[pixel], depth[pixel]) = (eroded_pixels[after], shown[after]);
            isolated += 1;
        }
        let (mut twice, mut continued) = (0, 0);
        for pixel in 0..depth.len() {
            let Some(rim) = source[pixel] else { continue };
            twice += usize::from(source[rim].is_some());
            let [x, y] = [pixel % WIDTH, pixel / WIDTH].map(|c| c as isize);
            let [u, v] = [rim % WIDTH, rim / WIDTH].map(|c| c as isize);
            let (there_x, there_y) = (2 * u - x, 2 * v - y);
            let is_inside = |c: isize, end: usize| (0..end as isize).contains(&c);
            if !is_inside(there_x, WIDTH) || !is_inside(there_y, HEIGHT) {
                continue;
            }
            let there = there_y as usize * WIDTH + there_x as usize;
            let away = (u - x).abs().max((v - y).abs()) as f32;
            let slack = (base.tint[rim].w + away * 4.0) * (1.0 / FOCAL_PX);
            let (here, beyond) = (before[rim], before[there]);
            let is_same = (beyond - here).abs() <= here * slack.min(0.5);
            if away >= 8.0 && eroded_pixels[there].is_none() && here.is_finite() && is_same {
                (source[pixel], depth[pixel]) = (Some(there), here - (beyond - here));
                continued += 1;
            }
        }
        (source, [isolated, twice, continued])
    }

    #[test]
    fn each_pixel_is_eroded_by_the_rule_in_whatever_order_pixels_are_visited() {
        let mut counts = [0; 3];
        for (seed, has_normals) in (1u64..40).flat_map(|seed| [(seed, false), (seed, true)]) {
            let (mut pyramid, mut depth) =
                layers(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15), has_normals);
            let (base, untouched) = (&mut pyramid.levels[0], depth.clone());
            let edges = edges(&depth, WIDTH, 2.0 / FOCAL_PX);
            let forwards: Vec<usize> = (0..depth.len()).collect();
            let backwards: Vec<usize> = forwards.iter().rev().copied().collect();
            let [expected, other] = [forwards, backwards].map(|order| {
                let mut depth = untouched.clone();
                (reference(base, &mut depth, &edges, &order), depth)
            });
            assert_eq!(expected, other);
            let ((expected, counted), expected_depth) = expected;
            counts.iter_mut().zip(counted).for_each(|(sum, n)| *sum += n);
            let before = base.clone();
            let touched = trim(base, &mut depth, &edges, FOCAL_PX);
            for (pixel, source) in expected.iter().enumerate() {
                let from = source.unwrap_or(pixel);
                assert_eq!(depth[pixel], expected_depth[pixel], "pixel {pixel}, seed {seed}");
                assert_eq!(base.front[pixel], before.front[from]);
                assert_eq!(base.tint[pixel], before.tint[from]);
                assert_eq!(base.depth[pixel], before.depth[from]);
                assert_eq!(base.normal.get(pixel), before.normal.get(from));
            }
            let is_eroded = |p: usize| expected[p].is_some();
            let grid = Grid { width: WIDTH, height: HEIGHT };
            let beside = |p: usize| grid.beside(grid.place(p)).into_iter();
            let changed = (0..depth.len())
                .filter(|&p| is_eroded(p) || beside(p).any(|place| is_eroded(place.index)));
            assert_eq!(touched.pixels().collect::<Vec<_>>(), changed.collect::<Vec<_>>());
            assert!(expected.iter().flatten().count() > 300, "seed {seed}");
        }
        assert!(counts.iter().all(|n| *n > 100), "isolated, eroded twice, mirrored: {counts:?}");
    }
}
