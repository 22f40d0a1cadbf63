//! Smooths the depth image of clouds without normals, and derives the shape of a surface from a
//! depth image: normals from differences of depth, and the distance of a pixel behind its
//! surroundings, by which shading darkens it (eye-dome lighting, `boucheny2009`).
//!
//! The smoothing is a separable bilateral mean of five pixels along each axis, first as wide as the
//! discs around the pixel, then narrower and narrower: depths that differ from the middle by more
//! than a surface can take no part. Narrow means remove the patterns that wide ones leave where
//! their taps alternate between surfaces. Loops over rows are free of branches; infinite depth (an
//! empty pixel) fails every comparison by itself.

use crate::inputs::camera::Camera;
use crate::picture::radii::Radii;
use crate::picture::surface::Surface;
use crate::simd::values::{EIGHT, Values, dot, load, only};
use fearless_simd::{Level, Simd, dispatch, f32x8};
use rayon::prelude::*;

/// Steepest slope (depth over width) that still counts as one surface.
pub(crate) const SLOPE_MAX: f32 = 6.0;
/// Weights of the smoothing, from the middle outwards (binomial).
pub(crate) const TAPS: [f32; 3] = [6.0, 4.0, 1.0];
/// Distances of taps, pixels. The rounds of the last two always run.
pub(crate) const STEPS: [usize; 4] = [8, 4, 2, 1];
/// Radius of discs over the distance of taps from which a round takes part, and from which it has
/// its full weight. In between its weight grows with the radius, so that pictures do not jump when
/// the view changes a little.
pub(crate) const RADIUS_PER_STEP: [f32; 2] = [1.7, 2.5];
/// Distance of the surroundings that a pixel is compared with, pixels.
pub(crate) const REACH: usize = 2;
/// Slope beyond which greater differences of depth darken no more.
pub(crate) const BEHIND_MAX: f32 = 4.0;

/// A depth image; infinite where it is empty.
#[derive(Clone, Copy)]
pub struct DepthImage<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Linear eye depth, row by row.
    pub depth: &'a [f32],
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle, pixels.
    pub centre_px: [f32; 2],
    /// Radii of the discs that the surface was filled from: steps of depth are this far apart.
    /// `None` counts as zero.
    pub radii: Option<&'a Radii>,
}

/// Memory kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct SmoothDepthScratch {
    rows: Vec<f32>,
    smooth: Vec<f32>,
    nothing: Vec<f32>,
    /// Radii of the discs of the last image that [`smooth_depth`] smoothed.
    radii: Radii,
}

impl SmoothDepthScratch {
    /// Takes a depth image as it is, in place of [`smooth_depth`].
    pub(crate) fn keep(&mut self, depth: &[f32]) {
        self.smooth.clear();
        self.smooth.extend_from_slice(depth);
        self.radii = Radii::default();
    }

    /// The depth image that [`smooth_depth`] left, for the same camera.
    pub fn image(&self, camera: &Camera) -> DepthImage<'_> {
        DepthImage::new(camera, &self.smooth, Some(&self.radii))
    }
}

/// Smooths the depth image of a surface without normals into `scratch`, as wide as its discs are.
pub fn smooth_depth(
    camera: &Camera,
    surface: &impl Surface,
    depth: &[f32],
    scratch: &mut SmoothDepthScratch,
) {
    let mut radii = std::mem::take(&mut scratch.radii);
    radii.measure(surface, depth);
    DepthImage::new(camera, depth, Some(&radii)).smoothed(scratch);
    scratch.radii = radii;
}

impl<'a> DepthImage<'a> {
    /// The depth image of a camera's picture, with its margin.
    pub fn new(camera: &Camera, depth: &'a [f32], radii: Option<&'a Radii>) -> Self {
        let width = camera.size[0] as usize;
        let Camera { focal_px, centre_px, .. } = *camera;
        Self { width, depth, focal_px, centre_px, radii }
    }

    fn row(&self, y: usize) -> &'a [f32] {
        &self.depth[y * self.width..][..self.width]
    }

    /// Smooths the image along both axes into `scratch`.
    pub fn smoothed<'b>(self, scratch: &'b mut SmoothDepthScratch) -> DepthImage<'b>
    where
        'a: 'b,
    {
        let SmoothDepthScratch { rows, smooth, nothing, .. } = scratch;
        rows.resize(self.depth.len(), 0.0);
        smooth.resize(self.depth.len(), 0.0);
        nothing.clear();
        nothing.resize(self.width, f32::INFINITY);
        let most = self.radii.map_or(0.0, Radii::most);
        let mut is_rough = true;
        for step in STEPS {
            if share(most, step as f32) == 0.0 {
                continue;
            }
            let rough = if is_rough { self.depth } else { &*smooth };
            DepthImage { depth: rough, ..self }.smooth_rows(step, rows);
            DepthImage { depth: rows, ..self }.smooth_columns(step, nothing, smooth);
            is_rough = false;
        }
        DepthImage { depth: smooth, ..self }
    }

    /// Writes the mean along rows to `out`, from taps `step` pixels apart.
    fn smooth_rows(&self, step: usize, out: &mut [f32]) {
        let reach = 2 * step;
        out.par_chunks_mut(self.width).enumerate().for_each_init(Vec::new, |room, (y, out)| {
            let row = self.row(y);
            let inner = self.width.saturating_sub(2 * reach);
            let first = reach.min(self.width);
            out[..first].copy_from_slice(&row[..first]);
            out[first + inner..].copy_from_slice(&row[first + inner..]);
            // Five views of the row, so that the loop needs no bounds checks.
            let view = |k: usize| row.get(k * step..k * step + inner).unwrap_or(&[]);
            let taps = [view(0), view(1), view(2), view(3), view(4)];
            let out = out.get_mut(reach..reach + inner).unwrap_or(&mut []);
            self.smooth_run(step, taps, [reach, y], room, out);
        });
    }

    /// Writes the mean along columns to `out`; `nothing` replaces rows outside the image.
    fn smooth_columns(&self, step: usize, nothing: &[f32], out: &mut [f32]) {
        let height = self.depth.len() / self.width;
        out.par_chunks_mut(self.width).enumerate().for_each_init(Vec::new, |room, (y, out)| {
            let up = |k: usize| y.checked_sub(k * step).map_or(nothing, |y| self.row(y));
            let down =
                |k: usize| if y + k * step < height { self.row(y + k * step) } else { nothing };
            let taps = [up(2), up(1), self.row(y), down(1), down(2)];
            self.smooth_run(step, taps, [0, y], room, out);
        });
    }

    /// Writes the mean of five runs, whose taps are `step` pixels apart, to `out`, which begins at
    /// pixel (`x`, `y`). `room` is reused.
    #[inline]
    fn smooth_run(
        &self,
        step: usize,
        taps: [&[f32]; 5],
        [x, y]: [usize; 2],
        room: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        let slope = SLOPE_MAX / self.focal_px;
        let Some(radii) = self.radii else {
            dispatch!(Level::new(), _ => mean(taps, step as f32 * slope, out));
            return;
        };
        // Radii up to which a round is left out, or is as for points.
        let limit = step as f32 * if step > 2 { RADIUS_PER_STEP[0] } else { 2.0 };
        for (run, is_wide) in radii.runs(y, limit) {
            let run = run.start.max(x) - x..run.end.min(x + out.len()).max(x) - x;
            let taps = taps.map(|t| t.get(run.clone()).unwrap_or(&[]));
            let Some(out) = out.get_mut(run.clone()) else { continue };
            if !is_wide && step > 2 {
                out.copy_from_slice(taps[2]);
                continue;
            }
            dispatch!(Level::new(), _ => {
                if !is_wide {
                    return mean(taps, step as f32 * slope, out);
                }
                let part = run.start + x..run.end + x;
                radii.write(y, &part, room);
                let radii = &room[part];
                match step {
                    1 => mean_as_wide::<1>(taps, radii, slope, out),
                    2 => mean_as_wide::<2>(taps, radii, slope, out),
                    4 => mean_as_wide::<4>(taps, radii, slope, out),
                    _ => mean_as_wide::<8>(taps, radii, slope, out),
                }
            });
        }
    }

    /// Radii of the discs of row `y`; empty if they are too small to matter to neighbouring pixels.
    fn wide_radii(&self, y: usize) -> Vec<f32> {
        let mut row = Vec::new();
        if let Some(radii) = self.radii {
            for (run, is_wide) in radii.runs(y, 2.0) {
                if is_wide {
                    dispatch!(Level::new(), _ => radii.write(y, &run, &mut row));
                }
            }
        }
        row
    }

    /// Rows around row `y`, from which the shape there is derived; `nothing` replaces rows outside
    /// the image.
    pub fn surroundings<'s>(&self, y: usize, nothing: &'s [f32]) -> Surroundings<'s>
    where
        'a: 's,
    {
        let height = self.depth.len() / self.width;
        let up = |k: usize| y.checked_sub(k).map_or(nothing, |y| self.row(y));
        let down = |k: usize| if y + k < height { self.row(y + k) } else { nothing };
        Surroundings {
            above: up(1),
            here: self.row(y),
            below: down(1),
            far: [up(REACH), self.row(y), down(REACH)],
            focal_px: self.focal_px,
            centre_px: self.centre_px,
            radii: self.wide_radii(y),
            y,
        }
    }
}

/// Share of its weights that a round has whose taps are `step` pixels apart; 0 if it is left out.
#[inline(always)]
fn share(radius_px: f32, step: f32) -> f32 {
    let [from, full] = RADIUS_PER_STEP;
    if step <= 2.0 {
        return 1.0;
    }
    ((radius_px / step - from) / (full - from)).clamp(0.0, 1.0)
}

/// Writes the bilateral mean of five rows to `out`; `near` is the greatest relative difference to
/// the middle.
#[inline(always)]
fn mean(taps: [&[f32]; 5], near: f32, out: &mut [f32]) {
    let n = out.len();
    let [a2, a1, middle, b1, b2] = taps.map(|t| &t[..n]);
    for x in 0..n {
        let m = middle[x];
        let around = [a2[x], a1[x], m, b1[x], b2[x]];
        out[x] = mean_of(around, near * m, TAPS);
    }
}

/// [`mean`] as wide as the discs around each pixel: `STEP` is the distance of taps, `radii` are
/// those of the discs, and `slope` is the greatest relative change of depth a pixel.
#[inline(always)]
fn mean_as_wide<const STEP: usize>(taps: [&[f32]; 5], radii: &[f32], slope: f32, out: &mut [f32]) {
    let n = out.len();
    let [a2, a1, middle, b1, b2] = taps.map(|t| &t[..n]);
    let (radii, step) = (&radii[..n], STEP as f32);
    for x in 0..n {
        let m = middle[x];
        let share = share(radii[x], step);
        // Between neighbouring discs depth changes at once by the change over their distance.
        let limit = slope * step.max(radii[x] * 0.5) * m;
        let around = [a2[x], a1[x], m, b1[x], b2[x]];
        let mean = mean_of(around, limit, [TAPS[0], TAPS[1] * share, TAPS[2] * share]);
        // Unchanged, or windows would differ by which rounds are made for other places.
        out[x] = if share > 0.0 { mean } else { m };
    }
}

/// Mean of five depths along a line, without those that differ from the middle by `limit` or more.
#[inline(always)]
fn mean_of([a2, a1, m, b1, b2]: [f32; 5], limit: f32, weights: [f32; 3]) -> f32 {
    let pair = |a: f32, b: f32| (a - m).abs() < limit && (b - m).abs() < limit;
    // In pairs, or the edge of a slope would bend towards its inside.
    let w1 = if pair(a1, b1) { weights[1] } else { 0.0 };
    let w2 = if pair(a2, b2) { weights[2] } else { 0.0 };
    let s1 = if w1 > 0.0 { a1 + b1 } else { 0.0 };
    let s2 = if w2 > 0.0 { a2 + b2 } else { 0.0 };
    (m * weights[0] + s1 * w1 + s2 * w2) / (weights[0] + 2.0 * (w1 + w2))
}

/// Depths around a row of pixels, from which the shape of the surface is derived.
pub struct Surroundings<'a> {
    above: &'a [f32],
    here: &'a [f32],
    below: &'a [f32],
    far: [&'a [f32]; 3],
    focal_px: f32,
    centre_px: [f32; 2],
    /// Radii of discs; empty if none is wider than two pixels.
    radii: Vec<f32>,
    y: usize,
}

impl Surroundings<'_> {
    /// Normals of eight pixels in view space: towards the eye, of unit length. They are meaningless
    /// at empty pixels.
    ///
    /// A pixel at (u, v) from the middle, v upwards, is the point (u, v, -f) d / f. With du and dv,
    /// the slopes of depth along the axes, the cross product of the two tangents is (du, dv, (d + u
    /// du + v dv) / f) d / f.
    #[inline(always)]
    pub fn normals<S: Simd>(&self, simd: S, first: usize) -> [f32x8<S>; 3] {
        let mut room = None;
        let [above, here, below] = runs([self.above, self.here, self.below], first, &mut room);
        let d = eight::<S, REACH>(simd, here);
        let left = eight::<S, { REACH - 1 }>(simd, here);
        let right = eight::<S, { REACH + 1 }>(simd, here);
        let above = eight::<S, REACH>(simd, above);
        let below = eight::<S, REACH>(simd, below);
        let columns = load(simd, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let u = columns + (first as f32 + 0.5 - self.centre_px[0]);
        let v = self.centre_px[1] - self.y as f32 - 0.5;
        let radii = self.radii.get(first..).and_then(<[_]>::first_chunk);
        let wide = (load(simd, radii.unwrap_or(&[0.0; EIGHT])) * 0.5).max(d.like(1.0));
        let limit = d * (wide * (SLOPE_MAX / self.focal_px));
        let du = slopes(d - left, right - d, limit);
        let dv = slopes(d - below, above - d, limit);
        let normal = [du, dv, (d + u * du + dv * v) / self.focal_px];
        let per_length = 1.0 / dot(normal, normal).sqrt();
        let (zero, one) = (d.like(0.0), d.like(1.0));
        let has_length = zero.cmplt(per_length) & per_length.cmplt(d.like(f32::INFINITY));
        [
            only(has_length, normal[0] * per_length),
            only(has_length, normal[1] * per_length),
            f32x8::select(has_length, normal[2] * per_length, one),
        ]
    }

    /// Distance of eight pixels behind their surroundings, 0 to 1; slopes up to `flat` do not
    /// count. It is meaningless at empty pixels.
    #[inline(always)]
    pub fn behind<S: Simd>(&self, simd: S, first: usize, flat: f32) -> f32x8<S> {
        const RIGHT: usize = 2 * REACH;
        let mut room = None;
        let [above, middle, below] = runs(self.far, first, &mut room);
        let here = eight::<S, REACH>(simd, middle);
        let per_slope = self.focal_px / (here * REACH as f32);
        let around = [
            eight::<S, REACH>(simd, above),
            eight::<S, REACH>(simd, below),
            eight::<S, 0>(simd, above),
            eight::<S, RIGHT>(simd, above),
            eight::<S, 0>(simd, middle),
            eight::<S, RIGHT>(simd, middle),
            eight::<S, 0>(simd, below),
            eight::<S, RIGHT>(simd, below),
        ];
        let mut sum = simd.splat_f32x8(0.0);
        for other in around {
            let slope = (here - other) * per_slope - flat;
            sum += slope.max(slope.like(0.0)).min(slope.like(BEHIND_MAX));
        }
        sum * (1.0 / (8.0 * BEHIND_MAX))
    }

    /// Distance of eight pixels behind the middle of the pixels on opposite sides, 0 to 1; bends up
    /// to `flat` do not count. A slope is no bend, so nothing darkens towards a silhouette. It is
    /// meaningless at empty pixels.
    #[inline(always)]
    pub fn sunken<S: Simd>(&self, simd: S, first: usize, flat: f32) -> f32x8<S> {
        const RIGHT: usize = 2 * REACH;
        let mut room = None;
        let [above, middle, below] = runs(self.far, first, &mut room);
        let here = eight::<S, REACH>(simd, middle);
        let sides = [
            [eight::<S, REACH>(simd, above), eight::<S, REACH>(simd, below)],
            [eight::<S, 0>(simd, middle), eight::<S, RIGHT>(simd, middle)],
            [eight::<S, 0>(simd, above), eight::<S, RIGHT>(simd, below)],
            [eight::<S, RIGHT>(simd, above), eight::<S, 0>(simd, below)],
        ];
        let per_slope = self.focal_px / (here * REACH as f32);
        let mut sum = simd.splat_f32x8(0.0);
        for [before, after] in sides {
            let slope = (here - (before + after) * 0.5) * per_slope - flat;
            sum += slope.max(slope.like(0.0)).min(slope.like(BEHIND_MAX));
        }
        sum * (1.0 / (4.0 * BEHIND_MAX))
    }
}

/// Eight depths of a row, and [`REACH`] depths on both sides of them.
type Run = [f32; EIGHT + 2 * REACH];

/// Runs of three rows around the pixels from `first` on. Runs that leave the picture are copied to
/// `room`, with infinity outside.
#[inline(always)]
fn runs<'a>(rows: [&'a [f32]; 3], first: usize, room: &'a mut Option<[Run; 3]>) -> [&'a Run; 3] {
    // Wraps to an index beyond all rows if there are no columns before.
    let from = first.wrapping_sub(REACH);
    let run = |row: &'a [f32]| row.get(from..)?.first_chunk();
    if let (Some(a), Some(b), Some(c)) = (run(rows[0]), run(rows[1]), run(rows[2])) {
        return [a, b, c];
    }
    room.insert(copied_runs(rows, first)).each_ref()
}

/// Version of [`runs`] that copies, for runs that leave the picture.
#[inline(never)]
fn copied_runs(rows: [&[f32]; 3], first: usize) -> [Run; 3] {
    rows.map(|row| {
        std::array::from_fn(|k| {
            let x = (first + k).checked_sub(REACH);
            x.and_then(|x| row.get(x)).copied().unwrap_or(f32::INFINITY)
        })
    })
}

/// Eight depths of a run, from index `AT` on.
#[inline(always)]
fn eight<S: Simd, const AT: usize>(simd: S, run: &Run) -> f32x8<S> {
    load(simd, run[AT..].first_chunk().unwrap_or(&[0.0; EIGHT]))
}

/// Slopes of depth per pixel from the differences on both sides: their mean, or the only one that
/// stays on the surface.
#[inline(always)]
fn slopes<S: Simd>(before: f32x8<S>, after: f32x8<S>, limit: f32x8<S>) -> f32x8<S> {
    let (before_size, after_size) = (Values::abs(before), Values::abs(after));
    let stays = [before_size.cmplt(limit), after_size.cmplt(limit)];
    // Between two steps, as at a silhouette: the difference to the nearer side, at most the limit.
    let nearer = f32x8::select(before_size.cmplt(after_size), before, after);
    let is_finite = Values::abs(nearer).cmplt(limit.like(f32::INFINITY));
    let alone = only(is_finite, nearer.max(-limit).min(limit));
    let one = f32x8::select(stays[0], before, f32x8::select(stays[1], after, alone));
    f32x8::select(stays[0] & stays[1], (before + after) * 0.5, one)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Normal of a pixel, and its distance behind its surroundings.
    fn shape(row: &Surroundings<'_>, x: usize) -> (Vec3, f32) {
        let (first, lane) = (x / EIGHT * EIGHT, x % EIGHT);
        dispatch!(Level::new(), simd => {
            let normal = row.normals(simd, first);
            let normal = Vec3::new(normal[0][lane], normal[1][lane], normal[2][lane]);
            (normal, row.behind(simd, first, 0.5)[lane])
        })
    }

    /// Depth of a plane through (0, 0, -`distance`) with this normal.
    fn plane(normal: Vec3, distance: f32, side: usize, focal_px: f32) -> Vec<f32> {
        let middle = side as f32 / 2.0;
        let depth = |i: usize| {
            let u = (i % side) as f32 + 0.5 - middle;
            let v = middle - (i / side) as f32 - 0.5;
            let ray = Vec3::new(u / focal_px, v / focal_px, -1.0);
            distance * -normal.z / normal.dot(ray)
        };
        (0..side * side).map(depth).collect()
    }

    #[test]
    fn planes_have_their_normal_everywhere_also_smoothed_and_at_the_edge() {
        for n in [Vec3::Z, Vec3::new(0.5, -0.3, 1.0), Vec3::new(-1.0, 1.5, 1.0)] {
            let n = n.normalize_or(Vec3::Z);
            let depth = plane(n, 5.0, 40, 80.0);
            let image = DepthImage {
                width: 40,
                depth: &depth,
                focal_px: 80.0,
                centre_px: [20.0; 2],
                radii: None,
            };
            let mut scratch = SmoothDepthScratch::default();
            let nothing = [f32::INFINITY; 40];
            for image in [image, image.smoothed(&mut scratch)] {
                for (x, y) in [(20, 20), (8, 30), (0, 0), (39, 10)] {
                    let (got, _) = shape(&image.surroundings(y, &nothing), x);
                    assert!(got.dot(n) > 0.995, "{got} for {n} at {x}, {y}");
                }
            }
        }
    }

    /// Sparse samples at several depths leave plateaus as wide as discs, with steps between them
    /// that are sometimes smaller and sometimes greater than those within one surface.
    #[test]
    fn surfaces_that_come_and_go_leave_no_pattern_of_dots() {
        const SIDE: usize = 96;
        let plateau = |i: usize| (i % SIDE / 12 * 7 + i / SIDE / 12 * 5) * 11 % 13;
        let depth: Vec<f32> = (0..SIDE * SIDE).map(|i| 5.0 + 0.2 * plateau(i) as f32).collect();
        let radii = Radii::even([SIDE; 2], 16.0);
        let image = DepthImage {
            width: SIDE,
            depth: &depth,
            focal_px: 270.0,
            centre_px: [SIDE as f32 / 2.0; 2],
            radii: Some(&radii),
        };
        let mut scratch = SmoothDepthScratch::default();
        let smooth = image.smoothed(&mut scratch).depth;
        // A dot is nearer, or farther, than all four pixels beside it by a slope of some 20
        // degrees.
        let limit = 0.3 * 5.0 / image.focal_px;
        let is_dot = |i: &usize| {
            let beyond = [i - 1, i + 1, i - SIDE, i + SIDE].map(|other| smooth[*i] - smooth[other]);
            beyond.iter().all(|b| *b > limit) || beyond.iter().all(|b| *b < -limit)
        };
        let inner = (0..SIDE * SIDE)
            .filter(|i| (1..SIDE - 1).contains(&(i % SIDE)) && (1..SIDE - 1).contains(&(i / SIDE)));
        assert_eq!(inner.filter(is_dot).count(), 0);
    }

    /// Radii change with every step of a walk, so the smoothing that depends on them must not set
    /// in at once.
    #[test]
    fn a_little_wider_discs_change_smooth_depth_a_little() {
        const SIDE: usize = 96;
        let wave = |i: usize| ((i % SIDE) as f32 * 0.4).sin() + ((i / SIDE) as f32 * 0.3).cos();
        let depth: Vec<f32> = (0..SIDE * SIDE).map(|i| 5.0 + 0.02 * wave(i)).collect();
        let smooth = |radius_px: f32| {
            let radii = Radii::even([SIDE; 2], radius_px);
            let image = DepthImage {
                width: SIDE,
                depth: &depth,
                focal_px: 270.0,
                centre_px: [SIDE as f32 / 2.0; 2],
                radii: Some(&radii),
            };
            image.smoothed(&mut SmoothDepthScratch::default()).depth.to_vec()
        };
        let differ =
            |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
        let radii: Vec<_> = (0..=300).map(|k| smooth(k as f32 * 0.1)).collect();
        let all = differ(&radii[0], &radii[300]);
        let most = radii.windows(2).map(|r| differ(&r[0], &r[1])).fold(0.0, f32::max);
        assert!(most < 0.1 * all, "{most} of {all} at once");
    }

    #[test]
    fn steps_between_surfaces_neither_blur_nor_tilt_and_darken_only_what_is_behind() {
        let depth: Vec<f32> = (0..400).map(|i| if i % 20 < 10 { 1.0 } else { 3.0 }).collect();
        let image = DepthImage {
            width: 20,
            depth: &depth,
            focal_px: 400.0,
            centre_px: [10.0; 2],
            radii: None,
        };
        let mut scratch = SmoothDepthScratch::default();
        assert!(image.smoothed(&mut scratch).depth == depth);
        let row = image.surroundings(10, &depth[..20]);
        let (normal, behind) = shape(&row, 9);
        assert_eq!((normal.truncate(), behind), (glam::Vec2::ZERO, 0.0));
        assert!(shape(&row, 10).1 > 0.2);
        assert_eq!(shape(&row, 15).1, 0.0);
    }
}
