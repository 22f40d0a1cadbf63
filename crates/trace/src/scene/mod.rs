//! The scene that rays meet: the splats of a cut as one tree, and meshes and moving objects in a
//! small tree above theirs. Lights are kept apart ([`crate::light`]); surfaces that emit are listed
//! here ([`Scene::area_lights`]).

pub mod emitters;
pub mod mesh;
mod normals;
pub mod objects;
pub mod splats;
pub(crate) mod surface;

pub use emitters::{AreaLight, Shape};
pub use mesh::{Material, Mesh, MeshTree};
pub use normals::adopt_normals;
pub use objects::Object;
pub use splats::{Albedo, Emitter, Members, RADIUS_FACTOR, SplatInput};

use crate::accel::{Bounds, DiscLeaf, Kind, Tree};
use crate::ray::{Hit, Ray};
use fearless_simd::{Level, dispatch};
use glam::Vec3;
use objects::Objects;
use std::sync::Arc;
use surface::Splats;

/// What rays meet. Clones share the splats and meshes.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    splats: Arc<Splats>,
    dropped: usize,
    objects: Objects,
    bounds: Bounds,
    lights: Vec<AreaLight>,
}

impl Scene {
    /// A scene of splats, relative to the origin that they were made for, with the implicit tree.
    pub fn new(input: SplatInput<'_>) -> Self {
        let splats = Splats::new(&input);
        let mut scene = Self {
            dropped: input.splats.len() - splats.count,
            splats: splats.into(),
            ..Default::default()
        };
        scene.update();
        scene
    }

    /// The same scene with `objects` in it.
    pub fn with_objects(mut self, objects: Vec<Object>) -> Self {
        self.set_objects(objects);
        self
    }

    /// Replaces the objects. The tree of splats stays.
    pub fn set_objects(&mut self, objects: Vec<Object>) {
        self.objects = Objects::new(objects);
        self.update();
    }

    /// Moves the vertices of the mesh of an object; see [`MeshTree::refit`]. A mesh that is shared
    /// is copied first.
    ///
    /// # Panics
    /// If there is no such object, or the number of positions differs from that of its mesh.
    pub fn refit(&mut self, object: usize, positions: Vec<Vec3>, normals: Vec<Vec3>) {
        let mut objects = std::mem::take(&mut self.objects).into_vec();
        Arc::make_mut(&mut objects[object].mesh).refit(positions, normals);
        self.set_objects(objects);
    }

    /// Replaces the tree of splats by one that takes longer to build and makes rays faster. Returns
    /// false if it stays, since no better one was found.
    pub fn refine(&mut self) -> bool {
        let refined = self.splats.refined();
        let is_refined = refined.is_some();
        if let Some(splats) = refined {
            self.splats = splats.into();
        }
        is_refined
    }

    /// How the tree of splats was built.
    pub fn kind(&self) -> Kind {
        self.splats.tree.kind
    }

    /// The surface that a ray meets first.
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        self.with_approach(ray, |ray| {
            dispatch!(Level::new(), simd => {
                let object = self.objects.hit(simd, ray);
                let ray = Ray { reach: object.map_or(ray.reach, |h| h.distance), ..*ray };
                let hit = self.splats.hit(simd, &ray).or(object)?;
                Some(self.objects.bounded(simd, &ray, hit))
            })
        })
    }

    /// The surface that a ray from the eye meets first: as [`Self::hit`], but through the backs of
    /// splats if the scene culls them ([`SplatInput::cull_back_faces`]).
    pub fn seen(&self, ray: &Ray) -> Option<Hit> {
        self.with_approach(ray, |ray| {
            dispatch!(Level::new(), simd => {
                let object = self.objects.hit(simd, ray);
                let ray = Ray { reach: object.map_or(ray.reach, |h| h.distance), ..*ray };
                let hit = self.splats.seen(simd, &ray).or(object)?;
                Some(self.objects.bounded(simd, &ray, hit))
            })
        })
    }

    /// [`Self::hit`] with a lift of two radii, whatever faces the surface; to compare their speeds.
    pub fn blended(&self, ray: &Ray) -> Option<Hit> {
        self.with_approach(ray, |ray| {
            dispatch!(Level::new(), simd => {
                let object = self.objects.hit(simd, ray);
                let ray = Ray { reach: object.map_or(ray.reach, |h| h.distance), ..*ray };
                self.splats.blended(simd, &ray).or(object)
            })
        })
    }

    /// The surface of the frontmost primitive alone, not blended with those behind it.
    pub fn first(&self, ray: &Ray) -> Option<Hit> {
        self.with_approach(ray, |ray| {
            dispatch!(Level::new(), simd => {
                let object = self.objects.hit(simd, ray);
                let ray = Ray { reach: object.map_or(ray.reach, |h| h.distance), ..*ray };
                self.splats.first(simd, &ray).or(object)
            })
        })
    }

    /// Whether anything lies on the ray before its reach.
    pub fn is_blocked(&self, ray: &Ray) -> bool {
        let (ray, _) = approach(&self.bounds, ray);
        dispatch!(Level::new(), simd => {
            self.splats.is_blocked(simd, &ray) || self.objects.is_blocked(simd, &ray)
        })
    }

    /// Box of everything in the scene; empty (least above greatest) if nothing is.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Number of splats in the scene.
    pub fn splats(&self) -> usize {
        self.splats.count
    }

    /// Number of splats that were left out, since no ray can meet them: without extent or with
    /// values that are not finite.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Tree of the splats. Slots of unused places have a radius of zero.
    pub fn tree(&self) -> &Tree<DiscLeaf> {
        &self.splats.tree
    }

    /// Radiance of each emitter of splats.
    pub fn radiances(&self) -> &[Vec3] {
        &self.splats.radiances
    }

    /// Objects of the scene.
    pub fn objects(&self) -> &[Object] {
        self.objects.list()
    }

    /// Splats and triangles that emit light.
    pub fn area_lights(&self) -> &[AreaLight] {
        &self.lights
    }

    /// Bytes of the scene. Meshes that objects share are counted once an object.
    pub fn bytes(&self) -> usize {
        self.splats.tree.bytes() + self.objects.bytes() + size_of_val(&*self.lights)
    }

    fn with_approach(&self, ray: &Ray, hit: impl Fn(&Ray) -> Option<Hit>) -> Option<Hit> {
        let (ray, ahead) = approach(&self.bounds, ray);
        let mut hit = hit(&ray)?;
        hit.distance += ahead;
        Some(hit)
    }

    /// Computes what depends on splats and objects.
    fn update(&mut self) {
        self.bounds = self.splats.tree.bounds.union(&self.objects.bounds());
        self.lights.clone_from(&self.splats.lights);
        for object in self.objects.list() {
            object.push_lights(&mut self.lights);
        }
    }
}

/// Moves the origin of a ray from far outside `bounds` to their neighbourhood, where `f32` is as
/// fine as the scene. Returns the distance moved.
fn approach(bounds: &Bounds, ray: &Ray) -> (Ray, f32) {
    let extent = bounds.min.abs().max(bounds.max.abs()).max_element();
    if ray.origin.abs().max_element() <= FAR * extent || bounds.is_empty() {
        return (*ray, 0.0);
    }
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let half = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length() * 0.5;
    let ahead = (bounds.centre().as_dvec3() - origin).dot(direction) - 1.1 * half;
    if ahead.is_nan() || ahead <= 0.0 {
        return (*ray, 0.0);
    }
    let start = origin + direction * ahead;
    let ray = Ray { origin: start.as_vec3(), reach: ray.reach - ahead as f32, ..*ray };
    (ray, ahead as f32)
}

/// Distance of a ray's origin, in extents of the scene, beyond which it is moved.
const FAR: f32 = 4.0;

#[cfg(test)]
mod tests {
    use super::*;
    use esker_render::Splat;
    use fearless_simd::Simd;
    use glam::Affine3A;

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
    fn all_instruction_sets_meet_the_same_surfaces() {
        let splats = floor();
        let scene = Scene::new(SplatInput { splats: &splats, ..Default::default() });
        fn hit<S: Simd>(simd: S, scene: &Scene, ray: &Ray) -> Option<Hit> {
            scene.splats.hit(simd, ray)
        }
        for i in 0..300 {
            let from = Vec3::new((i % 17) as f32 * 0.7 - 1.0, (i % 23) as f32 * 0.5 - 1.0, 2.0);
            let toward = Vec3::new((i % 7) as f32 * 0.1, (i % 5) as f32 * -0.1, -1.0);
            let ray = Ray::new(from, toward.normalize_or_zero());
            let wide = dispatch!(Level::new(), simd => hit(simd, &scene, &ray));
            let plain = dispatch!(Level::baseline(), simd => hit(simd, &scene, &ray));
            assert_eq!(wide.is_some(), plain.is_some());
            if let Some((a, b)) = wide.zip(plain) {
                assert!((a.distance - b.distance).abs() < 1e-5 && a.radius == b.radius);
                assert!((a.normal - b.normal).length() < 1e-3);
            }
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
