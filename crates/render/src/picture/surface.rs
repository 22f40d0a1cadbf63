//! Input of shading: the colours and normals of pixels. Pull-push leaves them in level 0 of the
//! pyramid, the values of a pixel side by side; EWA splatting leaves them in planes
//! ([`crate::ewa::planes`]).

use crate::picture::pyramid::{Planes, Pyramid};
use crate::simd::lanes::{LANES, four};
use crate::simd::values::{EIGHT, join};
use fearless_simd::{Simd, f32x8};
use glam::{Vec3, Vec4};

/// Pixels with a colour, and with a normal if the cloud has normals. The depth image decides which
/// pixels show a surface; the values of the others are undefined.
pub trait Surface: Sync {
    /// Width and height, pixels.
    fn size(&self) -> [usize; 2];
    /// Whether pixels have normals.
    fn has_normals(&self) -> bool;
    /// Row `y`.
    fn row(&self, y: usize) -> impl SurfaceRow;
    /// The normal of a pixel.
    fn normal(&self, x: usize, y: usize) -> Vec3;
    /// A normal of unit length from around a pixel without a normal; zero if there is none.
    fn normal_around(&self, x: usize, y: usize) -> Vec3;
    /// Radius of the disc or ellipse that a pixel shows, pixels; for clouds without normals.
    fn radius_px(&self, x: usize, y: usize) -> f32;
    /// Whether pixels with a normal are darkened behind edges.
    fn darkens_edges(&self) -> bool;
}

/// A row of pixels. Functions return eight pixels from column `x` on, a multiple of eight.
pub trait SurfaceRow {
    /// Colours, linear light; undefined beyond the row.
    fn tints<S: Simd>(&self, simd: S, x: usize) -> [f32x8<S>; 3];
    /// Normals in view space (right, up, back), not of unit length: those of the pixels, of their
    /// right neighbours, and of their neighbours below; zeros below the picture.
    fn normals<S: Simd>(&self, simd: S, x: usize) -> [[f32x8<S>; 3]; 3];
}

/// Levels of the pyramid above the picture in which a pixel without a normal looks for one.
pub(crate) const NORMAL_LEVELS: usize = 2;

/// A row of level 0 of the pyramid, with all rows below it.
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

    /// The normal of the finest coarser pixel that has one, up to level [`NORMAL_LEVELS`]: the
    /// normals of coarser levels would show as squares.
    fn normal_around(&self, x: usize, y: usize) -> Vec3 {
        let found =
            self.levels.iter().take(NORMAL_LEVELS + 1).enumerate().find_map(|(i, level)| {
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

    fn darkens_edges(&self) -> bool {
        true
    }
}

/// The first three values of eight pixels from `pixel` on; zeros beyond the end.
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
