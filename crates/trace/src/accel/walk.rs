//! Follows a ray through the nodes of a tree, the nearest child first. What a leaf does with the
//! ray is up to the caller, who returns how far the ray still has to be followed.

use crate::accel::WIDTH;
use crate::accel::node::{LEAF, Node};
use crate::ray::Ray;
use fearless_simd::{Simd, SimdBase, SimdFloat, SimdMask, f32x8, mask32x8};

/// Entries of the stack for `DEPTH_MAX` levels: at each all children but one wait.
const STACK: usize = DEPTH_MAX * (WIDTH - 1) + 1;
/// Greatest number of levels of a tree: an implicit tree of 2^31 primitives has 11, trees that are
/// less balanced are not used.
pub(crate) const DEPTH_MAX: usize = 18;
/// Least component of a direction, so that its inverse times a coordinate is finite.
const DIRECTION_MIN: f32 = 1e-20;

/// A ray in all lanes, for leaves.
pub(crate) struct Lanes<S: Simd> {
    pub(crate) origin: [f32x8<S>; 3],
    pub(crate) direction: [f32x8<S>; 3],
    /// Squared length of the direction.
    pub(crate) squared_speed: f32x8<S>,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(crate) fn new(simd: S, ray: &Ray) -> Self {
        Self {
            origin: ray.origin.to_array().map(|c| simd.splat_f32x8(c)),
            direction: ray.direction.to_array().map(|c| simd.splat_f32x8(c)),
            squared_speed: simd.splat_f32x8(ray.direction.length_squared()),
        }
    }
}

/// Loads eight values.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, values: &[f32; WIDTH]) -> f32x8<S> {
    f32x8::load_array_ref(simd, values)
}

/// Dot product.
#[inline(always)]
pub(crate) fn dot<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> f32x8<S> {
    a[2].mul_add(b[2], a[1].mul_add(b[1], a[0] * b[0]))
}

/// Cross product.
#[inline(always)]
pub(crate) fn cross<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> [f32x8<S>; 3] {
    [
        a[1].mul_sub(b[2], a[2] * b[1]),
        a[2].mul_sub(b[0], a[0] * b[2]),
        a[0].mul_sub(b[1], a[1] * b[0]),
    ]
}

/// Converts a mask to bits.
#[inline(always)]
pub(crate) fn bits<S: Simd>(mask: mask32x8<S>) -> u32 {
    mask.to_bitmask() as u32
}

/// Calls `f` with the number of each bit that is set.
#[inline(always)]
pub(crate) fn each_bit(mut bits: u32, mut f: impl FnMut(usize)) {
    while bits != 0 {
        f(bits.trailing_zeros() as usize % WIDTH);
        bits &= bits - 1;
    }
}

/// Calls `visit` with the number of each leaf whose box `ray` meets before the limit, roughly from
/// near to far. `visit` gets the limit, and returns it or a lesser one; a negative one ends the
/// walk.
#[inline(always)]
pub(crate) fn walk<S: Simd>(
    simd: S,
    nodes: &[Node],
    ray: &Ray,
    mut visit: impl FnMut(usize, f32) -> f32,
) {
    if nodes.is_empty() {
        return;
    }
    let inverse = ray
        .direction
        .to_array()
        .map(|d| 1.0 / if d.abs() < DIRECTION_MIN { DIRECTION_MIN.copysign(d) } else { d });
    let origin = ray.origin.to_array();
    let sides = inverse.map(|i| usize::from(i < 0.0));
    let starts = [0, 1, 2].map(|a| simd.splat_f32x8(origin[a] * inverse[a]));
    let inverses = inverse.map(|i| simd.splat_f32x8(i));
    let mut limit = ray.reach;
    // An entry is a distance above a child: both are compared at once.
    let mut stack = [0u64; STACK];
    let (mut top, mut at) = (0, 0u32);
    loop {
        if at & LEAF != 0 {
            limit = visit((at & !LEAF) as usize, limit);
            if limit < 0.0 {
                return;
            }
        } else {
            let node = &nodes[at as usize];
            let edge = |side: usize, a: usize| {
                load(simd, &node.edges[side][a]).mul_sub(inverses[a], starts[a])
            };
            let near = max3(simd, [0, 1, 2].map(|a| edge(sides[a], a)));
            let near = simd.max_f32x8(near, simd.splat_f32x8(0.0));
            let far = min3(simd, [0, 1, 2].map(|a| edge(1 - sides[a], a)));
            let far = simd.min_f32x8(far, simd.splat_f32x8(limit));
            let met = bits(simd.simd_le_f32x8(near, far));
            if met != 0 {
                let near = near.to_array();
                let entry =
                    |k: usize| u64::from(near[k].to_bits()) << 32 | u64::from(node.child[k]);
                let first = met.trailing_zeros() as usize % WIDTH;
                let others = met & (met - 1);
                if others == 0 {
                    at = node.child[first];
                    continue;
                }
                let (bottom, mut nearest) = (top, entry(first));
                each_bit(others, |k| {
                    let (a, b) = (nearest, entry(k));
                    nearest = a.min(b);
                    let mut far = a.max(b);
                    // Insertion into the entries of this node, the nearest on top.
                    let mut i = top;
                    while i > bottom && stack[i - 1] < far {
                        stack[i] = stack[i - 1];
                        i -= 1;
                    }
                    std::mem::swap(&mut stack[i], &mut far);
                    top += 1;
                });
                at = nearest as u32;
                continue;
            }
        }
        loop {
            if top == 0 {
                return;
            }
            top -= 1;
            if f32::from_bits((stack[top] >> 32) as u32) <= limit {
                at = stack[top] as u32;
                break;
            }
        }
    }
}

#[inline(always)]
fn max3<S: Simd>(simd: S, [a, b, c]: [f32x8<S>; 3]) -> f32x8<S> {
    simd.max_f32x8(simd.max_f32x8(a, b), c)
}

#[inline(always)]
fn min3<S: Simd>(simd: S, [a, b, c]: [f32x8<S>; 3]) -> f32x8<S> {
    simd.min_f32x8(simd.min_f32x8(a, b), c)
}
