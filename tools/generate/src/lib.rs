//! Writes a generated scan as LAS or LAZ, for programs that read nothing else and for measuring how fast
//! LAZ is decoded. Without a file it only generates, which says how fast that is.

mod las;

use anyhow::{Context, Result, bail};
use esker_points::{Batch, Lattice, Task};
use esker_scan::{OpenOptions, Source};
use las::Writer;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Bytes gathered before the file is written to.
const WRITE_BYTES: usize = 1 << 20;

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
    let ending = out.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let is_compressed = match ending.to_ascii_lowercase().as_str() {
        "laz" => true,
        "las" => false,
        _ => bail!("{}: name the file .laz or .las", out.display()),
    };
    let partial = PathBuf::from(format!("{}.partial", out.display()));
    let written = write_partial(source, &partial, is_compressed, task)
        .and_then(|bytes| Ok(std::fs::rename(&partial, out).map(|()| bytes)?));
    if written.is_err() {
        // What is said is why it was not written; whether the rest goes changes nothing.
        let _ = std::fs::remove_file(&partial);
    }
    written.with_context(|| format!("{}: cannot write it", out.display()))
}

fn write_partial(
    source: &dyn Source,
    partial: &Path,
    is_compressed: bool,
    task: &dyn Task,
) -> Result<u64> {
    let file = BufWriter::with_capacity(WRITE_BYTES, File::create(partial)?);
    let mut writer = Writer::new(file, source.info(), is_compressed)?;
    read(source, task, &mut |batch| writer.add(&batch))?;
    writer.finish()?;
    Ok(partial.metadata()?.len())
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
