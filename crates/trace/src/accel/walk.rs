//! Follows a ray through the nodes of a tree, the nearest child first. What a leaf does with the
//! ray is up to the caller, who returns how far the ray still has to be followed.

use crate::accel::WIDTH;
use crate::accel::node::{LEAF, Node};
use crate::ray::Ray;
use fearless_simd::{Simd, SimdBase, SimdFloat, SimdMask, f32x8, mask32x8};
use glam::Vec3;

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
            origin: splat3(simd, ray.origin),
            direction: splat3(simd, ray.direction),
            squared_speed: simd.splat_f32x8(ray.direction.length_squared()),
        }
    }
}

/// Loads eight values.
#[inline(always)]
pub(crate) fn load<S: Simd>(simd: S, values: &[f32; WIDTH]) -> f32x8<S> {
    f32x8::load_array_ref(simd, values)
}

/// Loads eight vectors. Arrays are written out here, not mapped: a closure that the compiler leaves
/// as a call would not be compiled for the wide registers.
#[inline(always)]
pub(crate) fn load3<S: Simd>(simd: S, values: &[[f32; WIDTH]; 3]) -> [f32x8<S>; 3] {
    [load(simd, &values[0]), load(simd, &values[1]), load(simd, &values[2])]
}

/// A vector in all lanes.
#[inline(always)]
pub(crate) fn splat3<S: Simd>(simd: S, v: Vec3) -> [f32x8<S>; 3] {
    [simd.splat_f32x8(v.x), simd.splat_f32x8(v.y), simd.splat_f32x8(v.z)]
}

/// Difference of vectors.
#[inline(always)]
pub(crate) fn sub<S: Simd>(a: [f32x8<S>; 3], b: [f32x8<S>; 3]) -> [f32x8<S>; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
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

/// Numbers of the bits that are set.
pub(crate) struct Bits(pub(crate) u32);

impl Iterator for Bits {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        if self.0 == 0 {
            return None;
        }
        let bit = self.0.trailing_zeros() as usize % WIDTH;
        self.0 &= self.0 - 1;
        Some(bit)
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
    // Boxes of unused places are met by infinite directions.
    if nodes.is_empty() || !(ray.origin + ray.direction).is_finite() {
        return;
    }
    let d = ray.direction;
    let inverse = Vec3::new(inverse(d.x), inverse(d.y), inverse(d.z));
    let [x, y, z] = [inverse.x < 0.0, inverse.y < 0.0, inverse.z < 0.0];
    let (x, y, z) = (usize::from(x), usize::from(y), usize::from(z));
    let (starts, inverses) = (splat3(simd, ray.origin * inverse), splat3(simd, inverse));
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
            let edges = &node.edges;
            let near = [&edges[x][0], &edges[y][1], &edges[z][2]];
            let far = [&edges[1 - x][0], &edges[1 - y][1], &edges[1 - z][2]];
            let [a, b, c] = distances(simd, near, inverses, starts);
            let near = simd.max_f32x8(simd.max_f32x8(a, b), c);
            let near = simd.max_f32x8(near, simd.splat_f32x8(0.0));
            let [a, b, c] = distances(simd, far, inverses, starts);
            let far = simd.min_f32x8(simd.min_f32x8(a, b), c);
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
                for k in Bits(others) {
                    let (a, b) = (nearest, entry(k));
                    nearest = a.min(b);
                    let far = a.max(b);
                    // Insertion into the entries of this node, the nearest on top.
                    let mut i = top;
                    while i > bottom && stack[i - 1] < far {
                        stack[i] = stack[i - 1];
                        i -= 1;
                    }
                    stack[i] = far;
                    top += 1;
                }
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

/// Distances at which a ray meets planes across the axes.
#[inline(always)]
fn distances<S: Simd>(
    simd: S,
    edges: [&[f32; WIDTH]; 3],
    inverses: [f32x8<S>; 3],
    starts: [f32x8<S>; 3],
) -> [f32x8<S>; 3] {
    [
        load(simd, edges[0]).mul_sub(inverses[0], starts[0]),
        load(simd, edges[1]).mul_sub(inverses[1], starts[1]),
        load(simd, edges[2]).mul_sub(inverses[2], starts[2]),
    ]
}

/// Inverse of a component of a direction.
#[inline(always)]
fn inverse(component: f32) -> f32 {
    let least = DIRECTION_MIN.copysign(component);
    1.0 / if component.abs() < DIRECTION_MIN { least } else { component }
}
