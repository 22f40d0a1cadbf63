//! The prioritised load queue (kanzok2015, section 3.2.1, item 3): what it holds at most, and how
//! requests whose bytes lie next to each other in the file become one batch, which one loader reads at
//! once.

use crate::planes::{Planes, Request};
use esker_format::PlaneKind;
use std::collections::{BTreeMap, HashSet};

/// Bytes between two planes that are read along with them rather than skipped: a disk gives them in
/// less time than it takes to begin another read.
pub(crate) const GAP_BYTES_MAX: u64 = 32 << 10;

/// Requests under way at once: waiting, taken, or landed and not yet uploaded. More than enough for
/// tens of milliseconds of the smallest nodes. Bounds the queue and every channel that tells of
/// requests, each of which is told of once.
pub(crate) const REQUESTS_MAX: usize = 1024;

/// Bytes that wait in the queue: what a disk of 2 GB/s reads in 30 ms, which is longer than the LOD
/// thread takes to fill it again; less where drawing memory is small, so that most of it can be drawn.
pub(crate) fn queue_bytes_max(drawing_bytes: u64) -> u64 {
    (drawing_bytes / 4).min(64 << 20)
}

/// Requests that are read together.
pub(crate) type Batch = Vec<Request>;

/// The bytes of the file from the first to the last of a request.
#[derive(Clone, Copy, Debug)]
struct Extent {
    start: u64,
    end: u64,
    /// Bytes of its planes.
    bytes: u64,
}

/// Joins requests, given best first, into batches, best first: each as good as its best. No batch has
/// more than `run_bytes`, gaps included, unless it is a single request; none is read along before what
/// it is drawn upon.
pub(crate) fn batches(requests: Vec<Request>, planes: &Planes, run_bytes: usize) -> Vec<Batch> {
    let extents: Vec<_> = requests.iter().map(|r| extent(r, planes)).collect();
    let starts = extents.iter().enumerate().filter_map(|(i, e)| Some((e.as_ref()?.start, i)));
    let mut at: BTreeMap<u64, usize> = starts.collect();
    let mut bases: HashSet<u32> = requests.iter().filter(|r| is_base(r)).map(|r| r.node).collect();
    let mut waiting: Vec<_> = requests.into_iter().map(Some).collect();
    let mut batches = Vec::new();
    for i in 0..waiting.len() {
        let Some(request) = waiting[i].take() else { continue };
        bases.remove(&request.node);
        let mut batch = vec![request];
        if let Some(mut extent) = extents[i] {
            // Another request may begin at the same byte; then this one is not in the map.
            if at.get(&extent.start) == Some(&i) {
                at.remove(&extent.start);
            }
            let may_join = |i: usize, bases: &HashSet<u32>| {
                waiting[i].as_ref().is_some_and(|r| !bases.contains(&below(r, planes)))
            };
            let bytes_max = run_bytes as u64;
            let mut joined = Vec::new();
            while let Some((start, next, both)) =
                neighbour(&at, &extents, extent, bytes_max).filter(|n| may_join(n.1, &bases))
            {
                at.remove(&start);
                bases.remove(&waiting[next].as_ref().map_or(0, |r| r.node));
                extent = both;
                joined.push(next);
            }
            batch.extend(joined.into_iter().filter_map(|next| waiting[next].take()));
        }
        batches.push(batch);
    }
    batches
}

fn is_base(request: &Request) -> bool {
    request.planes.iter().any(|&(kind, _)| kind != PlaneKind::Residual)
}

/// The node whose base planes a request is of no use without: for a residual its own node.
fn below(request: &Request, planes: &Planes) -> u32 {
    if is_base(request) { planes.node(request.node).parent } else { request.node }
}

/// The request right before or behind an extent that may be read along, and both together.
fn neighbour(
    at: &BTreeMap<u64, usize>,
    extents: &[Option<Extent>],
    extent: Extent,
    bytes_max: u64,
) -> Option<(u64, usize, Extent)> {
    let behind = at.range(extent.end..=extent.end.saturating_add(GAP_BYTES_MAX)).next();
    let before = at.range(..extent.start).next_back();
    behind.into_iter().chain(before).find_map(|(&start, &i)| {
        let other = extents[i]?;
        let gap = if start >= extent.end {
            start - extent.end
        } else {
            extent.start.checked_sub(other.end)?
        };
        let joined = Extent {
            start: extent.start.min(other.start),
            end: extent.end.max(other.end),
            bytes: extent.bytes + other.bytes + gap,
        };
        (gap <= GAP_BYTES_MAX && joined.bytes <= bytes_max).then_some((start, i, joined))
    })
}

/// `None` for requests that are read by themselves.
fn extent(request: &Request, planes: &Planes) -> Option<Extent> {
    let mut extent = Extent { start: u64::MAX, end: 0, bytes: 0 };
    for &(kind, _) in &request.planes {
        let range = planes.in_file(request.node, kind)?;
        extent.start = extent.start.min(range.start);
        extent.end = extent.end.max(range.end);
        extent.bytes += range.end - range.start;
    }
    (!request.alone).then_some(extent)
}
