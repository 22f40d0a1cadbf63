//! Writes a generated scan as LAS or LAZ, for programs that read nothing else and for measuring how fast
//! LAZ is decoded. Without a file it only generates, which says how fast that is.

mod las;

use anyhow::{Result, bail};
use esker_points::{Batch, Lattice, Task};
use esker_scan::write::{self, Outline, Target};
use esker_scan::{OpenOptions, Source};
use std::path::Path;

/// Opens a generated scan.
///
/// # Errors
/// Where the name is none of a generated scan.
pub fn open(spec: &Path, task: &dyn Task) -> Result<Box<dyn Source>> {
    if !esker_scan::synthetic::is_spec(spec) {
        bail!(
            "{}: is no generated scan; name one as synthetic:SCENE:POINTS[:SEED]",
            spec.display()
        );
    }
    Ok(esker_scan::open(spec, &OpenOptions::default(), task)?)
}

/// Generates all points and drops them; how many there were.
///
/// # Errors
/// Only on request.
pub fn generate(source: &dyn Source, task: &dyn Task) -> Result<u64> {
    read(source, task, &mut |_| Ok(()))
}

/// Writes all points to `out`, which appears when it is whole: LAZ or LAS, by its ending. The bytes of
/// the file.
///
/// # Errors
/// Where the ending is neither, or the file cannot be written.
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
    };
    let mut origins = std::iter::once(Ok(las::origin(info)));
    let mut export = write::create(out, target, &outline, &mut origins)?;
    read(source, task, &mut |batch| {
        export.output.put(export.encode.encode(&batch)).map_err(Into::into)
    })?;
    Ok(export.output.finish()?)
}

/// Reads on the lattice of the scan's own grid, whose coordinates are its integers and 2^31.
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
