//! The image pyramid that pull and push work on: level 0 is the picture, each level above has half as
//! many pixels a side (rounded up), down to a single one. Flat planes of up to four floats, as they would lie
//! in a GPU's textures; those that pixels do not carry ([`Planes`]) are empty.
//!
//! Lengths in the picture (displacements, radii) are in pixels of level 0 at every level. The centre of
//! pixel (x, y) of level l then lies at ((x + 1/2) 2^l, (y + 1/2) 2^l).

use crate::passes::tangent::Lens;
use crate::simd::lanes::{
    FITTED, FLAT, LANES, NORMALS, counting, four, four_planes, four_values, to_centres, valid,
};
use fearless_simd::{Level as Simd, dispatch};
use glam::{Vec2, Vec4};
use rayon::prelude::*;

/// The planes that pixels carry through the pyramid: those of their discs, along which depths are moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Planes {
    /// None: depths are compared as they are.
    #[default]
    None,
    /// Those told from depths ([`crate::passes::fit_planes`]).
    Fitted,
    /// Those of the points' normals.
    Normals,
}

impl Planes {
    /// Values that each takes.
    pub fn values(self) -> usize {
        match self {
            Self::None => FLAT,
            Self::Fitted => FITTED,
            Self::Normals => NORMALS,
        }
    }
}

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
    /// at the ellipse's centre ([`crate::passes::tangent`]).
    /// A pixel whose least depth is infinite is invalid, and its other planes mean nothing.
    pub front: Vec<Vec4>,
    /// Red, green, blue in linear light, and the radius in pixels of level 0.
    pub tint: Vec<Vec4>,
    /// Mean depth: that of the surface, where `front` has the interval for tests.
    pub depth: Vec<f32>,
    /// Normal in view space (right, up, back), not of unit length once averaged, and in w its
    /// ellipse's minor axis over the major one ([`crate::passes::gather`]). Empty where pixels have none.
    pub normal: Vec<Vec4>,
    /// Of a plane told from depths, what its depth grows by a pixel right, and a pixel up with the sign turned, over the
    /// depth at the ellipse's centre: its normal's first two parts where that is as long as q is -1 ([`crate::passes::tangent`]).
    /// Empty where none are told.
    pub tilt: Vec<Vec2>,
}

/// `front` of an invalid pixel.
pub const INVALID: Vec4 = Vec4::new(f32::INFINITY, f32::INFINITY, 0.0, 0.0);

impl Level {
    fn fit(&mut self, width: usize, height: usize, edge_px: f32, planes: Planes) {
        (self.width, self.height, self.edge_px) = (width, height, edge_px);
        let pixels = width * height;
        self.front.resize(pixels, INVALID);
        self.tint.resize(pixels, Vec4::ZERO);
        self.depth.resize(pixels, 0.0);
        let where_carried = |of: Planes| if planes == of { pixels } else { 0 };
        self.normal.resize(where_carried(Planes::Normals), Vec4::ZERO);
        self.tilt.resize(where_carried(Planes::Fitted), Vec2::ZERO);
    }

    /// Whether a pixel holds a surface.
    pub fn is_valid(&self, pixel: usize) -> bool {
        self.front[pixel].x < f32::INFINITY
    }

    /// The planes that its pixels carry.
    pub fn planes(&self) -> Planes {
        match (self.normal.is_empty(), self.tilt.is_empty()) {
            (false, _) => Planes::Normals,
            (true, false) => Planes::Fitted,
            (true, true) => Planes::None,
        }
    }

    /// Writes the depths at its pixels' centres; infinite where a pixel is invalid.
    pub fn depth_image(&self, lens: &Lens, depth: &mut [f32]) {
        match self.planes() {
            Planes::None => self.depth_image_of::<FLAT>(lens, depth),
            Planes::Fitted => self.depth_image_of::<FITTED>(lens, depth),
            Planes::Normals => self.depth_image_of::<NORMALS>(lens, depth),
        }
    }

    fn depth_image_of<const PLANE: usize>(&self, lens: &Lens, depth: &mut [f32]) {
        let width = self.width;
        let rows = depth.par_chunks_mut(width).with_min_len(8).enumerate();
        rows.for_each(|(y, out)| {
            let run = y * width..(y + 1) * width;
            let row = Row {
                y,
                front: &self.front[run.clone()],
                tint: &self.tint[run.clone()],
                depth: &self.depth[run.clone()],
                normal: self.normal.get(run.clone()).unwrap_or(&[]),
                tilt: self.tilt.get(run).unwrap_or(&[]),
            };
            dispatch!(Simd::new(), _ => row.depths_at_centres::<PLANE>(lens, self.edge_px, out));
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
    pub fn fit(&mut self, width: usize, height: usize, planes: Planes) {
        self.fit_levels(width, height, planes, usize::MAX);
    }

    /// The same, of so many levels at most.
    pub fn fit_levels(&mut self, width: usize, height: usize, planes: Planes, levels_max: usize) {
        let (mut w, mut h, mut edge) = (width.max(1), height.max(1), 1.0);
        let mut count = 0;
        loop {
            if self.levels.len() == count {
                self.levels.push(Level::default());
            }
            self.levels[count].fit(w, h, edge, planes);
            count += 1;
            if (w == 1 && h == 1) || count == levels_max {
                break;
            }
            (w, h, edge) = (w.div_ceil(2), h.div_ceil(2), edge * 2.0);
        }
        self.levels.truncate(count);
    }

    /// The planes that pixels carry.
    pub fn planes(&self) -> Planes {
        self.levels.first().map_or(Planes::None, Level::planes)
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
    /// As in [`Level`].
    pub normal: &'a [Vec4],
    /// As in [`Level`].
    pub tilt: &'a [Vec2],
}

impl Row<'_> {
    /// Writes the depths at its pixels' centres; infinite where a pixel is invalid.
    #[inline(always)]
    pub fn depths_at_centres<const PLANE: usize>(
        &self,
        lens: &Lens,
        edge_px: f32,
        out: &mut [f32],
    ) {
        for (i, out) in out.chunks_mut(LANES).enumerate() {
            put(self.four_at_centres::<PLANE>(lens, edge_px, i * LANES), out);
        }
    }

    /// The same of four pixels from `first` on, as far as the row goes.
    #[inline(always)]
    fn four_at_centres<const PLANE: usize>(
        &self,
        lens: &Lens,
        edge_px: f32,
        first: usize,
    ) -> [f32; LANES] {
        let run = first..self.front.len().min(first + LANES);
        let [least, _, right, down] = four(&self.front[run.clone()], INVALID);
        let is_valid = valid(least);
        if !is_valid.any() {
            return [f32::INFINITY; LANES];
        }
        let mut depth = four_values(&self.depth[run.clone()]);
        if PLANE != FLAT {
            let normals = self.normal.get(run.clone()).unwrap_or_default();
            let tilts = self.tilt.get(run.clone()).unwrap_or_default();
            let plane = four_planes::<PLANE>(normals, tilts);
            let [_, _, _, radius] = four(&self.tint[run], Vec4::ZERO);
            let centre = [
                counting((first as f32 + 0.5) * edge_px, edge_px),
                Vec4::splat((self.y as f32 + 0.5) * edge_px),
            ];
            depth *= to_centres::<PLANE>(lens, centre, [right, down], radius, plane);
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
    /// As in [`Level`].
    pub normal: &'a mut [Vec4],
    /// As in [`Level`].
    pub tilt: &'a mut [Vec2],
    /// The image that rows are handed out with; else empty.
    pub image: &'a mut [f32],
}

impl RowMut<'_> {
    /// Writes the depths at the centres of eight pixels from `first` on to the image, where there is one, as far as the
    /// row goes.
    #[inline(always)]
    pub fn write_image<const PLANE: usize>(&mut self, lens: &Lens, edge_px: f32, first: usize) {
        let Self { y, front, tint, depth, normal, tilt, image } = self;
        let row = Row { y: *y, front, tint, depth, normal, tilt };
        for first in [first, first + LANES] {
            if let Some(out) = image.get_mut(first..) {
                put(row.four_at_centres::<PLANE>(lens, edge_px, first), out);
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
    let all = Slices {
        front: &mut level.front,
        tint: &mut level.tint,
        depth: &mut level.depth,
        normal: &mut level.normal,
        tilt: &mut level.tilt,
        image,
    };
    let band = |first: usize, slices: Slices<'_>| work(Rows { next: first, width, slices });
    split_bands(0, height, rows, width, all, &band);
}

/// Rows one after another.
pub struct Rows<'a> {
    next: usize,
    width: usize,
    slices: Slices<'a>,
}

impl<'a> Iterator for Rows<'a> {
    type Item = RowMut<'a>;

    fn next(&mut self) -> Option<RowMut<'a>> {
        /// The first values of a plane.
        fn first<'a, T>(plane: &mut &'a mut [T], count: usize) -> &'a mut [T] {
            plane.split_off_mut(..count).unwrap_or_default()
        }
        let Slices { front, tint, depth, normal, tilt, image } = &mut self.slices;
        if front.is_empty() {
            return None;
        }
        let (y, width) = (self.next, self.width);
        self.next += 1;
        let or_none = |has: bool| if has { width } else { 0 };
        let (normals, tilts) = (or_none(!normal.is_empty()), or_none(!tilt.is_empty()));
        let images = or_none(!image.is_empty());
        Some(RowMut {
            y,
            front: first(front, width),
            tint: first(tint, width),
            depth: first(depth, width),
            normal: first(normal, normals),
            tilt: first(tilt, tilts),
            image: first(image, images),
        })
    }
}

struct Slices<'a> {
    front: &'a mut [Vec4],
    tint: &'a mut [Vec4],
    depth: &'a mut [f32],
    normal: &'a mut [Vec4],
    tilt: &'a mut [Vec2],
    image: &'a mut [f32],
}

impl Slices<'_> {
    /// The first `cut` pixels of each, and the others.
    fn split(self, cut: usize) -> [Self; 2] {
        /// Of one; of none, nothing.
        fn parts<T>(plane: &mut [T], cut: usize) -> (&mut [T], &mut [T]) {
            plane.split_at_mut(if plane.is_empty() { 0 } else { cut })
        }
        let (f0, f1) = parts(self.front, cut);
        let (t0, t1) = parts(self.tint, cut);
        let (d0, d1) = parts(self.depth, cut);
        let (n0, n1) = parts(self.normal, cut);
        let (s0, s1) = parts(self.tilt, cut);
        let (i0, i1) = parts(self.image, cut);
        [
            Self { front: f0, tint: t0, depth: d0, normal: n0, tilt: s0, image: i0 },
            Self { front: f1, tint: t1, depth: d1, normal: n1, tilt: s1, image: i1 },
        ]
    }
}

/// Halves the rows until a band has at most `rows` of them; halves may run on two threads.
fn split_bands(
    first: usize,
    count: usize,
    rows: usize,
    width: usize,
    slices: Slices<'_>,
    work: &(impl Fn(usize, Slices<'_>) + Sync),
) {
    if count <= rows {
        return work(first, slices);
    }
    let upper = count / 2;
    let [a, b] = slices.split(upper * width);
    rayon::join(
        || split_bands(first, upper, rows, width, a, work),
        || split_bands(first + upper, count - upper, rows, width, b, work),
    );
}
