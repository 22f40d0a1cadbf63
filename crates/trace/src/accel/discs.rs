//! Queries of rays on discs: the nearest one, all that make the surface a ray meets, whether any is
//! met, and how near a facing surface is.
//!
//! A surface is all discs met before the least sum of distance and two radii: no farther than two
//! radii behind the frontmost disc, less where a smaller one ends the surface. This bound does not
//! depend on the order in which discs are found, so that one traversal suffices and all trees over
//! the same discs agree.

use crate::accel::disc::DiscLeaf;
use crate::accel::node::Node;
use crate::accel::walk::{Bits, Lanes, Walk, bits, dot, load3, splat3};
use crate::accel::{WIDTH, tree::Tree};
use crate::ray::Ray;
use fearless_simd::{Simd, SimdBase};
use glam::Vec3;

/// Depth of a surface in radii. Discs of scans lie up to a radius off, tilted by up to 20 degrees:
/// over half of it normals are off by 1.6 times as much.
pub(crate) const DEPTH: f32 = 2.0;
/// Most discs of a surface that are blended, the nearest ones: some five scans of the same wall.
const MOST: usize = 32;

/// A disc that a ray meets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Met {
    /// Distance from the ray's origin.
    pub(crate) distance: f32,
    /// 1 at the centre of the disc, 0 at its rim.
    pub(crate) weight: f32,
    /// Slot of the disc: eight times its leaf plus its place there.
    pub(crate) slot: u32,
}

/// Discs of the surface that a ray meets.
pub(crate) struct Surface {
    met: [Met; MOST],
    count: usize,
    /// Distance at which the surface ends.
    end: f32,
}

impl Surface {
    /// No disc yet; the ray ends at `reach`.
    #[inline(always)]
    pub(crate) fn new(reach: f32) -> Self {
        Self { met: [Met::default(); MOST], count: 0, end: reach }
    }

    #[inline(always)]
    fn push(&mut self, met: Met, radius: f32) {
        if met.distance > self.end {
            return;
        }
        self.end = self.end.min(met.distance + DEPTH * radius);
        if self.count == MOST {
            self.make_room(&met);
        }
        if self.count < MOST {
            self.met[self.count] = met;
            self.count += 1;
        }
    }

    /// Drops discs behind the end of the surface. If all are before it, the farthest one of them
    /// and of `new` goes.
    #[cold]
    fn make_room(&mut self, new: &Met) {
        let mut kept = 0;
        for i in 0..self.count {
            if self.met[i].distance <= self.end {
                self.met[kept] = self.met[i];
                kept += 1;
            }
        }
        self.count = kept;
        if kept == MOST {
            let farthest =
                (0..MOST).max_by(|&a, &b| self.met[a].distance.total_cmp(&self.met[b].distance));
            if let Some(i) = farthest.filter(|&i| self.met[i].distance > new.distance) {
                self.met[i] = self.met[MOST - 1];
                self.count -= 1;
            }
        }
    }

    /// The discs of the surface.
    #[inline(always)]
    pub(crate) fn discs(&self) -> impl Iterator<Item = &Met> {
        self.met[..self.count].iter().filter(|m| m.distance <= self.end)
    }

    /// The frontmost disc; of several the one in the first slot.
    #[inline(always)]
    pub(crate) fn front(&self) -> Option<Met> {
        let mut all = self.met[..self.count].iter();
        let first = *all.next()?;
        Some(all.fold(
            first,
            |a, &b| {
                if (b.distance, b.slot) < (a.distance, a.slot) { b } else { a }
            },
        ))
    }
}

/// Adds all discs of the surface that `ray` meets first to `surface`. `CULLS`: whether discs whose
/// normal points away from the origin of the ray are not met.
#[inline(always)]
pub(crate) fn surface<S: Simd, const FACING: bool, const CULLS: bool>(
    simd: S,
    tree: &Tree<DiscLeaf>,
    ray: &Ray,
    surface: &mut Surface,
) {
    let lanes = Lanes::new(simd, ray);
    let mut walk = Walk::new(simd, &tree.nodes, ray);
    while let Some(at) = walk.next(surface.end) {
        let leaf = &tree.leaves[at];
        let met = leaf.meet::<S, FACING>(simd, &lanes, surface.end);
        let which = bits(if CULLS { met.is_met & met.is_front } else { met.is_met });
        if which != 0 {
            let (distance, off) = (met.distance.to_array(), met.off.to_array());
            for k in Bits(which) {
                let slot = (at * WIDTH + k) as u32;
                let met = Met { distance: distance[k], weight: 1.0 - off[k], slot };
                surface.push(met, leaf.radius[k].abs());
            }
        }
    }
}

/// The disc that `ray` meets first; of several the one in the first slot.
#[inline(always)]
pub(crate) fn nearest<S: Simd, const FACING: bool>(
    simd: S,
    tree: &Tree<DiscLeaf>,
    ray: &Ray,
) -> Option<Met> {
    let lanes = Lanes::new(simd, ray);
    let mut best = Met { distance: ray.reach, weight: 0.0, slot: u32::MAX };
    let mut walk = Walk::new(simd, &tree.nodes, ray);
    while let Some(at) = walk.next(best.distance) {
        let met = tree.leaves[at].meet::<S, FACING>(simd, &lanes, best.distance);
        let which = bits(met.is_met);
        if which != 0 {
            let (distance, off) = (met.distance.to_array(), met.off.to_array());
            for k in Bits(which) {
                let slot = (at * WIDTH + k) as u32;
                if (distance[k], slot) < (best.distance, best.slot) {
                    best = Met { distance: distance[k], weight: 1.0 - off[k], slot };
                }
            }
        }
    }
    (best.slot != u32::MAX).then_some(best)
}

/// Whether `ray` meets any disc.
#[inline(always)]
pub(crate) fn any<S: Simd, const FACING: bool>(simd: S, tree: &Tree<DiscLeaf>, ray: &Ray) -> bool {
    let lanes = Lanes::new(simd, ray);
    let mut walk = Walk::new(simd, &tree.nodes, ray);
    while let Some(at) = walk.next(ray.reach) {
        if bits(tree.leaves[at].meet::<S, FACING>(simd, &lanes, ray.reach).is_met) != 0 {
            return true;
        }
    }
    false
}

/// Distance along `ray` at which it meets a disc that faces its origin, as their normals are
/// stored, where the surface that the ray leaves has its stored normal along `normal`.
#[inline(always)]
pub(crate) fn facing<S: Simd>(
    simd: S,
    nodes: &[Node],
    leaves: &[DiscLeaf],
    ray: &Ray,
    normal: Vec3,
) -> Option<f32> {
    let lanes = Lanes::new(simd, ray);
    let normal = splat3(simd, normal);
    let mut best = ray.reach;
    let mut walk = Walk::new(simd, nodes, ray);
    while let Some(at) = walk.next(best) {
        let leaf = &leaves[at];
        let met = leaf.meet::<S, false>(simd, &lanes, best);
        let cosine = dot(normal, load3(simd, &leaf.normal));
        let which = bits(met.is_met & simd.simd_lt_f32x8(cosine, simd.splat_f32x8(FACING_COSINE)));
        let distance = met.distance.to_array();
        for k in Bits(which) {
            best = best.min(distance[k]);
        }
    }
    (best < ray.reach).then_some(best)
}

/// Cosine between normals below which two surfaces face each other: beyond what noise of normals
/// makes of one surface.
const FACING_COSINE: f32 = -0.3;
