//! The surface of a scan where a ray meets it: the place of the frontmost disc, normal and albedo
//! blended over all discs of the surface, and how far rays that leave it start.

use crate::accel::disc::{Disc, Tint};
use crate::accel::discs::{self, DEPTH, Met, Surface};
use crate::accel::refine::refined;
use crate::accel::tree::Leaf;
use crate::accel::{Bounds, DiscLeaf, Tree, WIDTH};
use crate::ray::{Hit, Ray};
use crate::scene::emitters::{AreaLight, Shape};
use crate::scene::splats::{SplatInput, albedo_of, disc_of, is_fine};
use esker_points::fetch::fetch;
use esker_render::Splat;
use fearless_simd::Simd;
use glam::Vec3;
use rayon::prelude::*;

/// Splats of a task.
const TASK: usize = 1 << 13;
/// Distance in radii from which on a facing surface counts: nearer ones are discs of the same
/// surface whose normals are turned the wrong way.
const FACING_FROM: f32 = 0.5;
/// Share of the distance to a facing surface at which rays start.
const FACING_SHARE: f32 = 0.5;

/// The splats of a scene.
#[derive(Clone, Debug, Default)]
pub(crate) struct Splats {
    pub(crate) tree: Tree<DiscLeaf>,
    /// Radiance of the emitters.
    pub(crate) radiances: Vec<Vec3>,
    /// Splats that emit light.
    pub(crate) lights: Vec<AreaLight>,
    /// Number of splats.
    pub(crate) count: usize,
    /// Whether some splats have no normal.
    pub(crate) has_facing: bool,
    /// Whether rays from the eye pass through the backs of splats.
    pub(crate) culls: bool,
}

/// What is counted of splats before their tree is built.
#[derive(Default)]
struct Tally {
    /// Splats that rays can meet.
    fine: usize,
    /// Those of them without a normal.
    facing: usize,
    /// Box of their centres.
    centres: Bounds,
}

impl Tally {
    #[inline(always)]
    fn add(&mut self, splat: &Splat) {
        if is_fine(splat) {
            self.fine += 1;
            self.facing += usize::from(splat.normal == [0.0; 3]);
            self.centres = self.centres.union(&Bounds::of_point(Vec3::from_array(splat.centre)));
        }
    }

    fn join(self, other: Self) -> Self {
        Self {
            fine: self.fine + other.fine,
            facing: self.facing + other.facing,
            centres: self.centres.union(&other.centres),
        }
    }
}

impl Splats {
    /// Builds the implicit tree of the splats that rays can meet.
    pub(crate) fn new(input: &SplatInput<'_>) -> Self {
        let all = input.splats;
        let tally = |splats: &[Splat]| {
            let mut tally = Tally::default();
            splats.iter().for_each(|splat| tally.add(splat));
            tally
        };
        let Tally { fine, facing, centres } =
            all.par_chunks(TASK).map(tally).reduce(Tally::default, Tally::join);
        let rule = input.albedo_rule();
        let centre = |index: usize| Vec3::from_array(all[index].centre);
        let disc = |index: usize| disc_of(&all[index], input.tint(index, rule));
        let (tree, _) = if fine == all.len() {
            Tree::implicit(fine, &centres, centre, disc, |i| fetch(all, i))
        } else {
            let kept: Vec<usize> = (0..all.len()).filter(|&i| is_fine(&all[i])).collect();
            Tree::implicit(fine, &centres, |i| centre(kept[i]), |i| disc(kept[i]), |_| ())
        };
        let radiances = input.emitters.iter().map(|e| Vec3::from_array(e.radiance)).collect();
        let (count, has_facing, culls) = (fine, facing > 0, input.cull_back_faces);
        let mut splats = Self { tree, radiances, lights: Vec::new(), count, has_facing, culls };
        splats.lights = splats.emitting();
        splats
    }

    /// The same splats with a refined tree, if there is one.
    pub(crate) fn refined(&self) -> Option<Self> {
        let discs: Vec<Disc> = self.discs().collect();
        let (tree, _) = refined(&discs)?;
        let (radiances, lights) = (self.radiances.clone(), self.lights.clone());
        Some(Self { tree, radiances, lights, ..*self })
    }

    /// Splats that emit light.
    fn emitting(&self) -> Vec<AreaLight> {
        if self.radiances.is_empty() {
            return Vec::new();
        }
        let emitting = self.discs().filter(|disc| disc.tint[3] > 0);
        emitting
            .map(|Disc { centre, normal, radius, tint }| {
                AreaLight::new(Shape::Disc { centre, normal, radius }, self.emission(tint))
            })
            .collect()
    }

    /// All discs.
    fn discs(&self) -> impl Iterator<Item = Disc> {
        let slots = 0..(self.tree.leaves.len() * WIDTH) as u32;
        slots.map(|slot| self.disc(slot)).filter(|disc| disc.radius > 0.0)
    }

    /// The disc in a slot.
    #[inline(always)]
    fn disc(&self, slot: u32) -> Disc {
        self.tree.leaves[slot as usize / WIDTH].get(slot as usize % WIDTH)
    }

    /// The surface that `ray` meets.
    #[inline(always)]
    pub(crate) fn hit<S: Simd>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        let mut hit = self.blended(simd, ray)?;
        hit.lift = self.lift(simd, ray, &hit);
        Some(hit)
    }

    /// The surface that `ray` from the eye meets.
    #[inline(always)]
    pub(crate) fn seen<S: Simd>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        if !self.culls {
            return self.hit(simd, ray);
        }
        let mut hit = self.met::<S, true>(simd, ray)?;
        hit.lift = self.lift(simd, ray, &hit);
        Some(hit)
    }

    /// The surface that `ray` meets; its lift is not bounded.
    #[inline(always)]
    pub(crate) fn blended<S: Simd>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        self.met::<S, false>(simd, ray)
    }

    /// [`Self::blended`] without discs that face away from the origin of the ray, if `CULLS`.
    #[inline(always)]
    fn met<S: Simd, const CULLS: bool>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        let mut surface = Surface::new(ray.reach);
        if self.has_facing {
            discs::surface::<S, true, CULLS>(simd, &self.tree, ray, &mut surface);
        } else {
            discs::surface::<S, false, CULLS>(simd, &self.tree, ray, &mut surface);
        }
        let front = surface.front()?;
        Some(self.blend(ray, front, surface.discs()))
    }

    /// The frontmost disc that `ray` meets.
    #[inline(always)]
    pub(crate) fn first<S: Simd>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        let front = if self.has_facing {
            discs::nearest::<S, true>(simd, &self.tree, ray)
        } else {
            discs::nearest::<S, false>(simd, &self.tree, ray)
        };
        front.map(|front| self.blend(ray, front, std::iter::once(&front)))
    }

    /// Whether `ray` meets any disc.
    #[inline(always)]
    pub(crate) fn is_blocked<S: Simd>(&self, simd: S, ray: &Ray) -> bool {
        if self.has_facing {
            discs::any::<S, true>(simd, &self.tree, ray)
        } else {
            discs::any::<S, false>(simd, &self.tree, ray)
        }
    }

    /// Emitted radiance of a tint.
    #[inline(always)]
    pub(crate) fn emission(&self, tint: Tint) -> Vec3 {
        if tint[3] == 0 { Vec3::ZERO } else { self.radiances[usize::from(tint[3]) - 1] }
    }

    /// Blends discs by their weights. Discs without a normal get that of the others.
    #[inline(always)]
    fn blend<'a>(&self, ray: &Ray, front: Met, all: impl Iterator<Item = &'a Met>) -> Hit {
        let (mut normal, mut albedo, mut emission) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        let mut sum = 0.0;
        for met in all {
            let slot = met.slot as usize;
            // At the very rim the weight can round to zero.
            let weight = met.weight.max(f32::EPSILON);
            let leaf = &self.tree.leaves[slot / WIDTH];
            let n = leaf.normal_of(slot % WIDTH);
            let tint = leaf.tint[slot % WIDTH];
            normal += n * weight.copysign(-n.dot(ray.direction));
            albedo += albedo_of(tint) * weight;
            if tint[3] > 0 {
                emission += self.emission(tint) * weight;
            }
            sum += weight;
        }
        let disc = self.disc(front.slot);
        Hit {
            distance: front.distance,
            normal: normal.normalize_or(-ray.direction),
            albedo: albedo / sum,
            emission: emission / sum,
            lift: DEPTH * disc.radius,
            radius: disc.radius,
            is_back: disc.normal.dot(ray.direction) > 0.0,
        }
    }

    /// Bounds the lift of `hit` at half the way to a surface that faces it.
    #[inline(always)]
    fn lift<S: Simd>(&self, simd: S, ray: &Ray, hit: &Hit) -> f32 {
        let least = FACING_FROM * hit.radius;
        let origin = ray.at(hit.distance) + hit.normal * least;
        let out = Ray { origin, direction: hit.normal, reach: hit.lift - least };
        let stored = if hit.is_back { -hit.normal } else { hit.normal };
        let (nodes, leaves) = (&self.tree.nodes, &self.tree.leaves);
        match discs::facing(simd, nodes, leaves, &out, stored) {
            Some(distance) => FACING_SHARE * (least + distance),
            None => hit.lift,
        }
    }
}
