//! Writes a mesh as binary little-endian PLY with normals, colours if it has any, and faces.

use super::triangles::TriangleMesh;
use crate::error::ScanError;
use crate::write::partial::Partial;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Writes a mesh to `path`, which appears once it is complete; returns its size in bytes.
///
/// # Errors
/// If the file cannot be written.
pub fn write(mesh: &TriangleMesh, path: &Path) -> Result<u64, ScanError> {
    let mut head =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", mesh.positions.len());
    // Infallible: a string takes any text.
    let mut line = |text: &str| writeln!(head, "property {text}").unwrap_or_default();
    ["x", "y", "z"].iter().for_each(|axis| line(&format!("double {axis}")));
    ["nx", "ny", "nz"].iter().for_each(|axis| line(&format!("float {axis}")));
    if !mesh.colours.is_empty() {
        ["red", "green", "blue"].iter().for_each(|c| line(&format!("uchar {c}")));
    }
    head += &format!("element face {}\n", mesh.triangles.len());
    head += "property list uchar uint vertex_indices\nend_header\n";
    let mut out = Partial::create(path)?;
    match body(mesh, &mut out, head.as_bytes()) {
        Ok(()) => out.finish(head.as_bytes()),
        Err(e) => Err(out.error(e)),
    }
}

fn body(mesh: &TriangleMesh, out: &mut impl Write, head: &[u8]) -> std::io::Result<()> {
    out.write_all(head)?;
    for (i, position) in mesh.positions.iter().enumerate() {
        for c in position {
            out.write_all(&c.to_le_bytes())?;
        }
        for c in mesh.normals[i] {
            out.write_all(&c.to_le_bytes())?;
        }
        if let Some(colour) = mesh.colours.get(i) {
            out.write_all(colour)?;
        }
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        for v in triangle {
            out.write_all(&v.to_le_bytes())?;
        }
    }
    Ok(())
}
