//! The prioritised load queue (kanzok2015, section 3.2.1, item 3): its limits, and how requests
//! whose bytes are adjacent in the file become one batch, which one loader reads at once.

use crate::planes::{LoadRequest, Planes};
use esker_format::PlaneKind;
use std::collections::{BTreeMap, HashSet};

/// Greatest gap between two planes that is read along with them rather than skipped: a disk
/// transfers it in less time than it takes to start another read.
pub(crate) const GAP_BYTES_MAX: u64 = 32 << 10;

/// Greatest number of requests in progress: waiting, taken, or landed and not yet uploaded. More
/// than enough for tens of milliseconds of the smallest nodes. It bounds the queue and every
/// channel that reports requests, since each request is reported once.
pub(crate) const REQUESTS_MAX: usize = 1024;

/// Bytes that wait in the queue: what a disk of 2 GB/s reads in 30 ms, longer than the LOD thread
/// takes to fill it again; less if drawing memory is small, so that most of it can be drawn.
pub(crate) fn queue_bytes_max(drawing_bytes: u64) -> u64 {
    (drawing_bytes / 4).min(64 << 20)
}

/// Requests that are read together.
pub(crate) type Batch = Vec<LoadRequest>;

/// Range of the file from the first to the last byte of a request.
#[derive(Clone, Copy, Debug)]
struct Extent {
    start: u64,
    end: u64,
    /// Bytes of the request's planes.
    bytes: u64,
}

/// Joins requests, given best first, into batches, best first: a batch ranks as its best request.
/// No batch has more than `run_bytes`, gaps included, unless it is a single request. No request
/// joins a batch ahead of the request for the planes that it is drawn upon.
pub(crate) fn batches(requests: Vec<LoadRequest>, planes: &Planes, run_bytes: usize) -> Vec<Batch> {
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
                waiting[i].as_ref().is_some_and(|r| !bases.contains(&depends_on(r, planes)))
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

fn is_base(request: &LoadRequest) -> bool {
    request.planes.iter().any(|&(kind, _)| kind != PlaneKind::Residual)
}

/// The node whose base planes a request depends on: its own node for a residual, otherwise the
/// parent.
fn depends_on(request: &LoadRequest, planes: &Planes) -> u32 {
    if is_base(request) { planes.node(request.node).parent } else { request.node }
}

/// The adjacent request before or after an extent that may join it, and the joined extent.
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

/// Extent of a request; `None` for requests that are read alone.
fn extent(request: &LoadRequest, planes: &Planes) -> Option<Extent> {
    let mut extent = Extent { start: u64::MAX, end: 0, bytes: 0 };
    for &(kind, _) in &request.planes {
        let range = planes.in_file(request.node, kind)?;
        extent.start = extent.start.min(range.start);
        extent.end = extent.end.max(range.end);
        extent.bytes += range.end - range.start;
    }
    (!request.alone).then_some(extent)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landing::Slot;
    use crate::planes::VisibilityTest;
    use crate::testing::hills;
    use proptest::prelude::*;

    fn request(id: u64, node: u32, kinds: &[PlaneKind], alone: bool) -> LoadRequest {
        let slot = Slot { offset: 0, bytes: 0 };
        let planes = kinds.iter().map(|&kind| (kind, slot)).collect();
        let (filter, test) = (Default::default(), VisibilityTest::Contour);
        LoadRequest { id, node, planes, forest: hills(), filter, test, alone }
    }

    proptest! {
        #[test]
        fn each_request_is_in_one_batch_behind_what_it_is_drawn_upon(
            nodes in prop::collection::btree_set(0u32..140, 1..80), kinds in 0usize..3,
            run_bytes in 4096usize..200_000, lonely in 1u32..20,
        ) {
            let planes = Planes::of(hills());
            let nodes: Vec<u32> =
                nodes.into_iter().filter(|&n| (n as usize) < planes.forest.table().nodes.len()).collect();
            let all = [PlaneKind::Position, PlaneKind::Colour, PlaneKind::Attribute(7)];
            let mut requests = Vec::new();
            for &node in &nodes {
                let alone = node % lonely == 1;
                requests.push(request(requests.len() as u64, node, &all[..=kinds], alone));
                requests.push(request(requests.len() as u64, node, &[PlaneKind::Residual], alone));
            }
            let count = requests.len();
            let batches = batches(requests, &planes, run_bytes);
            let turns: BTreeMap<u64, usize> = batches
                .iter()
                .enumerate()
                .flat_map(|(turn, batch)| batch.iter().map(move |r| (r.id, turn)))
                .collect();
            prop_assert_eq!(turns.len(), count);
            prop_assert_eq!(batches.iter().map(Vec::len).sum::<usize>(), count);
            for (i, &node) in nodes.iter().enumerate() {
                let turn = turns[&(2 * i as u64)];
                prop_assert!(turn <= turns[&(2 * i as u64 + 1)], "the residual comes later");
                if let Ok(above) = nodes.binary_search(&planes.node(node).parent) {
                    prop_assert!(turns[&(2 * above as u64)] <= turn, "the child comes later");
                }
            }
            for batch in batches.iter().filter(|b| b.len() > 1) {
                prop_assert!(batch.iter().all(|r| !r.alone));
                let mut ranges: Vec<_> = batch
                    .iter()
                    .flat_map(|r| r.planes.iter().filter_map(|&(k, _)| planes.in_file(r.node, k)))
                    .collect();
                ranges.sort_by_key(|r| r.start);
                let bytes: u64 = ranges.iter().map(|r| r.end - r.start).sum();
                prop_assert!(bytes <= run_bytes as u64);
                let gaps = ranges.windows(2).map(|w| w[1].start - w[0].end);
                prop_assert!(gaps.max().unwrap_or(0) <= GAP_BYTES_MAX);
            }
        }
    }

    #[test]
    fn neighbours_are_read_at_once() {
        let planes = Planes::of(hills());
        let kinds = [PlaneKind::Position, PlaneKind::Colour];
        // Siblings whose parent is resident.
        let nodes = planes.node(0).children();
        let requests: Vec<_> = nodes.map(|n| request(n.into(), n, &kinds, false)).collect();
        assert!(requests.len() > 2);
        assert_eq!(batches(requests, &planes, 1 << 20).len(), 1);
    }
}
