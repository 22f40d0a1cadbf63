//! Parts of meshes that scenes are made of by hand: quads and spheres.

use esker_scan::mesh::TriangleMesh;
use glam::{DVec3, Vec3};
use std::f32::consts::{PI, TAU};

/// Adds a quad of one colour. Its front is where the corners run counterclockwise.
pub(super) fn add_quad(mesh: &mut TriangleMesh, corners: [[f64; 3]; 4], colour: [u8; 3]) {
    let [a, b, c] = [0, 1, 2].map(|i| DVec3::from_array(corners[i]));
    let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3().to_array();
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    mesh.normals.extend([normal; 4]);
    mesh.colours.extend([colour; 4]);
    mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// Adds a box between two corners.
pub(super) fn add_box(mesh: &mut TriangleMesh, low: [f64; 3], high: [f64; 3], colour: [u8; 3]) {
    let corner = |i: usize| [0, 1, 2].map(|a| if i >> a & 1 == 0 { low[a] } else { high[a] });
    let faces =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    for face in faces {
        add_quad(mesh, face.map(corner), colour);
    }
}

/// Adds an upright wall along an arc about an axis, from the floor up; angles in turns, from the
/// x axis to the y axis.
pub(super) fn add_arc(
    mesh: &mut TriangleMesh,
    [x, y]: [f64; 2],
    radius: f64,
    height: f64,
    [start, end]: [f64; 2],
    colour: [u8; 3],
) {
    const PARTS: u32 = 64;
    let at = |part: u32, z: f64| {
        let turn = start + (end - start) * f64::from(part) / f64::from(PARTS);
        let (sin, cos) = (turn * std::f64::consts::TAU).sin_cos();
        [x + radius * cos, y + radius * sin, z]
    };
    for part in 0..PARTS {
        let corners = [at(part + 1, 0.0), at(part, 0.0), at(part, height), at(part + 1, height)];
        add_quad(mesh, corners, colour);
    }
}

/// Directions and triangles of a sphere of `rings` rings of twice as many triangle pairs, for
/// places of any radius. The poles are at z.
pub(super) fn sphere(rings: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let around = rings * 2;
    let direction = |ring: u32, part: u32| {
        let (sin, cos) = (PI * ring as f32 / rings as f32).sin_cos();
        let (y, x) = (TAU * part as f32 / around as f32).sin_cos();
        Vec3::new(sin * x, sin * y, cos)
    };
    let places = (0..=rings).flat_map(|r| (0..around).map(move |p| direction(r, p))).collect();
    let quad = |ring: u32, part: u32| {
        let next = (part + 1) % around;
        let [a, b] = [part, next].map(|p| ring * around + p);
        let [c, d] = [next, part].map(|p| (ring + 1) * around + p);
        [[a, d, c], [a, c, b]]
    };
    let triangles = (0..rings).flat_map(|r| (0..around).flat_map(move |p| quad(r, p))).collect();
    (places, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fronts_are_outside() {
        let mut mesh = TriangleMesh::default();
        add_box(&mut mesh, [-1.0; 3], [1.0; 3], [9; 3]);
        for (place, normal) in mesh.positions.iter().zip(&mesh.normals) {
            let out: f64 = (0..3).map(|a| place[a] * f64::from(normal[a])).sum();
            assert!((out - 1.0).abs() < 1e-6, "{place:?} {normal:?}");
        }
        let (places, triangles) = sphere(8);
        for [a, b, c] in triangles {
            let [a, b, c] = [a, b, c].map(|i| places[i as usize]);
            let area = (b - a).cross(c - a);
            assert!(area.dot(a + b + c) > -1e-6, "{a} {b} {c}");
        }
    }
}
