//! The camera on the lattice: the numbers of a frame and of a node from which positions of points
//! relative to its anchor are computed. The lattice cell of the anchor is subtracted in integers
//! and only the difference becomes `f32`. Its rounding is relative to the distance from the anchor,
//! so far coordinates do not jitter. The anchor is the eye; where the view is parallel, or a
//! pinhole is so narrow that this rounding would show, it is the point ahead of the eye at the
//! depth of the scan.
//!
//! A difference may need more than 32 bits, and a GPU has no wider integers. It is kept as `high *
//! 2^16 + low`, two integers that are exact in `f32`, so that their sum rounds once.

use crate::error::RenderError;
use crate::frame::{DrawNode, Frame, PIXELS_MAX, SIDE_MAX};
use crate::simd::values::{Values, load};
use esker_lod::{View, Window};
use esker_points::fetch::fetch;
use esker_points::quant::{HOT_POSITION_BYTES, read_residual, residual_bytes};
use esker_points::{Lattice, Node};
use fearless_simd::{Simd, f32x8};
use glam::{DVec3, Vec3};

/// Greatest difference, steps; nothing beyond it is in a picture.
const STEPS_FAR: f64 = (1u64 << 46) as f64;
/// Pixels of a unit of length at unit depth from which a pinhole is narrow: the rounding of
/// positions against the eye reaches a thousandth of a pixel.
const NARROW_PX: f64 = (1 << 14) as f64;
/// Most bits that a hot position drops: the lattice has 32 bits an axis, hot positions keep 16.
pub(crate) const SHIFT_MAX: u8 = 16;

/// Whether pictures of this size can be drawn.
pub fn is_drawable(width: u32, height: u32) -> bool {
    let sides = 1..=SIDE_MAX;
    let pixels = u64::from(width) * u64::from(height);
    sides.contains(&width) && sides.contains(&height) && pixels <= PIXELS_MAX
}

/// The part of the picture of `view` that is drawn: all of it without a window.
fn window_of(view: &View) -> Window {
    let (width, height) = (view.width, view.height);
    let Some(part) = view.window else { return Window { x: 0, y: 0, width, height } };
    let (x, y) = (part.x.min(width), part.y.min(height));
    Window { x, y, width: part.width.min(width - x), height: part.height.min(height - y) }
}

/// Camera of a frame in `f32`.
#[derive(Clone, Debug)]
pub struct Camera {
    anchor_steps: [f64; 3],
    /// Depth of the anchor; where the view is parallel, the depth at which lengths have their size
    /// on the picture.
    pub anchor_depth: f32,
    /// Whether the view is parallel.
    pub is_parallel: bool,
    /// The anchor on the lattice, rounded down: the part above 2^16,
    pub anchor_high: [i32; 3],
    /// and the part below.
    pub anchor_low: [i32; 3],
    /// Rest of the anchor after rounding down, steps.
    pub anchor_rest: Vec3,
    /// Length of a lattice step along each axis, in the unit of the file.
    pub step: Vec3,
    /// Rows (right, up, back) of the rotation from world axes to view axes.
    pub view_from_world: [Vec3; 3],
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// Centre of the picture, pixels; of the whole picture where a window of it is drawn.
    pub centre_px: [f32; 2],
    /// First column and row of the window in the whole picture, pixels. Places are computed on the
    /// whole picture and then moved, so that they are rounded alike in all of its windows.
    pub origin_px: [f32; 2],
    /// Width and height of the picture with its margin, pixels.
    pub size: [u32; 2],
    /// Width of the margin on each side, pixels ([`crate::picture::margin`]).
    pub margin_px: u32,
    /// What is added to a row to get that of the background, and the number of those.
    pub backdrop_rows: [i32; 2],
    /// Depth of the near plane.
    pub near: f32,
}

impl Camera {
    /// The camera of a frame. The anchor of a narrow pinhole is as deep as the middle of the first
    /// node.
    ///
    /// # Errors
    /// As for [`Camera::new`].
    pub fn of<P>(frame: &Frame<'_, P>) -> Result<Self, RenderError> {
        let (view, lattice) = (frame.view, frame.lattice);
        let first = frame.draws.first().filter(|_| view.focal_px() >= NARROW_PX);
        let depth = first.map_or(0.0, |draw| {
            let [low, high] = draw.node.own_box().map(|corner| corner.map(f64::from));
            let middle = [0, 1, 2].map(|i| lattice.world_axis(i, 0.5 * (low[i] + high[i])));
            view.depth(DVec3::from_array(middle))
        });
        let depth = if depth.is_finite() { depth.max(0.0) } else { 0.0 };
        Self::anchored(view, lattice, depth)
    }

    /// The camera of a view, whose anchor is the eye if it is a pinhole.
    ///
    /// # Errors
    /// If the size of the view is not supported, or its eye, direction, field of view or near plane
    /// is not usable.
    pub fn new(view: &View, lattice: &Lattice) -> Result<Self, RenderError> {
        Self::anchored(view, lattice, 0.0)
    }

    /// The camera of a view; `depth` is that of the anchor if it is a pinhole.
    fn anchored(view: &View, lattice: &Lattice, depth: f64) -> Result<Self, RenderError> {
        let (sides, Window { x, y, width, height }) = ([view.width, view.height], window_of(view));
        if !is_drawable(width, height) {
            return Err(RenderError::Size { width, height, side: SIDE_MAX, pixels: PIXELS_MAX });
        }
        let usable = |ok: bool, what| if ok { Ok(()) } else { Err(RenderError::Camera { what }) };
        usable(view.eye.is_finite(), "eye")?;
        usable(view.world_from_view.is_finite(), "direction")?;
        usable(view.focal_px() > 0.0 && view.focal_px().is_finite(), "field of view")?;
        usable(view.near > 0.0 && view.near.is_finite(), "near plane")?;
        let rows = view.view_from_world().transpose();
        let depth = view.parallel_at.unwrap_or(depth);
        usable(depth >= 0.0 && depth.is_finite(), "depth of a parallel view")?;
        let anchor = view.eye + view.forward() * depth;
        let anchor_steps = [0, 1, 2].map(|i| lattice.steps_axis(i, anchor[i]));
        let whole = anchor_steps.map(|e| e.clamp(-STEPS_FAR, STEPS_FAR).floor());
        // At least one pixel remains after cropping.
        let margin_px = view.margin_px.min((sides[0].min(sides[1]) - 1) / 2);
        let origin_px = [x, y].map(|at| at as f32);
        let centre_px = [0, 1].map(|axis| sides[axis] as f32 * 0.5 - origin_px[axis]);
        Ok(Self {
            anchor_steps,
            anchor_depth: depth as f32,
            is_parallel: view.parallel_at.is_some(),
            anchor_high: whole.map(|w| (w as i64 >> 16) as i32),
            anchor_low: whole.map(|w| (w as i64 & 0xffff) as i32),
            anchor_rest: [0, 1, 2]
                .map(|i| (anchor_steps[i] - whole[i]).clamp(0.0, 1.0) as f32)
                .into(),
            step: Vec3::from_array(lattice.scale.map(|s| s as f32)),
            view_from_world: [rows.x_axis, rows.y_axis, rows.z_axis].map(|r| r.as_vec3()),
            focal_px: view.focal_px() as f32,
            centre_px,
            origin_px,
            size: [width, height],
            margin_px: if view.window.is_some() { 0 } else { margin_px },
            backdrop_rows: [
                i64::from(y).saturating_sub(margin_px.into()) as i32,
                (sides[1] - 2 * margin_px) as i32,
            ],
            near: (view.near as f32).max(f32::MIN_POSITIVE),
        })
    }

    /// The camera with a margin of at most `margin_px` pixels.
    pub fn with_margin(self, margin_px: u32) -> Self {
        let left_out = self.margin_px.saturating_sub(margin_px);
        Self {
            size: self.size.map(|side| side - 2 * left_out),
            centre_px: self.centre_px.map(|middle| middle - left_out as f32),
            margin_px: self.margin_px - left_out,
            backdrop_rows: [self.backdrop_rows[0] + left_out as i32, self.backdrop_rows[1]],
            ..self
        }
    }

    /// Row of the background that row `y` of the picture shows, and the number of those. Margins
    /// show the outermost rows.
    pub(crate) fn backdrop_row(&self, y: usize) -> [usize; 2] {
        let [by, rows] = self.backdrop_rows;
        [(y as i32 + by).clamp(0, rows - 1) as usize, rows as usize]
    }

    /// Place on the picture from that on the whole picture relative to its centre, pixels.
    #[inline(always)]
    pub(crate) fn placed<V: Values>(&self, from_centre: [V; 2]) -> [V; 2] {
        let [x, y] = from_centre;
        [
            x + (self.centre_px[0] + self.origin_px[0]) - self.origin_px[0],
            y + (self.centre_px[1] + self.origin_px[1]) - self.origin_px[1],
        ]
    }

    /// Transforms a direction from world to view space.
    pub fn to_view(&self, v: Vec3) -> Vec3 {
        let [right, up, back] = self.view_from_world;
        Vec3::new(right.dot(v), up.dot(v), back.dot(v))
    }

    /// From the eye to the anchor, along the world's axes.
    #[inline(always)]
    pub fn to_anchor(&self) -> Vec3 {
        self.view_from_world[2] * -self.anchor_depth
    }

    /// `a` and `b` of the divisor `a * depth + b`: a unit of length to the right or up takes
    /// [`Camera::focal_px`] over it pixels.
    #[inline(always)]
    pub fn divisor(&self) -> [f32; 2] {
        if self.is_parallel { [0.0, self.anchor_depth] } else { [1.0, 0.0] }
    }

    /// Coordinates of a point relative to the eye: right, down and away from it. The argument is
    /// relative to the anchor. In a parallel view the point is moved sideways, so that a pinhole
    /// projects it to its place in the parallel projection.
    #[inline(always)]
    pub fn seen<V: Values>(&self, [x, y, ahead]: [V; 3]) -> [V; 3] {
        let depth = ahead + self.anchor_depth;
        if !self.is_parallel {
            return [x, y, depth];
        }
        let squeeze = depth * (1.0 / self.anchor_depth);
        [x * squeeze, y * squeeze, depth]
    }

    /// [`Camera::seen`] for a line, from one of its points and its direction.
    #[inline]
    pub fn seen_line(&self, [from, way]: [Vec3; 2]) -> [Vec3; 2] {
        let depth = from.z + self.anchor_depth;
        if !self.is_parallel {
            return [from.with_z(depth), way];
        }
        let per_depth = 1.0 / self.anchor_depth;
        let squeezed = |v: Vec3| v.truncate() * (depth * per_depth);
        let turned = squeezed(way) + from.truncate() * (way.z * per_depth);
        [squeezed(from).extend(depth), turned.extend(way.z)]
    }

    /// Directions to the eye from the centres of eight pixels, of which (`x`, `y`) is the first:
    /// right, up and back, of unit length.
    #[inline(always)]
    pub(crate) fn to_eye<S: Simd>(&self, simd: S, x: usize, y: usize) -> [f32x8<S>; 3] {
        let [middle_x, middle_y] = self.centre_px;
        let columns = load(simd, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        // Via `u32`, which converts in one instruction.
        let left = -(columns + (x as u32 as f32 + 0.5 - middle_x));
        let down = y as u32 as f32 + 0.5 - middle_y;
        let beside = simd.splat_f32x8(down * down + self.focal_px * self.focal_px);
        let per_length = 1.0 / Values::sqrt(Values::mul_add(left, left, beside));
        [left * per_length, per_length * down, per_length * self.focal_px]
    }

    /// Position of a lattice point relative to the anchor, steps. It does not depend on a node, so
    /// nodes that share a point get the same bits.
    #[inline(always)]
    pub fn steps_from_anchor(&self, at: [u32; 3]) -> Vec3 {
        let axis = |i: usize| {
            let high = ((at[i] >> 16) as i32).wrapping_sub(self.anchor_high[i]);
            let low = (at[i] & 0xffff) as i32 - self.anchor_low[i];
            high as f32 * 65_536.0 + low as f32 - self.anchor_rest[i]
        };
        Vec3::new(axis(0), axis(1), axis(2))
    }

    /// Constants for the positions of the points of a node.
    pub fn place(&self, node: &Node, has_residual: bool) -> NodePlace {
        let shift = node.hot_shift.min(SHIFT_MAX);
        // Without the dropped bits a point is drawn in the middle of its hot step.
        let middle = if has_residual { 0.0 } else { ((1u32 << shift) - 1) as f64 * 0.5 };
        let mut place =
            NodePlace { shift, base_high: [0; 3], base_low: [0; 3], bias_steps: Vec3::ZERO };
        for axis in 0..3 {
            let difference = f64::from(node.box_min[axis]) - self.anchor_steps[axis];
            let whole = difference.clamp(-STEPS_FAR, STEPS_FAR).floor();
            let whole = if whole.is_finite() { whole } else { STEPS_FAR };
            let fraction = (difference - whole).clamp(0.0, 1.0);
            place.base_high[axis] = (whole as i64 >> 16) as i32;
            place.base_low[axis] = (whole as i64 & 0xffff) as i32;
            place.bias_steps[axis] = (fraction + middle) as f32;
        }
        place
    }
}

/// Position of a node relative to the anchor, from which those of its points are computed.
#[derive(Clone, Copy, Debug)]
pub struct NodePlace {
    /// Number of bits that hot positions drop.
    pub shift: u8,
    /// `box_min` minus the anchor, steps, rounded down: the part above 2^16,
    pub base_high: [i32; 3],
    /// and the part below.
    pub base_low: [i32; 3],
    /// Rest after rounding down, and half a hot step if the dropped bits are missing, steps.
    pub bias_steps: Vec3,
}

impl NodePlace {
    /// Whole steps from the anchor to the box, if the node is so near that high and low part fit
    /// one integer: the sum with an offset then rounds to the same `f32`.
    pub fn near(&self) -> Option<[i32; 3]> {
        /// Keeps the sum below 2^31 for the greatest hot position.
        const HIGH_MAX: u32 = 1 << 14;
        let is_near = self.shift < 14 && self.base_high.iter().all(|h| h.unsigned_abs() < HIGH_MAX);
        is_near.then(|| [0, 1, 2].map(|i| (self.base_high[i] << 16) + self.base_low[i]))
    }

    /// Position of a point relative to the anchor along an axis, steps, from its offset in the box
    /// of the node.
    #[inline(always)]
    pub fn axis_steps(&self, axis: usize, offset: u32) -> f32 {
        let high = self.base_high[axis].wrapping_add((offset >> 16) as i32);
        let low = self.base_low[axis] + (offset & 0xffff) as i32;
        high as f32 * 65_536.0 + low as f32 + self.bias_steps[axis]
    }

    /// Position of a point relative to the anchor, steps, from its offset in the box of the node.
    #[inline(always)]
    pub fn steps_from_anchor(&self, offset: [u32; 3]) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.axis_steps(i, offset[i])))
    }
}

/// The planes that positions are decoded from, up to the shortest one.
#[derive(Clone, Copy, Debug)]
pub struct Positions<'a> {
    /// Number of points.
    pub len: usize,
    hot: &'a [u8],
    residual: Option<&'a [u8]>,
    shift: u8,
}

impl<'a> Positions<'a> {
    /// Positions of the drawn points of a node. A residual plane that is too short is ignored.
    pub fn of(draw: &DrawNode<'a>) -> Self {
        let shift = draw.node.hot_shift.min(SHIFT_MAX);
        let len = draw.prefix.min(draw.position.len() / HOT_POSITION_BYTES);
        let enough = |r: &&[u8]| r.len() / residual_bytes(shift).max(1) >= len;
        let residual = if shift == 0 { Some(&[][..]) } else { draw.residual.filter(enough) };
        Self { len, hot: draw.position, residual, shift }
    }

    /// Whether no bits are missing.
    pub fn is_exact(&self) -> bool {
        self.residual.is_some()
    }

    /// Writes the offsets ([`Positions::offset`]) of points from `first` on, as many as `out` has
    /// room for, by straight loops that are vectorised. Returns their number.
    #[inline(always)]
    pub fn offsets<const N: usize>(&self, first: usize, out: &mut [[u32; N]; 3]) -> usize {
        let count = N.min(self.len - first);
        let hot =
            self.hot[first * HOT_POSITION_BYTES..][..count * HOT_POSITION_BYTES].as_chunks().0;
        let shift = u32::from(self.shift);
        let [xs, ys, zs] = out;
        for (((raw, x), y), z) in hot.iter().zip(&mut *xs).zip(&mut *ys).zip(&mut *zs) {
            let raw = u64::from_le_bytes(*raw);
            *x = (raw as u32 & 0xffff) << shift;
            *y = (raw as u32 >> 16) << shift;
            *z = ((raw >> 32) as u32 & 0xffff) << shift;
        }
        let residual = self.residual.filter(|_| shift > 0);
        match (residual, residual_bytes(self.shift)) {
            (Some(plane), 4) => {
                let low = plane[first * 4..][..count * 4].as_chunks().0;
                for (((low, x), y), z) in low.iter().zip(xs).zip(ys).zip(zs) {
                    let low = u32::from_le_bytes(*low);
                    *x |= low & 1023;
                    *y |= low >> 10 & 1023;
                    *z |= low >> 20 & 1023;
                }
            }
            (Some(plane), _) => {
                let low = plane[first * 6..][..count * 6].as_chunks::<6>().0;
                for (((low, x), y), z) in low.iter().zip(xs).zip(ys).zip(zs) {
                    let at = |i: usize| u32::from(u16::from_le_bytes([low[i], low[i + 1]]));
                    *x |= at(0);
                    *y |= at(2);
                    *z |= at(4);
                }
            }
            (None, _) => {}
        }
        count
    }

    /// Prefetches the data of a point's offset.
    #[inline(always)]
    pub fn fetch(&self, index: usize) {
        fetch(self.hot, index * HOT_POSITION_BYTES);
    }

    /// Offset of a point in the box of its node, steps, without the dropped bits if they are
    /// missing; and the code of its radius.
    #[inline(always)]
    pub fn offset(&self, index: usize) -> ([u32; 3], u8) {
        let mut raw = [0; HOT_POSITION_BYTES];
        raw.copy_from_slice(&self.hot[index * HOT_POSITION_BYTES..][..HOT_POSITION_BYTES]);
        let raw = u64::from_le_bytes(raw);
        let q = [raw as u16, (raw >> 16) as u16, (raw >> 32) as u16];
        let mut offset = q.map(|q| u32::from(q) << self.shift);
        if self.shift > 0
            && let Some(plane) = self.residual
        {
            let low = read_residual(plane, index, self.shift);
            for (o, r) in offset.iter_mut().zip(low) {
                *o |= u32::from(r);
            }
        }
        (offset, (raw >> 48) as u8)
    }
}
