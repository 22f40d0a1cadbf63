//! The image pyramid that pull and push work on: level 0 is the picture, each level above has half as
//! many pixels a side (rounded up), down to a single one. Flat planes of four floats, as they would lie
//! in a GPU's textures; without normals, and without planes told in their place, there is no normal plane.
//!
//! Lengths in the picture (displacements, radii) are in pixels of level 0 at every level. The centre of
//! pixel (x, y) of level l then lies at ((x + 1/2) 2^l, (y + 1/2) 2^l).

use crate::lanes::{LANES, counting, four, four_values, to_centres, valid};
use crate::tangent::Lens;
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec2, Vec4};
use rayon::prelude::*;

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
    /// ellipse's minor axis over the major one ([`crate::gather`]); or the plane that is told in its place
    /// ([`crate::slant`]). Empty where there is neither.
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
        let width = self.width;
        let rows = depth.par_chunks_mut(width).with_min_len(8).enumerate();
        rows.for_each(|(y, out)| {
            let run = y * width..(y + 1) * width;
            let row = Row {
                y,
                front: &self.front[run.clone()],
                tint: &self.tint[run.clone()],
                depth: &self.depth[run.clone()],
                normal: self.normal.get(run).unwrap_or(&[]),
            };
            dispatch!(Simd::new(), _ => row.depths_at_centres(lens, self.edge_px, out));
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
    /// Planes that are not needed any more, for the next frame.
    aside: Vec<Vec4>,
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
        if !self.aside.is_empty()
            && let Some(base) = self.levels.first_mut()
        {
            base.normal = std::mem::take(&mut self.aside);
        }
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

    /// Puts the planes of the picture's level aside, which were told from depths to compare them: its pixels have
    /// no normals.
    pub fn put_planes_aside(&mut self) {
        if let Some(base) = self.levels.first_mut() {
            self.aside = std::mem::take(&mut base.normal);
        }
    }

    /// Whether pixels carry normals, or planes told in their place.
    pub fn has_normals(&self) -> bool {
        self.levels.first().is_some_and(|l| !l.normal.is_empty())
    }
}

/// A row of a level.
pub struct Row<'a> {
    /// Which row.
    pub y: usize,
    /// As in [`Level`].
    pub front: &'a [Vec4],
    /// As in [`Level`].
    pub tint: &'a [Vec4],
    /// As in [`Level`].
    pub depth: &'a [f32],
    /// As in [`Level`]; empty without normals.
    pub normal: &'a [Vec4],
}

impl Row<'_> {
    /// Writes the depths at its pixels' centres; infinite where a pixel is invalid.
    #[inline(always)]
    pub fn depths_at_centres(&self, lens: &Lens, edge_px: f32, out: &mut [f32]) {
        for (i, out) in out.chunks_mut(LANES).enumerate() {
            put(self.four_at_centres(lens, edge_px, i * LANES), out);
        }
    }

    /// The same of four pixels from `first` on, as far as the row goes.
    #[inline(always)]
    fn four_at_centres(&self, lens: &Lens, edge_px: f32, first: usize) -> [f32; LANES] {
        let run = first..self.front.len().min(first + LANES);
        let [least, _, right, down] = four(&self.front[run.clone()], INVALID);
        let is_valid = valid(least);
        if !is_valid.any() {
            return [f32::INFINITY; LANES];
        }
        let mut depth = four_values(&self.depth[run.clone()]);
        if let Some(normals) = self.normal.get(run.clone()) {
            let [nx, ny, nz, _] = four(normals, Vec4::ZERO);
            let [_, _, _, radius] = four(&self.tint[run], Vec4::ZERO);
            let centre = [
                counting((first as f32 + 0.5) * edge_px, edge_px),
                Vec4::splat((self.y as f32 + 0.5) * edge_px),
            ];
            depth *= to_centres(lens, centre, [right, down], radius, [nx, ny, nz]);
        }
        Vec4::select(is_valid, depth, Vec4::INFINITY).to_array()
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
    /// The image that rows are handed out with; else empty.
    pub image: &'a mut [f32],
}

impl RowMut<'_> {
    /// Writes the depths at the centres of eight pixels from `first` on to the image, where there is one, as far as the
    /// row goes.
    #[inline(always)]
    pub fn write_image(&mut self, lens: &Lens, edge_px: f32, first: usize) {
        let Self { y, front, tint, depth, normal, image } = self;
        let row = Row { y: *y, front, tint, depth, normal };
        for first in [first, first + LANES] {
            if let Some(out) = image.get_mut(first..) {
                put(row.four_at_centres(lens, edge_px, first), out);
            }
        }
    }

    /// Writes that there is nothing at eight pixels from `first` on.
    #[inline(always)]
    pub fn write_nothing(&mut self, first: usize) {
        if let Some(out) = self.image.get_mut(first..) {
            put([f32::INFINITY; 2 * LANES], out);
        }
    }
}

/// Writes values to where they go, as far as that goes.
#[inline(always)]
fn put<const N: usize>(values: [f32; N], out: &mut [f32]) {
    match out.first_chunk_mut() {
        Some(out) => *out = values,
        None => out.copy_from_slice(&values[..out.len()]),
    }
}

/// Calls `work` for every row of a level, in the current rayon pool where the level is worth it.
pub fn for_each_row(level: &mut Level, work: impl Fn(RowMut<'_>) + Sync) {
    for_each_band(level, &mut [], |rows| rows.for_each(&work));
}

/// Calls `work` for bands of rows of a level, together all of it, in the current rayon pool where the level is worth it.
/// Rows are handed out with those of an image of as many pixels, where it is not empty.
pub fn for_each_band(level: &mut Level, image: &mut [f32], work: impl Fn(Rows<'_>) + Sync) {
    /// Pixels under which handing out costs more than it gains.
    const SERIAL_PIXELS: usize = 64 * 64;
    let (width, height) = (level.width, level.height);
    let rows = if width * height <= SERIAL_PIXELS { height } else { (height / 64).clamp(4, 16) };
    let planes = Planes {
        front: &mut level.front,
        tint: &mut level.tint,
        depth: &mut level.depth,
        normal: &mut level.normal,
        image,
    };
    let band = |first: usize, planes: Planes<'_>| work(Rows { next: first, width, planes });
    split_bands(0, height, rows, width, planes, &band);
}

/// Rows one after another.
pub struct Rows<'a> {
    next: usize,
    width: usize,
    planes: Planes<'a>,
}

impl<'a> Iterator for Rows<'a> {
    type Item = RowMut<'a>;

    fn next(&mut self) -> Option<RowMut<'a>> {
        /// The first values of a plane.
        fn first<'a, T>(plane: &mut &'a mut [T], count: usize) -> &'a mut [T] {
            plane.split_off_mut(..count).unwrap_or_default()
        }
        let Planes { front, tint, depth, normal, image } = &mut self.planes;
        if front.is_empty() {
            return None;
        }
        let (y, width) = (self.next, self.width);
        self.next += 1;
        let or_none = |has: bool| if has { width } else { 0 };
        let (normals, images) = (or_none(!normal.is_empty()), or_none(!image.is_empty()));
        Some(RowMut {
            y,
            front: first(front, width),
            tint: first(tint, width),
            depth: first(depth, width),
            normal: first(normal, normals),
            image: first(image, images),
        })
    }
}

struct Planes<'a> {
    front: &'a mut [Vec4],
    tint: &'a mut [Vec4],
    depth: &'a mut [f32],
    normal: &'a mut [Vec4],
    image: &'a mut [f32],
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
    let (i0, i1) = planes.image.split_at_mut(if planes.image.is_empty() { 0 } else { cut });
    let (a, b) = (
        Planes { front: f0, tint: t0, depth: d0, normal: n0, image: i0 },
        Planes { front: f1, tint: t1, depth: d1, normal: n1, image: i1 },
    );
    rayon::join(
        || split_bands(first, upper, rows, width, a, work),
        || split_bands(first + upper, count - upper, rows, width, b, work),
    );
}
