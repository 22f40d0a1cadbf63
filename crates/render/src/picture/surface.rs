//! What is shaded: the colours and normals of a picture's pixels, wherever a method leaves them.
//! Pull and push work on level 0 of a pyramid, a pixel's values side by side; splats are summed up
//! plane by plane ([`crate::ewa::planes`]).

use crate::picture::pyramid::{Planes, Pyramid};
use crate::simd::lanes::{LANES, four};
use crate::simd::values::{EIGHT, join};
use fearless_simd::{Simd, f32x8};
use glam::{Vec3, Vec4};

/// Pixels with a colour, and a normal where the cloud has them. Which of them show anything the
/// depth image tells; what the others hold means nothing.
pub trait Surface: Sync {
    /// Columns and rows.
    fn size(&self) -> [usize; 2];
    /// Whether pixels have normals.
    fn has_normals(&self) -> bool;
    /// One of the rows.
    fn row(&self, y: usize) -> impl SurfaceRow;
    /// The normal of a pixel.
    fn normal(&self, x: usize, y: usize) -> Vec3;
    /// A normal of unit length for a pixel that has none, from around it; zero where there is none
    /// either.
    fn normal_around(&self, x: usize, y: usize) -> Vec3;
    /// Radius of the disc or ellipse that a pixel shows, pixels; of clouds without normals.
    fn radius_px(&self, x: usize, y: usize) -> f32;
}

/// A row of pixels, eight of which are told at once from a column on, a multiple of eight.
pub trait SurfaceRow {
    /// Colours, linear light; any where the row has no more.
    fn tints<S: Simd>(&self, simd: S, x: usize) -> [f32x8<S>; 3];
    /// Normals in view space (right, up, back), not of unit length, those to the right of them, and
    /// those below them; zeros below the picture.
    fn normals<S: Simd>(&self, simd: S, x: usize) -> [[f32x8<S>; 3]; 3];
}

/// A row of level 0: its pixels and all after them.
struct PixelRow<'a> {
    width: usize,
    tint: &'a [Vec4],
    normal: &'a [Vec4],
}

impl SurfaceRow for PixelRow<'_> {
    #[inline(always)]
    fn tints<S: Simd>(&self, simd: S, x: usize) -> [f32x8<S>; 3] {
        eight(simd, self.tint, x)
    }

    #[inline(always)]
    fn normals<S: Simd>(&self, simd: S, x: usize) -> [[f32x8<S>; 3]; 3] {
        [
            eight(simd, self.normal, x),
            eight(simd, self.normal, x + 1),
            eight(simd, self.normal, x + self.width),
        ]
    }
}

impl Surface for Pyramid {
    fn size(&self) -> [usize; 2] {
        [self.levels[0].width, self.levels[0].height]
    }

    fn has_normals(&self) -> bool {
        self.planes() == Planes::Normals
    }

    fn row(&self, y: usize) -> impl SurfaceRow {
        let base = &self.levels[0];
        let from = y * base.width;
        let (tint, normal) = (base.tint.get(from..), base.normal.get(from..));
        PixelRow { width: base.width, tint: tint.unwrap_or(&[]), normal: normal.unwrap_or(&[]) }
    }

    #[inline]
    fn normal(&self, x: usize, y: usize) -> Vec3 {
        let base = &self.levels[0];
        base.normal[y * base.width + x].truncate()
    }

    /// That of the finest coarser pixel with one.
    fn normal_around(&self, x: usize, y: usize) -> Vec3 {
        let found = self.levels.iter().enumerate().find_map(|(i, level)| {
            let pixel = (y >> i) * level.width + (x >> i);
            let normal = level.normal[pixel].truncate();
            if level.is_valid(pixel) { normal.try_normalize() } else { None }
        });
        found.unwrap_or(Vec3::ZERO)
    }

    fn radius_px(&self, x: usize, y: usize) -> f32 {
        let base = &self.levels[0];
        base.tint[y * base.width + x].w
    }
}

/// The first three attributes of eight pixels of a plane from one on; zeros behind its end.
#[inline(always)]
fn eight<S: Simd>(simd: S, plane: &[Vec4], pixel: usize) -> [f32x8<S>; 3] {
    let run = plane.get(pixel..).unwrap_or(&[]);
    let (first, second) = run[..run.len().min(EIGHT)].split_at(run.len().min(LANES));
    let (first, second) = (four(first, Vec4::ZERO), four(second, Vec4::ZERO));
    [
        join(simd, first[0], second[0]),
        join(simd, first[1], second[1]),
        join(simd, first[2], second[2]),
    ]
}
