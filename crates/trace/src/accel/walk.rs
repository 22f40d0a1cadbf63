//! Follows a ray through the nodes of a tree, the nearest child first. What a leaf does with the
//! ray is up to the caller, who states how far the ray still has to be followed.

use crate::accel::WIDTH;
use crate::accel::node::{EMPTY, LEAF, Node};
use crate::ray::Ray;
use fearless_simd::{Simd, SimdBase, SimdFloat, SimdMask, f32x8, mask32x8};
use glam::Vec3;

/// Entries of the stack: at each level of a tree all children but one wait. Implicit trees of up to
/// 2^31 primitives need 71; trees that need more are not used.
pub(crate) const STACK: usize = 80;
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

/// A ray on its way through the nodes of a tree. It is asked for one leaf after another. It takes
/// no closure, since one that the compiler leaves as a call would not be compiled for the wide
/// registers.
pub(crate) struct Walk<'a, S: Simd> {
    simd: S,
    nodes: &'a [Node],
    /// Inverse direction, and the origin times it.
    inverses: [f32x8<S>; 3],
    starts: [f32x8<S>; 3],
    /// Which edges of a box the ray meets first.
    sides: [usize; 3],
    /// Children that wait, the nearest on top. An entry is a distance above the number of a child:
    /// both are compared at once.
    stack: [u64; STACK],
    top: usize,
}

impl<'a, S: Simd> Walk<'a, S> {
    /// A ray at the root of a tree.
    #[inline(always)]
    pub(crate) fn new(simd: S, nodes: &'a [Node], ray: &Ray) -> Self {
        let d = ray.direction;
        let inverse = Vec3::new(inverse(d.x), inverse(d.y), inverse(d.z));
        let side = |i: f32| usize::from(i < 0.0);
        // Boxes of unused places are met by infinite directions.
        let is_fine = !nodes.is_empty() && (ray.origin + ray.direction).is_finite();
        Self {
            simd,
            nodes,
            inverses: splat3(simd, inverse),
            starts: splat3(simd, ray.origin * inverse),
            sides: [side(inverse.x), side(inverse.y), side(inverse.z)],
            stack: [0; STACK],
            top: usize::from(is_fine),
        }
    }

    /// Number of the next leaf whose box the ray meets before `limit`, which must not grow from
    /// call to call. Leaves come roughly from near to far.
    #[inline(always)]
    pub(crate) fn next(&mut self, limit: f32) -> Option<usize> {
        loop {
            let mut at = self.pop(limit)?;
            while at != EMPTY {
                if at & LEAF != 0 {
                    return Some((at & !LEAF) as usize);
                }
                at = self.descend(at, limit);
            }
        }
    }

    /// The nearest child that waits before `limit`.
    #[inline(always)]
    fn pop(&mut self, limit: f32) -> Option<u32> {
        while self.top > 0 {
            self.top -= 1;
            let entry = self.stack[self.top];
            if f32::from_bits((entry >> 32) as u32) <= limit {
                return Some(entry as u32);
            }
        }
        None
    }

    /// The nearest child of a node that the ray meets before `limit`, or [`EMPTY`]. The others
    /// wait.
    #[inline(always)]
    fn descend(&mut self, at: u32, limit: f32) -> u32 {
        let (simd, node) = (self.simd, &self.nodes[at as usize]);
        let (edges, [x, y, z]) = (&node.edges, self.sides);
        let near = [&edges[x][0], &edges[y][1], &edges[z][2]];
        let far = [&edges[1 - x][0], &edges[1 - y][1], &edges[1 - z][2]];
        let [a, b, c] = distances(simd, near, self.inverses, self.starts);
        let near = simd.max_f32x8(simd.max_f32x8(a, b), c);
        let near = simd.max_f32x8(near, simd.splat_f32x8(0.0));
        let [a, b, c] = distances(simd, far, self.inverses, self.starts);
        let far = simd.min_f32x8(simd.min_f32x8(a, b), c);
        let far = simd.min_f32x8(far, simd.splat_f32x8(limit));
        let met = bits(simd.simd_le_f32x8(near, far));
        if met & met.wrapping_sub(1) == 0 {
            // At most one child.
            let only = node.child[met.trailing_zeros() as usize % WIDTH];
            return if met == 0 { EMPTY } else { only };
        }
        let near = near.to_array();
        let entry = |k: usize| u64::from(near[k].to_bits()) << 32 | u64::from(node.child[k]);
        let first = met.trailing_zeros() as usize % WIDTH;
        let others = met & (met - 1);
        let second = others.trailing_zeros() as usize % WIDTH;
        let (a, b) = (entry(first), entry(second));
        let mut nearest = a.min(b);
        let bottom = self.top;
        self.stack[self.top] = a.max(b);
        self.top += 1;
        for k in Bits(others & (others - 1)) {
            let entry = entry(k);
            let farther = nearest.max(entry);
            nearest = nearest.min(entry);
            let mut i = self.top;
            while i > bottom && self.stack[i - 1] < farther {
                self.stack[i] = self.stack[i - 1];
                i -= 1;
            }
            self.stack[i] = farther;
            self.top += 1;
        }
        nearest as u32
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
