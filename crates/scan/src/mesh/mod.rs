//! Triangle meshes: read from PLY and OBJ files ([`read`]), generated ([`generated`]) and written
//! as PLY ([`write()`]). Files are untrusted: counts are checked before they are used, indices are
//! checked against the vertices, and memory grows only with what the file really holds.

mod clean;
pub mod generated;
mod normals;
mod obj;
mod ply;
mod triangles;
mod write;

use crate::error::ScanError;
use crate::packed::{READ_BYTES, open_stream};
use esker_points::Task;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::Path;

pub use triangles::{TRIANGLES_MAX, TriangleMesh, VERTICES_MAX};
pub use write::write;

/// Reads a mesh: PLY with faces or OBJ, plain or compressed with zstd, recognised by content.
/// Polygons become fans of triangles. Triangles without area are left out, with a note, and so are
/// vertices that no triangle uses. Normals that the file lacks are computed from the triangles;
/// they stay sharp where faces meet at more than 60 degrees.
///
/// # Errors
/// If the file cannot be read, is damaged, or holds no triangle with an area;
/// [`ScanError::Cancelled`].
pub fn read(path: &Path, task: &dyn Task) -> Result<TriangleMesh, ScanError> {
    let (mut stream, _) = open_stream(path)?;
    let mut head = Vec::new();
    let read = stream.by_ref().take(4).read_to_end(&mut head);
    read.map_err(|e| ScanError::io(path, e))?;
    let is_ply = matches!(head[..], [b'p', b'l', b'y', b'\r' | b'\n' | b' ' | b'\t']);
    let whole = Cursor::new(head).chain(stream);
    let stream: Box<dyn BufRead + Send> = Box::new(BufReader::with_capacity(READ_BYTES, whole));
    let raw = if is_ply { ply::read(path, stream, task)? } else { obj::read(path, stream, task)? };
    clean::clean(path, raw)
}
