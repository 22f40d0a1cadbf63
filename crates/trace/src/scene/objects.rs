//! Objects: meshes at places of their own, under a small tree over their boxes. When they move, no
//! tree of triangles is built.

use crate::accel::node::{Node, levels, slack};
use crate::accel::{Bounds, walk::Walk};
use crate::ray::{Hit, Ray};
use crate::scene::emitters::{AreaLight, Shape};
use crate::scene::mesh::MeshTree;
use fearless_simd::Simd;
use glam::{Affine3A, Vec3, Vec3A};
use std::sync::Arc;

/// A mesh at a place of its own.
#[derive(Clone, Debug)]
pub struct Object {
    /// The mesh, which objects can share.
    pub mesh: Arc<MeshTree>,
    /// Scene from mesh. An object whose place cannot be inverted is not met.
    pub place: Affine3A,
}

/// Objects and the tree over their boxes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Objects {
    objects: Vec<Object>,
    /// Mesh from scene for each object.
    inverses: Vec<Affine3A>,
    /// The leaf of an object has its number.
    nodes: Vec<Node>,
    bounds: Bounds,
}

impl Objects {
    pub(crate) fn new(objects: Vec<Object>) -> Self {
        let inverses = objects.iter().map(|o| o.place.inverse()).collect();
        let boxes: Vec<Bounds> = objects.iter().map(Object::bounds).collect();
        let bounds = boxes.iter().fold(Bounds::EMPTY, |all, b| all.union(b));
        let nodes = levels(&boxes, slack(&bounds));
        Self { objects, inverses, nodes, bounds }
    }

    pub(crate) fn list(&self) -> &[Object] {
        &self.objects
    }

    pub(crate) fn into_vec(self) -> Vec<Object> {
        self.objects
    }

    pub(crate) fn bounds(&self) -> Bounds {
        self.bounds
    }

    pub(crate) fn bytes(&self) -> usize {
        self.objects.iter().map(|o| o.mesh.bytes()).sum::<usize>() + size_of_val(&*self.nodes)
    }

    /// The surface that `ray` meets first.
    #[inline(always)]
    pub(crate) fn hit<S: Simd>(&self, simd: S, ray: &Ray) -> Option<Hit> {
        let (at, distance, slot) = self.nearest(simd, ray)?;
        Some(self.objects[at].surface(&self.inverses[at], ray, distance, slot))
    }

    /// The object that `ray` meets first, the distance, and the slot of its triangle.
    #[inline(always)]
    fn nearest<S: Simd>(&self, simd: S, ray: &Ray) -> Option<(usize, f32, u32)> {
        if self.nodes.is_empty() {
            return None;
        }
        let (mut best, mut reach) = (None, ray.reach);
        let mut walk = Walk::new(simd, &self.nodes, ray);
        while let Some(at) = walk.next(reach) {
            let inward = inward(&self.inverses[at], &Ray { reach, ..*ray });
            if let Some((distance, slot)) = self.objects[at].mesh.nearest(simd, &inward) {
                best = Some((at, distance, slot));
                reach = distance;
            }
        }
        best
    }

    /// A hit of `ray` whose lift ends half way to a triangle that is before its end: where bodies
    /// touch, rays would start beyond the other one. The place is then moved back along the ray by
    /// some roundings, since it can lie beyond the other one itself.
    #[inline(always)]
    pub(crate) fn bounded<S: Simd>(&self, simd: S, ray: &Ray, hit: Hit) -> Hit {
        if self.nodes.is_empty() {
            return hit;
        }
        let extent = ray.at(hit.distance).abs().max_element().max(hit.distance);
        let (back, least) = (BACK * extent, hit.lift.min(LIFT_MIN * extent));
        let distance = hit.distance - back;
        let out = Ray {
            origin: ray.at(distance) + hit.normal * least,
            direction: hit.normal,
            reach: hit.lift - least + back,
        };
        match self.nearest(simd, &out) {
            Some((_, free, _)) => Hit { distance, lift: least + 0.5 * free, ..hit },
            None => hit,
        }
    }

    /// Whether `ray` meets any object.
    #[inline(always)]
    pub(crate) fn is_blocked<S: Simd>(&self, simd: S, ray: &Ray) -> bool {
        if self.nodes.is_empty() {
            return false;
        }
        let mut walk = Walk::new(simd, &self.nodes, ray);
        while let Some(at) = walk.next(ray.reach) {
            if self.objects[at].mesh.is_blocked(simd, &inward(&self.inverses[at], ray)) {
                return true;
            }
        }
        false
    }
}

/// A ray of the scene relative to a mesh. Distances stay the same, so the direction has another
/// length.
#[inline(always)]
fn inward(mesh_from_scene: &Affine3A, ray: &Ray) -> Ray {
    Ray {
        origin: mesh_from_scene.transform_point3(ray.origin),
        direction: mesh_from_scene.transform_vector3(ray.direction),
        reach: ray.reach,
    }
}

impl Object {
    /// Box of the object in the scene; empty if its place cannot be inverted.
    fn bounds(&self) -> Bounds {
        let determinant = self.place.matrix3.determinant();
        let is_fine =
            determinant != 0.0 && self.place.is_finite() && (1.0 / determinant).is_finite();
        if is_fine { self.mesh.bounds().placed(&self.place) } else { Bounds::EMPTY }
    }

    /// The surface that `ray` of the scene meets at the triangle in `slot`.
    fn surface(&self, mesh_from_scene: &Affine3A, ray: &Ray, distance: f32, slot: u32) -> Hit {
        let mesh = self.mesh.mesh();
        let (triangle, corners) = self.mesh.triangle(slot);
        let weights = triangle.weights(inward(mesh_from_scene, ray).at(distance));
        let blend = |v: &[Vec3]| (0..3).map(|k| v[corners[k] as usize] * weights[k]).sum::<Vec3>();
        // Normals turn with the inverse transpose of the place.
        let turn = |n: Vec3| {
            let m = mesh_from_scene.matrix3.transpose();
            Vec3::from(m * Vec3A::from(n)).normalize_or_zero()
        };
        let flat = turn(triangle.normal());
        let is_back = flat.dot(ray.direction) > 0.0;
        let face = if is_back { -flat } else { flat };
        let mut normal = face;
        if !mesh.normals.is_empty() {
            let smooth = turn(blend(&mesh.normals));
            let smooth = if smooth.dot(face) < 0.0 { -smooth } else { smooth };
            // At silhouettes an interpolated normal can point away from the ray.
            if smooth.dot(ray.direction) < 0.0 {
                normal = smooth;
            }
        }
        let albedo =
            if mesh.colours.is_empty() { mesh.material.albedo } else { blend(&mesh.colours) };
        let place = ray.at(distance);
        let lift = LIFT * place.abs().max_element().max(distance);
        let emission = mesh.material.emission;
        Hit { distance, normal, albedo, emission, lift, radius: 0.0, is_back }
    }

    /// Appends the emitting triangles.
    pub(crate) fn push_lights(&self, into: &mut Vec<AreaLight>) {
        let mesh = self.mesh.mesh();
        let radiance = mesh.material.emission;
        if radiance.max_element() > 0.0 {
            into.extend(mesh.triangles.iter().map(|t| {
                let corners = t.map(|c| self.place.transform_point3(mesh.positions[c as usize]));
                AreaLight::new(Shape::Triangle(corners), radiance)
            }));
        }
    }
}

/// Distance at which rays leave triangles, over the greatest coordinate of the hit: some hundred
/// roundings of `f32`, so that they do not meet the triangle again.
const LIFT: f32 = 1e-5;
/// The same beside another surface: some roundings.
const LIFT_MIN: f32 = 5e-7;
/// How far the place is then moved back along the ray.
const BACK: f32 = 4e-6;
