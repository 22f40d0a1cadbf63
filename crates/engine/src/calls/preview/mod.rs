//! Previews of large scans, to look at while the whole file is built: small files of a share of the
//! points. The first one is of parts from all over the scans, read beforehand in about a second;
//! the second one is of points among all others, kept while the build reads them.

mod share;

use crate::calls::build::{self, BuildReport};
use crate::io::inputs;
use anyhow::Result;
use esker_builder::Options;
use esker_builder::budget::memory::MEMORY_BYTES_MIN;
use esker_points::{Cancelled, Task};
use esker_scan::Source;
use rayon::prelude::*;
use share::{Share, Thinned, Watched};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Points of a preview, about: as many as the pixels of a window.
const POINTS: u64 = 700_000;
/// Points that are decoded for the first preview at most: what two cores decode in half a second.
/// Those that are read together are neighbours, so more are read than are kept.
const DECODED: u64 = 4_000_000;
/// Points of text that are decoded at most: each is decoded twice, first for the bounds.
const DECODED_OF_TEXT: u64 = 2 * POINTS;
/// Number of points from which on there is a preview: smaller scans are built in hardly more time.
const WORTH: u64 = 5_000_000;
/// Most files of the first preview: each has to be opened for it.
const FILES_MAX: usize = 256;
/// Memory of the build that a second preview takes beside it, bytes: the least of any build, and
/// room for the points that are kept. A build with less than four times as much has none.
const MEMORY_BYTES: u64 = MEMORY_BYTES_MIN + (128 << 20);
const MEMORY_TIMES: u64 = 4;

/// Options of a preview, for those of the whole file: nothing that only splats need.
fn simple(options: &Options) -> Options {
    Options { sharp_features: false, tangents: false, compact: false, ..options.clone() }
}

/// Builds a preview of scans at `out` from parts of them. Returns its number of points and that of
/// the scans, about; `None`, and writes nothing, if the scans are small, too many, damaged, or
/// cannot be read in part.
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
    let Some(Shares { points: all, has_text }) = shares_of(&scans, options, task)? else {
        return Ok(None);
    };
    if all < WORTH {
        return Ok(None);
    }
    let one_in = all.div_ceil(if has_text { DECODED_OF_TEXT } else { DECODED });
    let every = all.div_ceil(one_in * POINTS).max(1);
    let one_in = u32::try_from(one_in).unwrap_or(u32::MAX);
    let simple = Options { one_in, ..simple(options) };
    let thin = |source| -> Box<dyn Source> { Box::new(Thinned::new(source, every)) };
    let thin = |sources: Vec<_>| sources.into_iter().map(thin).collect();
    let report = build::build_from(&scans, out, &simple, 0, &thin, task)?;
    Ok(Some([report.points_out, all]))
}

/// What is known of scans that can be read in part.
#[derive(Clone, Copy)]
struct Shares {
    /// Number of all points, about.
    points: u64,
    /// Whether some of them are text.
    has_text: bool,
}

/// What is known of scans; `None` if they cannot be read in part, or one is damaged, which the
/// build of the whole file reports.
fn shares_of(scans: &[PathBuf], options: &Options, task: &dyn Task) -> Result<Option<Shares>> {
    /// A source that is read in part is refused where it cannot be. Those that look for the bounds
    /// of their points read no more than this share, which shows how many there are.
    const ONE_IN: u32 = 64;
    if scans.len() > FILES_MAX {
        return Ok(None);
    }
    let reading = Options { one_in: ONE_IN, ..options.clone() }.open_options();
    let share = |path: &PathBuf| -> Result<Option<Shares>, Cancelled> {
        task.check()?;
        let source = esker_scan::open(path, &reading, task).ok();
        Ok(source.map(|source| Shares {
            points: source.info().points_hint.saturating_mul(ONE_IN.into()),
            has_text: source.is_text(),
        }))
    };
    let shares: Result<Vec<_>, _> = scans.par_iter().map(share).collect();
    let none = Shares { points: 0, has_text: false };
    Ok(shares?.into_iter().try_fold(none, |sum, share: Option<Shares>| {
        let share = share?;
        Some(Shares {
            points: sum.points.saturating_add(share.points),
            has_text: sum.has_text || share.has_text,
        })
    }))
}

/// Points that a build keeps for a second preview while it reads.
#[derive(Clone, Default)]
pub struct Sample {
    shares: Arc<Mutex<Vec<Share>>>,
}

impl Sample {
    /// Builds a preview at `out` of the points that were kept, once all were read. Returns its
    /// number of points; `None` if the scans are small.
    ///
    /// # Errors
    /// If space runs out, or `task` is cancelled; also if the build has chosen another lattice.
    pub fn build(&self, out: &Path, options: &Options, task: &dyn Task) -> Result<Option<u64>> {
        let shares = std::mem::take(&mut *self.lock());
        if shares.is_empty() {
            return Ok(None);
        }
        let sources = shares.into_iter().map(Share::into_source).collect();
        let options = Options { memory_bytes: MEMORY_BYTES_MIN, ..simple(options) };
        let report = esker_builder::build_sources(sources, out, &options, task)?;
        Ok(Some(report.points_out))
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Share>> {
        self.shares.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Builds `out` from scans as [`build::build`] does, and keeps points for a preview in `sample` if
/// the scans are large and there is memory for both.
///
/// # Errors
/// As for [`build::build`].
pub fn build_watched(
    inputs: &[PathBuf],
    out: &Path,
    options: &Options,
    sample: &Sample,
    task: &dyn Task,
) -> Result<BuildReport> {
    if options.memory_bytes < MEMORY_TIMES * MEMORY_BYTES {
        return build::build(inputs, out, options, 0, task);
    }
    let watch = |sources: Vec<Box<dyn Source>>| -> Vec<Box<dyn Source>> {
        let points = sources.iter().map(|source| source.info().points_hint);
        let points = points.fold(0, u64::saturating_add);
        if points < WORTH {
            return sources;
        }
        let every = points.div_ceil(POINTS);
        let watched = sources.into_iter().map(|source| -> Box<dyn Source> {
            let watched = Watched::new(source, every);
            sample.lock().push(watched.share());
            Box::new(watched)
        });
        watched.collect()
    };
    let whole = Options { memory_bytes: options.memory_bytes - MEMORY_BYTES, ..options.clone() };
    build::build_from(inputs, out, &whole, 0, &watch, task)
}
