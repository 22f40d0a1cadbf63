//! Normals of eight splats at once: turned to the eye, and packed in 30 bits to be unpacked in each
//! tile.

use crate::simd::values::{EIGHT, Values, WHOLE, dot, only, towards_eye};
use fearless_simd::{Bytes, Simd, SimdMask, f32x8, u32x8};

/// Packs world normals, turned to the eye.
#[inline(always)]
pub fn packed_towards_eye<S: Simd>(
    world: [f32x8<S>; 3],
    from_eye: [f32x8<S>; 3],
    has_fronts: bool,
) -> [u32; EIGHT] {
    packed(towards_eye(world, from_eye, has_fronts))
}

/// Normals of discs: a point without a normal faces the eye.
#[inline(always)]
pub fn normals_or_to_eye<S: Simd>(
    simd: S,
    normal: [f32x8<S>; 3],
    centre: [f32x8<S>; 3],
) -> [f32x8<S>; 3] {
    let zero = simd.splat_f32x8(0.0);
    let mut facing = normal;
    let has_normal = zero.cmplt(dot(facing, facing));
    if !has_normal.all_true() {
        let to_eye = unit(centre);
        for (own, to_eye) in facing.iter_mut().zip(to_eye) {
            *own = Values::select(has_normal, *own, to_eye);
        }
    }
    facing
}

/// Normalises vectors; zero stays zero.
#[inline(always)]
pub fn unit<V: Values>(v: [V; 3]) -> [V; 3] {
    let length = dot(v, v).sqrt();
    let has_length = length.like(0.0).cmplt(length);
    let [x, y, z] = v;
    [only(has_length, x / length), only(has_length, y / length), only(has_length, z / length)]
}

/// Greatest code of a component of a normal: ten bits with a sign.
pub const CODE_MAX: f32 = 511.0;

/// Adds an offset to components of unit vectors so that their last bits are their codes.
#[inline(always)]
fn component<S: Simd>(c: f32x8<S>) -> [f32; EIGHT] {
    *(c * CODE_MAX + 512.0 + WHOLE)
}

/// Packs unit vectors, or zeros, in 30 bits each. They are quick to unpack, which is done for every
/// tile.
#[inline(always)]
fn packed<S: Simd>(n: [f32x8<S>; 3]) -> [u32; EIGHT] {
    let [x, y, z] = [component(n[0]), component(n[1]), component(n[2])];
    // No closures, which would be calls.
    let mut codes = [0; EIGHT];
    for k in 0..EIGHT {
        let [x, y, z] = [x[k].to_bits() & 0x3ff, y[k].to_bits() & 0x3ff, z[k].to_bits() & 0x3ff];
        codes[k] = x | y << 10 | z << 20;
    }
    codes
}

/// The vector of [`packed`] times [`CODE_MAX`], in all eight lanes.
#[inline(always)]
pub fn unpacked<S: Simd>(simd: S, code: u32) -> [f32x8<S>; 3] {
    let code = simd.splat_u32x8(code);
    // As the last bits of floats whose other bits are those of a whole number.
    let component =
        |bits: u32x8<S>| ((bits & 0x3ff) | WHOLE.to_bits()).bitcast::<f32x8<S>>() - (WHOLE + 512.0);
    [component(code), component(code >> 10), component(code >> 20)]
}
