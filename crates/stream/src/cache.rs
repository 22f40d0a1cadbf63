//! The hierarchical cache (kanzok2015, section 3.2.1, item 5): which planes of which nodes have a slot,
//! and which of them has been of no use for longest. The unit is a node's plane. It is closed under
//! parent: a node is taken in below one that is there, and its base planes leave before its parent's do.

use crate::landing::Slot;
use crate::planes::Planes;
use crate::pool::Pool;
use esker_format::PlaneKind;
use std::cmp::Reverse;
use std::collections::HashMap;

/// A plane with a slot.
#[derive(Clone, Copy, Debug)]
struct Held {
    kind: PlaneKind,
    slot: Slot,
    /// The last pass that had a use for it.
    stamp: u64,
    /// Whether its bytes have been uploaded; until then it is asked for, and stays.
    is_resident: bool,
}

/// A node with slots, or with children that have some.
#[derive(Debug, Default)]
struct Entry {
    planes: Vec<Held>,
    /// Nodes below it that have an entry.
    children: u32,
}

/// The cache.
#[derive(Debug)]
pub(crate) struct Cache {
    planes: Planes,
    pool: Pool,
    entries: HashMap<u32, Entry>,
    nodes_max: usize,
    /// Counts choices: what was stamped in this one is in use.
    pass: u64,
    /// What may leave, in this pass; the first to leave is last. Made when first needed.
    leaving: Option<Vec<(u64, Reverse<u32>, PlaneKind)>>,
    evicted: u64,
}

impl Cache {
    pub(crate) fn new(planes: Planes, pool: Pool, nodes_max: usize) -> Self {
        Self {
            planes,
            pool,
            entries: HashMap::new(),
            nodes_max,
            pass: 0,
            leaving: None,
            evicted: 0,
        }
    }

    pub(crate) fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Nodes that have slots.
    pub(crate) fn nodes(&self) -> usize {
        self.entries.len()
    }

    /// Nodes that left so that others could come.
    pub(crate) fn evicted(&self) -> u64 {
        self.evicted
    }

    pub(crate) fn has_node(&self, node: u32) -> bool {
        self.entries.contains_key(&node)
    }

    fn held(&self, node: u32, kind: PlaneKind) -> Option<&Held> {
        self.entries.get(&node)?.planes.iter().find(|h| h.kind == kind)
    }

    /// Whether a plane has a slot, uploaded or not.
    pub(crate) fn has(&self, node: u32, kind: PlaneKind) -> bool {
        self.held(node, kind).is_some()
    }

    /// Where a plane is, once uploaded.
    pub(crate) fn resident(&self, node: u32, kind: PlaneKind) -> Option<Slot> {
        self.held(node, kind).filter(|h| h.is_resident).map(|h| h.slot)
    }

    /// Whether all of these planes are uploaded.
    pub(crate) fn is_resident(&self, node: u32, kinds: &[PlaneKind]) -> bool {
        kinds.iter().all(|&kind| self.resident(node, kind).is_some())
    }

    /// Begins a pass: from here on, what is not touched may leave.
    pub(crate) fn begin_pass(&mut self) {
        self.pass += 1;
        self.leaving = None;
    }

    /// Keeps a plane, where it is, through this pass.
    pub(crate) fn touch(&mut self, node: u32, kind: PlaneKind) {
        let pass = self.pass;
        let entry = self.entries.get_mut(&node);
        if let Some(held) = entry.and_then(|e| e.planes.iter_mut().find(|h| h.kind == kind)) {
            held.stamp = pass;
        }
    }

    /// Finds slots for planes of a node that have none, for the loaders to fill; what has been of no use
    /// for longest leaves for them. `base` are the planes that a node is drawn with. `None`, and no slot
    /// taken, where there is no place, or the parent is not here.
    pub(crate) fn reserve(
        &mut self,
        node: u32,
        kinds: &[PlaneKind],
        base: &[PlaneKind],
    ) -> Option<Vec<(PlaneKind, Slot)>> {
        let parent = self.planes.node(node).parent;
        if node != 0 && !self.has_node(parent) {
            return None;
        }
        while !self.has_node(node) && self.entries.len() >= self.nodes_max.max(1) {
            self.evict_one(base).then_some(())?;
        }
        let mut slots = Vec::with_capacity(kinds.len());
        for &kind in kinds {
            let bytes = self.planes.bytes(node, kind);
            let slot = loop {
                let slot = self.pool.take(bytes);
                if slot.is_some() || !self.evict_one(base) {
                    break slot;
                }
            };
            let Some(slot) = slot else {
                slots.drain(..).for_each(|(_, slot)| self.pool.give(slot));
                return None;
            };
            slots.push((kind, slot));
        }
        if !self.has_node(node) {
            self.entries.insert(node, Entry::default());
            if let Some(above) = self.entries.get_mut(&parent).filter(|_| node != 0) {
                above.children += 1;
            }
        }
        let (entry, stamp) = (self.entries.entry(node).or_default(), self.pass);
        let held = |&(kind, slot)| Held { kind, slot, stamp, is_resident: false };
        entry.planes.extend(slots.iter().map(held));
        Some(slots)
    }

    /// A plane has been uploaded.
    pub(crate) fn arrive(&mut self, node: u32, kind: PlaneKind) {
        let entry = self.entries.get_mut(&node);
        if let Some(held) = entry.and_then(|e| e.planes.iter_mut().find(|h| h.kind == kind)) {
            held.is_resident = true;
        }
    }

    /// Gives a plane's slot back.
    pub(crate) fn release(&mut self, node: u32, kind: PlaneKind) {
        let Some(entry) = self.entries.get_mut(&node) else { return };
        if let Some(at) = entry.planes.iter().position(|h| h.kind == kind) {
            self.pool.give(entry.planes.swap_remove(at).slot);
        }
        self.drop_empty(node);
    }

    /// Forgets a node that has neither slots nor children, and those above it that kept theirs for it.
    fn drop_empty(&mut self, mut node: u32) {
        while self.entries.get(&node).is_some_and(|e| e.planes.is_empty() && e.children == 0) {
            self.entries.remove(&node);
            node = self.planes.node(node).parent;
            let Some(above) = self.entries.get_mut(&node) else { break };
            above.children -= 1;
        }
    }

    /// Lets one plane leave; false where none may.
    fn evict_one(&mut self, base: &[PlaneKind]) -> bool {
        let mut leaving = self.leaving.take().unwrap_or_else(|| self.unused());
        let next = loop {
            let Some((_, Reverse(node), kind)) = leaving.pop() else { break None };
            let is_leaf = self.entries.get(&node).is_some_and(|e| e.children == 0);
            // A parent with a child on its way waits for it to arrive and leave.
            if is_leaf || !base.contains(&kind) {
                break Some((node, kind));
            }
        };
        self.leaving = Some(leaving);
        let Some((node, kind)) = next else { return false };
        self.release(node, kind);
        self.evicted += u64::from(!self.has_node(node));
        true
    }

    /// Uploaded planes that this pass had no use for. Of equal age children leave first: they stand
    /// behind their parents in the table, and are never used without them.
    fn unused(&self) -> Vec<(u64, Reverse<u32>, PlaneKind)> {
        let mut unused = Vec::new();
        for (&node, entry) in &self.entries {
            let old = entry.planes.iter().filter(|h| h.is_resident && h.stamp < self.pass);
            unused.extend(old.map(|h| (h.stamp, Reverse(node), h.kind)));
        }
        unused.sort_unstable_by(|a, b| b.cmp(a));
        unused
    }
}
