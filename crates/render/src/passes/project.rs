//! Project (marroquim2007 section 3.1): maps each point to at most one pixel. The frame buffer
//! holds `depth << 32 | point` and keeps the least value: the bits of a positive `f32` are ordered
//! as the number, so one 64-bit minimum is depth test and write. `point` numbers the points of all
//! draws of the frame ([`DrawList`]). The attributes of the points that won a pixel are fetched
//! afterwards ([`crate::passes::gather`]).
//!
//! Threads share one frame buffer of atomics and read before they write, since most points fail the
//! depth test. One buffer a thread, merged afterwards, is not faster.

use crate::frame::{DrawNode, Frame};
use crate::gpu::memory::table::CHUNK_POINTS;
use crate::inputs::camera::{Camera, Positions};
use crate::simd::lanes::LANES;
use esker_points::fetch::fetch;
use esker_points::quant::{HIDDEN_AT, HOT_POSITION_BYTES, oct_decode};
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Value of a pixel without a point.
pub const EMPTY: u64 = u64::MAX;
/// Points of a job: large enough that distribution costs nothing, small enough that all cores
/// finish together.
const JOB_POINTS: usize = 1 << 14;
/// Points of a block, which are projected before any is written, so that the arithmetic has no
/// branches.
const BLOCK: usize = 64;

/// Splits a frame-buffer value into depth and point number.
pub fn unpack(value: u64) -> (f32, u32) {
    (f32::from_bits((value >> 32) as u32), value as u32)
}

/// Numbers the points of all draws of a frame. Each draw begins at a multiple of a chunk, as on a
/// GPU ([`crate::gpu::memory::table::CHUNK_POINTS`]), so that the draw of a point is found by a
/// lookup and not by a search.
#[derive(Clone, Debug, Default)]
pub struct DrawList {
    /// Number of the first point of each draw.
    pub starts: Vec<u32>,
    /// Points of each draw.
    counts: Vec<u32>,
    /// The draw of each chunk of numbers.
    owners: Vec<u32>,
    points: u32,
}

impl DrawList {
    /// Numbers the points of `draws`. Points beyond the last number are not drawn.
    pub fn new(draws: &[DrawNode<'_>]) -> Self {
        let mut list = Self::default();
        let mut next = 0u64;
        for (owner, draw) in (0..).zip(draws) {
            // The last chunk stays free: all ones means no point.
            let left = u64::from(u32::MAX - CHUNK_POINTS).saturating_sub(next);
            let count = (Positions::of(draw).len as u64).min(left) as u32;
            let chunks = count.div_ceil(CHUNK_POINTS);
            list.starts.push(next as u32);
            list.counts.push(count);
            list.owners.extend(std::iter::repeat_n(owner, chunks as usize));
            list.points += count;
            next += u64::from(chunks) * u64::from(CHUNK_POINTS);
        }
        list
    }

    /// Number of points of a draw.
    pub fn len(&self, draw: usize) -> usize {
        self.counts[draw] as usize
    }

    /// Whether the frame has no point.
    pub fn is_empty(&self) -> bool {
        self.points == 0
    }

    /// Number of points of the frame.
    pub fn points(&self) -> u32 {
        self.points
    }

    /// Draw of a point, and its index in the draw.
    #[inline]
    pub fn find(&self, point: u32) -> (usize, usize) {
        let draw = self.owners[(point / CHUNK_POINTS) as usize] as usize;
        (draw, (point - self.starts[draw]) as usize)
    }
}

/// Octahedral code of a point without a normal.
pub(crate) const NO_NORMAL: [i16; 2] = [i16::MIN; 2];
/// Bits of [`NO_NORMAL`] in a normal plane.
pub(crate) const NO_NORMAL_BITS: u32 = 0x8000_8000;

/// Projects all points into `target` (one value a pixel, row by row), which is cleared first.
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
        dispatch!(Simd::new(), _ => project_run(draw, camera, run, base, target, normals, hides));
    });
}

#[inline(always)]
fn project_run(
    draw: &DrawNode<'_>,
    camera: &Camera,
    run: Range<usize>,
    base: u32,
    target: &[AtomicU64],
    normals: Option<&[u8]>,
    hides: bool,
) {
    let positions = Positions::of(draw);
    let place = camera.place(draw.node, positions.is_exact());
    let near = place.near();
    let mut offsets = [[0; BLOCK]; 3];
    let zero = [0.0; BLOCK];
    let block =
        PointBlock { start: 0, shown: 0, pixels: [0; BLOCK], depths: zero, from_eye: [zero; 3] };
    // The pixels of a block are prefetched while the block before is written.
    let (mut block, mut before) = (block, block);
    for start in run.clone().step_by(BLOCK) {
        let count = positions.offsets(start, &mut offsets).min(run.end - start);
        match near {
            Some(base) => block.place(camera, &offsets, |axis, offset| {
                base[axis].wrapping_add(offset as i32) as f32 + place.bias_steps[axis]
            }),
            None => block.place(camera, &offsets, |axis, o| place.axis_steps(axis, o)),
        }
        if let Some(plane) = normals {
            block.drop_back_faces(plane, start, count);
        }
        (block.start, block.shown) = (start, block.on_picture(count));
        ones(block.shown).for_each(|k| fetch(target, block.pixels[k] as usize));
        before.draw(base, target, |point| hides && is_hidden(draw.position, point));
        std::mem::swap(&mut block, &mut before);
    }
    before.draw(base, target, |point| hides && is_hidden(draw.position, point));
}

/// Indices of the set bits, from the lowest.
#[inline(always)]
fn ones(mut bits: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let k = bits.trailing_zeros() as usize % BLOCK;
        let any = bits != 0;
        bits &= bits.wrapping_sub(1);
        any.then_some(k)
    })
}

/// A block of projected points.
#[derive(Clone, Copy)]
struct PointBlock {
    /// Index in the node of the first point of the block.
    start: usize,
    /// Points within the picture, a bit each.
    shown: u64,
    /// Pixel of each point, row by row; the highest bit marks points outside the picture.
    pixels: [u32; BLOCK],
    depths: [f32; BLOCK],
    /// Position relative to the eye, along the axes of the world.
    from_eye: [[f32; BLOCK]; 3],
}

/// Bit that marks points outside the picture.
const OUTSIDE: u32 = 1 << 31;

impl PointBlock {
    /// Projects a block of points; `steps` gives the position relative to the eye from axis and
    /// offset. The loop has no branches, so that it compiles to SIMD.
    #[inline(always)]
    fn place(
        &mut self,
        camera: &Camera,
        offsets: &[[u32; BLOCK]; 3],
        steps: impl Fn(usize, u32) -> f32,
    ) {
        let [right, up, back] = camera.view_from_world;
        let step = camera.step;
        let [cx, cy] = camera.centre_px;
        let [width, height] = camera.size.map(|s| s as f32);
        let row = camera.size[0];
        let Self { pixels, depths, from_eye, .. } = self;
        for (k, (pixel, depth)) in pixels.iter_mut().zip(depths).enumerate() {
            let x = steps(0, offsets[0][k]) * step.x;
            let y = steps(1, offsets[1][k]) * step.y;
            let z = steps(2, offsets[2][k]) * step.z;
            (from_eye[0][k], from_eye[1][k], from_eye[2][k]) = (x, y, z);
            *depth = -(back.x * x + back.y * y + back.z * z);
            let scale = camera.focal_px / *depth;
            let at_x = cx + (right.x * x + right.y * y + right.z * z) * scale;
            let at_y = cy - (up.x * x + up.y * y + up.z * z) * scale;
            // Written so that NaN is outside.
            let is_inside = (at_x >= 0.0) & (at_x < width) & (at_y >= 0.0) & (at_y < height);
            let is_inside = is_inside & (*depth >= camera.near) & (*depth < f32::INFINITY);
            let at = whole(at_y).wrapping_mul(row).wrapping_add(whole(at_x));
            *pixel = if is_inside { at } else { OUTSIDE };
        }
    }

    /// Marks points as outside whose normals point away from the eye; points without a normal stay.
    /// Directions are those of [`esker_points::quant::oct_direction`], times 32767: they are
    /// integers, and the sign is the same.
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

    /// Writes the points that are within the picture and not hidden; `base` is the number of the
    /// first point of the node.
    #[inline(always)]
    fn draw(&self, base: u32, target: &[AtomicU64], is_hidden: impl Fn(usize) -> bool) {
        let value = |k: usize| {
            let point = base + (self.start + k) as u32;
            u64::from(self.depths[k].to_bits()) << 32 | u64::from(point)
        };
        // No branch here: the result of the depth test is unpredictable.
        let mut winning = 0;
        for k in ones(self.shown) {
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

    /// Those of the first `count` points that are within the picture, a bit each.
    #[inline(always)]
    fn on_picture(&self, count: usize) -> u64 {
        let mut outside = 0;
        for (i, four) in self.pixels.as_chunks::<LANES>().0.iter().enumerate() {
            let signs = Vec4::from_array(four.map(f32::from_bits)).is_negative_bitmask();
            outside |= u64::from(signs) << (i * LANES);
        }
        !outside & u64::MAX >> (BLOCK - count)
    }
}

/// Integer part of a number from 0 to 2^22; arbitrary for other numbers. `as` is not used, since
/// its saturation is no SIMD.
#[inline(always)]
fn whole(x: f32) -> u32 {
    // At this size numbers have no bits for fractions, so that adding it rounds.
    const ROUNDS: f32 = (1 << 23) as f32;
    let rounded = x + ROUNDS;
    let is_above = rounded - ROUNDS > x;
    rounded.to_bits().wrapping_sub(ROUNDS.to_bits()).wrapping_sub(u32::from(is_above))
}

/// Whether a filter has marked a point as hidden.
pub(crate) fn is_hidden(positions: &[u8], index: usize) -> bool {
    positions.get(index * HOT_POSITION_BYTES + HIDDEN_AT).is_some_and(|&mark| mark != 0)
}

/// Octahedral code of a point's normal, or `None` if the plane is too short.
#[inline]
pub(crate) fn normal_code(normals: &[u8], index: usize) -> Option<[i16; 2]> {
    let b = normals.get(index * 4..index * 4 + 4)?;
    Some([i16::from_le_bytes([b[0], b[1]]), i16::from_le_bytes([b[2], b[3]])])
}

/// World normal of a point; zero if the point has none or the plane is too short.
#[inline]
pub fn normal_at(normals: &[u8], index: usize) -> Vec3 {
    normal_code(normals, index).map_or(Vec3::ZERO, |code| Vec3::from_array(oct_decode(code)))
}
