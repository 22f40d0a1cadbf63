//! Normals of vertices from the triangles around them, weighted by area (Gouraud 1971). Where two
//! faces meet at more than a crease angle, the vertex is split so that the edge stays sharp.

use super::triangles::{TriangleMesh, add, cross, dot, unit};

/// Most triangles at a vertex that are compared in pairs for creases. A vertex with more is
/// smooth: the centre of a fan is flat, and a hostile file must not cost quadratic time.
const COMPARED_MAX: usize = 128;

/// Triangles around each vertex: those of vertex `v` are `corners[offsets[v]..offsets[v + 1]]`, as
/// `3 * triangle + corner`.
struct Around {
    offsets: Vec<u32>,
    corners: Vec<u32>,
}

impl Around {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut offsets = vec![0u32; vertices + 1];
        for &v in triangles.as_flattened() {
            offsets[v as usize + 1] += 1;
        }
        for v in 0..vertices {
            offsets[v + 1] += offsets[v];
        }
        let mut next = offsets.clone();
        let mut corners = vec![0; triangles.len() * 3];
        for (corner, &v) in triangles.as_flattened().iter().enumerate() {
            corners[next[v as usize] as usize] = corner as u32;
            next[v as usize] += 1;
        }
        Self { offsets, corners }
    }

    fn of(&self, v: usize) -> &[u32] {
        &self.corners[self.offsets[v] as usize..self.offsets[v + 1] as usize]
    }
}

/// Computes the normals of a mesh, and splits vertices at edges whose faces' normals have a cosine
/// below `crease_cos` (-1: no vertex is split). Triangles must have an area.
pub(crate) fn computed(mesh: &mut TriangleMesh, crease_cos: f64) {
    let vertices = mesh.positions.len();
    let around = Around::new(vertices, &mesh.triangles);
    let areas: Vec<[f64; 3]> = (0..mesh.triangles.len()).map(|t| cross(mesh.corners(t))).collect();
    mesh.normals = vec![[0.0; 3]; vertices];
    // Normals of the first copy of a vertex and of its others, with the index of each.
    let mut copies: Vec<([f32; 3], u32)> = Vec::new();
    for v in 0..vertices {
        copies.clear();
        let corners = around.of(v);
        let smooth = crease_cos <= -1.0 || corners.len() > COMPARED_MAX;
        for &corner in corners {
            let own = areas[corner as usize / 3];
            let has_crease = |other: [f64; 3]| match (unit(own), unit(other)) {
                (Some(a), Some(b)) => dot(a, b) < crease_cos,
                _ => false,
            };
            let others = corners.iter().map(|&c| areas[c as usize / 3]);
            let sum = others.filter(|&o| smooth || !has_crease(o)).fold([0.0; 3], add);
            let normal = unit(sum).or(unit(own)).unwrap_or([0.0, 0.0, 1.0]).map(|c| c as f32);
            // Corners on the same side of a crease add the same areas in the same order.
            let known = copies.iter().find(|(n, _)| *n == normal).map(|&(_, index)| index);
            let index = known.unwrap_or_else(|| {
                let index = if copies.is_empty() { v } else { mesh.positions.len() };
                if index == v {
                    mesh.normals[v] = normal;
                } else {
                    mesh.positions.push(mesh.positions[v]);
                    mesh.normals.push(normal);
                    if !mesh.colours.is_empty() {
                        mesh.colours.push(mesh.colours[v]);
                    }
                }
                copies.push((normal, index as u32));
                index as u32
            });
            mesh.triangles[corner as usize / 3][corner as usize % 3] = index;
            if smooth {
                corners.iter().for_each(|&c| {
                    mesh.triangles[c as usize / 3][c as usize % 3] = index;
                });
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles that share an edge and enclose an angle, in degrees.
    fn roof(angle_deg: f64) -> TriangleMesh {
        let (s, c) = angle_deg.to_radians().sin_cos();
        TriangleMesh {
            positions: vec![[0.0; 3], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-c, 0.0, s]],
            colours: vec![[1; 3], [2; 3], [3; 3], [4; 3]],
            triangles: vec![[0, 2, 1], [0, 1, 3]],
            ..Default::default()
        }
    }

    #[test]
    fn an_edge_is_smooth_below_the_crease_angle_and_sharp_above() {
        let mut flat = roof(30.0);
        computed(&mut flat, 0.5);
        assert_eq!((flat.positions.len(), &flat.triangles), (4, &vec![[0, 2, 1], [0, 1, 3]]));
        // The two areas are equal, so the normal at the edge lies half way: 15 degrees off.
        let half = [15f32.to_radians().sin(), 0.0, 15f32.to_radians().cos()];
        assert!((0..3).all(|i| (flat.normals[0][i] - half[i]).abs() < 1e-6), "{flat:?}");
        let mut sharp = roof(80.0);
        computed(&mut sharp, 0.5);
        assert_eq!(sharp.positions.len(), 6);
        assert_eq!(sharp.colours, [[1; 3], [2; 3], [3; 3], [4; 3], [1; 3], [2; 3]]);
        for (t, corners) in sharp.triangles.iter().enumerate() {
            let own = unit(cross(sharp.corners(t))).unwrap();
            for &v in corners {
                let n = sharp.normals[v as usize];
                assert!((0..3).all(|i| (f64::from(n[i]) - own[i]).abs() < 1e-6));
            }
        }
        let mut smooth = roof(80.0);
        computed(&mut smooth, -1.0);
        assert_eq!(smooth.positions.len(), 4);
    }

    #[test]
    fn a_vertex_of_very_many_triangles_is_smooth() {
        let n = 4 * COMPARED_MAX as u32;
        let mut fan = TriangleMesh { positions: vec![[0.0; 3]], ..Default::default() };
        for i in 0..n {
            let (s, c) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos();
            fan.positions.push([c, s, -1.0]);
            fan.triangles.push([0, i + 1, (i + 1) % n + 1]);
        }
        computed(&mut fan, 0.9);
        let up = fan.normals[0];
        assert!((up[2] - 1.0).abs() < 1e-6, "{up:?}");
        assert!(fan.triangles.iter().all(|t| t[0] == 0));
    }
}
