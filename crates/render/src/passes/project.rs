//! Project (`marroquim2007`, section 3.1): projects each point to at most one pixel. A pixel of the
//! frame buffer keeps the least value of `depth << 32 | point`: the bits of a positive `f32` are
//! ordered like the number, so one 64-bit minimum (`schuetz2021`) is depth test and write. `point`
//! is the number of the point in a [`DrawList`]. Attributes are fetched afterwards, for the points
//! that won ([`crate::passes::gather`]).
//!
//! Threads share one frame buffer of atomics, and read a value plainly before they write it, since
//! most points lose. A buffer per thread would take as long, and would have to be cleared, merged
//! and held.

use crate::frame::{DrawNode, Frame};
use crate::inputs::camera::{Camera, Positions};
use crate::inputs::lookup::{DrawList, is_hidden};
use crate::inputs::thinning::Thinning;
use crate::simd::lanes::LANES;
use esker_points::fetch::fetch;
use fearless_simd::{Level as Simd, dispatch};
use glam::Vec4;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Value of a pixel that no point fell on.
pub const EMPTY: u64 = u64::MAX;
/// Points per job: enough that scheduling costs nothing, few enough that all cores end together.
const JOB_POINTS: usize = 1 << 14;
/// Points that are projected together, before any is written, by arithmetic without branches.
const BLOCK: usize = 64;

/// Depth and number of the point of a frame-buffer value.
pub fn unpack(value: u64) -> (f32, u32) {
    (f32::from_bits((value >> 32) as u32), value as u32)
}

/// [`NO_NORMAL`](crate::inputs::lookup::NO_NORMAL) as stored in a plane.
pub(crate) const NO_NORMAL_BITS: u32 = 0x8000_8000;

/// Clears `target` (one value per pixel, row by row) and draws all points into it.
pub fn project(frame: &Frame<'_>, camera: &Camera, list: &DrawList, target: &[AtomicU64]) {
    target.par_chunks(1 << 16).for_each(|c| c.iter().for_each(|p| p.store(EMPTY, Relaxed)));
    let jobs: Vec<(usize, usize)> = (0..frame.draws.len())
        .flat_map(|d| (0..list.len(d)).step_by(JOB_POINTS).map(move |first| (d, first)))
        .collect();
    jobs.par_iter().for_each(|&(draw, first)| {
        let run = first..(first + JOB_POINTS).min(list.len(draw));
        let base = list.starts[draw];
        let draw = &frame.draws[draw];
        let normals = draw.normal.filter(|_| frame.cull_back_faces);
        let hides = frame.hides_points;
        let thinning = Thinning::of(frame, draw);
        let thinning = thinning.as_ref();
        dispatch!(Simd::new(), _ => {
            project_run(draw, camera, run, base, target, normals, thinning, hides)
        });
    });
}

#[allow(clippy::too_many_arguments, reason = "each input of a run has its own argument")]
#[inline(always)]
fn project_run(
    draw: &DrawNode<'_>,
    camera: &Camera,
    run: Range<usize>,
    base: u32,
    target: &[AtomicU64],
    normals: Option<&[u8]>,
    thinning: Option<&Thinning>,
    hides: bool,
) {
    let positions = Positions::of(draw);
    let place = camera.place(draw.node, positions.is_exact());
    let near = place.near();
    let mut offsets = [[0; BLOCK]; 3];
    let zero = [0.0; BLOCK];
    let block = ProjectedPoints {
        start: 0,
        visible: 0,
        pixels: [0; BLOCK],
        depths: zero,
        from_eye: [zero; 3],
    };
    // Prefetches the pixels of a block while the previous block is drawn.
    let (mut block, mut previous) = (block, block);
    for start in run.clone().step_by(BLOCK) {
        let count = positions.offsets(start, &mut offsets).min(run.end - start);
        match near {
            Some(base) => block.project(camera, &offsets, |axis, offset| {
                base[axis].wrapping_add(offset as i32) as f32 + place.bias_steps[axis]
            }),
            None => block.project(camera, &offsets, |axis, o| place.axis_steps(axis, o)),
        }
        if let Some(plane) = normals {
            block.drop_back_faces(plane, start, count);
        }
        if let Some(thinning) = thinning {
            block.leave_out(thinning, start);
        }
        (block.start, block.visible) = (start, block.visible_points(count));
        ones(block.visible).for_each(|k| fetch(target, block.pixels[k] as usize));
        previous.draw(base, target, |point| hides && is_hidden(draw.position, point));
        std::mem::swap(&mut block, &mut previous);
    }
    previous.draw(base, target, |point| hides && is_hidden(draw.position, point));
}

/// Indices of the bits that are set, from the lowest.
#[inline(always)]
fn ones(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = bits.trailing_zeros() as usize % BLOCK;
        let any = bits != 0;
        bits &= bits.wrapping_sub(1);
        any.then_some(k)
    })
}

/// A block of points of a node, projected to pixels.
#[derive(Clone, Copy)]
struct ProjectedPoints {
    /// Index in the node of the first point.
    start: usize,
    /// Points that fall on the picture, a bit each.
    visible: u64,
    /// Pixels, row by row; [`OUTSIDE`] is set for points outside the picture.
    pixels: [u32; BLOCK],
    depths: [f32; BLOCK],
    /// Position relative to the eye, along the world's axes.
    from_eye: [[f32; BLOCK]; 3],
}

/// Bit that marks points outside the picture.
const OUTSIDE: u32 = 1 << 31;

impl ProjectedPoints {
    /// Projects a block of points. `steps` gives the distance from the anchor in steps, from an
    /// axis and the offset along it. Straight arithmetic over arrays, which the compiler
    /// vectorises.
    #[inline(always)]
    fn project(
        &mut self,
        camera: &Camera,
        offsets: &[[u32; BLOCK]; 3],
        steps: impl Fn(usize, u32) -> f32,
    ) {
        let [right, up, back] = camera.view_from_world;
        let (step, ahead) = (camera.step, camera.to_anchor());
        let [per_depth, always] = camera.divisor();
        let [width, height] = camera.size.map(|s| s as f32);
        let row = camera.size[0];
        let Self { pixels, depths, from_eye, .. } = self;
        for (k, (pixel, depth)) in pixels.iter_mut().zip(depths).enumerate() {
            let x = steps(0, offsets[0][k]) * step.x;
            let y = steps(1, offsets[1][k]) * step.y;
            let z = steps(2, offsets[2][k]) * step.z;
            (from_eye[0][k], from_eye[1][k], from_eye[2][k]) =
                (x + ahead.x, y + ahead.y, z + ahead.z);
            *depth = camera.anchor_depth - (back.x * x + back.y * y + back.z * z);
            let scale = camera.focal_px / (*depth * per_depth + always);
            let [at_x, at_y] = camera.placed([
                (right.x * x + right.y * y + right.z * z) * scale,
                -(up.x * x + up.y * y + up.z * z) * scale,
            ]);
            // NaN compares as outside.
            let is_inside = (at_x >= 0.0) & (at_x < width) & (at_y >= 0.0) & (at_y < height);
            let is_inside = is_inside & (*depth >= camera.near) & (*depth < f32::INFINITY);
            let at = whole(at_y).wrapping_mul(row).wrapping_add(whole(at_x));
            *pixel = if is_inside { at } else { OUTSIDE };
        }
    }

    /// Marks points as outside whose normals point away from the eye; points without a normal stay.
    /// Directions are those of [`esker_points::quant::oct_direction`] times 32767: whole numbers,
    /// with the same signs.
    #[inline(always)]
    fn drop_back_faces(&mut self, normals: &[u8], start: usize, count: usize) {
        const ONE: i32 = 32_767;
        let mut codes = [NO_NORMAL_BITS; BLOCK];
        let plane = normals.get(start * 4..).unwrap_or(&[]).as_chunks::<4>().0;
        for (code, b) in codes.iter_mut().zip(plane).take(count) {
            *code = u32::from_le_bytes(*b);
        }
        let [xs, ys, zs] = &self.from_eye;
        for (k, pixel) in self.pixels.iter_mut().enumerate() {
            let (x, y) = ((codes[k] << 16) as i32 >> 16, codes[k] as i32 >> 16);
            let (x, y) = (x.max(-ONE), y.max(-ONE));
            let z = ONE - x.abs() - y.abs();
            let folded = |along: i32, other: i32| {
                let beyond = ONE - other.abs();
                if along < 0 { -beyond } else { beyond }
            };
            let (fx, fy) = if z < 0 { (folded(x, y), folded(y, x)) } else { (x, y) };
            let along = fx as f32 * xs[k] + fy as f32 * ys[k] + z as f32 * zs[k];
            let is_away = (along > 0.0) & (codes[k] != NO_NORMAL_BITS);
            *pixel |= u32::from(is_away) << 31;
        }
    }

    /// Marks points as outside that are closer together on the picture than asked.
    #[inline(always)]
    fn leave_out(&mut self, thinning: &Thinning, start: usize) {
        let mut shares = [0.0; BLOCK];
        thinning.shares(start as u32, &mut shares);
        for (k, pixel) in self.pixels.iter_mut().enumerate() {
            let is_left_out = thinning.leaves_out(shares[k], self.depths[k]);
            *pixel |= u32::from(is_left_out) << 31;
        }
    }

    /// Draws the visible points that `is_hidden` does not exclude; `base` is the number of the
    /// node's first point.
    #[inline(always)]
    fn draw(&self, base: u32, target: &[AtomicU64], is_hidden: impl Fn(usize) -> bool) {
        let value = |k: usize| {
            let point = base + (self.start + k) as u32;
            u64::from(self.depths[k].to_bits()) << 32 | u64::from(point)
        };
        // Without a branch, since it is hard to predict which points win.
        let mut winning = 0;
        for k in ones(self.visible) {
            let Some(slot) = target.get(self.pixels[k] as usize) else { continue };
            winning |= u64::from(value(k) < slot.load(Relaxed)) << k;
        }
        for k in ones(winning) {
            let Some(slot) = target.get(self.pixels[k] as usize) else { continue };
            if !is_hidden(self.start + k) {
                slot.fetch_min(value(k), Relaxed);
            }
        }
    }

    /// The points among the first `count` that fall on the picture, a bit each.
    #[inline(always)]
    fn visible_points(&self, count: usize) -> u64 {
        let mut outside = 0;
        for (i, four) in self.pixels.as_chunks::<LANES>().0.iter().enumerate() {
            let signs = Vec4::from_array(four.map(f32::from_bits)).is_negative_bitmask();
            outside |= u64::from(signs) << (i * LANES);
        }
        !outside & u64::MAX >> (BLOCK - count)
    }
}

/// Whole part of `x` from 0 to 2^22, and an arbitrary number for other values. Unlike `as`, which
/// treats those specially, it vectorises.
#[inline(always)]
fn whole(x: f32) -> u32 {
    // So large a number has no bits left for fractions: adding it rounds.
    const ROUNDS: f32 = (1 << 23) as f32;
    let rounded = x + ROUNDS;
    let is_above = rounded - ROUNDS > x;
    rounded.to_bits().wrapping_sub(ROUNDS.to_bits()).wrapping_sub(u32::from(is_above))
}
