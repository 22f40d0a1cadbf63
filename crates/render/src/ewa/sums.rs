//! Buffers of a tile while its splats are drawn: the front, and weighted sums of the splats that
//! are not behind it, one array an attribute in each pair of rows. A pixel is stored beside the one
//! below it, so that four neighbours of two rows take one addition an attribute.

use crate::ewa::tiles::{PAIR, STRIDE, TILE};
use crate::simd::values::{EIGHT, Values, load, only};
use fearless_simd::{ExtractToken, Simd, f32x8, mask32x8};

/// Arrays of a pair of rows: the front; red, green, blue, the weight; the normal or the radius; the
/// inverse depth.
const PLANES: usize = 9;
const FRONT: usize = 0;
/// First array of the colour: red, green, blue.
pub const TINT: usize = 1;
/// Array of the sums of weights.
pub const WEIGHT: usize = 4;
/// First array of the normal; or array of the radius.
pub const SHAPE: usize = 5;
/// Array of the inverse depth.
pub const INVERSE_DEPTH: usize = 8;

/// Pairs of rows of a tile.
pub const PAIRS: usize = TILE / PAIR;
/// Two rows of a tile. An array has the two pixels of the first column, of the second column, and
/// so on.
pub type Rows = [[f32; PAIR * STRIDE]; PLANES];
/// Rows without splats.
const EMPTY: Rows = [[0.0; PAIR * STRIDE]; PLANES];

/// Buffers of a tile.
pub struct Sums(Box<[Rows; PAIRS]>);

/// Attributes of a splat that are added to pixels.
#[derive(Clone, Copy)]
pub struct Share<S: Simd> {
    /// Linear light.
    pub tint: [f32; 3],
    /// Normal; or the radius and zeros.
    pub shape: [f32x8<S>; 3],
    /// Weight at its centre.
    pub amplitude: f32,
}

impl Default for Sums {
    fn default() -> Self {
        Self(Box::new([EMPTY; PAIRS]))
    }
}

impl Sums {
    /// Removes all splats.
    pub fn clear(&mut self) {
        self.0.fill(EMPTY);
    }

    /// Row `y` of the tile.
    #[inline(always)]
    pub fn row(&self, y: usize) -> Row<'_> {
        Row { rows: &self.0[y / PAIR], is_second: y % PAIR == 1 }
    }

    /// The pairs of rows of the tile.
    #[inline(always)]
    pub fn pairs(&mut self) -> &mut [Rows; PAIRS] {
        &mut self.0
    }
}

/// Four columns of an array of two rows, from column `x` on.
#[inline(always)]
fn at(rows: &mut Rows, plane: usize, x: usize) -> &mut [f32; EIGHT] {
    // `x` is less than `TILE`; the remainder lets the compiler drop the bounds check.
    let columns = rows[plane][PAIR * (x % TILE)..].first_chunk_mut();
    columns.unwrap_or_else(|| unreachable!("tiles have columns to spare"))
}

/// Inverse depth of the moved-back front at pixels from column `x` on; 0 where there is no splat.
#[inline(always)]
pub fn front<S: Simd>(simd: S, rows: &mut Rows, x: usize) -> f32x8<S> {
    load(simd, at(rows, FRONT, x))
}

/// Moves the front of pixels that are `inside` to `inverse_depth` if that is nearer.
#[inline(always)]
pub fn advance<S: Simd>(rows: &mut Rows, x: usize, inside: mask32x8<S>, inverse_depth: f32x8<S>) {
    let own = at(rows, FRONT, x);
    let front = load(inverse_depth.token(), own);
    *own = *Values::max(front, only(inside, inverse_depth));
}

/// Adds a splat to the sums of pixels.
#[inline(always)]
pub fn add<S: Simd, const NORMALS: bool>(
    rows: &mut Rows,
    x: usize,
    weight: f32x8<S>,
    share: &Share<S>,
    inverse_depth: f32x8<S>,
) {
    let [r, g, b] = share.tint;
    let [nx, ny, nz] = share.shape;
    add_to(rows, TINT, x, weight, weight.like(r));
    add_to(rows, TINT + 1, x, weight, weight.like(g));
    add_to(rows, TINT + 2, x, weight, weight.like(b));
    add_to(rows, WEIGHT, x, weight, weight.like(1.0));
    add_to(rows, SHAPE, x, weight, nx);
    if NORMALS {
        add_to(rows, SHAPE + 1, x, weight, ny);
        add_to(rows, SHAPE + 2, x, weight, nz);
    }
    add_to(rows, INVERSE_DEPTH, x, weight, inverse_depth);
}

/// Replaces the attributes and the front of pixels that are `seen` by those of a splat.
#[inline(always)]
pub fn replace<S: Simd>(
    rows: &mut Rows,
    x: usize,
    seen: mask32x8<S>,
    share: &Share<S>,
    inverse_depth: f32x8<S>,
) {
    put(rows, FRONT, x, seen, inverse_depth);
    let [r, g, b] = share.tint;
    for (plane, value) in (TINT..).zip([r, g, b, 1.0]) {
        put(rows, plane, x, seen, inverse_depth.like(value));
    }
    for (plane, value) in (SHAPE..).zip(share.shape) {
        put(rows, plane, x, seen, value);
    }
    put(rows, INVERSE_DEPTH, x, seen, inverse_depth);
}

#[inline(always)]
fn add_to<S: Simd>(rows: &mut Rows, plane: usize, x: usize, weight: f32x8<S>, value: f32x8<S>) {
    let own = at(rows, plane, x);
    *own = *weight.mul_add(value, load(weight.token(), own));
}

#[inline(always)]
fn put<S: Simd>(rows: &mut Rows, plane: usize, x: usize, seen: mask32x8<S>, value: f32x8<S>) {
    let own = at(rows, plane, x);
    *own = *<f32x8<S> as Values>::select(seen, value, load(value.token(), own));
}

/// A row of a tile.
#[derive(Clone, Copy)]
pub struct Row<'a> {
    rows: &'a Rows,
    is_second: bool,
}

impl Row<'_> {
    /// Sums in array `plane` of eight pixels from column `x` on.
    #[inline(always)]
    pub fn sum<S: Simd>(&self, simd: S, plane: usize, x: usize) -> f32x8<S> {
        let pixels = &self.rows[plane][PAIR * (x % TILE)..];
        let (Some(left), Some(right)) = (pixels.first_chunk(), pixels[EIGHT..].first_chunk())
        else {
            unreachable!("tiles have whole runs of columns")
        };
        let (left, right) = (load(simd, left), load(simd, right));
        if self.is_second {
            simd.unzip_high_f32x8(left, right)
        } else {
            simd.unzip_low_f32x8(left, right)
        }
    }
}
