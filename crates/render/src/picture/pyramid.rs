//! The image pyramid that pull and push work on (`marroquim2007`, section 3.2): level 0 is the
//! picture, each level above has half as many pixels a side (rounded up), down to a single one. A
//! level is a set of flat arrays of up to four floats a pixel, laid out as in a GPU's textures;
//! arrays of attributes that pixels do not carry ([`Planes`]) are empty.
//!
//! Lengths in the picture (displacements, radii) are in pixels of level 0 at every level. The
//! centre of pixel (x, y) of level l then lies at ((x + 1/2) 2^l, (y + 1/2) 2^l).

use crate::passes::tangent::Lens;
use glam::{Vec2, Vec4};

/// Number of values of a pixel's plane ([`Planes::values`]), for which kernels are compiled: pixels
/// have no plane.
pub const FLAT: usize = 0;
/// Number of values of a plane that is fitted to depths: its tilt.
pub const FITTED: usize = 2;
/// Number of values of a normal, with the aspect of its ellipse.
pub const NORMALS: usize = 4;

/// Which planes pixels carry through the pyramid. A pixel's depth is moved along the plane of its
/// disc.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Planes {
    /// No planes: depths are compared as they are.
    #[default]
    None,
    /// Planes fitted to depths ([`crate::passes::fit_planes`]).
    Fitted,
    /// The planes of the points' normals.
    Normals,
}

impl Planes {
    /// Number of values of a pixel's plane.
    pub fn values(self) -> usize {
        match self {
            Self::None => FLAT,
            Self::Fitted => FITTED,
            Self::Normals => NORMALS,
        }
    }
}

/// One level of the pyramid.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Side of its pixels, in pixels of level 0.
    pub edge_px: f32,
    /// Least depth, greatest depth, and the displacement x, y from the centre of the ellipse to
    /// that of the pixel. Depths hold at the centre of the ellipse ([`crate::passes::tangent`]). A
    /// pixel whose least depth is infinite is invalid, and its other attributes mean nothing.
    pub front: Vec<Vec4>,
    /// Red, green, blue in linear light, and the radius in pixels of level 0.
    pub tint: Vec<Vec4>,
    /// Mean depth: the depth of the surface, while `front` has the interval that is compared.
    pub depth: Vec<f32>,
    /// Normal in view space (right, up, back), not of unit length once averaged, and in w the minor
    /// axis of its ellipse over the major one ([`crate::passes::gather`]). Empty where pixels have
    /// no normals.
    pub normal: Vec<Vec4>,
    /// Tilt of a plane fitted to depths: growth of its depth per pixel to the right, and per pixel
    /// upwards with the sign changed, over the depth at the ellipse's centre. These are the first
    /// two components of its normal, scaled so that q is -1 ([`crate::passes::tangent`]). Empty
    /// where no planes are fitted.
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

    /// Whether `pixel` holds a surface.
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

    /// Centre of a pixel, in pixels of level 0.
    pub fn centre(&self, x: usize, y: usize) -> Vec2 {
        Vec2::new(x as f32 + 0.5, y as f32 + 0.5) * self.edge_px
    }
}

/// All levels, the picture first. Keeps its memory from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// The levels.
    pub levels: Vec<Level>,
    /// The projection of the picture.
    pub lens: Lens,
}

impl Pyramid {
    /// Resizes the levels for a picture; the contents of pixels are undefined.
    pub fn fit(&mut self, width: usize, height: usize, planes: Planes) {
        self.fit_levels(width, height, planes, usize::MAX);
    }

    /// Like [`Pyramid::fit`], with `levels_max` levels at most.
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

/// A row of a level, to be read.
pub struct Row<'a> {
    /// Number of the row.
    pub y: usize,
    /// Row of [`Level::front`].
    pub front: &'a [Vec4],
    /// Row of [`Level::tint`].
    pub tint: &'a [Vec4],
    /// Row of [`Level::depth`].
    pub depth: &'a [f32],
    /// Row of [`Level::normal`].
    pub normal: &'a [Vec4],
    /// Row of [`Level::tilt`].
    pub tilt: &'a [Vec2],
}

/// A row of a level, to be written.
pub struct RowMut<'a> {
    /// Number of the row.
    pub y: usize,
    /// Row of [`Level::front`].
    pub front: &'a mut [Vec4],
    /// Row of [`Level::tint`].
    pub tint: &'a mut [Vec4],
    /// Row of [`Level::depth`].
    pub depth: &'a mut [f32],
    /// Row of [`Level::normal`].
    pub normal: &'a mut [Vec4],
    /// Row of [`Level::tilt`].
    pub tilt: &'a mut [Vec2],
    /// Row of the image that is written together with the level; empty without one.
    pub image: &'a mut [f32],
}

/// Calls `work` for every row of a level, in the current rayon pool if the level is large enough.
pub fn for_each_row(level: &mut Level, work: impl Fn(RowMut<'_>) + Sync) {
    for_each_band(level, &mut [], |rows| rows.for_each(&work));
}

/// Calls `work` for bands of rows that cover a level, in the current rayon pool if the level is
/// large enough. `image` has as many pixels as the level and is split in the same way, or is empty.
pub fn for_each_band(level: &mut Level, image: &mut [f32], work: impl Fn(Rows<'_>) + Sync) {
    /// With fewer pixels, one thread is faster than several.
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

/// Iterator over the rows of a band.
pub struct Rows<'a> {
    next: usize,
    width: usize,
    slices: Slices<'a>,
}

impl<'a> Iterator for Rows<'a> {
    type Item = RowMut<'a>;

    fn next(&mut self) -> Option<RowMut<'a>> {
        /// Splits the first `count` values off.
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

/// Attributes of neighbouring rows of a level.
struct Slices<'a> {
    front: &'a mut [Vec4],
    tint: &'a mut [Vec4],
    depth: &'a mut [f32],
    normal: &'a mut [Vec4],
    tilt: &'a mut [Vec2],
    image: &'a mut [f32],
}

impl Slices<'_> {
    /// Splits every attribute after the first `cut` pixels.
    fn split(self, cut: usize) -> [Self; 2] {
        /// Splits one attribute, which may be empty.
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

/// Halves the rows until a band has at most `rows` rows; both halves may run in parallel.
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
