//! The image pyramid that pull and push work on: level 0 is the picture, each level above has half as
//! many pixels a side (rounded up), down to a single one. Flat planes of four floats, as they would lie
//! in a GPU's textures; a cloud without normals has no normal plane.
//!
//! Lengths in the picture (displacements, radii) are in pixels of level 0 at every level. The centre of
//! pixel (x, y) of level l then lies at ((x + 1/2) 2^l, (y + 1/2) 2^l).

use crate::tangent::Lens;
use glam::{Vec2, Vec4};
use rayon::prelude::*;

/// Depths at pixels' centres are no farther from those of the ellipses' than discs reach, or so many pixels at least:
/// beyond a rim a plane is nobody's.
const REACH_MIN_PX: f32 = 4.0;

/// One level.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Edge of its pixels, in pixels of level 0.
    pub edge_px: f32,
    /// Least depth, greatest depth, and the displacement x, y from the ellipse's centre to the pixel's. Depths hold
    /// at the ellipse's centre ([`crate::tangent`]).
    /// A pixel whose least depth is infinite is invalid, and its other planes mean nothing.
    pub front: Vec<Vec4>,
    /// Red, green, blue in linear light, and the radius in pixels of level 0.
    pub tint: Vec<Vec4>,
    /// Mean depth: that of the surface, where `front` has the interval for tests.
    pub depth: Vec<f32>,
    /// Normal in view space (right, up, back), not of unit length once averaged, and in w its
    /// ellipse's minor axis over the major one ([`crate::gather`]); empty where the cloud has none.
    pub normal: Vec<Vec4>,
}

/// `front` of an invalid pixel.
pub const INVALID: Vec4 = Vec4::new(f32::INFINITY, f32::INFINITY, 0.0, 0.0);

impl Level {
    fn fit(&mut self, width: usize, height: usize, edge_px: f32, has_normals: bool) {
        (self.width, self.height, self.edge_px) = (width, height, edge_px);
        let pixels = width * height;
        self.front.resize(pixels, INVALID);
        self.tint.resize(pixels, Vec4::ZERO);
        self.depth.resize(pixels, 0.0);
        self.normal.resize(if has_normals { pixels } else { 0 }, Vec4::ZERO);
    }

    /// Whether a pixel holds a surface.
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.front[pixel].x < f32::INFINITY
    }

    /// Writes the depths at its pixels' centres; infinite where a pixel is invalid.
    pub fn depth_image(&self, lens: &Lens, depth: &mut [f32]) {
        let rows = depth.par_chunks_mut(self.width).zip(self.front.par_chunks(self.width));
        let rows = rows.zip(self.depth.par_chunks(self.width)).enumerate();
        rows.for_each(|(y, ((out, front), depth))| {
            for ((out, front), depth) in out.iter_mut().zip(front).zip(depth) {
                *out = if front.x < f32::INFINITY { *depth } else { f32::INFINITY };
            }
            let normals = self.normal.get(y * self.width..).unwrap_or(&[]);
            for (x, ((out, front), normal)) in out.iter_mut().zip(front).zip(normals).enumerate() {
                let displaced = Vec2::new(front.z, front.w);
                let factor = lens.along(*normal, self.centre(x, y) - displaced, displaced);
                let reach = self.tint[y * self.width + x].w.max(REACH_MIN_PX) / lens.focal_px;
                *out *= factor.clamp(1.0 - reach, 1.0 + reach);
            }
        });
    }

    /// Centre of a pixel, in pixels of level 0.
    pub fn centre(&self, x: usize, y: usize) -> Vec2 {
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.edge_px
    }
}

/// All levels, the picture first. Memory is kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// The levels.
    pub levels: Vec<Level>,
    /// How the picture sees.
    pub lens: Lens,
}

impl Pyramid {
    /// Takes the shape for a picture; what the pixels hold is left over from before.
    pub fn fit(&mut self, width: usize, height: usize, has_normals: bool) {
        self.fit_levels(width, height, has_normals, usize::MAX);
    }

    /// The same, of so many levels at most.
    pub fn fit_levels(
        &mut self,
        width: usize,
        height: usize,
        has_normals: bool,
        levels_max: usize,
    ) {
        let (mut w, mut h, mut edge) = (width.max(1), height.max(1), 1.0);
        let mut count = 0;
        loop {
            if self.levels.len() == count {
                self.levels.push(Level::default());
            }
            self.levels[count].fit(w, h, edge, has_normals);
            count += 1;
            if (w == 1 && h == 1) || count == levels_max {
                break;
            }
            (w, h, edge) = (w.div_ceil(2), h.div_ceil(2), edge * 2.0);
        }
        self.levels.truncate(count);
    }

    /// Whether pixels carry normals.
    pub fn has_normals(&self) -> bool {
        self.levels.first().is_some_and(|l| !l.normal.is_empty())
    }
}

/// A row of a level, to be written.
pub struct RowMut<'a> {
    /// Which row.
    pub y: usize,
    /// As in [`Level`].
    pub front: &'a mut [Vec4],
    /// As in [`Level`].
    pub tint: &'a mut [Vec4],
    /// As in [`Level`].
    pub depth: &'a mut [f32],
    /// As in [`Level`]; empty without normals.
    pub normal: &'a mut [Vec4],
}

/// Calls `work` for every row of a level, in the current rayon pool where the level is worth it.
pub fn for_each_row(level: &mut Level, work: impl Fn(RowMut<'_>) + Sync) {
    /// Pixels under which handing out costs more than it gains.
    const SERIAL_PIXELS: usize = 64 * 64;
    let (width, height) = (level.width, level.height);
    let rows = if width * height <= SERIAL_PIXELS { height } else { (height / 64).clamp(4, 16) };
    let has_normals = !level.normal.is_empty();
    let band = |first: usize, planes: Planes<'_>| {
        let Planes { mut front, mut tint, mut depth, mut normal } = planes;
        let mut y = first;
        while !front.is_empty() {
            let (f, front_rest) = std::mem::take(&mut front).split_at_mut(width);
            let (t, tint_rest) = std::mem::take(&mut tint).split_at_mut(width);
            let (d, depth_rest) = std::mem::take(&mut depth).split_at_mut(width);
            let cut = if has_normals { width } else { 0 };
            let (n, normal_rest) = std::mem::take(&mut normal).split_at_mut(cut);
            work(RowMut { y, front: f, tint: t, depth: d, normal: n });
            (front, tint, depth, normal) = (front_rest, tint_rest, depth_rest, normal_rest);
            y += 1;
        }
    };
    let planes = Planes {
        front: &mut level.front,
        tint: &mut level.tint,
        depth: &mut level.depth,
        normal: &mut level.normal,
    };
    split_bands(0, height, rows, width, planes, &band);
}

struct Planes<'a> {
    front: &'a mut [Vec4],
    tint: &'a mut [Vec4],
    depth: &'a mut [f32],
    normal: &'a mut [Vec4],
}

/// Halves the rows until a band has at most `rows` of them; halves may run on two threads.
fn split_bands(
    first: usize,
    count: usize,
    rows: usize,
    width: usize,
    planes: Planes<'_>,
    work: &(impl Fn(usize, Planes<'_>) + Sync),
) {
    if count <= rows {
        return work(first, planes);
    }
    let upper = count / 2;
    let cut = upper * width;
    let (f0, f1) = planes.front.split_at_mut(cut);
    let (t0, t1) = planes.tint.split_at_mut(cut);
    let (d0, d1) = planes.depth.split_at_mut(cut);
    let (n0, n1) = planes.normal.split_at_mut(if planes.normal.is_empty() { 0 } else { cut });
    let (a, b) = (
        Planes { front: f0, tint: t0, depth: d0, normal: n0 },
        Planes { front: f1, tint: t1, depth: d1, normal: n1 },
    );
    rayon::join(
        || split_bands(first, upper, rows, width, a, work),
        || split_bands(first + upper, count - upper, rows, width, b, work),
    );
}
