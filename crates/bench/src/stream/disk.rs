//! Rates of the disk without Esker, which streaming is compared with in the same run: a plain
//! sequential read of a file, and plain reads of given ranges, as many at once as loaders make.

use anyhow::{Context, Result};
use esker_format::{Forest, PlaneKind};
use esker_points::Task;
use esker_points::node::NONE;
use esker_points::read_at::{Input, is_remote};
use esker_stream::Cut;
use std::io::Read;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::Instant;

/// Bytes of a read.
const READ_BYTES: usize = 1 << 20;
/// Ranges with at most this gap between them are read at once, as loaders do.
const GAP_BYTES: u64 = 64 << 10;
/// Bytes after which the sequential read of a large file stops: reading all of it would take longer
/// than the rest of the run.
const SEQUENTIAL_BYTES_MAX: u64 = 2 << 30;

/// The same for a file at an address.
const REMOTE_BYTES_MAX: u64 = 16 << 20;

/// Reads a file from its beginning, at most [`SEQUENTIAL_BYTES_MAX`], and returns bytes a second.
///
/// # Errors
/// If the file cannot be read, or `task` is cancelled.
pub(super) fn sequential_rate(path: &Path, task: &dyn Task) -> Result<f64> {
    let context = || format!("{}: cannot read", path.display());
    let mut file = Input::open(path).with_context(context)?;
    let most = if is_remote(path) { REMOTE_BYTES_MAX } else { SEQUENTIAL_BYTES_MAX };
    let mut buffer = vec![0; READ_BYTES];
    let start = Instant::now();
    let mut bytes = 0u64;
    while bytes < most {
        task.check()?;
        match file.read(&mut buffer).with_context(context)? {
            0 => break,
            n => bytes += n as u64,
        }
    }
    Ok(bytes as f64 / start.elapsed().as_secs_f64().max(1e-9))
}

/// Lists the ranges of `file` that hold the planes of `cut`, without those of the roots; adjacent
/// ranges are joined, and none is longer than a read.
pub(super) fn ranges_of(file: &Forest, cut: &Cut) -> Vec<Range<u64>> {
    let mut ranges = ranges_in(file, cut, |node| file.record(node).parent != NONE);
    ranges.sort_by_key(|r| r.start);
    let mut joined: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match joined.last_mut() {
            Some(last)
                if range.start <= last.end + GAP_BYTES
                    && range.end - last.start <= READ_BYTES as u64 =>
            {
                last.end = last.end.max(range.end);
            }
            _ => joined.push(range),
        }
    }
    let pieces = |r: Range<u64>| {
        let end = r.end;
        r.step_by(READ_BYTES).map(move |at| at..end.min(at + READ_BYTES as u64))
    };
    joined.into_iter().flat_map(pieces).collect()
}

/// Lists the ranges of `file` that hold the planes of `cut`.
pub(super) fn ranges_of_all(file: &Forest, cut: &Cut) -> Vec<Range<u64>> {
    ranges_in(file, cut, |_| true)
}

/// Lists the ranges of the planes of some nodes of a cut.
fn ranges_in(file: &Forest, cut: &Cut, is_listed: impl Fn(u32) -> bool) -> Vec<Range<u64>> {
    let mut ranges: Vec<Range<u64>> = Vec::new();
    for drawn in cut.nodes.iter().filter(|drawn| is_listed(drawn.node)) {
        let node = file.record(drawn.node);
        let range = |&(kind, _): &(PlaneKind, _)| {
            let range = file.plane_range(drawn.node, kind)?;
            Some(node.page_offset + range.start..node.page_offset + range.end)
        };
        ranges.extend(drawn.planes.iter().filter_map(range).filter(|r| !r.is_empty()));
    }
    ranges
}

/// Reads `ranges`, `in_flight` at a time, and returns the seconds that it took.
///
/// # Errors
/// If a read fails.
pub(super) fn plain_seconds(file: &Forest, ranges: &[Range<u64>], in_flight: usize) -> Result<f64> {
    let next = AtomicUsize::new(0);
    let longest = ranges.iter().map(|r| r.end - r.start).max().unwrap_or(0);
    let read = || -> Result<()> {
        let mut buffer = vec![0; longest as usize];
        while let Some(range) = ranges.get(next.fetch_add(1, Relaxed)) {
            let buffer = &mut buffer[..(range.end - range.start) as usize];
            file.read_exact_at(buffer, range.start)?;
        }
        Ok(())
    };
    let start = Instant::now();
    std::thread::scope(|scope| {
        let reader = |i| {
            let thread = std::thread::Builder::new().name(format!("plain-read-{i}"));
            thread.spawn_scoped(scope, read).context("cannot start a reading thread")
        };
        let readers: Vec<_> = (0..in_flight).map(reader).collect::<Result<_>>()?;
        readers.into_iter().try_for_each(|r| match r.join() {
            Ok(result) => result,
            Err(_) => anyhow::bail!("a reading thread panicked"),
        })
    })?;
    Ok(start.elapsed().as_secs_f64())
}
