//! Triangle meshes with their trees, and objects: meshes at places of their own. A mesh that
//! deforms keeps its tree, whose boxes are fitted anew.

use crate::accel::bounds::Bounds;
use crate::accel::simple::Tree;
use crate::accel::triangle::Triangle;
use crate::ray::{Hit, Ray};
use crate::scene::emitters::{AreaLight, Shape};
use glam::{Affine3A, Vec3};
use std::sync::Arc;

/// A triangle mesh.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Places of the vertices, relative to the origin of the scene or of the object.
    pub positions: Vec<Vec3>,
    /// Normals of the vertices; empty: each triangle is flat.
    pub normals: Vec<Vec3>,
    /// Vertices of each triangle; its front is where they run counterclockwise.
    pub triangles: Vec<[u32; 3]>,
    /// Albedo of the vertices; empty: that of the material.
    pub colours: Vec<Vec3>,
    /// Material of all triangles.
    pub material: Material,
}

/// How a mesh reflects and emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse albedo, linear light, 0 to 1.
    pub albedo: Vec3,
    /// Emitted radiance, linear light, to both sides.
    pub emission: Vec3,
}

impl Default for Material {
    fn default() -> Self {
        Self { albedo: Vec3::splat(0.5), emission: Vec3::ZERO }
    }
}

/// A mesh and the tree of its triangles.
#[derive(Clone, Debug)]
pub struct MeshTree {
    mesh: Mesh,
    triangles: Vec<Triangle>,
    tree: Tree,
}

/// A mesh at a place of its own.
#[derive(Clone, Debug)]
pub struct Object {
    /// The mesh, which objects can share.
    pub mesh: Arc<MeshTree>,
    /// Scene from mesh. Must be invertible.
    pub place: Affine3A,
}

impl MeshTree {
    /// Builds the tree of a mesh. Triangles are left out that name vertices which do not exist,
    /// have no extent, or have coordinates that are not finite.
    pub fn new(mut mesh: Mesh) -> Self {
        let positions = std::mem::take(&mut mesh.positions);
        let corners = |t: &[u32; 3]| {
            let p = t.map(|i| positions.get(i as usize).copied());
            Some([p[0]?, p[1]?, p[2]?])
        };
        mesh.triangles.retain(|t| {
            corners(t).is_some_and(|[a, b, c]| (b - a).cross(c - a).try_normalize().is_some())
        });
        if mesh.normals.len() != positions.len() {
            mesh.normals.clear();
        }
        if mesh.colours.len() != positions.len() {
            mesh.colours.clear();
        }
        let triangles: Vec<Triangle> =
            mesh.triangles.iter().filter_map(corners).map(Triangle::new).collect();
        mesh.positions = positions;
        let boxes: Vec<Bounds> = triangles.iter().map(Triangle::bounds).collect();
        Self { mesh, triangles, tree: Tree::new(boxes) }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Box of all triangles, empty if there are none.
    pub fn bounds(&self) -> Bounds {
        self.tree.bounds()
    }

    /// Bytes of the mesh and its tree.
    pub fn bytes(&self) -> usize {
        let m = &self.mesh;
        let vectors = m.positions.len() + m.normals.len() + m.colours.len() + m.triangles.len();
        vectors * 12 + size_of_val(&*self.triangles) + self.tree.bytes()
    }

    /// Moves the vertices and fits the boxes of the tree anew; which triangles lie together stays.
    ///
    /// # Panics
    /// If the number of positions differs from that of the mesh.
    pub fn refit(&mut self, positions: Vec<Vec3>, normals: Vec<Vec3>) {
        assert_eq!(positions.len(), self.mesh.positions.len());
        self.mesh.positions = positions;
        self.mesh.normals =
            if normals.len() == self.mesh.positions.len() { normals } else { Vec::new() };
        *self = Self::new(std::mem::take(&mut self.mesh));
    }

    /// Distance and triangle that `ray` meets first.
    pub(crate) fn nearest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let mut best = (ray.reach, u32::MAX);
        self.tree.walk(ray, |index| {
            if let Some(t) = self.triangles[index as usize].meet(ray).filter(|&t| t < best.0) {
                best = (t, index);
            }
            best.0
        });
        (best.1 != u32::MAX).then_some(best)
    }

    /// Whether any triangle lies on the ray before its reach.
    pub(crate) fn is_blocked(&self, ray: &Ray) -> bool {
        let mut found = false;
        self.tree.walk(ray, |index| {
            found |= self.triangles[index as usize].meet(ray).is_some_and(|t| t < ray.reach);
            if found { -1.0 } else { ray.reach }
        });
        found
    }
}

impl Object {
    /// Box of the object in the scene.
    pub(crate) fn bounds(&self) -> Bounds {
        self.mesh.bounds().placed(&self.place)
    }

    /// A ray of the scene relative to the mesh; distances stay the same, so its direction has no
    /// unit length.
    pub(crate) fn inward(mesh_from_scene: &Affine3A, ray: &Ray) -> Ray {
        Ray {
            origin: mesh_from_scene.transform_point3(ray.origin),
            direction: mesh_from_scene.transform_vector3(ray.direction),
            reach: ray.reach,
        }
    }

    /// The surface that `ray` of the scene meets at triangle `index`.
    pub(crate) fn surface(
        &self,
        mesh_from_scene: &Affine3A,
        ray: &Ray,
        distance: f32,
        index: u32,
    ) -> Hit {
        let mesh = &self.mesh.mesh;
        let corners = mesh.triangles[index as usize].map(|i| i as usize);
        let triangle = &self.mesh.triangles[index as usize];
        let weights = triangle.weights(Self::inward(mesh_from_scene, ray).at(distance));
        let blend = |v: &[Vec3]| (0..3).map(|k| v[corners[k]] * weights[k]).sum::<Vec3>();
        // Normals turn with the inverse transpose of the place.
        let turn = |n: Vec3| {
            let m = mesh_from_scene.matrix3.transpose();
            Vec3::from(m * glam::Vec3A::from(n)).normalize_or_zero()
        };
        let flat = turn(triangle.normal());
        let mirror = self.place.matrix3.determinant() < 0.0;
        let flat = if mirror { -flat } else { flat };
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
        let radiance = self.mesh.mesh.material.emission;
        if radiance.max_element() > 0.0 {
            into.extend(self.mesh.triangles.iter().map(|t| {
                let corners = t.corners().map(|p| self.place.transform_point3(p));
                AreaLight::new(Shape::Triangle(corners), radiance)
            }));
        }
    }
}

/// Distance at which rays leave triangles, over the greatest coordinate of the hit: some hundred
/// roundings of `f32`, so that they do not meet the triangle again.
const LIFT: f32 = 1e-5;
