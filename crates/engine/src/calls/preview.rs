//! A preview: a small file of a share of the points that is spread over all of a scan, made in
//! about a second, to look at while the whole file is built.

use crate::calls::build;
use crate::io::inputs;
use anyhow::Result;
use esker_builder::Options;
use esker_points::{Cancelled, Task};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Points of a preview, about: a window has fewer pixels than twice as many.
const POINTS: u64 = 2_000_000;
/// Number of points over those of a preview from which on there is one: smaller scans are built in
/// hardly more time.
const WORTH: u64 = 3;
/// Most files of a preview: each has to be opened for it.
const FILES_MAX: usize = 256;

/// Builds a preview of scans at `out`, with `options` as for the whole file but without what is
/// only for splats. Returns its number of points and that of the scans; `None`, and writes nothing, if the
/// scans are small, too many, or of a format that is read from front to back.
///
/// # Errors
/// If an input is damaged, space runs out, or `task` is cancelled.
pub fn preview(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    task: &dyn Task,
) -> Result<Option<[u64; 2]>> {
    let scans = inputs::scans(inputs, task)?;
    let Some(all) = points_of(&scans, options, task)? else { return Ok(None) };
    if all < POINTS * WORTH {
        return Ok(None);
    }
    let one_in = u32::try_from(all.div_ceil(POINTS)).unwrap_or(u32::MAX);
    let simple = Options {
        one_in,
        sharp_features: false,
        tangents: false,
        compact: false,
        ..options.clone()
    };
    let report = build::build(inputs, out, &simple, 0, task)?;
    Ok(Some([report.points_out, all]))
}

/// Number of points of scans, about; `None` if they cannot be read in part, or one is damaged, which
/// the build of the whole file reports.
fn points_of(scans: &[PathBuf], options: &Options, task: &dyn Task) -> Result<Option<u64>> {
    /// A source that is read in part is refused where it cannot be.
    const ONE_IN: u32 = 2;
    if scans.len() > FILES_MAX {
        return Ok(None);
    }
    let reading = Options { one_in: ONE_IN, ..options.clone() }.open_options();
    let count = |path: &PathBuf| -> Result<Option<u64>, Cancelled> {
        task.check()?;
        let source = esker_scan::open(path, &reading, task).ok();
        Ok(source.map(|source| source.info().points_hint.saturating_mul(ONE_IN.into())))
    };
    let counts: Result<Vec<_>, _> = scans.par_iter().map(count).collect();
    Ok(counts?.into_iter().try_fold(0, |sum: u64, count| Some(sum.saturating_add(count?))))
}
