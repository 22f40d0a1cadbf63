//! Makes a sound mesh of what a file holds: triangles without area and vertices without a triangle
//! are left out, with notes; normals that are missing or of no length are computed.

use super::normals::computed;
use super::triangles::{RawMesh, TriangleMesh, cross, unit};
use crate::error::ScanError;
use std::path::Path;

/// Cosine of the angle between faces from which an edge is sharp if the file has no normals: 60
/// degrees keep the edges of buildings sharp, and the noise of scanned surfaces smooth.
const CREASE_COS: f64 = 0.5;

/// Makes the mesh of a file.
///
/// # Errors
/// If no triangle with an area is left.
pub(crate) fn clean(path: &Path, mut raw: RawMesh) -> Result<TriangleMesh, ScanError> {
    let before = raw.triangles.len();
    let positions = &raw.positions;
    raw.triangles.retain(|t| unit(cross(t.map(|v| positions[v as usize]))).is_some());
    let dropped = before - raw.triangles.len();
    if raw.triangles.is_empty() {
        let what = match before {
            0 => "has no faces; it is a point cloud or empty, and not a mesh".to_owned(),
            _ => format!("none of its {before} triangles has an area"),
        };
        return Err(ScanError::unsupported(path, what));
    }
    if dropped > 0 {
        raw.notes.push(format!("{dropped} triangles without area are left out"));
    }
    let unused = compact(&mut raw);
    if unused > 0 {
        raw.notes.push(format!("{unused} vertices that no triangle uses are left out"));
    }
    let RawMesh { positions, normals, colours, triangles, notes } = raw;
    let mut mesh = TriangleMesh { positions, normals: Vec::new(), colours, triangles, notes };
    if normals.is_empty() {
        computed(&mut mesh, CREASE_COS);
        return Ok(mesh);
    }
    let given: Vec<_> = normals.iter().map(|n| unit(n.map(f64::from))).collect();
    if given.iter().any(Option::is_none) {
        // No vertex is split, so the computed normals have the order of the given ones.
        computed(&mut mesh, -1.0);
    } else {
        mesh.normals = vec![[0.0; 3]; given.len()];
    }
    for (normal, given) in mesh.normals.iter_mut().zip(given) {
        if let Some(given) = given {
            *normal = given.map(|c| c as f32);
        }
    }
    Ok(mesh)
}

/// Leaves out vertices that no triangle uses; returns their number. The order stays.
fn compact(raw: &mut RawMesh) -> usize {
    let mut used = vec![false; raw.positions.len()];
    raw.triangles.as_flattened().iter().for_each(|&v| used[v as usize] = true);
    let unused = used.iter().filter(|&&u| !u).count();
    if unused == 0 {
        return 0;
    }
    let mut next = 0;
    let places: Vec<u32> = used
        .iter()
        .map(|&u| {
            next += u32::from(u);
            next.wrapping_sub(1)
        })
        .collect();
    raw.triangles.as_flattened_mut().iter_mut().for_each(|v| *v = places[*v as usize]);
    keep(&mut raw.positions, &used);
    keep(&mut raw.normals, &used);
    keep(&mut raw.colours, &used);
    unused
}

fn keep<T>(values: &mut Vec<T>, used: &[bool]) {
    let mut at = used.iter();
    values.retain(|_| at.next().copied().unwrap_or(false));
}
