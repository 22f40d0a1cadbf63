//! The hierarchical cache (kanzok2015, section 3.2.1, item 5): which planes of which nodes have a
//! slot, and which of them is least recently used. The unit is a plane of a node in one of its
//! forms ([`PlaneForm`]). The cache is closed under parent: a node enters only below a node that is
//! cached, and its base planes are evicted before those of its parent.

use crate::landing::Slot;
use crate::planes::{PlaneForm, Planes};
use crate::pool::Pool;
use esker_format::{Forest, PlaneKind};
use esker_points::node::NONE;
use std::cmp::Reverse;
use std::collections::HashMap;
use std::sync::Arc;

/// A plane with a slot.
#[derive(Clone, Copy, Debug)]
struct CachedPlane {
    form: PlaneForm,
    slot: Slot,
    /// Last pass that used the plane.
    stamp: u64,
    /// Whether its bytes have been uploaded; until then the plane is requested and cannot be
    /// evicted.
    is_resident: bool,
}

/// A node with slots, or with children that have slots.
#[derive(Debug, Default)]
struct Entry {
    planes: Vec<CachedPlane>,
    /// Number of child nodes with an entry.
    children: u32,
}

impl Entry {
    /// Whether positions of the node are uploaded, in whichever form.
    fn has_positions(&self) -> bool {
        self.planes.iter().any(|p| p.is_resident && p.form.kind.has_positions())
    }
}

/// The cache.
#[derive(Debug)]
pub(crate) struct Cache {
    forest: Arc<Forest>,
    pool: Pool,
    entries: HashMap<u32, Entry>,
    nodes_max: usize,
    /// Number of the pass; planes stamped with it are in use.
    pass: u64,
    /// Planes that may be evicted in this pass, the first to leave last. Made on first use.
    leaving: Option<Vec<(u64, Reverse<u32>, PlaneForm)>>,
    resident: usize,
    evicted: u64,
}

impl Cache {
    pub(crate) fn new(forest: Arc<Forest>, pool: Pool, nodes_max: usize) -> Self {
        let roots = forest.table().roots().count();
        Self {
            forest,
            pool,
            entries: HashMap::new(),
            nodes_max: nodes_max.max(roots),
            pass: 0,
            leaving: None,
            resident: 0,
            evicted: 0,
        }
    }

    /// Takes a newer table of the forest, in which nodes have the same indices.
    pub(crate) fn grow(&mut self, forest: Arc<Forest>) {
        self.forest = forest;
    }

    pub(crate) fn pool(&self) -> &Pool {
        &self.pool
    }

    /// Number of nodes whose positions are uploaded.
    pub(crate) fn resident_nodes(&self) -> usize {
        self.resident
    }

    /// Number of nodes evicted so far.
    pub(crate) fn evicted(&self) -> u64 {
        self.evicted
    }

    pub(crate) fn has_node(&self, node: u32) -> bool {
        self.entries.contains_key(&node)
    }

    /// Planes of a node in a form: more than one while a root leaves memory beyond the budget.
    fn forms(&self, node: u32, form: PlaneForm) -> impl Iterator<Item = &CachedPlane> {
        let planes = self.entries.get(&node).map_or(&[][..], |entry| &entry.planes);
        planes.iter().filter(move |p| p.form == form)
    }

    /// Whether a plane has a slot within the budget or that is not uploaded yet.
    pub(crate) fn has(&self, node: u32, form: PlaneForm) -> bool {
        self.forms(node, form).any(|p| !p.is_resident || !self.pool.is_beyond(p.slot))
    }

    /// Slot of a plane that is uploaded. Slots beyond the budget count for roots alone, so that
    /// there is always something to draw.
    pub(crate) fn resident(&self, node: u32, form: PlaneForm) -> Option<Slot> {
        let uploaded = || self.forms(node, form).filter(|p| p.is_resident).map(|p| p.slot);
        let within = uploaded().find(|slot| !self.pool.is_beyond(*slot));
        within.or_else(|| uploaded().next().filter(|_| self.is_root(node)))
    }

    /// Whether all of `kinds` that the node has are uploaded in the form of `planes`.
    pub(crate) fn is_resident(&self, planes: &Planes, node: u32, kinds: &[PlaneKind]) -> bool {
        let is_resident = |k| self.resident(node, planes.form(node, k)).is_some();
        kinds.iter().all(|&k| is_resident(k) || !planes.has(node, k))
    }

    fn is_root(&self, node: u32) -> bool {
        self.forest.record(node).parent == NONE
    }

    /// Begins a pass: planes that are not touched from here on may be evicted.
    pub(crate) fn begin_pass(&mut self) {
        self.pass += 1;
        self.leaving = None;
    }

    /// Keeps a plane through this pass, if it is cached.
    pub(crate) fn touch(&mut self, node: u32, form: PlaneForm) {
        let planes = self.entries.get_mut(&node).map(|entry| &mut entry.planes);
        for plane in planes.into_iter().flatten().filter(|p| p.form == form) {
            plane.stamp = self.pass;
        }
    }

    /// Changes the budget of drawing memory. Slots beyond a lower one are used no more, except of
    /// roots, and [`Cache::vacate`] frees them.
    pub(crate) fn resize(&mut self, bytes: u64) {
        self.pool.resize(bytes);
    }

    /// Frees the slots beyond the budget, after a cut without them was published. Those of requests
    /// in progress remain, and those of roots that are in use and not loaded again yet. Returns
    /// whether none remains.
    pub(crate) fn vacate(&mut self) -> bool {
        let (mut gone, mut is_done) = (Vec::new(), true);
        for (&node, entry) in &self.entries {
            let is_root = self.is_root(node);
            for p in entry.planes.iter().filter(|p| self.pool.is_beyond(p.slot)) {
                let is_drawn =
                    is_root && p.stamp == self.pass && self.resident(node, p.form) == Some(p.slot);
                if p.is_resident && !is_drawn {
                    gone.push((node, p.slot));
                } else {
                    is_done = false;
                }
            }
        }
        for (node, slot) in gone {
            self.release(node, slot);
            self.evicted += u64::from(!self.has_node(node));
        }
        self.leaving = None;
        is_done
    }

    /// Finds slots for planes of a node that have none, in the form of `planes`, evicting the least
    /// recently used planes for them. `base` are the base planes of nodes. Returns `None` and takes
    /// no slot if there is no room or the parent is not cached.
    pub(crate) fn reserve(
        &mut self,
        planes: &Planes,
        node: u32,
        kinds: &[PlaneKind],
        base: &[PlaneKind],
    ) -> Option<Vec<(PlaneKind, Slot)>> {
        let parent = self.forest.record(node).parent;
        let is_root = self.is_root(node);
        if !is_root && !self.has_node(parent) {
            return None;
        }
        while !self.has_node(node) && self.entries.len() >= self.nodes_max {
            self.evict_one(planes, base).then_some(())?;
        }
        let mut slots = Vec::with_capacity(kinds.len());
        for &kind in kinds {
            let bytes = planes.bytes(node, kind);
            let slot = loop {
                let slot = self.pool.take(bytes);
                if slot.is_some() || !self.evict_one(planes, base) {
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
            if let Some(above) = self.entries.get_mut(&parent).filter(|_| !is_root) {
                above.children += 1;
            }
        }
        let (entry, stamp) = (self.entries.entry(node).or_default(), self.pass);
        let requested = |&(kind, slot): &(PlaneKind, Slot)| {
            let form = planes.form(node, kind);
            CachedPlane { form, slot, stamp, is_resident: false }
        };
        entry.planes.extend(slots.iter().map(requested));
        Some(slots)
    }

    /// Marks the plane with this slot as uploaded.
    pub(crate) fn arrive(&mut self, node: u32, slot: Slot) {
        let Some(entry) = self.entries.get_mut(&node) else { return };
        let had = entry.has_positions();
        if let Some(plane) = entry.planes.iter_mut().find(|p| p.slot == slot) {
            plane.is_resident = true;
        }
        self.resident += usize::from(!had && entry.has_positions());
    }

    /// Frees the slot of a plane.
    pub(crate) fn release(&mut self, node: u32, slot: Slot) {
        let Some(entry) = self.entries.get_mut(&node) else { return };
        let had = entry.has_positions();
        if let Some(at) = entry.planes.iter().position(|p| p.slot == slot) {
            entry.planes.swap_remove(at);
            self.pool.give(slot);
        }
        self.resident -= usize::from(had && !entry.has_positions());
        self.drop_empty(node);
    }

    /// Removes the entry of a node without slots and children, and then of ancestors that become
    /// empty.
    fn drop_empty(&mut self, mut node: u32) {
        while self.entries.get(&node).is_some_and(|e| e.planes.is_empty() && e.children == 0) {
            self.entries.remove(&node);
            node = self.forest.record(node).parent;
            let Some(above) = self.entries.get_mut(&node) else { break };
            above.children -= 1;
        }
    }

    /// Evicts one plane; false if none may be evicted.
    fn evict_one(&mut self, planes: &Planes, base: &[PlaneKind]) -> bool {
        let mut leaving = self.leaving.take().unwrap_or_else(|| self.unused());
        let next = loop {
            let Some((_, Reverse(node), form)) = leaving.pop() else { break None };
            let is_leaf = self.entries.get(&node).is_some_and(|e| e.children == 0);
            let is_base = base.contains(&form.kind) && planes.form(node, form.kind) == form;
            // A parent with a child in progress stays until that child has arrived and left.
            let unused = self.forms(node, form).find(|p| p.is_resident).map(|p| p.slot);
            if let Some(slot) = unused.filter(|_| is_leaf || !is_base) {
                break Some((node, slot));
            }
        };
        self.leaving = Some(leaving);
        let Some((node, slot)) = next else { return false };
        self.release(node, slot);
        self.evicted += u64::from(!self.has_node(node));
        true
    }

    /// Uploaded planes that this pass did not use. Of equal age, children are evicted first: their
    /// index is greater than their parent's, and they are never used without it.
    fn unused(&self) -> Vec<(u64, Reverse<u32>, PlaneForm)> {
        let mut unused = Vec::new();
        for (&node, entry) in &self.entries {
            let old = entry.planes.iter().filter(|p| p.is_resident && p.stamp < self.pass);
            unused.extend(old.map(|p| (p.stamp, Reverse(node), p.form)));
        }
        unused.sort_unstable_by(|a, b| b.cmp(a));
        unused
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::hills;
    use proptest::prelude::*;

    const BASE: [PlaneKind; 2] = [PlaneKind::Position, PlaneKind::Colour];

    impl Cache {
        /// Asserts the invariants.
        fn check(&self) -> Result<(), TestCaseError> {
            let mut children: HashMap<u32, u32> = HashMap::new();
            for &node in self.entries.keys().filter(|&&n| !self.is_root(n)) {
                let parent = self.forest.record(node).parent;
                prop_assert!(self.has_node(parent), "{} is without {}", node, parent);
                *children.entry(parent).or_default() += 1;
            }
            let mut used = 0;
            for (node, entry) in &self.entries {
                prop_assert_eq!(entry.children, children.get(node).copied().unwrap_or(0));
                prop_assert!(entry.children > 0 || !entry.planes.is_empty());
                used += entry.planes.iter().map(|p| Pool::taken(p.slot.bytes)).sum::<u64>();
            }
            prop_assert_eq!(used, self.pool.used());
            let resident = self.entries.values().filter(|entry| entry.has_positions());
            prop_assert_eq!(resident.count(), self.resident);
            Ok(())
        }
    }

    /// A path from the root: each number chooses a child.
    fn path(planes: &Planes, turns: &[u8]) -> Vec<u32> {
        let mut path = vec![0];
        for &turn in turns {
            let children = planes.node(path[path.len() - 1]).children();
            let Some(child) = children.clone().nth(usize::from(turn) % children.len().max(1))
            else {
                break;
            };
            path.push(child);
        }
        path
    }

    proptest! {
        #[test]
        fn it_stays_closed_under_parent_and_keeps_what_is_in_use(
            pages in 2u64..6, nodes_max in 3usize..40,
            passes in prop::collection::vec(
                (prop::collection::vec(any::<u8>(), 1..5), any::<bool>(), 0u8..4), 1..60),
        ) {
            let planes = Planes::of(hills());
            let mut cache =
                Cache::new(Arc::clone(&planes.forest), Pool::new(pages * (64 << 10), 64 << 10), nodes_max);
            let mut requested: Vec<(u32, Slot)> = Vec::new();
            for (turns, with_residual, fate) in passes {
                cache.begin_pass();
                let path = path(&planes, &turns);
                for &node in &path {
                    BASE.iter().for_each(|&kind| cache.touch(node, planes.form(node, kind)));
                }
                for &node in &path {
                    let mut kinds = BASE.to_vec();
                    kinds.extend(with_residual.then_some(PlaneKind::Residual));
                    kinds.retain(|&kind| !cache.has(node, planes.form(node, kind)));
                    let kept = path.iter().filter(|&&n| cache.is_resident(&planes, n, &BASE)).count();
                    let slots = cache.reserve(&planes, node, &kinds, &BASE);
                    requested.extend(slots.into_iter().flatten().map(|(_, slot)| (node, slot)));
                    let still = path.iter().filter(|&&n| cache.is_resident(&planes, n, &BASE)).count();
                    prop_assert_eq!(kept, still, "what is in use stays");
                    cache.check()?;
                }
                // Some arrive, some fail, some are still in progress.
                let ends = requested.len() * usize::from(fate) / 3;
                for (i, (node, slot)) in requested.drain(..ends.min(requested.len())).enumerate() {
                    if i % 5 == 4 { cache.release(node, slot) } else { cache.arrive(node, slot) }
                }
                cache.check()?;
                prop_assert!(cache.entries.len() <= nodes_max);
            }
        }
    }
}
