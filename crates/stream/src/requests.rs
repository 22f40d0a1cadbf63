//! The second half of a pass: missing planes of a choice become requests with slots, best first,
//! which replace those that no loader has taken. Also handles the end of requests.

use crate::batch::{REQUESTS_MAX, batches, queue_bytes_max};
use crate::choose::{Choice, Chooser};
use crate::landing::Slot;
use crate::planes::{LoadRequest, VisibilityTest};
use crate::priority::{Scorer, load_candidates};
use esker_format::PlaneKind;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Number of planes without a slot after which the rest is left for the next pass.
const UNPLACED_MAX: usize = 16;

impl Chooser {
    /// Replaces the load queue. Returns false if some planes of the picture found no slot.
    pub(crate) fn request_missing(&mut self, choice: &Choice) -> bool {
        self.take_back();
        if self.drawn_needs != self.needs {
            // All other nodes are chosen anew once the roots have their new planes, so the roots
            // are requested alone, unless they cannot be read.
            self.request_roots();
            if !self.planes.roots().any(|root| self.retries.has_failed(root)) {
                return true;
            }
        }
        let now = Instant::now();
        let scorer = Scorer::new(&self.planes, &choice.view, self.options.priority);
        let candidates = load_candidates(choice, &scorer, |node, kinds| {
            let may = self.retries.may_request(node, now);
            kinds.iter().copied().filter(|&k| may && self.is_missing(node, k)).collect()
        });
        let bytes_max = queue_bytes_max(self.options.drawing_bytes);
        let (mut bytes, mut unplaced, mut requests) = (0, 0, Vec::new());
        let (mut unplaced_around, mut around) = (0, Vec::new());
        self.has_more = false;
        for candidate in candidates {
            // The picture needs the holes that its surroundings would take.
            if candidate.is_around && (unplaced > 0 || unplaced_around >= UNPLACED_MAX) {
                break;
            }
            if bytes >= bytes_max || self.requests.len() >= REQUESTS_MAX || unplaced >= UNPLACED_MAX
            {
                self.has_more = unplaced < UNPLACED_MAX;
                break;
            }
            let is_root = self.planes.is_root(candidate.node);
            if !is_root && !self.cache.has_node(self.planes.node(candidate.node).parent) {
                continue;
            }
            let Some(slots) = self.cache.reserve(candidate.node, &candidate.kinds, &choice.base)
            else {
                *(if candidate.is_around { &mut unplaced_around } else { &mut unplaced }) += 1;
                continue;
            };
            bytes += slots.iter().map(|(_, slot)| slot.bytes).sum::<u64>();
            let test = match candidate.is_seen {
                _ if is_root || candidate.is_around => VisibilityTest::Always,
                true => VisibilityTest::Contour,
                false => VisibilityTest::Cell,
            };
            let request = self.request(candidate.node, slots, test);
            if candidate.is_around { around.push(request) } else { requests.push(request) }
        }
        self.send(requests, around);
        unplaced == 0
    }

    /// Whether a node has a plane that is neither resident nor requested.
    fn is_missing(&self, node: u32, kind: PlaneKind) -> bool {
        self.planes.has(node, kind) && !self.cache.has(node, kind)
    }

    /// Requests the base planes of the roots that are missing.
    pub(crate) fn request_roots(&mut self) {
        let (base, now) = (self.planes.base(&self.needs), Instant::now());
        let forest = Arc::clone(&self.planes.forest);
        let mut requests = Vec::new();
        for root in forest.table().roots() {
            let may_request = self.retries.may_request(root, now);
            let kinds: Vec<_> =
                base.iter().copied().filter(|&k| may_request && self.is_missing(root, k)).collect();
            if !kinds.is_empty()
                && let Some(slots) = self.cache.reserve(root, &kinds, &base)
            {
                requests.push(self.request(root, slots, VisibilityTest::Always));
            }
        }
        if !requests.is_empty() {
            self.send(requests, Vec::new());
        }
    }

    /// Makes a request and notes it as in progress.
    fn request(
        &mut self,
        node: u32,
        planes: Vec<(PlaneKind, Slot)>,
        test: VisibilityTest,
    ) -> LoadRequest {
        self.last_id += 1;
        let alone = self.retries.has_failed(node);
        let request = LoadRequest { id: self.last_id, node, planes, test, alone };
        self.requests.insert(request.id, request.clone());
        request
    }

    /// Puts requests into the queue, as batches; those for the surroundings behind all others, and
    /// in batches of their own, so that none makes a read for the picture longer.
    fn send(&mut self, requests: Vec<LoadRequest>, around: Vec<LoadRequest>) {
        self.shared.counts.waiting.fetch_add(requests.len() + around.len(), Relaxed);
        let mut all = batches(requests, &self.planes, self.run_bytes);
        all.extend(batches(around, &self.planes, self.run_bytes));
        self.queue.fill(all);
    }

    /// Withdraws the requests that no loader has taken; their slots were never written.
    pub(crate) fn take_back(&mut self) {
        for batch in self.queue.take_back() {
            self.shared.counts.waiting.fetch_sub(batch.len(), Relaxed);
            for request in batch {
                self.give_up(request.id);
            }
        }
    }

    /// Ends a request that will not be landed and frees its slots. Returns its node.
    pub(crate) fn give_up(&mut self, id: u64) -> Option<u32> {
        let request = self.requests.remove(&id)?;
        for &(kind, _) in &request.planes {
            self.cache.release(request.node, kind);
        }
        Some(request.node)
    }

    /// Ends a request whose bytes are all uploaded. Returns whether it made a node resident.
    pub(crate) fn arrive(&mut self, id: u64) -> bool {
        let Some(request) = self.requests.remove(&id) else { return false };
        for &(kind, _) in &request.planes {
            self.cache.arrive(request.node, kind);
        }
        self.retries.succeed(request.node);
        request.planes.iter().any(|&(kind, _)| kind.has_positions())
    }
}
