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
//! It goes inwards in waves, which only note for each pixel whose attributes it shows. As on a chessboard a
//! wave is for the pixels of one colour, which look at those of the other: each decides by itself, whatever
//! the order, so that any number of threads, and a GPU's pass for each wave, come to the same.

use crate::pyramid::Level;
use rayon::prelude::*;

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
/// How far a line may reach beyond its samples, pixels.
const LINE_OVERHANG_PX: f32 = 0.9;
/// A band is a line up to so many radii and pixels of width, where it goes on for so many radii on either side: one
/// sample alone is none, nor is one that stands out of a surface.
const LINE_WIDTH: (f32, f32) = (2.0, 2.0);
const LINE_SIDE: f32 = 2.0;
/// Radii beyond this, pixels, are not looked at for lines.
const LINE_RADIUS_MAX_PX: f32 = 32.0;
/// Bits of a source that name its pixel; above them is the outward direction of the line that it went from, plus one.
const PIXEL_BITS: u32 = 28;
const PIXEL_MASK: u32 = (1 << PIXEL_BITS) - 1;
/// Waves after that of the rims, at most. A surface has as many as its radius has pixels; beyond this many
/// only pictures of a few huge discs would change.
pub(crate) const WAVES: u32 = 256;
/// Directions to the neighbours, around.
const AROUND: [[isize; 2]; 8] =
    [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1]];

/// Trims `base`, whose depth image is `depth` (infinite where there is nothing) with its
/// [`crate::edges`]. Returns the pixels that changed and those beside them, each once.
pub fn trim(base: &mut Level, depth: &mut [f32], edges: &[usize], focal_px: f32) -> Vec<usize> {
    trim_with(&mut Vec::new(), base, depth, edges, focal_px)
}

/// The same; `scratch` is kept from frame to frame, all zeros in between.
pub(crate) fn trim_with(
    scratch: &mut Vec<u32>,
    base: &mut Level,
    depth: &mut [f32],
    edges: &[usize],
    focal_px: f32,
) -> Vec<usize> {
    scratch.resize(depth.len(), 0);
    let source = std::mem::take(scratch);
    let mut waves = Waves { base, per_focal: 1.0 / focal_px, depth, source };
    let mut gone = Vec::new();
    let rims = waves.write(waves.rims(edges), &mut gone);
    let (mut last, mut waiting): (Vec<_>, Vec<_>) =
        rims.into_iter().partition(|&p| !waves.is_due(p, 1));
    for wave in 1..=WAVES {
        last = waves.write(waves.inwards(wave, &last), &mut gone);
        // The rims that were due in the first wave themselves.
        last.append(&mut waiting);
        if last.is_empty() {
            break;
        }
    }
    let sources: Vec<_> = gone.par_iter().map(|&p| waves.shown(p)).collect();
    let beside = waves.beside(&gone);
    *scratch = waves.source;
    gone.iter().for_each(|&pixel| scratch[pixel] = 0);
    replace(base, &gone, &sources);
    gone.extend(beside);
    gone
}

/// What the waves up to one have decided.
struct Waves<'a> {
    base: &'a Level,
    /// One over the focal length in pixels: GPUs round products as everyone does, but not quotients.
    per_focal: f32,
    /// Depth of what each pixel shows.
    depth: &'a mut [f32],
    /// For each pixel the one whose attributes it shows, plus one, and above [`PIXEL_BITS`] the line's direction; 0
    /// where it shows its own.
    source: Vec<u32>,
}

/// A pixel that goes, and the one whose attributes it is to show.
struct Step {
    pixel: usize,
    source: u32,
    depth: f32,
}

impl Waves<'_> {
    /// The pixel whose attributes a pixel shows.
    fn shown(&self, pixel: usize) -> usize {
        ((self.source[pixel] & PIXEL_MASK) as usize).checked_sub(1).unwrap_or(pixel)
    }

    /// Whether a wave is for a pixel. Beside it are those of the waves before and after.
    fn is_due(&self, pixel: usize, wave: u32) -> bool {
        let [x, y] = [pixel % self.base.width, pixel / self.base.width];
        (x + y + wave as usize).is_multiple_of(2)
    }

    /// The pixels of `edges` at a rim, each with what lies beyond it.
    fn rims(&self, edges: &[usize]) -> Vec<Step> {
        let rims = edges.par_iter().with_min_len(1024);
        let step =
            |pixel| self.beyond_rim(pixel).map(|(after, line)| self.step(pixel, after, line));
        rims.filter_map(|&pixel| step(pixel)).collect()
    }

    /// The pixels that go in a wave, each with its source; beside them are `last`, which went before.
    fn inwards(&self, wave: u32, last: &[usize]) -> Vec<Step> {
        let follow = last.par_iter().with_min_len(512).flat_map_iter(|&gone| {
            let beside = self.grid().beside(gone).into_iter().flatten();
            // A pixel beside several goes with the one that it has chosen.
            let follow = beside.filter(move |&p| self.follows(wave, p, gone));
            follow.map(move |p| self.step(p, gone, self.source[gone] >> PIXEL_BITS))
        });
        follow.collect()
    }

    fn step(&self, pixel: usize, after: usize, line: u32) -> Step {
        let source = (self.shown(after) as u32 + 1) | line << PIXEL_BITS;
        Step { pixel, source, depth: self.depth[after] }
    }

    /// Notes what a wave has decided: all of it, once all is decided. Returns its pixels; those that had
    /// not gone before are added to `gone`.
    fn write(&mut self, steps: Vec<Step>, gone: &mut Vec<usize>) -> Vec<usize> {
        let written = steps.into_iter().filter_map(|Step { pixel, source, depth }| {
            match self.source[pixel] {
                0 => gone.push(pixel),
                // Twice among the steps, after a neighbour that was twice among the last.
                before if before == source => return None,
                _ => {}
            }
            (self.source[pixel], self.depth[pixel]) = (source, depth);
            Some(pixel)
        });
        written.collect()
    }

    /// Whether a pixel goes in a wave, and after this neighbour: of those that went and show another surface
    /// behind its own the farthest, of equals the first in the order left, right, above, below.
    fn follows(&self, wave: u32, pixel: usize, after: usize) -> bool {
        let behind = self.depth[after];
        if behind <= self.depth[pixel] {
            return false;
        }
        let shown = self.shown(pixel);
        let (radius, limit) = (self.base.tint[shown].w, self.limit(pixel, shown));
        let line = self.source[after] >> PIXEL_BITS;
        if behind <= limit || wave > radius as u32 || !sticks_out(self.base, shown, line) {
            return false;
        }
        let beside = self.grid().beside(pixel).into_iter().flatten();
        let farthest = beside
            .filter(|&p| self.source[p] > 0)
            .reduce(|far, p| if self.depth[p] > self.depth[far] { p } else { far });
        farthest == Some(after)
    }

    /// The pixels that stay beside those that went, each once.
    fn beside(&self, gone: &[usize]) -> Vec<usize> {
        let went = |p: usize| self.source[p] > 0;
        let beside = |p| self.grid().beside(p).into_iter().flatten();
        let found = gone.par_iter().with_min_len(4096).flat_map_iter(|&pixel| {
            beside(pixel).filter(move |&p| !went(p) && beside(p).find(|&q| went(q)) == Some(pixel))
        });
        found.collect()
    }

    fn grid(&self) -> Grid {
        Grid { width: self.base.width, height: self.base.height }
    }

    /// Depth beyond which there is another surface than the one that a pixel shows.
    fn limit(&self, pixel: usize, shown: usize) -> f32 {
        self.depth[pixel] * (1.0 + self.base.tint[shown].w * self.per_focal)
    }

    /// The pixel beyond the rim, where the pixel is at one: outwards in three neighbouring directions
    /// nothing lies as near as the surface. And where the rim is a line's, its direction outwards plus one, else 0.
    fn beyond_rim(&self, pixel: usize) -> Option<(usize, u32)> {
        if self.depth[pixel] == f32::INFINITY || !may_stick_out(self.base, pixel) {
            return None;
        }
        let limit = self.limit(pixel, pixel);
        let is_open = |way| self.is_open(pixel, way, self.base.tint[pixel].w, limit);
        let mut open = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| i % 2 == 0 && is_open(AROUND[i]));
        for i in [1, 3, 5, 7] {
            open[i] = (open[i - 1] || open[(i + 1) % 8]) && is_open(AROUND[i]);
        }
        let middle = (0..8).find(|&i| open[(i + 7) % 8] && open[i] && open[(i + 1) % 8])?;
        let line = self.line(pixel, open, limit);
        let beyond = self.grid().step(pixel, AROUND[middle])?;
        (line > 0 || sticks_out(self.base, pixel, 0)).then_some((beyond, line))
    }

    /// Whether nothing lies as near as `limit` from a pixel in a direction, for a radius.
    fn is_open(&self, pixel: usize, [dx, dy]: [isize; 2], radius: f32, limit: f32) -> bool {
        let Grid { width, height } = self.grid();
        let reach = (radius + 1.0).clamp(OPEN_PX.0, OPEN_PX.1) as isize;
        let (x, y) = ((pixel % width) as isize, (pixel / width) as isize);
        for k in 1..=reach {
            let (u, v) = ((x + dx * k) as usize, (y + dy * k) as usize);
            // What is left of the picture or above it wraps round to far beyond it.
            if u >= width || v >= height {
                return k as f32 > OPEN_PX.0;
            }
            if self.depth[v * width + u] <= limit {
                return false;
            }
        }
        true
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
                if !self.is_open(inner, inwards, radius, limit) {
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
fn sticks_out(base: &Level, pixel: usize, line: u32) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edges::edges;
    use crate::pyramid::{INVALID, Pyramid};
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
        pyramid.fit(WIDTH, HEIGHT, has_normals);
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

    /// The rule, pixel by pixel: what each shows, and where it went.
    fn reference(
        base: &Level,
        depth: &mut [f32],
        edges: &[usize],
        order: &[usize],
    ) -> Vec<Option<usize>> {
        let before = &mut depth.to_vec();
        let rim =
            Waves { base, per_focal: 1.0 / FOCAL_PX, depth: before, source: vec![0; depth.len()] };
        let mut source = vec![None; depth.len()];
        let mut lines = vec![0; depth.len()];
        for &pixel in edges {
            let Some((beyond, line)) = rim.beyond_rim(pixel) else { continue };
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
                if let Some(next) = chosen.filter(|&next| sticks_out(base, shown, lines[next])) {
                    (source[pixel], lines[pixel]) = (source[next], lines[next]);
                }
                depth[pixel] = source[pixel].map_or(depth[pixel], |s| rim.depth[s]);
            }
        }
        source
    }

    #[test]
    fn what_goes_is_what_the_rule_says_of_each_pixel_in_whatever_order_they_are_asked() {
        let mut went_twice = 0;
        for (seed, has_normals) in (1..40).flat_map(|seed| [(seed, false), (seed, true)]) {
            let (mut pyramid, mut depth) = layers(seed * 0x9E37_79B9_7F4A_7C15, has_normals);
            let (base, untouched) = (&mut pyramid.levels[0], depth.clone());
            let edges = edges(&depth, WIDTH, 2.0 / FOCAL_PX);
            let forwards: Vec<usize> = (0..depth.len()).collect();
            let backwards: Vec<usize> = forwards.iter().rev().copied().collect();
            let [expected, other] = [forwards, backwards]
                .map(|order| reference(base, &mut untouched.clone(), &edges, &order));
            assert_eq!(expected, other);
            let before = base.clone();
            let mut touched = trim(base, &mut depth, &edges, FOCAL_PX);
            for (pixel, source) in expected.iter().enumerate() {
                let from = source.unwrap_or(pixel);
                went_twice += usize::from(expected[from].is_some() && from != pixel);
                assert_eq!(depth[pixel], untouched[from], "pixel {pixel}, seed {seed}");
                assert_eq!(base.front[pixel], before.front[from]);
                assert_eq!(base.tint[pixel], before.tint[from]);
                assert_eq!(base.depth[pixel], before.depth[from]);
                assert_eq!(base.normal.get(pixel), before.normal.get(from));
            }
            let went = |p: usize| expected[p].is_some();
            let beside = |p: usize| Grid { width: WIDTH, height: HEIGHT }.beside(p);
            let changed =
                (0..depth.len()).filter(|&p| went(p) || beside(p).into_iter().flatten().any(went));
            touched.sort_unstable();
            assert_eq!(touched, changed.collect::<Vec<_>>());
            assert!(expected.iter().flatten().count() > 300, "seed {seed}");
        }
        assert!(went_twice > 100, "sources that went themselves: {went_twice}");
    }
}
