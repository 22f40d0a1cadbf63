//! Generated models: closed surfaces with normals, with as many points as those of table 1 of
//! `marroquim2007`, the same on every machine. Each is a pebble, a sphere whose radius varies
//! smoothly, sampled evenly.

use anyhow::{Context, Result};
use glam::DVec3;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Rows of the paper's table: model, points, and the times of a frame of 512 x 512 and of 1024 x
/// 1024 pixels, milliseconds.
pub const TABLE_1: [(&str, u64, [f64; 2]); 5] = [
    ("head", 25_000, [12.0, 42.0]),
    ("armadillo", 173_000, [14.0, 46.0]),
    ("happy-buddha", 544_000, [16.0, 47.0]),
    ("asian-dragon", 3_610_000, [39.0, 71.0]),
    ("thai-statue", 5_000_000, [49.0, 82.0]),
];
/// Points that are made in parallel and then written.
const BATCH: u64 = 1 << 16;

/// Writes a pebble of `points` points as a PLY file with normals.
///
/// # Errors
/// If the file cannot be written.
pub fn write_pebble(path: &Path, points: u64) -> Result<()> {
    let context = || format!("{}: cannot write the model", path.display());
    let mut out = BufWriter::new(File::create(path).with_context(context)?);
    let fields = ["x", "y", "z", "nx", "ny", "nz"];
    let fields: String = fields.iter().map(|name| format!("property float {name}\n")).collect();
    let head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\n{fields}end_header\n"
    );
    out.write_all(head.as_bytes()).with_context(context)?;
    for first in (0..points).step_by(BATCH as usize) {
        let batch = first..points.min(first + BATCH);
        let records: Vec<[f32; 6]> = batch.into_par_iter().map(|i| point(i, points)).collect();
        out.write_all(bytemuck::cast_slice(&records)).with_context(context)?;
    }
    out.flush().with_context(context)
}

/// Position and normal of point `index` of `points`.
fn point(index: u64, points: u64) -> [f32; 6] {
    // A Fibonacci lattice is even on the sphere.
    let turn = index as f64 * 0.618_033_988_749_894_9;
    let angle = std::f64::consts::TAU * (turn - turn.floor());
    let z = 1.0 - (2.0 * index as f64 + 1.0) / points as f64;
    let ring = (1.0 - z * z).max(0.0).sqrt();
    let direction = DVec3::new(ring * angle.cos(), ring * angle.sin(), z);
    let at = surface(direction);
    // The normal is the cross product of two short steps along the surface.
    let u = direction.any_orthonormal_vector();
    let v = direction.cross(u);
    let step = |along: DVec3| surface((direction + along * 1e-4).normalize_or(direction)) - at;
    let normal = step(u).cross(step(v)).normalize_or(direction);
    let [a, b] = [at, normal].map(|p| p.as_vec3().to_array());
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

/// Point of the pebble's surface in a direction from its centre.
fn surface(direction: DVec3) -> DVec3 {
    let DVec3 { x, y, z } = direction;
    let hills = (5.0 * x + 2.0 * z).sin() * (6.0 * y).sin() + 0.5 * (11.0 * z + 4.0 * x).sin();
    direction
        * (1.0 + 0.12 * hills + 0.012 * (40.0 * x).sin() * (37.0 * y).sin() * (43.0 * z).sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_point_outwards() {
        for i in 0..1000 {
            let [x, y, z, nx, ny, nz] = point(i, 1000).map(f64::from);
            let (at, normal) = (DVec3::new(x, y, z), DVec3::new(nx, ny, nz));
            assert!((normal.length() - 1.0).abs() < 1e-5);
            assert!(at.normalize_or_zero().dot(normal) > 0.1, "{at} {normal}");
            assert!((surface(at.normalize_or_zero()) - at).length() < 1e-6);
        }
    }
}
