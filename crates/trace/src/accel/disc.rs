//! Discs, the shape of splats, and leaves of eight.

use crate::accel::WIDTH;
use crate::accel::bounds::Bounds;
use crate::accel::tree::{Leaf, Primitive};
use crate::accel::walk::{Lanes, dot, load, load3, sub};
use bytemuck::{Pod, Zeroable};
use fearless_simd::{Select, Simd, SimdFloat, f32x8, mask32x8};
use glam::Vec3;

/// A disc; without a normal it faces each ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disc {
    pub(crate) centre: Vec3,
    /// Unit length, or zero.
    pub(crate) normal: Vec3,
    pub(crate) radius: f32,
    pub(crate) tint: Tint,
}

/// Albedo of a disc in 1 / 65535, and the number of its emitter plus one, zero for none.
pub type Tint = [u16; 4];

/// Eight discs, axis by axis.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C, align(32))]
pub struct DiscLeaf {
    /// Centres.
    pub centre: [[f32; WIDTH]; 3],
    /// Unit normals; zero for discs without one.
    pub normal: [[f32; WIDTH]; 3],
    /// Radii; negative for a disc without a normal, zero for an unused place.
    pub radius: [f32; WIDTH],
    /// Albedo and emitters.
    pub tint: [Tint; WIDTH],
}

/// Where a ray meets eight discs.
pub(crate) struct DiscsMet<S: Simd> {
    /// Distances.
    pub(crate) distance: f32x8<S>,
    /// Squared distance from the centre over the squared radius.
    pub(crate) off: f32x8<S>,
    /// Discs that are met before the limit.
    pub(crate) is_met: mask32x8<S>,
    /// Discs whose normal does not point away from the origin of the ray, or that have none.
    pub(crate) is_front: mask32x8<S>,
}

impl Primitive for Disc {
    type Leaf = DiscLeaf;

    #[inline(always)]
    fn bounds(&self) -> Bounds {
        let n = self.normal;
        let half = (Vec3::ONE - n * n).max(Vec3::ZERO).map(f32::sqrt) * self.radius;
        Bounds { min: self.centre - half, max: self.centre + half }
    }

    #[inline(always)]
    fn centre(&self) -> Vec3 {
        self.centre
    }
}

impl Leaf for DiscLeaf {
    type Primitive = Disc;

    #[inline(always)]
    fn set(&mut self, k: usize, disc: &Disc) {
        for axis in 0..3 {
            self.centre[axis][k] = disc.centre[axis];
            self.normal[axis][k] = disc.normal[axis];
        }
        self.radius[k] = if disc.normal == Vec3::ZERO { -disc.radius } else { disc.radius };
        self.tint[k] = disc.tint;
    }

    #[inline(always)]
    fn bounds(&self, count: usize) -> Bounds {
        let mut all = Bounds::EMPTY;
        for axis in 0..3 {
            let (mut least, mut greatest) = ([0.0; WIDTH], [0.0; WIDTH]);
            for k in 0..WIDTH {
                let n = self.normal[axis][k];
                let half = (1.0 - n * n).max(0.0).sqrt() * self.radius[k].abs();
                least[k] = self.centre[axis][k] - half;
                greatest[k] = self.centre[axis][k] + half;
            }
            for k in 0..count.min(WIDTH) {
                all.min[axis] = all.min[axis].min(least[k]);
                all.max[axis] = all.max[axis].max(greatest[k]);
            }
        }
        all
    }

    #[inline(always)]
    fn get(&self, k: usize) -> Disc {
        let centre = Vec3::new(self.centre[0][k], self.centre[1][k], self.centre[2][k]);
        Disc { centre, normal: self.normal_of(k), radius: self.radius[k].abs(), tint: self.tint[k] }
    }
}

impl DiscLeaf {
    /// Normal of disc `k`.
    #[inline(always)]
    pub(crate) fn normal_of(&self, k: usize) -> Vec3 {
        Vec3::new(self.normal[0][k], self.normal[1][k], self.normal[2][k])
    }

    /// Meets all discs with a ray. `FACING`: whether some discs have no normal.
    #[inline(always)]
    pub(crate) fn meet<S: Simd, const FACING: bool>(
        &self,
        simd: S,
        ray: &Lanes<S>,
        limit: f32,
    ) -> DiscsMet<S> {
        let centre = load3(simd, &self.centre);
        let normal = load3(simd, &self.normal);
        let radius = load(simd, &self.radius);
        let to = sub(centre, ray.origin);
        let (mut along, mut speed) = (dot(normal, to), dot(normal, ray.direction));
        // A disc without a normal has a speed of zero here.
        let is_front = simd.simd_le_f32x8(speed, simd.splat_f32x8(0.0));
        if FACING {
            // The plane faces the ray.
            let is_facing = simd.simd_lt_f32x8(radius, simd.splat_f32x8(0.0));
            along = is_facing.select(dot(ray.direction, to), along);
            speed = is_facing.select(ray.squared_speed, speed);
        }
        let distance = along / speed;
        let d = ray.direction;
        let across = [
            d[0].mul_sub(distance, to[0]),
            d[1].mul_sub(distance, to[1]),
            d[2].mul_sub(distance, to[2]),
        ];
        let (off, square) = (dot(across, across), radius * radius);
        let is_met = simd.simd_lt_f32x8(off, square)
            & simd.simd_lt_f32x8(simd.splat_f32x8(0.0), distance)
            & simd.simd_lt_f32x8(distance, simd.splat_f32x8(limit));
        DiscsMet { distance, off: off / square, is_met, is_front }
    }
}
