//! What a tile holds while its splats are drawn: the front, and sums over what is not behind it, plane after plane in each
//! row, so that four neighbouring pixels are one addition a plane.

use super::cover::STRIDE;
use super::tiles::{LANES, TILE};
use crate::lanes::{Lane, Mask, only};
use crate::values::EIGHT;
use fearless_simd::{Simd, f32x8};
use glam::Vec4;

/// Planes of a row: the front; red, green, blue, the weight; the normal (or the radius), the inverse depth.
const PLANES: usize = 9;
const FRONT: usize = 0;
/// Red, green, blue.
pub const TINT: usize = 1;
/// The sum of weights.
pub const WEIGHT: usize = 4;
/// The normal, or the radius alone.
pub const SHAPE: usize = 5;
/// Inverse depth.
pub const INVERSE_DEPTH: usize = 8;

/// A row of a tile.
pub type Row = [[f32; STRIDE]; PLANES];

/// A tile's sums.
pub struct Sums(Box<[Row; TILE]>);

/// What a splat adds: colour, and normal or radius.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// Linear light.
    tint: [Lane; 3],
    /// Normal, or the radius and zeros.
    shape: [Lane; 3],
}

impl Share {
    /// Of a splat.
    #[inline(always)]
    pub fn new(tint: [f32; 3], shape: [f32; 3]) -> Self {
        Self { tint: tint.map(Vec4::splat), shape: shape.map(Vec4::splat) }
    }
}

impl Default for Sums {
    fn default() -> Self {
        Self(Box::new([[[0.0; STRIDE]; PLANES]; TILE]))
    }
}

impl Sums {
    /// Empties the tile.
    pub fn clear(&mut self) {
        self.0.fill([[0.0; STRIDE]; PLANES]);
    }

    /// One of its rows.
    #[inline(always)]
    pub fn row(&self, y: usize) -> &Row {
        &self.0[y]
    }

    /// Its rows.
    #[inline(always)]
    pub fn rows(&mut self) -> &mut [Row; TILE] {
        &mut self.0
    }
}

#[inline(always)]
fn at(row: &Row, plane: usize, x: usize) -> Lane {
    Vec4::from_slice(&row[plane][x..x + LANES])
}

#[inline(always)]
fn put(row: &mut Row, plane: usize, x: usize, value: Lane) {
    value.write_to_slice(&mut row[plane][x..x + LANES]);
}

/// The front's inverse depth at pixels from `x` on, moved back; 0 where nothing is.
#[inline(always)]
pub fn front(row: &Row, x: usize) -> Lane {
    at(row, FRONT, x)
}

/// Moves the front of some pixels to where it is nearer.
#[inline(always)]
pub fn advance(row: &mut Row, x: usize, inside: Mask, inverse_depth: Lane) {
    let nearest = front(row, x).max(only(inside, inverse_depth));
    put(row, FRONT, x, nearest);
}

/// Adds to the sums.
#[inline(always)]
pub fn add<const NORMALS: bool>(
    row: &mut Row,
    x: usize,
    weight: Lane,
    share: &Share,
    inverse_depth: Lane,
) {
    let [r, g, b] = share.tint;
    let [nx, ny, nz] = share.shape;
    let mut add = |plane: usize, value: Lane| {
        let sum = at(row, plane, x) + value;
        put(row, plane, x, sum);
    };
    add(1, weight * r);
    add(2, weight * g);
    add(3, weight * b);
    add(WEIGHT, weight);
    add(5, weight * nx);
    if NORMALS {
        add(6, weight * ny);
        add(7, weight * nz);
    }
    add(INVERSE_DEPTH, weight * inverse_depth);
}

/// Puts a splat in the place of what was there, and of the front.
#[inline(always)]
pub fn replace(row: &mut Row, x: usize, seen: Mask, share: &Share, inverse_depth: Lane) {
    let ([r, g, b], [nx, ny, nz]) = (share.tint, share.shape);
    let mut replace = |plane: usize, value: Lane| {
        let value = Vec4::select(seen, value, at(row, plane, x));
        put(row, plane, x, value);
    };
    replace(FRONT, inverse_depth);
    let values = [r, g, b, Vec4::ONE, nx, ny, nz];
    values.into_iter().zip(1..).for_each(|(value, plane)| replace(plane, value));
    replace(INVERSE_DEPTH, inverse_depth);
}

/// A sum of eight pixels from `x` on.
#[inline(always)]
pub fn sum<S: Simd>(simd: S, row: &Row, plane: usize, x: usize) -> f32x8<S> {
    simd.load_array_ref_f32x8(row[plane][x..].first_chunk().unwrap_or(&[0.0; EIGHT]))
}
