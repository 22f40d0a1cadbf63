//! The second half of a pass: missing planes of a choice become requests with slots, best first,
//! which replace those that no loader has taken. Also handles the end of requests.

use crate::batch::{REQUESTS_MAX, batches, queue_bytes_max};
use crate::choose::{Choice, Chooser};
use crate::landing::Slot;
use crate::planes::{LoadRequest, Planes, VisibilityTest};
use crate::priority::{Scorer, load_candidates};
use esker_format::PlaneKind;
use esker_lod::Lacking;
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Number of planes without a slot after which the rest is left for the next pass.
const UNPLACED_MAX: usize = 16;

impl Chooser {
    /// Replaces the load queue. Returns false if some planes of the picture found no slot.
    pub(crate) fn request_missing(&mut self, choice: &Choice) -> bool {
        self.take_back();
        self.has_more = false;
        self.request_roots();
        if !self.shows_newest() && !self.planes.roots().any(|root| self.retries.has_failed(root)) {
            // All other nodes are chosen anew once the drawn ones have their new planes.
            self.request_drawn();
            return true;
        }
        let now = Instant::now();
        let scorer = Scorer::new(&self.planes, &choice.view, self.options.priority);
        let candidates = load_candidates(choice, &scorer, |node, kinds| {
            let may = self.retries.may_request(node, now);
            let missing = |k: &PlaneKind| may && self.is_missing(&self.planes, node, *k);
            kinds.iter().copied().filter(missing).collect()
        });
        let bytes_max = queue_bytes_max(self.options.drawing_bytes);
        let (mut bytes, mut unplaced, mut requests) = (0, 0, Vec::new());
        let (mut unplaced_around, mut around) = (0, Vec::new());
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
            let Self { cache, planes, .. } = self;
            let slots = cache.reserve(planes, candidate.node, &candidate.kinds, &choice.base);
            let Some(slots) = slots else {
                *(if candidate.is_around { &mut unplaced_around } else { &mut unplaced }) += 1;
                continue;
            };
            bytes += slots.iter().map(|(_, slot)| slot.bytes).sum::<u64>();
            let test = match candidate.is_seen {
                _ if is_root || candidate.is_around => VisibilityTest::Always,
                true => VisibilityTest::Contour,
                false => VisibilityTest::Cell,
            };
            let planes = self.planes.clone();
            let request = self.request(candidate.node, slots, &planes, test);
            if candidate.is_around { around.push(request) } else { requests.push(request) }
        }
        let mut links = self.request_links(choice);
        links.append(&mut requests);
        let planes = self.planes.clone();
        self.send(&planes, links, around);
        unplaced == 0
    }

    /// Requests for what is below the nodes in view that stand for more of a tree, and for the
    /// children that nodes lack. They come before all others: they are short, and what is to be
    /// read next depends on them.
    fn request_links(&mut self, choice: &Choice) -> Vec<LoadRequest> {
        let (mut requests, forest) = (Vec::new(), &self.planes.forest);
        if !forest.grows() {
            return requests;
        }
        let (planes, is_partial) = (self.planes.clone(), forest.is_partial());
        let (asked, now) = (self.requests.values(), Instant::now());
        let asked: HashSet<u32> =
            asked.filter(|r| !is_partial || r.planes.is_empty()).map(|r| r.node).collect();
        let hidden = choice.selection.hidden.iter().map(|hidden| hidden.node);
        let links = hidden.filter(|&node| planes.is_link(node));
        // Where they are is not all that the choice depends on.
        let lacking = choice.selection.lacking.iter().copied();
        let lacking = lacking.filter(|of| self.retries.may_request(of.node, now));
        let lacking = Lacking::urgent(&lacking.collect::<Vec<_>>()).into_iter();
        let lacking = lacking.map(|node| (node, VisibilityTest::Always));
        let links = links.map(|node| (node, VisibilityTest::Cell)).chain(lacking);
        for (node, test) in links.filter(|(node, _)| !asked.contains(node)) {
            if self.requests.len() < REQUESTS_MAX && self.retries.may_request(node, now) {
                requests.push(self.request(node, Vec::new(), &planes, test));
            }
        }
        requests
    }

    /// Whether a node has a plane that is neither resident nor requested in the form of `planes`.
    fn is_missing(&self, planes: &Planes, node: u32, kind: PlaneKind) -> bool {
        planes.has(node, kind) && !self.cache.has(node, planes.form(node, kind))
    }

    /// Requests the base planes of the roots that are missing.
    pub(crate) fn request_roots(&mut self) {
        let roots: Vec<u32> = self.planes.roots().collect();
        self.request_newest(&roots, VisibilityTest::Always);
    }

    /// Requests what is missing of the planes that the nodes of the front cut are shown with next:
    /// until they have them, or memory is full, that cut stays as it is.
    fn request_drawn(&mut self) {
        let filter = &self.newest_planes.filter;
        let drawn = self.drawn.iter().map(|d| d.node);
        let drawn: Vec<u32> = drawn.filter(|&node| filter.points_max(node) > 0).collect();
        self.is_full |= !self.request_newest(&drawn, VisibilityTest::Contour);
    }

    /// Requests what `nodes`, parents first, lack of the base planes of what is shown next. Returns
    /// false if some found no slot.
    fn request_newest(&mut self, nodes: &[u32], test: VisibilityTest) -> bool {
        let planes = self.newest_planes.clone();
        let (base, now) = (planes.base(&self.newest.needs), Instant::now());
        let bytes_max = queue_bytes_max(self.options.drawing_bytes);
        let (mut bytes, mut requests, mut are_placed) = (0, Vec::new(), true);
        for &node in nodes {
            let is_missing = |&k: &PlaneKind| self.is_missing(&planes, node, k);
            let kinds: Vec<_> = base.iter().copied().filter(is_missing).collect();
            if kinds.is_empty() || !self.retries.may_request(node, now) {
                continue;
            }
            let is_many = bytes >= bytes_max || self.requests.len() >= REQUESTS_MAX;
            if is_many && test != VisibilityTest::Always {
                self.has_more = true;
                break;
            }
            let Some(slots) = self.cache.reserve(&planes, node, &kinds, &base) else {
                are_placed = false;
                break;
            };
            bytes += slots.iter().map(|(_, slot)| slot.bytes).sum::<u64>();
            requests.push(self.request(node, slots, &planes, test));
        }
        if !requests.is_empty() {
            self.send(&planes, requests, Vec::new());
        }
        are_placed
    }

    /// Makes a request and notes it as in progress.
    fn request(
        &mut self,
        node: u32,
        slots: Vec<(PlaneKind, Slot)>,
        planes: &Planes,
        test: VisibilityTest,
    ) -> LoadRequest {
        self.last_id += 1;
        let (id, alone) = (self.last_id, self.retries.has_failed(node) || slots.is_empty());
        let (forest, filter) = (Arc::clone(&planes.forest), Arc::clone(&planes.filter));
        let request = LoadRequest { id, node, planes: slots, forest, filter, test, alone };
        self.requests.insert(request.id, request.clone());
        request
    }

    /// Puts requests into the queue, as batches; those for the surroundings behind all others, and
    /// in batches of their own, so that none makes a read for the picture longer.
    fn send(&mut self, planes: &Planes, requests: Vec<LoadRequest>, around: Vec<LoadRequest>) {
        self.shared.counts.waiting.fetch_add(requests.len() + around.len(), Relaxed);
        let mut all = batches(requests, planes, self.run_bytes);
        all.extend(batches(around, planes, self.run_bytes));
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
        for &(_, slot) in &request.planes {
            self.cache.release(request.node, slot);
        }
        Some(request.node)
    }

    /// Ends a request that a loader dropped, or that made more of a tree known.
    pub(crate) fn drop_request(&mut self, id: u64) {
        let is_link = self.requests.get(&id).is_some_and(|request| request.planes.is_empty());
        if let Some(node) = self.give_up(id)
            && is_link
        {
            self.retries.succeed(node);
        }
    }

    /// Ends a request whose bytes are all uploaded. Returns whether it made a node resident.
    pub(crate) fn arrive(&mut self, id: u64) -> bool {
        let Some(request) = self.requests.remove(&id) else { return false };
        for &(_, slot) in &request.planes {
            self.cache.arrive(request.node, slot);
        }
        self.retries.succeed(request.node);
        request.planes.iter().any(|&(kind, _)| kind.has_positions())
    }
}
