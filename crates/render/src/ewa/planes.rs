//! Means of the colours and normals of splats, to be shaded. Eight neighbouring pixels of a plane
//! are adjacent in memory, followed by the same pixels of the next plane, so that the result of a
//! row of a tile is one run of memory (`docs/design/splats.md`).

use crate::picture::surface::{Surface, SurfaceRow};
use crate::simd::values::{EIGHT, load};
use fearless_simd::{Simd, f32x8};
use glam::Vec3;

/// First planes of the colour (red, green, blue) and of the normal (right, up, back); without
/// normals, the second one is the radius.
const TINT: usize = 0;
const SHAPE: usize = 3;

/// The pixels of a picture.
#[derive(Clone, Debug, Default)]
pub struct Planes {
    size: [usize; 2],
    has_normals: bool,
    /// Planes of each eight pixels of a row; a row has eight more pixels, so that its last ones
    /// have neighbours.
    values: Vec<[f32; EIGHT]>,
}

impl Planes {
    /// Resizes the planes for a picture; the contents of pixels are undefined.
    pub fn fit(&mut self, size: [usize; 2], has_normals: bool) {
        (self.size, self.has_normals) = (size, has_normals);
        self.values.resize(self.row_len() * size[1], [0.0; EIGHT]);
    }

    /// Number of planes of eight pixels.
    pub fn planes(&self) -> usize {
        SHAPE + if self.has_normals { 3 } else { 1 }
    }

    /// Number of planes of all pixels of a row.
    pub fn row_len(&self) -> usize {
        (self.size[0].div_ceil(EIGHT) + 1) * self.planes()
    }

    /// All rows, [`Planes::row_len`] values of eight pixels each.
    pub fn rows_mut(&mut self) -> &mut [[f32; EIGHT]] {
        &mut self.values
    }

    /// Planes of the eight pixels that include (`x`, `y`); empty below the picture.
    #[inline(always)]
    fn eight(&self, x: usize, y: usize) -> &[[f32; EIGHT]] {
        let first = y * self.row_len() + x / EIGHT * self.planes();
        self.values.get(first..first + self.planes()).unwrap_or(&[])
    }

    /// Value of one plane of a pixel.
    fn one(&self, plane: usize, x: usize, y: usize) -> f32 {
        self.eight(x, y)[plane][x % EIGHT]
    }

    /// Colour of a pixel, linear light.
    pub fn tint(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.one(TINT + i, x, y)))
    }
}

/// A row of planes, and the row below it.
struct PlaneRow<'a> {
    planes: usize,
    here: &'a [[f32; EIGHT]],
    below: &'a [[f32; EIGHT]],
}

/// Three planes of eight pixels, from `plane` on; zeros beyond the row.
#[inline(always)]
fn three<S: Simd>(simd: S, row: &[[f32; EIGHT]], plane: usize) -> [f32x8<S>; 3] {
    let Some([a, b, c]) = row.get(plane..).and_then(<[_]>::first_chunk) else {
        return [simd.splat_f32x8(0.0); 3];
    };
    [load(simd, a), load(simd, b), load(simd, c)]
}

impl SurfaceRow for PlaneRow<'_> {
    #[inline(always)]
    fn tints<S: Simd>(&self, simd: S, x: usize) -> [f32x8<S>; 3] {
        three(simd, self.here, x / EIGHT * self.planes + TINT)
    }

    #[inline(always)]
    fn normals<S: Simd>(&self, simd: S, x: usize) -> [[f32x8<S>; 3]; 3] {
        let plane = x / EIGHT * self.planes + SHAPE;
        let here = three(simd, self.here, plane);
        let next = three(simd, self.here, plane + self.planes);
        let right = [
            simd.slide_f32x8::<1>(here[0], next[0]),
            simd.slide_f32x8::<1>(here[1], next[1]),
            simd.slide_f32x8::<1>(here[2], next[2]),
        ];
        [here, right, three(simd, self.below, plane)]
    }
}

impl Surface for Planes {
    fn size(&self) -> [usize; 2] {
        self.size
    }

    fn has_normals(&self) -> bool {
        self.has_normals
    }

    fn row(&self, y: usize) -> impl SurfaceRow {
        let of = |y: usize| {
            let from = (y * self.row_len()).min(self.values.len());
            &self.values[from..self.values.len().min(from + self.row_len())]
        };
        PlaneRow { planes: self.planes(), here: of(y), below: of(y + 1) }
    }

    #[inline]
    fn normal(&self, x: usize, y: usize) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|i| self.one(SHAPE + i, x, y)))
    }

    /// Zero: pixels without a normal already face the eye.
    fn normal_around(&self, _: usize, _: usize) -> Vec3 {
        Vec3::ZERO
    }

    fn radius_px(&self, x: usize, y: usize) -> f32 {
        self.one(SHAPE, x, y)
    }

    /// Not: splats have smooth outlines, along which the darkening would be a line.
    fn darkens_edges(&self) -> bool {
        false
    }
}
