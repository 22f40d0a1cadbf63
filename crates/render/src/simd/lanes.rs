//! Four pixels at once, one register an attribute: what pull, push and related passes compute with.
//! A [`Lane`] holds one value of each pixel. The pyramid stores the four values of a pixel side by
//! side; they are transposed when they are loaded and when they are stored.

use crate::passes::tangent::{Lens, factor, turn};
use crate::picture::pyramid::{FITTED, INVALID, Level, NORMALS, RowMut};
use crate::simd::values::{Lane, Mask, Values};
use glam::{Mat4, Vec2, Vec4};

/// Pixels that are computed together.
pub const LANES: usize = 4;

/// Depths are moved by at most the radius of a disc, or by this many pixels if the radius is
/// smaller: beyond the rim of a disc its plane is not reliable.
pub(crate) const REACH_MIN_PX: f32 = 4.0;

/// Attributes of four pixels of a [`Level`].
#[derive(Clone, Copy)]
pub struct Pixels {
    /// Least depth, greatest depth, displacement; the depths are infinite for invalid pixels.
    pub front: [Lane; 4],
    /// Colour and radius.
    pub tint: [Lane; 4],
    /// Mean depth.
    pub depth: Lane,
    /// Values of the plane, as many as the kernel is compiled for: a tilt; or a normal and the
    /// minor axis over the major one.
    pub plane: [Lane; 4],
}

impl Pixels {
    /// Writes the pixels of a mask to every `step`th pixel of a row from `first` on, up to the end
    /// of the row.
    #[inline(always)]
    pub fn write<const PLANE: usize>(
        &self,
        mask: Mask,
        row: &mut RowMut<'_>,
        first: usize,
        step: usize,
    ) {
        let bits = mask.bitmask();
        let mut to = [usize::MAX; LANES];
        for (k, to) in to.iter_mut().enumerate() {
            *to = if bits >> k & 1 == 1 { first + k * step } else { usize::MAX };
        }
        self.scatter::<PLANE>(to, row);
    }

    /// Writes the pixels to every second one of eight pixels of a row from `first` on: to the left
    /// ones, or to the `right` ones. Returns false if the row has fewer pixels.
    #[inline(always)]
    pub fn write_half<const PLANE: usize>(
        &self,
        row: &mut RowMut<'_>,
        first: usize,
        right: usize,
    ) -> bool {
        let run = first..first + 2 * LANES;
        if run.end > row.front.len() {
            return false;
        }
        let put = |plane: &mut [Vec4], values: [Lane; 4]| {
            for (to, value) in plane[run.clone()].chunks_exact_mut(2).zip(turned(values)) {
                to[right & 1] = value;
            }
        };
        put(row.front, self.front);
        put(row.tint, self.tint);
        if PLANE == NORMALS {
            put(row.normal, self.plane);
        }
        for (k, to) in row.depth[run.clone()].chunks_exact_mut(2).enumerate() {
            to[right & 1] = self.depth[k];
        }
        if PLANE == FITTED {
            for (k, to) in row.tilt[run].chunks_exact_mut(2).enumerate() {
                to[right & 1] = self.tilt(k);
            }
        }
        true
    }

    /// Writes one pixel to each of these columns of a row; columns beyond the row are skipped.
    #[inline(always)]
    pub fn scatter<const PLANE: usize>(&self, to: [usize; LANES], row: &mut RowMut<'_>) {
        let (front, tint) = (turned(self.front), turned(self.tint));
        let normal = if PLANE == NORMALS { turned(self.plane) } else { [Vec4::ZERO; 4] };
        for (k, at) in to.into_iter().enumerate() {
            if at < row.front.len() {
                (row.front[at], row.tint[at]) = (front[k], tint[k]);
                row.depth[at] = self.depth[k];
                match PLANE {
                    NORMALS => row.normal[at] = normal[k],
                    FITTED => row.tilt[at] = self.tilt(k),
                    _ => {}
                }
            }
        }
    }

    #[inline(always)]
    fn tilt(&self, k: usize) -> Vec2 {
        let [right, up, ..] = self.plane;
        Vec2::new(right[k], up[k])
    }
}

/// Transposes four values of four pixels: from pixel by pixel to attribute by attribute, or back.
#[inline(always)]
pub fn turned(four: [Vec4; 4]) -> [Vec4; 4] {
    let m = Mat4::from_cols(four[0], four[1], four[2], four[3]).transpose();
    [m.x_axis, m.y_axis, m.z_axis, m.w_axis]
}

/// Loads the first four pixels of a run, attribute by attribute; `missing` beyond its end.
#[inline(always)]
pub fn four(run: &[Vec4], missing: Vec4) -> [Lane; 4] {
    match run.first_chunk::<LANES>() {
        Some(&four) => turned(four),
        None => turned(filled(run, missing)),
    }
}

/// Loads the even and the odd ones of the first eight pixels of a run, attribute by attribute;
/// `missing` beyond its end.
#[inline(always)]
pub fn halves(run: &[Vec4], missing: Vec4) -> [[Lane; 4]; 2] {
    let of = |e: &[Vec4; 2 * LANES]| [[e[0], e[2], e[4], e[6]], [e[1], e[3], e[5], e[7]]];
    let [even, odd] = match run.first_chunk() {
        Some(eight) => of(eight),
        None => of(&filled(run, missing)),
    };
    [turned(even), turned(odd)]
}

/// [`halves`] for single values; zero beyond the end of the run.
#[inline(always)]
pub fn halves_of_values(run: &[f32]) -> [Lane; 2] {
    let of = |e: &[f32; 2 * LANES]| {
        [Vec4::new(e[0], e[2], e[4], e[6]), Vec4::new(e[1], e[3], e[5], e[7])]
    };
    match run.first_chunk() {
        Some(eight) => of(eight),
        None => of(&filled(run, 0.0)),
    }
}

/// Loads the first four values of a run; zero beyond its end.
#[inline(always)]
pub fn four_values(run: &[f32]) -> Lane {
    Vec4::from_array(match run.first_chunk() {
        Some(four) => *four,
        None => filled(run, 0.0),
    })
}

/// Loads the planes of the first four pixels of a run.
#[inline(always)]
pub fn four_planes<const PLANE: usize>(normal: &[Vec4], tilt: &[Vec2]) -> [Lane; 4] {
    match PLANE {
        NORMALS => four(normal, Vec4::ZERO),
        FITTED => {
            let [a, b, c, d] = match tilt.first_chunk() {
                Some(four) => *four,
                None => filled(tilt, Vec2::ZERO),
            };
            let zero = Vec4::ZERO;
            [Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y), zero, zero]
        }
        _ => [Vec4::ZERO; 4],
    }
}

/// [`halves`] for planes.
#[inline(always)]
pub fn halves_of_planes<const PLANE: usize>(normal: &[Vec4], tilt: &[Vec2]) -> [[Lane; 4]; 2] {
    match PLANE {
        NORMALS => halves(normal, Vec4::ZERO),
        FITTED => {
            let [a, b, c, d, e, f, g, h] = match tilt.first_chunk() {
                Some(eight) => *eight,
                None => filled(tilt, Vec2::ZERO),
            };
            let of = |a: Vec2, b: Vec2, c: Vec2, d: Vec2| {
                let (right, up) = (Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y));
                [right, up, Vec4::ZERO, Vec4::ZERO]
            };
            [of(a, c, e, g), of(b, d, f, h)]
        }
        _ => [[Vec4::ZERO; 4]; 2],
    }
}

/// Factor of depths that are moved along planes from `from` by `by` pixels; one without planes.
/// `facing` is q of a normal at `from` ([`crate::passes::tangent`]); q of a tilt is -1.
#[inline(always)]
pub fn moved<const PLANE: usize, V: Values>(tilt: [V; 2], facing: V, by: [V; 2]) -> V {
    match PLANE {
        NORMALS => factor(facing, turn(tilt, by)),
        FITTED => factor(facing.like(-1.0), turn(tilt, by)),
        _ => facing.like(1.0),
    }
}

/// Copies a run that is shorter than `N` and appends `missing`.
#[inline(never)]
fn filled<T: Copy, const N: usize>(run: &[T], missing: T) -> [T; N] {
    let mut all = [missing; N];
    let count = run.len().min(N);
    all[..count].copy_from_slice(&run[..count]);
    all
}

/// `value` in the lanes of a mask, zero in the others.
#[inline(always)]
pub fn only(mask: Mask, value: Lane) -> Lane {
    Vec4::select(mask, value, Vec4::ZERO)
}

/// Mask of the valid pixels, from their least depths.
#[inline(always)]
pub fn valid(least: Lane) -> Mask {
    least.cmplt(Vec4::INFINITY)
}

/// Whether none of the pixels with these values of [`Level::front`] is valid.
#[inline(always)]
pub fn is_empty(fronts: &[Vec4]) -> bool {
    let least = fronts.iter().fold(Vec4::INFINITY, |least, front| least.min(*front));
    least.x == f32::INFINITY
}

/// Four numbers from `first` on, `step` apart.
#[inline(always)]
pub fn counting(first: f32, step: f32) -> Lane {
    Vec4::new(0.0, 1.0, 2.0, 3.0) * step + first
}

/// Factor from depths at the centres of ellipses to depths at the centres of pixels, which are
/// given. `displaced`, `radius` and `plane` are those of the ellipses.
#[inline(always)]
pub fn to_centres<const PLANE: usize>(
    lens: &Lens,
    centre: [Lane; 2],
    displaced: [Lane; 2],
    radius: Lane,
    plane: [Lane; 4],
) -> Lane {
    let [right, up, back, _] = plane;
    let facing = match PLANE {
        NORMALS => {
            lens.facing([right, up, back], [centre[0] - displaced[0], centre[1] - displaced[1]])
        }
        _ => Vec4::ZERO,
    };
    let moved = moved::<PLANE, _>([right, up], facing, displaced);
    let reach = radius.max(Vec4::splat(REACH_MIN_PX)) / lens.focal_px;
    moved.max(1.0 - reach).min(1.0 + reach)
}

/// A row of a level, attribute by attribute, with an invalid pixel before its first and after its
/// last one. Invalid pixels have infinite depths; their other attributes are undefined.
#[derive(Clone, Debug, Default)]
pub struct Line {
    /// Runs of four pixels, each with the pixel before and after it.
    blocks: Vec<Run>,
}

/// [`LANES`] pixels of a line with the pixel before and the pixel after them, one array an
/// attribute.
pub type Run = [[f32; LANES + 2]; PLANES];

const PLANES: usize = 14;

impl Line {
    /// First array of least depth, greatest depth and displacement.
    pub const FRONT: usize = 0;
    /// First array of colour and radius.
    pub const TINT: usize = 4;
    /// Array of the mean depth.
    pub const DEPTH: usize = 8;
    /// First array of the tilt; or of the normal, the minor axis over the major one, and
    /// [`Line::FACING`].
    pub const PLANE: usize = 9;
    /// Array of q of a normal at the centre of the ellipse ([`crate::passes::tangent`]).
    pub const FACING: usize = 13;

    /// Loads row `y` of a level; without a row, all pixels are invalid.
    #[inline(always)]
    pub fn take<const PLANE: usize>(&mut self, lens: &Lens, level: &Level, y: Option<usize>) {
        let mut nothing = [[0.0; LANES + 2]; PLANES];
        nothing[Self::FRONT] = [f32::INFINITY; LANES + 2];
        self.blocks.resize(level.width.div_ceil(LANES), nothing);
        let Some(y) = y else { return self.blocks.fill(nothing) };
        let edge_px = level.edge_px;
        let row = y * level.width..(y + 1) * level.width;
        let normals = level.normal.get(row.clone()).unwrap_or_default();
        let tilts = level.tilt.get(row.clone()).unwrap_or_default();
        let fronts = level.front[row.clone()].chunks(LANES);
        let tints = level.tint[row.clone()].chunks(LANES);
        let depths = level.depth[row].chunks(LANES);
        for (i, ((fronts, tints), depths)) in fronts.zip(tints).zip(depths).enumerate() {
            if is_empty(fronts) {
                self.put(Self::FRONT, i, [Vec4::INFINITY]);
                continue;
            }
            let front = four(fronts, INVALID);
            self.put(Self::FRONT, i, front);
            self.put(Self::TINT, i, four(tints, Vec4::ZERO));
            self.put(Self::DEPTH, i, [four_values(depths)]);
            let run = i * LANES..i * LANES + fronts.len();
            let (normals, tilts) = (normals.get(run.clone()), tilts.get(run));
            let plane =
                four_planes::<PLANE>(normals.unwrap_or_default(), tilts.unwrap_or_default());
            let [right, up, back, share] = plane;
            if PLANE == FITTED {
                self.put(Self::PLANE, i, [right, up]);
            }
            if PLANE == NORMALS {
                let from = [
                    counting(((i * LANES) as f32 + 0.5) * edge_px, edge_px) - front[2],
                    Vec4::splat((y as f32 + 0.5) * edge_px) - front[3],
                ];
                let facing = lens.facing([right, up, back], from);
                self.put(Self::PLANE, i, [right, up, back, share, facing]);
            }
        }
    }

    #[inline(always)]
    fn put<const N: usize>(&mut self, plane: usize, i: usize, values: [Lane; N]) {
        if let Some(before) = i.checked_sub(1) {
            let before = &mut self.blocks[before];
            (0..N).for_each(|k| before[plane + k][LANES + 1] = values[k].x);
        }
        let block = &mut self.blocks[i];
        (0..N).for_each(|k| values[k].write_to_slice(&mut block[plane + k][1..]));
        if let Some(after) = self.blocks.get_mut(i + 1) {
            (0..N).for_each(|k| after[plane + k][0] = values[k].w);
        }
    }

    /// Iterates over the runs of the line.
    #[inline(always)]
    pub fn runs(&self) -> impl Iterator<Item = &Run> {
        self.blocks.iter()
    }
}

/// Whether a run has a valid pixel.
#[inline(always)]
pub fn has_pixels(run: &Run) -> bool {
    let least = &run[Line::FRONT];
    valid(Vec4::from_slice(least).min(Vec4::from_slice(&least[2..]))).any()
}
