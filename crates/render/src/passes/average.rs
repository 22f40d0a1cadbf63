//! Average: where several points fall on a pixel, it is chance which one wins, so colours alias and
//! flicker when the view moves (a limitation named in `marroquim2007`, section 5). This second pass
//! over the points, after gather, averages all points of a pixel's front surface (`schuetz2021`,
//! high-quality splatting). The front surface ends with the depth interval of the winner, moved
//! along its plane as in pull ([`crate::passes::tangent`]), instead of 1 % behind it: with normals,
//! a wall a radius behind another does not take part.
//!
//! Sums are integers, so the order of adding does not matter. Depths are compared by the pixels
//! that a unit of length takes there, `focal_px / depth`, which is linear in the picture along a
//! plane.

use crate::inputs::camera::{Camera, NodePlace};
use crate::inputs::lookup::{Lookup, is_hidden, normal_at};
use crate::passes::tangent::Lens;
use crate::picture::pyramid::{Level, Planes, for_each_row};
use crate::simd::values::{Lane, towards_eye};
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Steps that values from 0 to 1 are quantised to before they are summed.
pub(crate) const STEPS: f32 = 16_383.0;
/// Greatest component of a mean of normals that counts as no normal.
const NO_NORMAL: f32 = 2.0 / STEPS;
/// Most points of a pixel whose sums fit into 32 bits; with more, the winner stays.
pub(crate) const POINTS_MAX: f32 = 262_144.0;
/// Points per job.
const JOB_POINTS: usize = 1 << 14;
/// Points that are projected together, before any is added, by arithmetic without branches.
const BLOCK: usize = 64;

/// Sums for the pixels of a picture. Memory is kept from frame to frame.
#[derive(Debug, Default)]
pub struct Averages {
    /// Plane of each pixel's winner: its scale (`focal_px / depth`) at the pixel's centre, the
    /// change of the scale per pixel to the right and downwards, and the difference to the scale
    /// where the depth interval ends. The scale is infinite if there is no winner.
    planes: Vec<Vec4>,
    /// Red and green, blue and the number of points, normal x and y, normal z and depth: two sums
    /// of 32 bits each. With normals depths are not summed: the winner's is exact on its plane, and
    /// a mean is no better.
    sums: Vec<[AtomicU64; 4]>,
}

impl Averages {
    /// Mixes the attributes of the winners in `base` with the means of their pixels' front
    /// surfaces, whose share is `crowding`.
    pub fn run(&mut self, lookup: &Lookup<'_>, lens: &Lens, crowding: f32, base: &mut Level) {
        self.begin(lens, base);
        match base.planes() {
            Planes::Normals => self.add_all::<true>(lookup),
            Planes::None | Planes::Fitted => self.add_all::<false>(lookup),
        }
        self.finish(lens, crowding, base);
    }

    /// Stores the planes of the winners and clears the sums.
    fn begin(&mut self, lens: &Lens, base: &Level) {
        self.planes.resize(base.front.len(), Vec4::ZERO);
        self.sums.resize_with(base.front.len(), Default::default);
        let rows = self.planes.par_chunks_mut(base.width).zip(self.sums.par_chunks_mut(base.width));
        rows.enumerate().for_each(|(y, (planes, sums))| {
            for (x, (plane, sums)) in planes.iter_mut().zip(sums).enumerate() {
                *plane = plane_of(lens, base, x, y);
                *sums = Default::default();
            }
        });
    }

    fn add_all<const NORMALS: bool>(&self, lookup: &Lookup<'_>) {
        let jobs: Vec<(usize, usize)> = (0..lookup.frame.draws.len())
            .flat_map(|d| (0..lookup.list.len(d)).step_by(JOB_POINTS).map(move |first| (d, first)))
            .collect();
        jobs.par_iter().for_each(|&(draw, first)| {
            let last = (first + JOB_POINTS).min(lookup.list.len(draw));
            self.add_run::<NORMALS>(lookup, draw, first..last);
        });
    }

    fn add_run<const NORMALS: bool>(&self, lookup: &Lookup<'_>, draw: usize, run: Range<usize>) {
        let (positions, place) = lookup.places(draw);
        let (frame, camera) = (lookup.frame, lookup.camera);
        let planes = &frame.draws[draw];
        let mut offsets = [[0; BLOCK]; 3];
        for start in run.clone().step_by(BLOCK) {
            let count = positions.offsets(start, &mut offsets).min(run.end - start);
            let at = PixelPositions::new(camera, place, &offsets);
            for k in 0..count {
                let pixel = at.pixels[k] as usize;
                let Some(plane) = self.planes.get(pixel) else { continue };
                let behind = plane.x + plane.y * at.dx[k] + plane.z * at.dy[k] - at.scale[k];
                // Infinite if there is no winner.
                if behind > plane.w {
                    continue;
                }
                let (i, offset) = (start + k, offsets.map(|axis| axis[k]));
                let from_eye = place.steps_from_anchor(offset) * camera.step + camera.to_anchor();
                // Zero if the point has no normal.
                let mut normal = planes.normal.map_or(Vec3::ZERO, |plane| normal_at(plane, i));
                let looks_away = normal.dot(from_eye) > 0.0;
                let is_hidden = frame.hides_points && is_hidden(planes.position, i);
                if is_hidden || looks_away && frame.cull_back_faces {
                    continue;
                }
                if looks_away {
                    normal = towards_eye(normal.to_array(), from_eye.to_array(), frame.has_fronts)
                        .into();
                }
                let sums = &self.sums[pixel];
                let colour = lookup.colour(draw, i, offset, camera.focal_px / at.scale[k]);
                sums[0].fetch_add(pair(colour.x, colour.y), Relaxed);
                sums[1].fetch_add(steps(colour.z) | 1 << 32, Relaxed);
                if NORMALS {
                    let n = camera.to_view(normal) * 0.5 + Vec3::splat(0.5);
                    sums[2].fetch_add(pair(n.x, n.y), Relaxed);
                    sums[3].fetch_add(steps(n.z), Relaxed);
                } else {
                    let depth = behind / plane.w.max(f32::MIN_POSITIVE);
                    sums[3].fetch_add(pair(0.0, depth), Relaxed);
                }
            }
        }
    }

    /// Mixes in the means of pixels with more than one point; a single point is there already,
    /// exactly. Sums that overflow run into the next one, so the number of points is never too
    /// small.
    fn finish(&self, lens: &Lens, crowding: f32, base: &mut Level) {
        let width = base.width;
        for_each_row(base, |row| {
            let first = row.y * width;
            let pixels =
                self.sums[first..first + width].iter().zip(&self.planes[first..first + width]);
            for (x, (sums, plane)) in pixels.enumerate() {
                let sums = sums.each_ref().map(|sum| sum.load(Relaxed));
                let count = (sums[1] >> 32) as f32;
                if count <= 1.0 || count > POINTS_MAX {
                    continue;
                }
                let share = 1.0 / (count * STEPS);
                let low = |sum: u64| sum as u32 as f32 * share;
                let high = |sum: u64| (sum >> 32) as f32 * share;
                let mix = |own: Vec4, mean: Vec3| {
                    (own.truncate() * (1.0 - crowding) + mean * crowding).extend(own.w)
                };
                let mean = Vec3::new(low(sums[0]), high(sums[0]), low(sums[1]));
                row.tint[x] = mix(row.tint[x], mean);
                if let Some(normal) = row.normal.get_mut(x) {
                    let mean = Vec3::new(low(sums[2]), high(sums[2]), low(sums[3]));
                    let mean = mean * 2.0 - Vec3::ONE;
                    // Without normals the mean differs from zero by the rounding to steps.
                    let is_none = mean.abs().max_element() <= NO_NORMAL;
                    *normal = mix(*normal, if is_none { Vec3::ZERO } else { mean });
                    continue;
                }
                let depth = row.depth[x];
                let scale = lens.focal_px / depth - high(sums[3]) * plane.w;
                let moved = (lens.focal_px / scale - depth) * crowding;
                row.depth[x] += moved;
                row.front[x] += Vec4::new(moved, moved, 0.0, 0.0);
            }
        });
    }
}

/// Plane of the winner of a pixel, in the form of [`Averages::planes`].
fn plane_of(lens: &Lens, base: &Level, x: usize, y: usize) -> Vec4 {
    let pixel = y * base.width + x;
    let front = base.front[pixel];
    if front.x == f32::INFINITY {
        return Vec4::new(f32::INFINITY, 0.0, 0.0, 0.0);
    }
    let (displaced, centre) = (Vec2::new(front.z, front.w), base.centre(x, y));
    let scale = lens.focal_px / front.x;
    let slope = match (base.normal.get(pixel), base.tilt.get(pixel)) {
        (Some(normal), _) => {
            let own = [normal.x, normal.y, normal.z].map(Lane::splat);
            let facing = lens.facing(own, (centre - displaced).to_array().map(Lane::splat));
            // Divided first: with a zero normal, the scale over it would be infinite.
            Vec2::new(normal.x, -normal.y) / facing.x * scale
        }
        (None, Some(tilt)) => Vec2::new(-tilt.x, tilt.y) * scale,
        (None, None) => Vec2::ZERO,
    };
    let ends = lens.focal_px / front.y;
    Vec4::new(scale + slope.dot(displaced), slope.x, slope.y, scale - ends)
}

/// Quantises a number from 0 to 1; NaN becomes 0.
#[inline(always)]
fn steps(value: f32) -> u64 {
    (value.clamp(0.0, 1.0) * STEPS + 0.5) as u64
}

#[inline(always)]
fn pair(low: f32, high: f32) -> u64 {
    steps(low) | steps(high) << 32
}

/// Positions of a block of points on the picture.
struct PixelPositions {
    /// Pixels, row by row; all bits are set for points outside the picture.
    pixels: [u32; BLOCK],
    /// From the pixel's centre, pixels.
    dx: [f32; BLOCK],
    dy: [f32; BLOCK],
    /// `focal_px / depth`.
    scale: [f32; BLOCK],
}

impl PixelPositions {
    /// Projects points by the operations of [`crate::passes::project`], so that each falls on the
    /// same pixel.
    #[inline(always)]
    fn new(camera: &Camera, place: &NodePlace, offsets: &[[u32; BLOCK]; 3]) -> Self {
        let [right, up, back] = camera.view_from_world;
        let step = camera.step;
        let [per_depth, always] = camera.divisor();
        let [width, height] = camera.size.map(|s| s as f32);
        let row = camera.size[0];
        let zero = [0.0; BLOCK];
        let mut at = Self { pixels: [0; BLOCK], dx: zero, dy: zero, scale: zero };
        let Self { pixels, dx, dy, scale: scales } = &mut at;
        let places = pixels.iter_mut().zip(dx).zip(dy.iter_mut().zip(scales));
        for (k, ((pixel, dx), (dy, scale_there))) in places.enumerate() {
            let x = place.axis_steps(0, offsets[0][k]) * step.x;
            let y = place.axis_steps(1, offsets[1][k]) * step.y;
            let z = place.axis_steps(2, offsets[2][k]) * step.z;
            let depth = camera.anchor_depth - (back.x * x + back.y * y + back.z * z);
            let across = camera.focal_px / (depth * per_depth + always);
            let [at_x, at_y] = camera.placed([
                (right.x * x + right.y * y + right.z * z) * across,
                -(up.x * x + up.y * y + up.z * z) * across,
            ]);
            let is_inside = (at_x >= 0.0) & (at_x < width) & (at_y >= 0.0) & (at_y < height);
            let is_inside = is_inside & (depth >= camera.near) & (depth < f32::INFINITY);
            let [column, line] = [at_x as i32 as u32, at_y as i32 as u32];
            let at = line.wrapping_mul(row).wrapping_add(column);
            *pixel = if is_inside { at } else { u32::MAX };
            *dx = at_x - column as f32 - 0.5;
            *dy = at_y - line as f32 - 0.5;
            *scale_there = camera.focal_px / depth;
        }
        at
    }
}
