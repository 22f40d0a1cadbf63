//! Triangle meshes with their trees. A mesh that deforms keeps its tree, whose boxes are fitted to
//! the triangles anew.

use crate::accel::refine::refined;
use crate::accel::tree::{Leaf, NONE, Primitive};
use crate::accel::triangle::Triangle;
use crate::accel::walk::{Bits, Lanes, Walk, bits};
use crate::accel::{Bounds, Tree, TriangleLeaf, WIDTH};
use crate::ray::Ray;
use crate::scene::splats::COORDINATE_MAX;
use fearless_simd::{Simd, SimdBase};
use glam::Vec3;
use rayon::prelude::*;

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
    tree: Tree<TriangleLeaf>,
    /// Triangle of each slot of the tree.
    slots: Vec<u32>,
}

impl MeshTree {
    /// Builds the tree of a mesh. Triangles are left out that name vertices which do not exist,
    /// have no area, or have coordinates that are not finite.
    pub fn new(mut mesh: Mesh) -> Self {
        let count = mesh.positions.len();
        let positions = std::mem::take(&mut mesh.positions);
        mesh.triangles.retain(|corners| {
            let is_known = corners.iter().all(|&c| (c as usize) < count);
            is_known && triangle(&positions, corners).is_fine(COORDINATE_MAX)
        });
        mesh.positions = positions;
        mesh.normals = of_vertices(mesh.normals, count);
        mesh.colours = of_vertices(mesh.colours, count);
        let triangles: Vec<Triangle> =
            mesh.triangles.par_iter().map(|t| triangle(&mesh.positions, t)).collect();
        let (tree, slots) = refined(&triangles).unwrap_or_else(|| {
            let centre = |i: usize| triangles[i].centre();
            let centres = (0..triangles.len())
                .fold(Bounds::EMPTY, |all, i| all.union(&Bounds::of_point(centre(i))));
            Tree::implicit(triangles.len(), &centres, centre, |i| triangles[i], |_| ())
        });
        Self { mesh, tree, slots }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Box of all triangles, empty if there are none.
    pub fn bounds(&self) -> Bounds {
        self.tree.bounds
    }

    /// Bytes of the mesh and its tree.
    pub fn bytes(&self) -> usize {
        let m = &self.mesh;
        let vectors = m.positions.len() + m.normals.len() + m.colours.len() + m.triangles.len();
        vectors * 12 + size_of_val(&*self.slots) + self.tree.bytes()
    }

    /// The tree of the triangles.
    pub fn tree(&self) -> &Tree<TriangleLeaf> {
        &self.tree
    }

    /// Triangle of the mesh in each slot of the tree, `u32::MAX` in unused ones.
    pub fn slots(&self) -> &[u32] {
        &self.slots
    }

    /// Moves the vertices and fits the boxes of the tree to them; which triangles lie together
    /// stays, so rays get slower the more the mesh deforms. `normals` is empty for flat triangles.
    ///
    /// # Panics
    /// If the number of positions differs from that of the mesh.
    pub fn refit(&mut self, positions: Vec<Vec3>, normals: Vec<Vec3>) {
        assert_eq!(positions.len(), self.mesh.positions.len(), "a mesh keeps its vertices");
        self.mesh.normals = of_vertices(normals, positions.len());
        self.mesh.positions = positions;
        let Self { mesh, tree, slots } = self;
        tree.refit(slots, |i| triangle(&mesh.positions, &mesh.triangles[i]));
    }

    /// Distance and slot of the triangle that `ray` meets first.
    #[inline(always)]
    pub(crate) fn nearest<S: Simd>(&self, simd: S, ray: &Ray) -> Option<(f32, u32)> {
        let lanes = Lanes::new(simd, ray);
        let mut best = (ray.reach, NONE);
        let mut walk = Walk::new(simd, &self.tree.nodes, ray);
        while let Some(at) = walk.next(best.0) {
            let (distance, is_met) = self.tree.leaves[at].meet(simd, &lanes, best.0);
            let which = bits(is_met);
            if which != 0 {
                let distance = distance.to_array();
                for k in Bits(which) {
                    let met = (distance[k], (at * WIDTH + k) as u32);
                    best = if met < best { met } else { best };
                }
            }
        }
        (best.1 != NONE).then_some(best)
    }

    /// Whether any triangle lies on the ray before its reach.
    #[inline(always)]
    pub(crate) fn is_blocked<S: Simd>(&self, simd: S, ray: &Ray) -> bool {
        let lanes = Lanes::new(simd, ray);
        let mut walk = Walk::new(simd, &self.tree.nodes, ray);
        while let Some(at) = walk.next(ray.reach) {
            if bits(self.tree.leaves[at].meet(simd, &lanes, ray.reach).1) != 0 {
                return true;
            }
        }
        false
    }

    /// The triangle in a slot of the tree: its shape and the numbers of its vertices.
    pub(crate) fn triangle(&self, slot: u32) -> (Triangle, [u32; 3]) {
        let (leaf, k) = (slot as usize / WIDTH, slot as usize % WIDTH);
        (self.tree.leaves[leaf].get(k), self.mesh.triangles[self.slots[slot as usize] as usize])
    }
}

/// A triangle by the numbers of its vertices.
fn triangle(positions: &[Vec3], corners: &[u32; 3]) -> Triangle {
    Triangle::new(corners.map(|c| positions[c as usize]))
}

/// `values`, if there is one for each of `count` vertices.
fn of_vertices(values: Vec<Vec3>, count: usize) -> Vec<Vec3> {
    if values.len() == count { values } else { Vec::new() }
}
