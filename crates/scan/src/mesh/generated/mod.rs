//! Generated meshes for figures of light, so that a clean clone has scenes: `mesh:NAME` or
//! `mesh:NAME:TRIANGLES`. Each is a closed surface or several, in metres with z up, the same on
//! every machine: only arithmetic that IEEE 754 rounds exactly and `libm` decide a position.
//!
//! | name | what it is | triangles |
//! |---|---|---|
//! | `bust` | a smooth head on a plinth in a coloured niche | 545,000 |
//! | `knot` | a thin knotted body with scales and a ridge, as a dragon has | 939,000 |
//! | `hall` | a vaulted hall with columns and windows, seen from inside | 77,000 |

mod bust;
mod hall;
mod isosurface;
mod knot;
mod solids;
mod view;

use super::triangles::{TRIANGLES_MAX, TriangleMesh};
use crate::error::ScanError;
use crate::synthetic::parse_points;
use std::path::Path;

pub use view::{Lamp, Viewpoint};

/// Prefix of the name of every generated mesh.
const PREFIX: &str = "mesh:";
/// Fewest triangles with which each of the meshes has its shape.
pub const TRIANGLES_MIN: u64 = 20_000;

/// A generated mesh.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// Its name.
    pub name: &'static str,
    /// Number of triangles by default.
    pub triangles: u64,
    /// Where it is seen from.
    pub view: Viewpoint,
    /// What lights it.
    pub lamps: &'static [Lamp],
    make: fn(u64) -> TriangleMesh,
}

/// All generated meshes.
pub const MODELS: [Model; 3] = [
    Model {
        name: "bust",
        triangles: 545_000,
        view: bust::VIEW,
        lamps: &bust::LAMPS,
        make: bust::make,
    },
    Model {
        name: "knot",
        triangles: 939_000,
        view: knot::VIEW,
        lamps: &knot::LAMPS,
        make: knot::make,
    },
    Model {
        name: "hall",
        triangles: 77_000,
        view: hall::VIEW,
        lamps: &hall::LAMPS,
        make: hall::make,
    },
];

impl Model {
    /// Makes the mesh with about this number of triangles, at least [`TRIANGLES_MIN`]; it is met
    /// within 5 %.
    pub fn make(&self, triangles: u64) -> TriangleMesh {
        (self.make)(triangles.clamp(TRIANGLES_MIN, TRIANGLES_MAX as u64))
    }
}

/// Whether an input names a generated mesh and not a file.
pub fn is_spec(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().starts_with(PREFIX.as_bytes())
}

/// The model and the number of triangles that a name `mesh:NAME[:TRIANGLES]` asks for.
///
/// # Errors
/// If it is not such a name; the message says which there are.
pub fn parse(path: &Path) -> Result<(&'static Model, u64), ScanError> {
    let text = path.to_string_lossy();
    let refused = |what: String| {
        let names = MODELS.map(|m| m.name).join(", ");
        let what = format!(
            "{what}; a generated mesh is mesh:NAME[:TRIANGLES], NAME one of {names}, TRIANGLES such as 77000 or 545k"
        );
        ScanError::unsupported(path, what)
    };
    let mut parts = text.strip_prefix(PREFIX).unwrap_or(&text).splitn(2, ':');
    let name = parts.next().unwrap_or_default();
    let model = MODELS
        .iter()
        .find(|m| m.name == name)
        .ok_or_else(|| refused(format!("there is no mesh `{name}`")))?;
    let Some(count) = parts.next() else { return Ok((model, model.triangles)) };
    let triangles = parse_points(count).ok();
    let range = TRIANGLES_MIN..=TRIANGLES_MAX as u64;
    let triangles = triangles.filter(|n| range.contains(n)).ok_or_else(|| {
        let (least, most) = (range.start(), range.end());
        refused(format!("`{count}` is no number of triangles from {least} to {most}"))
    })?;
    Ok((model, triangles))
}
