//! The scene that rays meet: the splats of a cut as one tree, and meshes and moving objects in a
//! small tree above theirs. Lights are kept apart ([`crate::light`]); surfaces that emit are listed
//! here ([`Scene::area_lights`]).

pub mod emitters;
pub mod mesh;
pub mod splats;

pub use emitters::{AreaLight, Shape};
pub use mesh::{Material, Mesh, MeshTree, Object};
pub use splats::{Albedo, COORDINATE_MAX, Emitter, Members, RADIUS_FACTOR, SplatInput};

use crate::accel::bounds::Bounds;
use crate::accel::disc::Disc;
use crate::accel::simple::Tree;
use crate::ray::{Hit, Ray};
use glam::{Affine3A, Vec3};
use splats::{Tint, albedo_of, disc_of};
use std::sync::Arc;

/// What rays meet.
#[derive(Debug, Default)]
pub struct Scene {
    discs: Vec<Disc>,
    tints: Vec<Tint>,
    tree: Tree,
    radiances: Vec<Vec3>,
    dropped: usize,
    objects: Vec<(Object, Affine3A)>,
    lights: Vec<AreaLight>,
}

impl Scene {
    /// A scene of splats, relative to the origin that they were made for.
    pub fn new(input: SplatInput<'_>) -> Self {
        let rule = input.albedo_rule();
        let mut scene = Self::default();
        for (index, splat) in input.splats.iter().enumerate() {
            if let Some(disc) = disc_of(splat) {
                scene.discs.push(disc);
                scene.tints.push(input.tint(index, rule));
            }
        }
        scene.dropped = input.splats.len() - scene.discs.len();
        scene.radiances = input.emitters.iter().map(|e| Vec3::from_array(e.radiance)).collect();
        scene.tree = Tree::new(scene.discs.iter().map(Disc::bounds).collect());
        scene.list_lights();
        scene
    }

    /// The same scene with `objects` in it.
    pub fn with_objects(mut self, objects: Vec<Object>) -> Self {
        self.set_objects(objects);
        self
    }

    /// Replaces the objects. The tree of splats stays.
    pub fn set_objects(&mut self, objects: Vec<Object>) {
        self.objects = objects
            .into_iter()
            .map(|o| {
                let i = o.place.inverse();
                (o, i)
            })
            .collect();
        self.list_lights();
    }

    /// Moves the vertices of the mesh of an object; see [`MeshTree::refit`]. A mesh that is shared
    /// is copied first.
    ///
    /// # Panics
    /// If there is no such object, or the number of positions differs from that of its mesh.
    pub fn refit(&mut self, object: usize, positions: Vec<Vec3>, normals: Vec<Vec3>) {
        Arc::make_mut(&mut self.objects[object].0.mesh).refit(positions, normals);
        self.list_lights();
    }

    /// The surface that a ray meets first.
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        let mesh = self.object_hit(ray);
        let reach = mesh.map_or(ray.reach, |h| h.distance);
        self.splat_hit(&Ray { reach, ..*ray }, true).or(mesh)
    }

    /// The surface of the frontmost primitive alone, not blended with those behind it.
    pub fn first(&self, ray: &Ray) -> Option<Hit> {
        let mesh = self.object_hit(ray);
        let reach = mesh.map_or(ray.reach, |h| h.distance);
        self.splat_hit(&Ray { reach, ..*ray }, false).or(mesh)
    }

    /// Whether anything lies on the ray before its reach.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        let mut found = false;
        self.tree.walk(ray, |index| {
            found |= self.discs[index as usize].meet(ray).is_some_and(|(t, _)| t < ray.reach);
            if found { -1.0 } else { ray.reach }
        });
        found
            || self
                .objects
                .iter()
                .any(|(o, inverse)| o.mesh.is_blocked(&Object::inward(inverse, ray)))
    }

    /// Box of everything in the scene; empty (least above greatest) if nothing is.
    pub fn bounds(&self) -> Bounds {
        self.objects.iter().fold(self.tree.bounds(), |all, (o, _)| all.union(&o.bounds()))
    }

    /// Number of splats in the scene.
    pub fn splats(&self) -> usize {
        self.discs.len()
    }

    /// Number of splats that were left out, since no ray can meet them: without extent or with
    /// values that are not finite.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Objects of the scene.
    pub fn objects(&self) -> impl ExactSizeIterator<Item = &Object> {
        self.objects.iter().map(|(object, _)| object)
    }

    /// Splats and triangles that emit light.
    pub fn area_lights(&self) -> &[AreaLight] {
        &self.lights
    }

    /// Bytes of the scene. Meshes that objects share are counted once an object.
    pub fn bytes(&self) -> usize {
        let meshes: usize = self.objects.iter().map(|(o, _)| o.mesh.bytes()).sum();
        meshes + size_of_val(&*self.discs) + size_of_val(&*self.tints) + self.tree.bytes()
    }

    fn object_hit(&self, ray: &Ray) -> Option<Hit> {
        let mut best = None;
        let mut reach = ray.reach;
        for (object, inverse) in &self.objects {
            let inward = Object::inward(inverse, &Ray { reach, ..*ray });
            if let Some((t, index)) = object.mesh.nearest(&inward) {
                reach = t;
                best = Some((object, inverse, index));
            }
        }
        best.map(|(object, inverse, index)| object.surface(inverse, ray, reach, index))
    }

    fn splat_hit(&self, ray: &Ray, blends: bool) -> Option<Hit> {
        let mut met: Vec<(f32, f32, u32)> = Vec::new();
        let mut limit = ray.reach;
        self.tree.walk(ray, |index| {
            let disc = &self.discs[index as usize];
            if let Some((t, weight)) = disc.meet(ray).filter(|m| m.0 < limit) {
                met.push((t, weight, index));
                limit = limit.min(if blends { t + 2.0 * disc.radius } else { t });
            }
            limit
        });
        let &(distance, _, front) = met.iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        met.retain(|m| m.2 == front || blends && m.0 <= limit);
        let (mut normal, mut albedo, mut emission, mut sum) =
            (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, 0.0);
        for (_, weight, index) in met {
            let (n, tint) = (self.discs[index as usize].normal, self.tints[index as usize]);
            normal += if n.dot(ray.direction) > 0.0 { -n } else { n } * weight;
            albedo += albedo_of(tint) * weight;
            if tint[3] > 0 {
                emission += self.radiances[usize::from(tint[3]) - 1] * weight;
            }
            sum += weight;
        }
        let disc = &self.discs[front as usize];
        Some(Hit {
            distance,
            normal: normal.normalize_or(-ray.direction),
            albedo: albedo / sum,
            emission: emission / sum,
            lift: 2.0 * disc.radius,
            radius: disc.radius,
            is_back: disc.normal.dot(ray.direction) > 0.0,
        })
    }

    fn list_lights(&mut self) {
        self.lights.clear();
        for (disc, tint) in self.discs.iter().zip(&self.tints).filter(|(_, t)| t[3] > 0) {
            let &Disc { centre, normal, radius } = disc;
            let radiance = self.radiances[usize::from(tint[3]) - 1];
            self.lights.push(AreaLight::new(Shape::Disc { centre, normal, radius }, radiance));
        }
        for (object, _) in &self.objects {
            object.push_lights(&mut self.lights);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esker_render::Splat;

    fn floor() -> Vec<Splat> {
        let at = |i: u32| [(i % 10) as f32, (i / 10) as f32, 0.0];
        let of = |i| Splat {
            centre: at(i),
            radius: 1.0,
            normal: [0.0, 0.0, 1.0],
            colour: [0.5; 3],
            draw: 0,
            index: i,
        };
        (0..100).map(of).collect()
    }

    #[test]
    fn a_floor_of_splats_stops_rays_from_both_sides() {
        let splats = floor();
        let scene =
            Scene::new(SplatInput { splats: &splats, albedo: Albedo::AsIs, ..Default::default() });
        for side in [1.0, -1.0] {
            let ray = Ray::new(Vec3::new(4.3, 5.2, 3.0 * side), Vec3::new(0.0, 0.0, -side));
            let hit = scene.hit(&ray).unwrap();
            assert!((hit.distance - 3.0).abs() < 1e-6 && hit.normal.z == side);
            assert!((hit.albedo - 0.5).abs().max_element() < 1e-4);
            assert_eq!(hit.is_back, side < 0.0);
            assert!(scene.is_blocked(&ray) && !scene.is_blocked(&Ray { reach: 2.9, ..ray }));
        }
    }

    #[test]
    fn a_moved_triangle_hides_the_floor_and_emits() {
        let mesh = Mesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            triangles: vec![[0, 1, 2]],
            material: Material { emission: Vec3::ONE, ..Default::default() },
            ..Default::default()
        };
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(4.0),
            Default::default(),
            Vec3::new(4.0, 4.0, 1.0),
        );
        let splats = floor();
        let scene = Scene::new(SplatInput { splats: &splats, ..Default::default() })
            .with_objects(vec![Object { mesh: Arc::new(MeshTree::new(mesh)), place }]);
        let hit = scene.hit(&Ray::new(Vec3::new(5.0, 5.0, 3.0), Vec3::NEG_Z)).unwrap();
        assert!((hit.distance - 2.0).abs() < 1e-6 && !hit.is_splat() && hit.emission == Vec3::ONE);
        assert!((scene.area_lights()[0].area - 8.0).abs() < 1e-5);
    }
}
