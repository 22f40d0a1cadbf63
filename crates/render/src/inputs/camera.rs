//! The camera on the lattice: what a frame and a node give to each point's arithmetic (DESIGN
//! section 4). The camera's lattice cell is subtracted as integers, only the difference becomes
//! `f32`: its rounding is relative to the distance from the eye, so far coordinates do not jitter.
//!
//! A difference may need more than 32 bits, and a GPU has no wider integers: it is kept as
//! `high * 2^16 + low`, two integers that are exact in `f32`, so that their sum rounds once.

use crate::error::RenderError;
use crate::frame::{DrawNode, PIXELS_MAX, SIDE_MAX};
use crate::simd::values::{Values, load};
use esker_lod::View;
use esker_points::fetch::fetch;
use esker_points::quant::{HOT_POSITION_BYTES, read_residual, residual_bytes};
use esker_points::{Lattice, Node};
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

/// Differences are clamped here; nothing this far away is on a picture.
const STEPS_FAR: f64 = (1u64 << 46) as f64;
/// Bits a hot position can drop (the lattice has 32, a hot coordinate keeps 16).
pub(crate) const SHIFT_MAX: u8 = 16;

/// Whether pictures of this size can be drawn.
pub fn is_drawable(width: u32, height: u32) -> bool {
    let sides = 1..=SIDE_MAX;
    let pixels = u64::from(width) * u64::from(height);
    sides.contains(&width) && sides.contains(&height) && pixels <= PIXELS_MAX
}

/// The camera in `f32`, for a frame.
#[derive(Clone, Debug)]
pub struct Camera {
    eye_steps: [f64; 3],
    /// The eye on the lattice, rounded down: the part above 2^16 ...
    pub eye_high: [i32; 3],
    /// ... and the part below.
    pub eye_low: [i32; 3],
    /// What rounding down left, steps.
    pub eye_rest: Vec3,
    /// Length of a lattice step, an axis, the file's unit.
    pub step: Vec3,
    /// Rows right, up, back of the rotation from the world's axes to the view's.
    pub view_from_world: [Vec3; 3],
    /// Pixels that a unit of length takes at unit depth.
    pub focal_px: f32,
    /// The picture's middle in pixels.
    pub centre_px: [f32; 2],
    /// Pixels in a row, rows; of the picture with its margin.
    pub size: [u32; 2],
    /// What is drawn beyond the picture on each side, pixels ([`crate::picture::margin`]).
    pub margin_px: u32,
    /// What is nearer is not drawn.
    pub near: f32,
}

impl Camera {
    /// The camera of a view.
    ///
    /// # Errors
    /// Where the view is no usable camera.
    pub fn new(view: &View, lattice: &Lattice) -> Result<Self, RenderError> {
        let (width, height) = (view.width, view.height);
        if !is_drawable(width, height) {
            return Err(RenderError::Size { width, height, side: SIDE_MAX, pixels: PIXELS_MAX });
        }
        let usable = |ok: bool, what| if ok { Ok(()) } else { Err(RenderError::Camera { what }) };
        usable(view.eye.is_finite(), "eye")?;
        usable(view.world_from_view.is_finite(), "direction")?;
        usable(view.focal_px() > 0.0 && view.focal_px().is_finite(), "field of view")?;
        usable(view.near > 0.0 && view.near.is_finite(), "near plane")?;
        let rows = view.view_from_world().transpose();
        let eye_steps = [0, 1, 2].map(|i| lattice.steps_axis(i, view.eye[i]));
        let whole = eye_steps.map(|e| e.clamp(-STEPS_FAR, STEPS_FAR).floor());
        Ok(Self {
            eye_steps,
            eye_high: whole.map(|w| (w as i64 >> 16) as i32),
            eye_low: whole.map(|w| (w as i64 & 0xffff) as i32),
            eye_rest: [0, 1, 2].map(|i| (eye_steps[i] - whole[i]).clamp(0.0, 1.0) as f32).into(),
            step: Vec3::from_array(lattice.scale.map(|s| s as f32)),
            view_from_world: [rows.x_axis, rows.y_axis, rows.z_axis].map(|r| r.as_vec3()),
            focal_px: view.focal_px() as f32,
            centre_px: [width as f32 * 0.5, height as f32 * 0.5],
            size: [width, height],
            // A pixel at least is shown.
            margin_px: view.margin_px.min((width.min(height) - 1) / 2),
            near: (view.near as f32).max(f32::MIN_POSITIVE),
        })
    }

    /// The same with so much of its margin.
    pub fn with_margin(self, margin_px: u32) -> Self {
        let left_out = self.margin_px.saturating_sub(margin_px);
        Self {
            size: self.size.map(|side| side - 2 * left_out),
            centre_px: self.centre_px.map(|middle| middle - left_out as f32),
            margin_px: self.margin_px - left_out,
            ..self
        }
    }

    /// A direction of the world in view space.
    pub fn to_view(&self, v: Vec3) -> Vec3 {
        let [right, up, back] = self.view_from_world;
        Vec3::new(right.dot(v), up.dot(v), back.dot(v))
    }

    /// Directions to the eye from the middles of eight pixels of a row, the first of which is
    /// given; right, up and back, of unit length.
    #[inline(always)]
    pub(crate) fn to_eye<S: Simd>(&self, simd: S, x: usize, y: usize) -> [f32x8<S>; 3] {
        let [middle_x, middle_y] = self.centre_px;
        let columns = load(simd, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        // By 32 bits, which take an instruction.
        let left = -(columns + (x as u32 as f32 + 0.5 - middle_x));
        let down = y as u32 as f32 + 0.5 - middle_y;
        let beside = simd.splat_f32x8(down * down + self.focal_px * self.focal_px);
        let per_length = 1.0 / Values::sqrt(Values::mul_add(left, left, beside));
        [left * per_length, per_length * down, per_length * self.focal_px]
    }

    /// A place of the lattice against the eye, in steps: the same bits from whichever node it is
    /// asked.
    #[inline(always)]
    pub fn steps_from_eye(&self, at: [u32; 3]) -> Vec3 {
        let axis = |i: usize| {
            let high = ((at[i] >> 16) as i32).wrapping_sub(self.eye_high[i]);
            let low = (at[i] & 0xffff) as i32 - self.eye_low[i];
            high as f32 * 65_536.0 + low as f32 - self.eye_rest[i]
        };
        Vec3::new(axis(0), axis(1), axis(2))
    }

    /// The constants of a node's points.
    pub fn place(&self, node: &Node, has_residual: bool) -> NodePlace {
        let shift = node.hot_shift.min(SHIFT_MAX);
        // Without the dropped bits a point stands in the middle of its hot step.
        let middle = if has_residual { 0.0 } else { ((1u32 << shift) - 1) as f64 * 0.5 };
        let mut place =
            NodePlace { shift, base_high: [0; 3], base_low: [0; 3], bias_steps: Vec3::ZERO };
        for axis in 0..3 {
            let difference = f64::from(node.box_min[axis]) - self.eye_steps[axis];
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

/// A node's place against the eye, for its points' arithmetic.
#[derive(Clone, Copy, Debug)]
pub struct NodePlace {
    /// Bits that hot positions drop.
    pub shift: u8,
    /// `box_min` less the eye, in steps, rounded down: the part above 2^16 ...
    pub base_high: [i32; 3],
    /// ... and the part below.
    pub base_low: [i32; 3],
    /// What rounding down left, and half a hot step where the dropped bits are not there.
    pub bias_steps: Vec3,
}

impl NodePlace {
    /// Whole steps of the box from the eye, where no place in it is so far that high and low parts
    /// have to be apart: the sum with an offset rounds to the same `f32`.
    pub fn near(&self) -> Option<[i32; 3]> {
        /// With this the sum stays under 2^31, for the highest of hot positions as well.
        const HIGH_MAX: u32 = 1 << 14;
        let is_near = self.shift < 14 && self.base_high.iter().all(|h| h.unsigned_abs() < HIGH_MAX);
        is_near.then(|| [0, 1, 2].map(|i| (self.base_high[i] << 16) + self.base_low[i]))
    }

    /// A point against the eye along an axis, in steps, from its offset in the node's box.
    #[inline(always)]
    pub fn axis_steps(&self, axis: usize, offset: u32) -> f32 {
        let high = self.base_high[axis].wrapping_add((offset >> 16) as i32);
        let low = self.base_low[axis] + (offset & 0xffff) as i32;
        high as f32 * 65_536.0 + low as f32 + self.bias_steps[axis]
    }

    /// A point against the eye, in steps, from its offset in the node's box.
    #[inline(always)]
    pub fn steps_from_eye(&self, offset: [u32; 3]) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.axis_steps(i, offset[i])))
    }
}

/// The planes that positions are decoded from, cut to the points that they all have.
#[derive(Clone, Copy, Debug)]
pub struct Positions<'a> {
    /// Number of points.
    pub len: usize,
    hot: &'a [u8],
    residual: Option<&'a [u8]>,
    shift: u8,
}

impl<'a> Positions<'a> {
    /// The points of a node that are drawn. A residual plane that is too short serves nobody.
    pub fn of(draw: &DrawNode<'a>) -> Self {
        let shift = draw.node.hot_shift.min(SHIFT_MAX);
        let len = draw.prefix.min(draw.position.len() / HOT_POSITION_BYTES);
        let enough = |r: &&[u8]| r.len() / residual_bytes(shift).max(1) >= len;
        let residual = if shift == 0 { Some(&[][..]) } else { draw.residual.filter(enough) };
        Self { len, hot: draw.position, residual, shift }
    }

    /// Whether positions are exact.
    pub fn is_exact(&self) -> bool {
        self.residual.is_some()
    }

    /// Offsets of the points from `first` on, as many as there are and `out` takes: what
    /// [`Positions::offset`] says of each, by straight loops that become SIMD. Returns their
    /// number.
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

    /// Says ahead that a point's offset will be asked for.
    #[inline(always)]
    pub fn fetch(&self, index: usize) {
        fetch(self.hot, index * HOT_POSITION_BYTES);
    }

    /// Offset of a point in its node's box, in steps, without the dropped bits where these are not
    /// there; and its radius code.
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
