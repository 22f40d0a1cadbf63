//! Writes a generated scan as LAS or LAZ, for programs that read only these and for measuring how
//! fast LAZ is decoded, or a generated mesh as PLY. Without a file the points are generated and
//! dropped, to measure the generator.

mod las;

use anyhow::{Result, bail};
use esker_points::{Batch, Lattice, Task};
use esker_scan::mesh::{self, TriangleMesh, generated};
use esker_scan::write::{self, Outline, Target};
use esker_scan::{OpenOptions, Source};
use std::path::Path;

/// Opens a generated scan.
///
/// # Errors
/// If the name is not that of a generated scan.
pub fn open(spec: &Path, task: &dyn Task) -> Result<Box<dyn Source>> {
    if !esker_scan::synthetic::is_spec(spec) {
        bail!(
            "{}: is no generated scan; name one as synthetic:SCENE:POINTS[:SEED], or a mesh as mesh:NAME[:TRIANGLES]",
            spec.display()
        );
    }
    Ok(esker_scan::open(spec, &OpenOptions::default(), task)?)
}

/// Makes a generated mesh; `None` if the name is not that of one.
///
/// # Errors
/// If there is no such mesh.
pub fn mesh(spec: &Path) -> Result<Option<TriangleMesh>> {
    if !generated::is_spec(spec) {
        return Ok(None);
    }
    let (model, triangles) = generated::parse(spec)?;
    Ok(Some(model.make(triangles)))
}

/// Writes a mesh to `out`, which appears once it is complete. Returns the bytes of the file.
///
/// # Errors
/// If its extension is not `.ply`, or the file cannot be written.
pub fn write_mesh(mesh: &TriangleMesh, out: &Path) -> Result<u64> {
    if !matches!(Target::of(out), Ok(Target::Ply)) {
        bail!("{}: name the file .ply", out.display());
    }
    Ok(mesh::write(mesh, out)?)
}

/// Generates all points, drops them and returns their number.
///
/// # Errors
/// If the task is cancelled.
pub fn generate(source: &dyn Source, task: &dyn Task) -> Result<u64> {
    read(source, task, &mut |_| Ok(()))
}

/// Writes all points to `out`, which appears once it is complete: LAZ or LAS, by its extension.
/// Returns the bytes of the file.
///
/// # Errors
/// If the extension is neither, or the file cannot be written.
pub fn write(source: &dyn Source, out: &Path, task: &dyn Task) -> Result<u64> {
    let target = match Target::of(out) {
        Ok(target @ (Target::Las | Target::Laz)) => target,
        _ => bail!("{}: name the file .laz or .las", out.display()),
    };
    let info = source.info();
    let outline = Outline {
        lattice: Lattice::choose(std::slice::from_ref(&info.grid))?,
        schema: info.schema.clone(),
        points_max: info.points_hint,
        ranges: Vec::new(),
        classes: Vec::new(),
    };
    let mut origins = std::iter::once(Ok(las::origin(info)));
    let mut export = write::create(out, target, &outline, &mut origins)?;
    read(source, task, &mut |batch| {
        export.output.put(export.encode.encode(&batch)).map_err(Into::into)
    })?;
    Ok(export.output.finish()?)
}

/// Reads the scan on the lattice of its own grid: lattice coordinates are the grid's integers plus
/// 2^31.
fn read(
    source: &dyn Source,
    task: &dyn Task,
    take: &mut dyn FnMut(Batch) -> Result<()>,
) -> Result<u64> {
    let grid = &source.info().grid;
    let placement = Lattice::choose(std::slice::from_ref(grid))?.placement(grid);
    task.phase("generating", Some(source.info().points_hint), "points");
    let report = source.read(&placement, task, &mut |batch| {
        task.advance(batch.len() as u64);
        task.check()?;
        take(batch).map_err(|e| esker_scan::ScanError::Sink(e.into()))
    })?;
    Ok(report.points)
}
