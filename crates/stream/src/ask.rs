//! The second half of a pass: what a choice misses becomes requests with slots, best first, which
//! replace those that no loader has taken; and what becomes of requests.

use crate::batch::{REQUESTS_MAX, batches, queue_bytes_max};
use crate::choose::{Choice, Chooser};
use crate::landing::Slot;
use crate::planes::{Request, Sight};
use crate::priority::{Worth, wishes};
use esker_format::PlaneKind;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Wishes for which no place is found before the rest is left for the next pass.
const MISFITS_MAX: usize = 16;

impl Chooser {
    /// Replaces the load queue. False where something found no place.
    pub(crate) fn ask(&mut self, choice: &Choice) -> bool {
        self.take_back();
        if self.shown != self.needs {
            // With the roots' new planes everything else is chosen anew, so they come alone; unless
            // they cannot be had.
            self.ask_for_roots();
            if !self.planes.roots().any(|root| self.retries.has_failed(root)) {
                return true;
            }
        }
        let now = Instant::now();
        let worth = Worth::new(&self.planes, &choice.view, self.options.priority);
        let wishes = wishes(choice, &worth, |node, kinds| {
            let asks = self.retries.may_ask(node, now);
            kinds.iter().copied().filter(|&k| asks && self.lacks(node, k)).collect()
        });
        let bytes_max = queue_bytes_max(self.options.drawing_bytes);
        let (mut bytes, mut misfits, mut requests) = (0, 0, Vec::new());
        self.has_more = false;
        for wish in wishes {
            if bytes >= bytes_max || self.asked.len() >= REQUESTS_MAX || misfits >= MISFITS_MAX {
                self.has_more = misfits < MISFITS_MAX;
                break;
            }
            let is_root = self.planes.is_root(wish.node);
            if !is_root && !self.cache.has_node(self.planes.node(wish.node).parent) {
                continue;
            }
            let Some(slots) = self.cache.reserve(wish.node, &wish.kinds, &choice.base) else {
                misfits += 1;
                continue;
            };
            bytes += slots.iter().map(|(_, slot)| slot.bytes).sum::<u64>();
            let sight = match wish.is_seen {
                _ if is_root => Sight::Always,
                true => Sight::Contour,
                false => Sight::Cell,
            };
            requests.push(self.request(wish.node, slots, sight));
        }
        self.send(requests);
        misfits == 0
    }

    /// Whether a node has a plane that was not asked for yet.
    fn lacks(&self, node: u32, kind: PlaneKind) -> bool {
        self.planes.has(node, kind) && !self.cache.has(node, kind)
    }

    pub(crate) fn ask_for_roots(&mut self) {
        let (base, now) = (self.planes.base(&self.needs), Instant::now());
        let forest = Arc::clone(&self.planes.forest);
        let mut requests = Vec::new();
        for root in forest.table().roots() {
            let may_ask = self.retries.may_ask(root, now);
            let kinds: Vec<_> =
                base.iter().copied().filter(|&k| may_ask && self.lacks(root, k)).collect();
            if !kinds.is_empty()
                && let Some(slots) = self.cache.reserve(root, &kinds, &base)
            {
                requests.push(self.request(root, slots, Sight::Always));
            }
        }
        if !requests.is_empty() {
            self.send(requests);
        }
    }

    fn request(&mut self, node: u32, planes: Vec<(PlaneKind, Slot)>, sight: Sight) -> Request {
        self.last_id += 1;
        let alone = self.retries.has_failed(node);
        let request = Request { id: self.last_id, node, planes, sight, alone };
        self.asked.insert(request.id, request.clone());
        request
    }

    fn send(&mut self, requests: Vec<Request>) {
        self.shared.counts.waiting.fetch_add(requests.len(), Relaxed);
        self.queue.fill(batches(requests, &self.planes, self.run_bytes));
    }

    /// Takes back what no loader has taken yet; its slots were never written.
    pub(crate) fn take_back(&mut self) {
        for batch in self.queue.take_back() {
            self.shared.counts.waiting.fetch_sub(batch.len(), Relaxed);
            for request in batch {
                self.give_up(request.id);
            }
        }
    }

    /// A request that will not be landed: its slots are free again. Its node.
    pub(crate) fn give_up(&mut self, id: u64) -> Option<u32> {
        let request = self.asked.remove(&id)?;
        for &(kind, _) in &request.planes {
            self.cache.release(request.node, kind);
        }
        Some(request.node)
    }

    /// A request whose bytes are all uploaded. Whether a node has come with it.
    pub(crate) fn arrive(&mut self, id: u64) -> bool {
        let Some(request) = self.asked.remove(&id) else { return false };
        for &(kind, _) in &request.planes {
            self.cache.arrive(request.node, kind);
        }
        self.retries.succeed(request.node);
        request.planes.iter().any(|&(kind, _)| kind.has_positions())
    }
}
