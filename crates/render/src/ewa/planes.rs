//! What splats leave of a picture for shading: means of colours and normals, plane after plane in each row as the sums are
//! that they come from, so that nothing is turned over on the way.

use crate::lanes::LANES;
use crate::surface::Surface;
use crate::values::EIGHT;
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

/// Planes of a row: red, green, blue, then the normal (right, up, back), or the radius alone.
const TINT: usize = 0;
const SHAPE: usize = 3;

/// The pixels of a picture.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    size: [usize; 2],
    has_normals: bool,
    /// Values of a plane's row: those of its pixels, and so many more that eight may be taken from any.
    stride: usize,
    values: Vec<f32>,
}

impl Planes {
    /// Takes the shape for a picture; what the pixels hold is left over from before.
    pub fn fit(&mut self, size: [usize; 2], has_normals: bool) {
        (self.size, self.has_normals) = (size, has_normals);
        self.stride = size[0].next_multiple_of(LANES) + EIGHT;
        self.values.resize(self.row_len() * size[1], 0.0);
    }

    /// Planes of a row.
    fn planes(&self) -> usize {
        SHAPE + if self.has_normals { 3 } else { 1 }
    }

    /// Values of a row.
    pub fn row_len(&self) -> usize {
        self.planes() * self.stride
    }

    /// Values of a plane's row.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// All rows, [`Planes::row_len`] values each.
    pub fn rows_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Three values of eight pixels; zeros below the picture.
    #[inline(always)]
    fn three<S: Simd>(&self, simd: S, plane: usize, x: usize, y: usize) -> [f32x8<S>; 3] {
        let first = y * self.row_len() + plane * self.stride + x;
        [
            self.eight(simd, first),
            self.eight(simd, first + self.stride),
            self.eight(simd, first + 2 * self.stride),
        ]
    }

    #[inline(always)]
    fn eight<S: Simd>(&self, simd: S, first: usize) -> f32x8<S> {
        let values = self.values.get(first..).and_then(<[f32]>::first_chunk);
        simd.load_array_ref_f32x8(values.unwrap_or(&[0.0; EIGHT]))
    }

    fn one(&self, plane: usize, x: usize, y: usize) -> f32 {
        self.values[y * self.row_len() + plane * self.stride + x]
    }

    /// Colour of a pixel, linear light.
    pub fn tint(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.one(TINT + i, x, y)))
    }
}

impl Surface for Planes {
    fn size(&self) -> [usize; 2] {
        self.size
    }

    fn has_normals(&self) -> bool {
        self.has_normals
    }

    #[inline(always)]
    fn tints<S: Simd>(&self, simd: S, x: usize, y: usize) -> [f32x8<S>; 3] {
        self.three(simd, TINT, x, y)
    }

    #[inline(always)]
    fn normals<S: Simd>(&self, simd: S, x: usize, y: usize) -> [f32x8<S>; 3] {
        self.three(simd, SHAPE, x, y)
    }

    #[inline]
    fn normal(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.one(SHAPE + i, x, y)))
    }

    /// None: what has no normal was made to face the eye.
    fn normal_around(&self, _: usize, _: usize) -> Vec3 {
        Vec3::ZERO
    }

    fn radius_px(&self, x: usize, y: usize) -> f32 {
        self.one(SHAPE, x, y)
    }
}
