//! Trim: takes back what sticks out. Discs close a surface because they are wider than the samples lie
//! apart, so at its rim they stick out by up to a radius, each by another length. Discs are a dilation of
//! the samples; this is the erosion that makes a closing of it.
//!
//! Within a surface the ellipse of a filled pixel is the mean of those around, centred near the pixel. At a
//! rim they all lie on one side, and the displacement from the ellipse's centre to the pixel (marroquim2007
//! section 3.2) tells how far beyond the samples the pixel lies. Such pixels are given to what is behind,
//! from the rim inwards. Gaps smaller than a radius have no rim: they are not to grow.
//!
//! Where samples lie on a line (a wire, a railing), discs make a band of it as wide as they are, and both of its rims
//! are beyond the samples. What sticks out of a line is cut to its samples, by the displacement across it alone: along
//! it a pixel may lie far from them.
//!
//! Where two samples lie far apart, the pixels halfway between them have their mean in the middle: of what spans such a gap a
//! pixel here and there would stay, and float in front of what is behind. So a pixel that is left alone goes too.
//!
//! What is behind goes on where a pixel went: it shows what lies as far beyond the rim, mirrored.
//!
//! It goes inwards in waves, which only note for each pixel whose attributes it shows. As on a chessboard a
//! wave is for the pixels of one colour, which look at those of the other: each decides by itself, whatever
//! the order, so that any number of threads, and a GPU's pass for each wave, come to the same.

pub(crate) mod rim;
pub(crate) mod rows;

use crate::passes::silhouette::rim::{Grid, PixelAt, PixelEllipse, Rims};
use crate::picture::marks::Marks;
use crate::picture::pyramid::Level;
use esker_points::fetch::fetch;
use rayon::prelude::*;

/// Bits of a source that name its pixel; above them is the outward direction of the line that it went from, plus one.
const PIXEL_BITS: u32 = 28;
const PIXEL_MASK: u32 = (1 << PIXEL_BITS) - 1;
/// Waves after that of the rims, at most. A surface has as many as its radius has pixels; beyond this many
/// only pictures of a few huge discs would change.
pub(crate) const WAVES: u32 = 256;
/// Pixels of a wave that a job takes: fewer take less time than waking another thread.
const JOB: usize = 256;
/// So many pixels before it is looked at, what lies around a pixel is asked for.
const AHEAD: usize = 8;
/// A pixel is left alone where so many of its eight neighbours show what lies behind it, and its radius has so many pixels: a
/// sample's own pixel keeps three of them at least, since it is trimmed to more than a pixel around it. Where radii are
/// smaller, rims need theirs.
const ALONE: usize = 7;
const ALONE_RADIUS_PX: f32 = 3.0;

/// What lies behind goes on where a pixel has gone, as far as its depth changes by so many pixels' worth a pixel (ground seen
/// aslant), and by so much of it at most.
const STEEPEST: f32 = 4.0;
/// Nearer to the rim, pixels, it is shown as it is there: what is mirrored flickers, and stripes are no longer than that.
const MIRRORED_PX: usize = 8;
const RISE_MAX: f32 = 0.5;

/// Trims `base`, whose depth image is `depth` (infinite where there is nothing) with its
/// [`crate::picture::edges`]. Returns the pixels that changed and those beside them.
pub fn trim(base: &mut Level, depth: &mut [f32], edges: &Marks, focal_px: f32) -> Marks {
    trim_with(&mut Vec::new(), base, depth, edges, focal_px)
}

/// The same; `scratch` is kept from frame to frame, all zeros in between.
pub(crate) fn trim_with(
    scratch: &mut Vec<u32>,
    base: &mut Level,
    depth: &mut [f32],
    edges: &Marks,
    focal_px: f32,
) -> Marks {
    scratch.resize(depth.len(), 0);
    let (source, gone) = (std::mem::take(scratch), Marks::new(base.width, base.height));
    let mut waves = Waves { base, per_focal: 1.0 / focal_px, depth, source, gone };
    let rims = waves.write(waves.rims(edges));
    let (mut last, mut waiting): (Vec<_>, Vec<_>) = rims.into_iter().partition(|p| !p.is_due(1));
    for wave in 1..=WAVES {
        last = waves.write(waves.inwards(wave, &last));
        // The rims that were due in the first wave themselves.
        last.append(&mut waiting);
        if last.is_empty() {
            break;
        }
    }
    let went: Vec<_> = waves.gone.pixels().collect();
    let alone = waves.left_alone();
    let of_went = went.par_iter().map(|&p| (p, waves.source_of(p), waves.depth[p]));
    let of_alone = alone.par_iter().map(|step| (step.place.index, step.shown(), step.depth));
    let carried = of_went.chain(of_alone).map(|(pixel, source, depth)| {
        (pixel, waves.carried_on(waves.grid().place(pixel), source, depth))
    });
    let carried: Vec<_> = carried.collect();
    alone.iter().for_each(|step| waves.gone.set(step.place.index));
    let touched = waves.gone.grown(false);
    went.iter().for_each(|&pixel| waves.source[pixel] = 0);
    carried.iter().for_each(|&(pixel, (_, depth))| waves.depth[pixel] = depth);
    *scratch = waves.source;
    let (gone, sources): (Vec<_>, Vec<_>) =
        carried.into_iter().map(|(pixel, (source, _))| (pixel, source)).unzip();
    replace(base, &gone, &sources);
    touched
}

/// What the waves up to one have decided.
struct Waves<'a> {
    base: &'a Level,
    /// As in [`Rims`].
    per_focal: f32,
    /// Depth of what each pixel shows.
    depth: &'a mut [f32],
    /// For each pixel the one whose attributes it shows, plus one, and above [`PIXEL_BITS`] the line's direction; 0
    /// where it shows its own.
    source: Vec<u32>,
    /// Those that show others'.
    gone: Marks,
}

/// A pixel that goes, and the one whose attributes it is to show.
struct Step {
    place: PixelAt,
    source: u32,
    depth: f32,
}

impl Step {
    /// The pixel whose attributes it is to show.
    fn shown(&self) -> usize {
        (self.source & PIXEL_MASK) as usize - 1
    }
}

impl PixelAt {
    /// Whether a wave is for a pixel. Beside it are those of the waves before and after.
    fn is_due(self, wave: u32) -> bool {
        (self.x + self.y + wave as usize).is_multiple_of(2)
    }
}

impl Waves<'_> {
    /// The pixel whose attributes a pixel shows.
    #[inline(always)]
    fn source_of(&self, pixel: usize) -> usize {
        ((self.source[pixel] & PIXEL_MASK) as usize).checked_sub(1).unwrap_or(pixel)
    }

    /// The pixels of `edges` at a rim, each with what lies beyond it.
    fn rims(&self, edges: &Marks) -> Vec<Step> {
        let (picture, width) = (self.picture(), self.base.width);
        let rims = edges.bands().flat_map_iter(|pixels| {
            let mut steps = Vec::new();
            for y in pixels.start / width..pixels.end / width {
                picture.rims_of_row(edges, y, |place, (after, line)| {
                    steps.push(self.step(place, after, line));
                });
            }
            steps
        });
        rims.collect()
    }

    /// The pixels that go in a wave, each with its source; beside them are `last`, which went before.
    fn inwards(&self, wave: u32, last: &[PixelAt]) -> Vec<Step> {
        last.par_chunks(JOB).flat_map_iter(|last| self.followers(wave, last)).collect()
    }

    /// Those beside these.
    fn followers(&self, wave: u32, last: &[PixelAt]) -> Vec<Step> {
        let mut candidates = Vec::with_capacity(2 * last.len());
        let width = self.base.width;
        for (i, &gone) in last.iter().enumerate() {
            if let Some(ahead) = last.get(i + AHEAD) {
                // The rows that its neighbours and theirs lie in.
                for row in 0..5 {
                    let pixel = (ahead.index + row * width).wrapping_sub(2 * width);
                    fetch(self.depth, pixel);
                    fetch(&self.source, pixel);
                }
            }
            for place in self.grid().beside(gone) {
                // A pixel beside several goes with the one that it has chosen.
                let is_behind = self.depth[gone.index] > self.depth[place.index];
                if is_behind && self.farthest(place) == Some(gone.index) {
                    let shown = self.source_of(place.index);
                    fetch(&self.base.tint, shown);
                    fetch(&self.base.front, shown);
                    candidates.push((place, gone.index, shown));
                }
            }
        }
        // Read before any is judged, so that reads do not wait for each other.
        let shown: Vec<_> =
            candidates.iter().map(|&(.., by)| PixelEllipse::at(self.base, by)).collect();
        let mut steps = Vec::with_capacity(candidates.len());
        for (&(place, gone, _), shown) in candidates.iter().zip(&shown) {
            let line = self.source[gone] >> PIXEL_BITS;
            let limit = self.picture().limit(place.index, shown.radius);
            if self.depth[gone] > limit && wave <= shown.radius as u32 && shown.sticks_out(line) {
                steps.push(self.step(place, gone, line));
            }
        }
        steps
    }

    fn step(&self, place: PixelAt, after: usize, line: u32) -> Step {
        let source = (self.source_of(after) as u32 + 1) | line << PIXEL_BITS;
        Step { place, source, depth: self.depth[after] }
    }

    /// Notes what a wave has decided: all of it, once all is decided. Returns its pixels.
    fn write(&mut self, steps: Vec<Step>) -> Vec<PixelAt> {
        let written = steps.into_iter().filter_map(|Step { place, source, depth }| {
            let pixel = place.index;
            match self.source[pixel] {
                0 => self.gone.set(pixel),
                // Twice among the steps, after a neighbour that was twice among the last.
                before if before == source => return None,
                _ => {}
            }
            (self.source[pixel], self.depth[pixel]) = (source, depth);
            Some(place)
        });
        written.collect()
    }

    /// Of a pixel's neighbours that went the one that shows what is farthest, of equals the first in the order left, right,
    /// above, below.
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

    /// The pixels that are left alone beside those that went; none beside what went from a line.
    fn left_alone(&self) -> Vec<Step> {
        let beside = self.gone.grown(false).without(&self.gone);
        let alone = beside.pixels().filter_map(|pixel| {
            let place = self.grid().place(pixel);
            let (picture, around) = (self.picture(), self.grid().around(place)?);
            let behind = |limit: f32| around.iter().filter(|p| self.depth[**p] > limit).count();
            // Most are not, which is seen without their radii.
            if behind(self.depth[pixel]) < ALONE {
                return None;
            }
            let radius = self.base.tint[pixel].w;
            let limit = picture.limit(pixel, radius);
            let is_alone = radius >= ALONE_RADIUS_PX
                && behind(limit) >= ALONE
                && around.into_iter().all(|p| self.source[p] <= PIXEL_MASK);
            let after = self.farthest(place).filter(|_| is_alone)?;
            (self.depth[after] > limit).then(|| self.step(place, after, 0))
        });
        alone.collect()
    }

    /// What a pixel shows in the end, and its depth, that has gone and shows `source`, which lies at `depth`, beyond the rim: what lies
    /// behind goes on as it came there, mirrored, where that is the same surface and has not gone itself. (Shown as it is at the
    /// rim, it would make stripes.)
    fn carried_on(&self, place: PixelAt, source: usize, depth: f32) -> (usize, f32) {
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

/// Gives pixels the attributes of their sources.
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
    // A source may be among the pixels.
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

    /// Rectangles before each other, of pixels displaced at random, more towards their borders.
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

    /// The rule, pixel by pixel: what each that went shows, and its depth; and how many were left alone, showed one that went
    /// itself, and show what is mirrored.
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
        let (went, shown, mut left) = (source.clone(), depth.to_vec(), 0);
        for (x, y) in (1..HEIGHT - 1).flat_map(|y| (1..WIDTH - 1).map(move |x| (x, y))) {
            let pixel = y * WIDTH + x;
            let limit = depth[pixel] * (1.0 + base.tint[pixel].w * (1.0 / FOCAL_PX));
            let at = |dx: isize, dy: isize| pixel.wrapping_add_signed(dx + dy * WIDTH as isize);
            let around = || (0..9).filter(|&i| i != 4).map(|i| at(i % 3 - 1, i / 3 - 1));
            let is_alone = around().filter(|&p| shown[p] > limit).count() >= 7
                && around().all(|p| lines[p] == 0)
                && base.tint[pixel].w >= 3.0;
            let mut after: Option<usize> = None;
            for next in [at(-1, 0), at(1, 0), at(0, -1), at(0, 1)] {
                if went[next].is_some() && after.is_none_or(|a| shown[next] > shown[a]) {
                    after = Some(next);
                }
            }
            let Some(after) =
                after.filter(|&a| went[pixel].is_none() && is_alone && shown[a] > limit)
            else {
                continue;
            };
            (source[pixel], depth[pixel]) = (went[after], shown[after]);
            left += 1;
        }
        let (mut twice, mut carried) = (0, 0);
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
            if away >= 8.0 && went[there].is_none() && here.is_finite() && is_same {
                (source[pixel], depth[pixel]) = (Some(there), here - (beyond - here));
                carried += 1;
            }
        }
        (source, [left, twice, carried])
    }

    #[test]
    fn what_goes_is_what_the_rule_says_of_each_pixel_in_whatever_order_they_are_asked() {
        let mut counts = [0; 3];
        for (seed, has_normals) in (1..40).flat_map(|seed| [(seed, false), (seed, true)]) {
            let (mut pyramid, mut depth) = layers(seed * 0x9E37_79B9_7F4A_7C15, has_normals);
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
            let went = |p: usize| expected[p].is_some();
            let grid = Grid { width: WIDTH, height: HEIGHT };
            let beside = |p: usize| grid.beside(grid.place(p)).into_iter();
            let changed =
                (0..depth.len()).filter(|&p| went(p) || beside(p).any(|place| went(place.index)));
            assert_eq!(touched.pixels().collect::<Vec<_>>(), changed.collect::<Vec<_>>());
            assert!(expected.iter().flatten().count() > 300, "seed {seed}");
        }
        assert!(counts.iter().all(|n| *n > 100), "left alone, went twice, mirrored: {counts:?}");
    }
}
